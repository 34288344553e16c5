"""``sma-actuator enable``: current on, the wire is held where it is; or off again."""

from __future__ import annotations

import dataclasses
import math

from sma_actuator.base.signals import Mode

from .client import OFF_AGAIN_s, add_node_arguments, connected
from .watch import after


def add_arguments(parser) -> None:
    """Declare the options of ``sma-actuator enable``."""
    add_node_arguments(parser)
    parser.add_argument("--off", action="store_true", help="switch this wire off (stop: every wire of the process)")


def run(args) -> int:
    """Switch; 0 where the node has done it."""
    with connected(args) as client:
        from std_srvs.srv import SetBool

        status = client.status()  # a node whose instruments are not open yet answers with its state
        response = client.call(
            "enable", SetBool, SetBool.Request(data=not args.off), again_s=OFF_AGAIN_s if args.off else math.inf
        )
        if response.success:
            client.wait_until_said(on=not args.off)
    print(f"{client.full_name}: {client.words(response.message)}")
    if response.success:
        mode = Mode.OFF if args.off else Mode.HOLD
        client.say_next(args, after(client, dataclasses.replace(status, mode=mode, fault="")))
    return 0 if response.success else 1
