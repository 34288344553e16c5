"""The node in its own process, on a bench in another, seen over ROS 2 from a third."""

import fcntl
import math
import os
import select
import shutil
import signal
import subprocess
import sys

import pytest

pytest.importorskip("rclpy")
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from processes import parameter_file, wait_until
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import DescribeParameters, GetParameters, SetParameters
from rclpy.duration import Duration
from rclpy.time import Time
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64
from std_srvs.srv import SetBool, Trigger
from trajectory_msgs.msg import JointTrajectory

from sma_actuator.logs.bench_log import read_bench_log
from sma_actuator.safety.faults import FAULTS
from sma_msgs_py import setpoint_message, signals_from, status_from, trajectory_message

NAME = "/sma_actuator"
ASKED = "/asked/sma_actuator"  # that of client_of_running_node

#: Within which the current must be off here: as promised (docs/faults.md; `make attack` takes the times), and what a
#: machine may stall that runs other tests beside this one.
OFF_s = 3.0


def _enable(client, on=True, name=NAME):
    return client.call(f"{name}/enable", SetBool, SetBool.Request(data=on))


def _enabled(client, name=NAME):
    """Enable the wire once it has readings; wait until current is commanded."""
    client.next(f"{name}/load", WrenchStamped)
    currents = client.listen(f"{name}/command_current", Float64)
    client.next(f"{name}/command_current", Float64)
    statuses = client.listen(f"{name}/status", DiagnosticStatus, latched=True)
    # The last word is kept for who comes late: one on a fault that is cleared may still be under way.
    client.spin_until(lambda: statuses and not status_from(statuses[-1]).fault, what="a status without a fault")
    statuses.clear()
    response = _enable(client, name=name)
    assert response.success, response.message

    def flows():
        said = [status_from(message) for message in statuses]
        assert not any(status.fault for status in said), [status.message for status in said]
        return any(message.data > 0.0 for message in currents)

    client.spin_until(flows, what="current")


def _status(client, condition=lambda _: True, name=NAME):
    """The next status for which ``condition`` holds."""
    messages = client.listen(f"{name}/status", DiagnosticStatus, latched=True)
    messages.clear()
    return client.spin_until(lambda: next((s for m in messages if condition(s := status_from(m))), None), what="status")


def _age_s(client, message):
    """Time since the sampling."""
    return (client.node.get_clock().now() - Time.from_msg(message.header.stamp)).nanoseconds * 1e-9


def _set(client, **values):
    """Results of setting parameters, given as ParameterValue fields by name (dots as __)."""
    request = SetParameters.Request()
    for name, value in values.items():
        kind, field = {float: (3, "double_value"), int: (2, "integer_value"), str: (4, "string_value")}[type(value)]
        request.parameters.append(
            Parameter(name=name.replace("__", "."), value=ParameterValue(type=kind, **{field: value}))
        )
    return client.call(f"{ASKED}/set_parameters", SetParameters, request).results


def _transition(client, number):
    request = ChangeState.Request(transition=Transition(id=number))
    return client.call(f"{NAME}/change_state", ChangeState, request).success


@pytest.fixture
def bench(start_bench):
    return start_bench("--load", "weight:0.98")


@pytest.fixture
def parameters(make_config, bench):
    return lambda **changes: make_config(instruments=bench.instruments(), **changes)


