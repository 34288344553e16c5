"""Surroundings that are not those of the calibration: another room, and a draught or a shelter.

What a wire loses is known less well than what it does.  A heat balance has a wire ``k`` times as far above its
surroundings as it is, where its heat loss is off.  In the room of the calibration that shows nowhere: its temperatures
are as far off in every log.  In a room that is ΔT warmer the wire needs less power, by what it really loses over ΔT,
and by the heat balance it transforms (1 - k) ΔT hotter than it did.  The air at the wire is some kelvins off what a
sensor says that hangs elsewhere, and more off what it is taken for where nobody measures it: so is the heat balance.
Where air moves as it did not, it loses 1/(1 - l) times as much, and the heat balance has it too hot by l times its
rise.

What tells all three is how the wire behaves.  Resistance, load and how far resistance and temperature have come from
their last turns say which apparent temperature the wire had in the calibration when they were so; none of them knows
of an offset.  What the heat balance has beyond that is k's, the air's and l's, each reading as surely as such a
temperature was told in logs left out: a Kalman filter of three numbers that hardly change.  Samples are of one reading
as long as they are alike: a wire that is held for an hour says once what it says there.

That the air moves otherwise is seldom so and then by much, and so it is with a sensor that reads the air of elsewhere;
often all is as it was.  Each counts as far as the readings speak for it, the mean of hypotheses by their odds (Kass and
Raftery 1995).
"""

from __future__ import annotations

from collections.abc import Sequence
from math import exp, isnan, log, nan, sqrt

from sma_actuator.base.jit import Floats, floats, jit

COUNTS, COUNTS_WITHIN = range(2)  #: what is known: k, and its standard deviation before anything is seen
AS_MUCH = (1.0, 0.0)  #: of a model that was taught nothing of it
#: How surely a heat loss by geometry tells k: of 57 wires in three physics rms, the worst was 0.47 off.
WITHIN = 0.15
#: By how much air that moves otherwise makes a heat loss differ, and in what share of the runs it does.
DRAUGHT, DRAUGHTY = 0.15, 0.1
#: So much warmer or colder the air at the wire is than a sensor says, and than at the calibration where there is none,
#: seasons indoors; and what share of the sensors say as little as none.
SENSOR_K, UNMEASURED_K, ASTRAY = 2.0, 8.0, 0.1
#: Every second run is on the bench of the calibration, where air and sensor are to each other as they were.
SAME_K, SAME = 0.3, 0.5
#: Errors of an expected temperature are alike for so long, and over such a share of the stroke: a step, a quarter of a
#: cycle.  A place that moves by less than PLAY is noise.
ALIKE_s, ALIKE, PLAY = 20.0, 0.4, 0.02
#: An error of more than so many standard deviations counts as if it were one of these.
SURPRISE = 6.0
#: What is expected is off by a third of a standard deviation throughout a run (36 runs of five wires in three rooms):
#: all its readings together are worth no more than so many.
WORTH = 8.0
#: Of so many readings a memory is made: five minutes of motion, in which a fan may be switched on.
LASTS = 15.0
#: Surroundings that differ by less tell nothing within an hour.
LEAST_K = 1.0
NO_NEWS = 1e-6  #: standard deviation of what is not learned
_MOST = 50.0  # of a logarithm of odds
#: The numbers of the filter: 1 - k, by how many kelvins the air is colder than it is taken for, and l; and the entries
#: of a symmetric matrix of theirs, row by row up to the diagonal.
_ROOM, _AIR, _DRAUGHT = range(3)
_NUMBERS, _ENTRIES = 3, 6
# What was known: 1/variance of 1 - k, its value times that, and whether the others are looked for.  What was seen:
# readings, the sums of what each number makes of a degree times what the others do, and of it times what is beyond, all
# weighted.  Where the wire is, and what part of a reading its way there still gives.
_KNOWN, _KNOWN_PULL, _FOLLOWS, _READINGS, _SEEN = range(5)
_PULL = _SEEN + _ENTRIES
_SHARE, _NEWS = _PULL + _NUMBERS, _PULL + _NUMBERS + 1
_SIZE = _NEWS + 1


def nothing_seen(counts: Sequence[float]) -> Floats:
    """The memory of a model that has seen nothing; of no surroundings but those that are measured, until it is to
    :func:`follow`.

    ``counts``: what is known, in the order of the indices above.
    """
    memory = floats(_SIZE)
    within = counts[COUNTS_WITHIN] or NO_NEWS
    memory[_KNOWN] = 1.0 / within**2
    memory[_KNOWN_PULL] = (1.0 - counts[COUNTS]) / within**2
    forget(memory)
    return memory


def follow(follows: bool, memory: Floats) -> None:
    """Whether a draught is looked for, and air that is not what it is taken for."""
    memory[_FOLLOWS] = follows


def forget(memory: Floats) -> None:
    """What was known before anything was seen is all that is known."""
    for each in range(_READINGS, _SHARE):
        memory[each] = 0.0
    memory[_SHARE] = nan
    memory[_NEWS] = 1.0


