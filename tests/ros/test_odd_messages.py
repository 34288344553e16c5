"""Whatever ROS can send, the node refuses it in a sentence and goes on driving."""

import math
import signal
import statistics
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytest.importorskip("rclpy")
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import WrenchStamped
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from ports import free_port
from processes import Bench, Client, NodeProcess, parameter_file, wait_until
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters, SetParametersAtomically
from rclpy.serialization import serialize_message
from std_msgs.msg import Float64
from std_srvs.srv import SetBool, Trigger
from test_node import ASKED, NAME, _enable, _enabled, _status, _transition
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint
from type_description_interfaces.srv import GetTypeDescription

from sma_msgs_py import setpoint_message, trajectory_message

DRIVEN = "/driven/sma_actuator"  # that of the fixture driven
_INT64_MAX = 2**63 - 1
ODD_VALUES = {
    "inf": {"type": 3, "double_value": math.inf},
    "-inf": {"type": 3, "double_value": -math.inf},
    "nan": {"type": 3, "double_value": math.nan},
    "huge": {"type": 3, "double_value": 1e308},
    "largest whole": {"type": 2, "integer_value": _INT64_MAX},
    "smallest whole": {"type": 2, "integer_value": -_INT64_MAX - 1},
    "true": {"type": 1, "bool_value": True},
    "text": {"type": 4, "string_value": "x" * 10_000},
    "bytes": {"type": 5, "byte_array_value": [b"a"]},
    "list": {"type": 8, "double_array_value": [1.0, math.nan]},
    "texts": {"type": 9, "string_array_value": ["", "\n"]},
    "nothing": {"type": 0},
    "no such type": {"type": 77},
}
LIVE = [
    "loop.overruns_to_fault",
    "controller.kp",
    "controller.on_setpoint_loss",
    "controller.setpoint_timeout",
    "safety.reading_timeout",
    "thermal.max_temperature",
    "wire.max_stress",
]
NOT_LIVE = ["wire.length", "model.type", "autostart", "model.heating_slope", "use_sim_time", "", "nowhere", "a" * 5000]


def _answers(client, name=ASKED):
    """The node serves a request of the ordinary kind, and the loop goes on."""
    assert client.call(f"{name}/get_state", GetState).current_state.label == "active"
    client.next(f"{name}/command_current", Float64)


@pytest.mark.parametrize("atomically", [False, True], ids=["one by one", "together"])
@pytest.mark.parametrize("odd", ODD_VALUES.values(), ids=ODD_VALUES)
def test_no_odd_value_of_a_parameter_is_taken_or_harms(client_of_running_node, odd, atomically):
    client = client_of_running_node
    for name in LIVE + NOT_LIVE:
        parameters = [Parameter(name=name, value=ParameterValue(**odd))]
        if atomically:
            request = SetParametersAtomically.Request(parameters=parameters)
            result = client.call(f"{ASKED}/set_parameters_atomically", SetParametersAtomically, request).result
        else:
            request = SetParameters.Request(parameters=parameters)
            (result,) = client.call(f"{ASKED}/set_parameters", SetParameters, request).results
        assert not result.successful, name
        assert result.reason, name
    _answers(client)


def test_odd_questions_about_parameters_are_answered(client_of_running_node):
    client, names = client_of_running_node, ["", "nowhere", "wire.length", "Ω" * 3000]
    client.call(f"{ASKED}/describe_parameters", DescribeParameters, DescribeParameters.Request(names=names))
    client.call(f"{ASKED}/get_parameters", GetParameters, GetParameters.Request(names=names))
    for depth in (0, 1, 2**63):
        client.call(
            f"{ASKED}/list_parameters", ListParameters, ListParameters.Request(prefixes=["", "..", "a."], depth=depth)
        )
    empty = client.call(f"{ASKED}/set_parameters_atomically", SetParametersAtomically).result
    assert not empty.successful
    _answers(client)


