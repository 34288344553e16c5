"""The ROS arguments of a command line, read here so that nothing in a parameter file is lost.

rclpy ignores unknown parameters without a word, refuses ``250`` where ``250.0`` is wanted, and
rejects a whole file for a list of whole and broken numbers.  So ``--params-file`` and ``-p`` are
taken out of the arguments before rclpy sees them; what is left (remappings, log levels) is its own.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from sma_actuator.base.parameter_file import read_sections
from sma_actuator.base.parameters import ConfigError
from sma_actuator.base.sidecar import put_back
from sma_actuator.base.yaml_text import parse_yaml

_PARAMETERS = "ros__parameters"


@dataclass
class RosArguments:
    """A command line, taken apart."""

    user: list[str] = field(default_factory=list)  #: what is not between --ros-args and --
    rclpy: list[str] = field(default_factory=list)  #: what is left for ``rclpy.init``
    files: list[Path] = field(default_factory=list)
    assignments: list[tuple[str, str, Any]] = field(default_factory=list)  #: node pattern, parameter, value
    #: What stands in a file, for every node of it.
    _read: dict[Path, Mapping[str, Any]] = field(default_factory=dict, init=False, repr=False)

    @property
    def new_names(self) -> list[str]:
        """Names that remappings give the node (they would give them to every node of the process)."""
        return [found[1] for word in self.rclpy if (found := re.match(r"__(?:node|name):=(.*)", word, re.DOTALL))]

    def parameters_of(self, node: str) -> dict[str, Any]:
        """The parameters of the node with this fully qualified name; later sources override earlier ones.

        A section of the node's bare name, as ``left:``, is meant for it in any namespace, where its file has none for
        the full name: a launch file's ``namespace:=`` finds its parameters.
        Raises ConfigError where a file cannot be read or none speaks of this node.
        """
        merged: dict[str, Any] = {}
        found, sections = False, []
        for path in self.files:
            if path not in self._read:
                self._read[path] = read_sections(path)
            document = self._read[path]
            in_file = list(_sections(document))
            sections += [pattern for pattern, _ in in_file]
            bare = node.rpartition("/")[2]
            by_name = bare in document and not any(_matches(pattern, node) for pattern, _ in in_file)
            for pattern, values in in_file:
                if pattern == f"/{bare}" if by_name else _matches(pattern, node):
                    if not isinstance(values, Mapping):
                        raise ConfigError(
                            f"{path}: {pattern}: {_PARAMETERS} is {values!r}; a section of parameters is wanted"
                        )
                    found = True
                    _merge(merged, put_back(values, path))
        for pattern, name, value in self.assignments:
            if _matches(pattern, node):
                found = True
                _merge(merged, {name: value})
        if found:
            return merged
        if self.files:
            held = f"found {', '.join(sections)}" if sections else f"found no '{_PARAMETERS}:' at all"
            raise ConfigError(
                f"{', '.join(map(str, self.files))}: no section '{node.rsplit('/', 1)[-1]}: {_PARAMETERS}:' for the "
                f"node {node}; {held}"
            )
        raise ConfigError(f"the node {node} has no parameters; start it with --ros-args --params-file FILE")


def parse(arguments: list[str]) -> RosArguments:
    """Take a command line (without the program's name) apart.  Raises ConfigError."""
    out = RosArguments()
    rest = iter(arguments)
    inside = False
    for argument in rest:
        if argument == "--ros-args":
            inside = True
        elif not inside:
            out.user.append(argument)
        elif argument == "--":
            inside = False
        elif argument == "--params-file":
            out.files.append(Path(_next(rest, argument)))
        elif argument in ("-p", "--param"):
            out.assignments.append(_assignment(_next(rest, argument)))
        else:
            out.rclpy.append(argument)
    if out.rclpy:
        out.rclpy.insert(0, "--ros-args")
    return out


def _next(rest: Iterator[str], option: str) -> str:
    try:
        return next(rest)
    except StopIteration:
        raise ConfigError(f"{option}: something is wanted after it") from None


def _assignment(text: str) -> tuple[str, str, Any]:
    name, separator, value = text.partition(":=")
    pattern, colon, parameter = name.rpartition(":")
    if not separator or not parameter:
        raise ConfigError(f"-p {text}: is not of the form name:=value")
    return pattern if colon else "/**", parameter, parse_yaml(value, f"-p {text}")


def _sections(document: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Node patterns of a parameter file (namespaces may be nested) and what stands below them."""
    for key, value in document.items():
        pattern = f"{prefix}/{str(key).strip('/')}"
        if isinstance(value, Mapping):
            if _PARAMETERS in value:
                yield pattern, value[_PARAMETERS] or {}
            else:
                yield from _sections(value, pattern)


def _matches(pattern: str, node: str) -> bool:
    """Whether a pattern, with * for one part of the name and /** for any number, means this node."""
    tokens = [
        "(/.*)?" if t == "**" else "/[^/]+" if t == "*" else "/" + re.escape(t) for t in pattern.strip("/").split("/")
    ]
    return re.fullmatch("".join(tokens), node) is not None


def _merge(into: dict[str, Any], values: Mapping[str, Any]) -> None:
    for key, value in values.items():
        head, _, rest = str(key).partition(".")
        if rest:
            value = {rest: value}
        if isinstance(value, Mapping):
            if not isinstance(into.get(head), dict):
                into[head] = {}
            _merge(into[head], value)
        else:
            into[head] = value
