"""Most people hang one weight on a wire: one load, or one log, gives a model, and says what it is not good for."""

import contextlib
import dataclasses
import functools
import re

import numpy as np
import pytest
from characterised import bench_mapping, virtual_rig

from sma_actuator.base.parameters import ConfigError
from sma_actuator.base.signals import Quality
from sma_actuator.characterise.programs import partial_cycles, square_pulses
from sma_actuator.config import Config, require_calibrated
from sma_actuator.estimation.chain import Chain
from sma_actuator.identify import IdentificationError, identify
from sma_actuator.identify.fitters.whole_range import learner, surroundings
from sma_actuator.identify.identification import identify_best
from sma_actuator.logs.bench_log import BenchLog
from sma_actuator.logs.experiments import make_experiment
from sma_actuator.plant.loads import Spring, Weight

LOAD_N = 1.0
SPRING = Spring(300.0, 0.5)


@functools.cache
def record(wire, seed, load_N=LOAD_N, cycles=4, spring=None):
    """Pulses, then partial cycles, at one weight, or on a spring: logs that are everybody's."""
    _, rig, _ = virtual_rig(wire, seed=seed, load=spring or Weight(load_N))
    current_A = {"flexinol": 0.3, "furukawa": 0.6}[wire]
    places_m = {"flexinol": (0.0035, 0.0010), "furukawa": (0.0015, 0.0005)}[wire]
    with rig.opened():
        return (
            rig.record(square_pulses(cycles, current_A, 0.05, 5.0, 10.0)),
            rig.record(partial_cycles(list(np.linspace(*places_m, 4)), current_A, 0.05, 6.0, 8.0)),
        )