TOO_MUCH = {
    "names": (GetParameters, "get_parameters", {"names": ["controller.kp"] * 100_000}),
    "prefixes": (ListParameters, "list_parameters", {"prefixes": ["a"] * 100_000}),
    "described": (DescribeParameters, "describe_parameters", {"names": ["a"] * 100_000}),
    "a long name": (GetParameters, "get_parameters", {"names": ["a" * 1_000_000]}),
    "parameters": (SetParameters, "set_parameters", {"parameters": [Parameter(name="controller.kp")] * 2000}),
    "a long list": (
        SetParametersAtomically,
        "set_parameters_atomically",
        {"parameters": [Parameter(name="a", value=ParameterValue(type=9, string_array_value=["a"] * 110_000))]},
    ),
    "a long text": (
        SetParameters,
        "set_parameters",
        {"parameters": [Parameter(name="a", value=ParameterValue(type=4, string_value="a" * 1_000_000))]},
    ),
    "a long label": (ChangeState, "change_state", {"transition": Transition(label="a" * 20_000_000)}),
    "a long name of a type": (GetTypeDescription, "get_type_description", {"type_name": "a" * 1_000_000}),
}


@pytest.fixture(scope="module")
def driven(folder, make_config):
    """(bench, node, client) of a node that drives its wire through all of the tests that ask for it."""
    bench = Bench(folder, "--load", "weight:0.98")
    path = parameter_file(folder, {DRIVEN: make_config(instruments=bench.instruments())})
    node = NodeProcess(["--ros-args", "--params-file", str(path), "-r", "__ns:=/driven"], folder)
    client = Client()
    yield bench, node, client
    client.close()
    node.close()
    bench.close()


class TestWhileDriving:
    @pytest.fixture
    def driving(self, driven):
        bench, node, client = driven
        client.next(f"{DRIVEN}/load", WrenchStamped)
        status = _status(client, name=DRIVEN)
        if status.fault:  # of the test before, which has failed by it
            client.spin_until(lambda: client.call(f"{DRIVEN}/clear_fault", Trigger).success, what="clearing")
        if status.mode.value == "off":
            _enabled(client, DRIVEN)
        client.publish(f"{DRIVEN}/setpoint", setpoint_message(0.0025))
        _status(client, lambda s: s.mode.value == "tracking", DRIVEN)
        wait_until(lambda: bench.current_A() > 0.04)

        def still_drives():
            assert node.popen.poll() is None, node.words
            assert _status(client, name=DRIVEN).mode.value == "tracking"
            assert bench.current_A() > 0.04
            assert "Traceback" not in node.words

        return node, client, still_drives

    @pytest.mark.parametrize(("kind", "service", "asked"), TOO_MUCH.values(), ids=TOO_MUCH)
    def test_a_request_that_is_too_much_is_refused_unread(self, driving, kind, service, asked):
        node, client, still_drives = driving
        response = client.call(f"{DRIVEN}/{service}", kind, kind.Request(**asked))
        results = [getattr(response, "result", None), *getattr(response, "results", [])]
        assert all(each.reason for each in results if hasattr(each, "reason"))
        node.says(f"{service}: the request was refused: it has")
        still_drives()

    @pytest.mark.parametrize(
        ("transition", "shown"),
        [
            ({"id": 1}, "'1'"),
            ({"id": 99}, "'99'"),
            ({"label": "activate"}, "'activate'"),
            ({"id": 3}, "'3'"),
            ({"label": "x" * 100_000}, "(100000 characters)'"),
        ],
        ids=["configure", "no such number", "activate", "activate by number", "a long word"],
    )
    def test_a_transition_that_the_state_does_not_have_is_refused(self, driving, transition, shown):
        node, client, still_drives = driving
        request = ChangeState.Request(transition=Transition(**transition))
        sentence = f"{shown} is not one of deactivate (4), shutdown (7)"
        # Of refusals that differ in numbers alone one a second is shown.
        client.spin_until(
            lambda: not client.call(f"{DRIVEN}/change_state", ChangeState, request).success and sentence in node.words,
            what=sentence,
        )
        still_drives()

    def test_sim_time_is_refused_live(self, driving):
        _, client, still_drives = driving
        value = ParameterValue(type=1, bool_value=True)
        request = SetParameters.Request(parameters=[Parameter(name="use_sim_time", value=value)])
        (result,) = client.call(f"{DRIVEN}/set_parameters", SetParameters, request).results
        assert not result.successful
        assert "the instruments measure in real time" in result.reason
        still_drives()

    def test_broken_and_absurd_messages_are_refused(self, driving):
        node, client, still_drives = driving
        good = bytes(serialize_message(trajectory_message("sma_joint", [1.0, 2.0], [0.002, 0.002])))
        point = JointTrajectoryPoint(positions=[0.002], time_from_start=Duration(sec=-(2**31), nanosec=2**32 - 1))
        absurd = [
            (Float64, f"{DRIVEN}/setpoint", b""),
            (Float64, f"{DRIVEN}/setpoint", b"\x00\x01\x00\x00\x01"),
            (JointTrajectory, f"{DRIVEN}/joint_trajectory", good[:40]),
            (JointTrajectory, f"{DRIVEN}/joint_trajectory", good.replace(b"sma_joint", b"\xff\xfe\xfd_joint")),
            (JointTrajectory, f"{DRIVEN}/joint_trajectory", JointTrajectory(joint_names=["sma_joint"], points=[point])),
            (Float64, f"{DRIVEN}/setpoint", Float64(data=1e308)),
        ]
        for kind, topic, message in absurd:
            publisher = client.node.create_publisher(kind, topic, 10)
            client.spin_until(lambda p=publisher: p.get_subscription_count() > 0, what=f"subscriber of {topic}")
            publisher.publish(message)
            client.next(f"{DRIVEN}/command_current", Float64)
        node.says("is before the start; 0 or later is wanted")
        still_drives()

    @pytest.mark.parametrize("points", [100_000, 1_000_000])
    def test_a_trajectory_of_far_too_many_points_is_refused_without_holding_anything_up(self, driving, points):
        node, client, still_drives = driving
        small = bytes(serialize_message(trajectory_message("sma_joint", [1.0, 2.0], [0.002, 0.002])))
        two_points = bytes(serialize_message(trajectory_message("sma_joint", [1.0], [0.002])))
        one_point_B = len(small) - len(two_points)
        publisher = client.node.create_publisher(JointTrajectory, f"{DRIVEN}/joint_trajectory", 10)
        client.spin_until(lambda: publisher.get_subscription_count() > 0, what="subscriber of the trajectory")
        publisher.publish(small + bytes(one_point_B * points))  # its size is what counts
        node.says("trajectory refused: its message has")
        still_drives()


