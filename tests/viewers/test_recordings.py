"""A recording is opened by Foxglove's own packages: every kind of message, every value; the layouts draw what is in
it."""

import json
import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed (extra 'ros')")
pytest.importorskip("rosbags.rosbag2", reason="rosbags is not installed (extra 'bags')")

import foreign
from messages import NAME, STAMP_ns, every_message, kind_of
from rclpy.serialization import serialize_message
from rosbags import rosbag2
from rosbags.typesys import Stores, get_typestore

import sma_msgs_py
from sma_actuator.logs.bags import log_from_bag
from sma_actuator.ros.named_signals import named_signals

LAYOUTS = Path(__file__).resolve().parents[2] / "layouts"
FOR_NOBODY = {"time_message"}  #: makes a part of messages


@pytest.fixture
def recording(outputs, tmp_path):
    """(file, what was put into it)."""
    foreign.need_node()
    messages = every_message(outputs)
    store, connections = get_typestore(Stores.ROS2_JAZZY), {}
    with rosbag2.Writer(tmp_path / "bag", version=9, storage_plugin=rosbag2.StoragePlugin.MCAP) as writer:
        for number, (topic, message) in enumerate(messages):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind_of(message), typestore=store)
            writer.write(connections[topic], STAMP_ns + number, serialize_message(message))
    return tmp_path / "bag" / "bag.mcap", messages


@pytest.fixture
def opened(recording):
    """What Foxglove's packages read of the recording."""
    return foreign.run("open_mcap.mjs", recording[0])


def test_every_kind_of_message_is_recorded_here(outputs):
    """A new kind of message joins :func:`every_message`."""
    source = Path(__file__).with_name("messages.py").read_text(encoding="utf-8")
    makers = {name for name in sma_msgs_py.__all__ if re.search("_message$|_status_from$", name)} - FOR_NOBODY
    assert makers == set(re.findall(r"sma_msgs_py\.(\w+(?:_message|_status_from))\(", source)) - FOR_NOBODY
    assert all(serialize_message(message) for _, message in every_message(outputs))


def test_every_value_is_the_one_that_was_sent(recording, opened):
    found, sent = foreign.lines(opened), recording[1]
    assert [each["topic"] for each in found] == [topic for topic, _ in sent]
    for number, (each, (topic, message)) in enumerate(zip(found, sent)):
        assert each["type"] == kind_of(message)
        assert each["encoding"] == ["cdr", "ros2msg"]
        assert int(each["logTime"]) == STAMP_ns + number
        assert foreign.same(each["message"], foreign.plain(message)), topic


def test_a_bench_log_of_the_recording_holds_the_same(recording, opened):
    ours = log_from_bag(recording[0], {})
    theirs = [each["message"] for each in foreign.lines(opened) if each["topic"] == f"{NAME}/signals"]
    assert len(ours) == len(theirs) > 1
    for name in ours.columns:
        values = [message["position"][message["name"].index(name)] for message in theirs]
        np.testing.assert_array_equal(ours[name], values, err_msg=name)


def _plotjuggler_series(messages):
    """Series that PlotJuggler (3.9 and newer) makes of messages of joints: one a name and what there is of it."""
    return {
        f"{each['topic']}/{name}/{part}"
        for each in messages
        if each["type"] == "sensor_msgs/msg/JointState"
        for part in ("position", "velocity", "effort")
        for name, _ in zip(each["message"]["name"], each["message"][part])
    }


def test_the_layout_for_plotjuggler_draws_series_that_it_makes_of_the_recording(opened):
    series = _plotjuggler_series(foreign.lines(opened))
    curves = ElementTree.parse(LAYOUTS / "plotjuggler.xml").getroot().findall(".//curve")
    drawn = {
        curve.get(key) for curve in curves for key in (("curve_x", "curve_y") if curve.get("curve_x") else ("name",))
    }
    assert len(drawn) > 10
    assert drawn <= series


def test_the_layout_for_foxglove_draws_numbers_that_its_script_makes_of_the_recording(opened, outputs):
    """The user script is translated and run as Foxglove does, on messages as Foxglove reads them."""
    layout = json.loads((LAYOUTS / "foxglove.json").read_text(encoding="utf-8"))
    made = foreign.lines(foreign.run("run_script.mjs", LAYOUTS / "foxglove.json", stdin=opened))
    assert len(made) == len(outputs)
    plots = [panel for name, panel in layout["configById"].items() if name.startswith("Plot!")]
    paths = {path["value"] for plot in plots for path in [*plot["paths"], *filter(None, [plot.get("xAxisPath")])]}
    assert len(paths) == 8
    for path in paths:
        topic, _, name = path.partition(".")
        values = [each["message"][name] for each in made if each["topic"] == topic]
        assert foreign.same(values, [float(named_signals(output)[name]) for output in outputs]), path
        assert np.isfinite(values[-1]) or name == "displacement_m", path  # no reference sensor is wired