class TestHolding:
    def test_a_setpoint_is_reached_and_every_topic_tells_of_it(self, bench, parameters, start_node, client):
        start_node(parameters())
        _enabled(client)
        goal_m = 0.0025
        client.publish(f"{NAME}/setpoint", setpoint_message(goal_m))
        state = client.next(f"{NAME}/joint_states", JointState, lambda m: abs(m.position[0] - goal_m) < 2e-4)
        assert list(state.name) == ["sma_joint"]
        client.next(f"{NAME}/joint_states", JointState, lambda m: 0.0 < _age_s(client, m) < 1.0)
        true_m, load_N, _ = bench.truth()
        reference = client.next(f"{NAME}/reference", JointState)
        assert reference.position[0] == pytest.approx(true_m, abs=5e-4)
        load = client.next(f"{NAME}/load", WrenchStamped)
        assert load.wrench.force.x == pytest.approx(load_N, abs=0.2)
        assert load.header.frame_id == "sma_base"
        assert 0.05 <= client.next(f"{NAME}/command_current", Float64).data <= 0.40
        assert _status(client).mode.value == "tracking"

    def test_status_and_diagnostics_carry_the_key_values_at_1_hz(self, client_of_running_node):
        client = client_of_running_node
        array = client.next(
            "/diagnostics",
            DiagnosticArray,
            # The first may come before the first reading.
            lambda m: m.status[0].name == ASKED and {"period_p99_s", "quality"} <= {v.key for v in m.status[0].values},
        )
        keys = {pair.key for pair in array.status[0].values}
        assert {
            "mode",
            "fault",
            "limits",
            "lifecycle",
            "overruns",
            "period_mean_s",
            "period_p99_s",
            "period_max_s",
        } <= keys
        assert {"resistance_Ohm", "stress_Pa", "branch", "quality"} <= keys
        assert "Virtual Supply" in array.status[0].hardware_id
        health = array.status[1]
        assert (health.name, health.hardware_id) == (f"{ASKED}: model health", "sma_joint")
        assert health.message.startswith("not known")
        assert {"state", "due_for_s", "position_error_m", "cycles", "causes"} <= {pair.key for pair in health.values}
        client.next("/diagnostics", DiagnosticArray)

    def test_a_trajectory_is_followed_and_one_for_another_joint_refused(self, bench, parameters, start_node, client):
        node = start_node(parameters())
        _enabled(client)
        client.publish(f"{NAME}/joint_trajectory", trajectory_message("elbow", [0.0, 1.0], [0.001, 0.001]))
        node.says("it moves elbow, this joint is sma_joint")
        client.publish(f"{NAME}/joint_trajectory", trajectory_message("sma_joint", [1.0, 4.0], [0.0032, 0.0025]))
        client.next(f"{NAME}/joint_states", JointState, lambda m: abs(m.position[0] - 0.0025) < 2e-4)

    def test_a_trajectory_stamped_later_is_waited_for_and_an_empty_one_ends_the_motion(
        self, parameters, start_node, client
    ):
        start_node(parameters())
        _enabled(client)
        client.publish(f"{NAME}/setpoint", setpoint_message(0.0036))
        _status(client, lambda s: s.mode.value == "tracking")
        later = trajectory_message("sma_joint", [0.0], [0.0025])
        later.header.stamp = (client.node.get_clock().now() + Duration(seconds=3.0)).to_msg()
        client.publish(f"{NAME}/joint_trajectory", later)
        signals = client.listen(f"{NAME}/signals", JointState)
        client.spin_until(
            lambda: any(signals_from(m)["setpoint_m"] == 0.0025 for m in signals), what="start of the trajectory"
        )
        (first,) = [m for m in signals if signals_from(m)["setpoint_m"] == 0.0025][:1]
        assert (Time.from_msg(first.header.stamp) - Time.from_msg(later.header.stamp)).nanoseconds > -200_000_000
        client.publish(f"{NAME}/joint_trajectory", JointTrajectory(joint_names=["sma_joint"]))
        _status(client, lambda s: s.mode.value == "hold")

    def test_switching_off_ends_the_current(self, bench, parameters, start_node, client):
        start_node(parameters())
        _enabled(client)
        wait_until(lambda: bench.current_A() > 0.04)
        assert _enable(client, on=False).success
        wait_until(lambda: bench.current_A() == 0.0, OFF_s)

    def test_the_bench_log_is_recorded_and_complete_after_the_end(
        self, bench, parameters, start_node, client, tmp_path
    ):
        folder = tmp_path / "logs"
        node = start_node(parameters(recorder={"folder": str(folder)}))
        _enabled(client)
        client.next(f"{NAME}/joint_states", JointState)
        shutil.rmtree(folder, ignore_errors=True)  # it may have a file again before the last one is gone
        node.says(f"the bench log goes on in {folder}")
        _status(
            client, lambda s: "goes on in" in s.values["recorder"] and s.values["recorder"].endswith("; 0 rows lost")
        )
        node.popen.send_signal(signal.SIGINT)
        assert node.ends_in_order()
        (file,) = folder.glob("*.csv")
        assert read_bench_log(file, allow_gaps=True)["current_command_A"].max() >= 0.05


