"""The section ``calibration`` of a model and its own logs, part by part.

``trace`` compares new logs with it: an error that was there at the calibration is the model's, one
that was not has a cause.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from sma_actuator.base.calibration import Calibration, TrainingSection
from sma_actuator.config import Config
from sma_actuator.estimation.chain import Chain, Estimates
from sma_actuator.logs.experiments import Experiment, begins_anew

from . import expectation, hot_end, interval, power, rest
from .training import change_while_measured_m


def calibration_of(experiments: Sequence[Experiment], config: Config, at_rest: bool = True) -> Calibration:
    """The section ``calibration`` for a model and its own logs.

    ``at_rest``: with what a resting wire shows; left out for models of wires of any size.
    """
    known = _of_the_wire(experiments, config) if at_rest else Calibration()
    config = dataclasses.replace(config, calibration=known)  # the hot end that the node will know decides errors too
    found = _through(config, experiments)
    experiments = [t.through(estimate) for t, estimate in zip(experiments, found, strict=True)]
    estimates = [estimate.displacement_m for estimate in found]
    full_m = config.wire.full_stroke_m
    errors = [
        float(np.nanmean(np.abs(d - t.displacement_m))) / full_m * 100
        for d, t in zip(estimates, experiments, strict=True)
    ]
    known = dataclasses.replace(known, error=float(np.mean(errors)), largest_error=max(errors))
    if not at_rest:
        return known
    chain = Chain(config)
    # What a model leaves on logs that it has learned by heart is no measure of others; it says itself how sure it is.
    expected = (
        expectation.how_long(experiments, found)
        if chain.says_how_sure
        else expectation.learn(experiments, found, config)
    )
    return dataclasses.replace(
        known,
        interval=interval.learn(experiments, estimates, chain.displacement_range_m, full_m),
        expectation=expected,
    )


def _through(config: Config, experiments: Sequence[Experiment]) -> Sequence[Estimates]:
    """Every experiment through the chain, which goes on through stretches of one log that follow each other."""
    chain, out = Chain(config), list[Estimates]()
    for experiment, anew in zip(experiments, begins_anew(experiments), strict=True):
        if anew:
            chain = Chain(config)
        out.append(chain.judge(experiment.signals))
    return out


def _of_the_wire(experiments: Sequence[Experiment], config: Config) -> Calibration:
    """What the wire shows whatever the model makes of it."""
    config = dataclasses.replace(config, calibration=Calibration())
    experiments = [t.through(found) for t, found in zip(experiments, _through(config, experiments), strict=True)]
    measured_C = [np.atleast_1d(t.signals.ambient_temperature_C) for t in experiments]
    ambient = np.concatenate([a[np.isfinite(a)] for a in measured_C])
    resistance_Ohm = np.concatenate([t.resistance_Ohm for t in experiments])
    change_m = change_while_measured_m([t.log for t in experiments], config)
    known = Calibration(
        resistance_range=float(np.subtract(*np.nanpercentile(resistance_Ohm, (99.5, 0.5)))),
        ambient_temperature=float(ambient.mean()) if len(ambient) else np.nan,
        rest=rest.learn(experiments, config.thermal.heat_capacity / config.thermal.heat_loss),
        hot_end=hot_end.learn(experiments, config),
        training=TrainingSection(changed=change_m),
    )
    return dataclasses.replace(known, power=power.learn(experiments, config, known))
