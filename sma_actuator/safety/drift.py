"""Two measurements of one current, or of one voltage: what they differ by is noted when it first flows, and must stay.

The supply holds a current, the DAQ measures it over the sense resistor.  Both have errors of scale and zero, which
stand still; what changes between them is a drift.  So a difference is held against the one that was noted, over a
second that averages the noise.  One may be behind the other: what it shows then is what was so long ago, by the clock
or by readings.  So each reading is held against what was at each such time, and the difference is known but for how
much its mean depends on that: where nothing moves, exactly, however seldom or irregularly the readings come.

Both measure a voltage too, the supply with its own leads in it: what these drop is on a straight line over current.

A reading is a row of numbers, and what is remembered lies in three rows of them, so that a kernel does a step.
"""

from __future__ import annotations

from math import inf, isfinite, nan, sqrt

from sma_actuator.base.jit import Floats, floats, jit

WINDOW_s = 1.0  #: over which both are averaged
#: And over this, for a wire that is moved: some of its cycles; in half of it a drift of 0.4 % a second comes to 1.6 %.
LONG_s = 8.0
LAG_s = 0.2  #: that the DAQ may be behind the supply, and so much later than usual may a reading come
METER_LAG_s = 0.5  #: that either may be behind the other where the supply measures: slow ones do so twice a second
_LAGS = 4  #: parts of the lag that are looked at: of 0.2 s each is a period of the usual loop
_BEHIND = 2  #: readings that it may be behind where that takes longer
FLOOR_A = 1e-3  #: the step of the coarsest supplies that may be driven
FLOOR_V = 10e-3  #: by how much a supply's voltmeter may wander, beside its scale and the step of its digits
ZERO_V = 50e-3  #: its zero may be off by so much; that stands still
SCALE = 0.015  #: what the scales of both may differ by, beside a drift
STANDS_A = 0.25 * FLOOR_A  #: by how much a current that stands differs in the DAQ's eyes
_STEADY = 3  #: readings that show it
_ROUNDING_s = 1e-6
WIDER = 1.1  #: a current that is so much beyond those that were noted is noted as well

#: What a row holds of a reading: its time, and the two of which one is late, or the other;
_TIME, _ONE, _OTHER = 0, 1, 2
#: what means are taken of: two quantities, the square of by how much it may be off since it is late by a reading,
#: whether it is not the one before, shown again;
_MEAN, _LATE, _NEW = 3, 5, 6
#: and what the two have been, now and at each lag, by the clock and by readings.
_BEEN, _EACH = 7, _LAGS + 1 + _BEHIND
_ROW = _BEEN + 2 * _EACH
_MEANS = _ROW - _MEAN
#: What is remembered beside the rows: when the last reading came, the time between the last two, the share of it by
#: which the last came early or late, since when there is no gap, how many rows there are and how many noted currents;
_LAST_s, _USUAL_s, _ODD, _SINCE_s, _ROWS, _NOTED = range(6)
#: and of either window its first row and the sums of what means are taken of.
_FIRST, _SUMS = (6, 6 + 1 + _MEANS), (7, 7 + 1 + _MEANS)
_STATE = _SUMS[1] + _MEANS
_WINDOWS_s = (WINDOW_s, LONG_s)
#: Of a noted current: itself, by how much it was above, and how exactly that is known.
_POINT = 3
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
def _look_back(
    rows: Floats, last: int, lag_s: float, sign_one: float, add_one: float, sign_other: float, add_other: float
) -> None:
    """What the two have been at each lag of the last row, each with its sign and with what is added."""
    row, at = _ROW * last, last
    for lag in range(_EACH):
        if lag <= _LAGS:
            then_s = rows[row + _TIME] - lag_s * lag / _LAGS - _ROUNDING_s
            while at > 0 and rows[_ROW * (at - 1) + _TIME] >= then_s:
                at -= 1
        else:
            at = max(last - (lag - _LAGS), 0)
        rows[row + _BEEN + lag] = sign_one * rows[_ROW * at + _ONE] + add_one
        rows[row + _BEEN + _EACH + lag] = sign_other * rows[_ROW * at + _OTHER] + add_other


