"""The section ``calibration`` of files from before 0.2, side by side or as one word: they load as they did."""

import base64
import json
import textwrap
import zlib

import pytest

from sma_actuator.base.calibration import in_sections
from sma_actuator.base.packed import unpacked
from sma_actuator.base.parameter_file import parameters_in
from sma_actuator.base.parameters import ConfigError
from sma_actuator.base.share import shared_file
from sma_actuator.base.yaml_text import yaml_of
from sma_actuator.config import Config, write_parameter_file


def side_by_side(section):
    """A section with the fields of all that are below it, as such a file has it."""
    inside = [side_by_side(value) if isinstance(value, dict) else {name: value} for name, value in section.items()]
    return {name: value for fields in inside for name, value in fields.items()}


def packed(section):
    """A section whose lists are one word."""
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
    assert Config.from_mapping(mapping).calibration.rest.cold_resistance == (5.0, 5.1, 5.2)
    mapping["calibration"]["tables"] = damage(mapping["calibration"]["tables"])
    with pytest.raises(ConfigError, match=r"wire.yaml: calibration.tables: is damaged; it is written by"):
        Config.from_mapping(mapping, source="wire.yaml")


@pytest.mark.parametrize("of_before", [side_by_side, lambda section: packed(side_by_side(section))])
def test_a_file_of_before_is_the_same_configuration_and_is_written_anew(tmp_path, of_before):
    config = Config.load(shared_file("config/flexinol.yaml"))
    mapping = config.to_mapping()
    mapping["calibration"] = of_before(mapping["calibration"])
    assert "rest" not in mapping["calibration"]
    (tmp_path / "old.yaml").write_text(yaml_of({"sma_actuator": {"ros__parameters": mapping}}))
    assert Config.load(tmp_path / "old.yaml") == config
    write_parameter_file(tmp_path / "new.yaml", Config.load(tmp_path / "old.yaml").to_mapping(), "new")
    assert Config.load(tmp_path / "new.yaml") == config and (tmp_path / "new.tables.npz").exists()
    written = parameters_in(tmp_path / "new.yaml")["calibration"]
    assert "cold_stress" not in written and list(written["rest"])[:2] == ["cold_stress", "cold_resistance"]


def test_what_stands_in_its_section_counts_before_what_stands_beside_it(make_config):
    calibration = {"rest": {"hot_power": 0.5}, "hot_power": 0.4, "latent_rise": 20.0, "training": "none"}
    assert in_sections(calibration) == {"rest": {"hot_power": 0.5}, "power": {"latent_rise": 20.0}, "training": "none"}
    with pytest.raises(ConfigError, match=r"calibration.training: 'none' is not a section of parameters"):
        Config.from_mapping(make_config(calibration={**calibration, "changed": 0.1}))
