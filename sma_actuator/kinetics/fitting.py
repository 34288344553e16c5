"""Kinetics fitted to isobaric loops of all stresses jointly, and judged on stresses left out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from sma_actuator.base.one_thread import one_thread
from sma_actuator.plant.kinetics import (
    COOLING,
    HEATING,
    Kinetics,
    LiangRogers,
    Logistic,
    Measured,
    SmoothHardening,
    follow,
    outer,
)

from .reading import Loop
from .temperatures import Temperatures, temperatures

#: Slopes are looked for about this, the middle of the 7 to 14 MPa/K of the literature.
USUAL_SLOPE_K_Pa = 0.12e-6
_SLOPES_K_Pa = (0.02e-6, 0.4e-6)
_SLOPE_PRIOR = 0.05  #: weight, in percent, of parts whose slopes differ from that of the half transformation
_CROSSING = 10.0  #: weight, in percent, of a cooling band that lies above the heating band


@dataclass(frozen=True)
class Guess:
    """What is known of a wire before any fit: half transformation at zero stress, its slopes, and widths."""

    heating_C: float
    cooling_C: float
    heating_K_Pa: float
    cooling_K_Pa: float
    heating_K: float
    cooling_K: float


@dataclass(frozen=True)
class Family:
    """A kinetics as it is fitted: values with their bounds, and what to make of them."""

    name: str
    start: Callable[[Guess], list[tuple[float, float, float]]]  #: (low, start, high) of each value
    make: Callable[[np.ndarray], Kinetics]
    prior: Callable[[np.ndarray, Guess], np.ndarray]  #: weak, in percent, for what the loops do not determine


@dataclass(frozen=True)
class Fit:
    """Kinetics, and the strain that goes with it: base(σ) + H∞ (1 − exp(−(σ + σ_0)/σ_s)) ξ."""

    family: str
    kinetics: Kinetics
    base: tuple[float, float, float]
    largest: float
    stress_0_Pa: float
    stress_scale_Pa: float

    def strain(self, loop: Loop) -> np.ndarray:
        """Modelled strain at every sample of a loop, turning points and all."""
        fraction = follow(self.kinetics, loop.temperature_C, loop.smooth_stress_Pa)
        gpa = loop.mean_stress_Pa * 1e-9
        base = self.base[0] + self.base[1] * gpa + self.base[2] * gpa**2
        size = self.largest * (1.0 - np.exp(-(loop.mean_stress_Pa + self.stress_0_Pa) / self.stress_scale_Pa))
        return base + size * fraction

    def rms(self, loop: Loop) -> tuple[float, float]:
        """Error on heating and on cooling, relative to the loop's stroke."""
        wrong = (self.strain(loop) - loop.strain) / loop.stroke
        heating, cooling = (float(np.sqrt(np.mean(wrong[branch] ** 2))) for branch in loop.branches)
        return heating, cooling


def both(rms: tuple[float, float]) -> float:
    """One number of two."""
    return float(np.hypot(*rms) / np.sqrt(2.0))


def guess(found: Sequence[Temperatures]) -> Guess:
    """From what is read off the loops."""
    stress_Pa = np.array([t.stress_Pa for t in found])
    lines = []
    for name in ("heating_C", "cooling_C"):
        half_C = np.array([getattr(t, name)[1] for t in found])
        slope_K_Pa = USUAL_SLOPE_K_Pa
        if len(found) > 1 and np.ptp(stress_Pa) > 20e6:
            slope_K_Pa = float(np.clip(np.polyfit(stress_Pa, half_C, 1)[0], 0.05e-6, 0.25e-6))
        lines.append((float(np.mean(half_C - slope_K_Pa * stress_Pa)), slope_K_Pa))
    widths_K = np.array([t.widths_K for t in found]).mean(axis=0)
    return Guess(
        heating_C=lines[0][0],
        cooling_C=lines[1][0],
        heating_K_Pa=lines[0][1],
        cooling_K_Pa=lines[1][1],
        heating_K=float(widths_K[0]),
        cooling_K=float(widths_K[1]),
    )


