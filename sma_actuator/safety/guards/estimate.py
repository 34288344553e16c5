"""The estimate of the position."""

from __future__ import annotations

from math import isfinite

from sma_actuator.base.signals import Quality
from sma_actuator.safety.formula import parameter_value
from sma_actuator.safety.records import Action, Step, guard
from sma_actuator.safety.timing import ONE_STEP, TWO_STEPS


@guard(
    words="the estimator is outside its region",
    remedy="Compare load and resistance with what the model was identified on; identify it anew if they left it",
    detector="no estimate within the model's calibration for safety.outside_calibration_time",
    within=parameter_value("safety.outside_calibration_time") + TWO_STEPS,
    action=Action.OFF,
    latches=True,
)
def estimator_outside(step: Step) -> str:
    """The estimate has been outside the model's calibration for too long."""
    outside = step.settled and step.estimate.quality >= Quality.OUTSIDE_CALIBRATION
    lasts_s = step.memory.lasts_s("estimator_outside", outside, step.now_s)
    if not lasts_s >= step.config.safety.outside_calibration_time:
        return ""
    return (
        f"{step.estimate.quality.name.lower().replace('_', ' ')} for {lasts_s:.3g} s at "
        f"{step.config.wire.stress_text(step.signals.stress_Pa)}; "
        f"safety.outside_calibration_time is {step.config.safety.outside_calibration_time:g} s"
    )


@guard(
    words="there is no estimate",
    remedy="Check the readings; the current stays at the bias until there is an estimate",
    detector="the estimate is not finite or of quality INVALID while current flows; becomes estimator_outside when it "
    "lasts",
    within=ONE_STEP,
    action=Action.BIAS,
)
def estimate_invalid(step: Step) -> str:
    """The estimate is not a number."""
    if not step.settled or (step.estimate.quality is not Quality.INVALID and isfinite(step.estimate.displacement_m)):
        return ""
    return "the estimate is not valid"
