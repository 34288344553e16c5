"""Two measurements of one current, or of one voltage: what they differ by is noted when it first flows, and must stay.

The supply holds a current, the DAQ measures it over the sense resistor.  Both have errors of scale and zero, which
stand still; what changes between them is a drift.  So a difference is held against the one that was noted, over a
second that averages the noise, and over some.  One may be behind the other: what it shows then is what was so long
ago, by the clock or by readings.  So each reading is held against what was at each such time, and the difference is
known but for how much its mean depends on that: where nothing moves, exactly, however seldom or irregularly the
readings come.

Both measure a voltage too, the supply with its own leads in it: what these drop is on a straight line over current.

A reading is a row of numbers, and what is remembered lies in three rows of them, so that a kernel does a step.
"""

from __future__ import annotations

from math import inf, isfinite, nan, sqrt

from sma_actuator.base.jit import Floats, floats, jit

#: Over which both are averaged: a second averages the noise; a wire that is moved wants longer, up to some of its
#: cycles, and what drifts quickly is seen in the shortest that suffices.
WINDOWS_s = (1.0, 2.0, 4.0, 8.0)
WINDOW_s = WINDOWS_s[0]
LAG_s = 0.2  #: that the DAQ may be behind the supply, and so much later than usual may a reading come
METER_LAG_s = 0.5  #: that either may be behind the other where the supply measures: slow ones do so twice a second
#: Parts of the lag that are looked at, half a period of the usual loop each: where its readings come a little early or
#: late, one of whole periods is now that many readings ago, now one less.
_LAGS = 8
_BEHIND = 2  #: readings that it may be behind where that takes longer
FLOOR_A = 1e-3  #: the step of the coarsest supplies that may be driven
FLOOR_V = 10e-3  #: by how much a supply's voltmeter may wander, beside its scale and the step of its digits
ZERO_V = 50e-3  #: its zero may be off by so much; that stands still
#: Standard deviations of what is late at random, where that is known by what comes early or late: by chance one mean in
#: a million is farther off.  One has to do for what each reading is late by in any case, of a meter with a time of its
#: own, or of a DAQ whose readings come on time: a command comes a little sooner or later before the reading, within the
#: supply's rise or fall, which take unequal times.  With more nothing is left of a slow drift while the wire moves.
CHANCE = 5.0
SCALE = 0.015  #: what the scales of both may differ by, beside a drift
STANDS_A = 0.25 * FLOOR_A  #: by how much a current that stands differs in the DAQ's eyes
_STEADY = 3  #: readings that show it
_ROUNDING_s = 1e-6
WIDER = 1.1  #: a current that is so much beyond those that were noted is noted as well

#: What a row holds of a reading: its time, and two numbers of which each may belong to a later reading;
_TIME, _ONE, _OTHER = 0, 1, 2
#: what means are taken of: the current, where that is another quantity, the DAQ's, the square of by how much the
#: difference may be off since one is late by a reading, whether it is not the one before, shown again;
_MEAN, _LATE, _NEW = 3, 5, 6
#: and what the difference is, now and where one of the two is of each lag ago, by the clock and by readings.
_BEEN, _EACH = 7, _LAGS + 1 + _BEHIND
_ROW = _BEEN + 2 * _EACH
_MEANS = _ROW - _MEAN
#: What is remembered beside the rows: when the last reading came, the time between the last two, the share of it by
#: which the last came early or late, since when there is no gap, how many rows there are and how many noted currents;
_LAST_s, _USUAL_s, _ODD, _SINCE_s, _ROWS, _NOTED = range(6)
#: and of each window its first row and the sums of what means are taken of.
_FIRST = tuple(6 + (1 + _MEANS) * window for window in range(len(WINDOWS_s)))
_SUMS = tuple(first + 1 for first in _FIRST)
_STATE = _SUMS[-1] + _MEANS
#: Of a noted current: itself, by how much it was above, and how exactly that is known.
_POINT = 3
#: What two measurements have of their own.
_LAG, _FLOOR, _ZERO, _STANDS, _ODD_COUNTS, _KIND = range(6)
#: Noted currents, and at first rows, that there is room for; each of the former is a tenth beyond the next: from 1 nA
#: to 10 A they are 242.
_ROOM = 256


