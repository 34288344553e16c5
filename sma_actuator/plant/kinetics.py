"""How much martensite there is: kinetics to choose from, with what each remembers of where it turned.

A kinetics is two bands.  On heating from full martensite the fraction left is ``u``, on cooling from full
austenite the fraction formed is ``v``; both fall from 1 to 0 as the temperature rises, and shift with stress
(Clausius-Clapeyron).  What lies between them, after a turn in the middle, is the other half of a kinetics:

- :class:`LiangRogers`: cosines, compact (C. Liang, C. A. Rogers, J. Intell. Mater. Syst. Struct. 1 (1990) 207);
  from a turn the rest of the band is scaled to what is left, and a minor loop closes where it began;
- :class:`Measured`: a distribution of transformation temperatures, a sum of logistics each with a slope of its own,
  so that stress moves the tails otherwise than the middle; minor loops as above.  :mod:`.measured` has the numbers;
- :class:`SmoothHardening`: the power-law hardening of D. Lagoudas, D. Hartl, Y. Chemisky, L. Machado, P. Popov,
  Int. J. Plast. 32-33 (2012) 155: along a band the temperature goes as ½ [1 + ξ^n − (1 − ξ)^m]; after a turn the
  fraction stands until the other transformation surface is reached, as in every model with a yield surface;
- :class:`Activated`: grains of which each crosses its own barrier by thermal activation (I. Müller, S. Seelecke, Math.
  Comput. Model. 34 (2001) 1307): the fraction lags behind a temperature that moves and creeps on where it stands.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import cos, exp, expm1, pi
from typing import NamedTuple

import numpy as np

from sma_actuator.base.jit import inlined, jit

DEPTH = 12  #: nested reversals a transformation remembers
_EPS = 1e-9
# Layout of a memory: direction (+1 heating, −1 cooling), the least that was left to go in it, the most that was left
# to go in the other direction since, number of remembered heating and of cooling turns; then the ways of the heating
# turns, the fractions left there, and the same of the cooling turns.
DIRECTION, LEAST, OTHER, HEATING_TURNS, COOLING_TURNS = range(5)
_HEATING_LIST, _COOLING_LIST = 5, 5 + 2 * DEPTH
_MEMORY = 5 + 4 * DEPTH

LIANG_ROGERS, MEASURED, SMOOTH_HARDENING, ACTIVATED = range(4)  # families, as the kernels know them
# What the kernels read of a kinetics is one array of two rows; a family reads what it needs of the columns.
HEATING, COOLING = range(2)
PARTS = 3  #: logistics in a row of a measured distribution
GRAINS = 96  #: of an activated kinetics
TABLE = 1024  #: intervals in a row of a hardening law, from the cold end of the band to the hot one
START_C, FINISH_C, SLOPE_K_Pa, FIRST_PART = range(4)
WEIGHT, CENTRE_C, WIDTH_K, PART_SLOPE_K_Pa = range(4)  # of each part
PART_COLUMNS = 4
FIRST_KNOT = FIRST_PART + PARTS * PART_COLUMNS
_COLUMNS = FIRST_KNOT + TABLE + 1
# Of an activated kinetics: the barriers of both rows at no stress; in the first row then what the grains' shares are,
# and the three numbers of a rate.
FIRST_GRAIN, _FIRST_SHARE = FIRST_KNOT, FIRST_KNOT + GRAINS
_PER_K, _ATTEMPTS_1_s, _CROSSING_s = range(FIRST_KNOT + 2 * GRAINS, FIRST_KNOT + 2 * GRAINS + 3)
#: Grains stand equally far apart on a logistic, out to so many of its widths.
_GRAINS_OUT_TO = 6.0


class Shift(NamedTuple):
    """By how much the bands lie higher than the kinetics says [K]."""

    heating_K: float
    cooling_K: float


def _bands(heating: tuple[float, float, float], cooling: tuple[float, float, float]) -> np.ndarray:
    """Rows with a start, a finish and a slope [°C, °C, K/Pa]."""
    bands = np.zeros((2, _COLUMNS))
    bands[HEATING, :FIRST_PART], bands[COOLING, :FIRST_PART] = heating, cooling
    return bands


@dataclass(frozen=True, slots=True)
class LiangRogers:
    """Cosines between four temperatures at zero stress."""

    austenite_start_C: float
    austenite_finish_C: float
    martensite_start_C: float
    martensite_finish_C: float
    stress_slope_Pa_K: float

    family = LIANG_ROGERS

    def bands(self) -> np.ndarray:
        """For the kernels."""
        slope_K_Pa = 1.0 / self.stress_slope_Pa_K
        return _bands(
            (self.austenite_start_C, self.austenite_finish_C, slope_K_Pa),
            (self.martensite_start_C, self.martensite_finish_C, slope_K_Pa),
        )


@dataclass(frozen=True, slots=True)
class Logistic:
    """A share of the wire whose transformation temperatures are distributed logistically."""

    weight: float
    centre_C: float  #: at zero stress
    width_K: float  #: 10 to 90 % takes 4.39 of it
    slope_Pa_K: float


@dataclass(frozen=True, slots=True)
class Measured:
    """A distribution of transformation temperatures for each direction; the weights of each add up to one."""

    heating: tuple[Logistic, ...]
    cooling: tuple[Logistic, ...]

    family = MEASURED

    def bands(self) -> np.ndarray:
        """For the kernels; starts and finishes are the tenth and the ninetieth percent of the steepest part."""
        ends = []
        for parts, sense in ((self.heating, 1.0), (self.cooling, -1.0)):
            core = _steepest(parts)
            half_K = 2.197 * core.width_K * sense
            ends.append((core.centre_C - half_K, core.centre_C + half_K, 1.0 / core.slope_Pa_K))
        bands = _bands(*ends)
        for row, parts in ((HEATING, self.heating), (COOLING, self.cooling)):
            if len(parts) > PARTS or abs(sum(p.weight for p in parts) - 1.0) > 1e-6:
                raise ValueError(f"a distribution has up to {PARTS} parts, and weights that add up to 1")
            columns = [(p.weight, p.centre_C, p.width_K, 1.0 / p.slope_Pa_K) for p in parts]
            columns += [(0.0, 0.0, 1.0, 0.0)] * (PARTS - len(parts))
            bands[row, FIRST_PART:FIRST_KNOT] = np.ravel(columns)
        return bands

    def mapped(
        self, heating: tuple[float, float], cooling: tuple[float, float], slope_Pa_K: float | None = None
    ) -> Measured:
        """The same shape elsewhere: each temperature T becomes shift + scale · T.

        ``heating`` and ``cooling`` are (shift [°C], scale); with ``slope_Pa_K`` the steepest part of cooling has that
        slope, and all others in proportion.
        """
        slope = 1.0 if slope_Pa_K is None else slope_Pa_K / _steepest(self.cooling).slope_Pa_K

        def moved(parts: tuple[Logistic, ...], shift_C: float, scale: float) -> tuple[Logistic, ...]:
            return tuple(
                Logistic(
                    weight=p.weight,
                    centre_C=shift_C + scale * p.centre_C,
                    width_K=scale * p.width_K,
                    slope_Pa_K=slope * p.slope_Pa_K,
                )
                for p in parts
            )

        return Measured(moved(self.heating, *heating), moved(self.cooling, *cooling))

    def quantiles_C(self, share: float) -> tuple[float, float]:
        """Temperatures at zero stress below which this share of martensite is left on heating, or has formed on
        cooling."""
        bands = self.bands()
        return _quantile_C(bands, HEATING, share), _quantile_C(bands, COOLING, share)


def _steepest(parts: tuple[Logistic, ...]) -> Logistic:
    return max(parts, key=lambda p: p.weight / p.width_K)


@dataclass(frozen=True, slots=True)
class SmoothHardening:
    """Lagoudas' transition functions between four temperatures at zero stress."""

    austenite_start_C: float
    austenite_finish_C: float
    martensite_start_C: float
    martensite_finish_C: float
    heating_slope_Pa_K: float
    cooling_slope_Pa_K: float
    heating_exponents: tuple[float, float]  #: at full martensite's side less n, at austenite's m; 1 is straight
    cooling_exponents: tuple[float, float]

    family = SMOOTH_HARDENING

    def bands(self) -> np.ndarray:
        """For the kernels."""
        bands = _bands(
            (self.austenite_start_C, self.austenite_finish_C, 1.0 / self.heating_slope_Pa_K),
            (self.martensite_start_C, self.martensite_finish_C, 1.0 / self.cooling_slope_Pa_K),
        )
        bands[HEATING, FIRST_KNOT:] = hardening_table(*self.heating_exponents)
        bands[COOLING, FIRST_KNOT:] = hardening_table(*self.cooling_exponents)
        return bands


