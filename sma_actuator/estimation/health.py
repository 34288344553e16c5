"""Whether the model still holds, from what the wire itself shows: no reference sensor is needed.

Four signs are read off again and again while a wire is used:

* *cold*: the resistance at cold rest, and *hot*: that of the contracted wire, held against the section
  ``calibration`` at the present stress;
* *hold*: how warm the heat balance has the wire while a position is held, and *width*: by how much it is warmer on the
  heating branch than on the cooling one, held against what the first holds since the beginning have shown.

Each has a bound.  A sign is beyond it when two of its last three readings are, on the same side.  The resistances bound
what the position is wrong by, if it is wrong everywhere by as much; the other two say that something has changed
between heat and shape.  What lies between the wire and the joint shows in none of them.

Live and of a log the same code, sample by sample.
"""

from __future__ import annotations

import collections
from math import exp, inf, isfinite, nan
from typing import Protocol

import numpy as np

from sma_actuator.base.calibration import through
from sma_actuator.base.sections import Wire
from sma_actuator.base.signals import Branch, Estimate, Health, Quality, Sign, Signals, Verdict

from .chain import Estimates
from .hot_end import HotEndSections
from .models import Coefficients

#: A resistance may be off by what moves the estimate by this share of full stroke, or by this many of its scatter.
STROKE_SHARE, SCATTERS = 0.02, 4.0
#: The heat of a held wire may be off by this share, or by this many of the scatter of the first holds.
HOLD_SHARE, HOLD_SCATTERS = 0.3, 4.0
#: Cold is a wire that for so many time constants has been no warmer than this times what the bias current makes of it
#: and this many kelvins.  The balance leaves latent heat out: a wire that transforms is warmer than it says.
BIAS_RISES, COLD_K, COLD_TIMES = 1.5, 0.5, 6.0
WARM_SHARE = 0.6  #: of what the bias current makes of it, before it is read: the calibration has it all
#: Held is a wire whose rise stands, within this share of itself and this many kelvins, for so many time constants.
BALANCE_SHARE, BALANCE_K, HOLD_TIMES = 0.05, 0.7, 2.0
#: What it stands against: itself, lagging by so many time constants.
LAG_TIMES = 2.0
#: The contracted wire is this much warmer than where its resistance was noted; the balance leaves latent heat out.
HOTTER_K = 5.0
WINDOW_s = 0.5  #: averaged
STEADY_SHARE = 0.004  #: of the resistance, that it may move within the window
AGAIN_s = 60.0  #: a rest that lasts is read again
LEARNED_HOLDS = 16  #: on each branch; then they are what later ones are held against
LATEST_HOLDS = 8  #: averaged, and then the next as many
READINGS, BEYOND = 3, 2
UNKNOWN_K = 100.0  #: rise of a wire of which nothing is known
#: Kelvins that the surroundings may differ by where no sensor tells them.
UNKNOWN_AMBIENT_K = 3.0
LOOP_SHARES = 0.3, 0.7  #: of the working range, both of which a cycle passes


#: What each sign is called.
SIGNS = {
    "cold": "resistance at cold rest",
    "hot": "resistance of the contracted wire",
    "hold": "heat to hold a position",
    "width": "width of the loop in heat",
}
#: What may be the cause, and the sides (+1, 0, −1) to which it moves cold, hot, hold, width; None: it may or may not.
CAUSES: tuple[tuple[str, tuple[tuple[int, ...] | None, ...]], ...] = (
    ("leads or contacts with more resistance", ((1,), (1,), None, None)),
    ("leads or contacts with less resistance", ((-1,), (-1,), None, None)),
    ("a zero error of a voltage channel", ((1, -1), (0, 1, -1), None, None)),
    ("something that conducts beside the wire", ((-1,), (-1, 0), None, None)),
    ("a sense resistor that warms or drifts", ((0, 1, -1), (1, -1), None, None)),
    ("a resistivity that rises more with temperature", ((0,), (1,), None, None)),
    ("surroundings of another temperature", ((0, 1, -1), (0,), (1, -1), (0,))),
    ("another heat loss: draught, a tube, another posture", ((0,), (0,), (1, -1), None)),
    ("training or fatigue of the wire", (None, (0, 1), None, (0, -1))),
    ("a load cell that has drifted", ((0, 1, -1), (0,), None, (0,))),
)
#: What moves the joint and leaves no trace in resistance and heat.
BLIND = (
    "a slip or creep in crimps and mount, play, a mechanism that yields, thermal expansion of the mount, a "
    "resistivity that rises more with temperature where the wire is never held contracted, and anything smaller than "
    "the bounds"
)


