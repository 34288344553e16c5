"""The chain: one for a sample and for a log, honest about what it does not know."""

import dataclasses
import itertools
import json
import math
import os
import subprocess
import sys
from math import inf, nan
from pathlib import Path

import numpy as np
import pytest

from sma_actuator.base.parameters import ConfigError, walk
from sma_actuator.base.share import shared_file
from sma_actuator.base.signals import Quality, Signals
from sma_actuator.bench.bench import VirtualBench
from sma_actuator.bench.in_process import InProcessDaq, InProcessSupply
from sma_actuator.config import Config, read_parameter_file
from sma_actuator.control import CONTROL_LAWS
from sma_actuator.estimation.chain import Chain, _quality, _velocity, stresses_inside_Pa
from sma_actuator.estimation.circuit import signals_from_reading, without_undriven
from sma_actuator.estimation.effects import EFFECTS as KNOWN
from sma_actuator.estimation.effects import EffectError
from sma_actuator.estimation.models import COEFFICIENTS, ModelError


@pytest.fixture
def config(make_config):
    return Config.from_mapping(make_config())


def signals(n=400, seed=0, resistance_Ohm=5.0):
    """n samples of a wire that goes twice through its loop, as arrays."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(n) * 0.05
    resistance = resistance_Ohm * (1.0 + 0.06 * np.cos(time_s)) + 1e-3 * rng.standard_normal(n)
    power = np.where(np.sin(time_s) > 0.0, 0.6, 0.013)
    load = 1.0 + 0.01 * rng.standard_normal(n)
    return Signals(time_s, resistance, np.sqrt(power / resistance), power, load, load / 1.82e-8)


def sample(arrays, i):
    values = (getattr(arrays, field.name) for field in dataclasses.fields(Signals))
    return Signals(*(value if np.isscalar(value) else float(value[i]) for value in values))


def test_sample_by_sample_gives_the_numbers_of_replay(config):
    arrays = signals()
    live, replay = Chain(config), Chain(config)
    experiment = replay.run(arrays)
    for i in range(len(arrays.time_s)):
        estimate = live.step(sample(arrays, i))[1]
        for name in ("displacement_m", "strain", "velocity_m_s", "branch", "quality"):
            assert getattr(estimate, name) == getattr(experiment, name)[i], f"{name} of sample {i}"


@pytest.mark.parametrize(
    ("field", "value"),
    (
        *itertools.product(("time_s", "resistance_Ohm", "stress_Pa", "power_W"), (nan, inf, -inf)),
        *(("resistance_Ohm", value) for value in (-5.0, 0.0, 0.99, 20.1, 9.9e37)),
    ),
)
def test_an_impossible_reading_leaves_the_memory_as_it_was(config, field, value):
    arrays = signals(50)
    disturbed, clean = Chain(config), Chain(config)
    for i in range(49):
        last = disturbed.step(sample(arrays, i))[1]
        clean.step(sample(arrays, i))
    invalid = disturbed.step(dataclasses.replace(sample(arrays, 48), **{field: value}))[1]
    assert invalid.quality is Quality.INVALID
    assert invalid.displacement_m == last.displacement_m
    a, b = (chain.step(sample(arrays, 49))[1] for chain in (disturbed, clean))
    assert a.displacement_m == b.displacement_m


@pytest.mark.parametrize("stress_Pa", (400e6, -400e6, 1e308), ids="{:g} Pa".format)
def test_a_stress_beyond_calibration_acts_as_the_stress_at_the_margin(config, stress_Pa):
    # A cubic in stress is anything at all out there; one such reading must not cost the estimate its memory.
    arrays = signals(60)
    lo, hi = config.model.stress_range
    margin = 0.05 * (hi - lo)
    wild, bounded = Chain(config), Chain(config)
    at = {400e6: hi + margin, -400e6: lo - margin, 1e308: hi + margin}[stress_Pa]
    for i in range(60):
        seen = sample(arrays, i)
        far, near = (wild, stress_Pa), (bounded, at)
        a, b = (e.step(dataclasses.replace(seen, stress_Pa=s) if i == 30 else seen)[1] for e, s in (far, near))
        assert a.displacement_m == b.displacement_m
        assert (a.quality is Quality.OUTSIDE_CALIBRATION) == (i == 30)
    arrays.stress_Pa[30] = stress_Pa
    assert Chain(config).run(arrays).displacement_m[-1] == a.displacement_m


def test_velocity_survives_a_clock_that_is_set_back(config):
    estimator = Chain(config)
    for i in range(400):
        time_s = (1e6 if i < 200 else 0.0) + i * 0.05
        estimate = estimator.step(Signals(time_s, 5.0 + i * 1e-4, 0.05, 0.0125, 1.0, 55e6))[1]
    assert estimate.velocity_m_s == pytest.approx(4.3e-3 * 1e-4 / 0.05, rel=1e-3)


def test_replay_treats_gaps_as_the_node_does(config):
    arrays = signals(60)
    arrays.resistance_Ohm[[0, 20, 21]] = nan
    arrays.resistance_Ohm[[40, 59]] = 0.0
    arrays.time_s[50] = nan
    experiment, live = Chain(config).run(arrays), Chain(config)
    for i in range(60):
        estimate = live.step(sample(arrays, i))[1]
        assert estimate.quality == experiment.quality[i]
        np.testing.assert_equal(estimate.displacement_m, experiment.displacement_m[i])


@pytest.mark.parametrize(
    ("change", "quality"),
    (
        ({}, Quality.DETERMINATE),
        ({"resistance_Ohm": 5.6}, Quality.INDETERMINATE_COLD),
        ({"resistance_Ohm": 4.3}, Quality.INDETERMINATE_HOT),
        ({"stress_Pa": 400e6}, Quality.OUTSIDE_CALIBRATION),
    ),
)
def test_quality_names_the_reason(config, change, quality):
    ordinary = Signals(0.0, 5.0, 0.3, 0.45, 1.0, 55e6)
    assert Chain(config).step(dataclasses.replace(ordinary, **change))[1].quality is quality


def test_velocity_is_the_slope_of_a_steady_motion(config):
    estimator = Chain(config)
    for i in range(200):
        estimate = estimator.step(Signals(i * 0.05, 5.0 + i * 1e-3, 0.05, 0.0125, 1.0, 55e6))[1]
    assert estimate.velocity_m_s == pytest.approx(4.3e-3 * 1e-3 / 0.05, rel=1e-3)


_WITHOUT_NUMBA = """
import json, sys
from sma_actuator.config import Config
from sma_actuator.estimation.chain import Chain, _quality, _velocity, stresses_inside_Pa
from sma_actuator.base.jit import COMPILED
from test_chain import signals

