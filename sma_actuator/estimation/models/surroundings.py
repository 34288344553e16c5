"""Surroundings that are not those of the calibration: another room, and a draught or a shelter.

What a wire loses is known less well than what it does.  A heat balance has a wire ``k`` times as far above its
surroundings as it is, where its heat loss is off.  In the room of the calibration that shows nowhere: its temperatures
are as far off in every log.  In a room that is ΔT warmer the wire needs less power, by what it really loses over ΔT,
and by the heat balance it transforms (1 - k) ΔT hotter than it did.  Where air moves as it did not, it loses 1/(1 - l)
times as much, and the heat balance has it too hot by l times its rise.

What tells both is how the wire behaves.  Resistance, load and how far resistance and temperature have come from their
last turns say which apparent temperature the wire had in the calibration when they were so; none of them knows of an
offset.  What the heat balance has beyond that is k's and l's, each reading as surely as such a temperature was told in
logs left out: a Kalman filter of two numbers that hardly change.  Samples are of one reading as long as they are alike:
a wire that is held for an hour says once what it says there.

That the air moves otherwise is seldom so and then by much, so that l counts as far as the readings speak for it: the
mean of two hypotheses by their odds (Kass and Raftery 1995).  k and its doubt are there always.
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
# What was known: 1/variance of 1 - k, 1 - k times that, 1/variance of l.  What was seen: readings, and their weighted
# sums of ΔT², ΔT times rise, rise², and of what is beyond times either.  Where the wire is, and what part of a reading
# its way there still gives.
_KNOWN, _KNOWN_PULL, _KNOWN_DRAUGHT, _READINGS, _ROOM, _BOTH, _RISE, _ROOM_PULL, _RISE_PULL, _SHARE, _NEWS = range(11)


def nothing_seen(counts: Sequence[float]) -> Floats:
    """The memory of a model that has seen nothing; of no draught, until it is to :func:`follow_draughts`.

    ``counts``: what is known, in the order of the indices above.
    """
    memory = floats(11)
    within = counts[COUNTS_WITHIN] or NO_NEWS
    memory[_KNOWN] = 1.0 / within**2
    memory[_KNOWN_PULL] = (1.0 - counts[COUNTS]) / within**2
    follow_draughts(False, memory)
    forget(memory)
    return memory


def follow_draughts(follows: bool, memory: Floats) -> None:
    """Whether a draught is looked for."""
    memory[_KNOWN_DRAUGHT] = 1.0 / (DRAUGHT if follows else NO_NEWS) ** 2


def forget(memory: Floats) -> None:
    """What was known before anything was seen is all that is known."""
    for each in range(_READINGS, _SHARE):
        memory[each] = 0.0
    memory[_SHARE] = nan
    memory[_NEWS] = 1.0


@jit
def off_K(other_K: float, rise_K: float, memory: Floats) -> tuple[float, float]:
    """By how much the heat balance has a wire too warm that is by it ``rise_K`` above surroundings which are
    ``other_K`` warmer than usual, and how far off that may be, one standard deviation."""
    worth = WORTH / (WORTH + memory[_READINGS])
    room = memory[_KNOWN] + worth * memory[_ROOM]
    both = worth * memory[_BOTH]
    rise = memory[_KNOWN_DRAUGHT] + worth * memory[_RISE]
    room_pull = memory[_KNOWN_PULL] + worth * memory[_ROOM_PULL]
    rise_pull = worth * memory[_RISE_PULL]
    still = room_pull / room  # 1 - k where there is no draught
    still_K, still_within_K = still * other_K, abs(other_K) / sqrt(room)
    determinant = room * rise - both * both
    k_off = (rise * room_pull - both * rise_pull) / determinant
    draught = (room * rise_pull - both * room_pull) / determinant
    draught_K = k_off * other_K + draught * rise_K
    variance_K2 = (rise * other_K**2 - 2.0 * both * other_K * rise_K + room * rise_K**2) / determinant
    odds = 0.5 * (k_off * room_pull + draught * rise_pull - still * room_pull)
    odds -= 0.5 * log(determinant / (room * memory[_KNOWN_DRAUGHT]))
    chance = 1.0 / (1.0 + (1.0 - DRAUGHTY) / DRAUGHTY * exp(-min(max(odds, -_MOST), _MOST)))
    off = still_K + chance * (draught_K - still_K)
    within_K = still_within_K + chance * (sqrt(max(variance_K2, 0.0)) - still_within_K)
    return off, within_K + sqrt(chance * (1.0 - chance)) * abs(draught_K - still_K)


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
    memory[_ROOM] = stays * memory[_ROOM] + weight * other_K**2
    memory[_BOTH] = stays * memory[_BOTH] + weight * other_K * rise_K
    memory[_RISE] = stays * memory[_RISE] + weight * rise_K**2
    memory[_ROOM_PULL] = stays * memory[_ROOM_PULL] + weight * other_K * beyond_K
    memory[_RISE_PULL] = stays * memory[_RISE_PULL] + weight * rise_K * beyond_K