@jit
def _begin(state: Floats, now_s: float) -> None:
    """Take note of when a reading comes; where that has nothing to do with what was, since who stood still meanwhile is
    not known, begin anew."""
    apart_s = now_s - state[_LAST_s]
    state[_LAST_s] = now_s
    if state[_ROWS] > 0.0 and 0.0 <= apart_s <= min(state[_USUAL_s] + LAG_s, WINDOW_s):
        state[_ODD] = min(abs(apart_s - state[_USUAL_s]) / max(state[_USUAL_s], _ROUNDING_s), 1.0)
        state[_USUAL_s] = apart_s
        return
    state[_ROWS], state[_SINCE_s] = 0.0, now_s
    for k in range(_FIRST[0], _STATE):
        state[k] = 0.0


@jit
def _look_back(rows: Floats, last: int, lag_s: float, from_one: float, from_other: float) -> None:
    """What each is below what it is taken from, at each lag of the last row."""
    row, at = _ROW * last, last
    for lag in range(_EACH):
        if lag <= _LAGS:
            then_s = rows[row + _TIME] - lag_s * lag / _LAGS - _ROUNDING_s
            while at > 0 and rows[_ROW * (at - 1) + _TIME] >= then_s:
                at -= 1
        else:
            at = max(last - (lag - _LAGS), 0)
        rows[row + _BEEN + lag] = from_one - rows[_ROW * at + _ONE]
        rows[row + _BEEN + _EACH + lag] = from_other - rows[_ROW * at + _OTHER]


@jit
def _late(rows: Floats, last: int, is_new: bool) -> float:
    """By how much the last row may be off since it is late by a reading; one that is shown again is what was held."""
    late, lags = 0.0, _LAGS + 2 if is_new else _EACH - 1
    for one in (_ROW * last + _BEEN, _ROW * last + _BEEN + _EACH):
        low, high = rows[one], rows[one]
        for k in range(one + (_LAGS + 1 if is_new else 1), one + lags):
            low, high = min(low, rows[k]), max(high, rows[k])
        late = max(late, high - low)
    return late


@jit
def _add(rows: Floats, state: Floats, last: int) -> None:
    """Let all windows end with the last row."""
    row = _ROW * last
    state[_ROWS] = last + 1.0
    for window in range(len(WINDOWS_s)):
        first = int(state[_FIRST[window]])
        for k in range(_MEANS):
            state[_SUMS[window] + k] += rows[row + _MEAN + k]
        while rows[row + _TIME] - rows[_ROW * first + _TIME] >= WINDOWS_s[window]:
            for k in range(_MEANS):
                state[_SUMS[window] + k] -= rows[_ROW * first + _MEAN + k]
            first += 1
        state[_FIRST[window]] = first


@jit
def _among(state: Floats, window: int) -> tuple[float, float, float, float]:
    """Of a window the means of both quantities, and that of what may be late and how exactly that is known: all
    readings may be late, each by something else at random."""
    sums = _SUMS[window]
    count = state[_ROWS] - state[_FIRST[window]]
    low, high = inf, -inf
    for k in range(_BEEN - _MEAN, _MEANS):
        mean = state[sums + k] / count
        low, high = min(low, mean), max(high, mean)
    late, new = state[sums + _LATE - _MEAN] / count, state[sums + _NEW - _MEAN] / count
    at_random = sqrt(max(0.0, late) / max(1.0, new * count))
    return state[sums] / count, state[sums + 1] / count, 0.5 * (low + high), 0.5 * (high - low + at_random)


