"""Synthetic runs of a known wire, with the sensor's noise, and the measured ones where they lie beside the project."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sma_actuator.forward.kernel import POSITION, simulate
from sma_actuator.forward.runs import Run
from sma_actuator.forward.wire import ForwardWire, read_wire

ROOT = Path(__file__).resolve().parents[2]
MAKERS = ROOT / "config" / "flexinol_050_forward.yaml"
MEASURED = ROOT.parent / "shared" / "data" / "flexinol_050_bench"
_STEP_S = 0.02

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


def synthetic(effects: dict[str, float], noise_m: float = 2e-5) -> list[Run]:
    """A ramp, two steps with cooling and a staircase, of the true wire with ``effects``."""
    wire = makers().with_values(TRUTH | {f"effects.{name}": value for name, value in effects.items()})
    t = np.arange(0.0, 60.0, _STEP_S)
    duties = {
        "ramp": np.clip(0.01 * (t - 5.0), 0.0, 0.2) * (t < 35.0),
        "step": 0.2 * ((t > 5.0) & (t < 25.0)),
        "low": 0.15 * ((t > 5.0) & (t < 30.0)),
        "stairs": 0.12 * (t > 4.0) + 0.06 * (t > 16.0) - 0.1 * (t > 28.0) + 0.08 * (t > 42.0),
    }
    rng = np.random.default_rng(7)
    runs = []
    for name, duty in duties.items():
        position_m = np.concatenate([[0.0], simulate(wire, duty, _STEP_S)[:-1, POSITION]]) + noise_m * rng.standard_normal(len(t))
        runs.append(Run(name, t, duty, position_m + 0.001))
    return runs
