"""What ``~/signals`` carries of a step: every column of the bench log, and what was made of it, by name."""

from __future__ import annotations

from math import nan

from sma_actuator.base.signals import Output, Quality
from sma_actuator.logs.recorder import recorded_row

#: Of the status, which holds them already.
_OF_STATUS = (
    "temperature_C",
    "temperature_at_most_C",
    "heat_loss_times",
    "current_limit_A",
    "limited_setpoint_m",
    "shortest_m",
    "longest_m",
)


def named_signals(output: Output) -> dict[str, float]:
    """Named values of a step with a reading; a position that nobody knows is NaN."""
    assert output.reading is not None
    row = recorded_row(output.reading, output)
    if output.estimate.quality is Quality.INVALID:
        row["displacement_estimate_m"] = row["velocity_estimate_m_s"] = nan
    signals, values = output.signals, output.status.values
    of_status = {name: value for name in _OF_STATUS if isinstance(value := values.get(name, nan), float)}
    return {
        **row,
        "current_A": signals.current_A,
        "resistance_Ohm": signals.resistance_Ohm,
        "power_W": signals.power_W,
        "load_N": signals.load_N,
        "stress_Pa": signals.stress_Pa,
        "displacement_m": signals.reference_displacement_m,
        "uncertainty_m": output.estimate.uncertainty_m,
        "model_health": int(output.health.state),
        "model_error_m": output.health.error_m,
        **of_status,
        "error_m": row["displacement_estimate_m"] - of_status.get("limited_setpoint_m", nan),
    }