@jit
def _judge(
    state: Floats, noted: Floats, current: float, above: float, vague: float, drift: float, zero: float
) -> tuple[float, float]:
    """What the difference at a current has changed by, and what it may: between two currents that were noted on a
    straight line, beyond them the change that is worst.

    There the difference may be more by a scale of what is beyond, or, where a meter has a ``zero`` error, by the
    resistance of leads that drop so much at the noted current, but for that.  What is within what it may is noted,
    where the current is new, or where it is known more exactly than from those that were noted.
    """
    count = int(state[_NOTED])
    change, known, below, beyond, is_near, exactest = nan, nan, -1, -1, False, inf
    for i in range(count):
        at, was, its_vague = noted[_POINT * i], noted[_POINT * i + 1], noted[_POINT * i + 2]
        if at < current:
            if below < 0 or at > noted[_POINT * below]:
                below = i
        elif beyond < 0 or at < noted[_POINT * beyond]:
            beyond = i
        if at / WIDER <= current <= at * WIDER:
            is_near, exactest = True, min(exactest, its_vague)
        steep = (abs(was) + zero) / at if zero > 0.0 else SCALE
        its_change, its_known = above - was, its_vague + steep * abs(current - at)
        if i == 0 or abs(its_change) - its_known > abs(change) - known:
            change, known = its_change, its_known
    if below >= 0 and beyond >= 0:
        low, high = _POINT * below, _POINT * beyond
        way = (current - noted[low]) / (noted[high] - noted[low])
        change = above - (noted[low + 1] + way * (noted[high + 1] - noted[low + 1]))
        known = noted[low + 2] + way * (noted[high + 2] - noted[low + 2])
    allowed = known + drift + vague
    if not vague <= drift or abs(change) > allowed:
        return change, allowed
    is_new = not is_near and (below < 0 or beyond < 0)
    if is_new or (vague < 0.5 * min(known, exactest) and abs(change) <= vague + known):
        kept = 0
        for i in range(count):
            if not noted[_POINT * i] / WIDER <= current <= noted[_POINT * i] * WIDER:
                for k in range(_POINT):
                    noted[_POINT * kept + k] = noted[_POINT * i + k]
                kept += 1
        if kept < _ROOM:
            noted[_POINT * kept], noted[_POINT * kept + 1], noted[_POINT * kept + 2] = current, above, vague
            state[_NOTED] = kept + 1.0
    return change, allowed


@jit
def _steady(rows: Floats, state: Floats, stands: float) -> tuple[bool, float, float]:
    """Whether what is the first to flow stands within so much in the eyes of both (it may flow for a moment only); the
    supply's, and by how much the DAQ's is above it."""
    end = int(state[_ROWS])
    if end < _STEADY or rows[_ROW * (end - 1) + _TIME] - state[_SINCE_s] < LAG_s - _ROUNDING_s:
        return False, nan, nan
    low, high = inf, -inf
    for i in range(end):
        for k in (_ROW * i + _ONE, _ROW * i + _OTHER):
            low, high = min(low, rows[k]), max(high, rows[k])
    least, most, above = inf, -inf, 0.0
    for i in range(end - _STEADY, end):
        its_above = 0.5 * (rows[_ROW * i + _BEEN] + rows[_ROW * i + _BEEN + _EACH])
        least, most, above = min(least, its_above), max(most, its_above), above + its_above / _STEADY
    return max(most - least, high - low) <= stands, 0.5 * (low + high), above


@jit
def _apart(
    rows: Floats,
    state: Floats,
    noted: Floats,
    kind: Floats,
    now_s: float,
    current: float,
    daq: float,
    one: float,
    from_one: float,
    other: float,
    from_other: float,
    is_new: bool,
    digit: float,
    share: float,
) -> tuple[float, float]:
    """See :meth:`Apart._step`."""
    lag_s, stands, floor, zero = kind[_LAG], kind[_STANDS], kind[_FLOOR], kind[_ZERO]
    _begin(state, now_s)
    last = int(state[_ROWS])
    row = _ROW * last
    rows[row + _TIME], rows[row + _ONE], rows[row + _OTHER] = now_s, one, other
    rows[row + _MEAN], rows[row + _MEAN + 1], rows[row + _NEW] = current, daq, 1.0 if is_new else 0.0
    _look_back(rows, last, lag_s, from_one, from_other)
    its_own = max(1.0, CHANCE**2 * state[_ODD]) if kind[_ODD_COUNTS] > 0.0 else 1.0
    rows[row + _LATE] = _late(rows, last, is_new) ** 2 * its_own
    _add(rows, state, last)
    seen_s = now_s - state[_SINCE_s]
    if isfinite(stands) and seen_s < WINDOW_s + lag_s:
        it_stands, supply, above = _steady(rows, state, stands)
        return _judge(state, noted, supply, above, stands, share * supply + floor, zero) if it_stands else (nan, nan)
    change, allowed = nan, nan
    for window in range(len(WINDOWS_s)):
        if isfinite(digit) and seen_s >= WINDOWS_s[window] + lag_s:
            at, mean, above, vague = _among(state, window)
            supply = mean - above
            its_change, its_allowed = _judge(
                state,
                noted,
                at if isfinite(at) else supply,
                above,
                vague + 0.5 * digit,
                share * supply + floor,
                zero,
            )
            if window == 0 or abs(its_change) - its_allowed > abs(change) - allowed:
                change, allowed = its_change, its_allowed
    return change, allowed


