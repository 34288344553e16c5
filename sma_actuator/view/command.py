"""``sma-actuator view``."""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import errno
import faulthandler
import ipaddress
import socket
import time
from pathlib import Path

from sma_actuator.base.commands import NODE_NAME, namespace, node_name
from sma_actuator.base.errors import UserError, without_ros
from sma_actuator.base.interrupts import Interrupts, noted_signals
from sma_actuator.base.options import number_within
from sma_actuator.base.parameter_file import read_parameter_file
from sma_actuator.config import Config
from sma_actuator.console import notes

PORT = 8765
#: How often the main thread looks whether a signal was noted.
SIGNAL_INTERVAL_s = 0.1
#: Pages, tasks, threads and ROS have so long to end: twice what they may take in turn, an answer (3 s), the pages and
#: the thread of ROS (1 s each).
END_s = 10.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``sma-actuator view``."""
    parser.add_argument(
        "--node",
        nargs="+",
        type=node_name,
        default=[NODE_NAME],
        metavar="NAME",
        help=f"names of nodes, of wires and of joints, a tab for each (default {NODE_NAME})",
    )
    parser.add_argument(
        "--namespace", type=namespace, default="/", metavar="NS", help="namespace of the nodes (default %(default)s)"
    )
    parser.add_argument(
        "--port", type=number_within(0, 65535, int), default=PORT, help="0: any that is free (default %(default)s)"
    )
    parser.add_argument(
        "--host",
        default="127.0.0.1",
        metavar="ADDRESS",
        help="address to listen on; whoever reaches another than %(default)s can read what passes, the token too: "
        "from elsewhere rather ssh -L 8765:127.0.0.1:8765",
    )
    parser.add_argument(
        "--foxglove",
        action="store_true",
        help="serve Foxglove and Lichtblick instead of a page: the node's topics, to look at only",
    )
    parser.add_argument(
        "--config",
        type=Path,
        metavar="FILE",
        help="the node's parameter file: gains are saved to it, and its model is that of logs dropped while no node is "
        "there",
    )


#: Packages of this command's own extras, by what is imported of them; the others are ROS 2's.
_BROUGHT = {"foxglove": ("foxglove-sdk", "foxglove"), "aiohttp": ("aiohttp", "view")}


def run(args: argparse.Namespace) -> int:
    """Serve until a signal comes; 0 then."""
    host = _address(args.host)
    nodes = [f"{args.namespace.rstrip('/')}/{name}" for name in dict.fromkeys(args.node)]
    try:
        (_run_foxglove if args.foxglove else _run_page)(nodes, host, args)
    except ModuleNotFoundError as error:
        if error.name not in _BROUGHT:
            raise without_ros(error) from None
        package, extra = _BROUGHT[error.name]
        raise UserError(f"needs the Python package '{package}' (extra '{extra}')") from error
    return 0


def _run_page(nodes: list[str], host: str, args: argparse.Namespace) -> None:
    with _listening(host, args.port) as listening:  # first: to load and to join ROS takes seconds
        from .server import Desk, ViewServer
        from .watched import WatchedNode

        configs = [_config(args.config, node.rpartition("/")[2]) for node in nodes]
        with noted_signals() as interrupts, contextlib.ExitStack() as stack:
            stack.callback(faulthandler.cancel_dump_traceback_later)
            desks = []
            for node, config in zip(nodes, configs, strict=True):
                wire = WatchedNode(node)
                stack.callback(wire.close)
                desks.append(Desk(wire, config, args.config))
            asyncio.run(_serve(ViewServer(desks, host), host, listening, args, interrupts))


def _config(file: Path | None, name: str) -> Config | None:
    """The configuration of a node's wire; None without a file, and of a joint.  Raises ConfigError."""
    if file is None:
        return None
    mapping = read_parameter_file(file, name)
    return None if "wires" in mapping else Config.from_mapping(mapping, source=str(file))


def _run_foxglove(nodes: list[str], host: str, args: argparse.Namespace) -> None:
    from .foxglove import Topics

    if args.config:
        raise UserError("--config: Foxglove only looks; gains are saved from the page, without --foxglove")
    with noted_signals() as interrupts, contextlib.closing(Topics(nodes, host, args.port)) as topics:
        print(f"ws://{_shown(host)}:{topics.port}", flush=True)
        notes(args).print(
            "in Foxglove or Lichtblick: Open connection, Foxglove WebSocket, this address; then import "
            "layouts/foxglove.json"
        )
        while not interrupts:
            time.sleep(SIGNAL_INTERVAL_s)


def _address(host: str) -> str:
    """The one address to listen on.  Raises UserError where it is none, or stands for all."""
    try:
        address = ipaddress.ip_address("127.0.0.1" if host == "localhost" else host.strip("[]"))
    except ValueError:
        raise UserError(f"--host: '{host}' is no address; one as 127.0.0.1 is wanted") from None
    if address.is_unspecified:
        raise UserError(f"--host: {host} stands for every address of this machine; name the one that may be asked")
    return str(address)


def _shown(host: str) -> str:
    return f"[{host}]" if ":" in host else host


def _listening(host: str, port: int) -> socket.socket:
    """A socket that listens.  Raises UserError where the port cannot be had."""
    try:
        return socket.create_server((host, port), family=socket.AF_INET6 if ":" in host else socket.AF_INET)
    except (OSError, OverflowError) as error:
        in_use = isinstance(error, OSError) and error.errno == errno.EADDRINUSE
        why = f"port {port} is in use" if in_use else f"port {port} cannot be opened ({error})"
        raise UserError(f"--port: {why} on {host}; --port 0 takes one that is free") from error


async def _serve(server, host: str, listening: socket.socket, args: argparse.Namespace, interrupts: Interrupts) -> None:
    from aiohttp import web

    runner = web.AppRunner(server.app, access_log=None, shutdown_timeout=1.0)
    await runner.setup()
    try:
        await web.SockSite(runner, listening).start()
        print(f"http://{_shown(host)}:{listening.getsockname()[1]}/#token={server.token}", flush=True)
        notes(args).print("open this address in a browser on this machine; Ctrl-C ends the page, not the node")
        while not interrupts:
            await asyncio.sleep(SIGNAL_INTERVAL_s)
    finally:
        faulthandler.dump_traceback_later(END_s, exit=True)
        with contextlib.suppress(asyncio.CancelledError):
            await runner.cleanup()