assert not COMPILED
config = Config.from_mapping(json.loads(sys.argv[1]))
print(json.dumps(Chain(config).run(signals(resistance_Ohm=float(sys.argv[2]))).displacement_m.tolist()))
"""


@pytest.mark.parametrize(
    ("name", "changes", "resistance_Ohm"),
    (
        ("flexinol", {}, 5.0),
        pytest.param("flexinol_normalised", {}, 5.0, marks=pytest.mark.long),
        pytest.param("furukawa", {"variant": "direct_switching"}, 1.9, marks=pytest.mark.long),
        ("furukawa", {"variant": "transition"}, 1.9),
        pytest.param("furukawa_normalised", {}, 1.9, marks=pytest.mark.long),
    ),
)
def test_numbers_do_not_depend_on_numba(name, changes, resistance_Ohm):
    pytest.importorskip("numba")
    mapping = read_parameter_file(shared_file(f"config/{name}.yaml"))
    mapping["model"] = {**mapping["model"], **changes}
    plain = subprocess.run(
        [sys.executable, "-c", _WITHOUT_NUMBA, json.dumps(mapping), str(resistance_Ohm)],
        env={**os.environ, "SMA_ACTUATOR_NO_JIT": "1", "PYTHONPATH": str(Path(__file__).parent)},
        capture_output=True,
        text=True,
        check=True,
        timeout=150,
    )
    compiled = Chain(Config.from_mapping(mapping)).run(signals(resistance_Ohm=resistance_Ohm)).displacement_m
    np.testing.assert_allclose(json.loads(plain.stdout), compiled, rtol=0, atol=1e-12)


# --- what is forgotten, and what is not ----------------------------------------------------------

#: Effects that are of the session: what has come since it began does not go because the estimate starts anew.
LASTING = {
    "slip": {"length": 3e-4, "time": 5.0},
    "creep": {"compliance": 3e-4, "time_constant": 20.0},
    "contact_drift": {"resistance": 0.3, "time_constant": 20.0},
    "fatigue": {"displacement": 2e-4, "cold_share": 1.0},  # where it is does not matter then
    "load_cell_drift": {"rate": 0.005},
}


def some(arrays, here):
    return Signals(
        **{f.name: v if np.isscalar(v := getattr(arrays, f.name)) else v[here] for f in dataclasses.fields(Signals)}
    )


@pytest.mark.parametrize("name", LASTING)
def test_what_has_come_over_the_wire_outlasts_a_reset(make_config, name):
    """What the effect takes off or adds afterwards is what it would have without the reset."""
    config = Config.from_mapping(make_config(effects={name: LASTING[name]}))
    arrays = signals()
    before, after = some(arrays, slice(0, 200)), some(arrays, slice(200, None))
    chain = Chain(config)
    chain.run(before)
    chain.reset()
    found, whole = chain.judge(after), Chain(config).judge(arrays)
    assert found.elapsed_s[0] == after.time_s[0] - before.time_s[0]
    np.testing.assert_array_equal(found.signals.load_N, whole.signals.load_N[200:])
    np.testing.assert_array_equal(found.resistance_Ohm, whole.resistance_Ohm[200:])
    added_m = whole.displacement_m - whole.model_m
    np.testing.assert_allclose(found.displacement_m - found.model_m, added_m[200:], rtol=1e-9, atol=1e-15)
    fresh = Chain(config).run(after)
    moved = np.abs(found.displacement_m - fresh.displacement_m) / 4e-3 + np.abs(
        found.signals.load_N - fresh.signals.load_N
    )
    assert moved.max() > 1e-3  # a session of its own would give something else


def test_what_is_derived_from_the_loop_is_forgotten_with_it(make_config):
    """After a reset an incomplete branch of before says nothing: the estimate is that of a new chain."""
    config = Config.from_mapping(make_config(effects={"minor_loop_memory": {"after_heating": 5e-4}}))
    arrays = signals()
    chain = Chain(config)
    chain.run(some(arrays, slice(0, 230)))
    chain.reset()
    after = some(arrays, slice(230, None))
    np.testing.assert_array_equal(chain.run(after).displacement_m, Chain(config).run(after).displacement_m)


def test_a_session_begins_with_nothing(make_config):
    config = Config.from_mapping(make_config(effects=LASTING))
    arrays = signals()
    chain = Chain(config)
    first = chain.run(arrays)
    chain.begin_session()
    np.testing.assert_array_equal(chain.run(arrays).displacement_m, first.displacement_m)


def test_a_tare_is_of_the_load_without_the_effects(make_config):
    """What the model knows of the load cell's drift is not taken off twice."""
    config = Config.from_mapping(
        make_config(effects={"load_cell_drift": {"offset": 0.1}, "load_cell_gain": {"gain": 0.2}})
    )
    chain = Chain(config)
    empty = Signals(0.0, 5.0, 0.05, 0.0125, 0.1 + 0.036, 1e6)
    measured, _ = chain.step(empty)
    assert measured.load_N == pytest.approx(0.03)

    def tared(time_s, load_N):
        return dataclasses.replace(empty, time_s=time_s, load_N=load_N - 0.03, tare_N=0.03)

    measured, _ = chain.step(tared(0.05, empty.load_N))
    assert measured.load_N == pytest.approx(0.0, abs=1e-12)
    assert measured.stress_Pa == pytest.approx(0.0, abs=1e-3)
    measured, _ = chain.step(tared(0.1, empty.load_N + 1.2))
    assert measured.load_N == pytest.approx(1.0)


