"""Files that others have put in the place of one that is wanted: none is waited for, none read to no end."""

import os

import pytest

from sma_actuator.base import content
from sma_actuator.base.content import content_of, json_of
from sma_actuator.base.parameters import ConfigError
from sma_actuator.base.sidecar import put_back
from sma_actuator.characterise.manifest import FILE_NAME, Manifest
from sma_actuator.logs.bench_log import read_metadata
from sma_actuator.logs.errors import BenchLogError


def test_a_file_is_read_and_no_further_than_one_byte_too_far(tmp_path):
    path = tmp_path / "a"
    path.write_bytes(b"0123456789")
    assert content_of(path, 10) == b"0123456789"
    assert content_of(path, 5) == b"012345"


def test_json_that_is_none_is_said(tmp_path):
    path = tmp_path / "a.json"
    path.write_text('{"a": [1, null]}')
    assert json_of(path) == {"a": [1, None]}
    path.write_text("[" * 100_000)
    with pytest.raises(ValueError, match="nested too deeply"):
        json_of(path)
    path.write_text("1, 2")
    with pytest.raises(ValueError, match="Extra data"):
        json_of(path)


def test_json_as_long_as_none_is_not_read(tmp_path, monkeypatch):
    monkeypatch.setattr(content, "LONGEST_JSON_B", 5)
    (tmp_path / "a.json").write_text("[123]")
    assert json_of(tmp_path / "a.json") == [123]
    (tmp_path / "a.json").write_text("[1234]")
    with pytest.raises(ValueError, match="longer than 5 bytes"):
        json_of(tmp_path / "a.json")


def _nested(path):
    path.write_text("[" * 100_000)


@pytest.mark.parametrize("put", [os.mkfifo, os.mkdir, _nested], ids=lambda put: put.__name__)
def test_whoever_reads_such_a_file_names_it_in_a_sentence(tmp_path, put):
    """A pipe was awaited, for ever; a folder and deep nesting ended in a traceback."""
    put(tmp_path / "log.json")
    with pytest.raises(BenchLogError, match=r"log\.json: is not JSON \(.+\); it describes log\.csv"):
        read_metadata(tmp_path / "log.csv")
    put(tmp_path / FILE_NAME)
    with pytest.raises(ConfigError, match=r"manifest\.json: is not a manifest of a characterisation \(.+\)"):
        Manifest(tmp_path, {})
    put(tmp_path / "wire.npz")
    with pytest.raises(ConfigError, match=r"wire\.npz,? .*; take both files from the same place"):
        put_back({"tables": {"file": "wire.npz", "sha256": "0"}}, tmp_path / "wire.yaml")
