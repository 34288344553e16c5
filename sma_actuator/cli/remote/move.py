"""``sma-actuator move``: the wire to a position, and held there."""

from __future__ import annotations

import argparse
import time

from sma_actuator.base.errors import UserError
from sma_actuator.base.signals import Mode, Status

from .client import NodeClient, add_node_arguments, connected
from .watch import line, listen_to_motion

SETPOINT_PERIOD_s = 0.05
THERE_s = 0.5  #: within the tolerance for so long, it is there
ENDED_s = 3.0  #: for the node to say that it holds the wire
LINE_s = 1.0
FURTHEST_m = 0.5  #: no wire moves so far: who asks for it means millimetres


def metres(text: str) -> float:
    """A position [m] as it was typed, ``0.0025`` or ``2.5mm``.  Raises argparse.ArgumentTypeError."""
    number, factor = (text.removesuffix("mm"), 1e-3) if text.endswith("mm") else (text, 1.0)
    try:
        position_m = float(number) * factor
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is no position; 0.0025 (metres) or 2.5mm is wanted") from None
    if not abs(position_m) <= FURTHEST_m:
        raise argparse.ArgumentTypeError(
            f"{position_m:g} m is further than a wire moves; 0.0025 (metres) or 2.5mm is wanted"
        )
    return position_m


def add_arguments(parser) -> None:
    """Declare the options of ``sma-actuator move``."""
    parser.add_argument(
        "position", type=metres, metavar="M", help="where to, in metres or with mm, extension positive: 0.0025, 2.5mm"
    )
    parser.add_argument(
        "--within", type=float, default=20.0, metavar="S", help="give up after this time (default %(default)s)"
    )
    parser.add_argument(
        "--tolerance",
        type=metres,
        default=0.05e-3,
        metavar="M",
        help="near enough, in metres or with mm (default %(default)s)",
    )
    add_node_arguments(parser)


def run(args) -> int:
    """Send setpoints until the wire is there; it is held where it is then, on every way out.  0 where it came there."""
    with connected(args) as client:
        from std_msgs.msg import Float64
        from trajectory_msgs.msg import JointTrajectory

        listen_to_motion(client)
        status = client.status()
        if status.mode is Mode.OFF:
            raise UserError(f"{client.full_name}: {status.message}; switch it on first: sma-actuator enable")
        client.advertise("setpoint", Float64)
        client.advertise("joint_trajectory", JointTrajectory)
        try:
            took_s = _send(client, args)
        finally:
            client.finish()
            # Without points it ends the motion: a setpoint that nobody repeats any more would count as lost.
            client.publish("joint_trajectory", JointTrajectory())
            held = client.wait_for_status(lambda s: s.mode is not Mode.TRACKING, ENDED_s)
        print(f"there after {took_s:.1f} s; {'held there' if held else 'the node has not said that it holds the wire'}")
        print(line(client))
    return 0 if held else 1


def _send(client: NodeClient, args) -> float:
    """Send the setpoint until the estimate has been near it for a while; the time that took.  Raises UserError."""
    from sma_msgs_py import setpoint_message

    start_s = time.monotonic()
    near_since_s: float | None = None
    next_line_s = start_s
    while (now_s := time.monotonic()) - start_s <= args.within:
        client.publish("setpoint", setpoint_message(args.position))
        client.spin(SETPOINT_PERIOD_s)
        status = client.status()
        if status.mode is Mode.OFF or _refused(status):
            raise UserError(f"{client.full_name}: {status.message}")
        state = client.latest("joint_states", 1.0)
        if state is None or not abs(state.position[0] - args.position) <= args.tolerance:
            near_since_s = None
        else:
            near_since_s = now_s if near_since_s is None else near_since_s
            if now_s - near_since_s >= THERE_s:
                return now_s - start_s
        if now_s >= next_line_s and not args.quiet:
            print(line(client), flush=True)
            next_line_s += LINE_s
    raise UserError(f"{client.full_name}: not there within {args.within:g} s; {line(client)}")


def _refused(status: Status) -> bool:
    return status.fault in ("setpoint_not_finite", "setpoint_flood")
