"""YAML that means something else than a person reads in it, or costs more than its size, is refused with its line."""

import math
import os
import time

import pytest
import yaml

from sma_actuator.base import yaml_text
from sma_actuator.base.parameters import ConfigError, walk
from sma_actuator.base.share import shared_file
from sma_actuator.base.yaml_text import DEEPEST_LEVEL, LONGEST_TEXT, parse_yaml, read_yaml
from sma_actuator.config import Config
from sma_actuator.diagnosis.forward.wire import read_wire
from sma_actuator.instruments.dialect import FOLDER, Dialect

_BOMB = "a0: &a0 [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]\n" for i in range(1, 12)
)


@pytest.fixture(params=[yaml_text._LibyamlLoader, yaml_text._PythonLoader], ids=["libyaml", "without"])
def either_parser(request, monkeypatch):
    """As PyYAML was built."""
    if request.param is yaml_text._LibyamlLoader and not yaml.__with_libyaml__:
        pytest.skip("PyYAML was built without libyaml")
    monkeypatch.setattr(yaml_text, "_Loader", request.param)


@pytest.mark.usefixtures("either_parser")
def test_numbers_are_read_as_ros_reads_them():
    assert parse_yaml("[175.0e6, 1e-6, 250, 0.1, .inf]", "x") == [175e6, 1e-6, 250, 0.1, math.inf]


@pytest.mark.usefixtures("either_parser")
@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("a: 1\nb:\n  c: 1\n  c: 2\n", "file.yaml: line 4: 'c' stands here twice, first in line 3"),
        ("a: 1\n'a': 2\n", "file.yaml: line 2: 'a' stands here twice, first in line 1"),
        (_BOMB, "file.yaml: line 2: an alias"),
        ("a: &a [*a]", "file.yaml: line 1: an alias"),
        ("[" * 900, f"file.yaml: line 1: nested more than {DEEPEST_LEVEL} levels deep"),
        ("[" * 100_000, "file.yaml: line 1: "),  # a newer libyaml reads ahead, and has a bound of its own at 1000
        ("{a: " * 300, "levels deep"),
        ("\na: " + "9" * 5000, "file.yaml: line 2: a number or date that cannot be read"),
        ("a: 2001-13-45", "file.yaml: line 1: a number or date that cannot be read"),
        ("? [a]\n: 1\n", "file.yaml: line 1: a list or section cannot be a name"),
        ("a: [1", "file.yaml: line 1: is not YAML"),
        ("a:\n\tb: 1", "cannot start any token; a tab stands there, where YAML wants blanks"),
        ("a: \0", "file.yaml: is not YAML"),
        ("a: !!python/object:os.system x", "file.yaml: line 1: !!python/object:os.system is not taken"),
        ("a: 1\n---\nb: 2", "file.yaml: line 2: is not YAML"),
        ("x" * (LONGEST_TEXT + 1), "file.yaml: is longer than"),
    ],
)
def test_what_is_not_plain_is_refused_at_once_with_file_and_line(text, sentence):
    with pytest.raises(ConfigError) as refusal:
        parse_yaml(text, "file.yaml")
    assert sentence in str(refusal.value)
    assert len(str(refusal.value)) < 400


ODD = [
    "010",
    "-010",
    "08",
    "09.5",
    "00",
    "1_000",
    "1_0.5",
    "12:30",
    "12:30:15",
    "1:30.5",
    "0b11",
    "0o17",
    "!!int 010",
    "1__0",
]


@pytest.mark.usefixtures("either_parser")
@pytest.mark.parametrize("text", ODD)
def test_a_number_that_readers_of_yaml_read_differently_is_refused_with_what_to_write(text):
    with pytest.raises(
        ConfigError, match=r"^file\.yaml: line 2: .* is read as different numbers .*; write it plainly, as 10"
    ):
        parse_yaml(f"a: 1\nmax_voltage: {text}\n", "file.yaml")
    assert parse_yaml(f"a: '{text}'", "file.yaml") == {"a": text}


@pytest.mark.usefixtures("either_parser")
@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("0", 0),
        ("-7", -7),
        ("10.0", 10.0),
        ("5.", 5.0),
        (".5", 0.5),
        ("+.5e-3", 0.5e-3),
        ("1e3", 1e3),
        ("0x1F", 31),
        ("0.010", 0.01),
        ("yes", True),
        ("off", False),
        ("127.0.0.1:5025", "127.0.0.1:5025"),
        ("10:aa", "10:aa"),
    ],
)
def test_what_a_person_writes_is_read_as_it_is_meant(text, value):
    assert parse_yaml(f"a: {text}", "file.yaml") == {"a": value}


@pytest.mark.usefixtures("either_parser")
@pytest.mark.parametrize("text", ["!!set {a, b}", "!!binary aGk=", "!!omap [a: 1]", "!!pairs [a: 1]", "{<<: {b: 1}}"])
def test_types_of_yamls_own_are_refused(text):
    with pytest.raises(ConfigError, match=r"file\.yaml: line 1: !!\w+ is not taken"):
        parse_yaml(f"a: {text}", "file.yaml")


@pytest.mark.parametrize("value", [{0.1, 0.2}, {0.1: 1.0}, b"12", "12", 12])
def test_only_a_list_is_a_list(make_config, value):
    with pytest.raises(ConfigError, match=r"model\.heating_slope: .* is not a list"):
        Config.from_mapping(make_config(**{"model.heating_slope": value}))