@dataclass(frozen=True, slots=True)
class Activated:
    """Grains, each with a barrier on heating and one on cooling: the percentiles of a distribution, rank by rank.

    Beyond its barrier by ``x`` [K] what of a grain has not transformed yet does at a rate of 1 / (exp(−x / per) /
    attempts + crossing).  Under stress all barriers rise as the steepest part of the distribution does.
    """

    barriers: Measured
    per_K: float  #: so much hotter it crosses e times as often
    attempts_1_s: float  #: at the barrier
    crossing_s: float  #: the least time that it takes to go through a grain; above 0

    family = ACTIVATED

    def bands(self) -> np.ndarray:
        """For the kernels."""
        bands = self.barriers.bands()
        edges = 1.0 / (1.0 + np.exp(np.linspace(_GRAINS_OUT_TO, -_GRAINS_OUT_TO, GRAINS + 1)))
        edges[0], edges[-1] = 0.0, 1.0
        bands[HEATING, _FIRST_SHARE : _FIRST_SHARE + GRAINS] = np.diff(edges)
        for i, rank in enumerate(0.5 * (edges[:-1] + edges[1:])):
            bands[:, FIRST_GRAIN + i] = self.barriers.quantiles_C(rank)
        bands[HEATING, [_PER_K, _ATTEMPTS_1_s, _CROSSING_s]] = self.per_K, self.attempts_1_s, self.crossing_s
        return bands