class HealthSections(HotEndSections, Protocol):
    """The parameters that a model's health reads; a ``Config`` has them."""

    @property
    def wire(self) -> Wire:
        """The wire."""

    @property
    def model(self) -> Coefficients:
        """The model."""


class _Readings:
    """The readings of one sign."""

    def __init__(self) -> None:
        self._latest: collections.deque[tuple[float, float, float]] = collections.deque(maxlen=READINGS)
        self._since_s = nan
        self._readings = 0

    def note(self, time_s: float, deviation: float, bound: float) -> None:
        self._latest.append((time_s, deviation, bound))
        self._readings += 1
        if not self._side():
            self._since_s = nan
        elif self._since_s != self._since_s:
            self._since_s = next(t for t, d, b in self._latest if abs(d) > b)

    def _side(self) -> int:
        for side in (1, -1):
            if sum(side * d > b for _, d, b in self._latest) >= BEYOND:
                return side
        return 0

    def sign(self) -> Sign | None:
        """As it stands; None before anything was seen."""
        if not self._latest:
            return None
        middle = float(np.median([d for _, d, _ in self._latest]))
        return Sign(middle, self._latest[-1][2], self._side(), self._since_s, self._readings)


class _Holds:
    """Heat of held positions on one branch: a plane over position and stress through the first, then what comes."""

    def __init__(self) -> None:
        self._learned: list[tuple[float, float, float]] = []  #: position, stress, rise
        self._latest: list[float] = []  #: how far above the plane
        self._plane = np.zeros(3)
        self.scatter_K = nan
        self.rise_K = nan
        self.away_K = nan  #: mean of the last LATEST_HOLDS that were whole

    def note(self, position_m: float, stress_Pa: float, rise_K: float) -> bool:
        """Take a hold; whether there is a new mean."""
        if len(self._learned) < LEARNED_HOLDS:
            self._learned.append((position_m, stress_Pa, rise_K))
            if len(self._learned) == LEARNED_HOLDS:
                self._learn()
            return False
        self._latest.append(rise_K - float(self._row(position_m, stress_Pa) @ self._plane))
        if len(self._latest) < LATEST_HOLDS:
            return False
        # Each hold counts once: means that shared holds would go beyond a bound together.
        self.away_K, self._latest = float(np.mean(self._latest)), []
        return True

    def _row(self, position_m: float, stress_Pa: float) -> np.ndarray:
        # In millimetres and hundreds of megapascals, so that least squares see numbers of one size.
        return np.array([1.0, position_m * 1e3, stress_Pa * 1e-8])

    def _learn(self) -> None:
        rows = np.array([self._row(position_m, stress_Pa) for position_m, stress_Pa, _ in self._learned])
        rise_K = np.array([rise for _, _, rise in self._learned])
        # Where all were under one stress, or at one place, that column says nothing and gets nothing.
        self._plane = np.linalg.lstsq(rows, rise_K, rcond=1e-6)[0]
        self.scatter_K = float(np.std(rise_K - rows @ self._plane))
        self.rise_K = float(np.mean(rise_K))