class TestLog:
    def test_what_happens_to_the_wire_is_said_once_each_and_one_refusal_does_not_hide_another(
        self, bench, parameters, start_node, client
    ):
        node = start_node(parameters())
        client.next(f"{NAME}/load", WrenchStamped)
        client.publish(f"{NAME}/setpoint", setpoint_message(0.0025))
        client.publish(f"{NAME}/joint_trajectory", trajectory_message("elbow", [0.0], [0.001]))
        node.says("setpoint refused: the output is off; call ~/enable first")
        node.says("it moves elbow, this joint is sma_joint")
        _enabled(client)
        node.says("the output is on; holding the wire where it is")
        bench.tell("BENC:FAUL open_wire")
        fault = _status(client, lambda s: s.fault).fault
        node.says(FAULTS[fault].advice)
        bench.tell("BENC:FAUL:CLE")
        client.spin_until(lambda: client.call(f"{NAME}/clear_fault", Trigger).success, what="clearing")
        node.says(f"the fault {fault} is cleared; the output stays off until ~/enable")
        assert node.words.count("holding the wire where it is") == 1
        assert node.words.count(FAULTS[fault].advice) == 1

    def test_the_status_is_right_at_once_after_activation_and_deactivation(self, parameters, start_node, client):
        start_node(parameters(autostart=False))
        statuses = client.listen(f"{NAME}/status", DiagnosticStatus, latched=True)
        for transition, state in (
            (Transition.TRANSITION_CONFIGURE, "inactive"),
            (Transition.TRANSITION_ACTIVATE, "active"),
            (Transition.TRANSITION_DEACTIVATE, "inactive"),
        ):
            assert _transition(client, transition)
            # The first that is published after the answer, or on the way with it, says the new state.
            client.spin_until(
                lambda state=state: statuses and status_from(statuses[-1]).values["lifecycle"] == state, what=state
            )
            said = status_from(statuses[-1]).message
            assert ("the node is inactive" in said) == (state == "inactive"), said


class TestServices:
    def test_each_answers_with_a_sentence(self, bench, parameters, start_node, client):
        start_node(parameters())
        _enabled(client)
        for service in ("reset_estimator", "tare_load", "clear_fault", "measure_lead_resistance"):
            response = client.call(f"{NAME}/{service}", Trigger)
            assert response.message, service
        assert client.call(f"{NAME}/reset_estimator", Trigger).success


class TestBadMessages:
    # Of infinities and other numbers: test_odd_messages.py, and tests/test_state_machine.py of any.
    @pytest.mark.parametrize("position_m", [math.nan, pytest.param(math.inf, marks=pytest.mark.long)])
    def test_a_setpoint_that_is_not_finite_is_refused_and_the_wire_held(
        self, bench, parameters, start_node, client, position_m
    ):
        node = start_node(parameters())
        _enabled(client)
        client.publish(f"{NAME}/setpoint", setpoint_message(position_m))
        node.says("finite")
        client.next(f"{NAME}/command_current", Float64, lambda m: 0.05 <= m.data <= 0.40)
        client.publish(f"{NAME}/setpoint", setpoint_message(0.0025))
        client.next(f"{NAME}/joint_states", JointState, lambda m: abs(m.position[0] - 0.0025) < 2e-4)

    def test_no_setpoint_makes_more_than_the_configured_current_flow(self, bench, parameters, start_node, client):
        start_node(parameters(**{"supply.max_current": 0.15, "supply.over_current_trip": 0.2, "controller.kp": 250}))
        _enabled(client)
        client.publish(f"{NAME}/setpoint", setpoint_message(-1e9))
        currents = client.listen(f"{NAME}/command_current", Float64)
        currents.clear()
        client.spin_until(lambda: len(currents) > 40, what="currents")
        assert max(m.data for m in currents) <= 0.15
        assert bench.current_A() <= 0.151


