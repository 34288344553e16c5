"""The wire of the bench that exists: its resistance and displacement on both branches are those of the record."""

import numpy as np
import pytest

from sma_actuator.base.errors import UserError
from sma_actuator.base.sections import Wire
from sma_actuator.bench import VirtualBench, real
from sma_actuator.cli.main import main
from sma_actuator.plant.loads import Weight

DRAUGHT = 0.322  #: it lost less heat than the bench's wire of its size would, by its camera: 25 W/(m² K)
STEPS = 150  #: of power, one way: each is held for 2 s


@pytest.fixture
def points():
    if not real.RECORD.exists():
        pytest.skip("../shared/data/static_loop is not here: it has no licence and is not shipped")
    return real.read_points(real.RECORD)


def test_a_bench_with_it_goes_round_the_recorded_loop(points):
    size = Wire(alloy="ni-ti", length=real.LENGTH_m, diameter=real.DIAMETER_m)
    bench = VirtualBench.from_name("flexinol", load=Weight(real.LOAD_N), like=size, physics=real.REAL, ambient_C=25.0)
    bench.inject("draught", DRAUGHT)
    loss_W_K = DRAUGHT * bench.constants.heat_loss_W_K
    bench.supply.set_voltage(20.0)
    bench.supply.set_output(True)
    hottest_W = loss_W_K * (points.temperature_C.max() + 5.0 - bench.ambient_C)
    seen = []
    for share in np.concatenate((np.linspace(0.0, 1.0, STEPS), np.linspace(1.0, 0.0, STEPS))):
        bench.supply.set_current(float(np.sqrt(max(share, 1e-3) * hottest_W / bench.truth.resistance_Ohm)))
        bench.advance(bench.truth.time_s + 2.0)
        now = bench.truth
        seen.append((now.temperature_C, now.displacement_m, now.resistance_Ohm))
    temperature_C, displacement_m, resistance_Ohm = np.array(seen).T
    hot = int(np.argmax(temperature_C)) + 1
    zero_m = np.max(displacement_m)
    stroke_m, range_Ohm = (
        np.ptp(points.displacement_m),
        np.nanmax(points.resistance_Ohm) - np.nanmin(points.resistance_Ohm),
    )
    for branch, part in ((points.heating, slice(None, hot)), (~points.heating, slice(None, hot - 2, -1))):
        at_C = points.temperature_C[branch]
        place_m = np.interp(at_C, temperature_C[part], displacement_m[part] - zero_m)
        Ohm = np.interp(at_C, temperature_C[part], resistance_Ohm[part])
        assert np.abs(place_m - points.displacement_m[branch]).mean() < 0.02 * stroke_m
        assert np.nanmean(np.abs(Ohm - points.resistance_Ohm[branch])) < 0.02 * range_Ohm


def test_the_other_alloy_has_no_record_and_is_home(points):
    assert real.wire_of("furukawa", real.REAL).material == real.wire_of("furukawa", "measured").material
    assert real.wire_of("flexinol", real.REAL).material != real.wire_of("flexinol", "measured").material


def test_without_the_record_a_sentence_says_whose_it_is(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(real, "RECORD", tmp_path / "none.csv")
    with pytest.raises(UserError, match=r"none\.csv is not here; the record has no licence"):
        real.wire_of("flexinol", real.REAL)
    assert main(["bench", "--physics", "real", "--supply-port", "0", "--daq-port", "0"]) == 1
    assert "docs/physics.md" in capsys.readouterr().err
