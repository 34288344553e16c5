"""Characterisation: what it measures, that it loses nothing, and that the current is off on every way out."""

import contextlib
import dataclasses
import itertools
import json
import math
import os
import signal
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from characterised import SHORT, bench_mapping, virtual_rig

from sma_actuator.base.parameters import ConfigError
from sma_actuator.bench import VirtualBench
from sma_actuator.bench.server import background
from sma_actuator.characterise import PlanOptions, characterise, make_plan
from sma_actuator.characterise.calibration import fit_line
from sma_actuator.characterise.parts import RUN
from sma_actuator.characterise.plan import typical_resistance_Ohm
from sma_actuator.characterise.programs import (
    every_ordered_pair,
    held_currents,
    hold,
    partial_cycles,
    square_pulses,
    trained,
)
from sma_actuator.characterise.rig import ATTENDED_MARGIN
from sma_actuator.characterise.training import ENOUGH, FEWEST, Ends, left_to_go
from sma_actuator.cli.main import main
from sma_actuator.config import bench_from_mapping, write_parameter_file
from sma_actuator.derived import with_derived
from sma_actuator.estimation.chain import stresses_inside_Pa
from sma_actuator.instruments import InstrumentLost, InstrumentRefused
from sma_actuator.logs.bench_log import read_bench_log
from sma_actuator.logs.cycles import IN_MOTION, cycle_numbers, cycles_of, is_driven
from sma_actuator.plant.worlds import HOME, IN_TRAINING, WORLDS


@pytest.mark.parametrize("n", [2, 3, 5, 8])
def test_the_walk_takes_every_ordered_pair_of_set_points_once(n):
    walk = every_ordered_pair(n)
    steps = list(itertools.pairwise(walk))
    assert sorted(steps) == sorted((i, j) for i in range(n) for j in range(n) if i != j)


@pytest.mark.parametrize(
    ("slow_s", "pause_s"),
    [(1.0, 10.0), (8.0, 14.7), (60.0, 40.0), (None, 10.0)],
    ids=["at rest in time", "a long tail", "never at rest", "nothing measured"],
)
def test_a_pause_goes_on_until_the_wire_is_at_rest(slow_s, pause_s):
    """A tail of exp(-t/8 s) moves 6 % of the way that it has come in the last 15 % of 14.7 s."""
    program, time_s, off_s = square_pulses(1, 0.3, 0.05, heat_s=5.0, cool_s=10.0, longest_cool_s=40.0), 0.0, 0.0
    drive = next(program)
    with contextlib.suppress(StopIteration):
        while True:
            time_s += 0.05
            off_s = off_s + 0.05 if time_s > 6.0 and drive.current_A < 0.1 else 0.0
            at_m = math.nan if slow_s is None else 4e-3 * (1.0 - math.exp(-off_s / slow_s))
            drive = program.send(SimpleNamespace(time_s=time_s, reference_displacement_m=at_m))
    assert off_s == pytest.approx(pause_s, abs=0.3)


@pytest.mark.parametrize(
    ("done_at_A", "found_A"),
    [(0.25, 0.3), (0.34, 0.345), (9.9, 0.4), (None, 0.3)],
    ids=["contracted", "needs more", "needs more than there is", "nothing measured"],
)
def test_a_wire_that_still_contracts_is_heated_further(done_at_A, found_A):
    program = square_pulses(2, 0.3, 0.05, heat_s=6.0, cool_s=6.0, most_A=0.4)
    time_s, driven = 0.0, []
    drive = next(program)
    with contextlib.suppress(StopIteration):
        while True:
            driven.append(drive.current_A)
            time_s += 0.05
            way_m = math.nan if done_at_A is None else 0.02 * min(drive.current_A, done_at_A) ** 2
            drive = program.send(SimpleNamespace(time_s=time_s, reference_displacement_m=-way_m))
    pulses = [[*run] for heated, run in itertools.groupby(driven, lambda current_A: current_A > 0.1) if heated]
    assert len(pulses) == 2 and min(pulses[1]) == max(pulses[1]) == pytest.approx(found_A, abs=2e-3)
    assert max(driven) <= 0.4 and pulses[0][:100] == [0.3] * 100


@pytest.mark.parametrize(("slow_s", "lasted_s"), [(0.2, 9.0), (6.0, 21.6), (60.0, 24.6)])
def test_a_wire_that_still_contracts_with_all_the_current_is_given_time(slow_s, lasted_s):
    """Under a heavy load it is warm enough after a while only: at rest within 0.2 s, once ``exp(-t / 6 s)`` falls by no
    more than 2 % in 3 s, and when ``longest_heat_s`` is over."""
    program = square_pulses(1, 0.35, 0.05, heat_s=6.0, cool_s=6.0, most_A=0.35 * 1.05**0.5, longest_heat_s=24.0)
    time_s, on_s = 0.0, 0.0
    drive = next(program)
    with contextlib.suppress(StopIteration):
        while True:
            time_s += 0.05
            on_s += 0.05 * (drive.current_A > 0.1)
            at_m = -4e-3 * (1.0 - math.exp(-on_s / slow_s))
            drive = program.send(SimpleNamespace(time_s=time_s, reference_displacement_m=at_m))
    assert on_s == pytest.approx(lasted_s, abs=0.3)


@pytest.mark.parametrize(("begins_at_A", "found_A"), [(0.2, 0.3), (0.31, 0.322), (0.33, 0.345), (9.9, 0.4)])
def test_a_wire_that_does_not_contract_yet_is_heated_further(begins_at_A, found_A):
    """It expands, as one does under a heavy weight until it is hot enough; each step is 15 % more power."""
    program = trained(lambda hot_m, cold_m: False, 3, 0.3, 0.05, heat_s=6.0, cool_s=6.0, most_A=0.4, expands_m=2e-4)
    time_s, driven, heat_A2 = 0.0, [], 0.05**2
    drive = next(program)
    with contextlib.suppress(StopIteration):
        while True:
            driven.append(drive.current_A)
            time_s += 0.05
            heat_A2 += 0.1 * (drive.current_A**2 - heat_A2)
            at_m = 1e-3 * heat_A2 - 4e-3 * (heat_A2 > begins_at_A**2)
            drive = program.send(SimpleNamespace(time_s=time_s, reference_displacement_m=at_m))
    pulses = [[*run] for heated, run in itertools.groupby(driven, lambda current_A: current_A > 0.1) if heated]
    assert min(pulses[1]) == max(pulses[1]) == pytest.approx(found_A, abs=2e-3)


