"""The tables of a calibration as one word, as parameter files had them before: they load as they did."""

import base64
import json
import textwrap
import zlib

import pytest

from sma_actuator.base.packed import unpacked
from sma_actuator.base.parameters import ConfigError
from sma_actuator.base.share import shared_file
from sma_actuator.base.yaml_text import yaml_of
from sma_actuator.config import Config, write_parameter_file


def packed(section):
    """A section as such a file has it."""
    lists = {name: list(value) for name, value in section.items() if isinstance(value, (list, tuple))}
    word = base64.b64encode(zlib.compress(json.dumps(lists).encode(), 9)).decode()
    kept = {name: value for name, value in section.items() if name not in lists}
    return {**kept, "tables": " ".join(textwrap.wrap(word, 20))}


def test_a_table_that_stands_there_by_its_name_counts_first():
    section = {**packed({"cold_stress": [1e6, 2e6]}), "cold_stress": [3e6]}
    assert unpacked(section, "calibration") == {"cold_stress": [3e6]}


@pytest.mark.parametrize(
    "damage",
    [
        lambda word: word[:-8],
        lambda word: word[:30] + ("A" if word[30] != "A" else "B") + word[31:],
        lambda word: word + "%",
        lambda word: "",
        lambda word: 12,
        lambda word: [word],
        lambda word: base64.b64encode(zlib.compress(b"[" * 100_000)).decode(),
    ],
    ids=["cut", "one letter", "no base64", "empty", "a number", "a list", "nested without end"],
)
def test_a_damaged_word_is_refused_in_a_sentence(make_config, damage):
    mapping = make_config()
    mapping["calibration"] = packed({"error": 1.0, "cold_stress": [1e6, 2e6, 3e6], "cold_resistance": [5.0, 5.1, 5.2]})
    assert Config.from_mapping(mapping).calibration.cold_resistance == (5.0, 5.1, 5.2)
    mapping["calibration"]["tables"] = damage(mapping["calibration"]["tables"])
    with pytest.raises(ConfigError, match=r"wire.yaml: calibration.tables: is damaged; it is written by"):
        Config.from_mapping(mapping, source="wire.yaml")


def test_a_file_of_before_is_the_same_configuration_and_is_written_anew(tmp_path):
    config = Config.load(shared_file("config/flexinol.yaml"))
    mapping = config.to_mapping()
    mapping["calibration"] = packed(mapping["calibration"])
    (tmp_path / "old.yaml").write_text(yaml_of({"sma_actuator": {"ros__parameters": mapping}}))
    assert Config.load(tmp_path / "old.yaml") == config
    write_parameter_file(tmp_path / "new.yaml", Config.load(tmp_path / "old.yaml").to_mapping(), "new")
    assert Config.load(tmp_path / "new.yaml") == config and (tmp_path / "new.tables.npz").exists()
