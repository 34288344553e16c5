"""``sma-actuator stop``: every wire of the node's process off."""

from __future__ import annotations

from .client import OFF_AGAIN_s, add_node_arguments, connected


def add_arguments(parser) -> None:
    """Declare the options of ``sma-actuator stop``."""
    add_node_arguments(parser)


def run(args) -> int:
    """Switch off; 0 where every supply has confirmed it."""
    with connected(args) as client:
        from std_srvs.srv import Trigger

        response = client.call("stop", Trigger, Trigger.Request(), again_s=OFF_AGAIN_s)
        if response.success:
            client.wait_until_said(on=False)
    print(client.words(response.message))
    return 0 if response.success else 1
