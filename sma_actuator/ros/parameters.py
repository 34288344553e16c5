"""The parameters of a node, declared to ROS with all that is known of them, and changed live where they may be."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, Generic, Protocol, Self, TypeVar

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from sma_actuator.base.parameters import ConfigError, Declaration, loosened, no_such_parameter, walk

#: Parameters every ROS 2 node has; rclpy gives them their meaning.
ROS_PARAMETERS = ("use_sim_time", "start_type_description_service")
NO_SIM_TIME = (
    "use_sim_time: true is refused: the instruments measure in real time, so what they measured is stamped by the "
    "system's clock"
)


class Sections(Protocol):
    """All parameters of a node."""

    def replace(self, changes: Mapping[str, Any]) -> Self:
        """A copy with some changed, checked as a whole; raises ConfigError."""


Parameters = TypeVar("Parameters", bound=Sections)


class NodeParameters(Generic[Parameters]):
    """Declares ``config`` on ``node`` and holds it as it changes; ``on_change(config, names)`` is told of every change.

    A request may want hundreds to be set, one after another: ``alive`` is called before each.  While current ``flows``
    no change is taken that guards less; at other times it is, and the log says so.
    """

    def __init__(
        self,
        node: Node,
        config: Parameters,
        on_change: Callable[[Parameters, list[str]], None],
        alive: Callable[[], None] = lambda: None,
        flows: Callable[[], bool] = lambda: False,
    ):
        self.config = self._begun_with = config
        self._key_values: dict[str, str] = {}
        self._on_change, self._alive, self._flows = on_change, alive, flows
        self._log = node.get_logger()
        self._declarations: dict[str, tuple[Declaration, str]] = {}
        for name, value, declaration, kind in walk(config):
            self._declarations[name] = declaration, kind
            if isinstance(value, tuple):
                if not value:
                    continue  # not given; an empty list has no type in ROS
                value = list(value)
            node.declare_parameter(name, value, _descriptor(declaration, kind))
        node.add_pre_set_parameters_callback(self._as_declared)
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._apply)

    def _as_declared(self, parameters: list[Parameter]) -> list[Parameter]:
        """Accept ``250`` where a float is wanted, as everybody types it, and ``3.0`` for a whole number."""
        self._alive()
        return [self._converted(parameter) for parameter in parameters]

    def _converted(self, parameter: Parameter) -> Parameter:
        kind = self._declarations.get(parameter.name, (None, ""))[1]
        if parameter.type_ is Parameter.Type.INTEGER and kind == "float":
            return Parameter(parameter.name, value=float(parameter.value))
        if parameter.type_ is Parameter.Type.DOUBLE and kind == "int" and parameter.value.is_integer():
            return Parameter(parameter.name, value=int(parameter.value))
        return parameter

    def _changes(self, parameters: list[Parameter]) -> dict[str, Any]:
        return {p.name: p.value for p in parameters if p.name in self._declarations}

    def _check(self, parameters: list[Parameter]) -> SetParametersResult:
        problems = [
            no_such_parameter(p.name, list(self._declarations))
            for p in parameters
            if p.name not in self._declarations and p.name not in ROS_PARAMETERS
        ]
        if any(p.name == "use_sim_time" and p.value is not False for p in parameters):
            problems.append(NO_SIM_TIME)
        try:
            changed = self.config.replace(self._changes(parameters))
        except ConfigError as error:
            problems += error.problems
        else:
            if self._flows():
                problems += [
                    f"{name}: {change} guards less; while the output is on it can only be made "
                    f"{declaration.stricter}: switch it off first, ~/enable false"
                    for name, change, declaration in loosened(self.config, changed)
                ]
        return SetParametersResult(successful=not problems, reason="; ".join(problems))

    def _apply(self, parameters: list[Parameter]) -> None:
        changes = self._changes(parameters)
        before, self.config = self.config, self.config.replace(changes)
        if self.config != before:  # each change waits for a step of the loop
            for name, change, _ in loosened(before, self.config):
                self._log.warning(f"{name}: {change} guards less")
            words = "; ".join(f"{name}: {change}" for name, change, _ in loosened(self._begun_with, self.config))
            self._key_values = {"loosened": words} if words else {}
            self._on_change(self.config, list(changes))

    def key_values(self) -> dict[str, str]:
        """For the status: what guards less than when the node began, where anything does."""
        return self._key_values


def _constraints(declaration: Declaration) -> str:
    stricter = f"while the output is on, it can only be made {declaration.stricter}" if declaration.stricter else ""
    return "; ".join(
        filter(None, (f"one of {', '.join(declaration.choices)}" if declaration.choices else "", stricter))
    )


def _descriptor(declaration: Declaration, kind: str) -> ParameterDescriptor:
    unit = f" [{declaration.unit}]" if declaration.unit not in ("", "1") else ""
    descriptor = ParameterDescriptor(
        description=declaration.description + unit,
        additional_constraints=_constraints(declaration),
        read_only=not declaration.live,
        # So that a wrong type comes to our own check, which answers in a sentence.
        dynamic_typing=bool(declaration.live),
    )
    finite = math.isfinite(declaration.lo) and math.isfinite(declaration.hi) and not declaration.optional
    if finite and kind == "float":
        descriptor.floating_point_range = [FloatingPointRange(from_value=declaration.lo, to_value=declaration.hi)]
    elif finite and kind == "int":
        descriptor.integer_range = [IntegerRange(from_value=int(declaration.lo), to_value=int(declaration.hi))]
    return descriptor
