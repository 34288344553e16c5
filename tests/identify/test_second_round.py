"""A wire driven by its own model while it is characterised, and what identify makes of that; and of a file that `init`
wrote."""

import dataclasses

import numpy as np
import pytest
from characterised import virtual_rig

from sma_actuator.base.parameters import ConfigError
from sma_actuator.base.share import shared_file
from sma_actuator.base.signals import Signals
from sma_actuator.characterise import PlanOptions, characterise, make_plan
from sma_actuator.characterise.following import ModelFollower
from sma_actuator.characterise.parts import positions_m
from sma_actuator.characterise.plan import POSITIONS, followed_shares
from sma_actuator.characterise.programs import FROM_COLD
from sma_actuator.characterise.rig import ATTENDED_MARGIN
from sma_actuator.cli.main import main
from sma_actuator.config import Config, bench_from_mapping, read_parameter_file, write_parameter_file
from sma_actuator.derived import derived, with_derived, without_derived
from sma_actuator.logs.bench_log import read_bench_log, signals_from_log
from sma_actuator.logs.kinds import PARTIAL, make_experiments
from sma_actuator.safety.reach import HELD_BACK_TIMES

NODE = shared_file("config/flexinol.yaml")


def second_round(folder, model=NODE):
    """One spring of it, on the virtual bench."""
    _, rig, operator = virtual_rig("flexinol")
    options = PlanOptions(follow=str(model), loads_N=(0.98,), springs_N_m=((150.0, 0.8),))
    plan = [part for part in make_plan(rig.config, options) if "spring" in part.name]
    characterise(read_parameter_file(NODE), plan, rig, operator, folder)
    return read_bench_log(folder / f"{plan[0].name}.csv")


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    return second_round(tmp_path_factory.mktemp("second"))


def test_the_model_drives_the_wire_to_positions_over_its_stroke(log):
    config = Config.load(NODE)
    (followed,) = make_experiments([log], config)
    place_m, asked_m = followed.displacement_m, log["setpoint_m"][: len(followed.displacement_m)]
    assert np.ptp(asked_m[np.isfinite(asked_m)]) > 0.6 * config.wire.full_stroke_m
    off = np.abs(place_m - asked_m)[np.isfinite(asked_m)] / config.wire.full_stroke_m
    assert np.median(off) < 0.04  # the thesis's model does not err by more
    assert len(np.unique(asked_m[np.isfinite(asked_m)].round(7))) > 100  # positions, and a sine and a triangle