def test_a_pulse_goes_on_until_the_wire_is_at_rest_in_the_heat():
    """A guard may hold back the current of any pulse: 6 % of the way in the last 15 % of 14.7 s, as of a pause."""
    program, time_s, driven = square_pulses(2, 0.3, 0.05, heat_s=5.0, cool_s=5.0, longest_heat_s=20.0), 0.0, []
    drive, on_s = next(program), 0.0
    with contextlib.suppress(StopIteration):
        while True:
            driven.append(drive.current_A)
            time_s += 0.05
            on_s = on_s + 0.05 if drive.current_A > 0.1 else 0.0
            drive = program.send(SimpleNamespace(time_s=time_s, reference_displacement_m=4e-3 * math.exp(-on_s / 8.0)))
    lasted_s = [0.05 * len([*run]) for heated, run in itertools.groupby(driven, lambda a: a > 0.1) if heated]
    assert lasted_s == pytest.approx([14.7, 14.7], abs=0.3)


@pytest.mark.parametrize("heat_loss", [1.0, 3.0], ids=["as expected", "three times"])
def test_a_wire_that_the_heat_limit_holds_back_is_told_of(tmp_path, heat_loss):
    """One that loses much more heat than its parameters say is never hot enough, for all that a guard can know."""
    bench, rig, operator = virtual_rig("furukawa", seed=3)
    bench.inject("draught", heat_loss)
    said = []
    plan = [part for part in make_plan(rig.config, PlanOptions(loads_N=(2.5,))) if part.kind == "pulses"]
    characterise(bench_mapping("furukawa"), plan, rig, operator, tmp_path, say=said.append)
    assert any("the heat limit let" in words and "thermal.heat_loss" in words for words in said) == (heat_loss > 1.0)


@pytest.mark.parametrize("rate_Hz", [2.0, 20.0])
def test_readings_that_are_slower_than_the_wire_see_it_on_its_way(rate_Hz):
    """A wire of 0.1 mm is contracted within one reading of a supply that takes a third of a second to answer."""
    mapping = bench_mapping("flexinol")
    mapping["wire"] |= {"diameter": 1e-4}
    mapping["thermal"] |= {"heat_capacity": 0.0042, "heat_loss": 0.0045}
    mapping["supply"] |= {"watchdog_timeout": 2.0, "bias_current": 0.034, "max_current": 0.247}
    mapping.setdefault("safety", {})["reading_timeout"] = 2.0
    mapping["loop"] = {"rate": rate_Hz}
    plan = make_plan(bench_from_mapping(mapping), PlanOptions(loads_N=(0.5,)))
    (pulses,) = (part.parameters for part in plan if part.kind == "pulses")
    program = square_pulses(3, pulses["heat_current_A"], 0.034, pulses["heat_s"], 1.0, ramp_s=pulses.get("ramp_s", 0.0))
    time_s, temperature, seen, drive = 0.0, 0.0, 0, next(program)
    with contextlib.suppress(StopIteration):
        while True:  # at rest at 1 with the heating current; contracts in proportion between 0.4 and 0.7
            time_s += 1.0 / rate_Hz
            to = (drive.current_A / pulses["heat_current_A"]) ** 2
            temperature += (to - temperature) * (1.0 - math.exp(-1.0 / rate_Hz / 0.93))
            seen += drive.current_A > 0.1 and 0.475 < temperature < 0.625
            drive = program.send(SimpleNamespace(time_s=time_s, reference_displacement_m=math.nan))
    assert seen >= 3 * 5


def test_the_parts_after_the_pulses_use_what_contracted_the_wire_in_them():
    _, rig, operator = virtual_rig("flexinol", physics="hot")
    plan = make_plan(rig.config, PlanOptions(loads_N=(0.98,), pulses=2, levels=2))
    pulses, levels = (next(part for part in plan if part.kind == kind) for kind in ("pulses", "levels"))
    with rig.opened():
        (log,) = RUN["pulses"](pulses, rig, operator, {}, lambda _: None).logs.values()
        held = RUN["levels"](levels, rig, operator, {pulses.name: log}, lambda _: None).results["currents_A"]
    planned_A = pulses.parameters["heat_current_A"]
    assert planned_A < log.metadata["heat_current_A"] == held[-1] <= pulses.parameters["most_current_A"]


STROKE_m, NOISE_m = 4e-3, 4e-7


def cycles_of_training(shortened_m, most=200, noise_m=NOISE_m):
    """Ends, and how many pulses were driven, of a wire that is so much shorter before each cycle (0, 1, …) when hot,
    and by two fifths of it when cold."""
    rng, ends = np.random.default_rng(1), Ends(STROKE_m)
    program = trained(ends.stand, most, 0.3, 0.05, heat_s=6.0, cool_s=12.0, most_A=0.3)
    drive, time_s, pulses, heated = next(program), 0.0, 0, False
    with contextlib.suppress(StopIteration):
        while True:
            time_s += 0.5
            pulses, heated = pulses + (drive.current_A > 0.1 and not heated), drive.current_A > 0.1
            share, at_m = (1.0, 0.0) if heated else (0.4, STROKE_m)
            at_m += rng.normal(0.0, noise_m) - share * shortened_m(pulses)
            drive = program.send(SimpleNamespace(time_s=time_s, reference_displacement_m=at_m))
    return ends, pulses


def training_m(cycles):
    """As in the measured wire: a fifth of the stroke, gone as exp(-N/25)."""
    return 0.2 * STROKE_m * math.exp(-cycles / 25.0)


def test_a_wire_is_trained_until_its_ends_stand():
    ends, pulses = cycles_of_training(training_m)
    assert 0.001 * STROKE_m < training_m(pulses) <= ENOUGH * STROKE_m  # and not for much longer than that takes
    assert "they stand, with at most 0." in ends.words
    assert left_to_go(ends.hot_m).mean_m == pytest.approx(training_m(pulses), rel=0.1)


def test_a_wire_that_stands_is_not_trained():
    ends, pulses = cycles_of_training(lambda cycles: 0.0)
    assert pulses == 1 + FEWEST and "the hot end moved 0.0%" in ends.words


