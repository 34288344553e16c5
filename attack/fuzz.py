"""ROS fuzz: everything a node can be sent, with odd values, as fast as it goes."""

from __future__ import annotations

import json
import math
import struct
import time

from sma_actuator.config import Config, read_parameter_file

from .hours import CONFIG, OFF_AT_MOST_s
from .nodes import AttackedNodes, Client, Node
from .promises import flat
from .result import Result
from .stand import Stand

# After .nodes, which says where ROS may be heard.
from builtin_interfaces.msg import Duration  # isort: skip
from lifecycle_msgs.msg import Transition  # isort: skip
from lifecycle_msgs.srv import ChangeState  # isort: skip
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue  # isort: skip
from rcl_interfaces.srv import SetParameters  # isort: skip
from sensor_msgs.msg import JointState  # isort: skip
from std_msgs.msg import Float64  # isort: skip
from std_srvs.srv import SetBool, Trigger  # isort: skip
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint  # isort: skip

NAME = "fuzzed"
BURST = 500
MEASURING_s = 0.1
PUBLISHERS = 4  #: each a DDS participant of its own
ODD = (math.nan, math.inf, -math.inf, 0.0, -0.0, -1.0, 1.0, 5e-324, 1e300, -1e300, 1e-9, 0.001, 0.002, 0.003, 0.0042)
ODD_INTS = (0, 1, -1, 2**31 - 1, -(2**31), 2**63 - 1, -(2**63), 10)
ODD_TEXTS = ("", "off", "nan", "ü" * 1000, "\x07", "; OUTP ON", "../../etc", "{}", "1e400", "true")
TRANSITIONS = tuple(
    getattr(Transition, name)
    for name in dir(Transition)
    if name.startswith("TRANSITION_") and isinstance(getattr(Transition, name), int)
)