class TestParameters:
    def test_each_is_described_with_unit_and_range(self, client_of_running_node):
        request = DescribeParameters.Request(
            names=["wire.diameter", "controller.kp", "controller.on_setpoint_loss", "model.type"]
        )
        diameter, kp, loss, model = client_of_running_node.call(
            f"{ASKED}/describe_parameters", DescribeParameters, request
        ).descriptors
        assert diameter.description == "diameter of the wire [m]"
        assert diameter.read_only and not kp.read_only and model.read_only
        assert (diameter.floating_point_range[0].from_value, diameter.floating_point_range[0].to_value) == (10e-6, 2e-3)
        stricter = "while the output is on, it can only be made later in hold, bias, off"
        assert loss.additional_constraints == f"one of hold, bias, off; {stricter}"

    def test_a_gain_changes_while_it_runs_and_a_whole_number_will_do(self, client_of_running_node):
        (result,) = _set(client_of_running_node, controller__kp=300)
        assert result.successful, result.reason
        value = client_of_running_node.call(
            f"{ASKED}/get_parameters", GetParameters, GetParameters.Request(names=["controller.kp"])
        ).values[0]
        assert (value.type, value.double_value) == (3, 300.0)

    def test_what_guards_less_than_the_node_began_with_is_shown_until_it_is_as_it_was(self, client_of_running_node):
        """Here the output is off; while it is on, it is refused (test_node_parameters.py)."""
        client = client_of_running_node
        for value, shown in ((30.0, "safety.stuck_time: 2 → 30"), (2.0, None)):
            (result,) = _set(client, safety__stuck_time=value)
            assert result.successful, result.reason
            _status(client, lambda s, shown=shown: s.values.get("loosened") == shown, name=ASKED)
            client.next(
                "/diagnostics",
                DiagnosticArray,
                lambda m, shown=shown: (
                    m.status[0].name == ASKED and {v.key: v.value for v in m.status[0].values}.get("loosened") == shown
                ),
            )

    @pytest.mark.parametrize(
        ("name", "value", "sentence"),
        [
            ("controller__kp", -1.0, "controller.kp out of range"),
            (
                "controller__kp",
                "much",
                "controller.kp: 'much' is not a number; 0 to 1e+06 A/m is wanted (proportional gain)",
            ),
            (
                "controller__on_setpoint_loss",
                "panic",
                "controller.on_setpoint_loss: 'panic' is not one of hold, bias, off",
            ),
            ("wire__length", 0.2, "read-only parameter: wire.length"),
            ("thermal__derate_temperature", 300.0, "thermal.derate_temperature: is not below thermal.max_temperature"),
        ],
    )
    def test_a_wrong_one_is_refused_in_a_sentence(self, client_of_running_node, name, value, sentence):
        (result,) = _set(client_of_running_node, **{name: value})
        assert not result.successful
        assert sentence in result.reason

    @pytest.mark.parametrize(
        ("changes", "sentences"),
        [
            (
                {"controller.kpp": 1.0, "autostrat": True, "wire.diameter": 0.1524, "model.type": "steel"},
                [
                    "controller.kpp: no such parameter; did you mean controller.kp?",
                    "autostrat: no such parameter; did you mean autostart?",
                    "wire.diameter: 0.1524 is outside its range; 1e-05 to 0.002 m is wanted",
                    "model.type: 'steel' is not one of",
                ],
            ),
            ({"wire.alloy": "ni-ti-cu"}, ["alloy"]),
            ({"instruments.supply.dialect": "morse"}, ["instruments.supply.dialect"]),
        ],
        ids=["unknown, out of range", "coefficients of another alloy", "unknown dialect"],
    )
    def test_a_wrong_file_ends_the_node_with_sentences_before_any_current(
        self, make_config, start_node, changes, sentences
    ):
        node = start_node(make_config(**changes))
        assert node.ends() == 1
        assert [sentence for sentence in sentences if sentence not in node.words] == []
        assert "Traceback" not in node.words

    def test_a_file_for_another_node_is_named(self, make_config, start_node):
        node = start_node({"left": make_config()}, names=["right"])
        assert node.ends() == 1
        assert "no section 'right: ros__parameters:' for the node /right; found /left" in node.words


