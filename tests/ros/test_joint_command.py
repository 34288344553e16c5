"""ros2_control drives a wire by ``~/joint_command``: against a double of its plugin here, against the real one where it
is installed (test_ros2_control.py)."""

import math
from pathlib import Path

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("xacro")
import xacro
from diagnostic_msgs.msg import DiagnosticStatus
from plugin_double import PluginDouble
from sensor_msgs.msg import JointState
from test_node import NAME, _enable, _enabled, _status

from sma_actuator.base.parameters import from_mapping
from sma_actuator.base.sections import Wire
from sma_actuator.base.signals import Mode
from sma_actuator.config import Config, read_parameter_file, write_parameter_file
from sma_actuator.control.pair import Pair, PairParameters
from sma_msgs_py import joint_command_message, signals_from, status_from

URDF = Path(__file__).resolve().parents[2] / "urdf" / "one_wire.urdf.xacro"


@pytest.fixture
def plugin():
    double = PluginDouble(xacro.process_file(URDF).toxml())
    yield double
    double.close()


@pytest.mark.parametrize("name", ["flexinol", "flexinol_normalised", "furukawa"])
def test_the_joints_limits_are_those_of_the_parameter_file(name):
    path = URDF.parents[1] / "config" / f"{name}.yaml"
    config = Config.load(path)
    for given in (path, Path("..") / "config" / path.name):
        robot = xacro.process_file(URDF, mappings={"params_file": str(given)})
        (limit,) = robot.getElementsByTagName("limit")
        said = {name: float(limit.getAttribute(name)) for name in ("lower", "upper", "velocity", "effort")}
        low_m, high_m = config.model.build(config.wire).displacement_range_m
        assert said == pytest.approx(
            {
                "lower": low_m,
                "upper": high_m,
                "velocity": config.controller.setpoint_rate_limit,
                "effort": config.wire.max_stress * config.wire.area_m2,
            }
        )
        assert robot.getElementsByTagName("joint")[0].getAttribute("name") == config.joint_name


def test_the_limits_can_be_what_the_wire_reaches_with_its_load():
    robot = xacro.process_file(URDF, mappings={"lower": "0.0008", "upper": "0.0024"})
    (limit,) = robot.getElementsByTagName("limit")
    assert [float(limit.getAttribute(name)) for name in ("lower", "upper")] == [0.0008, 0.0024]


def test_the_limits_of_a_joint_are_what_both_its_wires_reach_at_its_co_contraction():
    robot = xacro.process_file(URDF.parent / "two_wires.urdf.xacro")
    (limit,) = robot.getElementsByTagName("limit")
    said = {name: float(limit.getAttribute(name)) for name in ("lower", "upper", "velocity", "effort")}
    path = URDF.parents[1] / "config" / "pair.yaml"
    parameters = PairParameters.from_mapping(read_parameter_file(path, "joint"))
    wires = [Config.load(path, name) for name in parameters.wires]
    ranges_m = [wire.model.build(wire.wire).displacement_range_m for wire in wires]
    low_rad, high_rad = Pair(parameters, ranges_m).range_rad(parameters.cocontraction)
    torque_Nm = parameters.tension_limit * parameters.pulley_radius
    limits = {"lower": low_rad, "upper": high_rad, "velocity": parameters.angle_rate_limit, "effort": torque_Nm}
    assert said == pytest.approx(limits)
    joint = robot.getElementsByTagName("joint")[0]
    assert (joint.getAttribute("name"), joint.getAttribute("type")) == (parameters.joint_name, "revolute")
    assert "/joint/joint_command" in robot.toxml() and "/joint/joint_states" in robot.toxml()


@pytest.mark.parametrize(
    "form",
    [
        {"form": "coil", "coil_diameter": 1.524e-3, "diameter": 0.254e-3},
        {"form": "bundle", "wires": 4, "connection": "series"},
    ],
    ids=lambda form: form["form"],
)
def test_the_force_of_a_coil_or_a_bundle_is_what_all_of_it_bears(form, tmp_path):
    mapping = read_parameter_file(URDF.parents[1] / "config" / "flexinol.yaml")
    mapping["wire"] |= form
    path = tmp_path / "other.yaml"
    write_parameter_file(path, mapping, "another form")
    (limit,) = xacro.process_file(URDF, mappings={"params_file": str(path)}).getElementsByTagName("limit")
    wire, problems = from_mapping(Wire, mapping["wire"], "wire.")
    assert not problems
    assert float(limit.getAttribute("effort")) == pytest.approx(wire.max_stress * wire.area_m2, rel=1e-9)


