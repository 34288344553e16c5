"""Two wires on one joint, over real processes and topics."""

import math
import re
import signal

import pytest
from processes import SOON_s, wait_until

pytest.importorskip("rclpy")

from diagnostic_msgs.msg import DiagnosticStatus
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import ListParameters, SetParameters
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool, Trigger

from sma_actuator.actuator import AFTER_A_FAULT
from sma_actuator.base.share import shared_file
from sma_actuator.cli.main import main
from sma_actuator.config import read_parameter_file
from sma_msgs_py import pair_command_message, setpoint_message, status_from, trajectory_message

FILE = shared_file("config/pair.yaml")
NAMES = ("left", "right")
#: A process may stand still for a while with the current on: neither wire then pulls to its limit, or jumps.
CALM = {"supply.max_current": 0.3, "safety.load_spike": 3.0}


def joint_parameters(**changes):
    return {**read_parameter_file(FILE, "joint"), **changes}


#: What a machine that stands still with a wire on is rightly taken for.
STANDSTILLS = {"node_lost", "loop_overrun", "loop_hung", "supply_lost", "daq_lost", "reading_stale"}


def enabled(client):
    return client.call("/joint/enable", SetBool, SetBool.Request(data=True)).success


def reached(client, condition, what):
    """Wait until the joint has come to something; where a standstill has switched it off, go on as a person does."""
    statuses = client.listen("/joint/status", DiagnosticStatus, latched=True)

    def now():
        latest = status_from(statuses[-1]) if statuses else None
        if latest and latest.fault in STANDSTILLS:
            client.spin_until(lambda: client.call("/joint/clear_fault", Trigger).success, what="clearing")
            client.spin_until(lambda: enabled(client), what="enabling")
            statuses.clear()
        return condition()

    return client.spin_until(now, what=what)


def status_of(client, name, condition):
    """The next status of a node for which ``condition`` holds."""
    messages = client.listen(f"/{name}/status", DiagnosticStatus, latched=True)
    return client.spin_until(
        lambda: next((s for s in map(status_from, messages[-1:]) if condition(s)), None), what=f"status of {name}"
    )


