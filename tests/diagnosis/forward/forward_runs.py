"""Synthetic runs of a known wire, with the sensor's noise, and the measured ones where they lie beside the project."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sma_actuator.diagnosis.forward.kernel import POSITION, simulate
from sma_actuator.diagnosis.forward.runs import Run
from sma_actuator.diagnosis.forward.wire import ForwardWire, read_wire

ROOT = Path(__file__).resolve().parents[3]
MAKERS = ROOT / "config" / "flexinol_050_forward.yaml"
MEASURED = ROOT.parent / "shared" / "data" / "flexinol_050_bench"
_STEP_s = 0.02
STROKE_M = 0.016

#: The wire that is simulated: not the one the fit starts from.
TRUTH = {
    "wire.austenite_start_C": 70.0,
    "wire.austenite_finish_C": 92.0,
    "wire.martensite_start_C": 62.0,
    "wire.martensite_finish_C": 42.0,
    "wire.specific_heat_J_kgK": 700.0,
    "wire.latent_heat_J_kg": 15e3,
    "wire.transformation_strain": 0.018,
    "surroundings.heat_transfer_W_m2K": 110.0,
}


def makers() -> ForwardWire:
    """What the fit starts from."""
    return read_wire(MAKERS)


def synthetic(
    effects: dict[str, float],
    noise_m: float = 2e-5,
    drift_m: float = 0.0,
    ambient_K: float = 0.0,
    bend: float = 0.0,
    seed: int = 7,
) -> list[Run]:
    """A ramp, two steps with cooling and a staircase, of the true wire with ``effects``.

    What no candidate can express: ``drift_m``, a slow drift of the slider (10 s); ``ambient_K``, the
    air's temperature from run to run; ``bend``, a sensor that is not linear, in shares of the stroke.
    """
    t = np.arange(0.0, 60.0, _STEP_s)
    duties = {
        "ramp": np.clip(0.01 * (t - 5.0), 0.0, 0.2) * (t < 35.0),
        "step": 0.2 * ((t > 5.0) & (t < 25.0)),
        "low": 0.15 * ((t > 5.0) & (t < 30.0)),
        "stairs": 0.12 * (t > 4.0) + 0.06 * (t > 16.0) - 0.1 * (t > 28.0) + 0.08 * (t > 42.0),
    }
    rng = np.random.default_rng(seed)
    keeps = np.exp(-_STEP_s / 10.0)
    runs = []
    for name, duty in duties.items():
        values = TRUTH | {f"effects.{key}": value for key, value in effects.items()}
        wire = makers().with_values(values | {"surroundings.ambient_C": 24.0 + ambient_K * rng.standard_normal()})
        position_m = np.concatenate([[0.0], simulate(wire, duty, _STEP_s)[:-1, POSITION]])
        position_m += bend * STROKE_M * np.sin(2.0 * np.pi * position_m / STROKE_M)
        if drift_m:
            from scipy.signal import lfilter

            steps = np.sqrt(1.0 - keeps**2) * rng.standard_normal(len(t))
            position_m += drift_m * lfilter([1.0], [1.0, -keeps], steps)
        runs.append(Run(name, t, duty, position_m + noise_m * rng.standard_normal(len(t)) + 0.001))
    return runs
