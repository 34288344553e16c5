"""Parameter files and -p are read before rclpy sees them, so that nothing in them is lost."""

import subprocess
import sys

import pytest

from sma_actuator.base import parameter_file
from sma_actuator.base.parameters import ConfigError
from sma_actuator.base.share import shared_file
from sma_actuator.base.yaml_text import yaml_of
from sma_actuator.config import read_parameter_file
from sma_actuator.ros.arguments import parse


@pytest.fixture
def file(tmp_path):
    def write(text):
        path = tmp_path / f"{len(list(tmp_path.iterdir()))}.yaml"
        path.write_text(text)
        return str(path)

    return write


def test_what_is_not_about_parameters_is_left_to_rclpy():
    arguments = parse(["--nodes", "a", "--ros-args", "-r", "x:=y", "-p", "rate:=3", "--log-level", "debug", "--", "b"])
    assert arguments.user == ["--nodes", "a", "b"]
    assert arguments.rclpy == ["--ros-args", "-r", "x:=y", "--log-level", "debug"]


def test_a_whole_number_and_a_mixed_list_are_read_as_they_stand(file):
    path = file("sma_actuator: {ros__parameters: {controller: {kp: 250}, model: {slope: [1, 2.5]}}}")
    parameters = parse(["--ros-args", "--params-file", path]).parameters_of("/sma_actuator")
    assert parameters == {"controller": {"kp": 250}, "model": {"slope": [1, 2.5]}}


@pytest.mark.parametrize(
    ("section", "node", "found"),
    [
        ("/**", "/ns/left", True),
        ("left", "/left", True),
        ("/left", "/left", True),
        ("left", "/ns/left", True),
        ("/left", "/ns/left", False),
        ("/other/left", "/ns/left", False),
        ("/*/left", "/ns/left", True),
        ("/ns/*", "/ns/left", True),
        ("/*", "/ns/left", False),
        ("/**/left", "/left", True),
        ("/**/left", "/a/b/left", True),
        ("l.ft", "/left", False),
    ],
)
def test_a_section_means_the_nodes_its_pattern_matches(file, section, node, found):
    arguments = parse(["--ros-args", "--params-file", file(f"{section}: {{ros__parameters: {{a: 1}}}}")])
    if found:
        assert arguments.parameters_of(node) == {"a": 1}
    else:
        with pytest.raises(ConfigError, match="no section 'left"):
            arguments.parameters_of(node)


def test_a_namespace_may_be_nested_and_a_name_dotted(file):
    path = file("ns:\n  left:\n    ros__parameters: {wire.length: 0.1, wire: {diameter: 1.0e-4}}")
    parameters = parse(["--ros-args", "--params-file", path]).parameters_of("/ns/left")
    assert parameters == {"wire": {"length": 0.1, "diameter": 1e-4}}


def test_a_bare_name_stands_back_where_the_file_has_the_full_one(file):
    path = file("left: {ros__parameters: {a: 1, b: 1}}\n/ns/left: {ros__parameters: {a: 2}}")
    assert parse(["--ros-args", "--params-file", path]).parameters_of("/ns/left") == {"a": 2}


def test_later_files_override_earlier_ones_and_assignments_override_files(file):
    first = file("/**: {ros__parameters: {a: 1, b: 1, c: 1}}")
    second = file("left: {ros__parameters: {b: 2, c: 2}}")
    arguments = parse(["--ros-args", "--params-file", first, "--params-file", second, "-p", "c:=3", "-p", "right:a:=4"])
    assert arguments.parameters_of("/left") == {"a": 1, "b": 2, "c": 3}
    assert arguments.parameters_of("/right") == {"a": 4, "b": 1, "c": 3}


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--ros-args"], "/sma_actuator has no parameters; start it with --ros-args --params-file FILE"),
        (["--ros-args", "--params-file"], "--params-file: something is wanted after it"),
        (["--ros-args", "--params-file", "/nowhere.yaml"], "/nowhere.yaml: cannot be read"),
        (["--ros-args", "-p", "kp=3"], "-p kp=3: is not of the form name:=value"),
        (["--ros-args", "-p", "kp:=[3"], "-p kp:=[3: line 1: is not YAML"),
    ],
)
def test_what_cannot_be_read_is_refused_in_a_sentence(arguments, sentence):
    with pytest.raises(ConfigError) as refusal:
        parse(arguments).parameters_of("/sma_actuator")
    assert sentence in str(refusal.value)


@pytest.mark.parametrize("name", ["a-b", "9a", "a b", "a\nb", "", "a" * 201, "Ω", "a/b", "\udcff"])
def test_a_name_that_ros_does_not_allow_gets_a_sentence(name):
    pytest.importorskip("rclpy")
    from sma_actuator.ros.node import named

    with pytest.raises(ConfigError, match="is no name of a node: letters, digits and _ are wanted"):
        named(["--nodes", name])


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["-r", "__node:=a-b"], "ROS 2 refuses them: Couldn't parse remap rule: '-r __node:=a-b'"),
        (["-r", "__ns:=9/a"], "ROS 2 refuses them: Couldn't parse remap rule: '-r __ns:=9/a'"),
        (["--log-level", "much"], "ROS 2 refuses them: Couldn't parse log level: '--log-level much'"),
        (["-r", "__node:=\udcff"], "'__node:=.udcff' is no text"),
        (["--nonsense"], r"ROS 2 does not know \['--nonsense'\]"),
    ],
)
def test_arguments_that_ros_does_not_understand_get_a_sentence(arguments, sentence):
    pytest.importorskip("rclpy")
    from sma_actuator.ros.node import begin_ros

    with pytest.raises(ConfigError, match=sentence):
        begin_ros(["--ros-args", *arguments])


@pytest.mark.parametrize("length", [240, 300])
def test_a_name_too_long_for_the_topics_of_a_node_gets_a_sentence(length):
    """Of the topics at the first, of any node at the second, which ended in a traceback."""
    pytest.importorskip("rclpy")
    file = shared_file("config/flexinol.yaml")
    named = ["-r", f"__node:={'a' * length}", "--params-file", str(file)]
    code = "import sys; from sma_actuator.ros.node import main; sys.exit(main(sys.argv[1:]))"
    arguments = [sys.executable, "-c", code, "--ros-args", *named]
    ended = subprocess.run(arguments, capture_output=True, text=True, timeout=60)
    assert ended.returncode == 1 and "Traceback" not in ended.stderr
    assert "aaa' is no name of a node: letters, digits and _ are wanted" in ended.stderr


def test_sixteen_coils_with_their_tables_stand_in_one_file_that_is_read_once(file, monkeypatch):
    wanted = read_parameter_file(shared_file("config/coil.yaml"))
    of_coil = yaml_of(wanted).replace("\n", "\n    ")
    names = [f"wire_{number}" for number in range(16)]
    path = file("".join(f"{name}:\n  ros__parameters:\n    {of_coil}\n" for name in names))
    read, read_yaml = [], parameter_file.read_yaml
    monkeypatch.setattr(parameter_file, "read_yaml", lambda path, wanted: read.append(path) or read_yaml(path, wanted))
    arguments = parse(["--ros-args", "--params-file", path])
    assert all(arguments.parameters_of(f"/{name}") == wanted for name in names)
    assert len(read) == 1