def _lines(g: Guess) -> tuple[tuple[float, float, float], ...]:
    return (g.heating_C, g.heating_K_Pa, g.heating_K), (g.cooling_C, g.cooling_K_Pa, g.cooling_K)


# --- Liang & Rogers: middle and width of both bands, one slope ------------------------------------------------------


def _liang_rogers_start(g: Guess) -> list[tuple[float, float, float]]:
    out = [(middle_C - 60.0, middle_C, middle_C + 60.0) for middle_C, _, _ in _lines(g)]
    out += [(1.0, 1.2 * width_K, 150.0) for _, _, width_K in _lines(g)]
    return [*out, (_SLOPES_K_Pa[0], 0.5 * (g.heating_K_Pa + g.cooling_K_Pa), _SLOPES_K_Pa[1])]


def _liang_rogers(x: np.ndarray) -> LiangRogers:
    return LiangRogers(
        austenite_start_C=x[0] - 0.5 * x[2],
        austenite_finish_C=x[0] + 0.5 * x[2],
        martensite_start_C=x[1] + 0.5 * x[3],
        martensite_finish_C=x[1] - 0.5 * x[3],
        stress_slope_Pa_K=1.0 / x[4],
    )


# --- a distribution: three logistics in each direction --------------------------------------------------------------


def _measured_start(g: Guess) -> list[tuple[float, float, float]]:
    out = []
    for middle_C, slope_K_Pa, width_K in _lines(g):
        out += [(-6.0, start, 4.0) for start in (-1.5, 0.0)]
        out += [(middle_C - 90.0, middle_C + offset_K, middle_C + 90.0) for offset_K in (0.0, 0.2 * width_K, 0.0)]
        out += [(np.log(0.3), np.log(share * width_K), np.log(45.0)) for share in (0.05, 0.15, 0.35)]
        out += [(_SLOPES_K_Pa[0], slope_K_Pa, _SLOPES_K_Pa[1])] * 3
    return out


def _measured(x: np.ndarray) -> Measured:
    return Measured(*(_logistics(x[:11]), _logistics(x[11:])))


def _logistics(x: np.ndarray) -> tuple[Logistic, ...]:
    weights = np.exp(np.array([0.0, x[0], x[1]]))
    weights /= weights.sum()
    return tuple(
        Logistic(weight=float(w), centre_C=float(c), width_K=float(np.exp(lw)), slope_Pa_K=float(1.0 / s))
        for w, c, lw, s in zip(weights, x[2:5], x[5:8], x[8:11], strict=True)
    )


def _measured_prior(x: np.ndarray, g: Guess) -> np.ndarray:
    out = []
    for values, (middle_C, slope_K_Pa, width_K) in zip((x[:11], x[11:]), _lines(g), strict=True):
        out += [0.02 * (values[2:5] - middle_C) / width_K, 0.02 * (values[5:8] - np.log(0.2 * width_K))]
        out += [_SLOPE_PRIOR * (values[8:11] - slope_K_Pa) / (0.4 * USUAL_SLOPE_K_Pa)]
    kinetics = _measured(x)
    bands = kinetics.bands()
    at_C = np.linspace(g.cooling_C - 60.0, g.heating_C + 90.0, 40)
    u, v = np.empty(len(at_C)), np.empty(len(at_C))
    for stress_Pa in (10e6, 100e6, 250e6):
        outer(kinetics.family, bands, HEATING, at_C, stress_Pa, u)
        outer(kinetics.family, bands, COOLING, at_C, stress_Pa, v)
        out.append(_CROSSING * np.maximum(v - u, 0.0))
    return np.concatenate(out)


# --- smooth hardening: both bands, each with a slope and two exponents ----------------------------------------------


def _lagoudas_start(g: Guess) -> list[tuple[float, float, float]]:
    out = []
    for middle_C, slope_K_Pa, width_K in _lines(g):
        out += [(middle_C - 60.0, middle_C, middle_C + 60.0), (2.0, 2.5 * width_K, 250.0)]
        out += [(_SLOPES_K_Pa[0], slope_K_Pa, _SLOPES_K_Pa[1]), (0.1, 0.3, 1.0), (0.1, 0.3, 1.0)]
    return out