Kinetics = LiangRogers | Measured | SmoothHardening | Activated


def hardening_way(fraction: np.ndarray, n: float, m: float) -> np.ndarray:
    """How far from the hot end of a band to the cold one the fraction is reached, 0 to 1: ½ [1 + ξ^n − (1 − ξ)^m]."""
    return 0.5 * (1.0 + fraction**n - (1.0 - fraction) ** m)


@lru_cache(maxsize=8)
def hardening_table(n: float, m: float) -> np.ndarray:
    """Fraction at equal steps from the cold end to the hot end; exponents within 0 (exclusive) to 1."""
    if not (0.0 < n <= 1.0 and 0.0 < m <= 1.0):
        raise ValueError(f"hardening exponents {n:g} and {m:g}: above 0 and at most 1 are wanted")
    # Close to both ends the way goes as a small power of the fraction: space the knots by it.
    near = np.geomspace(1e-30, 1e-3, 600)
    knots = np.concatenate(([0.0], near, np.linspace(1e-3, 1.0 - 1e-3, 4001)[1:-1]))
    low = hardening_way(knots, n, m)
    left = np.concatenate((near[::-1], [0.0]))  # what is missing to 1, kept apart so that it is not rounded away
    high = 0.5 * (1.0 + (1.0 - left) ** n - left**m)
    way = np.concatenate((low, high))
    fraction = np.concatenate((knots, 1.0 - left))
    table = np.interp(np.linspace(1.0, 0.0, TABLE + 1), way, fraction)
    table[0], table[-1] = 1.0, 0.0  # not what is left of them after rounding
    table.flags.writeable = False
    return table


@jit
def half_cosine(temperature_C, finish_C, start_C):
    """Liang and Rogers' cosine: 1 at or below ``finish_C``, 0 at or above ``start_C`` (eq. 2.5–2.8)."""
    if temperature_C <= finish_C:
        return 1.0
    if temperature_C >= start_C:
        return 0.0
    return 0.5 * (1.0 + cos(pi * (temperature_C - finish_C) / (start_C - finish_C)))


@jit
def logistic(temperature_C, centre_C, width_K):
    """1 far below the centre, 0 far above."""
    over = (temperature_C - centre_C) / width_K
    rest = exp(-abs(over))
    return (rest if over > 0.0 else 1.0) / (1.0 + rest)


@inlined
def distribution(bands, row, temperature_C, stress_Pa):
    """Share whose transformation temperature lies above ``temperature_C``."""
    share = 0.0
    for i in range(FIRST_PART, FIRST_KNOT, PART_COLUMNS):
        centre_C = bands[row, i + CENTRE_C] + stress_Pa * bands[row, i + PART_SLOPE_K_Pa]
        share += bands[row, i + WEIGHT] * logistic(temperature_C, centre_C, bands[row, i + WIDTH_K])
    return share


@jit
def _quantile_C(bands, row, share):
    """Temperature at zero stress above which this share transforms."""
    low_C = -300.0
    high_C = 500.0
    for _ in range(60):
        middle_C = 0.5 * (low_C + high_C)
        if distribution(bands, row, middle_C, 0.0) > share:
            low_C = middle_C
        else:
            high_C = middle_C
    return low_C


@inlined
def hardened(bands, row, temperature_C, cold_C, hot_C):
    """Lagoudas' fraction between the two ends of a band."""
    at = (temperature_C - cold_C) / (hot_C - cold_C) * TABLE
    if at <= 0.0:
        return 1.0
    if at >= TABLE:
        return 0.0
    i = int(at)
    low = bands[row, FIRST_KNOT + i]
    return low + (at - i) * (bands[row, FIRST_KNOT + i + 1] - low)