def test_what_the_sensor_does_not_show_is_waited_for():
    """Where the ends scatter by a fifth of the stroke's hundredth, ten cycles do not show that they stand."""
    ends, pulses = cycles_of_training(lambda cycles: 0.0, noise_m=8e-6)
    assert pulses > 20 and "they stand" in ends.words
    assert cycles_of_training(training_m, noise_m=8e-6)[1] > 100


def test_a_wire_that_does_not_come_to_stand_is_told_of():
    """The square root of the cycles fits the measured wire as well, and has no end."""
    ends, pulses = cycles_of_training(lambda cycles: -2e-4 * math.sqrt(cycles), most=60)
    assert pulses == 60 and "they do not stand" in ends.words
    ends, pulses = cycles_of_training(training_m, most=5)
    assert pulses == 5 and "too few to say" in ends.words


def test_a_half_trained_wire_is_trained_on_before_it_is_measured(tmp_path):
    before, said = 90.0, []
    bench, rig, operator = virtual_rig("flexinol", physics="in_training", cycles=before)
    plan = make_plan(rig.config, dataclasses.replace(QUICK, training_cycles=60, skip=(*QUICK.skip, "lead_resistance")))
    manifest = characterise(bench_mapping("flexinol"), plan[:1], rig, operator, tmp_path, say=said.append)

    def left(cycles):
        lacking = IN_TRAINING.after(cycles)
        return lacking.hot_strain * rig.config.wire.length / rig.config.wire.full_stroke_m

    assert left(before) > 2.0 * ENOUGH > 2.0 * left(before + bench.cycles)
    assert len(said) == 1 and "they stand" in said[0]
    found = manifest.data["parts"]["training"]["results"]
    assert found["left_m"] <= ENOUGH * rig.config.wire.full_stroke_m
    assert plan[0].parameters["load_N"] == max(part.parameters["load_N"] for part in plan)
    from sma_actuator.characterise.page import write_page  # which takes long to import for all who collect the tests

    write_page(tmp_path, manifest)
    assert "Training: where the ends of the wire went" in (tmp_path / "calibration.html").read_text()


def signals_of(time_s, current_A, displacement_m):
    return SimpleNamespace(time_s=time_s, current_A=current_A, reference_displacement_m=displacement_m)


class HeldBackHalfWay:
    """A wire that the heat limit holds where it is, unless it has rested for so long: from there it goes in one go."""

    def __init__(self, cool_s):
        self.cool_s = cool_s
        self.time_s, self.at_m, self.rested_s, self.in_one_go = 0.0, 4e-3, cool_s, True

    def step(self, asked_A, dt_s=0.05):
        self.time_s += dt_s
        heated_m = 4e-3 * (1.0 - min((asked_A / 0.3) ** 2, 1.0))
        if asked_A <= 0.05:
            self.rested_s += dt_s
            self.at_m += 1e-3 * dt_s if self.at_m < 4e-3 else 0.0
            self.in_one_go = self.rested_s >= self.cool_s
            return signals_of(self.time_s, asked_A, self.at_m)
        self.rested_s = 0.0
        if not self.in_one_go and heated_m < self.at_m:
            return signals_of(self.time_s, 0.6 * asked_A, self.at_m)
        self.at_m -= min(4e-3 * dt_s, max(self.at_m - heated_m, 0.0))
        self.in_one_go = self.at_m > heated_m
        return signals_of(self.time_s, asked_A, self.at_m)


def driven_by(program, wire):
    """Times, currents and places that a program asked for, and where the wire was."""
    rows = []
    drive = next(program)
    with contextlib.suppress(StopIteration):
        while True:
            signals = wire.step(drive.current_A)
            rows.append((signals.time_s, drive.current_A, drive.setpoint_m, signals.reference_displacement_m))
            drive = program.send(signals)
    return np.array(rows).T


def test_a_wire_that_the_limit_holds_half_way_is_let_cool_and_comes_to_every_set_point():
    """It stood at the first for the rest of the experiment: each move waited for its time-out."""
    points_m = (3e-3, 2e-3, 1e-3)
    program = partial_cycles(points_m, 0.3, 0.05, move_timeout_s=20.0, cool_s=6.0)
    time_s, _, asked_m, at_m = driven_by(program, HeldBackHalfWay(cool_s=5.0))
    for point_m in points_m:
        assert np.abs(at_m[asked_m == point_m] - point_m).min() < 1e-4
    assert time_s[-1] < 60.0


def test_a_wire_that_the_limit_holds_half_way_is_let_cool_and_is_held_by_every_current():
    program = held_currents((0.05, 0.15, 0.22, 0.3), hold_s=4.0, cool_s=6.0)
    _, current_A, _, at_m = driven_by(program, HeldBackHalfWay(cool_s=1.5))
    starts = np.flatnonzero(np.diff(current_A) > 0.0) + 1
    highest = [i for i in starts if current_A[i] == 0.3]
    assert len(highest) > 3
    for i in highest:
        assert at_m[i:][current_A[i:] == 0.3].min() < 1e-4


def test_held_currents_take_every_step_between_two_of_them_and_stand_long_and_short():
    program, time_s, driven = held_currents((0.05, 0.2, 0.3), hold_s=4.0, cool_s=6.0), 0.0, []
    drive = next(program)
    with contextlib.suppress(StopIteration):
        while True:
            driven.append(drive.current_A)
            time_s += 0.05
            drive = program.send(signals_of(time_s, drive.current_A, math.nan))
    held = [(current_A, 0.05 * len(list(run))) for current_A, run in itertools.groupby(driven)]
    steps = list(itertools.pairwise(current_A for current_A, _ in held))
    assert sorted(set(steps)) == sorted(itertools.permutations((0.05, 0.2, 0.3), 2)) and len(steps) == 6
    assert {round(seconds) for _, seconds in held[1:-1]} == {2, 4}


def test_the_calibrations_of_the_bench_are_found(flexinol):
    found = flexinol.manifest.data["calibration"]
    assert found["load_cell.slope"] == pytest.approx(12.7297, rel=1e-3)
    assert found["load_cell.offset"] == pytest.approx(-0.0598, abs=2e-3)
    assert found["reference_sensor.slope"] == pytest.approx(0.315842, rel=2e-3)
    assert found["reference_sensor.offset"] == pytest.approx(-1.2195e-3, abs=2e-5)
    assert found["circuit.lead_resistance"] == pytest.approx(0.25, abs=2e-3)
    assert flexinol.mapping["circuit"]["lead_resistance"] == found["circuit.lead_resistance"]