class ModelHealth:
    """The health of one wire's model; remembers what it has seen."""

    def __init__(self, config: HealthSections, bias_current_A: float):
        self._bias_current_A = bias_current_A
        self._signs = {name: _Readings() for name in SIGNS}
        self._holds = {Branch.HEATING: _Holds(), Branch.COOLING: _Holds()}
        self._time_s = nan
        self._rise_K = nan  #: by the heat balance
        self._lagging_K = nan  #: the same, later
        self._window: list[tuple[float, float, float]] = []  #: time, resistance, stress, while they are of one kind
        self._kind = ""  #: what is going on: cold, hot, hold or nothing
        self._begun_s = nan  #: since when
        self._read_s = -inf  #: when that was last read
        self._cycles, self._was_hot = 0, False
        self._configure(config)
        self.verdict = self._judge()

    def update(self, config: HealthSections) -> None:
        """Take over live parameters; the memory stays."""
        self._configure(config)

    def _configure(self, config: HealthSections) -> None:
        calibration, thermal = config.calibration, config.thermal
        self._calibration = calibration
        self._heat_loss_W_K = thermal.heat_loss
        self._time_constant_s = thermal.heat_capacity / thermal.heat_loss
        self._usual_C, self._tolerance_K = thermal.ambient_temperature, thermal.ambient_tolerance
        self._range_m = config.model.build(config.wire).displacement_range_m
        rest, hot_end = calibration.rest, calibration.hot_end
        hot = rest.hot_resistance, rest.hot_displacement
        if not rest.hot_resistance:  # logs that nowhere rest at the hot end: what was contracted is near it
            hot = hot_end.contracted_resistance, hot_end.contracted_displacement
        ends = [
            float(np.mean(values)) if values else nan
            for values in (rest.cold_resistance, hot[0], rest.cold_displacement, hot[1])
        ]
        self._bias_rise_K = self._bias_current_A**2 * ends[0] / thermal.heat_loss
        #: What a resistance that is wrong makes of the position.
        self._m_per_Ohm = abs(float((ends[2] - ends[3]) / (ends[0] - ends[1]))) if ends[0] != ends[1] else nan
        self._bound_Ohm = float(
            max(STROKE_SHARE * config.wire.full_stroke_m / self._m_per_Ohm, SCATTERS * rest.resistance_scatter)
        )
        #: Whether the calibration says what a resting wire shows.
        self.known = isfinite(self._m_per_Ohm) and isfinite(self._bound_Ohm)

    # --- a sample ----------------------------------------------------------------------------------

    def step(self, signals: Signals, estimate: Estimate) -> bool:
        """Look at one sample; whether the verdict has changed."""
        time_s = signals.time_s
        step_s = time_s - self._time_s
        self._time_s = time_s
        if not self.known or not isfinite(time_s):
            return False
        power_W = signals.power_W if isfinite(signals.power_W) else 0.0
        settled_K = power_W / self._heat_loss_W_K
        self._keep_heat(settled_K, step_s)
        self._count(estimate)
        kind = self._what_goes_on(signals, estimate)
        if kind != self._kind:
            self._kind, self._begun_s, self._read_s = kind, time_s, -inf
            self._window.clear()
        wait_s = (COLD_TIMES if kind == "cold" else HOLD_TIMES) * self._time_constant_s
        if not kind or time_s - self._begun_s < wait_s or time_s - self._read_s < AGAIN_s:
            return False
        measured = estimate.quality is not Quality.INVALID and isfinite(signals.resistance_Ohm + signals.stress_Pa)
        if not measured or self._rise_K < WARM_SHARE * self._bias_rise_K:
            self._window.clear()
            return False
        self._window.append((time_s, signals.resistance_Ohm, signals.stress_Pa))
        if time_s - self._window[0][0] < WINDOW_s:
            return False
        resistance_Ohm, stress_Pa = (np.array([row[k] for row in self._window]) for k in (1, 2))
        self._window.clear()
        half = len(resistance_Ohm) // 2
        moved_Ohm = abs(resistance_Ohm[:half].mean() - resistance_Ohm[half:].mean())
        if not moved_Ohm <= STEADY_SHARE * resistance_Ohm.mean():
            return False
        self._read_s = time_s
        return self._read(kind, float(resistance_Ohm.mean()), float(stress_Pa.mean()), signals, estimate)

    def _keep_heat(self, settled_K: float, step_s: float) -> None:
        """Heat balance: the rise above ambient, and what it lags to."""
        # the first sample, or a clock that was set back: nothing is known of the wire, so it is hot
        if not step_s >= 0.0:
            self._rise_K = self._lagging_K = max(settled_K, UNKNOWN_K)
            return
        self._rise_K = settled_K + (self._rise_K - settled_K) * exp(-step_s / self._time_constant_s)
        lag = exp(-step_s / (LAG_TIMES * self._time_constant_s))
        self._lagging_K = self._rise_K + (self._lagging_K - self._rise_K) * lag

    def _count(self, estimate: Estimate) -> None:
        """Cycles: from the long end of the working range to the short one and back."""
        if estimate.quality is Quality.INVALID:
            return
        lo_m, hi_m = self._range_m
        share = (estimate.displacement_m - lo_m) / (hi_m - lo_m)
        if share < LOOP_SHARES[0]:
            self._was_hot = True
        elif share > LOOP_SHARES[1] and self._was_hot:
            self._was_hot = False
            self._cycles += 1

    def _what_goes_on(self, signals: Signals, estimate: Estimate) -> str:
        """cold, hot, hold, or "" where nothing can be read."""
        if self._rise_K <= BIAS_RISES * self._bias_rise_K + COLD_K:
            return "cold"
        if not abs(self._lagging_K - self._rise_K) <= BALANCE_SHARE * self._rise_K + BALANCE_K:
            return ""
        if self._ambient_C(signals) + self._rise_K >= self._calibration.hot_end.contracted_temperature + HOTTER_K:
            return "hot"
        return "hold" if estimate.quality is Quality.DETERMINATE else ""

    def _ambient_C(self, signals: Signals) -> float:
        read_C = signals.ambient_temperature_C
        return read_C if abs(read_C - self._usual_C) <= self._tolerance_K else self._usual_C

    def run(self, estimates: Estimates) -> list[tuple[float, Verdict]]:
        """The same of a log: when the verdict changed, and to what."""
        signals = estimates.signals
        names = ("time_s", "resistance_Ohm", "current_A", "power_W", "load_N", "stress_Pa", "ambient_temperature_C")
        columns = {name: np.broadcast_to(getattr(signals, name), estimates.time_s.shape) for name in names}
        changes = []
        for i, time_s in enumerate(estimates.time_s):
            sample = Signals(**{name: float(column[i]) for name, column in columns.items()})
            estimate = Estimate(
                float(time_s),
                float(estimates.displacement_m[i]),
                float(estimates.strain[i]),
                float(estimates.velocity_m_s[i]),
                Branch(int(estimates.branch[i])),
                Quality(int(estimates.quality[i])),
            )
            if self.step(sample, estimate):
                changes.append((float(time_s), self.verdict))
        return changes

    # --- what was read -------------------------------------------------------------------------------

    def _read(self, kind: str, resistance_Ohm: float, stress_Pa: float, signals: Signals, estimate: Estimate) -> bool:
        if kind == "hold":
            if self._holds[estimate.branch].note(estimate.displacement_m, stress_Pa, self._rise_K):
                self._compare_holds()
        else:
            self._compare_resistance(kind, resistance_Ohm, stress_Pa, signals)
        before = self.verdict
        self.verdict = self._judge()
        return self.verdict.state is not before.state

    def _compare_resistance(self, kind: str, resistance_Ohm: float, stress_Pa: float, signals: Signals) -> None:
        calibration, rest, hot_end = self._calibration, self._calibration.rest, self._calibration.hot_end
        stresses, resistances = (
            (rest.cold_stress, rest.cold_resistance)
            if kind == "cold"
            else (hot_end.contracted_stress, hot_end.contracted_resistance)
        )
        if not stresses or not min(stresses) * 0.95 <= stress_Pa <= max(stresses) * 1.05:
            return
        expected_Ohm = float(through(stresses, resistances, stress_Pa))
        slope_Ohm_K = hot_end.contracted_slope if isfinite(hot_end.contracted_slope) else 0.0
        ambient_C = self._ambient_C(signals)
        if kind == "hot":
            expected_Ohm += slope_Ohm_K * (ambient_C + self._rise_K - hot_end.contracted_temperature)
        elif isfinite(calibration.ambient_temperature):
            # The martensite warms as the austenite does, by half as much or by half as much again.
            expected_Ohm += slope_Ohm_K * (ambient_C - calibration.ambient_temperature)
        differs_K = abs(ambient_C - calibration.ambient_temperature) if isfinite(signals.ambient_temperature_C) else nan
        slack_K = 0.5 * differs_K if isfinite(differs_K) else UNKNOWN_AMBIENT_K
        self._signs[kind].note(
            self._time_s, resistance_Ohm - expected_Ohm, self._bound_Ohm + abs(slope_Ohm_K) * slack_K
        )

    def _compare_holds(self) -> None:
        heating, cooling = self._holds[Branch.HEATING], self._holds[Branch.COOLING]
        aways_K = [(h.away_K, h.scatter_K, h.rise_K) for h in (heating, cooling) if isfinite(h.away_K)]
        if not aways_K:
            return
        away_K, scatter_K, rise_K = (float(np.mean([a[k] for a in aways_K])) for k in range(3))
        bound_K = max(HOLD_SHARE * rise_K, HOLD_SCATTERS * scatter_K / LATEST_HOLDS**0.5)
        self._signs["hold"].note(self._time_s, away_K, bound_K)
        if len(aways_K) == 2:
            self._signs["width"].note(self._time_s, heating.away_K - cooling.away_K, 1.5 * bound_K)

    # --- the verdict -------------------------------------------------------------------------------

    def _judge(self) -> Verdict:
        if not self.known:
            return Verdict(Health.UNKNOWN, "not known: the calibration does not say what a resting wire shows")
        signs = {name: sign for name, readings in self._signs.items() if (sign := readings.sign()) is not None}
        beyond = {name: sign for name, sign in signs.items() if sign.side}
        errors_m = [abs(signs[name].deviation) * self._m_per_Ohm for name in ("cold", "hot") if name in signs]
        error_m = float(max(errors_m)) if errors_m else nan
        if beyond:
            causes = _causes({name: sign.side for name, sign in signs.items() if sign.readings >= BEYOND})
            since_s = min(sign.since_s for sign in beyond.values())
            words = "calibration due: " + "; ".join(_words(name, sign) for name, sign in beyond.items())
            if "cold" in beyond or "hot" in beyond:
                words += f"; the position is off by about {error_m * 1e3:.2f} mm"
            words += f". It could be: {'; '.join(causes) or 'nothing that has a name here'}. Not seen this way: {BLIND}"
            return Verdict(Health.DUE, words, since_s, error_m, causes, signs, self._cycles)
        if not any(name in signs and signs[name].readings >= BEYOND for name in ("cold", "hot")):
            words = "not known yet: the wire has not rested long enough, cold at the bias current or contracted"
            return Verdict(Health.UNKNOWN, words, error_m=error_m, signs=signs, cycles=self._cycles)
        words = "the model holds, by " + ", ".join(SIGNS[name] for name in signs)
        return Verdict(Health.HOLDS, words, error_m=error_m, signs=signs, cycles=self._cycles)


def _words(name: str, sign: Sign) -> str:
    unit = "Ω" if name in ("cold", "hot") else "K"
    side = "too high" if sign.side > 0 else "too low"
    return f"{SIGNS[name]} is {abs(sign.deviation):.3g} {unit} {side} ({sign.bound:.3g} {unit} may be)"


def _causes(sides: dict[str, int]) -> tuple[str, ...]:
    """Those of CAUSES that agree with every sign that was seen, in words."""
    return tuple(
        words
        for words, expected in CAUSES
        if all(
            name not in sides or allowed is None or sides[name] in allowed
            for name, allowed in zip(SIGNS, expected, strict=True)
        )
    )
