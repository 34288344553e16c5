"""A trajectory that somebody waits for the end of: how far the wire, or the joint, is from it, and what became of it.

Positions are those of the trajectory, m or rad.
"""

from __future__ import annotations

import enum
from math import inf

from .setpoints import Trajectory


class Outcome(enum.Enum):
    """What became of it."""

    REACHED = "reached"
    PATH_VIOLATED = "path violated"  #: too far from the trajectory on the way
    END_MISSED = "end missed"  #: not near its end in time


class Pursuit:
    """One trajectory, from ``begins_s``, with tolerances: of the position on the ``path`` and at the ``end``, infinite
    where any will do, and the time [s] that it may come late."""

    def __init__(self, trajectory: Trajectory, begins_s: float, path: float, end: float, late_s: float):
        self._trajectory, self._begins_s = trajectory, begins_s
        self._path, self._end, self._late_s = path, end, late_s

    def setpoint(self, now_s: float) -> float:
        """Where it should be."""
        return self._trajectory(now_s - self._begins_s)

    def begun(self, now_s: float) -> bool:
        """Whether the trajectory runs, or has run."""
        return now_s >= self._begins_s

    def look(self, now_s: float, position: float) -> Outcome | None:
        """What has become of it with it at ``position``; None while that is open.  NaN is near nothing."""
        if not self.begun(now_s):
            return None
        self._trajectory = self._trajectory.led_in(now_s - self._begins_s, position)
        error = abs(position - self.setpoint(now_s))
        late_s = now_s - self._begins_s - self._trajectory.duration_s
        if late_s < 0.0:
            return None if self._path == inf or error <= self._path else Outcome.PATH_VIOLATED
        if error <= self._end:
            return Outcome.REACHED
        return Outcome.END_MISSED if late_s > self._late_s else None


def tolerance(asked: float, usual: float) -> float:
    """A tolerance as ROS messages ask for it: 0 is the usual one, a negative one is none at all."""
    return usual if asked == 0.0 else inf if asked < 0.0 else asked
