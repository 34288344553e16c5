"""What is wanted of the wire: off, held, at a setpoint, along a trajectory, or a setpoint that is lost.

::

        enable               setpoint                  timeout
    OFF ──────▶ HOLDING ──┬────────────▶ TRACKING ──┬──────────▶ LOST_HOLDING ──┐
                          │ trajectory              │ (as the    or             │
                          ├────────────▶ FOLLOWING ─┘ parameters LOST_AT_BIAS ──┤
                          │                           say)                      │
                          └────────────────── setpoint, trajectory ─────────────┘

A setpoint or trajectory takes the place of the one before; ``stop`` leads from every driven state to HOLDING, where the
wire is (``cancel`` of a trajectory: where its reference has come), and ``off`` to OFF.  ``tune`` leads from every
driven state to TUNING, where the setpoints are the tuning's own; its end is a ``stop``, and whatever else is wanted of
the wire ends it.

Joint commands come as a stream, from a program that may never have asked where the wire is.  One that counts is a
setpoint; the first that counts is one near the wire (``armed``), and after anything else was wanted of the wire so is
the next.

Beside its state it remembers one more thing, whether the controller is to begin ``anew``: from the
present position and current, as soon as these are known.  A wire that is to be held is held there.
Nothing is measured and nothing supervised here: who does so tells what has happened.
"""

from __future__ import annotations

import enum
from math import nan

from sma_actuator.base.signals import Mode

from .setpoints import Trajectory


class State(enum.Enum):
    """What is wanted."""

    OFF = "off"
    HOLDING = "holding"  #: where the wire was when the controller began
    TRACKING = "tracking"  #: the last setpoint
    FOLLOWING = "following"  #: a trajectory, and after its end its last point
    LOST_HOLDING = "lost, holding"  #: the setpoint is lost: where the wire was then
    TUNING = "tuning"  #: setpoints of its own
    LOST_AT_BIAS = "lost, at bias"  #: the setpoint is lost: no position, only the bias current


class Event(enum.Enum):
    """What may happen."""

    ENABLE = "enable"
    OFF = "off"  #: by hand, or a fault that latches
    SETPOINT = "setpoint"
    TRAJECTORY = "trajectory"  #: one that begins now
    STOP = "stop"  #: the motion ends where the wire is: something is wrong with it, or a tuning has ended
    CANCEL = "cancel"  #: the motion ends where the reference has come: asked for
    TUNE = "tune"
    TIMEOUT_HOLD = "timeout: hold"
    TIMEOUT_BIAS = "timeout: bias"


_DRIVEN = tuple(state for state in State if state is not State.OFF)
_MOVING = (State.TRACKING, State.FOLLOWING)
_MODES = {State.OFF: Mode.OFF, State.TUNING: Mode.TUNING, **dict.fromkeys(_MOVING, Mode.TRACKING)}
#: (event, the states in which it does something, the state after it, the states from which the controller begins anew).
#: In any other state an event does nothing.
TRANSITIONS: tuple[tuple[Event, tuple[State, ...], State, tuple[State, ...]], ...] = (
    (Event.ENABLE, (State.OFF,), State.HOLDING, (State.OFF,)),
    (Event.OFF, _DRIVEN, State.OFF, ()),
    (Event.SETPOINT, _DRIVEN, State.TRACKING, (State.LOST_AT_BIAS, State.TUNING)),
    (Event.TRAJECTORY, _DRIVEN, State.FOLLOWING, (State.LOST_AT_BIAS, State.TUNING)),
    (Event.STOP, _DRIVEN, State.HOLDING, _DRIVEN),
    (Event.CANCEL, (State.HOLDING, State.FOLLOWING, State.LOST_HOLDING), State.HOLDING, ()),
    (Event.TUNE, _DRIVEN, State.TUNING, ()),
    (Event.TIMEOUT_HOLD, _MOVING, State.LOST_HOLDING, _MOVING),
    (Event.TIMEOUT_BIAS, _MOVING, State.LOST_AT_BIAS, _MOVING),
)
_NEXT = {(state, event): (after, state in anew) for event, states, after, anew in TRANSITIONS for state in states}