def test_correlation_and_residuals_of_a_calibration_are_reported(flexinol):
    line = flexinol.manifest.data["parts"]["load_cell"]["results"]
    assert line["correlation"] > 0.99999 and len(line["residuals"]) == len(SHORT.masses_kg)


def test_pulses_show_a_full_stroke_and_partial_cycles_stay_inside_it(flexinol):
    pulses, partial = flexinol.only("pulses_1.200N")[0], flexinol.only("partial_1.200N")[0]
    assert np.ptp(pulses["lvdt_current_A"]) * 0.3158 > 3.5e-3
    moving = np.isfinite(partial["setpoint_m"])
    assert len(np.unique(partial["setpoint_m"][moving])) == 3
    inside = partial["lvdt_current_A"][moving]
    assert inside.min() > pulses["lvdt_current_A"].min() + 1e-3


def test_metadata_says_which_wire_and_load_a_log_is_of(flexinol):
    metadata = flexinol.only("pulses_0.600N")[0].metadata
    assert metadata["kind"] == "pulses" and metadata["load_N"] == 0.6
    assert metadata["wire"] == {"alloy": "ni-ti", "length_m": 0.1, "diameter_m": 0.1524e-3}


QUICK = dataclasses.replace(SHORT, loads_N=(0.5,), pulses=1, fatigue_cycles=0, skip=("load_cell", "lvdt", "partial"))


def interrupt_after(part_name):
    def progress(part, elapsed_s):
        if part.name == part_name and elapsed_s > 1.0:
            raise KeyboardInterrupt

    return progress


def test_an_interrupted_characterisation_keeps_what_is_finished_and_resumes_there(tmp_path):
    bench, rig, operator = virtual_rig("flexinol")
    plan = make_plan(rig.config, QUICK)
    with pytest.raises(KeyboardInterrupt):
        characterise(bench_mapping("flexinol"), plan, rig, operator, tmp_path, interrupt_after("pulses_0.500N"))
    assert not bench.supply.output_on and bench.supply.current_A == 0.0
    assert list(json.loads((tmp_path / "manifest.json").read_text())["parts"]) == ["lead_resistance"]
    assert not list(tmp_path.glob("*.csv"))
    kept = (tmp_path / "calibration" / "lead_resistance.csv").read_bytes()
    _, rig, operator = virtual_rig("flexinol", seed=5)
    manifest = characterise(bench_mapping("flexinol"), plan, rig, operator, tmp_path)
    assert set(manifest.data["parts"]) == {"lead_resistance", "pulses_0.500N"}
    assert (tmp_path / "calibration" / "lead_resistance.csv").read_bytes() == kept
    assert len(read_bench_log(tmp_path / "pulses_0.500N.csv")) > 100


def test_a_part_in_which_an_answer_was_lost_begins_anew_by_itself_once(tmp_path):
    bench, rig, operator = virtual_rig("flexinol")
    plan, said, whole = make_plan(rig.config, QUICK), [], "pulses_0.500N"

    def progress(part, elapsed_s):
        if part.name == whole and elapsed_s > 1.0 and not said:
            bench.inject("daq_silent")

    def say(words):
        said.append(words)
        assert not bench.supply.output_on, "no current flows meanwhile"
        bench.clear("daq_silent")

    manifest = characterise(bench_mapping("flexinol"), plan, rig, operator, tmp_path, progress, say=say)
    assert len(said) == 1 and said[0].endswith(f"; {whole} begins anew")
    log = read_bench_log(tmp_path / f"{whole}.csv")
    assert whole in manifest.data["parts"] and log["time_s"][0] == 0.0 and np.diff(log["time_s"]).max() < 0.1


@pytest.mark.parametrize("times", [1, 2])
def test_so_does_one_in_which_the_computer_stood_still(tmp_path, times):
    """A busy one does now and then, in the two hours that it takes; twice in one part is no chance."""
    bench, rig, operator = virtual_rig("flexinol")
    plan, said, stood = make_plan(rig.config, QUICK), [], []

    def progress(part, elapsed_s):
        if part.name == "pulses_0.500N" and elapsed_s > 1.0 and len(stood) <= len(said) < times:
            stood.append(elapsed_s)
            bench.advance(bench.time_s + 0.8)

    if times > 1:
        with pytest.raises(InstrumentRefused, match="the part is repeated when resumed"):
            characterise(bench_mapping("flexinol"), plan, rig, operator, tmp_path, progress, say=said.append)
    else:
        manifest = characterise(bench_mapping("flexinol"), plan, rig, operator, tmp_path, progress, say=said.append)
        assert "pulses_0.500N" in manifest.data["parts"]
        assert np.diff(read_bench_log(tmp_path / "pulses_0.500N.csv")["time_s"]).max() < 0.1
    assert len(said) == 1 and "pulses_0.500N begins anew" in said[0] and not bench.supply.output_on


