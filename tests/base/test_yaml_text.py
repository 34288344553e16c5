"""YAML that means something else than a person reads in it, or costs more than its size, is refused with its line."""

import math
import time

import pytest

from sma_actuator.base.parameters import ConfigError
from sma_actuator.base.yaml_text import DEEPEST_LEVEL, LONGEST_TEXT, parse_yaml, read_yaml
from sma_actuator.config import Config
from sma_actuator.diagnosis.forward.wire import read_wire
from sma_actuator.instruments.dialect import FOLDER, Dialect

_BOMB = "a0: &a0 [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]\n" for i in range(1, 12)
)


def test_numbers_are_read_as_ros_reads_them():
    assert parse_yaml("[175.0e6, 1e-6, 250, 0.1, .inf]", "x") == [175e6, 1e-6, 250, 0.1, math.inf]


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("a: 1\nb:\n  c: 1\n  c: 2\n", "file.yaml: line 4: 'c' stands here twice, first in line 3"),
        ("a: 1\n'a': 2\n", "file.yaml: line 2: 'a' stands here twice, first in line 1"),
        (_BOMB, "file.yaml: line 2: an alias"),
        ("a: &a [*a]", "file.yaml: line 1: an alias"),
        ("[" * 100_000, f"file.yaml: line 1: nested more than {DEEPEST_LEVEL} levels deep"),
        ("{a: " * 300, "levels deep"),
        ("\na: " + "9" * 5000, "file.yaml: line 2: a number or date that cannot be read"),
        ("a: 2001-13-45", "file.yaml: line 1: a number or date that cannot be read"),
        ("? [a]\n: 1\n", "file.yaml: line 1: a list or section cannot be a name"),
        ("a: [1", "file.yaml: line 1: is not YAML"),
        ("a: \0", "file.yaml: is not YAML"),
        ("a: !!python/object:os.system x", "file.yaml: line 1: is not YAML"),
        ("a: 1\n---\nb: 2", "file.yaml: line 2: is not YAML"),
        ("x" * (LONGEST_TEXT + 1), "file.yaml: is longer than"),
    ],
)
def test_what_is_not_plain_is_refused_at_once_with_file_and_line(text, sentence):
    with pytest.raises(ConfigError) as refusal:
        parse_yaml(text, "file.yaml")
    assert sentence in str(refusal.value)
    assert len(str(refusal.value)) < 400


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
