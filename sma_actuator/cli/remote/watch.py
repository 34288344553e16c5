"""``sma-actuator watch``: a line now and then on what the wire does, until Ctrl-C."""

from __future__ import annotations

import math
import time

from sma_actuator.base.newtons import newtons
from sma_actuator.base.options import number_within
from sma_actuator.base.signals import Mode, Status

from .client import NodeClient, add_node_arguments, connected

#: Beyond this age nothing that was heard is shown as if it were so.
STALE_s = 3.0


def add_arguments(parser) -> None:
    """Declare the options of ``sma-actuator watch``."""
    add_node_arguments(parser)
    parser.add_argument(
        "--every", type=number_within(0.01), default=1.0, metavar="S", help="time between lines (default %(default)s)"
    )
    parser.add_argument(
        "--duration",
        type=number_within(0.0),
        default=math.inf,
        metavar="S",
        help="end after this time (default: with Ctrl-C)",
    )


def run(args) -> int:
    """Print lines; a node that falls silent is said to, and found again."""
    with connected(args) as client:
        from sma_msgs_py import status_from

        listen_to_motion(client)
        start_s = time.monotonic()
        try:
            while (elapsed_s := time.monotonic() - start_s) <= args.duration:
                print(f"{elapsed_s:7.1f} s  {line(client)}", flush=True)
                client.spin(max(min(args.every, args.duration - elapsed_s), 0.01))
        finally:  # Ctrl-C is how it ends
            if (status := client.latest("status", STALE_s)) is not None:
                client.say_next(args, after(client, status_from(status)))
    return 0


def is_joint(status: Status) -> bool:
    """Whether a node turns a joint: it has an angle, and no displacement."""
    return "angle_rad" in status.values


def after(client: NodeClient, status: Status) -> str:
    """What to do with a node in a state."""
    if status.mode is Mode.OFF:
        if status.values.get("lifecycle", "active") != "active":
            return "once the node is ready, ~/enable"
        from sma_actuator.safety.faults import FAULTS  # with kernels, which take longest to import

        fault = FAULTS.get(status.fault)
        if fault is None:
            return "~/enable"
        return f"mend what it says, then {'~/enable' if fault.until_back else '~/clear_fault and ~/enable'}"
    return f"`sma-actuator move {'0.1rad' if is_joint(status) else '40%'}{client.options}`, or ~/stop"


def listen_to_motion(client: NodeClient) -> Status:
    """Position, load and current, as they come; the state of the node once the first have.  Raises UserError."""
    from geometry_msgs.msg import WrenchStamped
    from sensor_msgs.msg import JointState
    from std_msgs.msg import Float64

    client.listen("load", WrenchStamped)
    client.listen("command_current", Float64)
    client.listen("joint_states", JointState)
    status = client.status()
    shown = [] if is_joint(status) else ["load", "command_current"]
    if status.mode is not Mode.OFF:  # which has no position
        shown.append("joint_states")
    client.wait_until_heard(shown, STALE_s)
    return client.status()


def line(client: NodeClient) -> str:
    """What is known now, on a line; what has not been heard of for a while is a dash."""
    from sma_msgs_py import status_from

    status = client.latest("status", STALE_s)
    if status is None:
        return f"nothing has been heard of {client.full_name} for {STALE_s:g} s"
    values = {pair.key: pair.value for pair in status.values}
    state, load, current = (client.latest(topic, 1.0) for topic in ("joint_states", "load", "command_current"))
    if is_joint(status_from(status)):
        angle_rad = state and state.position[0]
        return (
            f"angle {_number(angle_rad and math.degrees(angle_rad), '6.2f')}° = {_number(angle_rad, '6.3f')} rad "
            f"± {_number(_known(values.get('uncertainty_rad'), 1.0), '5.3f')}  "
            f"co-contraction {_number(state and state.effort[0], '5.3f')} N  {client.words(status.message)}"
        )
    return (
        f"position {_number(state and state.position[0] * 1e3, '6.3f')} mm "
        f"± {_number(_known(values.get('uncertainty_m'), 1e3), '5.3f')}  "
        f"load {'–' if load is None else newtons(load.wrench.force.x):>6} N  "
        f"current {_number(current and current.data * 1e3, '5.1f')} mA  {client.words(status.message)}"
    )


def _known(text: str | None, factor: float) -> float | None:
    value = float(text) * factor if text else math.nan
    return value if math.isfinite(value) else None


def _number(value: float | None, form: str) -> str:
    return "–" if value is None else f"{value:{form}}"