@inlined
def band_fraction(family, bands, row, temperature_C, stress_Pa):
    """Fraction of martensite on the outer loop: ``u`` of the row ``HEATING``, ``v`` of ``COOLING``."""
    if family in (MEASURED, ACTIVATED):
        return distribution(bands, row, temperature_C, stress_Pa)
    t = temperature_C - stress_Pa * bands[row, SLOPE_K_Pa]
    cold_C = bands[row, START_C] if row == HEATING else bands[row, FINISH_C]
    hot_C = bands[row, FINISH_C] if row == HEATING else bands[row, START_C]
    if family == LIANG_ROGERS:
        return half_cosine(t, cold_C, hot_C)
    return hardened(bands, row, t, cold_C, hot_C)


def new_memory(fraction: float, family: int = LIANG_ROGERS) -> np.ndarray:
    """The memory of a transformation that stands, fully cooled (1) or fully heated (0)."""
    if family == ACTIVATED:
        return np.full(GRAINS, fraction)
    memory = np.zeros(_MEMORY)
    memory[[DIRECTION, LEAST, OTHER]] = (-1.0 if fraction == 1.0 else 1.0), 0.0, 1.0
    return memory


@jit
def _remember(memory, at, turns, way, left):
    """Keep a turn in the list that begins ``at``; the outermost of too many is forgotten.  How many there are now."""
    if turns == DEPTH:
        for i in range(at, at + DEPTH - 1):
            memory[i] = memory[i + 1]
            memory[i + DEPTH] = memory[i + DEPTH + 1]
        turns -= 1
    memory[at + turns] = way
    memory[at + DEPTH + turns] = left
    return turns + 1


@jit
def _left_after(memory, at, turns, least, left, way):
    """What is left to transform once ``way`` is left of the band, and how many turns are still remembered."""
    if way <= 0.0:
        return 0.0, 0
    while turns > 0 and way <= memory[at + turns - 1]:
        turns -= 1
        least = float(memory[at + turns])
        left = float(memory[at + DEPTH + turns])
    end_way = float(memory[at + turns - 1]) if turns > 0 else 0.0
    end = float(memory[at + DEPTH + turns - 1]) if turns > 0 else 0.0
    if least > end_way:
        left = end + (left - end) * (way - end_way) / (least - end_way)
    return left, turns


@jit
def transform(memory, fraction, u, v, commit):
    """Fraction of the low-temperature phase after its driving coordinates became ``u`` and ``v``.

    ``u`` falls from 1 to 0 over the heating band, ``v`` rises from 0 to 1 over the cooling band.
    From any reversal (u_0 = 1 or v_0 = 0, ξ_0) the fraction is Liang and Rogers': ξ_0·u on heating,
    (1 − ξ_0)·v + ξ_0 on cooling.  Two things are added.  ξ_0 is taken anew only when the reverse
    transformation has moved, not when the temperature merely turned; and a minor loop closes
    where it began and is then forgotten (return-point memory).  So dithering does not ratchet.

    Cooling is the mirror of heating: there ``1 − v`` is the way that is left, and ``1 − ξ`` what is left to transform.
    ``memory`` changes only if ``commit``.
    """
    heating = memory[DIRECTION] > 0.0
    least = float(memory[LEAST])
    other = float(memory[OTHER])
    way = u if heating else 1.0 - v
    back = 1.0 - v if heating else u
    left = fraction if heating else 1.0 - fraction
    here = HEATING_TURNS if heating else COOLING_TURNS
    there = COOLING_TURNS if heating else HEATING_TURNS
    at = _HEATING_LIST if heating else _COOLING_LIST
    turns = int(memory[here])
    turns_there = int(memory[there])
    if way >= least:
        if back >= other - _EPS:
            if commit and back > other:
                memory[OTHER] = back
            return fraction
        if least > 0.0:
            turns = _remember(memory, at, turns, least, left) if commit else turns + 1
        heating = not heating
        least, other = other, way
        way, back = back, way
        left = 1.0 - left
        here, there = there, here
        turns, turns_there = turns_there, turns
        at = _HEATING_LIST if heating else _COOLING_LIST
    left, still = _left_after(memory, at, turns, least, left, way)
    if commit:
        memory[DIRECTION] = 1.0 if heating else -1.0
        memory[LEAST] = way
        memory[OTHER] = max(other, back)
        memory[here] = still
        memory[there] = max(turns_there - (turns - still), 0) if way > 0.0 else 0
    return left if heating else 1.0 - left