def test_some_positions_are_come_to_from_the_cold_wire(log):
    """As the first after every `enable` is: with the bias current alone, not held where it would be cold."""
    asked_m, positions = log["setpoint_m"], len(log.metadata["shares"])
    same = np.isclose(asked_m[1:], asked_m[:-1], rtol=0.0, atol=0.0, equal_nan=True)
    begins = np.flatnonzero([True, *~same])
    visited_m = asked_m[begins][: 2 + positions + positions // FROM_COLD]
    nowhere = np.flatnonzero(np.isnan(visited_m))
    assert nowhere.tolist() == [0, 2, 7, 12, 17]
    place_m = signals_from_log(log, Config.load(NODE)).reference_displacement_m
    for begin, end in zip(begins[nowhere], begins[nowhere + 1], strict=True):
        assert log["current_command_A"][begin + 1 : end] == pytest.approx(Config.load(NODE).supply.bias_current)
        assert log["time_s"][end] - log["time_s"][begin] == pytest.approx(log.metadata["dwell_s"], abs=0.1)
        assert place_m[end - 1] > np.max(place_m) - 0.05 * np.ptp(place_m), "and it is cold by then"


def test_before_them_the_wire_is_contracted(log):
    """Until then it is as long as another load has made it."""
    somewhere = np.isfinite(log["setpoint_m"])
    asked_m = log["setpoint_m"][somewhere]
    place_m = signals_from_log(log, Config.load(NODE)).reference_displacement_m[somewhere]
    first = np.flatnonzero(np.diff(asked_m) != 0.0)[0]
    assert asked_m[0] == min(asked_m)
    assert place_m[first] < np.min(place_m) + 0.05 * np.ptp(place_m)


def test_it_is_fitted_whole_since_each_motion_stands_on_those_before_it(log):
    (whole,) = make_experiments([log], Config.load(NODE))
    assert whole.kind == PARTIAL and len(whole.signals.time_s) > 0.95 * len(log)


def held_back_after_s(asked_m, flows, seconds=8.0):
    """When a wire that stands in the middle, by its resistance, is called held back; ``flows``: share of what its law
    asks for."""
    config = Config.load(NODE)
    follower = ModelFollower(config)
    hot_end, rest = config.calibration.hot_end, config.calibration.rest
    middle_Ohm = float(np.mean(hot_end.contracted_resistance) + np.mean(rest.cold_resistance)) / 2.0
    time_s, current_A = 0.0, config.supply.bias_current
    while time_s < seconds:
        power_W = current_A**2 * middle_Ohm
        asked_A = follower(Signals(time_s, middle_Ohm, current_A, power_W, 0.9, 0.9 / config.wire.area_m2), asked_m)
        if follower.held_back:
            return time_s
        time_s, current_A = time_s + 0.05, max(flows * asked_A, config.supply.bias_current)
    return np.inf


def test_a_wire_that_the_heat_limit_holds_back_is_told_as_by_the_driver():
    """It stands for two of its time constants, far from where it is wanted, with less than is asked for."""
    patience_s = HELD_BACK_TIMES * Config.load(NODE).thermal.balance.time_constant_s
    assert held_back_after_s(1e-3, flows=0.5) == pytest.approx(patience_s, abs=0.5)
    assert held_back_after_s(1e-3, flows=1.0) == np.inf, "it flows"
    assert held_back_after_s(np.nan, flows=0.5) == np.inf, "it rests"
    assert held_back_after_s(4e-3, flows=0.5) == np.inf, "it is to become longer"


def test_the_rig_knows_the_wire_while_its_model_drives_it():
    _, rig, _ = virtual_rig("flexinol")
    limits = rig._watch._supervisor
    with rig.knowing(Config.load(NODE).calibration):
        assert limits.config.calibration.hot_end_known
        assert limits.config.thermal.heat_loss_margin <= ATTENDED_MARGIN
    assert not limits.config.calibration.hot_end_known


def test_a_model_that_does_not_know_its_ends_is_refused(tmp_path):
    lacking, mapping = tmp_path / "model.yaml", read_parameter_file(NODE)
    del mapping["calibration"]
    write_parameter_file(lacking, mapping, "Without its ends.", {})
    with pytest.raises(ConfigError, match="does not say where the wire ends"):
        second_round(tmp_path / "out", lacking)


def test_the_command_that_takes_both_rounds_asks_for_the_model_that_drove_the_wire(tmp_path, capsys):
    out = tmp_path / "second"
    words = ["characterise", "--virtual", "flexinol", "--follow", str(NODE), "--loads", "0.98", "--out", str(out)]
    assert main(words) == 0
    said = " ".join(capsys.readouterr().err.split())
    assert f"identify FIRST_ROUND/p*.csv FIRST_ROUND/levels_*.csv {out}/followed_*.csv" in said
    assert said.endswith(f"--config {out}/bench.yaml --model flexinol --out better_wire.yaml")


def test_what_follows_from_the_rest_gives_way_to_what_is_measured():
    given = {"wire": {"alloy": "ni-ti", "length": 0.1, "diameter": 0.1524e-3}, "thermal": {"heat_loss": 0.006}}
    given["controller"] = {"kp": 500.0}
    bare, names = without_derived(with_derived(given))
    assert bare["thermal"] == {"heat_loss": 0.006} and bare["controller"] == {"kp": 500.0}
    assert "supply.max_current" in names and "thermal.heat_loss" not in names
    measured = {**bare, "thermal": {"heat_loss": 0.003}}
    assert derived(measured)["supply.max_current"].value < derived(bare)["supply.max_current"].value


def test_a_coil_gets_the_time_that_it_takes_and_a_spring_as_soft_as_it_moves_far():
    bench = bench_from_mapping(read_parameter_file(shared_file("config/coil_bench.yaml")))
    spring = make_plan(bench, PlanOptions(follow="model.yaml"))[-1].parameters
    raised_Pa = spring["stiffness_N_m"] * bench.wire.full_stroke_m / bench.wire.area_m2
    assert 30e6 < raised_Pa < 70e6, "as on a wire: 44 MPa"
    assert spring["dwell_s"] == pytest.approx(6.0 * bench.thermal.heat_capacity / bench.thermal.heat_loss)


def test_a_quick_wire_comes_to_more_positions_in_the_same_time():
    bench = bench_from_mapping(read_parameter_file(shared_file("config/flexinol_bench.yaml")))
    quick = dataclasses.replace(
        bench,
        thermal=dataclasses.replace(bench.thermal, heat_capacity=0.1 * bench.thermal.heat_capacity),
        loop=dataclasses.replace(bench.loop, rate=75.0),
    )
    usual, more = (make_plan(each, PlanOptions(follow="model.yaml"))[0].parameters for each in (bench, quick))
    assert more["dwell_s"] == pytest.approx(120 / 75.0), "long enough for the loop"
    held_s = [each["dwell_s"] * len(each["shares"]) for each in (usual, more)]
    assert held_s == pytest.approx([144.0, 144.0], rel=0.04)
    gaps = np.diff(np.sort([0.05, *more["shares"], 0.95]))
    assert len(more["shares"]) == 90 and np.all(gaps < 0.021), "over all of the stroke"


def test_positions_are_held_where_the_model_is_unsure():
    """Of a model whose interval is four times as wide about 0.7 of the stroke half of the positions are there."""
    config = Config.load(shared_file("config/coil.yaml"))
    low_m, high_m = config.model.stroke
    shares = followed_shares(0, POSITIONS)
    for width, there in ((1.0, 3), (4.0, 6)):
        wide = [width if 0.6 <= place <= 0.8 else 1.0 for place in np.linspace(0.0, 1.0, 41)]
        unsure = dataclasses.replace(config.model, intervals=(*np.ones(41), *wide))
        held = positions_m(dataclasses.replace(config, model=unsure), shares, low_m, high_m)
        place = (np.array(held) - low_m) / (high_m - low_m)
        assert np.count_nonzero((place > 0.58) & (place < 0.82)) == pytest.approx(there, abs=1)
        assert place.min() > 0.05 and place.max() < 0.95
    thesis = Config.load(NODE)
    assert positions_m(thesis, [0.25, 0.5], 0.0, 4e-3) == pytest.approx([1e-3, 2e-3])


def test_no_two_of_its_logs_hold_the_same_positions_in_the_same_order():
    bench = bench_from_mapping(read_parameter_file(shared_file("config/flexinol_bench.yaml")))
    plan = make_plan(bench, PlanOptions(follow="model.yaml"))
    shares = [part.parameters["shares"] for part in plan]
    assert len({tuple(np.argsort(each)) for each in shares}) == len(plan) == 6
    for each in shares:
        gaps = np.diff(np.sort([0.05, *each, 0.95]))
        assert np.all(gaps >= 0.0) and np.all(gaps < 0.16), "over all of the stroke"
    assert make_plan(bench, PlanOptions(follow="model.yaml")) == plan, "what is interrupted goes on"