@pytest.fixture
def minded():
    """Signals that are ignored where these tests run under nohup or in the background are not, here."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGHUP)}
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def test_under_nohup_the_end_of_the_terminal_ends_nothing(tmp_path, minded):
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    _, rig, operator = virtual_rig("flexinol")
    short_wire = operator.short_wire

    def hang_up_and_short_the_wire():
        os.kill(os.getpid(), signal.SIGHUP)
        short_wire()

    operator.short_wire = hang_up_and_short_the_wire
    manifest = characterise(bench_mapping("flexinol"), make_plan(rig.config, QUICK), rig, operator, tmp_path)
    assert set(manifest.data["parts"]) == {"lead_resistance", "pulses_0.500N"}


def test_in_the_background_ctrl_c_ends_it_also_while_a_person_is_asked(tmp_path, minded):
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    bench, rig, operator = virtual_rig("flexinol")
    operator.short_wire = lambda: os.kill(os.getpid(), signal.SIGINT)
    with pytest.raises(KeyboardInterrupt):
        characterise(bench_mapping("flexinol"), make_plan(rig.config, QUICK), rig, operator, tmp_path)
    assert not bench.supply.output_on


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP], ids=lambda n: n.name)
def test_a_signal_that_a_library_would_swallow_still_ends_it_with_the_output_off(tmp_path, number, minded):
    bench, rig, operator = virtual_rig("flexinol")
    read_block = rig.daq.read_block

    def swallowing():
        with contextlib.suppress(KeyboardInterrupt):
            os.kill(os.getpid(), number)
        return read_block()

    rig.daq.read_block = swallowing
    with pytest.raises(KeyboardInterrupt):
        characterise(bench_mapping("flexinol"), make_plan(rig.config, QUICK), rig, operator, tmp_path)
    assert not bench.supply.output_on
    assert bench.supply.current_A == 0.0


def test_other_settings_in_the_same_folder_are_refused(tmp_path):
    _, rig, operator = virtual_rig("flexinol")
    characterise(bench_mapping("flexinol"), make_plan(rig.config, QUICK), rig, operator, tmp_path)
    other = make_plan(rig.config, dataclasses.replace(QUICK, pulses=3))
    with pytest.raises(ConfigError, match="pulses_0.500N was measured with other settings"):
        characterise(bench_mapping("flexinol"), other, rig, operator, tmp_path)
    _, rig, operator = virtual_rig("furukawa")
    with pytest.raises(ConfigError, match="belongs to another wire"):
        characterise(bench_mapping("furukawa"), make_plan(rig.config, QUICK), rig, operator, tmp_path)


def test_the_current_is_off_when_the_daq_is_lost(tmp_path):
    bench, rig, operator = virtual_rig("flexinol")
    bench.inject("daq_silent", at_s=3.0)
    with pytest.raises(InstrumentLost):
        characterise(bench_mapping("flexinol"), make_plan(rig.config, QUICK), rig, operator, tmp_path)
    assert not bench.supply.output_on and bench.supply.current_A == 0.0


def test_one_answer_that_comes_late_does_not_end_an_experiment():
    """As the driver, it waits as long as a reading may be old: an hour's work is not begun again for a hiccup."""
    bench, rig, _ = virtual_rig("flexinol")
    late_s = 1.5 * rig.config.instruments.daq.timeout
    assert late_s < rig.config.safety.reading_timeout
    for instrument, name, number in ((rig.daq, "read_block", 30), (rig.supply, "read_back", 75)):
        in_time, asked = getattr(instrument, name), itertools.count()

        def late(in_time=in_time, asked=asked, number=number):
            if next(asked) == number:
                bench.inject("slow_answers", late_s)
            try:
                return in_time()
            finally:
                bench.clear("slow_answers")

        setattr(instrument, name, late)
    with rig.opened():
        log = rig.record(hold(0.2, 5.0))
    assert np.diff(log["time_s"]).max() > late_s
    assert len(log) > 80
    assert not bench.supply.output_on


def test_too_much_stress_stops_the_experiment_with_the_current_off():
    bench, rig, operator = virtual_rig("flexinol")
    operator.hang_load(4.0)
    with pytest.raises(InstrumentRefused, match="stress above its limit .*wire.max_stress is 175 MPa"), rig.opened():
        rig.record(hold(0.3, 5.0))
    assert not bench.supply.output_on


def test_a_hand_that_switches_the_output_off_ends_the_experiment():
    bench, rig, _ = virtual_rig("flexinol")
    with pytest.raises(InstrumentRefused, match="somebody else commands the supply"), rig.opened():
        rig.record(hold(0.2, 5.0), lambda _: bench.supply.set_output(False))


def test_a_tripped_supply_is_noticed():
    bench, rig, _ = virtual_rig("flexinol")
    bench.inject("current_disagrees", 2.0, at_s=0.5)
    with pytest.raises(InstrumentRefused, match="OCP"), rig.opened():
        rig.record(hold(0.3, 5.0))
    assert not bench.supply.output_on


@pytest.mark.parametrize(
    ("fault", "value", "words"),
    [
        ("open_wire", math.nan, "the wire is open"),
        ("short_wire", 0.0, "the wire is shorted"),
        ("channel_stuck", 103, "a channel is stuck"),
        ("channel_nan", 103, "a reading is not finite"),
        ("channel_saturated", 103, "a DAQ channel is saturated"),
        ("load_spike", 2.0, "the load jumped"),
        ("current_disagrees", 0.5, "the supply does not do what it was told"),
    ],
)
def test_every_guard_of_the_driver_looks_at_an_experiment_too(fault, value, words):
    bench, rig, _ = virtual_rig("flexinol")

    def provoke(elapsed_s):
        if elapsed_s > 0.5 and fault not in provoked:
            provoked.append(fault)
            bench.inject(fault, value)

    provoked = []
    with rig.opened():
        with pytest.raises(InstrumentRefused, match=words):
            rig.record(hold(0.2, 5.0), provoke)
        assert not bench.supply.output_on


@pytest.mark.parametrize("wire", ["flexinol", "furukawa"])
@pytest.mark.parametrize("physics", WORLDS)
def test_a_wire_that_loses_half_of_the_heat_it_should_is_not_overheated_whatever_is_asked_for(wire, physics):
    bench, rig, _ = virtual_rig(wire, physics=physics)
    bench.inject("draught", 0.5 / WORLDS[physics].heat_transfer)
    hottest_C = []
    with rig.opened():
        most_A, cycle = rig.config.supply.max_current, square_pulses(3, rig.config.supply.max_current, 0.05, 12.0, 2.0)
        log = rig.record(cycle, lambda _: hottest_C.append(bench.truth.temperature_C))
    assert 100.0 < max(hottest_C) < rig.config.thermal.max_temperature
    assert log["current_command_A"].max() == most_A
    bent = log["current_command_A"] < most_A
    assert (bent & (log["reference_voltage_V"] > 0.06)).any(), "the limit was reached"


def test_a_watchdog_that_cut_an_idle_supply_while_the_person_was_busy_stops_nothing():
    bench, rig, _ = virtual_rig("flexinol")
    with rig.opened():
        rig.record(hold(0.05, 0.5))
        bench.supply.trip("WDOG")
        assert rig.supply.read_back().tripped == "WDOG"
        assert len(rig.record(hold(0.05, 0.5))) > 8


