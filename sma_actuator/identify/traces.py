"""Bench logs as a fit sees them: resistance, stress, branch and measured displacement, cut into cycles."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sma_actuator.base.signals import Signals
from sma_actuator.estimation.branch import BranchDetector
from sma_actuator.estimation.chain import EstimateTrace
from sma_actuator.logs.bench_log import BenchLog, require_reference, signals_from_log
from sma_actuator.logs.errors import BenchLogError

NOT_FITTED = ("lead_resistance", "load_cell", "lvdt", "training")
_WIRE_KEYS = {"length_m": "length", "diameter_m": "diameter"}


class IdentificationError(BenchLogError):
    """The logs cannot determine what was asked.  The message names what is missing."""


@dataclass(frozen=True, slots=True)
class Trace:
    """One log, arrays of shape (n,)."""

    log: BenchLog
    kind: str  #: pulses, partial, fatigue, or "" where the log does not say
    signals: Signals
    heating: np.ndarray  #: bool, the branch the estimator would take
    driven: np.ndarray  #: bool, the current is above the middle of its range (appendix C, step 1)
    cycle: np.ndarray  #: int, number of the cycle; one begins when the current is switched on

    @property
    def name(self) -> str:
        """Name of the log."""
        return self.log.name

    @property
    def resistance_Ohm(self) -> np.ndarray:
        """Resistance of the wire."""
        return self.signals.resistance_Ohm

    @property
    def stress_Pa(self) -> np.ndarray:
        """Stress in the wire."""
        return self.signals.stress_Pa

    @property
    def displacement_m(self) -> np.ndarray:
        """Measured displacement."""
        return self.signals.reference_displacement_m

    @property
    def mean_stress_Pa(self) -> float:
        """Mean stress."""
        return float(np.nanmean(self.stress_Pa))

    @property
    def constant_load(self) -> bool:
        """Whether the load is a weight: spread within a twentieth of its mean (or noise)."""
        spread_N = float(np.subtract(*np.nanpercentile(self.signals.load_N, (97.5, 2.5))))
        return spread_N <= max(0.05 * abs(float(np.nanmean(self.signals.load_N))), 0.02)

    def rows(self, chosen: np.ndarray) -> Trace:
        """The trace with some of its samples only (bool, shape (n,))."""
        fields = {f.name: getattr(self.signals, f.name) for f in dataclasses.fields(self.signals)}
        signals = Signals(**{name: v[chosen] if np.ndim(v) else v for name, v in fields.items()})
        log = dataclasses.replace(self.log, columns={k: v[chosen] for k, v in self.log.columns.items()})
        return Trace(log, self.kind, signals, self.heating[chosen], self.driven[chosen], self.cycle[chosen])

    def through(self, estimate: EstimateTrace) -> Trace:
        """The trace with the signals and the branch that a model's chain made of it."""
        return dataclasses.replace(self, signals=estimate.signals, heating=estimate.branch.astype(bool))


def make_trace(log: BenchLog, config) -> Trace:
    """Apply the calibrations of ``config`` (Config or bench sections) to a log.

    Raises BenchLogError: no reference, a saturated channel, or a log of another wire.
    """
    require_reference(log)
    _same_wire(log, config)
    _not_saturated(log, config)
    signals = signals_from_log(log, config)
    good = np.isfinite(signals.resistance_Ohm + signals.stress_Pa + signals.power_W)
    if not good.any():
        largest_A = float(np.nan_to_num(signals.current_A, nan=0.0).max())
        raise BenchLogError(
            f"{log.source}: line 2: no reading has a resistance and a load: the current never exceeds {largest_A:.3g} A, where "
            f"half of supply.bias_current ({config.supply.bias_current:g} A) is the least to measure resistance with, or the "
            "load is missing; was the wire never driven, or is circuit.reference_resistance of another circuit?"
        )
    resistance_Ohm = np.median(signals.resistance_Ohm[good])
    safety = config.safety
    if not safety.resistance_min <= resistance_Ohm <= safety.resistance_max:
        raise BenchLogError(
            f"{log.source}: line 2: the wire's resistance is about {resistance_Ohm:.3g} Ω, outside "
            "safety.resistance_min and "
            f"resistance_max ({safety.resistance_min:g} to {safety.resistance_max:g} Ω); is it the log of another "
            "wire, or "
            "circuit.reference_resistance of another circuit?"
        )
    stress_Pa = np.median(signals.stress_Pa[good])
    if not stress_Pa <= 1.5 * config.wire.max_stress:
        raise BenchLogError(
            f"{log.source}: line 2: the stress is about {stress_Pa / 1e6:.0f} MPa, beyond wire.max_stress "
            f"({config.wire.max_stress / 1e6:.0f} MPa); check wire.diameter and the load's unit"
        )
    detector = BranchDetector(config.estimator)
    seen = [np.ascontiguousarray(v[good]) for v in (signals.time_s, signals.resistance_Ohm, signals.power_W)]
    detector.reset(*(float(v[0]) for v in seen))
    latest = np.maximum(np.cumsum(good) - 1, 0)  # a reading that is missing stays on the branch of the one before
    heating = detector.run(*seen)[latest]
    middle_A = 0.5 * (np.nanmin(signals.current_A) + np.nanmax(signals.current_A))
    driven = signals.current_A > middle_A
    switched_on = np.flatnonzero(driven & ~np.roll(driven, 1))
    cycle = np.searchsorted(switched_on[switched_on > 0], np.arange(len(driven)), side="right")
    return Trace(log, str(log.metadata.get("kind", "")), signals, heating, driven, cycle)


def make_traces(logs: Sequence[BenchLog], config) -> list[Trace]:
    """Traces of the logs that a model is fitted on; calibration and training logs are left out.

    Raises IdentificationError where none is left.
    """
    traces = [make_trace(log, config) for log in logs if log.metadata.get("kind") not in NOT_FITTED]
    if not traces:
        raise IdentificationError(
            "no log to fit: pulses or partial cycles of a wire with a measured displacement are needed"
        )
    return traces


def _same_wire(log: BenchLog, config) -> None:
    said = log.metadata.get("wire", {})
    for key, name in _WIRE_KEYS.items():
        ours = getattr(config.wire, name)
        if key in said and abs(said[key] - ours) > 1e-3 * ours:
            raise BenchLogError(
                f"{log.source}: is a log of another wire: its {name} is {said[key] * 1e3:g} mm and wire.{name} is "
                f"{ours * 1e3:g} mm"
            )
    if "alloy" in said and said["alloy"] != config.wire.alloy:
        raise BenchLogError(
            f"{log.source}: is a log of another wire: its alloy is {said['alloy']} and wire.alloy is "
            f"{config.wire.alloy}"
        )


def _not_saturated(log: BenchLog, config) -> None:
    limit_V = config.safety.channel_max_voltage
    channels = {"supply_voltage_V": 1.0, "reference_voltage_V": 1.0, "load_cell_voltage_V": 1.0}
    channels["lvdt_current_A"] = config.instruments.daq.lvdt_shunt_resistance
    for name, factor in channels.items():
        if name not in log:
            continue
        at_limit = np.abs(log[name]) * factor >= 0.999 * limit_V
        if at_limit.any():
            line = int(np.argmax(at_limit)) + 2
            raise BenchLogError(
                f"{log.source}: line {line}, column {name}: the channel is saturated at {limit_V:g} V "
                "(safety.channel_max_voltage); measure again with a larger range"
            )