class TestInstruments:
    def test_one_that_is_not_there_and_not_waited_for_ends_the_node_with_its_address(
        self, bench, parameters, start_node
    ):
        nowhere = {"instruments.daq.resource": "TCPIP::127.0.0.1::1::SOCKET"}
        node = start_node(parameters(wait_for_instruments=False, **nowhere))
        assert node.ends() == 1
        assert "TCPIP::127.0.0.1::1::SOCKET" in node.words
        assert "Traceback" not in node.words
        assert bench.current_A() == 0.0

    def test_one_that_is_lost_switches_off_is_found_again_and_stays_off_until_enabled(
        self, bench, parameters, start_node, client
    ):
        start_node(parameters(**{"instruments.daq.timeout": 0.5, "safety.reading_timeout": 2.0}))
        _enabled(client)
        client.listen(f"{NAME}/status", DiagnosticStatus, latched=True)
        bench.tell("BENC:FAUL daq_silent")
        wait_until(lambda: _truth_over_supply(bench)[9] == 0.0, 2.0 + OFF_s, "end of the current")
        status = _status(client, lambda s: s.fault)
        assert status.fault == "daq_lost"
        response = client.call(f"{NAME}/clear_fault", Trigger)
        assert not response.success
        _tell_supply(bench, "BENC:FAUL:CLE")
        status = _status(client, lambda s: not s.fault)
        assert (status.mode.value, _truth_over_supply(bench)[9]) == ("off", 0.0)
        _enabled(client)


def _tell_supply(bench, command):
    """The same as ``bench.tell``, over the supply's port."""
    ports = bench.ports[0]
    bench.ports[0] = {**ports, "daq": ports["supply"]}
    try:
        return bench.tell(command)
    finally:
        bench.ports[0] = ports


def _truth_over_supply(bench):
    return [float(v) for v in _tell_supply(bench, "BENC:TRUT?").split(",")]


