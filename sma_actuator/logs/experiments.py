"""Bench logs as a fit sees them: resistance, stress, branch and measured displacement, cut into cycles."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sma_actuator.base.signals import Signals
from sma_actuator.estimation.branch import BranchDetector
from sma_actuator.estimation.chain import Estimates

from .bench_log import BenchLog, longest_pause_s, require_reference, signals_from_log
from .cycles import cycle_numbers, is_driven
from .errors import BenchLogError
from .sense import MOST_STROKE, counts_pull_as_negative

NOT_FITTED = ("lead_resistance", "load_cell", "lvdt", "training")
_WIRE_KEYS = {"length_m": "length", "diameter_m": "diameter"}


class IdentificationError(BenchLogError):
    """The logs cannot determine what was asked.  The message names what is missing."""


@dataclass(frozen=True, slots=True)
class Experiment:
    """One log, arrays of shape (n,)."""

    log: BenchLog
    kind: str  #: pulses, partial, fatigue, or "" where the log does not say
    signals: Signals
    heating: np.ndarray  #: bool, the branch the estimator would take
    driven: np.ndarray  #: bool, the current is above the middle of its range (appendix C, step 1)
    cycle: np.ndarray  #: int, number of the cycle; one begins when the current is switched on
    part_of: str = ""  #: name of the log, or of its session, that this is a stretch of

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

    @property
    def judged(self) -> np.ndarray:
        """Bool, the samples that say something of the wire: it is driven, and nothing is missing."""
        return np.isfinite(self.resistance_Ohm + self.stress_Pa + self.signals.power_W + self.displacement_m)

    def rows(self, chosen: np.ndarray) -> Experiment:
        """The experiment with some of its samples only (bool, shape (n,))."""
        fields = {f.name: getattr(self.signals, f.name) for f in dataclasses.fields(self.signals)}
        signals = Signals(**{name: v[chosen] if np.ndim(v) else v for name, v in fields.items()})
        log = dataclasses.replace(self.log, columns={k: v[chosen] for k, v in self.log.columns.items()})
        return dataclasses.replace(
            self,
            log=log,
            signals=signals,
            heating=self.heating[chosen],
            driven=self.driven[chosen],
            cycle=self.cycle[chosen],
        )

    def through(self, estimate: Estimates) -> Experiment:
        """The experiment with the signals and the branch that a model's chain made of it."""
        return dataclasses.replace(self, signals=estimate.signals, heating=estimate.branch.astype(bool))


def begins_anew(experiments: Sequence[Experiment]) -> list[bool]:
    """Of each whether it begins anew; else it is the stretch of a log after the one before it, and the wire has that
    past."""
    return [
        before is None
        or not t.part_of
        or t.part_of != before.part_of
        or bool(t.signals.time_s[0] <= before.signals.time_s[-1])
        for before, t in zip((None, *experiments), experiments, strict=False)
    ]


def make_experiment(log: BenchLog, config, with_reference: bool = True) -> Experiment:
    """Apply the calibrations of ``config`` (Config or bench sections) to a log.

    Raises BenchLogError: no reference (where one is wanted), a saturated channel, or a log of another wire.
    """
    if with_reference:
        require_reference(log, config)
    _same_wire(log, config)
    log = _as_the_node_read_it(log, config)
    _not_saturated(log, config)
    signals = signals_from_log(log, config)
    good = np.isfinite(signals.resistance_Ohm + signals.stress_Pa + signals.power_W)
    _of_this_wire(log, signals, good, config)
    detector = BranchDetector(config.estimator)
    seen = [np.ascontiguousarray(v[good]) for v in (signals.time_s, signals.resistance_Ohm, signals.power_W)]
    time_s, resistance_Ohm, power_W = (float(v[0]) for v in seen)
    detector.reset(time_s, resistance_Ohm, power_W)
    latest = np.maximum(np.cumsum(good) - 1, 0)  # a reading that is missing stays on the branch of the one before
    heating = detector.run(*seen)[latest]
    driven = is_driven(signals.current_A)
    return Experiment(log, str(log.metadata.get("kind", "")), signals, heating, driven, cycle_numbers(driven))