@pytest.mark.parametrize("name", ["self_heating", "creep", "fatigue", "rate"])
def test_what_the_chain_drops_no_later_stage_sees(make_config, name):
    """Live and judged alike: impossible samples leave the memory of wire and mechanism as it was."""
    strong = {
        "self_heating": {"temperature_coefficient": 5e-4, "onset": 10.0},
        "rate": {"relaxation_time": 0.2},
        **LASTING,
    }
    config = Config.from_mapping(make_config(effects={name: strong[name]}))
    arrays = signals()
    spoilt = dataclasses.replace(arrays, resistance_Ohm=arrays.resistance_Ohm.copy(), power_W=arrays.power_W.copy())
    bad = np.zeros(len(arrays.time_s), dtype=bool)
    bad[[0, 57, 58, 200, 311]] = True
    spoilt.resistance_Ohm[bad] = [nan, 1e3, inf, 1e-6, -1.0]
    spoilt.power_W[bad] = 30.0
    judged, live = Chain(config).judge(spoilt), Chain(config)
    without = Chain(config).run(some(arrays, ~bad))
    np.testing.assert_array_equal(judged.quality == Quality.INVALID, bad)
    np.testing.assert_allclose(judged.displacement_m[~bad], without.displacement_m, rtol=1e-9)
    for i in range(len(bad)):
        np.testing.assert_equal(live.step(sample(spoilt, i))[1].displacement_m, judged.displacement_m[i])