class TestEnd:
    # What a program makes of each of them: tests/base/test_interrupts.py.
    @pytest.mark.parametrize(
        "number",
        [signal.SIGINT, signal.SIGTERM, pytest.param(signal.SIGUSR1, marks=pytest.mark.long)],
        ids=lambda n: n.name,
    )
    def test_a_signal_switches_off_within_a_second_and_is_no_error(self, bench, parameters, start_node, client, number):
        node = start_node(parameters(), fresh=True)  # to the end of its interpreter
        _enabled(client)
        wait_until(lambda: bench.current_A() > 0.04)
        node.popen.send_signal(number)
        wait_until(lambda: bench.current_A() == 0.0, OFF_s, "end of the current")
        assert node.ends_in_order()
        if node.popen.returncode == 0:
            assert node.words.rstrip().endswith("sma_actuator_node: sma_actuator: output off, confirmed by the supply")
        assert "Traceback" not in node.words

    def test_a_supply_that_does_not_confirm_off_makes_it_end_with_1(self, bench, parameters, start_node, client):
        node = start_node(parameters())
        _enabled(client)
        wait_until(lambda: bench.current_A() > 0.04)
        bench.tell("BENC:FAUL supply_silent")
        node.popen.send_signal(signal.SIGTERM)
        assert node.ends() == 1
        node.says("sma_actuator_node: sma_actuator: the output is told to be off, not confirmed; look at the supply")
        wait_until(lambda: bench.current_A() == 0.0, what="the watchdog's cut")
        assert "Traceback" not in node.words

    def test_it_drives_where_ros_can_write_no_log_and_a_quit_switches_off_too(
        self, bench, parameters, start_node, client, monkeypatch
    ):
        monkeypatch.setenv("ROS_LOG_DIR", "/proc/none")
        node = start_node(parameters())
        _enabled(client)
        wait_until(lambda: bench.current_A() > 0.04)
        assert "going on without a log file of ROS 2" in node.words
        node.popen.send_signal(signal.SIGQUIT)
        wait_until(lambda: bench.current_A() == 0.0, OFF_s, "end of the current")
        assert node.ends_in_order()

    def test_words_that_nobody_reads_hold_up_neither_the_wire_nor_its_end(self, bench, parameters, client, folder):
        reader, writer = os.pipe()  # as of a pager that waits for its reader
        fcntl.fcntl(writer, fcntl.F_SETPIPE_SZ, 4096)
        path = parameter_file(folder, {"sma_actuator": parameters(**{"supply.watchdog_timeout": 60.0})})
        arguments = ["-m", "sma_actuator.ros.node", "--ros-args", "--params-file", str(path), "--log-level", "debug"]
        node = subprocess.Popen([sys.executable, *arguments], stdout=writer, stderr=writer)
        try:
            _enabled(client)
            wait_until(lambda: bench.current_A() > 0.04)
            wait_until(lambda: not select.select([], [writer], [], 0.0)[1], what="a full pipe")
            for _ in range(3):
                assert client.call(f"{NAME}/enable", SetBool, SetBool.Request(data=False)).success
                client.spin_until(lambda: _enable(client).success, what="enabling")
            wait_until(lambda: bench.current_A() > 0.04)
            node.send_signal(signal.SIGHUP)
            wait_until(lambda: bench.current_A() == 0.0, 5.0, "end of the current")
            assert node.wait(30.0) == 0
        finally:
            node.kill()
            node.wait()
            os.close(reader)
            os.close(writer)

    def test_after_kill_9_the_supplys_watchdog_switches_off(self, bench, parameters, start_node, client):
        node = start_node(parameters(**{"supply.watchdog_timeout": 0.5}))
        _enabled(client)
        wait_until(lambda: bench.current_A() > 0.04)
        node.popen.kill()
        wait_until(lambda: bench.current_A() == 0.0, OFF_s, "end of the current")
        assert _tell_supply(bench, "OUTP:PROT:TRIP?") == "WDOG"

    def test_a_stopped_process_is_cut_off_by_the_watchdog_and_does_not_go_on_by_itself(
        self, bench, parameters, start_node, client
    ):
        node = start_node(parameters(**{"supply.watchdog_timeout": 0.5}))
        _enabled(client)
        wait_until(lambda: bench.current_A() > 0.04)
        node.popen.send_signal(signal.SIGSTOP)
        wait_until(lambda: bench.current_A() == 0.0, OFF_s, "end of the current")
        node.popen.send_signal(signal.SIGCONT)
        assert _status(client, lambda s: s.fault).fault in (
            "supply_tripped",
            "clock_jump",
            "node_lost",
            "reading_stale",
        )
        assert bench.current_A() == 0.0

    def test_an_exception_in_the_loop_switches_off_and_is_an_error(
        self, bench, parameters, start_node, client, tmp_path
    ):
        now = tmp_path / "now"
        program = f"""
import os, sys
from sma_actuator.driver.loop import Loop
from sma_actuator.ros import node
steps = Loop.step
def step(self):
    output = steps(self)
    if os.path.exists({str(now)!r}):
        raise ZeroDivisionError("provoked")
    return output
Loop.step = step
sys.exit(node.main())
"""
        node = start_node(parameters(), program=("-c", program))
        _enabled(client)
        wait_until(lambda: bench.current_A() > 0.04)
        now.touch()
        assert node.ends() == 1
        assert "the control loop ended with ZeroDivisionError: provoked; the output is off" in node.words
        assert bench.current_A() == 0.0

    def test_a_ros_thread_that_hangs_is_a_lost_node(self, bench, parameters, start_node, client):
        program = """
import sys, threading
from sma_actuator.ros import commands, node
def hang(self, message):
    threading.Event().wait()
commands.Commands._on_setpoint = hang
sys.exit(node.main())
"""
        node = start_node(parameters(), program=("-c", program))
        _enabled(client)
        wait_until(lambda: bench.current_A() > 0.04)
        client.publish(f"{NAME}/setpoint", setpoint_message(0.002))
        wait_until(lambda: bench.current_A() == 0.0, OFF_s, "end of the current")
        node.popen.send_signal(signal.SIGTERM)
        assert node.ends_in_order()


