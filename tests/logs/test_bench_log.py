"""Bench logs: what is written is read again, and what cannot be is refused by name and line."""

import dataclasses
import errno
import os

import numpy as np
import pytest

from sma_actuator.logs.bench_log import BenchLog, read_bench_log, write_bench_log
from sma_actuator.logs.errors import BenchLogError
from sma_actuator.logs.files import write_atomically

HEADER = "time_s,supply_voltage_V,reference_voltage_V,load_cell_voltage_V,lvdt_current_A,current_command_A"


def rows(n=40, separator=",", **replaced):
    """``n`` rows at 20 Hz; ``replaced`` maps column name to a function of the row number."""
    out = []
    for k in range(n):
        values = dict(zip(HEADER.split(","), (k * 0.05, 2.5 + 0.01 * k, 0.3, 0.1, 0.01, 0.3)))
        values.update({name: f(k) for name, f in replaced.items()})
        out.append(separator.join(v if isinstance(v, str) else f"{v:.6g}" for v in values.values()))
    return "\n".join(out) + "\n"


@pytest.fixture
def file(tmp_path):
    def write(content):
        path = tmp_path / "log.csv"
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write


def test_a_written_log_is_read_again_with_its_extra_columns_and_metadata(tmp_path):
    n = 1000
    columns = {name: np.linspace(0.01, 0.02, n) * (i + 1) for i, name in enumerate(HEADER.split(","))}
    columns["time_s"] = np.arange(n) * 0.05
    columns["mine"] = np.arange(n, dtype=float)
    write_bench_log(tmp_path / "a.csv", BenchLog(columns, {"load_N": 0.98}))
    log = read_bench_log(tmp_path / "a.csv")
    assert set(log.columns) == set(columns) and log.metadata == {"load_N": 0.98}
    for name, values in columns.items():
        np.testing.assert_allclose(log[name], values, rtol=1e-8)


def test_reading_in_small_chunks_gives_the_same_numbers(file, monkeypatch):
    path = file(HEADER + "\n" + rows(500))
    whole = read_bench_log(path)
    monkeypatch.setattr("sma_actuator.logs.text.PIECE_B", 997)
    chunked = read_bench_log(path)
    for name in whole.columns:
        np.testing.assert_array_equal(whole[name], chunked[name])


@pytest.mark.parametrize(
    "convert",
    [
        pytest.param(lambda t: t.encode(), id="plain"),
        pytest.param(lambda t: t.replace("\n", "\r\n").encode(), id="windows line ends"),
        pytest.param(lambda t: b"\xef\xbb\xbf" + t.encode(), id="byte order mark"),
        pytest.param(lambda t: t.rstrip("\n").encode(), id="no last line end"),
        pytest.param(lambda t: (t + "\n\n").encode(), id="blank lines at the end"),
        pytest.param(lambda t: t.replace(",", ";").replace(".", ",").encode(), id="semicolons and decimal commas"),
        pytest.param(lambda t: t.replace(",", ";").encode(), id="semicolons and decimal points"),
        pytest.param(lambda t: t.replace(",", "\t").encode(), id="tabs"),
        pytest.param(lambda t: t.replace(",", "\t").replace(".", ",").encode(), id="tabs and decimal commas"),
        pytest.param(lambda t: t.replace(",", "  ").encode(), id="blanks"),
        pytest.param(lambda t: t.encode("utf-16"), id="utf-16"),
        pytest.param(lambda t: ("# made by hand\n\n" + t).encode(), id="a comment above"),
        pytest.param(lambda t: ("# " + t).encode(), id="the header as a comment"),
        pytest.param(
            lambda t: t.replace("\n", ',"text"\n').replace('"text"', "note", 1).encode(), id="a column of text"
        ),
    ],
)
def test_ways_to_write_the_same_numbers(file, convert):
    log = read_bench_log(file(convert(HEADER + "\n" + rows())))
    assert len(log) == 40
    assert log["supply_voltage_V"][39] == 2.89 and log["time_s"][39] == 1.95 and log["current_command_A"][0] == 0.3


def cut(text, n):
    return text[:-n]


