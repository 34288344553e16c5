"""Files of a few bytes that stand for gigabytes are refused before they are unpacked, whatever their format."""

import contextlib
import io
import json
import os
import re
import resource
import shutil
import sqlite3
import struct
import tracemalloc
import zipfile
from pathlib import Path

import numpy as np
import pytest

from sma_actuator.cli.main import main
from sma_actuator.logs import unpacking
from sma_actuator.logs.bags import log_from_bag
from sma_actuator.logs.bench_log import check_bench_log, read_bench_log
from sma_actuator.logs.errors import BenchLogError
from sma_actuator.logs.formats import read_table

NUMBERS = 5_000_000  #: that each of them claims: 40 MB
BOUND_B = 4_000_000


def hdf5(path, names=("time_s", "resistance_Ohm"), shape=(NUMBERS,), chunks=(1000,)):
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        for name in names:
            file.create_dataset(name, shape, "f8", maxshape=(None,), chunks=chunks, compression="gzip")


def hdf5_chunk(path):
    hdf5(path, shape=(10,), chunks=(NUMBERS,))


def matlab(path):
    scipy_io = pytest.importorskip("scipy.io")
    scipy_io.savemat(path, {"time_s": np.zeros(NUMBERS)}, do_compression=True)


def parquet(path):
    pyarrow = pytest.importorskip("pyarrow")
    writer = pytest.importorskip("pyarrow.parquet")
    writer.write_table(pyarrow.table({"time_s": np.zeros(NUMBERS)}), path)


def tdms(path):
    nptdms = pytest.importorskip("nptdms")
    with nptdms.TdmsWriter(path) as file:
        file.write_segment([nptdms.ChannelObject("run", "time_s", np.zeros(NUMBERS))])


def excel(path, rows):
    openpyxl = pytest.importorskip("openpyxl")
    plain = path.with_name("plain.xlsx")
    book = openpyxl.Workbook()
    book.active.append(["time_s", "resistance_Ohm"])
    book.save(plain)
    with zipfile.ZipFile(plain) as old, zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as new:
        for each in old.infolist():
            text = old.read(each)
            if each.filename.startswith("xl/worksheets/"):
                text = re.sub(rb"<dimension[^>]*/>", b"", text).replace(b"</sheetData>", rows + b"</sheetData>")
            new.writestr(each, text)