class TestDefects:
    def test_a_message_that_a_defect_cannot_take_is_refused(self, start_bench, make_config, start_node, client):
        bench = start_bench("--load", "weight:0.98")
        program = """
import sys
from sma_actuator.ros import commands, node, reporter
def broken(self, message):
    raise ZeroDivisionError("provoked")
commands.Commands._on_setpoint = broken
sys.exit(node.main())
"""
        node = start_node(make_config(instruments=bench.instruments()), program=("-c", program))
        _enabled(client)
        client.publish(f"{NAME}/setpoint", setpoint_message(0.002))
        node.says("/sma_actuator/setpoint: a message was refused: ZeroDivisionError: provoked")
        assert _status(client).mode.value == "hold"
        assert bench.current_A() > 0.04

    def test_an_exception_that_no_message_is_to_blame_for_is_a_fault_and_the_node_goes_on(
        self, start_bench, make_config, start_node, client, tmp_path
    ):
        bench, now = start_bench("--load", "weight:0.98"), tmp_path / "now"
        program = f"""
import os, sys
from sma_actuator.ros import commands, node, reporter
health = reporter.WireReporter._key_values
def broken(self):
    if os.path.exists({str(now)!r}):
        os.remove({str(now)!r})
        raise ZeroDivisionError("provoked")
    return health(self)
reporter.WireReporter._key_values = broken
sys.exit(node.main())
"""
        node = start_node(make_config(instruments=bench.instruments()), program=("-c", program))
        _enabled(client)
        wait_until(lambda: bench.current_A() > 0.04)
        now.touch()
        wait_until(lambda: bench.current_A() == 0.0, what="end of the current")
        assert _status(client, lambda s: s.fault).fault == "unhandled_exception"
        assert "ZeroDivisionError in a ROS callback: provoked" in node.words
        assert client.call(f"{NAME}/clear_fault", Trigger).success
        _enabled(client)

    @pytest.mark.parametrize(
        "hangs, code",
        [
            # As Fast DDS does where the clock says a time before 1970: for ever, and Python with it.
            pytest.param("node.Switch.close = lambda self: ctypes.PyDLL(None).pause()", 1, marks=pytest.mark.long),
            # A thread that Python waits for at its end.
            ("threading.Thread(target=threading.Event().wait).start()", 1),
            # A library that tidies up when Python is gone already.
            ("libc.__cxa_atexit(ctypes.cast(libc.pause, ctypes.c_void_p), None, None)", -signal.SIGALRM),
        ],
        ids=["ros", "thread", "library"],
    )
    def test_what_hangs_at_the_end_ends_with_the_process_and_the_output_off(
        self, start_bench, make_config, start_node, client, hangs, code
    ):
        bench = start_bench("--load", "weight:0.98")
        program = f"""
import ctypes, sys, threading
from sma_actuator.ros import commands, node, reporter
libc = ctypes.CDLL(None)
node.END_s = 1.0
{hangs}
sys.exit(node.main())
"""
        node = start_node(make_config(instruments=bench.instruments()), program=("-c", program), fresh=True)
        _enabled(client)
        wait_until(lambda: bench.current_A() > 0.04)
        node.popen.send_signal(signal.SIGTERM)
        wait_until(lambda: bench.current_A() == 0.0, what="end of the current")
        assert node.ends() == code


