"""What a node offers, in the words of the command line: its sentences name services (``~/enable``), since that is what
it has."""

from __future__ import annotations

import argparse
import re

NODE_NAME = "sma_actuator"  #: of a node that is given no other

#: What follows ``~/`` → the command that does it.
_COMMANDS = {
    "enable false": "enable --off",
    "enable": "enable",
    "stop": "stop",
    "status": "status",
    "tune": "tune --running",
    **{name: f"call {name}" for name in ("clear_fault", "self_test", "tare_load", "measure_lead_resistance")},
}
#: Characters of a node's name with its namespace: topics and services of ROS 2 have 247, and the longest that a node
#: adds, those of its action, take 45.
LONGEST_NODE_NAME = 200
_NODE = re.compile(r"[A-Za-z_]\w*", re.ASCII)
NODES_NAMES = f"letters, digits and _ are wanted, no digit first, {LONGEST_NODE_NAME} characters at the most"
_NAMED = re.compile(rf"~/({'|'.join(_COMMANDS)})\b")


def is_node_name(name: str) -> bool:
    """Whether ROS 2 takes it as the name of a node."""
    return len(name) <= LONGEST_NODE_NAME and _NODE.fullmatch(name) is not None


def node_name(text: str) -> str:
    """A node's name of an option, with or without its namespace.  Raises argparse.ArgumentTypeError."""
    if text.strip("/") and namespace(text):
        return text.strip("/")
    raise argparse.ArgumentTypeError(f"{text[:60]!r} is no name of a node: {NODES_NAMES}")


def namespace(text: str) -> str:
    """A namespace of an option, none where it is empty.  Raises argparse.ArgumentTypeError."""
    inside = text.strip("/")
    if len(inside) <= LONGEST_NODE_NAME and all(map(is_node_name, inside.split("/") if inside else ())):
        return f"/{inside}"
    raise argparse.ArgumentTypeError(f"{text[:60]!r} is no name of a node or namespace: {NODES_NAMES}")


def as_commands(sentence: str, options: str = "") -> str:
    """The sentence with commands for services; ``options``: which node is meant, where it is not the usual one."""
    return _NAMED.sub(lambda found: f"`sma-actuator {_COMMANDS[found[1]]}{options}`", sentence)