def excel_far_cells(path):
    excel(
        path, b"".join(b'<row r="%d"><c r="XFD%d"><v>1</v></c></row>' % (k, k) for k in range(2, 2 + NUMBERS // 16384))
    )


def excel_far_row(path):
    excel(path, b'<row r="1048576"><c r="A1048576"><v>1</v></c></row>')


def excel_blanks(path):
    excel(path, b" " * NUMBERS)


def blank_lines(path):
    path.write_text(",".join(f"c{k}" for k in range(1000)) + "\n" * (NUMBERS // 1000))


def wide_text(path):
    path.write_bytes("time_s\n".encode("utf-16") + b"1\0\n\0" * (BOUND_B // 8))


BOMBS = [
    (hdf5, ".h5"), (hdf5_chunk, ".h5"), (matlab, ".mat"), (parquet, ".parquet"), (tdms, ".tdms"),
    (excel_far_cells, ".xlsx"), (excel_far_row, ".xlsx"), (excel_blanks, ".xlsx"),
    (blank_lines, ".csv"), (wide_text, ".csv"),
]  # fmt: skip


@pytest.mark.parametrize(("write", "ending"), BOMBS, ids=[write.__name__ for write, _ in BOMBS])
def test_what_takes_more_memory_than_a_log_may_is_refused_before_it_is_unpacked(tmp_path, monkeypatch, write, ending):
    path = tmp_path / f"bomb{ending}"
    write(path)
    monkeypatch.setattr(unpacking, "LARGEST_B", BOUND_B)
    tracemalloc.start()
    try:
        with pytest.raises(
            BenchLogError, match=r"bomb\.\w+: takes more than 0\.004 GB where it is unpacked; cut the log"
        ):
            read_table(path)
        # half of what it would take, with what a library imports
        assert tracemalloc.get_traced_memory()[1] < 4 * NUMBERS
    finally:
        tracemalloc.stop()


def wide_styles(path):
    plain = path.with_name("styled.xlsx")
    excel(plain, b"")
    with zipfile.ZipFile(plain) as old, zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as new:
        for each in old.infolist():
            text = old.read(each)
            if each.filename == "xl/styles.xml":
                text = re.sub(rb"(<cellXfs[^>]*>)", rb"\1" + b"<xf/>" * 2_000_000, text)
            new.writestr(each, text)


def test_styles_of_a_workbook_are_counted_as_the_objects_that_they_become(tmp_path):
    """Not packed at all, 10 MB of them, and 1.3 GB as openpyxl reads them."""
    wide_styles(tmp_path / "a.xlsx")
    with pytest.raises(BenchLogError, match=r"a\.xlsx: takes more than 1 GB"):
        read_table(tmp_path / "a.xlsx")


@pytest.mark.parametrize("inside", [b"<a>" * 300_000 + b"</a>" * 300_000, b"<c/>" * 500_000], ids=["deep", "wide"])
@pytest.mark.parametrize(
    "after", [b"", b'<x:row r="9"><x:c r="A9"><x:v>1</x:v></x:c></x:row>'], ids=["last", "between"]
)
def test_what_a_sheet_has_between_its_rows_is_counted_as_the_objects_that_it_becomes(tmp_path, inside, after):
    """39 kB of a book were 35 MB of elements in elements, and took 1.5 GB."""
    rows = b"".join(b'<row r="%d"><c r="A%d"><v>1</v></c></row>' % (k, k) for k in range(2, 9))
    excel(tmp_path / "a.xlsx", rows + inside + after)
    with pytest.raises(BenchLogError, match=r"a\.xlsx: \d+ bytes that stand for 3\d\d MB; no log packs so well"):
        read_table(tmp_path / "a.xlsx")


@pytest.mark.parametrize("piece_B", [1, 7, 100, 10_000])
def test_the_longest_row_of_a_sheet_is_found_wherever_it_is_cut_into_pieces(monkeypatch, piece_B):
    monkeypatch.setattr(unpacking, "PIECE_B", piece_B)
    rows = [
        b"<sheetData>",
        *(b'<x:row r="%d">' % k + b"<c/>" * k + b"</x:row>" for k in range(20)),
        b"<row/>",
        b"<row>",
    ]
    for after in (b"", b"<a/>" * 100):
        longest_B = max(len(after) + 5, len(rows[20]))
        assert unpacking._longest_row_B(io.BytesIO(b"".join(rows) + after)) == longest_B


def renamed_texts(path, name):
    """A book whose texts stand in a part of another name, as the book says."""
    from openpyxl.xml.constants import SHARED_STRINGS

    plain = path.with_name("texts.xlsx")
    excel(plain, b"")
    said = f'<Override PartName="/{name}" ContentType="{SHARED_STRINGS}"/></Types>'.encode()
    with zipfile.ZipFile(plain) as old, zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as new:
        for each in old.infolist():
            new.writestr(each, old.read(each).replace(b"</Types>", said))
        new.writestr(name, b"<sst>" + b"<si><t>a</t></si>" * 1_000_000 + b"</sst>")


@pytest.mark.parametrize("name", ["xl/strings.bin", "xl/media/picture.png", "xl/worksheets/strings.xml"])
def test_texts_of_a_workbook_are_counted_whatever_their_part_is_called(tmp_path, name):
    """826 kB of them in a part called strings.bin were 340 MB of XML, and were read for minutes."""
    pytest.importorskip("openpyxl")
    renamed_texts(tmp_path / "a.xlsx", name)
    with pytest.raises(BenchLogError, match=r"a\.xlsx: \d+ bytes that stand for 3\d\d MB"):
        read_table(tmp_path / "a.xlsx")


@pytest.mark.parametrize("name", ["xl/media/picture.png", "xl/vbaProject.bin"])
def test_pictures_and_macros_of_a_workbook_are_none_of_its_log(tmp_path, name):
    excel(tmp_path / "book.xlsx", b'<row r="2"><c r="A2"><v>1</v></c><c r="B2"><v>2</v></c></row>')
    shutil.copy(tmp_path / "book.xlsx", tmp_path / "a.xlsx")
    with zipfile.ZipFile(tmp_path / "a.xlsx", "a") as book:
        book.writestr(name, os.urandom(2_000_000))
    assert list(read_table(tmp_path / "a.xlsx").columns) == ["time_s", "resistance_Ohm"]


#: The others have files as long as what they stand for.
SMALL = [each for each in BOMBS if each[0] not in (tdms, wide_text)]


@pytest.mark.parametrize(("write", "ending"), SMALL, ids=[write.__name__ for write, _ in SMALL])
def test_a_few_bytes_do_not_stand_for_a_large_log(tmp_path, monkeypatch, write, ending):
    """Below what a log may take, and yet hundreds of times what the file has."""
    path = tmp_path / f"bomb{ending}"
    write(path)
    monkeypatch.setattr(unpacking, "SMALL_B", BOUND_B)
    with pytest.raises(BenchLogError, match=r"bomb\.\w+: \d+ bytes that stand for \d+ MB; no log packs so well"):
        read_table(path)


def test_measured_numbers_that_are_packed_are_read(tmp_path, monkeypatch):
    """Those of a converter of 12 bits, beside a column that stands still, as well as gzip packs them."""
    h5py = pytest.importorskip("h5py")
    noise = np.random.default_rng(1).normal(size=100_000)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for name, values in {
            "time_s": np.arange(1e5),
            "R": np.round(4000 + noise) / 1000,
            "I": np.full(100_000, 0.05),
        }.items():
            file.create_dataset(name, data=values, chunks=(1000,), compression="gzip", shuffle=True, compression_opts=9)
    monkeypatch.setattr(unpacking, "SMALL_B", 0)
    times = 2_400_000 / (tmp_path / "a.h5").stat().st_size
    assert list(read_table(tmp_path / "a.h5").columns) == ["I", "R", "time_s"] and times > 4.0


def test_a_line_without_an_end_is_refused_and_not_kept(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("time_s,R\n1,2\n")
    with path.open("r+b") as file:
        file.truncate(200_000_000)  # zeros that take no room on the disk
    tracemalloc.start()
    try:
        with pytest.raises(BenchLogError, match=r"a\.csv: has a line of more than 1 MB"):
            read_table(path)
        assert tracemalloc.get_traced_memory()[1] < 60_000_000
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("place", ["pipe", "device"])
def test_what_is_no_file_is_not_waited_for(tmp_path, place):
    path = tmp_path / "a.csv" if place == "pipe" else Path("/dev/zero")
    if place == "pipe":
        os.mkfifo(path)
    with pytest.raises(BenchLogError, match="is no file; a log"):
        read_table(path)


def test_names_and_words_of_a_file_do_not_command_the_terminal(tmp_path, capsys):
    path = tmp_path / "a.csv"
    rows = "".join(f"{k},2,[/x]\x1b[2J\n" for k in range(20))
    path.write_text("time_s,\x1b]0;mine\x07,[/bold]\x1b[31m\n" + rows, newline="")
    table = read_table(path)
    assert list(table.columns) == ["time_s", r"\x1b]0;mine\x07"]
    assert table.notes == (r"column '[/bold]\x1b[31m' holds text and is left out",)
    assert main(["check-log", str(path)]) == 1
    said = "".join(capsys.readouterr())
    assert r"\x1b]0;mine\x07" in said and "\x1b" not in said


def test_a_file_of_thousands_of_columns_has_twenty_of_them_named(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(",".join(f"c{k}" + 99 * "c" for k in range(1000)) + "\n" + ",".join(1000 * "1") + "\n")
    with pytest.raises(BenchLogError, match=r"found c0c+… \(101 characters\), c1c.* and 980 more") as refused:
        check_bench_log(read_bench_log(path))
    assert len(str(refused.value)) < 3000


def test_matlabs_structures_are_read_as_ever(tmp_path):
    scipy_io = pytest.importorskip("scipy.io")
    columns = {"time_s": np.arange(20.0), "R": np.arange(20.0) + 1.0}
    for packed in (False, True):
        scipy_io.savemat(
            tmp_path / "a.mat", {"log": {"inside": columns, "who": "x" * 3, "n": 1}}, do_compression=packed
        )
        assert list(read_table(tmp_path / "a.mat").columns) == ["time_s", "R"]


@pytest.mark.parametrize(("place", "value"), [(8, b"\xf8\xff\0\0"), (4, b"\xff\xff\xff\0"), (12, b"\xff\xff\xff\x0f")])
def test_an_element_that_scipy_would_break_on_is_refused(tmp_path, place, value):
    """With a bus error, where its kind is none that there is."""
    scipy_io = pytest.importorskip("scipy.io")
    path = tmp_path / "a.mat"
    scipy_io.savemat(path, {"time_s": np.arange(20.0)})
    data = bytearray(path.read_bytes())
    data[128 + place : 128 + place + 4] = value
    path.write_bytes(data)
    with pytest.raises(BenchLogError, match=r"a\.mat: is no readable \.mat file \(an element of kind"):
        read_table(path)


def test_a_chunk_of_a_recording_that_claims_to_be_huge_is_not_unpacked(tmp_path):
    pytest.importorskip("rosbags")
    path = tmp_path / "bomb.mcap"
    chunk = struct.pack("<QQQ", 0, 1, 10**12) + bytes(16)
    path.write_bytes(b"\x89MCAP0\r\n" + struct.pack("<BQ", 1, 8) + bytes(8) + struct.pack("<BQ", 6, len(chunk)) + chunk)
    with pytest.raises(BenchLogError, match=r"bomb\.mcap: takes more than 1 GB"):
        log_from_bag(path, {})


_TOPICS = """
CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT, offered_qos_profiles TEXT);
INSERT INTO topics VALUES (1, '/a/signals', 'sensor_msgs/msg/JointState', 'cdr', '');
CREATE TABLE schema(schema_version INTEGER, ros_distro TEXT);
INSERT INTO schema VALUES (3, 'jazzy');
"""


def recording(folder, messages, packed=""):
    """A recording of one topic in SQLite; ``messages``: statements that make the table of its messages and fill it."""
    pytest.importorskip("rosbags")
    folder.mkdir()
    with contextlib.closing(sqlite3.connect(folder / "x_0.db3")) as database:
        database.executescript(_TOPICS + messages)
    name = "x_0.db3.zstd" if packed == "file" else "x_0.db3"
    topic = {"name": "/a/signals", "type": "sensor_msgs/msg/JointState", "serialization_format": "cdr"}
    counted = [{"topic_metadata": {**topic, "offered_qos_profiles": ""}, "message_count": 1}]
    said = {
        "version": 5, "storage_identifier": "sqlite3", "relative_file_paths": [name], "duration": {"nanoseconds": 1},
        "starting_time": {"nanoseconds_since_epoch": 0}, "message_count": 1, "topics_with_message_count": counted,
        "compression_format": "zstd" if packed else "", "compression_mode": packed,
    }  # fmt: skip
    (folder / "metadata.yaml").write_text(json.dumps({"rosbag2_bagfile_information": said}))
    return folder


_MESSAGES = "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB{});"


def test_messages_that_a_recording_computes_are_not_read(tmp_path):
    """4 kB of them took 10 GB, and minutes."""
    computed = _MESSAGES.format(" AS (zeroblob(900000000))") + "INSERT INTO messages VALUES (1, 1, 1);"
    with pytest.raises(BenchLogError, match=r"x_0\.db3: column 'data' of its table 'messages' is computed"):
        log_from_bag(recording(tmp_path / "bag", computed), {})


@pytest.mark.parametrize("packed", ["message", "file"])
def test_what_a_recording_does_not_say_of_its_size_is_bounded(tmp_path, monkeypatch, packed):
    """183 kB took 7 GB of memory, or as much of the disk."""
    pytest.importorskip("rosbags")
    from rosbags.rosbag2.reader import zstd

    limits = resource.getrlimit(resource.RLIMIT_AS), resource.getrlimit(resource.RLIMIT_FSIZE)
    monkeypatch.setattr(unpacking, "UNPACKING_B", 100_000_000)
    bomb = zstd.compress(bytes(300_000_000))
    folder = recording(
        tmp_path / "bag", f"{_MESSAGES.format('')} INSERT INTO messages VALUES (1, 1, 1, x'{bomb.hex()}');", packed
    )
    (folder / "x_0.db3.zstd").write_bytes(bomb)
    with pytest.raises(BenchLogError, match=r"bag: takes more than 0\.1 GB where it is unpacked; cut the log"):
        log_from_bag(folder, {})
    assert (resource.getrlimit(resource.RLIMIT_AS), resource.getrlimit(resource.RLIMIT_FSIZE)) == limits


def test_a_pipe_in_the_place_of_a_recording_is_not_waited_for(tmp_path):
    pytest.importorskip("rosbags")
    os.mkfifo(tmp_path / "a.mcap")
    with pytest.raises(BenchLogError, match=r"a\.mcap: is no file; a recording is wanted"):
        log_from_bag(tmp_path / "a.mcap", {})


def test_words_in_every_row_of_a_parquet_file_are_stored_once_and_not_multiplied(tmp_path):
    pyarrow = pytest.importorskip("pyarrow")
    writer = pytest.importorskip("pyarrow.parquet")
    long = "x" * 20_000
    columns = {"time_s": np.arange(1000.0), "event": [None, *[long] * 999], "note": [long] * 1000}
    writer.write_table(pyarrow.table(columns), tmp_path / "a.parquet")
    tracemalloc.start()
    try:
        table = read_table(tmp_path / "a.parquet")
        assert tracemalloc.get_traced_memory()[1] < 5_000_000  # not the 20 MB of all words
    finally:
        tracemalloc.stop()
    assert list(table.columns) == ["time_s"]
    assert len(table.texts) == 999 and table.texts[1] == long
    assert table.notes == ("column 'note' holds text and is left out",)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("time_s,current_A\r1,2\r", "carriage returns that end no line"),
        ("time_s,current_A\n1,2\r3,4\n", "carriage returns that end no line"),
        ('time_s,note\n1,"' + "x" * 200_000, "a quotation mark that is never closed"),
    ],
)
def test_text_that_is_no_table_is_refused_in_our_own_words(tmp_path, text, words):
    (tmp_path / "a.csv").write_text(text, newline="")
    with pytest.raises(BenchLogError, match=words):
        read_table(tmp_path / "a.csv")


@pytest.mark.parametrize("how", ["stored outside", "put together", "linked"])
def test_what_an_hdf5_file_takes_from_other_files_is_not_read(tmp_path, how):
    """Whoever sends a log would choose what of this computer is read as numbers."""
    h5py = pytest.importorskip("h5py")
    (tmp_path / "secret.bin").write_bytes(np.arange(20.0).tobytes())
    with h5py.File(tmp_path / "other.h5", "w") as other:
        other["R"] = np.arange(20.0)
    path = tmp_path / "log.h5"
    with h5py.File(path, "w") as file:
        file["time_s"] = np.arange(20.0)
        if how == "stored outside":
            file.create_dataset("R", (20,), "f8", external=[(str(tmp_path / "secret.bin"), 0, 160)])
        elif how == "put together":
            layout = h5py.VirtualLayout((20,), "f8")
            layout[:] = h5py.VirtualSource(str(tmp_path / "other.h5"), "R", (20,))
            file.create_virtual_dataset("R", layout)
        else:
            file["R"] = h5py.ExternalLink(str(tmp_path / "other.h5"), "R")
    with pytest.raises(
        BenchLogError, match=r"log\.h5: the numbers of 'R' are .*; only what stands in the file itself is"
    ):
        read_table(path)