@pytest.mark.parametrize("name", ["creep", "contact_drift", "self_heating"])
def test_a_clock_that_is_set_back_wrecks_no_memory(make_config, name):
    """What is of the session outlasts a reset, so it must outlast a clock: nothing grows while time runs backwards."""
    warm = {"temperature_coefficient": 5e-4, "onset": 10.0, "time_constant": 0.5}
    config = Config.from_mapping(make_config(effects={name: {**LASTING, "self_heating": warm}[name]}))
    arrays = signals()
    set_back = np.where(np.arange(400) < 200, arrays.time_s, arrays.time_s - 500.0)

    def taken_m(time_s):
        """The most that the effect changes, against a chain without it."""
        moved = dataclasses.replace(arrays, time_s=time_s)
        found = Chain(config).run(moved)
        assert (found.quality != Quality.INVALID).all()
        return np.abs(found.displacement_m - Chain(config, {}).run(moved).displacement_m).max()

    assert taken_m(set_back) < 2.0 * taken_m(arrays.time_s)


# --- live parameters -----------------------------------------------------------------------------

LIVE = {
    "estimator.heating_power": ("power", 0.8),
    "estimator.heating_power_hysteresis": ("heat_balance", 0.8),
    "estimator.thermal_time_constant": ("heat_balance", 0.3),
    "estimator.resistance_deadband": ("resistance_rate", 0.5),
    "estimator.velocity_time_constant": ("heat_balance", 2.0),
    "thermal.ambient_temperature": ("heat_balance", 60.0),
}


def test_every_live_parameter_of_the_estimate_is_in_the_list(config):
    live = {name for name, _, declaration, _ in walk(config) if declaration.live}
    assert {name for name in live if name.startswith("estimator.")} == {n for n in LIVE if n.startswith("estimator.")}


@pytest.mark.parametrize("name", LIVE)
def test_a_live_parameter_arrives_in_the_estimate(make_config, name):
    """After the update the chain gives what one gives that was made with the new value, and not what it gave."""
    decision, value = LIVE[name]
    effects = {"ambient_temperature": {"temperature_coefficient": 1e-3, "fading": 1e6}}
    old = Config.from_mapping(make_config(effects=effects)).replace({"estimator.branch_decision": decision})
    new = old.replace({name: value})
    changed = Chain(old)
    changed.update(new)
    wavering = signals()  # the branch is not decided by on and off alone
    wavering = dataclasses.replace(wavering, power_W=0.3 + 0.3 * np.sin(3.0 * wavering.time_s))
    found, wanted, stale = (chain.run(wavering) for chain in (changed, Chain(new), Chain(old)))
    for field in ("displacement_m", "velocity_m_s"):
        np.testing.assert_array_equal(getattr(found, field), getattr(wanted, field))
    assert (found.displacement_m != stale.displacement_m).any() or (found.velocity_m_s != stale.velocity_m_s).any()


