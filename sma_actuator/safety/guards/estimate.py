"""The estimate of the position."""

from __future__ import annotations

from math import isfinite, isnan, nan

from sma_actuator.base.signals import Quality
from sma_actuator.safety.formula import parameter_value, seconds
from sma_actuator.safety.records import Action, Step, guard
from sma_actuator.safety.timing import ONE_STEP, TWO_STEPS

#: Share of the full stroke, beside half of the estimate's 95 % interval, that it and a displacement sensor may be
#: apart, and for how long.  For a second models of the wire's own logs are 3 % apart at most, the thesis's 7 %; where
#: something lies it is 19 % and more, once the wire is moved.
APART, APART_s = 0.1, 1.0


def contradicted_m(step: Step) -> float:
    """How far the displacement sensor and the position that resistance and load tell are apart; NaN where one of them
    is not known or both may be right."""
    if step.contradicted_m is None:
        step.contradicted_m = _contradicted_m(step)
    return step.contradicted_m


def _contradicted_m(step: Step) -> float:
    if step.reading is None or not step.settled or step.estimate.quality > Quality.INDETERMINATE_HOT:
        return nan
    apart_m = step.signals.reference_displacement_m - step.estimate.displacement_m
    half_m = step.estimate.uncertainty_m
    may_m = APART * step.config.wire.full_stroke_m + (0.0 if isnan(half_m) else half_m)
    return apart_m if abs(apart_m) > may_m else nan


@guard(
    words="the displacement sensor contradicts the position",
    remedy="Compare both with a ruler. Where the sensor is right, look at load cell, crimps and mount, and identify "
    "anew; else at the sensor, its mount and channel. instruments.daq.lvdt_channel 0 leaves it out",
    detector="a displacement sensor, where fitted, and an estimate inside its calibration are apart by more "
    f"than {100 * APART:g} % of the full stroke and half of the estimate's 95 % interval for {APART_s:g} s; a sensor "
    "that stands still shows when the wire is moved",
    within=seconds(APART_s) + TWO_STEPS,
    action=Action.NOTE,
)
def position_contradicted(step: Step) -> str:
    """Resistance and load tell one position, the displacement sensor another."""
    apart_m = contradicted_m(step)
    if not step.memory.lasts_s("position_contradicted", not isnan(apart_m), step.now_s) >= APART_s:
        return ""
    return f"it reads {apart_m * 1e3:+.3g} mm from {step.estimate.displacement_m * 1e3:.3g} mm"


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
