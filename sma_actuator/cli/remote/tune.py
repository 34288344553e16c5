"""A tuning by a running node: begun, watched, and what it has found."""

from __future__ import annotations

import argparse
import math
import time

from sma_actuator.base.errors import UserError
from sma_actuator.base.signals import Mode, Tuned
from sma_actuator.console import notes
from sma_actuator.control.tuning import GAINS

from .client import NodeClient, connected

#: Between two looks at the status, which comes once a second.
LOOK_s = 0.2
#: The node has fallen silent; and a tuning that has not ended by then never will.
SILENCE_s, LONGEST_s = 10.0, 900.0


def by_node(args: argparse.Namespace) -> Tuned:
    """Have the node tune its wire; on every way out the wire is held.  Raises UserError where it came to nothing."""
    with connected(args) as client:
        from std_srvs.srv import Trigger
        from trajectory_msgs.msg import JointTrajectory

        of_before = client.status().values.get("tuning")
        before = _gains(client)
        client.advertise("joint_trajectory", JointTrajectory)
        begun_s = time.monotonic()
        answer = client.call("tune", Trigger, Trigger.Request())
        if not answer.success:
            raise UserError(client.words(f"{client.full_name}: {answer.message}"))
        console = notes(args)
        console.print(answer.message)
        try:
            outcome, words = "", of_before
            while not outcome:
                client.spin(LOOK_s)
                if client.latest("status", SILENCE_s) is None or time.monotonic() - begun_s > LONGEST_s:
                    raise UserError(f"{client.full_name}: not heard of the end of the tuning")
                status = client.status()
                tuning = str(status.values.get("tuning", ""))
                if tuning != words and status.mode is Mode.TUNING:
                    words = tuning
                    console.print(words)
                elif tuning != words:
                    outcome = tuning
        finally:
            client.finish()
            if not outcome:
                client.publish("joint_trajectory", JointTrajectory())  # without points it ends what moves the wire
                client.spin(LOOK_s)
        if not outcome.startswith("done"):
            raise UserError(f"{client.full_name}: {outcome}")
        return Tuned(_gains(client), before, {}, time.monotonic() - begun_s)


def _gains(client: NodeClient) -> dict[str, float]:
    """The gains that the node has now."""
    from rcl_interfaces.srv import GetParameters

    request = GetParameters.Request(names=[f"controller.{name}" for name in GAINS])
    values = client.call("get_parameters", GetParameters, request).values
    gains = {name: float(value.double_value) for name, value in zip(GAINS, values, strict=False) if value.type == 3}
    if len(gains) < len(GAINS) or not all(math.isfinite(value) for value in gains.values()):
        raise UserError(f"{client.full_name}: its control law has no gains of a PID")
    return gains