def test_nor_one_of_a_supply_that_does_not_say_what_has_tripped():
    """As a Keysight N6700, which does not let its output on until that is cleared."""
    bench, rig, _ = virtual_rig("flexinol")
    rig.supply.reads_back = frozenset()
    told = rig.supply.read_back
    rig.supply.read_back = lambda: dataclasses.replace(told(), tripped="")
    with rig.opened():
        bench.supply.trip("WDOG")
        assert len(rig.record(hold(0.05, 0.5))) > 8


def test_an_output_that_is_not_confirmed_to_be_off_at_the_end_is_said():
    bench, rig, _ = virtual_rig("flexinol")
    with pytest.raises(InstrumentLost, match="told to be off, not confirmed: look at it"), rig.opened():
        bench.inject("supply_silent")
    bench.clear()
    with pytest.raises(KeyboardInterrupt), rig.opened():
        bench.inject("supply_silent")
        raise KeyboardInterrupt


@pytest.mark.long  # test_characterise_prompts.py sees the command measure over sockets
def test_the_same_characterisation_over_tcp(tmp_path):
    """In a physics whose cold wire stands still as soon as it is loaded, so that a fifth of a second measures its
    place.

    The load cell has no calibration before, as in a file that ``init`` has written.
    """
    mapping = bench_mapping("flexinol")
    known = mapping.pop("load_cell")
    with background(VirtualBench.from_name("flexinol", physics="liang_rogers")) as server:
        ports = server.ports[0]
        for name in ("supply", "daq"):
            mapping["instruments"][name]["resource"] = f"TCPIP::127.0.0.1::{ports[name]}::SOCKET"
        (tmp_path / "in.yaml").write_text(yaml.safe_dump({"sma_actuator": {"ros__parameters": mapping}}))
        code = main(
            [
                "characterise",
                "--config",
                str(tmp_path / "in.yaml"),
                "--unattended-bench",
                mapping["instruments"]["daq"]["resource"],
                "--out",
                str(tmp_path / "out"),
                "--loads",
                "0.6",
                "--pulses",
                "1",
                "--heat-time",
                "0.5",
                "--cool-time",
                "0.5",
                "--average",
                "0.2",
                "--masses",
                "20,100,200",
                "--skip",
                "partial",
                "--skip",
                "training",
                "--skip",
                "fatigue",
            ]
        )
    assert code == 0
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert manifest["calibration"]["circuit.lead_resistance"] == pytest.approx(0.25, abs=0.01)
    assert manifest["calibration"]["reference_sensor.slope"] == pytest.approx(0.315842, rel=0.01)
    assert manifest["calibration"]["load_cell.slope"] == pytest.approx(known["slope"], rel=0.01)
    log = read_bench_log(tmp_path / "out" / "pulses_0.600N.csv")
    assert log["reference_voltage_V"].max() > 0.25 and len(log) >= 20
    assert "data:image/png" in (tmp_path / "out" / "calibration.html").read_text()


@pytest.mark.parametrize(
    "options, sentence",
    [
        (PlanOptions(loads_N=(9.0,)), "9 N is outside what the wire is driven with, 0 to 2.87 N"),
        (PlanOptions(loads_N=(0.6, 2.9)), "2.9 N is outside what the wire is driven with, 0 to 2.87 N"),
        (PlanOptions(springs_N_m=((300.0, 2.9),)), "2.9 N is outside what the wire is driven with"),
        (PlanOptions(heat_current_A=0.9), "0.9 A is not between"),
    ],
    ids=["a load beyond the wire", "a load that it is not moved with", "nor on a spring", "a current beyond the limit"],
)
def test_a_plan_that_would_harm_the_wire_is_refused(options, sentence):
    _, rig, _ = virtual_rig("flexinol")
    with pytest.raises(ConfigError, match=sentence):
        make_plan(rig.config, options)


def test_partial_cycles_without_the_pulses_whose_stroke_they_go_by_are_refused():
    _, rig, _ = virtual_rig("flexinol")
    with pytest.raises(ConfigError, match="--skip pulses leaves those out; --skip partial too"):
        make_plan(rig.config, PlanOptions(skip=("pulses", "check")))
    kinds = {part.kind for part in make_plan(rig.config, PlanOptions(levels=2, skip=("pulses", "partial")))}
    assert "levels" in kinds and "partial" not in kinds


def test_a_current_that_would_overheat_a_badly_cooled_wire_is_refused():
    mapping = bench_mapping("flexinol")
    mapping["thermal"] = {**mapping["thermal"], "heat_loss": 0.002}
    with pytest.raises(ConfigError, match=r"0\.3 A would bring the wire to .* above thermal.max_temperature"):
        make_plan(bench_from_mapping(mapping), PlanOptions(heat_current_A=0.3))


def test_a_calibration_whose_channel_does_not_move_is_refused():
    with pytest.raises(ConfigError, match="load cell: the channel does not move"):
        fit_line([0.1, 0.1, 0.1], [0.1, 0.5, 1.0], "load cell")
    with pytest.raises(ConfigError, match="no straight line"):
        fit_line([0.0, 1.0, 2.0, 3.0], [0.0, 5.0, 1.0, 4.0], "load cell")


@pytest.mark.parametrize("sensor, channel", [("load_cell", 103), ("lvdt", 104)])
def test_a_sensor_that_does_not_follow_its_points_is_named_with_its_channel(sensor, channel, tmp_path):
    """As an input that is open: its noise lies on no line."""
    _, rig, operator = virtual_rig("flexinol")
    noise, read_block = np.random.default_rng(2), rig.daq.read_block
    rig.daq.read_block = lambda: dataclasses.replace(
        read_block(), load_cell_voltage_V=noise.normal(0.0, 2e-3), lvdt_current_A=noise.normal(0.0, 2e-4)
    )
    (part,) = [each for each in make_plan(rig.config, PlanOptions(average_s=0.5)) if each.kind == sensor]
    with rig.opened(), pytest.raises(ConfigError, match=rf"at instruments\.daq\.{sensor}_channel, {channel}: corr.*"):
        RUN[sensor](part, rig, operator, {}, lambda elapsed_s: None)


