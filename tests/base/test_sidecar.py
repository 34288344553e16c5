"""The long tables of a parameter file lie beside it; both are one model, and come apart in a sentence."""

import hashlib
import io
import shutil
import zipfile

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from sma_actuator.base import sidecar
from sma_actuator.base.parameter_file import parameters_in
from sma_actuator.base.parameters import ConfigError
from sma_actuator.base.share import shared_file
from sma_actuator.config import Config, copy_tables, read_parameter_file, write_parameter_file
from sma_actuator.ros.arguments import parse

NUMBERS = st.lists(st.floats(allow_nan=False, allow_infinity=False), max_size=60)
SECTIONS = st.dictionaries(st.sampled_from(["a", "b", "c"]), NUMBERS | st.floats(allow_nan=False, allow_infinity=False))
MODELS = st.fixed_dictionaries({"calibration": SECTIONS, "model": SECTIONS, "thermal": SECTIONS})


@pytest.fixture
def shipped(tmp_path):
    """A copy of a shipped model, both files."""
    for name in ("flexinol.yaml", "flexinol.tables.npz"):
        shutil.copy(shared_file(f"config/{name}"), tmp_path)
    return tmp_path / "flexinol.yaml"


@given(mapping=MODELS)
def test_what_is_written_is_read_to_the_bit(tmp_path_factory, mapping):
    path = tmp_path_factory.mktemp("written") / "wire.yaml"
    write_parameter_file(path, mapping, "a wire")
    assert read_parameter_file(path) == mapping
    stays = parameters_in(path)
    long = {f"{s}.{n}": v for s in sidecar.MAY_MOVE for n, v in mapping[s].items() if sidecar._long(v)}
    assert stays["thermal"] == mapping["thermal"] and ("tables" in stays) is bool(long)
    if long:
        with np.load(path.with_name("wire.tables.npz"), allow_pickle=False) as archive:
            assert {name: archive[name].tolist() for name in archive} == long, "as anybody reads it"


def test_the_same_numbers_make_the_same_file(tmp_path):
    config = Config.load(shared_file("config/flexinol.yaml"))
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        write_parameter_file(tmp_path / name / "wire.yaml", config.to_mapping(), "again")
    assert Config.load(tmp_path / "one" / "wire.yaml") == config
    one, two = (
        {path.name: path.read_bytes() for path in sorted((tmp_path / name).iterdir())} for name in ("one", "two")
    )
    assert one == two and list(one) == ["wire.tables.npz", "wire.yaml"]


def test_a_person_reads_what_is_left(shipped):
    lengths = []

    def measure(value):
        if isinstance(value, list):
            lengths.append(len(value))
        for inside in value.values() if isinstance(value, dict) else ():
            measure(inside)

    measure(parameters_in(shipped))
    assert 7 <= max(lengths) <= sidecar.MOST_READ
    assert max(map(len, shipped.read_text().splitlines())) <= 130


def test_the_node_reads_both_files(shipped):
    values = parse(["--ros-args", "--params-file", str(shipped)]).parameters_of("/sma_actuator")
    assert Config.from_mapping(values) == Config.load(shipped)


def test_a_table_that_stands_in_the_file_by_its_name_counts_first(shipped):
    document = yaml.safe_load(shipped.read_text())
    document["sma_actuator"]["ros__parameters"]["calibration"]["expectation"]["expected_weights"] = [1.0] * 254
    shipped.write_text(yaml.safe_dump(document))
    assert Config.load(shipped).calibration.expectation.expected_weights == (1.0,) * 254


def test_a_file_without_its_tables_says_so_and_what_to_do(shipped):
    beside = shipped.with_name("flexinol.tables.npz")
    beside.unlink()
    with pytest.raises(ConfigError, match=rf"{shipped}: its tables, {beside}, is not there; take both files from"):
        Config.load(shipped)
    assert parameters_in(shipped)["supply"], "what switches a supply off reads no tables"


def test_the_tables_of_another_model_are_refused(shipped):
    shutil.copy(shared_file("config/furukawa.tables.npz"), shipped.with_name("flexinol.tables.npz"))
    with pytest.raises(ConfigError, match=r"flexinol.tables.npz is not the file that was written with it"):
        Config.load(shipped)


@pytest.mark.parametrize("name", ["../flexinol.tables.npz", "/etc/passwd", "", "..", 3, None])
def test_only_a_file_beside_it_is_read(shipped, name):
    document = yaml.safe_load(shipped.read_text())
    document["sma_actuator"]["ros__parameters"]["tables"]["file"] = name
    shipped.write_text(yaml.safe_dump(document))
    with pytest.raises(ConfigError, match=r"tables.file: the name of a file beside it is wanted"):
        Config.load(shipped)


def archive_of(name, array, allow_pickle=False, **changes):
    stream, content = io.BytesIO(), io.BytesIO()
    np.lib.format.write_array(content, array, allow_pickle=allow_pickle)
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as entries:
        entries.writestr(name, changes.get("content", content.getvalue()))
    return stream.getvalue()


HUGE = b"\x93NUMPY\x01\x00v\x00{'descr': '<f8', 'fortran_order': False, 'shape': (9999999999999,), }".ljust(127) + b"\n"


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (
            archive_of("calibration.expectation.expected_weights.npy", np.array([{}], dtype=object), True),
            "no row of numbers",
        ),
        (archive_of("calibration.expectation.expected_weights.npy", np.zeros((2, 2))), "no row of numbers"),
        (archive_of("calibration.expectation.expected_weights.npy", np.zeros(300_000)), "more than 2 MB"),
        (archive_of("calibration.expectation.expected_weights.npy", np.zeros(1), content=HUGE), "no row of numbers"),
        (archive_of("supply.max_current.npy", np.array([9.0])), "is none of the tables of calibration and model"),
        (archive_of("supply.npy", np.array([9.0])), "is none of the tables of calibration and model"),
        (b"PK" + bytes(100), "is no file of tables"),
        (bytes(2_000_001), "is no file of tables"),
    ],
    ids=[
        "a pickle",
        "a matrix",
        "unpacks to much",
        "says it is huge",
        "another section",
        "no section",
        "broken",
        "big",
    ],
)
def test_what_is_no_row_of_numbers_is_refused_whatever_its_sum(shipped, content, said):
    beside = shipped.with_name("flexinol.tables.npz")
    beside.write_bytes(content)
    text = shipped.read_text()
    before = text.partition("sha256: ")[2].split()[0]
    shipped.write_text(text.replace(before, hashlib.sha256(content[: sidecar.MOST_BYTES + 1]).hexdigest()))
    with pytest.raises(ConfigError, match=said):
        Config.load(shipped)


def test_a_text_that_is_written_elsewhere_takes_its_tables_along(shipped, tmp_path):
    out = tmp_path / "tuned" / "again.yaml"
    out.parent.mkdir()
    out.write_text(shipped.read_text())
    copy_tables(shipped, out)
    assert Config.load(out) == Config.load(shipped)
    copy_tables(shipped, shipped)


def test_a_mapping_whose_tables_were_not_read_is_refused():
    with pytest.raises(ConfigError, match=r"wire.yaml: tables: the file that it names was not read"):
        Config.from_mapping(parameters_in(shared_file("config/flexinol.yaml")), source="wire.yaml")