def measured(wire, seconds=60.0):
    """What a wire of the bench shows that is heated far and cools again, with all that may be wrong with a sample:
    nothing measured, a sensor of the surroundings that lies or is none, a load beyond what was calibrated."""
    config = Config.from_mapping(read_parameter_file(shared_file(f"config/{wire}.yaml")))
    bench = VirtualBench.from_name("flexinol", seed=3, like=config.wire)
    supply, daq = InProcessSupply(bench, config), InProcessDaq(bench, config)
    supply.open(), daq.open()
    supply.set_output(True)
    rows: list[tuple[float, ...]] = []
    for number in range(round(seconds / 0.05)):
        turn = math.sin(2.0 * math.pi * number / 400.0)
        supply.set_current(config.supply.max_current * max(0.15, 0.9 * turn))
        bench.advance(bench.time_s + 0.05)
        rows.append(dataclasses.astuple(without_undriven(signals_from_reading(daq.read_block(), config), 0.05)))
    arrays = Signals(*np.array(rows).T)
    stress_Pa = np.where(np.arange(len(rows)) % 100 > 90, 20.0, 1.0) * arrays.stress_Pa
    stress_Pa[200:230] = 0.0
    arrays = dataclasses.replace(
        arrays,
        stress_Pa=stress_Pa,
        load_N=stress_Pa * config.wire.area_m2,
        resistance_Ohm=np.where(np.arange(len(rows)) % 37 == 36, 1e3, arrays.resistance_Ohm),
        power_W=np.where(np.arange(len(rows)) % 53 == 52, nan, arrays.power_W),
        ambient_temperature_C=np.choose(np.arange(len(rows)) // 80 % 3, (24.0, nan, 70.0)),
        tare_N=np.full(len(rows), 0.02),
    )
    return config, arrays


@pytest.fixture(scope="module", params=["flexinol", "furukawa", "coil"])
def seen(request):
    return measured(request.param)


EFFECTS = {
    "none": {},
    "of the circuit": {"lead_resistance": {"resistance": 0.05}},
    "that last": LASTING,
    "of the heat": {
        "self_heating": {"temperature_coefficient": 2e-4},
        "heat_loss": {"change": 0.3, "time_constant": 2.0, "heat_loss": 5e-3},
    },
}


@pytest.mark.parametrize("effects", EFFECTS)
def test_one_by_one_and_in_pieces_all_samples_give_the_same(seen, effects):
    config, arrays = seen
    config = Config.from_mapping({**config.to_mapping(), "effects": EFFECTS[effects]})
    one, pieces, whole = Chain(config), Chain(config), Chain(config)
    at_once = whole.run(arrays)
    bad = np.flatnonzero(at_once.quality == Quality.INVALID)
    ends = sorted({0, *bad, *(bad + 1), len(arrays.time_s)})  # some begin and end with what is no sample
    in_pieces = [pieces.run(some(arrays, slice(*piece))) for piece in itertools.pairwise(ends)]
    names = ("displacement_m", "strain", "velocity_m_s", "branch", "quality", "uncertainty_m")
    for name in names:
        together = np.concatenate([getattr(each, name) for each in in_pieces])
        np.testing.assert_array_equal(together, getattr(at_once, name), name)
    steps = [one.step(sample(arrays, i)) for i in range(len(arrays.time_s))]
    for name in names:
        np.testing.assert_array_equal([getattr(estimate, name) for _, estimate in steps], getattr(at_once, name), name)
    for name in (field.name for field in dataclasses.fields(Signals)):
        alone = np.array([getattr(signals, name) for signals, _ in steps], dtype=float)
        shown = np.broadcast_to(np.asarray(getattr(at_once.signals, name), dtype=float), alone.shape)
        np.testing.assert_allclose(alone, shown, rtol=1e-12, atol=0.0, err_msg=name)
    assert len(set(at_once.quality)) >= 3
    cooled = "heat_loss" in EFFECTS[effects]
    good = at_once.quality != Quality.INVALID
    assert np.array_equal(at_once.heat_W[good], at_once.signals.power_W[good]) != cooled


@pytest.mark.parametrize(("wire", "knows"), [("flexinol", False), ("coil", True)])
def test_a_model_with_a_heat_balance_knows_the_ends(wire, knows):
    assert Chain(Config.load(shared_file(f"config/{wire}.yaml"))).knows_the_ends == knows


def test_a_twentieth_of_the_calibrated_stresses_lies_within_reach_on_either_side():
    assert stresses_inside_Pa((10e6, 110e6)) == pytest.approx((5e6, 115e6))


def test_a_log_is_judged_from_its_own_beginning_and_as_its_sensor_shows_it(make_config):
    config = Config.from_mapping(make_config())
    later = dataclasses.replace(signals(50), time_s=signals(50).time_s + 100.0)
    judged = Chain(config, {"reference_drift": KNOWN["reference_drift"](offset=2e-4)}).judge(later)
    np.testing.assert_allclose(judged.elapsed_s, later.time_s - 100.0)
    np.testing.assert_allclose(judged.shown_m, judged.displacement_m + 2e-4)


class TestVelocity:
    """Of a position a second ago at 1 mm, that moved by 0.5 mm/s, with a low-pass of a second."""

    @pytest.fixture
    def state(self):
        return np.array([10.0, 1e-3, 0.5e-3])

    @pytest.mark.parametrize("step_s", [1.0, 0.5])
    def test_it_comes_to_the_difference_quotient(self, state, step_s):
        wanted = 0.5e-3 + (1e-3 - 0.5e-3 * step_s) / (1.0 + step_s)
        assert _velocity(10.0 + step_s, 2e-3, state, 1.0) == pytest.approx(wanted)
        assert list(state) == pytest.approx([10.0 + step_s, 2e-3, wanted])

    @pytest.mark.parametrize("step_s", [-1.0, -0.5])
    def test_it_goes_on_from_a_clock_that_was_set_back(self, state, step_s):
        assert _velocity(10.0 + step_s, 2e-3, state, 1.0) == 0.5e-3
        assert list(state) == [10.0 + step_s, 2e-3, 0.5e-3]

    def test_in_no_time_nothing_moves(self, state):
        assert _velocity(10.0, 2e-3, state, 1.0) == 0.5e-3
        assert list(state) == [10.0, 1e-3, 0.5e-3]

    def test_a_position_that_is_none_leaves_no_trace(self, state):
        assert _velocity(11.0, nan, state, 1.0) == 0.0
        assert list(state) == [10.0, 1e-3, 0.5e-3]

    @pytest.mark.parametrize(("at_s", "place_m"), [(nan, 1e-3), (10.0, nan)])
    def test_after_one_it_begins_anew(self, at_s, place_m):
        state = np.array([at_s, place_m, 0.5e-3])
        assert _velocity(11.0, 2e-3, state, 1.0) == 0.0
        assert list(state) == [11.0, 2e-3, 0.0]


@pytest.mark.parametrize(("wire", "slack"), [("flexinol", 0.0), ("coil", 0.05)])
def test_an_estimate_counts_inside_the_working_range_and_of_the_whole_range_a_twentieth_beyond(wire, slack):
    config = Config.load(shared_file(f"config/{wire}.yaml"))
    model = config.model.build(config.wire)
    low_m, high_m = model.stroke_m if slack else model.displacement_range_m
    slack_m = slack * (high_m - low_m)
    assert Chain(config)._bounds[2:] == pytest.approx([low_m - slack_m, high_m + slack_m])


@pytest.mark.parametrize(
    ("place_m", "stress_Pa", "contracted", "quality"),
    [
        (1e-3, 5.0, False, Quality.DETERMINATE),
        (nan, 5.0, False, Quality.INVALID),
        (1e-3, 0.9, False, Quality.OUTSIDE_CALIBRATION),
        (1e-3, 9.1, True, Quality.OUTSIDE_CALIBRATION),
        (1e-3, 5.0, True, Quality.INDETERMINATE_HOT),
        (0.4e-3, 5.0, False, Quality.INDETERMINATE_HOT),
        (2.1e-3, 5.0, False, Quality.INDETERMINATE_COLD),
        *((place_m, stress_Pa, False, Quality.DETERMINATE) for place_m in (0.5e-3, 2e-3) for stress_Pa in (1.0, 9.0)),
    ],
)
def test_quality_of_one_between_bounds_that_count_as_inside(place_m, stress_Pa, contracted, quality):
    assert _quality(place_m, stress_Pa, contracted, np.array([1.0, 9.0, 0.5e-3, 2e-3])) == quality


@pytest.mark.parametrize("wire", ["flexinol", "coil"])
def test_after_a_reset_a_contracted_wire_is_one_of_which_nothing_is_known(wire):
    config, arrays = measured(wire)
    hot = int(np.nanargmax(np.where(np.arange(len(arrays.time_s)) < 400, arrays.power_W, nan))) + 20
    chain, after = Chain(config), some(arrays, slice(hot, None))
    chain.run(some(arrays, slice(0, hot)))
    chain.reset()
    np.testing.assert_array_equal(chain.run(after).displacement_m, Chain(config).run(after).displacement_m)


def test_a_live_parameter_arrives_at_the_hot_end(config):
    chain = Chain(config)
    chain.update(config.replace({"thermal.ambient_tolerance": 3.0}))
    assert chain._hot_end.line[-1] == 3.0


@pytest.mark.parametrize("bound", ["resistance_min", "resistance_max"])
def test_a_resistance_at_its_bound_is_good_for_one_sample_and_for_many(config, bound):
    """And one beyond it for neither."""
    at_Ohm = getattr(config.safety, bound)
    beyond_Ohm = np.nextafter(at_Ohm, 0.0 if bound == "resistance_min" else np.inf)
    for resistance_Ohm, good in ((at_Ohm, True), (beyond_Ohm, False)):
        some = dataclasses.replace(signals(n=3), resistance_Ohm=np.full(3, resistance_Ohm))
        first = {f.name: np.ravel(getattr(some, f.name))[0] for f in dataclasses.fields(some)}
        one = dataclasses.replace(some, **first)
        assert (Chain(config).step(one)[1].quality is not Quality.INVALID) is good
        assert ((Chain(config).run(some).quality != Quality.INVALID) == good).all()


@pytest.mark.parametrize(
    ("does", "said"),
    [
        (lambda frame: 1 / 0, "ZeroDivisionError: division by zero"),
        (lambda frame: sys.exit(3), "SystemExit: 3"),
        (lambda frame: setattr(frame, "displacement_m", np.zeros(7)), "leaves another number of samples than the "),
        (lambda frame: setattr(frame, "displacement_m", 0.0), "AttributeError: "),
    ],
    ids=["raises", "leaves", "other shape", "one number"],
)
def test_an_effect_of_a_plug_in_that_fails_is_named_by_sample_and_by_log(seen, monkeypatch, does, said):
    config, arrays = seen
    monkeypatch.setattr(KNOWN["slip"], "at_displacement", lambda self, frame, state, place: does(frame))
    chain = Chain(config, effects={"slip": KNOWN["slip"]()})
    for judged in (lambda: chain.step(sample(arrays, 0)), lambda: chain.run(arrays)):
        with pytest.raises(EffectError, match=f"effect 'slip', at_displacement: {said}"):
            judged()


def _short(self, *_):
    return np.zeros(7)


def _leaves(self, *_):
    raise SystemExit(3)


@pytest.mark.parametrize(
    ("does", "of_one", "of_many"),
    [
        (_leaves, "SystemExit: 3", "SystemExit: 3"),
        (_short, "TypeError: ", r"ValueError: gives an array of shape \(7,\) for samples of shape "),
        (lambda *_: None, "TypeError: ", "AttributeError: "),
    ],
    ids=["leaves", "other shape", "nothing"],
)
def test_a_model_of_a_plug_in_that_fails_is_named_by_sample_and_by_log(config, monkeypatch, does, of_one, of_many):
    arrays, chain = signals(), Chain(config)
    model = type(config.model.build(config.wire))
    monkeypatch.setattr(model, "step", does)
    with pytest.raises(ModelError, match=f"strain model '{config.model_type}': {of_one}"):
        chain.step(sample(arrays, 0))
    monkeypatch.setattr(model, "run", does)
    with pytest.raises(ModelError, match=f"strain model '{config.model_type}': {of_many}"):
        chain.run(arrays)


@pytest.mark.parametrize("method", ["build", "mismatches"])
def test_a_model_of_a_plug_in_that_cannot_be_asked_is_named_when_parameters_are_read(make_config, monkeypatch, method):
    monkeypatch.setattr(COEFFICIENTS[make_config()["model"]["type"]], method, _leaves)
    with pytest.raises(ConfigError, match="^strain model 'flexinol': SystemExit: 3$"):
        Config.from_mapping(make_config())


def test_a_law_of_a_plug_in_that_cannot_be_asked_is_named_when_parameters_are_read(make_config, monkeypatch):
    monkeypatch.setattr(CONTROL_LAWS["pid"], "mismatches", _leaves)
    with pytest.raises(ConfigError, match="^control law 'pid': SystemExit: 3$"):
        Config.from_mapping(make_config())
