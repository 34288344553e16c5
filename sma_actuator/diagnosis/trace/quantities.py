"""What a residual may depend on."""

from __future__ import annotations

import numpy as np

from sma_actuator.estimation.lag import lagged

from .evidence import Comparison
from .prediction import smooth

POWER_LAGS_s = (1.0, 10.0, 100.0)


def quantities(comparison: Comparison) -> dict[str, np.ndarray]:
    """What a residual may depend on, all logs together, of the samples compared, with the unit in the name."""
    evidence = comparison.evidence
    out: dict[str, list[np.ndarray]] = {}
    for experiment, unit, rows, p in zip(
        evidence.logs.experiments, evidence.unit, evidence.logs.compared, comparison.predictions, strict=True
    ):
        s = experiment.signals
        period_s = float(np.median(np.diff(s.time_s)))
        power_W, resistance_Ohm = p.power_W, p.resistance_Ohm
        slope = np.gradient(smooth(resistance_Ohm, period_s), s.time_s)
        reversal = np.flatnonzero(np.diff(p.heating.astype(int))) + 1
        last = np.concatenate(([0], reversal))[np.searchsorted(reversal, np.arange(len(p.heating)), side="right")]
        values = {
            "time_s": s.time_s - evidence.logs.start_s,
            "resistance_Ohm": resistance_Ohm,
            "displacement_m": p.model_m,
            "stress_Pa": p.stress_Pa,
            "branch": p.heating.astype(float),
            "distance_from_reversal_m": np.abs(p.model_m - p.model_m[last]),
            "power_W": power_W,
            **{f"power_lagged_{lag:g}_s_W": lagged(s.time_s, power_W, lag) for lag in POWER_LAGS_s},
            "cycle": unit.astype(float),
            # Of the current that flows: a model answers the noise of its readings too, which is no error of a sensor.
            "inverse_current_1_A": 1.0 / np.maximum(smooth(s.current_A, period_s), 1e-6),
            "resistance_rate_Ohm_s": slope,
            "ambient_temperature_C": np.broadcast_to(s.ambient_temperature_C, np.shape(power_W)),
        }
        for name, v in values.items():
            out.setdefault(name, []).append(np.asarray(v, dtype=float)[rows])
    together = {name: np.concatenate(parts) for name, parts in out.items()}
    return {name: v for name, v in together.items() if np.isfinite(v).all() and np.ptp(v) > 0.0}
