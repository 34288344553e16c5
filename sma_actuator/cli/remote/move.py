"""``sma-actuator move``: a wire to a position, or a joint to an angle, and held there."""

from __future__ import annotations

import argparse
import math
import re
import sys
import time
from dataclasses import dataclass
from typing import Any

from sma_actuator.base.errors import UserError
from sma_actuator.base.options import number_within
from sma_actuator.base.signals import Mode, Status
from sma_actuator.logs.units import quantity

from .client import NodeClient, add_node_arguments, connected
from .watch import after, is_joint, line, listen_to_motion

SETPOINT_PERIOD_s = 0.05
THERE_s, THERE_READINGS = 0.5, 4  #: within the tolerance for so long and in so many readings, it is there
ENDED_s = 3.0  #: for the node to say that it holds the wire
LINE_s = 1.0
FURTHEST_m = 0.5  #: no wire moves so far: who asks for it means millimetres
NEAR_m, NEAR_rad = 0.05e-3, 0.01  #: what counts as there
NEAR_SHARE = 0.0125  #: of what a wire reaches, where that is more: of a coil
_BEYOND = {"setpoint_range", "angle_range"}  #: limits by which a node says that it does not follow so far
_ANGLES = {"rad": 1.0, "deg": math.pi / 180.0, "°": math.pi / 180.0}
_WIRE, _JOINT = "0.0025 (metres) or 2.5mm is wanted", "0.2 (radians), 0.2rad or 10deg is wanted"


@dataclass(frozen=True, slots=True)
class Place:
    """A place as it was typed: a length [m], an angle [rad], a share of the way [%], or a bare number, in the unit of
    what is moved."""

    value: float
    unit: str  #: m, rad, % or ""


def place(text: str) -> Place:
    """``0.0025``, ``2.5mm``, ``40%``, ``0.2rad`` or ``10deg``.  Raises argparse.ArgumentTypeError."""
    if text.strip().endswith("%"):
        share = quantity(text, "%")
        if share is None or not 0.0 <= share <= 100.0:
            raise argparse.ArgumentTypeError(f"'{text}' is no share of a wire's way; 0% (contracted) to 100% is wanted")
        return Place(share, "%")
    symbol = next((unit for unit in _ANGLES if text.endswith(unit)), "")
    number = quantity(text.removesuffix(symbol), "rad" if symbol else "m")
    if number is None:
        raise argparse.ArgumentTypeError(f"'{text}' is no position; {_WIRE} (of a joint: 0.2rad or 10deg)")
    if symbol:
        return Place(number * _ANGLES[symbol], "rad")
    if not abs(number) <= FURTHEST_m:
        raise argparse.ArgumentTypeError(
            f"{number:g} m is further than a wire moves; {_WIRE} (of a joint: 0.2rad or 10deg)"
        )
    return Place(number, "m" if text.strip()[-1].isalpha() else "")


def add_arguments(parser) -> None:
    """Declare the options of ``sma-actuator move``."""
    parser._negative_number_matcher = re.compile(r"-\.?\d")  # -10deg is a place, and no option
    parser.add_argument(
        "position",
        type=place,
        metavar="PLACE",
        help="where to: a wire, in metres or with mm, extension positive (0.0025, 2.5mm), or 0%% (contracted) to 100%% "
        "of what it reaches; a joint, in radians or with deg (0.2, 10deg)",
    )
    parser.add_argument(
        "--within",
        type=number_within(0.0),
        default=20.0,
        metavar="S",
        help="give up after this time (default %(default)s)",
    )
    parser.add_argument(
        "--tolerance",
        type=place,
        metavar="SIZE",
        help=f"near enough, as the position (default {NEAR_m * 1e3:g}mm, or 1/80 of what the wire reaches; of a joint "
        f"{NEAR_rad:g}rad)",
    )
    add_node_arguments(parser)