@pytest.mark.parametrize(
    "content, names",
    [
        pytest.param("", ["line 1", "empty"], id="empty file"),
        pytest.param(HEADER + "\n", ["line 2", "no readings"], id="header only"),
        pytest.param(rows(), ["line 1", "header row"], id="no header"),
        pytest.param(
            HEADER.replace("supply_voltage_V", "supply_volts_V") + "\n" + rows(),
            ["line 1", "supply_voltage_V", "'supply_volts_V'"],
            id="misnamed column",
        ),
        pytest.param(
            HEADER.replace("supply_voltage_V", "Supply_Voltage_V") + "\n" + rows(),
            ["supply_voltage_V", "'Supply_Voltage_V'"],
            id="column in capitals",
        ),
        pytest.param(
            HEADER.replace("load_cell_voltage_V", "x") + "\n" + rows(),
            ["load_cell_voltage_V or load_N", "--map load_N=0.98"],
            id="missing column",
        ),
        pytest.param(
            HEADER.replace("load_cell_voltage_V", "time_s") + "\n" + rows(), ["time_s", "twice"], id="column twice"
        ),
        pytest.param(
            HEADER + "\n" + rows(current_command_A=lambda k: 300),
            ["line 2", "current_command_A", "300 A", "milliamperes"],
            id="milliampere column",
        ),
        pytest.param(
            HEADER + "\n" + rows(lvdt_current_A=lambda k: 10),
            ["line 2", "lvdt_current_A", "milliamperes"],
            id="lvdt in milliamperes",
        ),
        pytest.param(
            HEADER + "\n" + rows(time_s=lambda k: 50 * k), ["time_s", "milliseconds"], id="time in milliseconds"
        ),
        pytest.param(
            HEADER + "\n" + rows(time_s=lambda k: 0.05 * k if k != 7 else 0.1),
            ["line 9", "time_s", "runs back"],
            id="time runs back",
        ),
        pytest.param(
            HEADER + "\n" + rows(time_s=lambda k: 0.05 * k if k != 7 else 0.3),
            ["line 9", "time_s", "stands still"],
            id="time stands still",
        ),
        pytest.param(HEADER + "\n" + rows(time_s=lambda k: 0.05 * k + (k > 9)), ["line 12", "time_s", "gap"], id="gap"),
        pytest.param(
            HEADER + "\n" + rows(load_cell_voltage_V=lambda k: "nan" if k == 5 else 0.1),
            ["line 7", "load_cell_voltage_V", "finite"],
            id="NaN",
        ),
        pytest.param(
            HEADER + "\n" + rows(load_cell_voltage_V=lambda k: "" if k == 5 else 0.1),
            ["line 7", "load_cell_voltage_V", "finite"],
            id="blank field",
        ),
        pytest.param(
            HEADER + "\n" + rows(time_s=lambda k: "inf" if k == 5 else 0.05 * k),
            ["line 7", "time_s", "finite"],
            id="infinite time",
        ),
        pytest.param(
            HEADER + "\n" + rows(load_cell_voltage_V=lambda k: "oops" if k == 5 else 0.1),
            ["line 7", "load_cell_voltage_V", "'oops'"],
            id="text",
        ),
        pytest.param(HEADER + "\n" + cut(rows(), 12), ["line 41", "4 fields", "cut off"], id="half a line"),
        pytest.param(
            HEADER + "\n" + rows().replace(".", ","), ["line 2", "semicolon"], id="decimal commas between commas"
        ),
    ],
)
def test_a_bad_log_is_refused_in_a_sentence_that_names_the_place(file, content, names):
    path = file(content)
    with pytest.raises(BenchLogError) as caught:
        read_bench_log(path)
    for name in [str(path), *names]:
        assert name in str(caught.value)


def test_gaps_and_missing_readings_are_accepted_on_request(file):
    path = file(
        HEADER
        + "\n"
        + rows(time_s=lambda k: 0.05 * k + (k > 9), load_cell_voltage_V=lambda k: "nan" if k == 5 else 0.1)
    )
    log = read_bench_log(path, allow_gaps=True)
    assert np.isnan(log["load_cell_voltage_V"][5]) and len(log) == 40


def test_a_column_without_any_number_counts_as_absent(file):
    log = read_bench_log(file(HEADER + "\n" + rows(lvdt_current_A=lambda k: "nan")))
    assert "lvdt_current_A" not in log and not log.has_reference


def test_an_interrupted_write_leaves_the_old_file_and_no_other(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("old")

    def fail(stream):
        stream.write(b"half")
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_atomically(path, fail)
    assert path.read_text() == "old" and list(tmp_path.iterdir()) == [path]


def test_a_disk_that_is_full_is_said_of_the_file_that_was_wanted(tmp_path):
    def fail(stream):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with pytest.raises(OSError, match="No space left on device: '.*a.csv'"):
        write_atomically(tmp_path / "a.csv", fail)


def test_the_source_stays_with_a_slice(file):
    log = read_bench_log(file(HEADER + "\n" + rows())).slice(5, 15)
    assert len(log) == 10 and log.name == "log.csv" and dataclasses.is_dataclass(log)
