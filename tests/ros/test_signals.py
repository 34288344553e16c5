"""``~/signals``: every column of the bench log and what was made of it; a bag of it is a bench log."""

import json
import math
import signal

import numpy as np
import pytest

pytest.importorskip("rclpy")
from geometry_msgs.msg import WrenchStamped
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from test_node import NAME, _enable, _enabled, _status

from sma_actuator.cli.main import main
from sma_actuator.logs.bags import log_from_bag
from sma_actuator.logs.bench_log import read_bench_log
from sma_actuator.logs.recorder import RECORDED_COLUMNS
from sma_msgs_py import setpoint_message, signals_from

MADE_OF_IT = {
    "limited_setpoint_m",
    "shortest_m",
    "longest_m",
    "error_m",
    "resistance_Ohm",
    "stress_Pa",
    "power_W",
    "temperature_C",
    "heat_loss_times",
    "current_limit_A",
    "current_A",
    "load_N",
    "displacement_m",
    "uncertainty_m",
    "model_health",
    "model_error_m",
}


def _stamp_s(message):
    return message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec


def _bag(path, messages, mcap):
    rosbag2 = pytest.importorskip("rosbags.rosbag2")
    from rosbags.typesys import Stores, get_typestore

    plugin = rosbag2.StoragePlugin.MCAP if mcap else rosbag2.StoragePlugin.SQLITE3
    with rosbag2.Writer(path, version=9, storage_plugin=plugin) as writer:
        store = get_typestore(Stores.ROS2_JAZZY)
        connection = writer.add_connection(f"{NAME}/signals", "sensor_msgs/msg/JointState", typestore=store)
        for serialized in messages:
            stamp_s = _stamp_s(deserialize_message(serialized, JointState))
            writer.write(connection, round(1e9 * stamp_s), serialized)
    return path


@pytest.fixture
def driven(start_bench, make_config, start_node, client, tmp_path):
    """(messages of ~/signals, as a recorder gets them: bytes; the node's own log; its parameters): a wire was
    driven."""
    bench = start_bench("--load", "weight:0.98")
    parameters = make_config(instruments=bench.instruments(), recorder={"folder": str(tmp_path / "log")})
    node = start_node(parameters)
    client.next(f"{NAME}/load", WrenchStamped)
    messages = []
    client.node.create_subscription(JointState, f"{NAME}/signals", messages.append, 500, raw=True)
    client.spin_until(lambda: len(messages) > 10, what="signals with the output off")
    _enabled(client)
    client.publish(f"{NAME}/setpoint", setpoint_message(0.0025))
    client.next(f"{NAME}/joint_states", JointState, lambda m: abs(m.position[0] - 0.0025) < 2e-4)
    _enable(client, on=False)
    _status(client, lambda s: s.mode.value == "off")
    assert not client.call(f"{NAME}/tare_load", Trigger).success  # there hangs a load
    seen = len(messages)
    client.spin_until(lambda: len(messages) > seen + 20, what="signals after switching off")
    node.popen.send_signal(signal.SIGINT)
    assert node.ends_in_order()
    (file,) = (tmp_path / "log").glob("*.csv")
    return messages, file, parameters


@pytest.mark.parametrize("mcap", [pytest.param(False, marks=pytest.mark.long), True], ids=["sqlite3", "mcap"])
def test_a_bag_of_it_is_the_recorders_log_and_goes_through_replay_without_a_topic(driven, tmp_path, mcap, capsys):
    serialized, file, parameters = driven
    messages = [deserialize_message(message, JointState) for message in serialized]
    values = [signals_from(message) for message in messages]
    assert set(RECORDED_COLUMNS) | MADE_OF_IT <= set(values[0])

    # Stamped with the time of sampling: the distances are those of the loop's own clock.
    stamps_s = np.array([_stamp_s(message) for message in messages])
    times_s = np.array([value["time_s"] for value in values])
    assert np.all(np.diff(times_s) > 0.0)
    np.testing.assert_allclose(stamps_s - stamps_s[0], times_s - times_s[0], atol=0.02)

    # No position is said that nobody knows.
    for value in values:
        known = math.isfinite(value["displacement_estimate_m"])
        assert known == (value["quality"] < 4)
        if known and math.isfinite(value["limited_setpoint_m"]):
            expected_m = value["displacement_estimate_m"] - value["limited_setpoint_m"]
            assert value["error_m"] == pytest.approx(expected_m, abs=1e-12)
    assert not math.isfinite(values[0]["displacement_estimate_m"])
    assert not math.isfinite(values[-1]["displacement_estimate_m"])

    # Row for row and digit for digit what the recorder wrote meanwhile.
    bag = _bag(tmp_path / "bag", serialized, mcap)
    recorded, from_bag = read_bench_log(file, allow_gaps=True), log_from_bag(bag, {})
    rows = np.isin(recorded["time_s"], from_bag["time_s"])
    assert rows.sum() == len(from_bag) == len(messages)
    for name in recorded.columns:
        known = from_bag["quality"] < 4 if name.startswith(("displacement_e", "velocity_e")) else slice(None)
        np.testing.assert_array_equal(from_bag[name][known], recorded[name][rows][known], err_msg=name)
    since_s = from_bag["time_s"][0]
    assert [e for e in from_bag.events if e[0] > since_s] == [e for e in recorded.events if e[0] > since_s]
    assert any("enabled" in event for _, event in from_bag.events)

    model = tmp_path / "model.yaml"
    model.write_text(json.dumps({"sma_actuator": {"ros__parameters": parameters}}))
    verdicts = {}
    for name, log in (("bag", bag), ("csv", _cut(file, from_bag["time_s"], tmp_path / "cut.csv"))):
        code = main(["replay", str(log), "--config", str(model), "--json", str(tmp_path / f"{name}.json")])
        assert code == 0, capsys.readouterr().err
        (verdicts[name],) = json.loads((tmp_path / f"{name}.json").read_text())
        verdicts[name] = {key: value for key, value in verdicts[name].items() if isinstance(value, (int, float))}
    assert verdicts["bag"] == pytest.approx(verdicts["csv"], rel=1e-12, nan_ok=True)


def _cut(file, times_s, path):
    """The recorder's file, the rows of which the bag holds too: it begins later, and ends before the node does."""
    header, *rows = file.read_text().splitlines(keepends=True)
    path.write_text(header + "".join(row for row in rows if float(row.partition(",")[0]) in set(times_s)))
    return path


def test_no_message_of_joint_states_tells_a_position_while_the_output_is_off(
    start_bench, make_config, start_node, client
):
    bench = start_bench("--load", "weight:0.98")
    start_node(make_config(instruments=bench.instruments()))
    _enabled(client)
    client.publish(f"{NAME}/setpoint", setpoint_message(0.0025))
    client.next(f"{NAME}/joint_states", JointState, lambda m: abs(m.position[0] - 0.0025) < 2e-4)
    assert _enable(client, on=False).success
    _status(client, lambda s: s.values["quality"] == "invalid")
    states, loads = (
        client.listen(f"{NAME}/{topic}", kind)
        for topic, kind in (("joint_states", JointState), ("load", WrenchStamped))
    )
    client.next(f"{NAME}/load", WrenchStamped)  # whatever was under way is here
    states.clear()
    loads.clear()
    client.spin_until(lambda: len(loads) > 20, what="loads")
    assert states == []
    _enabled(client)
    client.next(f"{NAME}/joint_states", JointState)
    assert abs(states[0].position[0] - bench.truth()[0]) < 1e-3