@pytest.mark.parametrize("name", ["a\nb", "a\0", "\x1b[2J", "a\u2028b"])
def test_a_name_is_one_line_that_can_be_printed(make_config, name):
    with pytest.raises(ConfigError, match=r"^joint_name: .* holds what cannot be printed"):
        Config.from_mapping(make_config(joint_name=name))


@pytest.mark.parametrize(
    "file", sorted(shared_file("config/flexinol.yaml").parent.glob("*.yaml")), ids=lambda file: file.stem
)
def test_both_parsers_read_every_shipped_file_alike(monkeypatch, file):
    read = []
    for loader in (yaml_text._LibyamlLoader, yaml_text._PythonLoader):
        monkeypatch.setattr(yaml_text, "_Loader", loader)
        read.append(repr(read_yaml(file, "a file of parameters")))
    assert read[0] == read[1]


def test_numbers_are_put_where_they_stood_whatever_signs_stand_before_them():
    text = "# Ω µ\nnode:\n  ros__parameters:\n    controller: {kp: 1.0, ki: 2.0}  # ±\n    name: ü\n"
    found = yaml_text.with_values(text, "x", ("node", "ros__parameters", "controller"), {"ki": 3.5}, "tuned")
    assert found == text.replace("2.0", "3.5").replace("    controller", "    # tuned\n    controller")


TEXTS = sorted(
    name
    for name, _, declared, kind in walk(Config.load(shared_file("config/flexinol.yaml")))
    if kind == "str" and not declared.choices and not name.endswith(".type")
)


@pytest.mark.parametrize("value", ["\r", "x" * 5000, ["x"]], ids=["a line's end", "long", "list"])
@pytest.mark.parametrize("name", TEXTS)
def test_every_text_of_the_parameters_is_one_line_that_somebody_may_read(make_config, name, value):
    with pytest.raises(ConfigError, match=rf"^{name}: .{{1,300}}$"):
        Config.from_mapping(make_config(**{name: value}))


@pytest.mark.long
def test_a_file_of_the_longest_length_is_read_within_seconds():
    began_s = time.process_time()
    assert len(parse_yaml("".join(f"k{i}: 1\n" for i in range(LONGEST_TEXT // 10)), "x")) == LONGEST_TEXT // 10
    assert time.process_time() - began_s < 30.0


def test_a_huge_file_is_not_read_to_its_end(tmp_path):
    path = tmp_path / "huge.yaml"
    with path.open("wb") as stream:
        stream.truncate(10**10)  # takes no room on the disk
    with pytest.raises(ConfigError, match="is longer than"):
        read_yaml(path, "a YAML file")


@pytest.mark.parametrize("read", [Config.load, read_wire, lambda path: Dialect.load(str(path), "daq")])
def test_every_reader_of_a_file_refuses_what_stands_twice(tmp_path, read):
    path = tmp_path / "twice.yaml"
    path.write_text("kind: daq\n" * 2)
    with pytest.raises(ConfigError, match=r"twice\.yaml: line 2: 'kind' stands here twice"):
        read(path)


def test_the_dialects_that_come_with_it_are_plain():
    for path in FOLDER.glob("*.yaml"):
        assert read_yaml(path, "a dialect")["kind"] in ("supply", "daq")


@pytest.mark.parametrize(
    "value",
    [10**400, -(10**400), math.inf, math.nan, "x" * 10**6, [[1]] * 10**5, 10**30],
    ids=["400 digits", "-400 digits", "inf", "nan", "long text", "long list", "30 digits"],
)
@pytest.mark.parametrize(
    "name", ["loop.overruns_to_fault", "loop.rate", "wire.alloy", "autostart", "model.type", "controller.type"]
)
def test_a_value_beyond_all_measure_is_refused_in_a_short_sentence(make_config, name, value):
    with pytest.raises(ConfigError) as refusal:
        Config.from_mapping(make_config(**{name: value}))
    assert name in str(refusal.value)
    assert len(str(refusal.value)) < 400


def test_of_thousands_of_unknown_parameters_some_are_named_at_once(make_config):
    began_s = time.process_time()
    with pytest.raises(ConfigError) as refusal:
        Config.from_mapping({**make_config(), **{f"unknown{i}": 1 for i in range(20_000)}})
    assert time.process_time() - began_s < 10.0
    assert "unknown0: no such parameter" in str(refusal.value)
    assert "19980 more are unknown" in str(refusal.value)


def test_of_thousands_of_unknown_effects_some_are_named_by_their_beginning(make_config):
    with pytest.raises(ConfigError) as refusal:
        Config.from_mapping(make_config(effects={f"{i}{'x' * 1000}": {} for i in range(1000)}))
    assert "effects: 980 more are unknown" in str(refusal.value)
    assert len(str(refusal.value)) < 20_000


def test_of_thousands_of_sections_that_are_not_ours_the_first_are_named(tmp_path):
    path = tmp_path / "other.yaml"
    path.write_text("\n".join(f"node{i}: 1" for i in range(10_000)))
    with pytest.raises(ConfigError, match=r"found node0, node1, .*… \(10000 in all\)") as refusal:
        Config.load(path)
    assert len(str(refusal.value)) < 500


def test_a_pipe_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "a.yaml")
    with pytest.raises(ConfigError, match=r"a\.yaml: cannot be read \(it is a pipe\); a parameter file is wanted"):
        read_yaml(tmp_path / "a.yaml", "a parameter file")