@jit
def settled(bands, memory, temperature_C, stress_Pa, shift):
    """Fraction of martensite of grains that came from the hot end and have no barrier left to cross; ``memory`` is what
    of each is martensite."""
    fraction = 0.0
    for i in range(GRAINS):
        barrier_C = bands[COOLING, FIRST_GRAIN + i] + stress_Pa * bands[COOLING, SLOPE_K_Pa] + shift.cooling_K
        memory[i] = 1.0 if temperature_C < barrier_C else 0.0
        fraction += bands[HEATING, _FIRST_SHARE + i] * memory[i]
    return fraction


@jit
def crossed(bands, memory, temperature_C, stress_Pa, shift, step_s):
    """Fraction of martensite after so long at a temperature and a stress; ``memory`` is what of each grain is it."""
    per_K, attempts_1_s, crossing_s = bands[HEATING, _PER_K], bands[HEATING, _ATTEMPTS_1_s], bands[HEATING, _CROSSING_s]
    hot_K = temperature_C - stress_Pa * bands[HEATING, SLOPE_K_Pa] - shift.heating_K
    cold_K = temperature_C - stress_Pa * bands[COOLING, SLOPE_K_Pa] - shift.cooling_K
    fraction = 0.0
    for i in range(GRAINS):
        to_austenite_1_s = 1.0 / (
            exp(min((bands[HEATING, FIRST_GRAIN + i] - hot_K) / per_K, 300.0)) / attempts_1_s + crossing_s
        )
        to_martensite_1_s = 1.0 / (
            exp(min((cold_K - bands[COOLING, FIRST_GRAIN + i]) / per_K, 300.0)) / attempts_1_s + crossing_s
        )
        both_1_s = to_austenite_1_s + to_martensite_1_s
        memory[i] += (to_martensite_1_s / both_1_s - memory[i]) * -expm1(-step_s * both_1_s)
        fraction += bands[HEATING, _FIRST_SHARE + i] * memory[i]
    return fraction


@inlined
def martensite_after(family, bands, memory, fraction, temperature_C, stress_Pa, shift, commit):
    """Fraction of martensite after the wire came to a temperature and a stress; ``memory`` changes only if
    ``commit``.

    An activated one takes time (:func:`crossed`): at once it changes nothing, and to be committed is to settle.
    """
    if family == ACTIVATED:
        return settled(bands, memory, temperature_C, stress_Pa, shift) if commit else fraction
    heating = memory[DIRECTION] > 0.0
    hot_C = temperature_C - shift.heating_K
    cold_C = temperature_C - shift.cooling_K
    own = band_fraction(family, bands, HEATING if heating else COOLING, hot_C if heating else cold_C, stress_Pa)
    if not commit and family != SMOOTH_HARDENING:
        way = own if heating else 1.0 - own
        if way < memory[LEAST]:  # it goes on as it went: the other band has no say, and need not be known
            at = _HEATING_LIST if heating else _COOLING_LIST
            turns = int(memory[HEATING_TURNS if heating else COOLING_TURNS])
            left = fraction if heating else 1.0 - fraction
            left, _ = _left_after(memory, at, turns, float(memory[LEAST]), left, way)
            return left if heating else 1.0 - left
    other = band_fraction(family, bands, COOLING if heating else HEATING, cold_C if heating else hot_C, stress_Pa)
    u = own if heating else other
    v = other if heating else own
    if family == SMOOTH_HARDENING:
        return max(v, min(fraction, u))
    return transform(memory, fraction, u, v, commit)


def follow(kinetics: Kinetics, temperature_C: np.ndarray, stress_Pa: np.ndarray) -> np.ndarray:
    """Fraction of martensite (n,) along temperatures and stresses (n,), of a wire that came from the hot end."""
    fraction = np.empty(len(temperature_C))
    _follow(kinetics.family, kinetics.bands(), new_memory(0.0), temperature_C, stress_Pa, fraction)
    return fraction


@jit
def _follow(family, bands, memory, temperature_C, stress_Pa, fraction):
    now = 0.0
    shift = Shift(0.0, 0.0)
    for i in range(len(temperature_C)):
        now = martensite_after(family, bands, memory, now, temperature_C[i], stress_Pa[i], shift, True)
        fraction[i] = now


@jit
def outer(family, bands, row, temperature_C, stress_Pa, fraction):
    """Fill ``fraction`` (n,) with that of a band at temperatures (n,), under one stress."""
    for i in range(len(temperature_C)):
        fraction[i] = band_fraction(family, bands, row, temperature_C[i], stress_Pa)