class TestLifecycle:
    def test_by_hand_current_flows_only_while_active_and_enabled(self, bench, parameters, start_node, client):
        start_node(parameters(autostart=False))
        assert client.call(f"{NAME}/get_state", GetState).current_state.label == "unconfigured"
        response = _enable(client)
        assert not response.success
        assert response.message == "the node is unconfigured; configure and activate it first"
        assert _transition(client, Transition.TRANSITION_CONFIGURE)
        assert not _enable(client).success
        assert _transition(client, Transition.TRANSITION_ACTIVATE)
        _enabled(client)
        wait_until(lambda: bench.current_A() > 0.04)
        assert _transition(client, Transition.TRANSITION_DEACTIVATE)
        wait_until(lambda: bench.current_A() == 0.0, OFF_s)
        assert _transition(client, Transition.TRANSITION_ACTIVATE)
        _enabled(client)
        assert _transition(client, Transition.TRANSITION_DEACTIVATE)
        assert _transition(client, Transition.TRANSITION_CLEANUP)
        assert client.call(f"{NAME}/get_state", GetState).current_state.label == "unconfigured"
        assert _transition(client, Transition.TRANSITION_CONFIGURE)
        assert _transition(client, Transition.TRANSITION_ACTIVATE)
        _enabled(client)
        assert _transition(client, Transition.TRANSITION_ACTIVE_SHUTDOWN)
        wait_until(lambda: bench.current_A() == 0.0, OFF_s)

    def test_nothing_is_kept_of_drivers_that_were_given_up(self, parameters, start_node, client):
        program = """
import gc, sys, weakref
from sma_actuator.ros import node, wire
made, kept, opened = [], weakref.WeakSet(), wire.open_instruments
def open_instruments(config, clock):
    supply, daq = opened(config, clock)
    made.append(id(supply))
    kept.add(supply)
    return supply, daq
wire.open_instruments = open_instruments
code = node.main()
gc.collect()
print(f"kept {len(kept)} of {len(made)} supplies", file=sys.stderr)
sys.exit(code)
"""
        node = start_node(parameters(autostart=False), program=("-c", program))
        for _ in range(6):
            _transition(client, Transition.TRANSITION_CONFIGURE)
            _transition(client, Transition.TRANSITION_CLEANUP)
        node.popen.send_signal(signal.SIGTERM)
        assert node.ends_in_order()
        kept, made = (int(word) for word in node.words.split("kept ")[1].split()[:3:2])
        assert made >= 4
        assert kept <= 2, "of the first, with what is imported then, and of one that was not given up"

    def test_an_instrument_that_is_not_there_leaves_it_unconfigured(self, bench, parameters, start_node, client):
        start_node(parameters(autostart=False, **{"instruments.supply.resource": "TCPIP::127.0.0.1::1::SOCKET"}))
        assert not _transition(client, Transition.TRANSITION_CONFIGURE)
        assert client.call(f"{NAME}/get_state", GetState).current_state.label == "unconfigured"
        assert "TCPIP::127.0.0.1::1::SOCKET" in _status(client).message


class TestSeveralWires:
    def test_two_nodes_in_one_process_are_two_wires_and_a_fault_is_one_wires_alone(
        self, start_bench, make_config, start_node, client
    ):
        bench = start_bench("--count", "2")
        sections = {
            name: make_config(instruments=bench.instruments(i), joint_name=name)
            for i, name in enumerate(("left", "right"))
        }
        node = start_node(sections, names=["left", "right"])
        _enabled(client, "/left")
        assert bench.current_A(1) == 0.0
        _enabled(client, "/right")
        client.publish("/left/setpoint", setpoint_message(0.0025))
        state = client.next("/left/joint_states", JointState, lambda m: abs(m.position[0] - 0.0025) < 2e-4)
        assert list(state.name) == ["left"]
        bench.tell("BENC:FAUL open_wire", 0)
        assert _status(client, lambda s: s.fault and s.mode.value == "off", "/left")
        client.next("/right/joint_states", JointState)
        assert _status(client, name="/right").mode.value == "hold"
        assert bench.current_A(1) > 0.04
        bench.tell("BENC:FAUL:CLE", 0)
        client.spin_until(lambda: client.call("/left/clear_fault", Trigger).success, what="clearing")
        _enabled(client, "/left")
        wait_until(lambda: bench.current_A(0) > 0.04)
        node.popen.send_signal(signal.SIGTERM)
        wait_until(lambda: bench.current_A(0) == bench.current_A(1) == 0.0, OFF_s)
        assert node.ends_in_order()

    def test_renaming_several_at_once_is_refused(self, make_config, start_node):
        node = start_node({"a": make_config()}, "-r", "__node:=x", names=["a", "b"])
        assert node.ends() == 1
        assert "gives all nodes of this process the same name" in node.words