@jit
def _add(rows: Floats, state: Floats, last: int) -> None:
    """Let both windows end with the last row."""
    row = _ROW * last
    state[_ROWS] = last + 1.0
    for window in range(2):
        first = int(state[_FIRST[window]])
        for k in range(_MEANS):
            state[_SUMS[window] + k] += rows[row + _MEAN + k]
        while rows[row + _TIME] - rows[_ROW * first + _TIME] >= _WINDOWS_s[window]:
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
def _steady(rows: Floats, state: Floats) -> tuple[bool, float, float]:
    """Whether the current that is the first to flow stands in the eyes of the DAQ (it may flow for a moment only); the
    supply's, and by how much the DAQ's is above it."""
    first, end = int(state[_FIRST[0]]), int(state[_ROWS])
    if end - first < _STEADY or rows[_ROW * (end - 1) + _TIME] - state[_SINCE_s] < LAG_s - _ROUNDING_s:
        return False, nan, nan
    low_A, high_A = inf, -inf
    for i in range(first, end):
        for k in range(_ROW * i + _BEEN, _ROW * (i + 1)):
            low_A, high_A = min(low_A, rows[k]), max(high_A, rows[k])
    lowest_A, highest_A, sum_A = inf, -inf, 0.0
    for i in range(end - _STEADY, end):
        daq_A = rows[_ROW * i + _MEAN]
        lowest_A, highest_A, sum_A = min(lowest_A, daq_A), max(highest_A, daq_A), sum_A + daq_A
    supply_A = 0.5 * (low_A + high_A)
    return max(highest_A - lowest_A, high_A - low_A) <= STANDS_A, supply_A, sum_A / _STEADY - supply_A


@jit
def _currents(
    rows: Floats,
    state: Floats,
    noted: Floats,
    now_s: float,
    daq_A: float,
    from_A: float,
    to_A: float,
    share: float,
) -> tuple[float, float]:
    """See :meth:`CurrentsApart.step`."""
    _begin(state, now_s)
    last = int(state[_ROWS])
    row = _ROW * last
    rows[row + _TIME], rows[row + _ONE], rows[row + _OTHER] = now_s, from_A, to_A
    rows[row + _MEAN], rows[row + _MEAN + 1], rows[row + _NEW] = daq_A, daq_A, 1.0
    _look_back(rows, last, LAG_s, 1.0, 0.0, 1.0, 0.0)
    one, other = row + _BEEN, row + _BEEN + _EACH
    late_A = max(abs(rows[one] - rows[one + _LAGS + 1]), abs(rows[other] - rows[other + _LAGS + 1]))  # by a reading
    late_A *= sqrt(state[_ODD])  # as likely as it did not come when it usually does
    rows[row + _LATE] = late_A * late_A
    _add(rows, state, last)
    seen_s = now_s - state[_SINCE_s]
    change_A, allowed_A = nan, nan
    if seen_s < WINDOW_s + LAG_s:
        stands, supply_A, above_A = _steady(rows, state)
        if stands:
            return _judge(state, noted, supply_A, above_A, STANDS_A, share * supply_A + FLOOR_A, 0.0)
        return change_A, allowed_A
    for window in range(2):
        if seen_s >= _WINDOWS_s[window] + LAG_s:
            mean_A, _, supply_A, vague_A = _among(state, window)
            drift_A = share * supply_A + FLOOR_A
            change, allowed = _judge(state, noted, supply_A, mean_A - supply_A, vague_A, drift_A, 0.0)
            if window == 0 or abs(change) - allowed > abs(change_A) - allowed_A:
                change_A, allowed_A = change, allowed
    return change_A, allowed_A