@jit
def _makes(other_K: float, rise_K: float) -> tuple[float, float, float]:
    """How many degrees one of each number makes."""
    return 0.0 if isnan(other_K) else other_K, 1.0, rise_K


@jit
def _by_air(
    air_K: float, makes: tuple[float, float, float], memory: Floats
) -> tuple[float, float, float, float, float, float]:
    """Where the air is off by some ``air_K``: by how much the heat balance has the wire too warm in no draught, the
    variance of that, and how much speaks for it; what a draught adds, its variance, and how much more speaks for one.

    By Cholesky's decomposition of all that is known; what its last row has is the draught's.
    """
    worth = WORTH / (WORTH + memory[_READINGS])
    a = sqrt(memory[_KNOWN] + worth * memory[_SEEN])
    b = worth * memory[_SEEN + 1] / a
    c = sqrt(1.0 / air_K**2 + worth * memory[_SEEN + 2] - b * b)
    d = worth * memory[_SEEN + 3] / a
    e = (worth * memory[_SEEN + 4] - d * b) / c
    f = sqrt(1.0 / DRAUGHT**2 + worth * memory[_SEEN + 5] - d * d - e * e)
    u = makes[_ROOM] / a
    v = (makes[_AIR] - b * u) / c
    w = (makes[_DRAUGHT] - d * u - e * v) / f
    x = (memory[_KNOWN_PULL] + worth * memory[_PULL + _ROOM]) / a
    y = (worth * memory[_PULL + _AIR] - b * x) / c
    z = (worth * memory[_PULL + _DRAUGHT] - d * x - e * y) / f
    speaks = 0.5 * y * y - log(air_K * c)
    return u * x + v * y, u * u + v * v, speaks, w * z, w * w, 0.5 * z * z - log(DRAUGHT * f)


@jit
def off_K(other_K: float, rise_K: float, memory: Floats) -> tuple[float, float]:
    """By how much the heat balance has a wire too warm that is by it ``rise_K`` above surroundings which are
    ``other_K`` warmer than usual, NaN where nobody measures them, and how far off that may be, one standard deviation:
    the mean of the hypotheses, by what speaks for each."""
    makes = _makes(other_K, rise_K)
    if not memory[_FOLLOWS]:
        still_K, still_K2, _, _, _, _ = _by_air(NO_NEWS, makes, memory)
        return still_K, sqrt(still_K2)
    astray, same = (1.0, 0.0) if isnan(other_K) else (ASTRAY, SAME)
    odds = mean_K = square_K2 = first = 0.0
    for air_K, share in ((UNMEASURED_K, astray), (SENSOR_K, 1.0 - astray - same), (SAME_K, same)):
        still_K, still_K2, speaks, draught_K, draught_K2, more = _by_air(air_K, makes, memory)
        if odds == 0.0:
            first = speaks
        still = share * (1.0 - DRAUGHTY) * exp(min(max(speaks - first, -_MOST), _MOST))
        windy = share * DRAUGHTY * exp(min(max(speaks + more - first, -_MOST), _MOST))
        there_K = still_K + draught_K
        odds += still + windy
        mean_K += still * still_K + windy * there_K
        square_K2 += still * (still_K**2 + still_K2) + windy * (there_K**2 + still_K2 + draught_K2)
    mean_K /= odds
    return mean_K, sqrt(max(square_K2 / odds - mean_K**2, 0.0))


@jit
def tell(
    beyond_K: float,
    within_K: float,
    believed_K: float,
    other_K: float,
    rise_K: float,
    step_s: float,
    share: float,
    memory: Floats,
) -> None:
    """For so long a sample's apparent temperature was so far beyond the expected one, which is as sure as that.

    ``believed_K``: by how much it was thought to be (:func:`off_K`); ``share``: of the stroke, where the wire is.
    """
    if isnan(memory[_SHARE]):
        memory[_SHARE] = share
    way = max(abs(share - memory[_SHARE]) - PLAY, 0.0)
    memory[_SHARE] += way if share > memory[_SHARE] else -way
    reading = min(step_s / ALIKE_s, memory[_NEWS])
    memory[_NEWS] = min(memory[_NEWS] - reading + way / ALIKE, 1.0)
    if abs(other_K) < LEAST_K:
        other_K = 0.0
    most_K = SURPRISE * within_K
    beyond_K = believed_K + min(max(beyond_K - believed_K, -most_K), most_K)
    weight = reading / within_K**2
    stays = 1.0 - reading / LASTS
    memory[_READINGS] = stays * memory[_READINGS] + reading
    makes, entry = _makes(other_K, rise_K), _SEEN
    for i in range(_NUMBERS):
        memory[_PULL + i] = stays * memory[_PULL + i] + weight * makes[i] * beyond_K
        for j in range(i + 1):
            memory[entry] = stays * memory[entry] + weight * makes[i] * makes[j]
            entry += 1