class TestFromTheStart:
    def test_sim_time_in_the_parameter_file_is_refused_and_the_node_runs(
        self, start_bench, make_config, start_node, client
    ):
        bench = start_bench("--load", "weight:0.98")
        node = start_node(make_config(instruments=bench.instruments(), use_sim_time=True))
        node.says("use_sim_time: true is refused")
        _enabled(client)
        request = GetParameters.Request(names=["use_sim_time"])
        assert not client.call(f"{NAME}/get_parameters", GetParameters, request).values[0].bool_value

    def test_a_node_that_waits_for_instruments_can_be_shut_down_by_transition(self, make_config, start_node, client):
        nowhere = {f"instruments.{name}.resource": "TCPIP::127.0.0.1::1::SOCKET" for name in ("supply", "daq")}
        node = start_node(make_config(**nowhere))
        node.says("looking again until they are there")
        assert _transition(client, Transition.TRANSITION_UNCONFIGURED_SHUTDOWN)
        assert client.call(f"{NAME}/get_state", GetState).current_state.label == "finalized"
        said = _status(client)  # the timer that tries again has run out by the time of the second
        _status(client)
        assert node.popen.poll() is None, node.words
        assert "finalized" in str(said.values["lifecycle"])

    def test_a_node_that_waits_for_instruments_can_be_configured_by_hand_meanwhile(
        self, start_bench, make_config, start_node, client
    ):
        there = ("--load", "weight:0.98", "--supply-port", free_port(), "--daq-port", free_port())
        bench = start_bench(*there)
        resources = bench.instruments()
        bench.close()
        node = start_node(make_config(instruments=resources))
        node.says("looking again until they are there")
        start_bench(*there)
        _transition(client, Transition.TRANSITION_CONFIGURE)  # or the node itself has been quicker
        _status(client, lambda s: s.values["lifecycle"] == "active")
        assert client.call(f"{NAME}/get_state", GetState).current_state.label == "active"
        assert node.popen.poll() is None, node.words