def _says(client, words, **wanted):
    """Wait until the status says of the joint commands what begins with ``words``."""
    return _status(
        client,
        lambda s: (
            s.values.get("joint_commands", "").startswith(words)
            and all(getattr(s, name) == value for name, value in wanted.items())
        ),
    )


def _followed_m(client, signals):
    """Wait for a signal that says where the wire is sent, and say where."""
    client.spin_until(
        lambda: math.isfinite(signals_from(signals[-1])["limited_setpoint_m"]), what="a followed setpoint"
    )
    return signals_from(signals[-1])["limited_setpoint_m"]


def test_a_controller_manager_drives_the_wire_without_a_jump_and_its_death_is_seen(
    start_bench, make_config, start_node, client, plugin
):
    bench = start_bench("--load", "weight:0.98")
    node = start_node(make_config(instruments=bench.instruments()))
    statuses = client.listen(f"{NAME}/status", DiagnosticStatus, latched=True)
    signals = client.listen(f"{NAME}/signals", JointState)

    # Before a controller runs every command is NaN, also while the wire is on: no fault, no motion.
    _says(client, "no number yet", mode=Mode.OFF, fault="")
    _enabled(client)
    _says(client, "no number yet", mode=Mode.HOLD, fault="")
    client.spin_until(lambda: math.isfinite(plugin.position_m), what="a position")
    assert plugin.position_m == pytest.approx(bench.truth()[0], abs=1e-3)

    # What a controller held before the wire was switched on is no reason to go there.
    start_m = bench.truth()[0]
    plugin.hold(0.0010)
    _says(client, "not followed: 1.000 mm, and the wire is at", mode=Mode.HOLD, fault="")
    assert bench.truth()[0] == pytest.approx(start_m, abs=2e-4)

    # A goal begins at the state: it is followed, with the first command near the wire.
    held_m = _followed_m(client, signals)
    signals.clear()
    plugin.go(0.0025, duration_s=3.0)
    _says(client, "followed", mode=Mode.TRACKING)
    client.spin_until(lambda: abs(plugin.position_m - 0.0025) < 2e-4, what="the goal")
    assert bench.truth()[0] == pytest.approx(0.0025, abs=4e-4)
    # The wire was sent along what this goal commanded, never towards what stood there before.  (How far two setpoints
    # lie apart in time says what the machine was doing, not the driver.)
    followed_m = [signals_from(message)["limited_setpoint_m"] for message in signals]
    assert all(map(math.isfinite, followed_m))
    assert abs(plugin.sent_m[0] - held_m) < 2e-4
    assert min(plugin.sent_m) - 1e-6 <= min(followed_m) < held_m - 1e-4
    assert max(followed_m) < max(held_m, *plugin.sent_m) + 1e-6
    assert not any(status_from(message).fault for message in statuses), [m.message for m in statuses]

    # The controller manager is killed: the wire is held, and the status says why.
    plugin.close()
    lost = _status(client, lambda s: s.fault == "setpoint_stale")
    assert lost.mode is Mode.HOLD
    assert "controller.joint_command_timeout is 0.5 s" in lost.message

    # One that comes back with what it last held far away is not followed; a name that is not the joint's is refused.
    client.publish(f"{NAME}/joint_command", joint_command_message("sma_joint", 0.0005))
    _says(client, "not followed: 0.500 mm", mode=Mode.HOLD)
    client.publish(f"{NAME}/joint_command", joint_command_message("elbow", 0.0025))
    node.says("joint command refused: it is for elbow, and this joint is sma_joint")
    client.publish(f"{NAME}/joint_command", JointState(name=["elbow", "sma_joint"], position=[0.1]))
    node.says("joint command refused: it has no position for sma_joint")
    client.publish(f"{NAME}/joint_command", JointState(name=["x" * 30_000], position=[0.1]))
    node.says("joint command refused: its message has 30")
    assert _enable(client, on=False).success
    client.spin_until(lambda: bench.current_A() == 0.0, what="end of the current")