def run(args) -> int:
    """Send setpoints until it is there, where it is held then; on every other way out it is held where it is.  0 where
    it came there."""
    with connected(args) as client:
        from trajectory_msgs.msg import JointTrajectory

        status = listen_to_motion(client)
        if status.mode is Mode.OFF:
            then = after(client, status)
            first = f"; switch it on first: {then}" if then == "~/enable" else f"; {then}"
            advised = "~/enable" in status.message  # as that of a fault is
            raise UserError(client.words(f"{client.full_name}: {status.message}{'' if advised else first}"))
        if joint := status.values.get("turned_by"):
            raise UserError(
                f"{client.full_name}: {joint} drives this wire with another; move that, as `sma-actuator move 0.1rad "
                f"--node {str(joint).rpartition('/')[2]}`"
            )
        motion = _of_joint(client, args) if is_joint(status) else _of_wire(client, args, status)
        client.advertise(motion.topic, type(motion.message))
        client.advertise("joint_trajectory", JointTrajectory)
        if status.mode is Mode.TRACKING and client.others_publish(motion.topic):
            said = f"{client.full_name}: another program sends it setpoints too; the last one that comes counts"
            print(said, file=sys.stderr, flush=True)
        try:
            took_s = _send(client, motion, args)
            if not is_joint(status):
                client.publish("joint_trajectory", _at(client.latest("joint_states").name[0], motion.asked))
        finally:
            client.finish()
            # Without points it ends the motion: a setpoint that nobody repeats any more would count as lost.  It ends
            # where the reference of a trajectory has come, and of a setpoint, which may be far, where the wire is.
            client.publish("joint_trajectory", JointTrajectory())
            held = client.wait_for_status(lambda s: s.mode is not Mode.TRACKING, ENDED_s)
        print(f"there after {took_s:.1f} s; {'held there' if held else 'the node has not said that it holds the wire'}")
        print(line(client))
        client.say_next(
            args, "`sma-actuator watch" + client.options + "`, or ~/stop" if held else "~/status, or ~/stop"
        )
    return 0 if held else 1


@dataclass(frozen=True, slots=True)
class _Motion:
    """What is sent, and from when on it has come to pass."""

    topic: str
    message: Any
    asked: float
    near: float


def _at(joint_name: str, position_m: float) -> Any:
    """A trajectory that has come to its end from the beginning."""
    from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

    return JointTrajectory(joint_names=[joint_name], points=[JointTrajectoryPoint(positions=[position_m])])


def beyond_words(asked: float, status: Status) -> str:
    """A sentence where a place [m, of a joint rad] that was sent is beyond what can be reached now, as the node says
    itself, or "": a little beyond its end a wire may be followed."""
    low, high = _reach(status)
    if _BEYOND.isdisjoint(status.limits) or not math.isfinite(high - low) or low <= asked <= high:
        return ""
    end = low if asked < low else high
    if is_joint(status):
        return (
            f"{asked:.3f} rad is beyond where the joint can be held, {low:.3f} to {high:.3f} rad; it is held at "
            f"{end:.3f} rad"
        )
    return (
        f"{asked * 1e3:.3f} mm is beyond where the wire can be held at this load, {low * 1e3:.3f} to "
        f"{high * 1e3:.3f} mm; it {'is held at its short' if asked < low else 'goes to its long'} end, "
        f"{end * 1e3:.3f} mm"
    )