class TestFlood:
    @pytest.fixture(scope="class")
    def flooded(self, folder, make_config):
        """(bench, client) of a node that four publishers flood through both tests."""
        bench = Bench(folder, "--load", "weight:0.98")
        # So low that a flood is one on a slow machine too.
        parameters = make_config(instruments=bench.instruments(), **{"safety.setpoint_flood_rate": 20.0})
        path = parameter_file(folder, {"sma_actuator": parameters})
        node, client, floods = NodeProcess(["--ros-args", "--params-file", str(path)], folder), Client(), []
        try:
            _enabled(client)
            program = [sys.executable, str(Path(__file__).with_name("flood.py")), f"{NAME}/setpoint"]
            floods += [subprocess.Popen(program, stdout=subprocess.PIPE) for _ in range(4)]
            for flood in floods:
                flood.stdout.readline()
            node.says("setpoints come faster than safety.setpoint_flood_rate")
            yield bench, client
        finally:
            for flood in floods:
                flood.kill()
                flood.wait()
                flood.stdout.close()
            client.close()
            node.close()
            bench.close()

    def test_off_goes_before_four_publishers_that_flood(self, flooded):
        bench, client = flooded
        took_s = []
        for _ in range(5):
            client.spin_until(lambda: _enable(client).success, what="enabling")
            wait_until(lambda: bench.current_A() > 0.04)
            began_s = time.monotonic()
            response = _enable(client, on=False)
            assert response.success, response.message
            wait_until(lambda: bench.current_A() == 0.0, what="end of the current")
            took_s.append(time.monotonic() - began_s)
        # Mostly: a machine that stalls may take as long as a request that is lost in the flood, which DDS offers again
        # only after three seconds.
        assert statistics.median(took_s) < 2.0, took_s

    def test_stop_switches_off_and_says_so(self, flooded):
        bench, client = flooded
        client.spin_until(lambda: _enable(client).success, what="enabling")
        response = client.call(f"{NAME}/stop", Trigger)
        assert response.success
        assert response.message == "/sma_actuator: the output is off"
        wait_until(lambda: bench.current_A() == 0.0, what="end of the current")


AGAIN_AND_AGAIN = "~/enable true comes again and again"


def test_off_wins_over_a_client_that_asks_for_on_a_hundred_times_a_second(start_bench, make_config, start_node, client):
    bench = start_bench("--load", "weight:0.98")
    node = start_node(make_config(instruments=bench.instruments()))
    _enabled(client)
    program = [sys.executable, str(Path(__file__).with_name("flood.py")), f"{NAME}/enable", "100"]
    with subprocess.Popen(program, stdout=subprocess.PIPE) as flood:
        try:
            flood.stdout.readline()
            for stop in (False, True, False):
                refused = node.words.count(AGAIN_AND_AGAIN)
                wait_until(lambda: bench.current_A() > 0.04)
                response = client.call(f"{NAME}/stop", Trigger) if stop else _enable(client, on=False)
                assert response.success, response.message
                wait_until(lambda: bench.current_A() == 0.0, what="end of the current")
                wait_until(lambda refused=refused: node.words.count(AGAIN_AND_AGAIN) > refused, what="requests")
                assert bench.current_A() == 0.0
                flood.send_signal(signal.SIGUSR1)
                # What it asked before it heard of that may yet come, and makes the first on a request among many.
                client.spin_until(lambda: _enable(client).success, what="enabling")
                flood.send_signal(signal.SIGUSR2)
        finally:
            flood.kill()


def test_stop_switches_off_every_wire_of_the_process(start_bench, make_config, start_node, client):
    bench = start_bench("--count", "2")
    sections = {name: make_config(instruments=bench.instruments(i)) for i, name in enumerate(("left", "right"))}
    start_node(sections, names=["left", "right"])
    _enabled(client, "/left")
    _enabled(client, "/right")
    wait_until(lambda: bench.current_A(0) > 0.04 and bench.current_A(1) > 0.04)
    response = client.call("/right/stop", Trigger)
    assert response.success
    assert response.message == "/left: the output is off; /right: the output is off"
    wait_until(lambda: bench.current_A(0) == bench.current_A(1) == 0.0, what="end of both currents")


def test_a_node_without_instruments_knows_nothing_of_the_output_but_what_it_read_last(
    start_bench, make_config, start_node, client
):
    def off():
        answer = client.call(f"{NAME}/enable", SetBool, SetBool.Request(data=False))
        return answer.success, answer.message

    bench = start_bench("--load", "weight:0.98")
    start_node(make_config(instruments=bench.instruments(), autostart=False))
    unknown = "not known: no instruments are open, so nobody can say whether the output is off; look at the supply"
    assert off() == (False, unknown)
    assert not client.call(f"{NAME}/enable", SetBool, SetBool.Request(data=True)).success
    for transition in (Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE):
        assert _transition(client, transition)
    client.spin_until(lambda: _enable(client).success, what="enabling")
    for transition in (Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_CLEANUP):
        assert _transition(client, transition)
    assert off() == (True, "the output is off: the supply said so before it was given up")
    bench.close()
    assert not _transition(client, Transition.TRANSITION_CONFIGURE)
    assert off() == (False, unknown)
