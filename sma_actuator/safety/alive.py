"""A channel is believed as long as it behaves as it has: what it has shown in this run says what is improbable of it.

Three ways to stand still that no single reading shows: digits repeat far more often than they have (one block comes
again and again with new times, or a few values in turn); a channel is quieter than it has ever been (its source stands,
and only a converter's dither is left); the load does not change any more when the wire moves, where it always has.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from math import inf, isfinite, log, nan

from sma_actuator.base.jit import Floats, floats, jit

RARE = 1e-12  #: what is less probable than this, by what was seen before, is not taken for chance
SEEN = 200  #: readings that say what is probable
OFTEN = 0.3  #: of the readings that should have differed repeat, where something stands
WINDOW = 100  #: readings over which a channel is called quiet
#: Times its noise by which a channel may move over a window that shows how noisy it is: a load that is held on a spring
#: creeps.  Motion that is no quicker adds a hundredth to second differences.
CREEPS = 5.0
WINDOWS = 2  #: of a channel that stood, before the latest, which may hold the beginning of the end
SWING = 0.3  #: share of the full stroke that is a motion
ALIKE = 2.0  #: motions are alike whose stiffness differs by less than this factor
SWINGS = 3  #: so many that are alike say what a load does
FOLLOWS = 0.1  #: share of the change of load that belongs to a motion below which the load stands
STOOD = 2  #: motions, to and fro, that it has not followed
_IMPROBABLE = -log(RARE)
LATELY = 20  #: readings within which a hand hangs another load on a wire


@dataclass(slots=True)
class Repeats:
    """Whether readings are like the one before far more often than they have been: a cumulative sum of
    log-likelihoods."""

    _last: tuple[float, ...] = ()
    _seen: int = 0
    _equal: int = 0
    _sum: float = 0.0

    def step(self, *values: float) -> bool:
        """Whether that is no chance any more."""
        equal, self._last = values == self._last, values
        if self._seen >= SEEN and (equal or self._sum > 0.0):  # one that differs only takes from a sum
            usual = (self._equal + 1) / (self._seen + 2)
            often = 1.0 - (1.0 - OFTEN) * (1.0 - usual)
            self._sum = max(0.0, self._sum + log(often / usual if equal else (1.0 - often) / (1.0 - usual)))
        self._seen += 1
        self._equal += equal
        return self._sum > _IMPROBABLE


#: What is remembered of a channel's noise beside its last values and their second differences: how many there are,
#: how many since the last window that counted, the level of that, the least of those before it, how many those are; and
#: how many running came while nothing moved what it measures.
_SEEN, _FRESH, _LATEST, _LEAST, _BEFORE, _RESTED = range(6)
_QUARTER = WINDOW // 4


@jit
def _range_of_quarters(recent: Floats) -> float:
    """How far apart the means of four quarters are: of noise alone less than the noise."""
    low, high = inf, -inf
    for begin in range(0, WINDOW, _QUARTER):
        mean = sum(recent[begin : begin + _QUARTER]) / _QUARTER
        low, high = min(low, mean), max(high, mean)
    return high - low


@jit
def _push(values: Floats, newest: float) -> None:
    """Let the oldest go.  One by one: to compile a slice that is put into another takes two seconds."""
    last = len(values) - 1
    for i in range(last):
        values[i] = values[i + 1]
    values[last] = newest


@jit
def _noise(recent: Floats, steps: Floats, state: Floats, value: float, rests: bool) -> float:
    """See :meth:`Liveliness.step`; ``recent`` and ``steps`` end with the newest."""
    if state[_SEEN] >= 2.0:
        _push(steps, abs(value - 2.0 * recent[-1] + recent[-2]))
    _push(recent, value)
    state[_SEEN] += 1.0
    state[_FRESH] += 1.0
    state[_RESTED] = state[_RESTED] + 1.0 if rests else 0.0
    if state[_SEEN] < WINDOW:
        return nan
    level = sum(steps) / (WINDOW - 2)
    share = level / state[_LEAST] if state[_BEFORE] >= WINDOWS else nan
    own = min(state[_FRESH], state[_RESTED]) >= WINDOW and level > 0.0
    if own and _range_of_quarters(recent) <= CREEPS * level:
        state[_FRESH] = 0.0
        if isfinite(state[_LATEST]):
            state[_LEAST] = min(state[_LEAST], state[_LATEST])
            state[_BEFORE] += 1.0
        state[_LATEST] = level
    return share


class Liveliness:
    """How noisy a channel is, against the least that it has been by itself: while nothing moved what it measures."""

    __slots__ = ("_recent", "_state", "_steps")

    def __init__(self) -> None:
        self._recent = floats(WINDOW)
        self._steps = floats(WINDOW - 2)  #: second differences: what is left of a steady motion is noise
        self._state = floats(6)
        self._state[_LATEST], self._state[_LEAST] = nan, inf

    def step(self, value: float, rests: bool = True) -> float:
        """Share of the least noise that the last readings have; NaN until both are known.  ``rests``: nothing has moved
        what it measures since the reading before."""
        return _noise(self._recent, self._steps, self._state, value, rests)


_NOWHERE = (inf, -inf, inf, -inf)


@dataclass(slots=True)
class Following:
    """What the load does when the wire moves, from one turn of the motion to the next.

    A load that changes by more than the wire's motion can make it is another load: what a load does is seen anew.  One
    whose cell has died does not change any more.  One that another wire pulls on, as on a joint, never does the same
    three times.
    """

    _from: tuple[float, float] = (nan, nan)  #: place and load where this motion began
    _to: tuple[float, float] = (nan, nan)  #: and the farthest that it has come
    _stiffness: list[float] = field(default_factory=list)  #: of the last motions
    #: Motions running that the load has not followed: way, change of load expected, and seen.
    _stood: list[tuple[float, float, float]] = field(default_factory=list)
    _lately: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=LATELY))  #: places and loads
    #: Between which places and loads it has been since it was another load.
    _within: tuple[float, float, float, float] = _NOWHERE
    carries: bool = False  #: the wire has moved, and the load has not changed: it is a weight
    changed: bool = False  #: with the last reading: it does not do what three motions have shown

    def step(self, place_m: float, load_N: float, swing_m: float, noise_N: float) -> str:
        """At the end of a motion, how the load has not followed it and the one before; else ""."""
        self.changed = False
        if not isfinite(place_m):
            self.pause()
            return ""
        self._lately.append((place_m, load_N))
        if self._is_another(swing_m, noise_N):
            self.changed = isfinite(self.stiffness_N_m)  # else nobody knows yet what it does
            self._stiffness, self._stood, self._within = [], [], _NOWHERE
            self._lately.clear()
            self.pause()
        low_m, high_m, low_N, high_N = self._within
        if not (low_m <= place_m <= high_m and low_N <= load_N <= high_N):
            low_m, high_m = min(low_m, place_m), max(high_m, place_m)
            low_N, high_N = min(low_N, load_N), max(high_N, load_N)
            self._within = low_m, high_m, low_N, high_N
        self.carries = high_m - low_m >= swing_m and high_N - low_N <= noise_N
        if not isfinite(self._from[0]):
            self._from = self._to = (place_m, load_N)
        way_m = self._to[0] - self._from[0]
        if (place_m - self._to[0]) * way_m >= 0.0:
            self._to = (place_m, load_N)
            return ""
        if abs(place_m - self._to[0]) < 0.25 * swing_m:
            return ""  # it has not turned yet
        change_N, slack = self._to[1] - self._from[1], min(self._to[1], self._from[1]) < noise_N
        self._from, self._to = self._to, (place_m, load_N)
        if abs(way_m) < swing_m or slack:
            return ""
        expected_N = self.stiffness_N_m * way_m
        followed = abs(change_N / expected_N) if expected_N else nan  # one that changes the other way is alive
        self.changed = change_N * expected_N < 0.0 and abs(change_N) > noise_N
        if abs(expected_N) > 2.0 * noise_N and followed < 1.0 / ALIKE:
            self._stood = [*self._stood, (way_m, expected_N, change_N)] if followed < FOLLOWS else []
        else:  # what has stood still is not what is usual
            self._stood = []
            #: a change within the noise is none
            self._stiffness = [*self._stiffness[1 - SWINGS :], change_N / way_m if abs(change_N) > noise_N else 0.0]
        if len(self._stood) < STOOD:
            return ""
        return " and ".join(
            f"{change_N:+.2g} N where {expected_N:+.2g} N belong to a motion of {way_m * 1e3:+.2g} mm"
            for way_m, expected_N, change_N in self._stood
        )

    @property
    def stiffness_N_m(self) -> float:
        """The least that the last motions have shown alike, negative where the wire pulls as it contracts, 0 where it
        does nothing else than carry; NaN where they have not, or where the load grows with the length."""
        shown = self._stiffness
        if len(shown) < SWINGS or min(shown) < ALIKE * max(shown):
            return nan
        return max(shown)

    def _is_another(self, swing_m: float, noise_N: float) -> bool:
        """Whether the load has lately changed by more than the last motions have shown of it, over the way that the
        wire went; what was within the noise may be as steep as that."""
        change_N = abs(self._lately[-1][1] - self._lately[0][1])
        if not change_N > noise_N or not self._stiffness:
            return False
        places_m = [place_m for place_m, _ in self._lately]
        steepest_N_m = max(noise_N / swing_m, *map(abs, self._stiffness))
        return change_N > noise_N + ALIKE * steepest_N_m * (max(places_m) - min(places_m))

    def pause(self) -> None:
        """The wire has no place now."""
        self._from = self._to = (nan, nan)


@dataclass(slots=True)
class Leaps:
    """Whether load and displacement leap together: another load stretches the wire, or lets it go, in the same reading.

    How far needs no model: by more than the wire's motion has lately changed from one reading to the next.
    """

    _load_N: float = nan
    _place_m: float = nan
    _way_m: float = nan  #: from the place before
    _lately_m: deque[float] = field(default_factory=lambda: deque(maxlen=LATELY))  #: how much such ways have differed
    _since: int = LATELY  #: readings

    def step(self, load_N: float, place_m: float, noise_N: float) -> None:
        """Take in a reading; ``place_m`` is that of the displacement sensor, NaN without one."""
        change_N, way_m = load_N - self._load_N, place_m - self._place_m
        leapt_m = way_m - self._way_m
        both = abs(change_N) > noise_N and abs(leapt_m) > max(self._lately_m, default=inf)
        self._since = 0 if both and leapt_m * change_N > 0.0 else self._since + 1
        self._load_N, self._place_m, self._way_m = load_N, place_m, way_m
        if isfinite(leapt_m):
            self._lately_m.append(abs(leapt_m))

    @property
    def together(self) -> bool:
        """Whether they have lately."""
        return self._since < LATELY


@dataclass(slots=True)
class LoadAlive:
    """What is to be seen of a load cell's life."""

    repeats: Repeats = field(default_factory=Repeats)
    noise: Liveliness = field(default_factory=Liveliness)
    following: Following = field(default_factory=Following)
    leaps: Leaps = field(default_factory=Leaps)
    _told_A: float = nan
    _is_suspect: bool = False
    _contradicted: bool = False  #: with the reading before

    def quiet(self, value_V: float, told_A: float) -> float:
        """Share of the least noise of its own that the channel has lately; NaN until both are known.

        A load moves with every step of the current that the supply is told, but for that of a weight.
        """
        stays, self._told_A = told_A == self._told_A, told_A
        return self.noise.step(value_V, stays or self.following.carries)

    def is_suspect(self, contradicted: bool) -> bool:
        """Whether the load has changed by itself, and the displacement did not leap with it; what it does is not known
        anew, and the displacement sensor did not contradict before."""
        before, self._contradicted = self._contradicted, contradicted
        if self.following.changed and not (before or self.leaps.together):
            self._is_suspect = True
        elif self._is_suspect and isfinite(self.following.stiffness_N_m):
            self._is_suspect = False
        return self._is_suspect
