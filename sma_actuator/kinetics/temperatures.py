"""What is read off a loop without any model: transformation temperatures, widths, slopes against stress."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .reading import Loop

SHARES = (0.9, 0.5, 0.1)  #: of martensite: the transformation to austenite begins, is half done, ends


@dataclass(frozen=True)
class Temperatures:
    """Of one loop, in °C; shares are those of its own stroke."""

    stress_Pa: float
    stroke: float
    heating_C: tuple[float, ...]  #: where 90, 50 and 10 % of the stroke are left
    cooling_C: tuple[float, ...]  #: where as much has come back
    austenite_start_C: float  #: where the steepest tangent meets the ends
    austenite_finish_C: float
    martensite_start_C: float
    martensite_finish_C: float

    @property
    def widths_K(self) -> tuple[float, float]:
        """10 to 90 % of heating and of cooling."""
        return self.heating_C[2] - self.heating_C[0], self.cooling_C[2] - self.cooling_C[0]

    @property
    def hysteresis_K(self) -> float:
        """At half the stroke."""
        return self.heating_C[1] - self.cooling_C[1]


def temperatures(loop: Loop) -> Temperatures:
    """Read one loop."""
    curves = [_curve(loop, branch) for branch in loop.branches]
    at = [tuple(_where(curve, share) for share in SHARES) for curve in curves]
    (as_C, af_C), (mf_C, ms_C) = (_tangent(curve) for curve in curves)
    return Temperatures(loop.mean_stress_Pa, loop.stroke, at[0], at[1], as_C, af_C, ms_C, mf_C)


def slopes_Pa_K(found: Sequence[Temperatures]) -> dict[str, tuple[float, ...]]:
    """Clausius-Clapeyron slopes of heating and cooling, at each of :data:`SHARES`; empty for a single stress."""
    stress_Pa = np.array([t.stress_Pa for t in found])
    if len(found) < 2 or np.ptp(stress_Pa) < 5e6:
        return {}
    out = {}
    for name in ("heating_C", "cooling_C"):
        at_C = np.array([getattr(t, name) for t in found])
        out[name.removesuffix("_C")] = tuple(float(1.0 / np.polyfit(stress_Pa, at_C[:, i], 1)[0]) for i in range(3))
    return out


def _curve(loop: Loop, branch: slice) -> tuple[np.ndarray, np.ndarray]:
    """Temperature, rising, and share of the stroke, falling: means over kelvins."""
    t, strain = loop.temperature_C[branch], loop.strain[branch]
    hot, _ = loop.ends
    kelvins, which = np.unique(np.round(t), return_inverse=True)
    count = np.bincount(which, minlength=len(kelvins))
    share = np.bincount(which, (strain - hot) / loop.stroke) / count
    return np.bincount(which, t) / count, np.minimum.accumulate(share)


def _where(curve: tuple[np.ndarray, np.ndarray], share: float) -> float:
    return float(np.interp(-share, -curve[1], curve[0]))


def _tangent(curve: tuple[np.ndarray, np.ndarray]) -> tuple[float, float]:
    """Where the steepest straight piece, a fifth of the stroke long, meets one and zero."""
    steepest = min((_where(curve, m - 0.1) - _where(curve, m + 0.1), float(m)) for m in np.linspace(0.2, 0.8, 25))
    per_share, middle = steepest[0] / 0.2, steepest[1]
    at_C = _where(curve, middle)
    return at_C - (1.0 - middle) * per_share, at_C + middle * per_share
