"""A known wire is found again, an effect that was switched on is named, none where there is none, and none that a run
alone asks for."""

import numpy as np
import pytest
from forward_runs import MEASURED, TRUTH, makers, synthetic

from sma_actuator.base.parameters import declaration_of
from sma_actuator.diagnosis.forward.candidates import CANDIDATES, named
from sma_actuator.diagnosis.forward.fitting import fit, fit_for_new_runs, plain_parameters, plain_starts
from sma_actuator.diagnosis.forward.race import trace_runs
from sma_actuator.diagnosis.forward.report import sentences, summary
from sma_actuator.diagnosis.forward.runs import Run, read_run
from sma_actuator.diagnosis.forward.wire import ForwardEffects

FEW = tuple(named(n) for n in ("backlash", "dead time", "natural convection", "spread", "lead resistance"))


@pytest.mark.parametrize("fitted", (fit, fit_for_new_runs))
def test_the_parameters_of_a_known_wire_are_found_again(fitted):
    wire = makers()
    free = plain_parameters(wire)
    found = fitted(wire, free, synthetic({}), plain_starts(free), 60)
    assert found.rms_m < 3e-5
    # Heat capacity, losses and latent heat scale with the power, which is known: all of them are fixed by the runs.
    for name, value in TRUTH.items():
        assert found.wire.value(name) == pytest.approx(value, rel=0.05), name


def test_what_runs_do_not_say_is_what_was_known_before_them():
    """A run that ends hot says nothing of martensite, wherever the search begins."""
    (_, step, *_), wire = synthetic({}), makers()
    heats = step.time_s < 25.0
    run = Run("heats", step.time_s[heats], step.duty[heats], step.position_m[heats])
    free = plain_parameters(wire)
    elsewhere = plain_starts(free)[1]
    alone, found = (fitted(wire, free, [run], [elsewhere], 60) for fitted in (fit, fit_for_new_runs))
    of_martensite = [i for i, f in enumerate(free) if "martensite" in f.name]
    usual = [free[i].start for i in of_martensite]
    np.testing.assert_allclose(found.values[of_martensite], usual, rtol=0.01)
    assert np.all(np.abs(alone.values[of_martensite] - usual) > 1.0)
    assert found.rms_m < 1.1 * alone.rms_m


@pytest.mark.long  # test_forward_command.py sees that one that is there is named
@pytest.mark.parametrize("judged, candidates", ((slice(3, None), FEW[:1]), (slice(0), FEW[:3])))
def test_without_an_effect_none_is_named(judged, candidates):
    runs = synthetic({})
    found = trace_runs(makers(), runs[:3], runs[judged], candidates=candidates)
    assert found.verdict == "none"
    assert found.named == () == found.choice.winner.effects
    assert found.choice.heated_by == "rms"
    report = summary(found)
    assert report["verdict"] == "none" and report["effects"] == []
    assert "Nothing is missing" in report["sentence"]


@pytest.mark.long
def test_an_error_that_is_no_candidates_is_not_given_a_name():
    found = trace_runs(makers(), synthetic({}, drift_m=5e-5, ambient_K=0.7, bend=0.005, seed=1)[:3], candidates=FEW)
    assert found.verdict == "unexplained", sentences(found)
    assert found.named == ()
    assert summary(found)["effects"] == []
    assert found.fitted is found.choice.fitted_plain
    assert "no candidate explains" in sentences(found)[0]


@pytest.mark.long  # test_forward_command.py sees it of a backlash
@pytest.mark.parametrize(
    "effects, name",
    (({"backlash_m": 4e-4}, "backlash"), ({"dead_time_s": 0.4}, "dead time"), ({"spread_K": 6.0}, "spread")),
)
def test_an_effect_that_was_switched_on_is_named_on_a_run_that_had_no_part_in_it(effects, name):
    runs = synthetic(effects)
    found = trace_runs(makers(), runs[:3], runs[3:], candidates=FEW)
    assert found.verdict == "traced", sentences(found)
    assert [c.name for c in found.named] == [name], sentences(found)
    assert [run.name for run in found.choice.runs] == ["ramp", "step", "low"] and [
        run.name for run in found.judged
    ] == ["stairs"]
    report = summary(found)
    assert report["error_after_mm"] < 0.5 * report["error_before_mm"]
    ((parameter, value),) = effects.items()
    assert found.fitted.wire.value(f"effects.{parameter}") == pytest.approx(value, rel=0.25)
    assert report["effects"][0]["parameters"][parameter]["value"] == pytest.approx(value, rel=0.25)
    assert report["runs"][0]["chosen_and_fitted_on"] == ["ramp", "step", "low"]


@pytest.mark.long
def test_an_effect_is_named_through_errors_that_are_no_candidates():
    found = trace_runs(
        makers(), synthetic({"dead_time_s": 0.4}, drift_m=5e-5, ambient_K=0.3, bend=0.005, seed=5), candidates=FEW[:2]
    )
    assert found.verdict == "traced", sentences(found)
    assert [c.name for c in found.named] == ["dead time"]
    assert found.chosen_in("dead time") > 0.5
    assert sum(found.after_m) < 0.8 * sum(found.before_m)


@pytest.mark.long
def test_each_run_is_judged_by_a_choice_that_it_had_no_part_in():
    runs = synthetic({"dead_time_s": 0.4})[:3]
    found = trace_runs(makers(), runs, candidates=FEW[1:2])
    for run, judgement in zip(runs, found.judgements, strict=True):
        assert judgement.judged == (run,)
        assert run not in judgement.choice.runs
        assert all(run not in fitted + judged for fitted, judged in judgement.choice.folds)
    alone = trace_runs(makers(), runs[1:], runs[:1], candidates=FEW[1:2])
    assert np.array_equal(alone.choice.fitted.values, found.judgements[0].choice.fitted.values)
    assert alone.after_m == found.judgements[0].after_m


def test_every_candidate_keeps_to_what_its_parameters_are_declared_for():
    for candidate in CANDIDATES:
        for free in candidate.free:
            where, _, key = free.name.partition(".")
            if where == "effects":
                declared = declaration_of(ForwardEffects.__dataclass_fields__[key])
                assert declared.lo <= free.lo < free.start < free.hi <= declared.hi, free.name
                assert free.unit == declared.unit


@pytest.mark.long
@pytest.mark.skipif(not MEASURED.is_dir(), reason=f"the measurements are not beside the project ({MEASURED})")
def test_the_measured_wire_is_heated_by_the_rms_voltage_and_lacks_something():
    ramp, cooling, other = (read_run(MEASURED / f"{n}.csv") for n in ("ramp01", "step02", "step03_pr"))
    found = trace_runs(makers(), [ramp, cooling, other], candidates=FEW[2:3])
    assert found.choice.heated_by == "rms"
    assert np.mean(found.heats_m("mean")) > 3 * np.mean(found.heats_m("rms"))
    assert max(found.after_m) < 0.06 * other.stroke_m
    assert found.verdict in ("traced", "unexplained")
    text = " ".join(sentences(found))
    assert "after power off the slider still moves 0.8" in text
    assert "step02 and step03_pr were driven alike" in text