def sessions(experiment: Experiment) -> list[Experiment]:
    """An experiment cut where its log pauses.

    Pieces without a cycle are left out where others have one.
    """
    starts = np.flatnonzero(np.diff(experiment.signals.time_s) > longest_pause_s(experiment.log)) + 1
    number = np.searchsorted(starts, np.arange(len(experiment.log)), side="right")
    pieces = [experiment.rows(number == k) for k in range(len(starts) + 1)]
    pieces = [dataclasses.replace(piece, cycle=cycle_numbers(piece.driven)) for piece in pieces]
    cycled = [piece for piece in pieces if piece.cycle[-1] > 0] or pieces[:1]
    if len(cycled) < 2:
        return cycled
    return [
        dataclasses.replace(
            piece, log=dataclasses.replace(piece.log, source=f"{piece.log.source} ({k} of {len(cycled)})")
        )
        for k, piece in enumerate(cycled, 1)
    ]


def judged_rows(experiment: Experiment) -> Experiment:
    """An experiment without the samples that say nothing of the wire: undriven, or with something missing."""
    return experiment if experiment.judged.all() else experiment.rows(experiment.judged)


def _same_wire(log: BenchLog, config) -> None:
    said = log.metadata.get("wire", {})
    for key, name in _WIRE_KEYS.items():
        ours = getattr(config.wire, name)
        if key in said and abs(said[key] - ours) > 1e-3 * ours:
            raise BenchLogError(
                f"{log.source}: is a log of another wire: its {name} is {said[key] * 1e3:g} mm and wire.{name} is "
                f"{ours * 1e3:g} mm"
            )
    if said and said.get("form", "") != config.wire.form_text:
        raise BenchLogError(
            f"{log.source}: is a log of another wire: it is a {said.get('form', 'straight wire')} and wire.form says "
            f"{config.wire.form_text or 'wire'}"
        )
    if "alloy" in said and said["alloy"] != config.wire.alloy:
        raise BenchLogError(
            f"{log.source}: is a log of another wire: its alloy is {said['alloy']} and wire.alloy is "
            f"{config.wire.alloy}"
        )


def _of_this_wire(log: BenchLog, signals: Signals, good: np.ndarray, config) -> None:
    """Raises BenchLogError where current, resistance, load or displacement are none that this wire could have.

    ``good``: bool, the readings that have a resistance and a load.
    """
    usual_A = float(np.median(np.nan_to_num(signals.current_A, nan=0.0)))
    if usual_A < -0.5 * config.supply.bias_current:
        raise BenchLogError(
            f"{log.source}: line 2: the current is about {usual_A:.3g} A; of one that is measured the other way round "
            "say --unit current_A=-A"
        )
    if not good.any():
        largest_A = float(np.nan_to_num(signals.current_A, nan=0.0).max())
        raise BenchLogError(
            f"{log.source}: line 2: no reading has a resistance and a load: the current never exceeds {largest_A:.3g} "
            f"A, where half of supply.bias_current ({config.supply.bias_current:g} A) is the least to measure "
            "resistance with, or the load is missing; was the wire never driven, or is circuit.reference_resistance "
            "of another circuit?"
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
    if counts_pull_as_negative(signals.stress_Pa[good], config.wire.max_stress):
        raise BenchLogError(
            f"{log.source}: line 2: the load is about {np.median(signals.load_N[good]):.3g} N, and a wire only pulls; "
            "of a load cell that counts pull as negative say --unit load_N=-N, or turn load_cell.slope round"
        )
    if signals.reference_displacement_m is not None and np.ndim(signals.reference_displacement_m):
        moved_m = signals.reference_displacement_m[np.isfinite(signals.reference_displacement_m)]
        stroke_m = float(np.subtract(*np.percentile(moved_m, (99.0, 1.0)))) if len(moved_m) else 0.0
        if stroke_m > MOST_STROKE * (most_m := config.wire.strain_length_m):
            raise BenchLogError(
                f"{log.source}: line 2: the displacement moves by {stroke_m * 1e3:.3g} mm, {stroke_m / most_m:.0%} "
                f"of strain, and no wire does more than {MOST_STROKE:.0%}; check its unit (--unit displacement_m=mm) "
                f"and wire.length"
            )


def _as_the_node_read_it(log: BenchLog, config) -> BenchLog:
    """A node's own recording without the readings that the node did not use: a channel at its limit."""
    limit_V = config.safety.channel_max_voltage
    channels = ("supply_voltage_V", "reference_voltage_V", "load_cell_voltage_V")
    if "output_on" not in log or not all(name in log for name in channels):
        return log
    usable = np.all([np.abs(log[name]) < limit_V for name in channels], axis=0)
    if usable.all():
        return log
    return dataclasses.replace(
        log, columns={**log.columns, **{name: np.where(usable, log[name], np.nan) for name in channels}}
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