def test_a_joint_is_turned_by_commands_and_a_fault_of_one_wire_switches_both_off(
    start_bench, make_config, start_node, client, capsys
):
    bench = start_bench("--load", "joint:0.004,0.0017")
    calibration = read_parameter_file(FILE, "left")["calibration"]
    wires = {
        name: make_config(instruments=bench.instruments(number), joint_name=name, calibration=calibration, **CALM)
        for number, name in enumerate(NAMES)
    }
    node = start_node({**wires, "joint": joint_parameters(cocontraction=0.6)}, "--", "--joints", "joint", names=NAMES)
    states = client.listen("/joint/joint_states", JointState)
    for name in NAMES:
        status_of(client, name, lambda s: s.values["lifecycle"] == "active")

    client.publish("/joint/joint_command", pair_command_message("joint", 0.1))
    node.says("joint command refused: the joint is off; call ~/enable first")
    assert not states, "an angle is said, and nobody knows it"

    client.spin_until(lambda: enabled(client), what="enabling")
    reached(client, lambda: states and states[-1].effort[0] > 0.4, "the slack taken up")
    assert list(states[-1].name) == ["joint"] and math.isfinite(states[-1].position[0])
    command, publisher = pair_command_message("joint", 0.15, 0.6), client.publisher("/joint/joint_command", JointState)
    commander = client.node.create_timer(0.05, lambda: publisher.publish(command))
    reached(client, lambda: abs(states[-1].position[0] - 0.15) < 0.03 and states[-1].effort[0] > 0.4, "the angle")
    assert float(bench.tell("BENC:JOIN:ANGL?")) == pytest.approx(0.15, abs=0.1)
    assert status_of(client, "joint", lambda s: s.mode.value == "tracking").values["uncertainty_rad"] < 0.2

    client.publish("/left/setpoint", setpoint_message(0.001))
    node.says("a setpoint was ignored: /joint drives this wire; ask that for an angle")
    assert status_of(client, "left", lambda s: True).values["turned_by"] == "/joint"

    answer = client.call("/joint/list_parameters", ListParameters)
    assert {"pulley_radius", "tension_limit"} <= set(answer.result.names)
    longer = Parameter(name="joint_command_timeout", value=ParameterValue(type=3, double_value=5.0))
    request = SetParameters.Request(parameters=[longer])
    (result,) = client.call("/joint/set_parameters", SetParameters, request).results
    assert not result.successful and "joint_command_timeout: 0.5 → 5 guards less" in result.reason

    commander.cancel()
    lost = status_of(client, "joint", lambda s: s.fault == "setpoint_stale")
    assert lost.mode.value == "hold" and "joint_command_timeout is 0.5 s" in lost.message

    assert main(["move", "3rad", "--node", "joint", "--patience", "60", "--within", "1"]) == 1
    assert "3.000 rad is beyond where the joint can be held, " in capsys.readouterr().err
    assert main(["move", "0.1rad", "--node", "joint", "--patience", "60", "--within", "60"]) == 0
    said = capsys.readouterr().out.splitlines()
    assert said[-2].startswith("there after") and said[-2].endswith("held there"), said
    angle_deg, angle_rad = map(float, re.match(r"angle +(.+)° = +(.+) rad ± .* co-contraction", said[-1]).groups())
    assert angle_rad == pytest.approx(0.1, abs=0.03) and angle_deg == pytest.approx(math.degrees(angle_rad), abs=0.05)
    assert main(["move", "2mm", "--node", "joint", "--patience", "60"]) == 1
    assert "10deg is wanted" in capsys.readouterr().err

    client.publish("/joint/joint_trajectory", trajectory_message("joint", [0.5, 1.0], [0.12, 0.1]))
    moved = status_of(client, "joint", lambda s: s.values["asked_angle_rad"] == 0.1)
    assert (moved.mode.value, moved.fault) == ("tracking", "")
    client.publish("/joint/joint_trajectory", trajectory_message("joint", [1.0], [10.0]))
    node.says("radians are wanted")

    bench.tell("BENC:FAUL open_wire", 1)
    right = status_of(client, "right", lambda s: s.fault and s.mode.value == "off")
    why = f"right: {right.message.removesuffix(AFTER_A_FAULT)}"
    left = status_of(client, "left", lambda s: s.fault and s.mode.value == "off")
    assert (left.fault == "partner_off" and why in left.message) or left.fault in STANDSTILLS
    joint = status_of(client, "joint", lambda s: s.fault == right.fault)
    assert joint.mode.value == "off" and joint.message == f"off: {why}{AFTER_A_FAULT}"
    wait_until(lambda: bench.current_A(0) == bench.current_A(1) == 0.0)

    bench.tell("BENC:FAUL:CLE", 1)
    client.spin_until(lambda: client.call("/joint/clear_fault", Trigger).success, what="clearing")
    client.spin_until(lambda: enabled(client), what="enabling")
    wait_until(lambda: bench.current_A(0) > 0.04 and bench.current_A(1) > 0.04)
    answer = client.call("/right/stop", Trigger)  # of one node: every wire of the process
    assert answer.success and "/left: the output is off" in answer.message and "/joint: left" in answer.message
    wait_until(lambda: bench.current_A(0) == bench.current_A(1) == 0.0)
    for name in ("joint", *NAMES):
        assert status_of(client, name, lambda s: s.mode.value == "off").fault == ""
    (result,) = client.call("/joint/set_parameters", SetParameters, request).results
    assert result.successful, result.reason
    status_of(client, "joint", lambda s: s.values.get("loosened") == "joint_command_timeout: 0.5 → 5")
    node.popen.send_signal(signal.SIGTERM)
    assert node.popen.wait(SOON_s) == 0


def test_a_joint_whose_wires_are_not_there_ends_with_a_sentence(make_config, start_node):
    sections = {"left": make_config(), "joint": joint_parameters()}
    node = start_node(sections, "--", "--joints", "joint", names=["left"])
    assert node.ends() == 1
    assert "joint: wires: right is no node of this process; --nodes names them" in node.words