def test_a_folder_of_another_physics_is_refused_and_what_it_holds_is_said_to_be_measured(tmp_path, capsys):
    shown = ["characterise", "--virtual", "flexinol", "--loads", "0.5", "--average", "2"]
    kinds = ("lead_resistance", "load_cell", "lvdt", "training", "partial", "levels", "fatigue")
    shown += [word for kind in kinds for word in ("--skip", kind)] + ["--out", str(tmp_path)]
    assert main([*shown, "--physics", "drawn-5"]) == 0
    assert "part 1 of 1: pulses_0.500N, about" in capsys.readouterr().err
    assert main([*shown, "--physics", "drawn-5"]) == 0
    assert "part 1 of 1: pulses_0.500N, measured already" in capsys.readouterr().err
    assert main(shown) == 1
    assert "belongs to another wire" in (said := capsys.readouterr().err) and "'drawn-5'" in said


def test_one_that_an_instrument_has_ended_says_what_stays_and_how_it_goes_on(tmp_path, capsys, monkeypatch):
    def lost(*_):
        raise InstrumentLost("supply at TCPIP::h::1::SOCKET: no complete answer to 'MEAS?' within 0.2 s")

    shown = ["characterise", "--virtual", "flexinol", "--average", "2", "--out", str(tmp_path)]
    goes_on = f"what is measured stays in {tmp_path}; the same command goes on there\n"
    monkeypatch.setitem(RUN, "lead_resistance", lost)
    assert main(shown) == 1
    assert goes_on not in capsys.readouterr().err, "nothing is measured yet"
    monkeypatch.undo()
    monkeypatch.setitem(RUN, "load_cell", lost)
    assert main(shown) == 1
    assert goes_on in capsys.readouterr().err


def test_a_hidden_effect_wants_the_virtual_bench_and_a_name_it_knows(tmp_path, capsys):
    out = str(tmp_path / "out")
    assert main(["characterise", "--hidden", "voltage_offset=0.003", "--out", out]) == 1
    assert "--virtual" in capsys.readouterr().err
    assert main(["characterise", "--virtual", "flexinol", "--hidden", "gremlins=1", "--out", out]) == 1
    assert "'gremlins' is no hidden effect" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["characterise", "--virtual", "flexinol", "--hidden", "voltage_offset", "--out", out])
    assert "EFFECT=STRENGTH" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_the_virtual_bench_has_the_physics_that_was_asked_for_and_a_real_one_has_no_choice(tmp_path, capsys):
    def measured(physics):
        out = tmp_path / physics
        words = [
            "characterise",
            "--virtual",
            "furukawa",
            "--physics",
            physics,
            "--out",
            str(out),
            "--loads",
            "0.6",
            "--pulses",
            "1",
        ]
        for part in ("lead_resistance", "load_cell", "lvdt", "training", "partial", "fatigue"):
            words += ["--skip", part]
        assert main(words) == 0
        return read_bench_log(next(out.glob("pulses_*.csv")))

    home, foreign = measured(HOME), measured("foreign")
    difference = home["lvdt_current_A"] - foreign["lvdt_current_A"]
    assert 0.315842 * abs(difference).max() > 1e-4  # a tenth of a millimetre at least
    assert main(["characterise", "--physics", "measured", "--out", str(tmp_path / "real")]) == 1
    assert "only the virtual bench" in capsys.readouterr().err


_OPENED = """
import sys
from sma_actuator.base.share import shared_file
from sma_actuator.bench import InProcessDaq, InProcessSupply, VirtualBench, VirtualClock
from sma_actuator.characterise import Rig
from sma_actuator.characterise.programs import hold
from sma_actuator.estimation.chain import stresses_inside_Pa
from sma_actuator.config import bench_from_mapping, read_parameter_file

def ready():
    return {
        (name, what): len(kernel.signatures)
        for name, module in list(sys.modules.items())
        if name.startswith("sma_actuator.safety")
        for what, kernel in vars(module).items()
        if hasattr(kernel, "signatures")
    }

config = bench_from_mapping(read_parameter_file(shared_file("config/flexinol_bench.yaml")))
bench = VirtualBench.from_name("flexinol")
rig = Rig(config, InProcessSupply(bench, config), InProcessDaq(bench, config), VirtualClock(bench))
before, begin = {}, rig._watch.begin
rig._watch.begin = lambda: (before.update(ready()), begin())
with rig.opened():
    rig.record(hold(config.supply.bias_current, 10.0))
print({name: now for name, now in ready().items() if now != before[name]})
"""


def test_what_looks_at_every_row_is_compiled_before_current_flows():
    """On a machine that has driven nothing yet it takes seconds, in which nobody looks at the wire."""
    done = subprocess.run([sys.executable, "-c", _OPENED], capture_output=True, text=True, timeout=300, check=True)
    assert done.stdout == "{}\n"


@pytest.mark.parametrize("late_periods", [0.0, 1.3])
def test_after_an_answer_that_comes_late_the_current_has_time_to_stand_before_a_row_is_read(late_periods):
    """A DAQ that takes one channel at a time would read them on both sides of its step."""
    bench, rig, _ = virtual_rig("flexinol")
    period_s = 1.0 / rig.config.loop.rate
    read_block, set_current, told_s, stood_s = rig.daq.read_block, rig.supply.set_current, [], []

    def read():
        if told_s:
            stood_s.append(bench.time_s - told_s[-1])
        if len(stood_s) == 5:
            bench.advance(bench.time_s + late_periods * period_s)
        return read_block()

    rig.daq.read_block = read
    rig.supply.set_current = lambda current_A: (told_s.append(bench.time_s), set_current(current_A))
    with rig.opened():
        rig.record(hold(rig.config.supply.bias_current, 1.0))
    assert len(stood_s) > 10 and min(stood_s) > 0.99 * period_s


@pytest.mark.parametrize("diameter_m", [25e-6, 50e-6, 0.15e-3, 0.5e-3])
def test_fine_wires_get_weights_and_loads_that_they_can_carry_and_that_differ(diameter_m):
    mapping = bench_mapping("flexinol")
    mapping["wire"]["diameter"] = diameter_m
    for section in ("supply", "thermal", "controller", "estimator", "safety"):
        del mapping[section]
    bench = bench_from_mapping(with_derived(mapping))
    plan = make_plan(bench, PlanOptions())
    (forces_N,) = [part.parameters["forces_N"] for part in plan if part.kind == "load_cell"]
    strongest_N = bench.wire.max_stress * bench.wire.area_m2
    assert len(forces_N) >= 3
    assert 0.35 * strongest_N < max(forces_N) < strongest_N or forces_N[-1] == pytest.approx(2.94, abs=0.01)
    loads_N = {part.name: part.parameters["load_N"] for part in plan if part.kind == "pulses"}
    stresses_MPa = [load_N / bench.wire.area_m2 * 1e-6 for load_N in loads_N.values()]
    np.testing.assert_allclose(stresses_MPa, [15, 22, 32.4, 47.6, 70, 103, 151.2], rtol=0.005)


