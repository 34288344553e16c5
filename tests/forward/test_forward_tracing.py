"""A known wire is found again, an effect that was switched on is named, and none where there is none."""

import numpy as np
import pytest

from sma_actuator.forward.candidates import CANDIDATES, named
from sma_actuator.forward.fitting import fit, plain_parameters, plain_starts
from sma_actuator.forward.findings import sentences, summary
from sma_actuator.forward.runs import read_run
from sma_actuator.forward.tracing import trace
from sma_actuator.forward.wire import Effects
from sma_actuator.parameters import declaration_of

from forward_runs import MEASURED, TRUTH, makers, synthetic

FEW = tuple(named(n) for n in ("friction", "backlash", "dead time", "natural convection", "spread", "lead resistance"))


def test_the_parameters_of_a_known_wire_are_found_again():
    wire = makers()
    free = plain_parameters(wire)
    found = fit(wire, free, synthetic({}), plain_starts(free), 60)
    assert found.rms_m < 3e-5
    # Heat capacity, losses and latent heat scale with the power, which is known: all of them are fixed by the runs.
    for name, value in TRUTH.items():
        assert found.wire.value(name) == pytest.approx(value, rel=0.05), name


def test_without_an_effect_none_is_named():
    found = trace(makers(), synthetic({})[:3], candidates=FEW)
    assert found.chosen == ()
    assert found.heated_by == "rms"
    assert "No effect is named" in " ".join(sentences(found))


@pytest.mark.parametrize(
    "effects, name",
    (
        ({"backlash_m": 4e-4}, "backlash"),
        ({"dead_time_s": 0.4}, "dead time"),
        ({"spread_K": 6.0}, "spread"),
    ),
)
def test_an_effect_that_was_switched_on_is_named(effects, name):
    runs = synthetic(effects)
    found = trace(makers(), runs[:3], runs[3:], candidates=FEW)
    assert name in [c.name for c in found.chosen], sentences(found)
    assert found.left < 0.5
    (parameter, value), = effects.items()
    assert found.fitted.wire.value(f"effects.{parameter}") == pytest.approx(value, rel=0.25)
    assert summary(found)["named"][0]["values"]


def test_every_candidate_keeps_to_what_its_parameters_are_declared_for():
    for candidate in CANDIDATES:
        for free in candidate.free:
            where, _, key = free.name.partition(".")
            if where == "effects":
                declared = declaration_of(Effects.__dataclass_fields__[key])
                assert declared.lo <= free.lo < free.start < free.hi <= declared.hi, free.name
                assert free.unit == declared.unit


@pytest.mark.skipif(not MEASURED.is_dir(), reason=f"the measurements are not beside the project ({MEASURED})")
def test_the_measured_wire_is_heated_by_the_rms_voltage_and_lacks_something():
    ramp, step, cooling, other = (read_run(MEASURED / f"{n}.csv") for n in ("ramp01", "step01", "step02", "step03_pr"))
    found = trace(makers(), [ramp, cooling], [step, other], candidates=FEW)
    assert found.heated_by == "rms"
    assert np.mean(found.heats["mean"]) > 3 * np.mean(found.heats["rms"])
    assert max(found.held_out.held_out_m) < 0.05 * other.stroke_m
    assert "after power off the slider still moves 0.8" in " ".join(sentences(found))
    assert found.chosen
