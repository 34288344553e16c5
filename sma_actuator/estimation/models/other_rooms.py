"""What a kelvin of another room counts: what a wire loses is known less well than what it does.

A heat balance has a wire ``k`` times as far above its surroundings as it is, where its heat loss is off.  In the room
of the calibration that shows nowhere: its temperatures are as far off in every log.  In a room that is ΔT warmer the
wire needs less power, by what it really loses over ΔT, and by the heat balance it transforms (1 - k) ΔT hotter than it
did.

What tells k is how the wire behaves there.  Resistance, load and how far resistance and temperature have come from
their last turns say which apparent temperature the wire had in the calibration when they were so; none of them knows
of an offset.  What the heat balance has beyond that is counted over ΔT, each reading as surely as such a temperature
was told in logs left out: a Kalman filter of one number that does not change.  Samples are of one reading as long as
they are alike: a wire that is held for an hour says once what it says there.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import isnan, nan, sqrt

from sma_actuator.base.jit import Floats, floats, jit

COUNTS, COUNTS_WITHIN = range(2)  #: what is known: k, and its standard deviation before anything is seen
AS_MUCH = (1.0, 0.0)  #: of a model that was taught nothing of it
#: How surely a heat loss by geometry tells k: of 57 wires in three physics rms, the worst was 0.47 off.
WITHIN = 0.15
#: Errors of an expected temperature are alike for so long, and over such a share of the stroke: a step, a quarter of a
#: cycle.  A place that moves by less than PLAY is noise.
ALIKE_s, ALIKE, PLAY = 20.0, 0.4, 0.02
#: An error of more than so many standard deviations counts as if it were one of these.
SURPRISE = 3.0
#: What is expected is off by a third of a standard deviation throughout a run, so that all its readings together are
#: worth no more than so many: of 36 runs of five wires in three rooms k was off by least with 4 to 8.
WORTH = 5.0
#: Surroundings that differ by less tell nothing within an hour.
LEAST_K = 1.0
NO_NEWS = 1e-6  #: standard deviation of what is not learned
# What was known: 1/variance of 1 - k, and 1 - k times that.  What was seen: the same, and in how many readings.  Where
# the wire is, and what part of a reading its way there still gives.
_KNOWN, _KNOWN_PULL, _SEEN, _SEEN_PULL, _READINGS, _SHARE, _NEWS = range(7)


def nothing_seen(counts: Sequence[float]) -> Floats:
    """The memory of a model that has seen no other room."""
    memory = floats(7)
    forget(counts, memory)
    return memory


def forget(counts: Sequence[float], memory: Floats) -> None:
    """What was known before anything was seen is all that is known."""
    within = counts[COUNTS_WITHIN] or NO_NEWS
    memory[_KNOWN] = 1.0 / within**2
    memory[_KNOWN_PULL] = (1.0 - counts[COUNTS]) / within**2
    memory[_SEEN] = memory[_SEEN_PULL] = memory[_READINGS] = 0.0
    memory[_SHARE] = nan
    memory[_NEWS] = 1.0


@jit
def _worth(memory: Floats) -> float:
    """Of what the readings would be worth if nothing were common to them."""
    return WORTH / (WORTH + memory[_READINGS])


@jit
def information(memory: Floats) -> float:
    """1/variance of 1 - k."""
    return memory[_KNOWN] + _worth(memory) * memory[_SEEN]


@jit
def off_K(other_K: float, memory: Floats) -> float:
    """By how much the heat balance has the wire too warm in surroundings that are ``other_K`` warmer."""
    pull = memory[_KNOWN_PULL] + _worth(memory) * memory[_SEEN_PULL]
    return pull / information(memory) * other_K


@jit
def unsure_K(other_K: float, memory: Floats) -> float:
    """How far off that may be, one standard deviation."""
    return abs(other_K) / sqrt(information(memory))


@jit
def tell(beyond_K: float, within_K: float, other_K: float, step_s: float, share: float, memory: Floats) -> None:
    """For so long a sample's apparent temperature was so far beyond the expected one, which is as sure as that.

    ``share``: of the stroke, where the wire is.
    """
    if isnan(memory[_SHARE]):
        memory[_SHARE] = share
    way = max(abs(share - memory[_SHARE]) - PLAY, 0.0)
    memory[_SHARE] += way if share > memory[_SHARE] else -way
    reading = min(step_s / ALIKE_s, memory[_NEWS])
    memory[_NEWS] = min(memory[_NEWS] - reading + way / ALIKE, 1.0)
    expected_K = off_K(other_K, memory)
    most_K = SURPRISE * within_K
    beyond_K = expected_K + min(max(beyond_K - expected_K, -most_K), most_K)
    weight = reading / within_K**2 * other_K
    memory[_SEEN] += weight * other_K
    memory[_SEEN_PULL] += weight * beyond_K
    memory[_READINGS] += reading
