"""The tables of a calibration as one word in a parameter file."""

import base64
import zlib

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from sma_actuator.base.packed import packed, unpacked
from sma_actuator.base.parameters import ConfigError
from sma_actuator.base.share import shared_file
from sma_actuator.base.yaml_text import parse_yaml, yaml_of
from sma_actuator.config import Config, read_parameter_file, write_parameter_file

NUMBERS = st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=1, max_size=300)
SECTIONS = st.dictionaries(st.sampled_from(["a", "b", "c"]), NUMBERS | st.floats(allow_nan=False, allow_infinity=False))


@given(SECTIONS)
def test_what_is_packed_comes_out_of_a_file_as_it_was_to_the_bit(section):
    text = yaml_of({"calibration": packed(section)})
    assert max(map(len, text.splitlines())) <= 145
    assert unpacked(parse_yaml(text, "a file")["calibration"], "calibration") == section
    assert unpacked(yaml.safe_load(text)["calibration"], "calibration") == section, "as any other reader takes it"


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


def test_a_parameter_file_is_the_same_configuration_in_fewer_lines(tmp_path):
    config = Config.load(shared_file("config/flexinol.yaml"))
    write_parameter_file(tmp_path / "again.yaml", config.to_mapping(), "again")
    assert Config.load(tmp_path / "again.yaml") == config
    assert len((tmp_path / "again.yaml").read_text().splitlines()) < 250
    assert "tables" in read_parameter_file(tmp_path / "again.yaml")["calibration"]