class Commanding:
    """The state, and what goes with it: setpoint, trajectories and why a setpoint is lost."""

    def __init__(self) -> None:
        self.anew = False  #: the controller is to begin from the present position and current
        self._become(State.OFF)
        self._forget()

    def _become(self, state: State) -> None:
        """Be in a state, and know what follows from it: who steps a wire asks many times, and it changes seldom."""
        self.state = state
        self.is_driven = state is not State.OFF  #: whether current is to flow
        self.is_tuned = state is State.TUNING  #: whether a tuning has the wire
        #: Whether the controller has a position to reach; else the bias current is all that is wanted.
        self.wants_position = state not in (State.OFF, State.LOST_AT_BIAS)
        self.mode = _MODES.get(state, Mode.HOLD)  #: the state as the status tells it

    def _forget(self) -> None:
        self.lost = ""  #: why the setpoint counts as lost
        self.armed = False  #: the setpoint came by a joint command, and the next one counts wherever it is
        self._position_m = nan
        self._heard_s = nan  #: when the last setpoint came, or a trajectory last ran
        self._motion: tuple[float, Trajectory] | None = None  #: start, and what is followed
        self._awaited: tuple[float, Trajectory] | None = None  #: one whose start is still to come

    def _take(self, event: Event) -> bool:
        """Go where the table says; whether it says anything."""
        if (self.state, event) not in _NEXT:
            return False
        state, anew = _NEXT[self.state, event]
        self._become(state)
        self.anew = self.is_driven and (self.anew or anew)
        return True

    # --- what has happened -------------------------------------------------------------------------

    def enable(self) -> None:
        """The output goes on; the wire is held where it is."""
        self._take(Event.ENABLE)

    def switch_off(self) -> None:
        """The output goes off: nothing that was wanted stands any more."""
        if self._take(Event.OFF):
            self._forget()

    def stop(self) -> None:
        """The motion ends where the wire is."""
        if self._take(Event.STOP):
            self._forget()

    def cancel(self, reference_m: float) -> None:
        """A trajectory ends where the reference of the control law has come, and the wire follows to there.

        Holding where the wire is would be a step back by its following error.  The reference of a setpoint is at its
        end from the beginning: there, and where there is none, this is a ``stop``.
        """
        if reference_m == reference_m and self._take(Event.CANCEL):
            self._forget()
            self._position_m = reference_m
        else:
            self.stop()

    def tune(self) -> None:
        """A tuning begins, which says from step to step where the wire should be."""
        if self._take(Event.TUNE):
            self._forget()

    def track(self, now_s: float, position_m: float) -> None:
        """A setpoint has come; it takes the place of a trajectory, and of one that is awaited."""
        if self._take(Event.SETPOINT):
            self._position_m, self._motion, self.armed = position_m, None, False
            self._hear(now_s)

    def command(self, now_s: float, position_m: float, wire_m: float, near_m: float) -> bool:
        """A joint command has come, with the wire at ``wire_m``; whether it counts: it is near, or one has been before.

        None counts before the controller has begun: nobody knows yet where the wire is held.
        """
        if not self.is_driven or self.anew or not (self.armed or abs(position_m - wire_m) <= near_m):
            return False
        self.track(now_s, position_m)
        self.armed = True
        return True

    def follow(self, now_s: float, trajectory: Trajectory, delay_s: float, reference_m: float = nan) -> None:
        """A trajectory has come that begins ``delay_s`` after now, or began before; until then all stays as it is.

        To its first point it is led in from the ``reference_m`` of the control law, where that is known.
        """
        if self.state is State.OFF:
            return
        if delay_s > 0.0:
            self._awaited = (now_s + delay_s, trajectory)
        else:
            self._begin_motion(now_s, (now_s + delay_s, trajectory), reference_m)

    def advance(self, now_s: float, reference_m: float = nan) -> None:
        """Time has passed: a trajectory that was awaited begins, and one that runs counts as a setpoint of now."""
        if self._awaited is not None and now_s >= self._awaited[0]:
            self._begin_motion(now_s, self._awaited, reference_m)
        if self._motion is not None and now_s - self._motion[0] < self._motion[1].duration_s:
            self._heard_s = now_s

    def lose(self, why: str, at_bias: bool) -> None:
        """No setpoint has come for too long: the wire is held, or relaxes ``at_bias``, until the next."""
        if self._take(Event.TIMEOUT_BIAS if at_bias else Event.TIMEOUT_HOLD):
            self.lost, self._motion, self.armed = why, None, False

    def begun(self, now_s: float, position_m: float) -> None:
        """The controller has begun anew, with the wire at ``position_m``."""
        self.anew = False
        if self.mode is Mode.HOLD:
            self._position_m = position_m
        self._lead_in(now_s, position_m)

    def _begin_motion(self, now_s: float, motion: tuple[float, Trajectory], reference_m: float) -> None:
        if self._take(Event.TRAJECTORY):
            self._motion, self.armed = motion, False
            self._hear(now_s)
            self._lead_in(now_s, reference_m)

    def _lead_in(self, now_s: float, position_m: float) -> None:
        if self._motion is not None:
            start_s, trajectory = self._motion
            self._motion = start_s, trajectory.led_in(now_s - start_s, position_m)

    def _hear(self, now_s: float) -> None:
        self._heard_s, self._awaited, self.lost = now_s, None, ""

    # --- what is wanted now ------------------------------------------------------------------------

    def position_m(self, now_s: float) -> float:
        """Where the wire should be; NaN where that is not known (yet)."""
        if self._motion is not None:
            start_s, trajectory = self._motion
            return trajectory(now_s - start_s)
        return self._position_m

    def begins_in_s(self, now_s: float) -> float:
        """Time until a trajectory begins whose start is still to come; NaN where there is none."""
        return nan if self._awaited is None else self._awaited[0] - now_s

    def silent_s(self, now_s: float) -> float:
        """Time since a setpoint was last heard of."""
        return now_s - self._heard_s