def _of_wire(client: NodeClient, args, status: Status) -> _Motion:
    """Raises UserError for a share of a way that nobody knows."""
    from sma_msgs_py import setpoint_message

    low_m, high_m = _reach(status)
    known = math.isfinite(high_m - low_m)
    if args.position.unit == "%":
        if not known:
            raise UserError(f"{client.full_name}: it is not known how far the wire reaches at this load; {_WIRE}")
        args.position = Place(low_m + args.position.value / 100.0 * (high_m - low_m), "m")
    usual_m = max(NEAR_m, NEAR_SHARE * (high_m - low_m)) if known else NEAR_m
    asked_m, near_m = _in(args.position, "m", _WIRE), _in(args.tolerance or Place(usual_m, "m"), "m", _WIRE)
    if known and not args.quiet:
        reach = f"{low_m * 1e3:.3f} (0%) to {high_m * 1e3:.3f} mm (100%)"
        print(f"to {asked_m * 1e3:.3f} mm; at this load the wire can be held from {reach}", flush=True)
    return _Motion("setpoint", setpoint_message(asked_m), asked_m, near_m)


def _reach(status: Status) -> tuple[float, float]:
    """From where to where it reaches, a wire at its load [m], a joint with its tension [rad]; NaN where that is not
    known."""
    ends = ("lowest_rad", "highest_rad") if is_joint(status) else ("shortest_m", "longest_m")
    low, high = (status.values.get(name) for name in ends)
    return low if isinstance(low, float) else math.nan, high if isinstance(high, float) else math.nan


def _of_joint(client: NodeClient, args) -> _Motion:
    """The co-contraction stays what it is."""
    from sma_msgs_py import pair_command_message

    asked_rad = _in(args.position, "rad", _JOINT)
    near_rad = _in(args.tolerance or Place(NEAR_rad, "rad"), "rad", _JOINT)
    joint_name = client.latest("status").hardware_id
    return _Motion("joint_command", pair_command_message(joint_name, asked_rad), asked_rad, near_rad)


def _in(given: Place, unit: str, wanted: str) -> float:
    if given.unit not in ("", unit):
        raise UserError(f"{given.value:g} {given.unit} is nothing that this node moves by; {wanted}")
    return given.value


class Standing:
    """What was seen near a place: two readings of a slow loop are half a second, and a wire that goes by."""

    def __init__(self) -> None:
        self._since_s = math.inf
        self._stamps: set[tuple[int, int]] = set()

    def seen(self, stamp: tuple[int, int], now_s: float) -> bool:
        """A reading of this stamp, which may be one that was seen; whether it is there by now."""
        self._since_s = min(self._since_s, now_s)
        self._stamps.add(stamp)
        return now_s - self._since_s >= THERE_s and len(self._stamps) >= THERE_READINGS


def _send(client: NodeClient, motion: _Motion, args) -> float:
    """Send it until the estimate has been near it for a while; the time that took.

    Raises UserError where it does not come there, as soon as it is at the end before it.
    """
    start_s = time.monotonic()
    standing, next_line_s, told = Standing(), start_s, False
    while (now_s := time.monotonic()) - start_s <= args.within:
        client.publish(motion.topic, motion.message)
        client.spin(SETPOINT_PERIOD_s)
        status = client.status()
        if status.mode is Mode.OFF or _refused(status):
            raise UserError(client.words(f"{client.full_name}: {status.message}"))
        state = client.latest("joint_states", 1.0)
        beyond, (low, high) = beyond_words(motion.asked, status), _reach(status)
        if beyond and not told:
            print(f"{client.full_name}: {beyond}", file=sys.stderr, flush=True)
            told = True
        aim = min(max(motion.asked, low), high) if beyond else motion.asked
        if state is None or not abs(state.position[0] - aim) <= motion.near:
            standing = Standing()
        elif standing.seen((state.header.stamp.sec, state.header.stamp.nanosec), now_s):
            if abs(aim - motion.asked) > motion.near:
                raise UserError(f"{client.full_name}: it is at the end of its way; {beyond}; {line(client)}")
            return now_s - start_s
        if now_s >= next_line_s and not args.quiet:
            print(line(client), flush=True)
            next_line_s += LINE_s
    raise UserError(f"{client.full_name}: not there within {args.within:g} s; {line(client)}")


def _refused(status: Status) -> bool:
    return status.fault in ("setpoint_not_finite", "setpoint_flood")
