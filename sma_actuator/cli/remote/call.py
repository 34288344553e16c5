"""``sma-actuator call``: one of the node's services that want no argument, as ``clear_fault`` or ``self_test``."""

from __future__ import annotations

from sma_actuator.base.errors import UserError

from .client import add_node_arguments, connected
from .watch import after

#: A self-test looks at every channel and waits for the watchdog.
LONGEST_s = 120.0


def add_arguments(parser) -> None:
    """Declare the options of ``sma-actuator call``."""
    parser.add_argument("service", metavar="SERVICE", help="its name: clear_fault, tare_load, self_test …")
    add_node_arguments(parser)


def run(args) -> int:
    """Call it and print the node's sentence; 0 where the node has done it."""
    name = args.service.removeprefix("~").strip("/")
    with connected(args) as client:
        from diagnostic_msgs.srv import SelfTest
        from std_srvs.srv import Trigger

        kinds = {"std_srvs/srv/Trigger": Trigger, "diagnostic_msgs/srv/SelfTest": SelfTest}
        client.status()  # a node that is not there has no services
        offered = {service: kinds[kind] for service, kind in client.services().items() if kind in kinds}
        if name not in offered:
            raise UserError(f"{client.full_name} has no service {name}; it has {', '.join(sorted(offered))}")
        kind = offered[name]
        response = client.call(name, kind, kind.Request(), max(args.patience, LONGEST_s))
        status = client.status()
    if kind is Trigger:
        print(f"{client.full_name}: {client.words(response.message)}")
        if response.success:
            client.say_next(args, "~/enable" if name == "clear_fault" else after(client, status))
        return 0 if response.success else 1
    for part in response.status:
        print(f"{part.name}: {client.words(part.message)}")
    if response.passed != b"\0":
        client.say_next(args, after(client, status))
    return 0 if response.passed != b"\0" else 1