@pytest.mark.parametrize("most_Pa, lightest_Pa", [(60e6, 5.18e6), (175e6, 15e6), (300e6, 15e6)])
def test_a_wire_is_measured_and_followed_up_to_what_it_may_be_driven_with(most_Pa, lightest_Pa):
    """Within a twentieth of the range of the loads: beyond that an estimate is outside its calibration."""
    mapping = bench_mapping("flexinol")
    mapping["wire"]["max_stress"] = most_Pa
    bench = bench_from_mapping(mapping)
    stresses_Pa, followed_Pa = (
        [p.parameters["load_N"] / bench.wire.area_m2 for p in plan if p.kind == kind and "load_N" in p.parameters]
        for plan, kind in (
            (make_plan(bench, PlanOptions()), "pulses"),
            (make_plan(bench, PlanOptions(follow="model.yaml")), "followed"),
        )
    )
    driven_Pa = bench.safety.stress_limit_fraction * most_Pa
    assert stresses_Pa[0] == pytest.approx(lightest_Pa, rel=0.01) and stresses_Pa[-1] < driven_Pa
    assert stresses_inside_Pa((stresses_Pa[0], stresses_Pa[-1]))[1] >= driven_Pa
    *between_Pa, heaviest_Pa = followed_Pa
    assert np.searchsorted(stresses_Pa, between_Pa).tolist() == [1, 3, 5, 6] and heaviest_Pa == stresses_Pa[-1]


def test_a_spring_has_its_preload_at_full_extension_of_a_long_wire_too(tmp_path):
    """It had it at 4 mm, the full extension of 100 mm, and a longer wire went slack before it was extended."""
    mapping = bench_mapping("flexinol")
    mapping["wire"]["length"] = 0.3
    for section in ("supply", "thermal", "controller", "estimator", "safety"):
        del mapping[section]
    write_parameter_file(tmp_path / "bench.yaml", with_derived(mapping), "a longer wire")
    kinds = ("check", "training", "lead_resistance", "load_cell", "lvdt", "partial", "levels", "fatigue")
    skipped = [word for kind in kinds for word in ("--skip", kind)]
    words = ["characterise", "--virtual", "flexinol", "--config", str(tmp_path / "bench.yaml"), *skipped]
    words += ["--loads", "0.5", "--spring", "60,0.3", "--pulses", "1", "--out", str(tmp_path / "out")]
    assert main(words) == 0
    (log,) = (tmp_path / "out").glob("pulses_spring*.csv")
    read = read_bench_log(log)
    load_N = read["load_cell_voltage_V"] * 12.7297 - 0.0598
    assert load_N.min() > 0.29


@pytest.mark.parametrize("spring", ["100", "100,0.5,0.004", "0,0.5", "100,-1", "nan,0.5"])
def test_what_is_no_spring_is_refused_with_what_is_one(capsys, spring):
    with pytest.raises(SystemExit):
        main(["characterise", "--virtual", "flexinol", "--out", "nowhere", f"--spring={spring}"])
    assert f"'{spring}' is no spring; stiffness and preload, both above zero" in " ".join(
        capsys.readouterr().err.split()
    )


def test_too_few_masses_for_a_load_cell_are_refused_before_anything_is_measured():
    bench = bench_from_mapping(bench_mapping("flexinol"))
    with pytest.raises(ConfigError, match=r"masses: 2 are too few to calibrate a load cell; 3 different ones"):
        make_plan(bench, PlanOptions(masses_kg=(0.1, 0.2, 0.2)))
    assert make_plan(bench, PlanOptions(masses_kg=(0.1,), skip=("load_cell",)))


@pytest.mark.parametrize("share", [0.3, 0.8], ids=["early on the ramp", "near its end"])
def test_a_quick_wire_is_ramped_through_its_transformation_and_no_further_than_the_heat_limit_bears(share):
    """37 µm at 20 Hz cool in three readings: each pulse is one cycle, with its way into the heat in many readings."""
    mapping = bench_mapping("flexinol")
    mapping["wire"]["diameter"] = 37e-6
    for section in ("supply", "thermal", "controller", "estimator", "safety"):
        del mapping[section]
    bench = bench_from_mapping(with_derived(mapping))
    (pulses,) = [part for part in make_plan(bench, PlanOptions(loads_N=(0.08,))) if part.kind == "pulses"]
    thermal, p = bench.thermal, pulses.parameters
    held_K = p["heat_current_A"] ** 2 * typical_resistance_Ohm(bench.wire) / thermal.heat_loss
    limit_K = (thermal.max_temperature - thermal.ambient_temperature) / min(thermal.heat_loss_margin, ATTENDED_MARGIN)
    assert 0.85 * limit_K < held_K < limit_K  # of the one that looks meanwhile: the wire is not left alone
    program, time_s, temperature_K = square_pulses(
        2, p["heat_current_A"], 5e-3, p["heat_s"], p["cool_s"], 4.0 * p["cool_s"], p["most_current_A"],
        4.0 * p["heat_s"], p["ramp_s"],
    ), 0.0, 0.0  # fmt: skip
    drive, shown = next(program), []
    with contextlib.suppress(StopIteration):
        while True:
            time_s += 0.05
            temperature_K += 0.5 * (held_K * (drive.current_A / p["heat_current_A"]) ** 2 - temperature_K)
            at_m = 4e-3 / (1.0 + math.exp((temperature_K - share * held_K) / 1.5)) + 5e-6 * temperature_K  # it expands
            shown.append((drive.current_A, at_m))
            drive = program.send(SimpleNamespace(time_s=time_s, reference_displacement_m=at_m))
    current_A, at_m = np.array(shown).T
    driven = is_driven(current_A)
    cycles = cycles_of(at_m, driven, cycle_numbers(driven))
    assert [cycle.rests for cycle in cycles] == [True, True]
    assert min(cycle.heated for cycle in cycles) >= IN_MOTION
    assert current_A.max() == pytest.approx(p["heat_current_A"] * 1.15**0.5, rel=1e-3), "more was tried, once"
