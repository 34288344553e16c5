"""From what is measured of a wire to where it is: one chain, live and judged.

    measured → at resistance → branch and strain model → at displacement → shown

``measured`` takes off what circuit and load cell do, ``at resistance`` and ``at displacement`` add what
the strain model does not know of wire and mechanism; those are the stages at which effects act.
``shown`` is what a reference sensor makes of the displacement: only a log that is judged goes so far.

One sample in the node and a whole log in replay or tracing go through the same code, kernel by kernel,
so both give the same numbers.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import inf, isfinite, isnan, nan
from typing import Any, Protocol, cast

import numpy as np

from sma_actuator.base.jit import Floats, jit
from sma_actuator.base.signals import Branch, Estimate, Quality, Signals

from .branch import BranchDetector, EstimatorParameters, is_heating
from .circuit import CircuitSections
from .effects import Effect, EffectError, Effects, in_order
from .effects.frame import Frame, Place
from .elastic_load import ElasticLoad
from .hot_end import HotEnd, HotEndSections, is_contracted
from .models import COEFFICIENTS, Coefficients, ModelError, StrainModel, ThermalStrainModel

#: The event that says in a log: here the chain forgot where on its loop the wire was.
ESTIMATOR_RESET = "estimator reset"
#: Share of the calibrated stress range by which a stress may lie outside it.  Beyond that the model sees the
#: stress at the margin: polynomials in stress go astray quickly outside the data they were fitted on.
STRESS_MARGIN = 0.05
#: Share of its stroke by which the estimate of a model of the whole range may lie outside it and still be trusted.
STROKE_MARGIN = 0.05

_QUALITIES = tuple(Quality)  # indexing is quicker than calling an enumeration
#: What an effect does at a stage, its memory, and what to call it.
Act = tuple[Callable[[Frame, np.ndarray, Place], None], np.ndarray, str]


class PlausibleResistance(Protocol):
    """Between which resistances a reading is one of a wire."""

    @property
    def resistance_min(self) -> float:
        """Lowest [Ω]."""

    @property
    def resistance_max(self) -> float:
        """Highest [Ω]."""


def stresses_inside_Pa(range_Pa: tuple[float, float]) -> tuple[float, float]:
    """Between which stresses an estimate is inside the calibration of a model with a range of them."""
    low_Pa, high_Pa = range_Pa
    margin_Pa = STRESS_MARGIN * (high_Pa - low_Pa)
    return low_Pa - margin_Pa, high_Pa + margin_Pa


class ChainSections(CircuitSections, HotEndSections, Protocol):
    """The parameters that the chain is built from; a ``Config`` has them."""

    @property
    def estimator(self) -> EstimatorParameters:
        """How heating is told from cooling."""

    @property
    def model(self) -> Coefficients:
        """The strain model."""

    @property
    def effects(self) -> Effects:
        """What tracing has added to it."""

    @property
    def safety(self) -> PlausibleResistance:
        """Which readings count."""


def place_of(config: ChainSections) -> Place:
    """What effects need to know of the configuration."""
    return Place(
        reference_resistance_Ohm=config.circuit.reference_resistance,
        lead_resistance_Ohm=config.circuit.lead_resistance,
        area_m2=config.wire.area_m2,
        length_m=config.wire.strain_length_m,
        heat_loss_W_K=config.thermal.heat_loss,
        ambient_C=config.thermal.ambient_temperature,
        working_range_m=config.model.build(config.wire).displacement_range_m,
        resistance_range_Ohm=config.calibration.resistance_range,
        stroke=config.calibration if config.calibration.transformation_known else None,
    )


@dataclass(frozen=True, slots=True)
class Estimates:
    """Estimates of n samples, the fields of :class:`Estimate`, and how they came about: arrays of shape (n,)."""

    time_s: np.ndarray
    displacement_m: np.ndarray
    strain: np.ndarray
    velocity_m_s: np.ndarray
    branch: np.ndarray
    quality: np.ndarray
    uncertainty_m: np.ndarray  #: half of the 95 % interval; NaN where the model has none
    signals: Signals  #: without the effects of circuit and load cell
    resistance_Ohm: np.ndarray  #: that the strain model saw; of the last good sample where a sample is not
    model_m: np.ndarray  #: displacement of the strain model alone, likewise
    heat_W: np.ndarray  #: what heats the wire, as a heat balance of the calibration sees it


@dataclass(frozen=True, slots=True)
class Judged(Estimates):
    """The same of a log that is held against a reference sensor."""

    elapsed_s: np.ndarray  #: since the session began
    before_s: float  #: how long the sessions before it lasted
    shown_m: np.ndarray  #: displacement that the reference sensor should show, likewise


@jit
def _velocity(time: float, displacement: float, state: np.ndarray, time_constant: float) -> float:
    """Difference quotient through a first-order low-pass; ``state`` = [time, δ, velocity].

    A displacement that is not finite leaves no trace.
    """
    if not isfinite(displacement):
        return 0.0
    if not isfinite(time - state[0] + state[1]):
        state[0], state[1], state[2] = time, displacement, 0.0
    step = time - state[0]
    if step > 0.0:
        state[2] += (displacement - state[1] - state[2] * step) / (time_constant + step)
    if step != 0.0:  # also where the clock was set back: else the velocity would stand until it has caught up
        state[0], state[1] = time, displacement
    return state[2]


@jit
def _velocity_all(
    time: np.ndarray, displacement: np.ndarray, state: np.ndarray, time_constant: float, velocity: np.ndarray
) -> None:
    for i in range(len(time)):
        velocity[i] = _velocity(time[i], displacement[i], state, time_constant)


@jit
def _quality(displacement: float, stress: float, contracted: bool, bounds: np.ndarray) -> int:
    """``bounds`` = [σ_lo, σ_hi, δ_lo, δ_hi]."""
    if not isfinite(displacement):
        return 4
    if not bounds[0] <= stress <= bounds[1]:
        return 3
    if contracted:
        return 2
    if not displacement <= bounds[3]:
        return 1
    if not displacement >= bounds[2]:
        return 2
    return 0


@jit
def _quality_all(
    displacement: np.ndarray, stress: np.ndarray, contracted: np.ndarray, bounds: np.ndarray, quality: np.ndarray
) -> None:
    for i in range(len(displacement)):
        quality[i] = _quality(displacement[i], stress[i], contracted[i], bounds)


@jit
def _seen(
    time: float,
    resistance: float,
    stress: float,
    power: float,
    heat: float,
    ambient: float,
    decision: int,
    branch: np.ndarray,
    numbers: np.ndarray,
    asks_hot_end: bool,
    row: Floats,
    hot_end: np.ndarray,
    line: np.ndarray,
) -> tuple[bool, bool]:
    """What a sample shows before the strain model sees it: whether the wire is heating, and contracted as far as it
    goes.  In one call, as :func:`_told`: what has rested since the last sample is slow to be found again."""
    heating = is_heating(decision, time, resistance, power, branch, numbers)
    return heating, asks_hot_end and is_contracted(row, stress, time, resistance, heat, ambient, hot_end, line)


@jit
def _told(
    time: float,
    displacement: float,
    stress: float,
    contracted: bool,
    state: np.ndarray,
    time_constant: float,
    bounds: np.ndarray,
) -> tuple[float, int]:
    """What goes with a displacement: velocity and quality."""
    return _velocity(time, displacement, state, time_constant), _quality(displacement, stress, contracted, bounds)


class Chain:
    """The chain of one wire; remembers its past.

    A sample that is not finite, or whose resistance no wire of this circuit can have
    (``safety.resistance_min``, ``resistance_max``), goes no further than ``measured``: no later stage
    sees it, the last good displacement comes back, marked INVALID.  The first good sample starts the
    model on its cooling curve, which is where a wire at rest is; as cold as around it, where no current flowed before.

    Beyond the working range, where R moves with temperature and δ hardly at all, the model goes on
    and the quality says so (INDETERMINATE_COLD, INDETERMINATE_HOT): an estimate that stood still
    there would not see the wire come back.  Only where the wire is known to be contracted as far as it
    goes (:class:`HotEnd`) is it where the calibration has it: resistance rises with temperature there.
    A model with a heat balance of its own knows the ends; where it is asked for what its calibration has
    not seen it says so (OUTSIDE_CALIBRATION).

    It has two memories.  That of the *loop*, where the wire stands on it: branch, model, velocity, and
    what effects derive from positions passed; :meth:`reset` forgets it, which a tare asks for too, since
    the stress was wrong with which it was found.  And that of the *session*: its clock, and what has crept,
    slipped, warmed up and been counted since; it is the wire's and not the estimate's, and only
    :meth:`begin_session` forgets it.

    ``effects``: by name; those of ``config`` where none are given.
    """

    def __init__(self, config: ChainSections, effects: Mapping[str, Effect] | None = None):
        self._built = config.model.build(config.wire)
        self._model_type = COEFFICIENTS.name_of(type(config.model))
        # A model with a heat balance wants the power too, and says how sure it is; the others are asked as ever.
        thermal = isinstance(self._built, ThermalStrainModel)
        self._thermal = cast(ThermalStrainModel, self._built) if thermal else None
        self._model = cast(StrainModel, self._built)
        self._branch = BranchDetector(config.estimator)
        self._hot_end = HotEnd(config)
        self._asks_hot_end = self._hot_end.known and self._thermal is None
        self._length_m = config.wire.strain_length_m
        self._stress_Pa = stresses_inside_Pa(self._model.stress_range_Pa)
        low_m, high_m = self._model.displacement_range_m if self._thermal is None else self._thermal.stroke_m
        # A model of the whole range has been at both ends; its estimates scatter about them.
        slack_m = 0.0 if self._thermal is None else STROKE_MARGIN * (high_m - low_m)
        self._bounds = np.array([*self._stress_Pa, low_m - slack_m, high_m + slack_m])
        asked = thermal and config.estimator.elastic_load
        self._elastic_load = ElasticLoad(config.wire.full_stroke_m) if asked else None
        self._resistances_Ohm = config.safety.resistance_min, config.safety.resistance_max
        self._velocity_state = np.full(3, nan)
        self._effects = [
            (name, effect, np.empty(effect.STATES))
            for name, effect in in_order(config.effects.active if effects is None else effects).items()
        ]
        self._measured = self._at("measured")
        self._at_resistance = self._at("at_resistance")
        self._at_displacement = self._at("at_displacement")
        self._shown = self._at("shown")
        self.update(config)
        self.begin_session()

    def _at(self, stage: str) -> tuple[Act, ...]:
        return tuple(
            (getattr(effect, stage), state, f"effect '{name}', {stage}")
            for name, effect, state in self._effects
            if hasattr(effect, stage)
        )

    @property
    def effects(self) -> tuple[Effect, ...]:
        """The effects that act in it, in their order."""
        return tuple(effect for _, effect, _ in self._effects)

    @property
    def displacement_range_m(self) -> tuple[float, float]:
        """The model's working range [m]."""
        return self._model.displacement_range_m

    @property
    def longer_m(self) -> float:
        """How much longer the wire of the last sample is than its transformation makes it, since another load was on it
        [m]; 0 where the model does not follow that."""
        return self._thermal.longer_m if self._thermal is not None else 0.0

    @property
    def loses(self) -> float:
        """Heat that the wire loses, over what it lost in the calibration; NaN where the model does not follow that."""
        return getattr(self._thermal, "loses", nan)

    @property
    def says_how_sure(self) -> bool:
        """Whether the model itself says how far off every one of its samples may be."""
        return self._thermal is not None

    @property
    def knows_the_ends(self) -> bool:
        """Whether the model follows the wire to both ends of its stroke at any load."""
        return self._thermal is not None

    def begin_session(self, before_s: float = 0.0) -> None:
        """Forget everything: the next sample is the first of a session, after others that lasted ``before_s``."""
        self._start_s, self._before_s = nan, before_s
        self._undriven = False  #: at the last sample
        for _, _, state in self._effects:
            state[:] = nan
        self.reset()

    def reset(self) -> None:
        """Forget where on its loop the wire is: the next good sample is taken for a wire at rest on its cooling
        curve."""
        self._started = False
        self._velocity_state[:] = nan  # it begins with the first displacement
        self._hot_end.reset()
        if self._elastic_load is not None:
            self._elastic_load.reset()
        for _, effect, state in self._effects:
            effect.forget_the_loop(state)
        self._last = Estimate(-inf, nan, nan, 0.0, Branch.COOLING, Quality.INVALID)

    def update(self, config: ChainSections) -> None:
        """Take over live parameters; the memory stays."""
        self._branch.configure(config.estimator)
        self._velocity_time_constant_s = config.estimator.velocity_time_constant
        self._hot_end.update(config)
        self._usual_C, self._tolerance_K = config.thermal.ambient_temperature, config.thermal.ambient_tolerance
        self._place = place_of(config)
        branch, hot_end = self._branch, self._hot_end
        self._seen_by = (
            *(branch.decision, branch.state, branch.numbers),
            *(self._asks_hot_end, hot_end.row, hot_end.state, hot_end.line),
        )
        self._told_by = self._velocity_state, self._velocity_time_constant_s, self._bounds

    # --- one sample ---------------------------------------------------------------------------------

    def step(self, signals: Signals) -> tuple[Signals, Estimate]:
        """One sample: its signals without the effects of circuit and load cell, and the estimate."""
        signals, frame = self._measure(signals)
        resistance_Ohm, stress_Pa, power_W = signals.resistance_Ohm, signals.stress_Pa, signals.power_W
        lowest_Ohm, highest_Ohm = self._resistances_Ohm
        if not (lowest_Ohm <= resistance_Ohm <= highest_Ohm and isfinite(signals.time_s + stress_Pa + power_W)):
            last, self._undriven = self._last, isnan(power_W) and isfinite(signals.current_A)
            self._last = Estimate(
                signals.time_s, last.displacement_m, last.strain, 0.0, last.branch, Quality.INVALID, last.uncertainty_m
            )
            return signals, self._last
        heat_W = power_W
        if frame is not None:
            frame = self._act(self._at_resistance, frame)
            resistance_Ohm, heat_W = float(frame.resistance_Ohm[0]), float(frame.power_W[0])
        if not self._started:
            self._start(signals.time_s, resistance_Ohm, stress_Pa, power_W)
        self._undriven = False
        time_s, ambient_C = signals.time_s, signals.ambient_temperature_C
        heating, contracted = _seen(time_s, resistance_Ohm, stress_Pa, power_W, heat_W, ambient_C, *self._seen_by)
        displacement_m, uncertainty_m, seen = self._observe(signals, resistance_Ohm, heating, heat_W)
        if contracted:
            displacement_m = min(displacement_m, float(self._hot_end.displacement_m(stress_Pa)))
        if frame is not None:
            frame.heating, frame.displacement_m = np.array([heating]), np.array([displacement_m])
            displacement_m = float(self._act(self._at_displacement, frame).displacement_m[0])
        if self._elastic_load is not None:
            displacement_m, uncertainty_m = self._elastic_load.step(time_s, stress_Pa, displacement_m, uncertainty_m)
        velocity_m_s, quality = _told(time_s, displacement_m, stress_Pa, contracted, *self._told_by)
        self._last = Estimate(
            time_s,
            displacement_m,
            displacement_m / self._length_m,
            velocity_m_s,
            Branch.HEATING if heating else Branch.COOLING,
            _QUALITIES[quality] if seen else Quality.OUTSIDE_CALIBRATION,
            uncertainty_m,
        )
        return signals, self._last

    def _observe(
        self, signals: Signals, resistance_Ohm: float, heating: bool, heat_W: float
    ) -> tuple[float, float, bool]:
        """The strain model's displacement, half of its 95 % interval, and whether its calibration has seen the like."""
        stress_Pa, ambient_C = self._in_reach(signals.stress_Pa), signals.ambient_temperature_C
        if not abs(ambient_C - self._usual_C) <= self._tolerance_K:
            ambient_C = nan  # a sensor that is not to be believed is none
        try:
            if self._thermal is None:
                return float(self._model.step(resistance_Ohm, stress_Pa, heating)), nan, True
            displacement_m, uncertainty_m, seen = self._thermal.observe(
                signals.time_s, resistance_Ohm, stress_Pa, heating, heat_W, ambient_C
            )
            return float(displacement_m), float(uncertainty_m), bool(seen)
        except (Exception, SystemExit) as error:  # it may be somebody else's
            raise self._model_failed(error) from error

    # --- many ---------------------------------------------------------------------------------------

    def run(self, signals: Signals) -> Estimates:
        """The live view of n samples: every field of ``signals`` is an array of shape (n,), or one number for all.

        The memory is carried on, so a log may come in pieces.
        """
        return Estimates(**self._run(signals, judged=False))

    def judge(self, signals: Signals) -> Judged:
        """The judged view of n samples: the model's alone, whatever the load tells and as if the surroundings were what
        they are taken for, and what a reference sensor should show."""
        return Judged(**self._run(signals, judged=True))

    def _run(self, signals: Signals, judged: bool) -> dict[str, Any]:
        if (follow := getattr(self._thermal, "follow_surroundings", None)) is not None:
            follow(not judged)
        signals, frame = self._measure(signals)
        last = self._last
        lowest_Ohm, highest_Ohm = self._resistances_Ohm
        good = (signals.resistance_Ohm >= lowest_Ohm) & (signals.resistance_Ohm <= highest_Ohm)
        good &= np.isfinite(signals.time_s + signals.stress_Pa + signals.power_W)
        n = len(good)
        out: dict[str, Any] = {
            "time_s": signals.time_s,
            "displacement_m": np.full(n, last.displacement_m),
            "velocity_m_s": np.zeros(n),
            "branch": np.full(n, int(last.branch)),
            "quality": np.full(n, int(Quality.INVALID)),
            "uncertainty_m": np.full(n, last.uncertainty_m),
            "signals": signals,
            "resistance_Ohm": np.full(n, nan),
            "model_m": np.full(n, nan),
            "heat_W": np.array(np.broadcast_to(signals.power_W, n), dtype=float),
        }
        if judged:
            out["elapsed_s"] = np.asarray(signals.time_s) - self._start_s
            out["before_s"] = self._before_s
            out["shown_m"] = np.full(n, nan)
        undriven = np.broadcast_to(np.isnan(signals.power_W) & np.isfinite(signals.current_A), n)
        if good.any():
            first = int(np.argmax(good))
            self._undriven = bool(undriven[first - 1]) if first else self._undriven
            self._run_good(signals, frame, good, out)
        out["strain"] = out["displacement_m"] / self._length_m
        if n:
            self._undriven = bool(undriven[-1])
            self._last = Estimate(
                float(signals.time_s[-1]),
                float(out["displacement_m"][-1]),
                float(out["strain"][-1]),
                float(out["velocity_m_s"][-1]),
                Branch(int(out["branch"][-1])),
                Quality(int(out["quality"][-1])),
                float(out["uncertainty_m"][-1]),
            )
        return out

    def _run_good(self, signals: Signals, frame: Frame | None, good: np.ndarray, out: dict[str, Any]) -> None:
        """Everything after ``measured``, of the good samples; what is held in between is held in ``out``."""
        time_s, resistance_Ohm, stress_Pa, power_W = (
            np.ascontiguousarray(np.broadcast_to(getattr(signals, name), good.shape)[good])
            for name in ("time_s", "resistance_Ohm", "stress_Pa", "power_W")
        )
        heat_W = power_W
        if frame is not None:
            frame = frame if good.all() else frame.rows(good)
            frame = self._act(self._at_resistance, frame)
            resistance_Ohm, heat_W = (np.ascontiguousarray(v) for v in (frame.resistance_Ohm, frame.power_W))
            out["heat_W"][good] = heat_W
        ambient_C = np.broadcast_to(signals.ambient_temperature_C, good.shape)[good]
        heating, model_m, uncertainty_m, seen, contracted = self._follow(
            time_s, resistance_Ohm, stress_Pa, power_W, heat_W, ambient_C
        )
        displacement_m = shown_m = model_m
        if frame is not None:
            frame.heating, frame.displacement_m = heating, model_m
            displacement_m = np.ascontiguousarray(self._act(self._at_displacement, frame).displacement_m)
            if "shown_m" in out:
                shown_m = self._act(self._shown, frame).displacement_m
        if self._elastic_load is not None and "shown_m" not in out:
            displacement_m, uncertainty_m = np.array(displacement_m), np.array(uncertainty_m)
            self._elastic_load.run(time_s, stress_Pa, displacement_m, uncertainty_m)
        velocity_m_s, quality = np.empty(len(time_s)), np.empty(len(time_s), dtype=np.int64)
        _velocity_all(time_s, displacement_m, self._velocity_state, self._velocity_time_constant_s, velocity_m_s)
        _quality_all(displacement_m, stress_Pa, contracted, self._bounds, quality)
        quality = np.where(seen, quality, int(Quality.OUTSIDE_CALIBRATION))
        out["velocity_m_s"][good], out["quality"][good] = velocity_m_s, quality
        latest = np.cumsum(good) - 1  # index of the last good sample at each place; −1 before the first
        known = latest >= 0
        held = {
            "displacement_m": displacement_m,
            "branch": heating,
            "resistance_Ohm": resistance_Ohm,
            "model_m": model_m,
            "uncertainty_m": uncertainty_m,
        }
        if "shown_m" in out:
            held["shown_m"] = shown_m
        for name, values in held.items():
            out[name][known] = values[latest[known]]

    def _follow(
        self,
        time_s: np.ndarray,
        resistance_Ohm: np.ndarray,
        stress_Pa: np.ndarray,
        power_W: np.ndarray,
        heat_W: np.ndarray,
        ambient_C: np.ndarray,
    ) -> tuple[np.ndarray, ...]:
        """What branch, strain model and hot end make of n good samples: whether heating, δ, half of its 95 % interval,
        whether the calibration has seen the like, and whether the wire is contracted as far as it goes."""
        if not self._started:
            self._start(time_s[0], resistance_Ohm[0], stress_Pa[0], power_W[0])
        heating = self._branch.run(time_s, resistance_Ohm, power_W)
        in_reach_Pa = np.clip(stress_Pa, *self._stress_Pa)
        doubtful = ~(np.abs(ambient_C - self._usual_C) <= self._tolerance_K)
        try:
            if self._thermal is None:
                model_m = self._model.run(resistance_Ohm, in_reach_Pa, heating)
                uncertainty_m, seen = np.full(len(time_s), nan), np.ones(len(time_s), dtype=np.bool_)
            else:
                model_m, uncertainty_m, seen = self._thermal.observe_all(
                    time_s, resistance_Ohm, in_reach_Pa, heating, heat_W, np.where(doubtful, nan, ambient_C)
                )
            for each in (model_m, uncertainty_m, seen):
                if each.shape != time_s.shape:
                    raise ValueError(f"gives an array of shape {each.shape} for samples of shape {time_s.shape}")
        except (Exception, SystemExit) as error:  # it may be somebody else's
            raise self._model_failed(error) from error
        contracted = np.zeros(len(time_s), dtype=np.bool_)
        if self._asks_hot_end:
            contracted = self._hot_end.run(time_s, resistance_Ohm, stress_Pa, heat_W, ambient_C)
            model_m = np.where(contracted, np.minimum(model_m, self._hot_end.displacement_m(stress_Pa)), model_m)
        return heating, model_m, uncertainty_m, seen, contracted

    # --- small print --------------------------------------------------------------------------------

    def _measure(self, signals: Signals) -> tuple[Signals, Frame | None]:
        """The signals without the effects of circuit and load cell, and a frame where there are any effects."""
        if isnan(self._start_s):
            self._begin(signals.time_s)
        if not self._effects:
            return signals, None
        frame = Frame.of(signals, self._start_s, self._before_s)
        if not self._measured:
            return signals, frame
        frame.load_N = frame.load_N + signals.tare_N  # what the load cell shows is what its faults act on
        self._act(self._measured, frame)
        frame.load_N = frame.load_N - signals.tare_N
        values: dict[str, Any] = {
            "resistance_Ohm": frame.resistance_Ohm,
            "current_A": frame.current_A,
            "power_W": frame.power_W,
            "load_N": frame.load_N,
            "stress_Pa": frame.load_N / self._place.area_m2,
        }
        if not isinstance(signals.time_s, np.ndarray):
            values = {name: float(value[0]) for name, value in values.items()}
        return dataclasses.replace(signals, **values), frame

    def _begin(self, time_s: float | np.ndarray) -> None:
        """Start the session's clock at the first time that is one."""
        if isinstance(time_s, np.ndarray):
            known = time_s[np.isfinite(time_s)]
            self._start_s = float(known[0]) if len(known) else nan
        elif isfinite(time_s):
            self._start_s = time_s

    def _act(self, acts: tuple[Act, ...], frame: Frame) -> Frame:
        samples = frame.elapsed_s.shape
        for act, state, name in acts:
            try:
                act(frame, state, self._place)
                fits = frame.resistance_Ohm.shape == samples and (
                    frame.displacement_m is None or frame.displacement_m.shape == samples
                )
            except (Exception, SystemExit) as error:  # it may be somebody else's
                raise EffectError(f"{name}: {type(error).__name__}: {error}") from error
            if not fits:
                raise EffectError(f"{name}: leaves another number of samples than the {samples[0]} that it is given")
        return frame

    def _model_failed(self, error: BaseException) -> ModelError:
        return ModelError(f"strain model '{self._model_type}': {type(error).__name__}: {error}")

    def _in_reach(self, stress_Pa: float) -> float:
        """The stress, or the margin of the calibrated range where it lies beyond."""
        return min(max(stress_Pa, self._stress_Pa[0]), self._stress_Pa[1])

    def _start(self, time_s: float, resistance_Ohm: float, stress_Pa: float, power_W: float) -> None:
        try:
            if self._thermal is None:
                self._model.reset(resistance_Ohm, self._in_reach(stress_Pa))
            else:
                self._thermal.reset(0.0 if self._undriven else nan)
        except (Exception, SystemExit) as error:  # it may be somebody else's
            raise self._model_failed(error) from error
        self._branch.reset(time_s, resistance_Ohm, power_W)
        self._started = True