class Fuzzing(AttackedNodes):
    """A node, and everything it is sent."""

    def __init__(self, seed: int):
        super().__init__(seed)
        self.stand = Stand("--seed", str(seed))
        parameters = read_parameter_file(CONFIG / "flexinol.yaml")
        parameters["instruments"]["supply"]["resource"] = f"TCPIP::127.0.0.1::{self.stand.supply_port}::SOCKET"
        parameters["instruments"]["daq"]["resource"] = f"TCPIP::127.0.0.1::{self.stand.daq_port}::SOCKET"
        self.config = Config.from_mapping(parameters)
        self.names = [*flat(self.config.to_mapping()), "use_sim_time", "no.such.parameter", ""]
        self.parameters = self.folder / "parameters.yaml"
        self.parameters.write_text(json.dumps({NAME: {"ros__parameters": parameters}}))
        self._others = [Client(number) for number in range(1, PUBLISHERS)]
        nodes = [client.node for client in (self.client, *self._others)]
        self._setpoints = [node.create_publisher(Float64, f"/{NAME}/setpoint", 10) for node in nodes]
        self._trajectories = [node.create_publisher(JointTrajectory, f"/{NAME}/joint_trajectory", 10) for node in nodes]
        self._commands = [node.create_publisher(JointState, f"/{NAME}/joint_command", 10) for node in nodes]
        self._recent: list[str] = []
        self._node: Node | None = None
        self._starts = 0

    def close(self) -> None:
        """End everything."""
        if self._node is not None:
            self._node.end()
        for client in self._others:
            client.close()
        super().close()

    def _close_stand(self) -> None:
        self.stand.close()

    @property
    def replay(self) -> str:
        """See :class:`AttackedNodes`."""
        return f"python -m attack fuzz --seed {self.seed} --messages {self.result.counts['messages']}"

    def broken(self, rule: str, detail: str) -> None:
        """Write down a broken promise, and what was sent before it."""
        super().broken(rule, f"{detail} (after: {'; '.join(self._recent[-3:])})")

    def run(self, messages: int) -> Result:
        """Send ``messages`` messages, parameters and calls among them."""
        while self.result.counts["messages"] < messages:
            self._drive()
            for _ in range(self._chance.randint(1, 4)):
                self._burst()
                self._odd_parameter() if self._chance.random() < 0.7 else self._odd_call()
                self._alive()
            self._off_counts()
        return self.result

    def _alive(self) -> bool:
        node = self._node
        if node is None:
            return False
        if node.ended is not None:
            self.broken("one message ends the node", f"exit code {node.ended}; {node.last_words()[-300:]}")
            self._node = None
            return False
        if self.stand.most_A > self.config.supply.max_current * 1.001:
            self.broken("more than supply.max_current flows", f"{self.stand.most_A:.4f} A")
        if self.stand.hottest_C > self.config.thermal.max_temperature:
            self.broken("the wire is above its limit of temperature", f"{self.stand.hottest_C:.0f} °C")
        self.stand.fresh()
        return True

    def _drive(self) -> None:
        """A node that drives the wire, whatever it was sent before; a new one where need be."""
        for attempt in range(2):
            if self._node is None:
                self._starts += 1
                self._node = Node(self.nursery, self.parameters, self.folder / f"node{self._starts}.log", NAME)
                self.result.counts["nodes started"] += 1
            for transition in (Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE):
                if attempt or self._starts > 1 or self.result.counts["messages"]:
                    self._transition(transition)
            words = self.client.drive(NAME, self.stand, lambda: self._node.ended is None, 8.0)
            if not words:
                return
            self._alive()
            if self._node is not None and attempt:
                # What it was told may well keep it from driving: a limit near zero, say.  A new node knows nothing of
                # it.
                self._node.end()
                self._node = None
                self.result.counts["parameters that no longer drive"] += 1

    def _burst(self) -> None:
        for _ in range(BURST):
            kind = self._chance.random()
            if kind < 0.5:
                self._chance.choice(self._setpoints).publish(Float64(data=self._odd_float()))
            elif kind < 0.8:
                self._chance.choice(self._commands).publish(self._odd_joint_command())
            else:
                self._chance.choice(self._trajectories).publish(self._odd_trajectory())
            self.result.counts["messages"] += 1
        self.client.spin_until(lambda: True, 0.1)

    def _odd_joint_command(self) -> JointState:
        chance = self._chance
        names = chance.choice((["sma_joint"], ["sma_joint"], [], ["elbow"], ["elbow", "sma_joint"], ["sma_joint"] * 2))
        many = chance.choice((len(names), len(names), 0, 1, 3))
        return JointState(name=names, position=[self._odd_float() for _ in range(many)])

    def _odd_float(self) -> float:
        kind = self._chance.random()
        if kind < 0.4:
            return self._chance.choice(ODD)
        if kind < 0.8:
            return self._chance.uniform(-0.001, 0.006)
        return struct.unpack("d", self._chance.randbytes(8))[0]

    def _odd_trajectory(self) -> JointTrajectory:
        chance = self._chance
        points = [
            JointTrajectoryPoint(
                positions=[self._odd_float() for _ in range(chance.choice((0, 1, 1, 1, 1, 2)))],
                time_from_start=Duration(
                    sec=chance.choice((0, 1, 2, 3, -1, 2**31 - 1)), nanosec=chance.choice((0, 5, 999999999, 2**32 - 1))
                ),
            )
            for _ in range(chance.choice((0, 1, 2, 3, 50)))
        ]
        return JointTrajectory(
            joint_names=chance.choice((["sma_joint"], ["sma_joint"], [], ["elbow"], ["a", "b"])), points=points
        )

    def _odd_parameter(self) -> None:
        chance = self._chance
        kind, field, values = chance.choice(
            (
                (ParameterType.PARAMETER_DOUBLE, "double_value", ODD),
                (ParameterType.PARAMETER_DOUBLE, "double_value", ODD),
                (ParameterType.PARAMETER_INTEGER, "integer_value", ODD_INTS),
                (ParameterType.PARAMETER_STRING, "string_value", ODD_TEXTS),
                (ParameterType.PARAMETER_BOOL, "bool_value", (True, False)),
                (ParameterType.PARAMETER_NOT_SET, "bool_value", (False,)),
            )
        )
        name, value = chance.choice(self.names), chance.choice(values)
        if chance.random() < 0.1:
            name, kind, field, value = chance.choice(
                (
                    ("use_sim_time", ParameterType.PARAMETER_BOOL, "bool_value", True),
                    ("loop.overruns_to_fault", ParameterType.PARAMETER_DOUBLE, "double_value", math.inf),
                    ("loop.overruns_to_fault", ParameterType.PARAMETER_DOUBLE, "double_value", math.nan),
                )
            )
        parameter = Parameter(name=name, value=ParameterValue(type=kind, **{field: value}))
        self._recent.append(f"{name} := {value!r}"[:120])
        self.result.counts["parameters"] += 1
        self.client.call(f"/{NAME}/set_parameters", SetParameters, SetParameters.Request(parameters=[parameter]), 2.0)

    def _odd_call(self) -> None:
        name = self._chance.choice(
            ("clear_fault", "reset_estimator", "tare_load", "measure_lead_resistance", "transition", "enable")
        )
        self.result.counts["calls"] += 1
        if name == "transition":
            self._transition(self._chance.choice(TRANSITIONS))
        elif name == "enable":
            self._recent.append("enable")
            self.client.call(f"/{NAME}/enable", SetBool, SetBool.Request(data=self._chance.random() < 0.5), 2.0)
        else:
            self._recent.append(name)
            self.client.call(f"/{NAME}/{name}", Trigger, timeout_s=2.0)

    def _transition(self, number: int) -> None:
        self._recent.append(f"transition {number}")
        request = ChangeState.Request(transition=Transition(id=number))
        self.client.call(f"/{NAME}/change_state", ChangeState, request, 2.0)

    def _off_counts(self) -> None:
        """ "Off" has to be true, and to come before everything that floods in."""
        if not self._alive():
            return
        self._burst()
        asked_s = time.monotonic()
        answer = self.client.call(f"/{NAME}/enable", SetBool, SetBool.Request(data=False), 5.0)
        self.result.counts["offs demanded"] += 1
        took_s = self.stand.off_within_s(asked_s, 5.0)
        if answer is None and self._alive():
            self.broken("~/enable false is not answered", "within 5 s")
        elif not took_s <= OFF_AT_MOST_s + MEASURING_s:
            self.broken("the current is not off within a second of ~/enable false", f"after {took_s:.2f} s")
        else:
            self.result.see("off after ~/enable false in a flood [s]", took_s)


def attack(seed: int, messages: int) -> Result:
    """Fuzz one node, and those after it where one ends."""
    fuzzing = Fuzzing(seed)
    try:
        return fuzzing.run(messages)
    finally:
        fuzzing.close()