@contextlib.contextmanager
def few_units():
    """A whole-range model of a quarter of the units takes a fifth of the time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(learner, "UNITS", 8)
        patch.setattr(surroundings, "UNITS", 4)
        yield


@pytest.fixture(scope="module")
def logs():
    return record("flexinol", 1)


@pytest.fixture(scope="module")
def thesis(logs):
    return identify(logs, bench_mapping("flexinol"), "flexinol")


@pytest.fixture(scope="module")
def from_one_log(logs):
    """The best model of one long log of one load."""
    return identify_best(logs[:1], bench_mapping("flexinol"))


def error_percent(result, log):
    """Mean absolute, in the working range, of a log that was not fitted; and the share of readings inside the
    calibration."""
    experiment = make_experiment(log, result.config)
    found = Chain(result.config).run(experiment.signals)
    low_m, high_m = result.config.model.build(result.config.wire).displacement_range_m
    inside = (experiment.displacement_m > low_m) & (experiment.displacement_m < high_m)
    error = np.abs(found.displacement_m - experiment.displacement_m)[inside] / result.config.wire.full_stroke_m * 100.0
    return float(np.nanmean(error)), float(np.mean(found.quality[inside] < Quality.OUTSIDE_CALIBRATION))


@pytest.mark.parametrize("model", ("flexinol", "flexinol_normalised"))
def test_one_weight_gives_the_thesiss_model_without_a_flag(logs, model):
    found = identify(logs, bench_mapping("flexinol"), model)
    assert len(found.config.model.heating_slope) == 1  # of order 0 in stress
    assert found.verdict.good_for_control


@pytest.mark.parametrize("model", ("furukawa", "furukawa_normalised"))
def test_so_does_one_weight_on_a_wire_of_ni_ti_cu(model):
    found = identify(record("furukawa", 1), bench_mapping("furukawa"), model)
    assert error_percent(found, record("furukawa", 2)[0])[0] < 2.0


def test_an_order_that_one_load_cannot_tell_is_still_refused_where_it_is_asked_for(logs):
    with pytest.raises(IdentificationError, match="order 1 in stress needs full cycles at 2 different loads"):
        identify(logs, bench_mapping("flexinol"), "flexinol", order=1)


@pytest.mark.parametrize("which", ("thesis", pytest.param("from_one_log", marks=pytest.mark.long)))
def test_the_verdict_says_from_which_load_on_the_node_calls_it_foreign(which, request):
    result = request.getfixturevalue(which)
    (sentence,) = [s for s in result.verdict.sentences if s.startswith("for one load")]
    assert "1 N" in sentence and "each tenth" in sentence
    low_N, high_N = map(float, re.search(r"below ([\d.]+) and above ([\d.]+) N", sentence).groups())
    assert 0.85 < low_N < 0.92 and 1.08 < high_N < 1.15
    for load_N, seen in ((high_N + 0.03, False), (low_N - 0.03, False), (high_N - 0.04, True), (low_N + 0.04, True)):
        share = error_percent(result, record("flexinol", 3, load_N, cycles=1)[0])[1]
        assert (share > 0.9) == seen, (load_N, share)


@pytest.mark.parametrize("which", ("thesis", pytest.param("from_one_log", marks=pytest.mark.long)))
def test_a_tenth_more_load_costs_what_the_verdict_says(which, request):
    result = request.getfixturevalue(which)
    at_home, _ = error_percent(result, record("flexinol", 2)[0])
    heavier, _ = error_percent(result, record("flexinol", 2, 1.1 * LOAD_N)[0])
    assert at_home < 1.2 and heavier - at_home < 2.0


@pytest.mark.long
def test_one_long_log_is_cut_into_stretches_to_hold_some_out(from_one_log):
    assert from_one_log.config.model_type == "whole_range"
    assert from_one_log.fit.coefficients.curve_interval > 0.0  # of stretches left out
    assert from_one_log.chosen.startswith("take whole_range")
    assert error_percent(from_one_log, record("flexinol", 2)[0])[0] < 0.6


@pytest.fixture(scope="module")
def on_a_spring():
    """The model of a wire on which nobody hung a weight: it pulls the spring of its joint."""
    with few_units():
        return identify_best(record("flexinol", 1, spring=SPRING), bench_mapping("flexinol"))


def test_the_spring_of_a_joint_will_do(on_a_spring):
    assert on_a_spring.config.model_type == "whole_range"
    assert on_a_spring.verdict.good_for_control
    assert error_percent(on_a_spring, record("flexinol", 2, spring=SPRING)[0])[0] < 0.8


def test_a_spring_tells_what_heat_the_wire_takes_as_a_weight_does(on_a_spring, thesis):
    """By that a node knows how hot it may make it, and tracing knows another heat loss."""
    pulled, hung = (found.config.calibration for found in (on_a_spring, thesis))
    assert pulled.hot_end.contracted_temperature == pytest.approx(hung.hot_end.contracted_temperature, abs=6.0)
    (stress_Pa,) = hung.hot_end.contracted_stress
    for share in (0.2, 0.5, 0.8):
        assert pulled.power.heating_C(share, stress_Pa) == pytest.approx(
            hung.power.heating_C(share, stress_Pa), abs=4.0
        )


@pytest.mark.parametrize("wire", ["flexinol", pytest.param("furukawa", marks=pytest.mark.long)])
def test_between_two_weights_it_goes_along_a_line_and_says_so(wire):
    """Nothing tells the square of the stress from a constant: with half of each it was off by 49 and 11 % midway."""
    logs = [log for load_N in (0.6, 2.0) for log in record(wire, 1, load_N)]
    with few_units():
        found = identify(logs, bench_mapping(wire), "whole_range")
    assert error_percent(found, record(wire, 2, 1.2)[0])[0] < 5.0
    (sentence,) = [s for s in found.verdict.sentences if s.startswith("between 0.6 and 2 N no log has a load")]
    assert "5 % of full stroke midway" in sentence


def as_if_it_rose(log):
    """The log of a wire whose resistance rises as it contracts."""
    voltage_V, current_A = log["supply_voltage_V"], log["reference_voltage_V"]  # on 1 Ω
    resistance_Ohm = voltage_V / current_A
    turned_V = (2.0 * np.median(resistance_Ohm) - resistance_Ohm) * current_A
    return dataclasses.replace(log, columns={**log.columns, "supply_voltage_V": turned_V})


def test_the_resistance_of_a_wire_may_rise_as_it_contracts():
    logs = [as_if_it_rose(log) for load_N in (0.6, 2.0) for log in record("flexinol", 1, load_N)]
    with few_units():
        found = identify(logs, bench_mapping("flexinol"), "whole_range")
    (hot_Ohm, *_), (cold_Ohm, *_) = found.config.model.hot_resistance, found.config.model.cold_resistance
    assert hot_Ohm > cold_Ohm
    assert error_percent(found, as_if_it_rose(record("flexinol", 2, 0.6)[0]))[0] < 1.0
    with pytest.raises(ConfigError, match="resistance rises as it contracts; the guards .* it is not driven"):
        require_calibrated(found.config)
    turned = {**found.mapping["model"], "curve": [-value for value in found.mapping["model"]["curve"]]}
    with pytest.raises(ConfigError, match="counts contraction"):
        Config.from_mapping({**found.mapping, "model": turned})


@pytest.mark.parametrize("wire", ["flexinol", pytest.param("furukawa", marks=pytest.mark.long)])
def test_three_weights_are_judged_by_two_that_tell_of_a_line(wire):
    """Without the one between, the square of the stress was told by nothing: it was said to be off by 9 % there."""
    logs = [log for load_N in (0.6, 1.2, 2.0) for log in record(wire, 1, load_N)]
    with few_units():
        found = identify(logs, bench_mapping(wire), "whole_range")
    between = [error_percent(found, record(wire, 2, load_N)[0])[0] for load_N in (0.9, 1.6)]
    assert max(between) < found.verdict.regions["working range"] < 2.0
    assert not [s for s in found.verdict.sentences if s.startswith("not for")]


def test_two_cycles_are_too_few_for_it_and_the_thesiss_model_is_taken(logs):
    short = record("flexinol", 1, cycles=2)[:1]
    found = identify_best(short, bench_mapping("flexinol"))
    assert found.config.model_type == "flexinol"
    assert found.chosen.startswith("flexinol: whole_range: 3 logs or cycles at least")


def test_a_log_that_is_judged_wrongly_is_named_and_left_out(logs):
    """The wire on its way back is not in it, as of a recorder that was switched off and on."""
    pulses = logs[0]
    place, current = pulses["lvdt_current_A"], pulses["reference_voltage_V"]
    share = (place - place.min()) / np.ptp(place)
    kept = (current > 0.5 * current.max()) | (share < 0.2) | (share > 0.8)
    columns = {name: values[kept] for name, values in pulses.columns.items()}
    columns["time_s"] = np.arange(kept.sum()) * pulses.period_s
    broken = BenchLog(columns, source="broken.csv")
    found = identify([*logs, broken], bench_mapping("flexinol"), "flexinol")
    (note,) = [n for n in found.notes if n.startswith("left out")]
    assert "broken.csv: the cooling branch has 0 samples in mid-stroke, all cycles together; 5 are wanted" in note
    assert "measure more cycles (`characterise --pulses`)" in note, "it says what to do"
    assert not any("broken" in e.name for e in found.errors)


def test_a_log_of_another_wire_is_named_and_left_out_among_others(logs):
    other = dataclasses.replace(logs[0], metadata={"wire": {"length_m": 0.2}}, source="other.csv")
    found = identify([*logs, other], bench_mapping("flexinol"), "flexinol")
    assert [n for n in found.notes if "other.csv" in n and "another wire" in n]
    with pytest.raises(ValueError, match="another wire"):
        identify([other], bench_mapping("flexinol"), "flexinol")
