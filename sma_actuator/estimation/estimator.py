"""From the wire's signals to its displacement: branch, strain model and its effects, quality.

The chain is the same for one sample in the node and for a whole log in replay, kernel by kernel,
so both give the same numbers.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from math import inf, isfinite, nan
from typing import TYPE_CHECKING

import numpy as np

from sma_actuator.base.jit import jit
from sma_actuator.base.signals import Branch, Estimate, Quality, Signals

from .branch import BranchDetector
from .effects import EffectChain, Place

if TYPE_CHECKING:
    from sma_actuator.config import Config

#: Share of the calibrated stress range by which a stress may lie outside it.  Beyond that the model sees the
#: stress at the margin: polynomials in stress go astray quickly outside the data they were fitted on.
STRESS_MARGIN = 0.05
#: The event that says in a log: here the estimator began anew.
ESTIMATOR_RESET = "estimator reset"


@dataclass(frozen=True, slots=True)
class EstimateTrace:
    """Estimates of n samples: the fields of :class:`Estimate`, each an array of shape (n,)."""

    time_s: np.ndarray
    displacement_m: np.ndarray
    strain: np.ndarray
    velocity_m_s: np.ndarray
    branch: np.ndarray
    quality: np.ndarray


@jit
def _velocity(time, displacement, state, time_constant):
    """Difference quotient through a first-order low-pass; ``state`` = [time, δ, velocity]."""
    step = time - state[0]
    if step > 0.0:
        state[2] += (displacement - state[1] - state[2] * step) / (time_constant + step)
    if step != 0.0:  # also where the clock was set back: else the velocity would stand until it has caught up
        state[0], state[1] = time, displacement
    return state[2]


@jit
def _velocity_all(time, displacement, state, time_constant, velocity):
    for i in range(len(time)):
        velocity[i] = _velocity(time[i], displacement[i], state, time_constant)


@jit
def _quality(displacement, stress, bounds):
    """``bounds`` = [σ_lo, σ_hi, δ_lo, δ_hi]."""
    if not bounds[0] <= stress <= bounds[1]:
        return 3
    if not displacement <= bounds[3]:
        return 1
    if not displacement >= bounds[2]:
        return 2
    return 0


@jit
def _quality_all(displacement, stress, bounds, quality):
    for i in range(len(displacement)):
        quality[i] = _quality(displacement[i], stress[i], bounds)


class Estimator:
    """Estimates the displacement of one wire; remembers its past.

    A reading that is not finite, or whose resistance no wire of this circuit can have
    (``safety.resistance_min``, ``resistance_max``), leaves the memory untouched: the last good
    displacement comes back, marked INVALID.  The first good sample starts the model on its cooling
    curve, which is where a wire at rest is.

    Beyond the working range, where R moves with temperature and δ hardly at all, the model goes on
    and the quality says so (INDETERMINATE_COLD, INDETERMINATE_HOT): an estimate that stood still
    there would not see the wire come back.

    ``effects``: those of the wire and the mechanism (those of ``config`` where none are given); the signals
    come with circuit and load cell corrected (:meth:`EffectChain.measure`).
    """

    def __init__(self, config: Config, effects: EffectChain | None = None):
        self._model = config.model.build(config.wire)
        self._effects = effects or EffectChain(config.effects.active, Place.of(config))
        self._branch = BranchDetector(config.estimator)
        self._length_m = config.wire.length
        stress_lo, stress_hi = self._model.stress_range_Pa
        margin_Pa = STRESS_MARGIN * (stress_hi - stress_lo)
        self._stress_Pa = stress_lo - margin_Pa, stress_hi + margin_Pa
        self._bounds = np.array([*self._stress_Pa, *self._model.displacement_range_m])
        self._resistances_Ohm = config.safety.resistance_min, config.safety.resistance_max
        self._velocity_state = np.zeros(3)
        self._velocity_time_constant_s = config.estimator.velocity_time_constant
        self.reset()

    @property
    def displacement_range_m(self) -> tuple[float, float]:
        """The model's working range [m]."""
        return self._model.displacement_range_m

    def reset(self) -> None:
        """Forget the past."""
        self._started = False
        self._effects.reset()
        self._last = Estimate(-inf, nan, nan, 0.0, Branch.COOLING, Quality.INVALID)

    def update(self, config: Config) -> None:
        """Take over live parameters; the memory stays."""
        self._branch.configure(config.estimator)
        self._velocity_time_constant_s = config.estimator.velocity_time_constant

    def step(self, signals: Signals) -> Estimate:
        """Estimate from one sample."""
        resistance_Ohm, stress_Pa, power_W = signals.resistance_Ohm, signals.stress_Pa, signals.power_W
        lowest_Ohm, highest_Ohm = self._resistances_Ohm
        if not (lowest_Ohm <= resistance_Ohm <= highest_Ohm and isfinite(signals.time_s + stress_Pa + power_W)):
            last = self._last
            self._last = Estimate(signals.time_s, last.displacement_m, last.strain, 0.0, last.branch, Quality.INVALID)
            return self._last
        effects = self._effects
        if effects.changes_strain:
            frame = effects.run("at_resistance", effects.frame(signals))
            resistance_Ohm = float(frame.resistance_Ohm[0])
        started = self._started
        if not started:
            self._start(signals.time_s, resistance_Ohm, stress_Pa, power_W)
        heating = self._branch.step(signals.time_s, resistance_Ohm, power_W)
        displacement_m = self._model.step(resistance_Ohm, self._in_reach(stress_Pa), heating)
        if effects.changes_strain:
            frame.heating, frame.displacement_m = np.array([heating]), np.array([displacement_m])
            displacement_m = float(effects.run("at_displacement", frame).displacement_m[0])
        if not started:
            self._velocity_state[:] = signals.time_s, displacement_m, 0.0
        velocity_m_s = _velocity(signals.time_s, displacement_m, self._velocity_state, self._velocity_time_constant_s)
        self._last = Estimate(
            signals.time_s,
            displacement_m,
            displacement_m / self._length_m,
            velocity_m_s,
            Branch(heating),
            Quality(_quality(displacement_m, stress_Pa, self._bounds)),
        )
        return self._last

    def run(self, signals: Signals) -> EstimateTrace:
        """Estimate from n samples: every field of ``signals`` is an array of shape (n,).

        The memory is carried on, so a log may come in pieces.
        """
        lowest_Ohm, highest_Ohm = self._resistances_Ohm
        good = (signals.resistance_Ohm >= lowest_Ohm) & (signals.resistance_Ohm <= highest_Ohm)
        good &= np.isfinite(signals.time_s + signals.stress_Pa + signals.power_W)
        n = len(good)
        displacement_m, velocity_m_s = np.full(n, self._last.displacement_m), np.zeros(n)
        branch, quality = np.full(n, int(self._last.branch)), np.full(n, int(Quality.INVALID))
        if good.any():
            time_s, resistance_Ohm = signals.time_s[good], np.ascontiguousarray(signals.resistance_Ohm[good])
            stress_Pa = np.ascontiguousarray(signals.stress_Pa[good])
            power_W = np.ascontiguousarray(signals.power_W[good])
            effects = self._effects
            if effects.changes_strain:
                frame = effects.run("at_resistance", effects.frame(_some(signals, good)))
                resistance_Ohm = np.ascontiguousarray(frame.resistance_Ohm)
            started = self._started
            if not started:
                self._start(time_s[0], resistance_Ohm[0], stress_Pa[0], power_W[0])
            heating = self._branch.run(time_s, resistance_Ohm, power_W)
            delta = self._model.run(resistance_Ohm, np.clip(stress_Pa, *self._stress_Pa), heating)
            if effects.changes_strain:
                frame.heating, frame.displacement_m = heating, delta
                delta = np.ascontiguousarray(effects.run("at_displacement", frame).displacement_m)
            if not started:
                self._velocity_state[:] = time_s[0], delta[0], 0.0
            velocity, quality_of_good = np.empty(len(delta)), np.empty(len(delta), dtype=np.int64)
            _velocity_all(time_s, delta, self._velocity_state, self._velocity_time_constant_s, velocity)
            _quality_all(delta, stress_Pa, self._bounds, quality_of_good)
            velocity_m_s[good], quality[good] = velocity, quality_of_good
            latest = np.cumsum(good) - 1  # index of the last good sample at each place; −1 before the first
            known = latest >= 0
            displacement_m[known], branch[known] = delta[latest[known]], heating[latest[known]]
        if n:
            self._last = Estimate(
                float(signals.time_s[-1]),
                float(displacement_m[-1]),
                float(displacement_m[-1] / self._length_m),
                float(velocity_m_s[-1]),
                Branch(int(branch[-1])),
                Quality(int(quality[-1])),
            )
        return EstimateTrace(
            signals.time_s, displacement_m, displacement_m / self._length_m, velocity_m_s, branch, quality
        )

    def _in_reach(self, stress_Pa: float) -> float:
        """The stress, or the margin of the calibrated range where it lies beyond."""
        return min(max(stress_Pa, self._stress_Pa[0]), self._stress_Pa[1])

    def _start(self, time_s: float, resistance_Ohm: float, stress_Pa: float, power_W: float) -> None:
        self._model.reset(resistance_Ohm, self._in_reach(stress_Pa))
        self._branch.reset(time_s, resistance_Ohm, power_W)
        self._started = True


def _some(signals: Signals, chosen: np.ndarray) -> Signals:
    """Some of n samples; a field that is one number for all stays it."""
    fields = {f.name: getattr(signals, f.name) for f in dataclasses.fields(signals)}
    return Signals(**{name: v[chosen] if np.ndim(v) else np.full(int(chosen.sum()), v) for name, v in fields.items()})
