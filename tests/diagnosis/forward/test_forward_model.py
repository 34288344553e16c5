"""The forward model against closed forms: heat alone, equilibrium against the spring, each effect's own mark."""

import math
from pathlib import Path

import numpy as np
import pytest

from sma_actuator.base.errors import UserError
from sma_actuator.diagnosis.forward.kernel import LOAD, MARTENSITE, POSITION, POWER, TEMPERATURE, simulate
from sma_actuator.diagnosis.forward.wire import read_wire, wire_yaml

ROOT = Path(__file__).resolve().parents[3]
MAKERS = ROOT / "config" / "flexinol_050_forward.yaml"


@pytest.fixture(scope="module")
def wire():
    """With cosines: beyond their band nothing transforms, which closed forms want."""
    return read_wire(MAKERS).with_values({"wire.kinetics": "liang_rogers"})


def _duty(high, on_s, off_s, step_s, before_s=1.0):
    parts = ((0.0, before_s), (high, on_s), (0.0, off_s))
    return np.concatenate([np.full(round(seconds / step_s), value) for value, seconds in parts])


def _area_m2(wire):
    return math.pi * wire.wire.diameter_m**2 / 4


def test_without_transformation_the_wire_warms_exponentially(wire):
    duty = np.full(400, 0.03)
    out = simulate(wire, duty, 0.1)
    power_W = out[:, POWER].mean()
    loss_W_K = wire.surroundings.heat_transfer_W_m2K * math.pi * wire.wire.diameter_m * wire.wire.length_m
    capacity_J_K = wire.wire.density_kg_m3 * _area_m2(wire) * wire.wire.length_m * wire.wire.specific_heat_J_kgK
    t = 0.1 * np.arange(1, 401)
    expected = 24.0 + power_W / loss_W_K * (1 - np.exp(-t * loss_W_K / capacity_J_K))
    assert out[:, MARTENSITE].min() == 1.0
    np.testing.assert_allclose(out[:, TEMPERATURE], expected, atol=0.02)


@pytest.mark.parametrize("heats, expected_W", (("rms", 0.2 * 24**2), ("mean", 0.2**2 * 24**2)))
def test_the_power_is_that_of_the_voltage_that_heats(wire, heats, expected_W):
    out = simulate(wire.with_values({"drive.heats": heats}), np.full(1, 0.2), 0.01)
    resistance_Ohm = wire.wire.martensite_resistivity_Ohm_m * wire.wire.length_m / _area_m2(wire)
    assert out[0, POWER] == pytest.approx(expected_W / resistance_Ohm, rel=0.05)  # 5 %: the strained wire is thinner


def test_hot_and_cold_it_stands_where_spring_and_wire_balance(wire):
    duty = _duty(0.2, 60.0, 200.0, 0.1)
    out = simulate(wire, duty, 0.1)
    w, area_m2 = wire.wire, _area_m2(wire)
    hot = out[600]
    assert hot[MARTENSITE] == 0.0
    cold_strain = w.transformation_strain + wire.bias.preload_N / area_m2 / w.martensite_modulus_Pa
    load_N = wire.bias.preload_N + wire.bias.stiffness_N_m * hot[POSITION]
    hot_strain = load_N / area_m2 / w.austenite_modulus_Pa + w.austenite_expansion_1_K * (hot[TEMPERATURE] - 24.0)
    assert hot[LOAD] == pytest.approx(load_N, rel=1e-6)
    assert hot[POSITION] == pytest.approx(w.length_m * (cold_strain - hot_strain), abs=1e-7)
    assert out[-1, POSITION] == pytest.approx(0.0, abs=1e-5)


def test_the_step_does_not_matter(wire):
    fine, coarse = (simulate(wire, _duty(0.2, 10.0, 30.0, step_s), step_s)[:, POSITION] for step_s in (0.01, 0.1))
    assert np.abs(fine[9::10] - coarse).max() < 0.03 * np.ptp(fine)


def test_after_power_off_a_hot_wire_shrinks_before_it_transforms(wire):
    out = simulate(wire, _duty(0.2, 30.0, 3.0, 0.1), 0.1)
    off = 310
    shrinks_m = out[off + 29, POSITION] - out[off - 1, POSITION]
    cooled_K = out[off - 1, TEMPERATURE] - out[off + 29, TEMPERATURE]
    assert out[off:, MARTENSITE].max() == 0.0
    assert shrinks_m == pytest.approx(wire.wire.austenite_expansion_1_K * cooled_K * wire.wire.length_m, rel=0.02)


def test_backlash_holds_the_sensor_at_a_reversal(wire):
    duty = _duty(0.2, 10.0, 60.0, 0.05)
    true = simulate(wire, duty, 0.05)[:, POSITION]
    seen = simulate(wire.with_values({"effects.backlash_m": 4e-4}), duty, 0.05)[:, POSITION]
    assert true.max() - seen.max() == pytest.approx(2e-4, rel=1e-3)
    assert np.abs(true - seen).max() <= 2e-4 + 1e-9


def test_friction_holds_the_slider_and_loads_the_wire(wire):
    duty = _duty(0.2, 10.0, 60.0, 0.05)
    out = simulate(wire.with_values({"effects.friction_N": 1.0}), duty, 0.05)
    spring_N = wire.bias.preload_N + wire.bias.stiffness_N_m * out[:, POSITION]
    assert np.abs(out[:, LOAD] - spring_N).max() <= 1.0 + 1e-6
    rising = np.diff(out[:, POSITION]) > 1e-4
    assert np.allclose((out[:, LOAD] - spring_N)[1:][rising], 1.0, atol=1e-6)


def test_a_dead_time_moves_the_whole_record(wire):
    duty = _duty(0.2, 5.0, 20.0, 0.1)
    prompt = simulate(wire, duty, 0.1)[:, POSITION]
    late = simulate(wire.with_values({"effects.dead_time_s": 0.5}), duty, 0.1)[:, POSITION]
    np.testing.assert_allclose(late[5:], prompt[:-5], atol=1e-9)


def test_a_wire_file_is_read_as_it_was_written(wire, tmp_path):
    changed = wire.with_values({"effects.spread_K": 4.0, "drive.heats": "mean"})
    (tmp_path / "w.yaml").write_text(wire_yaml(changed, "a comment"))
    assert read_wire(tmp_path / "w.yaml") == changed


@pytest.mark.parametrize(
    "old, new, sentence",
    (
        ("preload_N", "preloud_N", "bias.preloud_N: no such parameter; did you mean bias.preload_N?"),
        ("preload_N: 6.5", "preload_N: -6.5", "bias.preload_N: -6.5 is outside its range"),
        ("length_m: 1.0", "length_m: long", "wire.length_m: 'long' is not a number"),
        (
            "austenite_finish_C: 98.0",
            "austenite_finish_C: 80.0",
            "wire.austenite_finish_C: 80 °C is not above wire.austenite_start_C",
        ),
        ("heats: rms", "heats: peak", "drive.heats: 'peak' is not one of rms, mean"),
        ("  supply_V: 24.0", "  supply_V: [", "is not YAML"),
    ),
)
def test_a_wire_file_that_will_not_do_is_named_with_its_line(old, new, sentence, tmp_path):
    text = MAKERS.read_text()
    assert old in text
    (tmp_path / "w.yaml").write_text(text.replace(old, new))
    with pytest.raises(UserError) as raised:
        read_wire(tmp_path / "w.yaml")
    assert f"{tmp_path / 'w.yaml'}: line" in str(raised.value) and sentence in str(raised.value)