@jit
def _voltages(
    rows: Floats,
    state: Floats,
    noted: Floats,
    now_s: float,
    current_A: float,
    daq_V: float,
    supply_V: float,
    new: float,
    digit_V: float,
    share: float,
) -> tuple[float, float]:
    """See :meth:`VoltagesApart.step`."""
    _begin(state, now_s)
    last = int(state[_ROWS])
    row = _ROW * last
    rows[row + _TIME], rows[row + _ONE], rows[row + _OTHER] = now_s, daq_V, supply_V
    rows[row + _MEAN], rows[row + _MEAN + 1], rows[row + _NEW] = current_A, supply_V, new
    _look_back(rows, last, METER_LAG_s, 1.0, -supply_V, -1.0, daq_V)
    late_V = 0.0
    for one in (row + _BEEN, row + _BEEN + _EACH):
        if new:
            late_V = max(late_V, abs(rows[one] - rows[one + _LAGS + 1]))  # by a reading
        else:  # a meter shows what it held
            low_V, high_V = inf, -inf
            for k in range(one, one + _EACH - 1):
                low_V, high_V = min(low_V, rows[k]), max(high_V, rows[k])
            late_V = max(late_V, high_V - low_V)
    rows[row + _LATE] = late_V * late_V
    _add(rows, state, last)
    seen_s = now_s - state[_SINCE_s]
    change_V, allowed_V = nan, nan
    for window in range(2):
        if isfinite(digit_V) and seen_s >= _WINDOWS_s[window] + METER_LAG_s:
            at_A, mean_V, above_V, vague_V = _among(state, window)
            vague_V += 0.5 * digit_V
            change, allowed = _judge(state, noted, at_A, above_V, vague_V, share * mean_V + FLOOR_V, ZERO_V)
            if window == 0 or abs(change) - allowed > abs(change_V) - allowed_V:
                change_V, allowed_V = change, allowed
    return change_V, allowed_V


class Apart:
    """How far one measurement has come from another since both were first seen."""

    def __init__(self) -> None:
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

    def _make_room(self) -> None:
        """For another row."""
        if not self._left:
            first = int(self._state[_FIRST[1]])
            wanted = self._rows[_ROW * first : _ROW * int(self._state[_ROWS])]
            self._rows = floats(max(len(self._rows), 2 * len(wanted)))
            self._rows[: len(wanted)] = wanted
            self._left = (len(self._rows) - len(wanted)) // _ROW
            for k in (_ROWS, *_FIRST):
                self._state[k] -= first
        self._left -= 1


class CurrentsApart(Apart):
    """How far the DAQ's current has come from the supply's since both were first seen."""

    def step(self, now_s: float, daq_A: float, from_A: float, to_A: float, share: float) -> tuple[float, float]:
        """What the DAQ's current has changed by against the supply's, which lies from ``from_A`` to ``to_A``, and what
        it may [A].

        NaN until that is known.  ``share`` of the current may be a drift.
        """
        self._make_room()
        return _currents(self._rows, self._state, self._noted, now_s, daq_A, from_A, to_A, share)


class VoltagesApart(Apart):
    """How far the DAQ's voltage has come from the supply's since both were first seen."""

    def __init__(self) -> None:
        super().__init__()
        self._latest_V, self._digit_V = nan, inf  # the supply's, and the least by which it has changed

    def step(self, now_s: float, current_A: float, daq_V: float, supply_V: float, share: float) -> tuple[float, float]:
        """What the DAQ's voltage has changed by against the supply's at such a current, and what it may [V].

        NaN until that is known.  ``share`` of the voltage may be a drift.
        """
        is_new = supply_V != self._latest_V
        if is_new and isfinite(self._latest_V):
            self._digit_V = min(self._digit_V, abs(supply_V - self._latest_V))
        self._latest_V = supply_V
        self._make_room()
        return _voltages(
            self._rows,
            self._state,
            self._noted,
            now_s,
            current_A,
            daq_V,
            supply_V,
            float(is_new),
            self._digit_V,
            share,
        )


def made_ready() -> None:
    """Have the kernels compiled, or loaded: before current flows, which would go on through the seconds that it takes
    in the first step."""
    for apart in (CurrentsApart(), VoltagesApart()):
        apart.step(0.0, 0.0, 0.0, 0.0, 0.0)
