"""What a node offers, in the words of the command line: its sentences name services (``~/enable``), since that is what
it has."""

from __future__ import annotations

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
_NAMED = re.compile(rf"~/({'|'.join(_COMMANDS)})\b")


def as_commands(sentence: str, options: str = "") -> str:
    """The sentence with commands for services; ``options``: which node is meant, where it is not the usual one."""
    return _NAMED.sub(lambda found: f"`sma-actuator {_COMMANDS[found[1]]}{options}`", sentence)