def _lagoudas(x: np.ndarray) -> SmoothHardening:
    return SmoothHardening(
        austenite_start_C=x[0] - 0.5 * x[1],
        austenite_finish_C=x[0] + 0.5 * x[1],
        martensite_start_C=x[5] + 0.5 * x[6],
        martensite_finish_C=x[5] - 0.5 * x[6],
        heating_slope_Pa_K=1.0 / x[2],
        cooling_slope_Pa_K=1.0 / x[7],
        heating_exponents=(x[3], x[4]),
        cooling_exponents=(x[8], x[9]),
    )


def _no_prior(x: np.ndarray, g: Guess) -> np.ndarray:
    return np.zeros(0)


FAMILIES = {
    family.name: family
    for family in (
        Family("liang_rogers", _liang_rogers_start, _liang_rogers, _no_prior),
        Family("measured", _measured_start, _measured, _measured_prior),
        Family("lagoudas", _lagoudas_start, _lagoudas, _no_prior),
    )
}


@one_thread()
def fit(family: Family, loops: Sequence[Loop]) -> Fit:
    """Least squares over all loops jointly; every branch of every loop weighs the same, relative to its stroke."""
    found = [temperatures(loop) for loop in loops]
    g = guess(found)
    stroke = max(t.stroke for t in found)
    kinetic = family.start(g)
    strain = [(0.3 * stroke, 1.2 * stroke, 6.0 * stroke), (0.0, 60e6, 400e6), (5e6, 80e6, 600e6)]
    base = [(-0.02, float(np.mean([loop.ends[0] for loop in loops])), 0.02), (-0.1, 0.0, 0.1), (-1.0, 0.0, 1.0)]
    low, start, high = np.array([*strain, *base, *kinetic]).T
    scale = np.maximum(np.abs(start), 0.02 * (high - low))

    def made(x: np.ndarray) -> Fit:
        return Fit(
            family=family.name,
            kinetics=family.make(x[6:]),
            base=(float(x[3]), float(x[4]), float(x[5])),
            largest=float(x[0]),
            stress_0_Pa=float(x[1]),
            stress_scale_Pa=float(x[2]),
        )

    def wrong(z: np.ndarray) -> np.ndarray:
        x = np.clip(z * scale, low, high)
        candidate = made(x)
        parts = [1e-2 * (x[:3] / start[:3] - 1.0), 0.02 * x[4:6] / (0.05, 0.3), family.prior(x[6:], g)]
        for loop in loops:
            off = 100.0 * (candidate.strain(loop) - loop.strain) / loop.stroke
            parts += [off[branch] / np.sqrt(2.0 * len(loops) * len(off[branch])) for branch in loop.branches]
        return np.concatenate(parts)

    best = least_squares(
        wrong,
        np.clip(start / scale, low / scale, high / scale),
        bounds=(low / scale, high / scale),
        diff_step=1e-5,
        max_nfev=200,
        ftol=1e-6,
        xtol=1e-6,
    )
    return made(np.clip(best.x * scale, low, high))


@dataclass(frozen=True)
class Comparison:
    """One family: fitted to all loops, and each loop judged by a fit to the others."""

    all: Fit
    seen: tuple[tuple[float, float], ...]  #: RMS of each loop, heating and cooling, relative to its stroke
    left_out: tuple[tuple[float, float], ...]  #: the same, of loops that had no part; empty where there are too few


def compare(family: Family, loops: Sequence[Loop], leave_out: bool) -> Comparison:
    """Fit one family; with ``leave_out`` also to all but each."""
    together = fit(family, loops)
    seen = tuple(together.rms(loop) for loop in loops)
    left_out: tuple[tuple[float, float], ...] = ()
    if leave_out and len(loops) > 2:
        left_out = tuple(fit(family, [other for other in loops if other is not loop]).rms(loop) for loop in loops)
    return Comparison(together, seen, left_out)
