"""The scales of some logs: how large everything is that an effect is measured by, and what they could show at all."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from sma_actuator.base.signals import Signals
from sma_actuator.config import Config
from sma_actuator.estimation.effects.free import Scales

from .evidence import Evidence
from .witnesses.spring import LOADS_DIFFER

#: Percentiles that count as the least, as what is large and often comes, and as the largest: a few readings beyond that
#: say nothing.
LEAST, OFTEN, MOST = 5.0, 98.0, 99.0
FEELS_STRESS = 1e-3  #: of full stroke: what a load that is so much less must move the model by …
LIGHTER = 1.1  #: … times
PARTIAL = 0.85  #: of the largest cycle's stroke, below which a cycle is partial …
PARTIAL_SHARE = 0.05  #: … and the share of such cycles from which the logs count as having them


def scales_of(evidence: Evidence) -> Scales:
    """The scales of some logs."""
    config, signals = evidence.config, [t.signals for t in evidence.logs.experiments]

    def together(name: str) -> np.ndarray:
        return np.concatenate([np.broadcast_to(getattr(s, name), np.shape(s.time_s)) for s in signals])

    power_W, load_N = together("power_W"), together("load_N")
    current_A, resistance_Ohm = together("current_A"), together("resistance_Ohm")
    ambient_C = together("ambient_temperature_C")
    ambient_C = ambient_C[np.isfinite(ambient_C)]
    calibrated_C = config.calibration.ambient_temperature
    known = math.isfinite(calibrated_C)
    high_W = float(np.percentile(power_W, OFTEN))
    middle_N = float(np.median(np.abs(load_N)))
    return Scales(
        stroke_m=evidence.full_stroke_m,
        resistance_Ohm=float(np.median(resistance_Ohm)),
        resistance_range_Ohm=_spread(resistance_Ohm),
        current_A=float(np.percentile(current_A, OFTEN)),
        voltage_V=float(np.percentile(current_A * resistance_Ohm, OFTEN)),
        load_N=middle_N,
        most_load_N=float(np.percentile(np.abs(load_N), MOST)),
        power_W=high_W,
        rise_K=high_W / config.thermal.heat_loss,
        duration_s=evidence.logs.duration_s,
        period_s=float(np.median([np.median(np.diff(s.time_s)) for s in signals])),
        cycles=evidence.units,
        cycle_power_W=0.5 * (float(np.percentile(power_W, LEAST)) + high_W),
        thermal_s=config.thermal.heat_capacity / config.thermal.heat_loss,
        heat_loss_W_K=config.thermal.heat_loss,
        latent_heat_J=_latent_heat_J(config),
        sense_Ohm=config.circuit.reference_resistance,
        reference_zero_m=config.reference_sensor.offset if config.reference_sensor.fitted else 0.0,
        ambient_logged=bool(len(ambient_C)),
        ambient_change_K=_ambient_change_K(ambient_C, calibrated_C),
        calibration_ambient_known=known,
        calibration_ambient_C=calibrated_C if known else config.thermal.ambient_temperature,
        loads_differ=_spread(load_N) > LOADS_DIFFER * middle_N,
        partial_cycles=_partial_cycles(evidence),
        model_feels_stress=_model_feels_stress(evidence),
        power_known=evidence.of_power.known,
        calibration_counts=evidence.beyond_floor,
    )


def _latent_heat_J(config: Config) -> float:
    rise_K = config.calibration.power.latent_rise
    return max(rise_K, 0.0) * config.thermal.heat_capacity if math.isfinite(rise_K) else 0.0


def _spread(values: np.ndarray) -> float:
    return float(np.subtract(*np.percentile(values, (MOST, 100.0 - MOST))))


def _ambient_change_K(known_C: np.ndarray, calibrated_C: float) -> float:
    if not len(known_C):
        return 0.0
    since_K = abs(float(np.median(known_C)) - calibrated_C) if math.isfinite(calibrated_C) else 0.0
    return max(_spread(known_C), since_K)


def _model_feels_stress(evidence: Evidence) -> bool:
    """Whether a load that is shown wrong would show."""

    def lighter(s: Signals) -> Signals:
        return replace(s, load_N=s.load_N / LIGHTER, stress_Pa=s.stress_Pa / LIGHTER)

    logs, chain = evidence.logs, evidence.chain({})
    as_it_is = [p.shown_m for p in logs.followed_by(chain)]
    if_lighter = [p.shown_m for p in logs.followed_by(chain, lighter)]
    moved_m = [np.mean(np.abs(a - b)[kept]) for a, b, (_, kept) in zip(as_it_is, if_lighter, logs.seen, strict=True)]
    return bool(max(moved_m) > FEELS_STRESS * evidence.full_stroke_m)


def _partial_cycles(evidence: Evidence) -> bool:
    """Whether there are cycles that turn back early."""
    spans_m: list[float] = []
    for measured_m, unit in zip(evidence.logs.measured_m, evidence.unit, strict=True):
        spans_m += [float(np.ptp(measured_m[unit == u])) for u in np.unique(unit)]
    return bool(np.mean(np.array(spans_m) < PARTIAL * np.max(spans_m)) > PARTIAL_SHARE)