class Apart:
    """How far one measurement has come from another since both were first seen."""

    def __init__(self, lag_s: float, floor: float, zero: float, stands: float, odd_counts: bool) -> None:
        """One may be ``lag_s`` behind the other; ``floor`` of a drift, and the error of ``zero`` that stands still.

        What differs by less than ``stands`` is seen at once to stand; NaN: never.  ``odd_counts``: one that comes
        early or late is late by more at random.
        """
        self._kind = floats(_KIND)
        self._kind[:] = lag_s, floor, zero, stands, float(odd_counts)
        self._rows = floats(_ROOM * _ROW)
        self._left = _ROOM  #: rows that there is room for
        self._state = floats(_STATE)
        self._state[_LAST_s], self._state[_USUAL_s], self._state[_ODD] = nan, WINDOW_s, 1.0
        self._noted = floats(_POINT * _ROOM)

    def pause(self) -> None:
        """Nothing can be compared now; what was noted stays."""
        self._state[_ROWS] = 0.0

    def forget(self) -> None:
        """Begin anew."""
        self._state[_ROWS] = self._state[_NOTED] = 0.0

    def _step(
        self,
        now_s: float,
        current: float,
        daq: float,
        one: float,
        from_one: float,
        other: float,
        from_other: float,
        share: float,
        is_new: bool = True,
        digit: float = 0.0,
    ) -> tuple[float, float]:
        """What the DAQ's difference from the supply has changed by at such a ``current`` (NaN: what is measured is
        one), and what it may; NaN until that is known.

        ``one`` and ``other`` are two numbers of which one is late, each followed by what it is taken from to make the
        difference; ``share`` of what is measured may be a drift.  One that is not ``is_new`` is shown again, in steps
        of ``digit``.
        """
        if not self._left:
            self._make_room()
        self._left -= 1
        return _apart(
            self._rows,
            self._state,
            self._noted,
            self._kind,
            now_s,
            current,
            daq,
            one,
            from_one,
            other,
            from_other,
            is_new,
            digit,
            share,
        )

    def _make_room(self) -> None:
        """For more rows."""
        first = int(self._state[_FIRST[-1]])
        wanted = self._rows[_ROW * first : _ROW * int(self._state[_ROWS])]
        self._rows = floats(max(len(self._rows), 2 * len(wanted)))
        self._rows[: len(wanted)] = wanted
        self._left = (len(self._rows) - len(wanted)) // _ROW
        for k in (_ROWS, *_FIRST):
            self._state[k] -= first


class CurrentsApart(Apart):
    """How far the DAQ's current has come from the supply's since both were first seen."""

    def __init__(self) -> None:
        super().__init__(LAG_s, FLOOR_A, 0.0, STANDS_A, odd_counts=True)

    def step(self, now_s: float, daq_A: float, from_A: float, to_A: float, share: float) -> tuple[float, float]:
        """What the DAQ's current has changed by against the supply's, which lies from ``from_A`` to ``to_A``, and what
        it may [A].

        NaN until that is known.  ``share`` of the current may be a drift.
        """
        return self._step(now_s, nan, daq_A, from_A, daq_A, to_A, daq_A, share)


class VoltagesApart(Apart):
    """How far the DAQ's voltage has come from the supply's since both were first seen."""

    def __init__(self) -> None:
        super().__init__(METER_LAG_s, FLOOR_V, ZERO_V, nan, odd_counts=False)  # the meter has a time of its own
        self._latest_V, self._digit_V = nan, inf  # the supply's, and the least by which it has changed

    def step(self, now_s: float, current_A: float, daq_V: float, supply_V: float, share: float) -> tuple[float, float]:
        """What the DAQ's voltage has changed by against the supply's at such a current, and what it may [V].

        NaN until that is known.  ``share`` of the voltage may be a drift.
        """
        is_new = supply_V != self._latest_V
        if is_new and isfinite(self._latest_V):
            self._digit_V = min(self._digit_V, abs(supply_V - self._latest_V))
        self._latest_V = supply_V
        return self._step(now_s, current_A, daq_V, -daq_V, -supply_V, supply_V, daq_V, share, is_new, self._digit_V)
