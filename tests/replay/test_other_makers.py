"""Logs of other people: other columns, units, separators and files give the numbers that our own give."""

import json
import re

import numpy as np
import pytest

from sma_actuator.cli.identify import write_model
from sma_actuator.cli.main import main
from sma_actuator.config import Config
from sma_actuator.logs.bench_log import BenchLog, signals_from_log, write_bench_log

G = 9.80665e-3  #: newtons per gram


@pytest.fixture(scope="module")
def model_file(identified_flexinol, tmp_path_factory):
    path = tmp_path_factory.mktemp("model") / "model.yaml"
    write_model(path, identified_flexinol)
    return path


@pytest.fixture(scope="module")
def signals(flexinol, model_file):
    return signals_from_log(flexinol.only("pulses_0.600N")[0], Config.load(model_file))


@pytest.fixture(scope="module")
def ours(flexinol, model_file, tmp_path_factory):
    """Errors of the log as we write it, of a bench that knows no ambient temperature: the others do not say it
    either."""
    log, folder = flexinol.only("pulses_0.600N")[0], tmp_path_factory.mktemp("ours")
    columns = {name: values for name, values in log.columns.items() if name != "ambient_temperature_C"}
    write_bench_log(folder / "ours.csv", BenchLog(columns, dict(log.metadata), "ours.csv"))
    return errors(folder / "ours.csv", model_file, folder)


def errors(log, model_file, folder, *words):
    assert main(["replay", str(log), "--config", str(model_file), "--json", str(folder / "e.json"), *words]) == 0
    (row,) = json.loads((folder / "e.json").read_text())
    return [row["working_percent"], row["working_share"], row["full_percent"], row["load_N"]]


def write_csv(path, columns, separator=",", decimal="."):
    rows = zip(*columns.values(), strict=True)
    lines = [separator.join(f"{value:.10g}".replace(".", decimal) for value in row) for row in rows]
    path.write_text("\n".join([separator.join(columns), *lines]) + "\n")
    return path


def foreign(s):
    """As another laboratory has it: milliseconds, grams, millimetres."""
    return {
        "Zeit": s.time_s * 1e3,
        "R": s.resistance_Ohm,
        "I": s.current_A * 1e3,
        "Last (g)": s.load_N / G,
        "Weg": s.reference_displacement_m * 1e3,
    }


MAP = [
    *("--map", "time_s=Zeit", "--unit", "time_s=ms", "--map", "resistance_Ohm=R", "--map", "current_A=I"),
    *(
        "--unit",
        "current_A=mA",
        "--map",
        "load_N=Last (g)",
        "--map",
        "displacement_m=Weg",
        "--unit",
        "displacement_m=mm",
    ),
]


def test_columns_are_named_on_the_command_line(signals, model_file, ours, tmp_path):
    log = write_csv(tmp_path / "lab.csv", foreign(signals), ";", ",")
    assert errors(log, model_file, tmp_path, *MAP) == pytest.approx(ours, rel=1e-6)


def test_or_once_in_a_file(signals, model_file, ours, tmp_path):
    write_csv(tmp_path / "lab.csv", foreign(signals), "\t", ",")
    (tmp_path / "map.yaml").write_text(
        "columns: {time_s: Zeit, resistance_Ohm: R, current_A: I, load_N: Last (g), displacement_m: Weg}\n"
        "units: {time_s: ms, current_A: mA, displacement_m: mm}\n"
    )
    found = errors(tmp_path / "lab.csv", model_file, tmp_path, "--map-file", str(tmp_path / "map.yaml"))
    assert found == pytest.approx(ours, rel=1e-6)


ELECTRICAL = {
    "voltage over the wire and current": lambda s: {
        "wire_voltage_V": s.resistance_Ohm * s.current_A,
        "current_A": s.current_A,
    },
    "voltage over the wire and over a resistor": lambda s: {
        "wire_voltage_V": s.resistance_Ohm * s.current_A,
        "reference_voltage_V": s.current_A * 1.0,
    },
    "resistance and power": lambda s: {"resistance_Ohm": s.resistance_Ohm, "power_W": s.power_W},
    "power and current in mA": lambda s: {"power_mW": 1e3 * s.power_W, "current_mA": 1e3 * s.current_A},
    "power and voltage": lambda s: {"power_W": s.power_W, "wire_voltage_V": s.resistance_Ohm * s.current_A},
}


@pytest.mark.parametrize("columns", ELECTRICAL.values(), ids=ELECTRICAL)
def test_resistance_and_current_come_as_they_were_measured(signals, model_file, ours, tmp_path, columns):
    columns = {
        "time_s": signals.time_s,
        **columns(signals),
        "load_N": signals.load_N,
        "displacement_mm": 1e3 * signals.reference_displacement_m,
    }
    log = write_csv(tmp_path / "lab.csv", columns)
    assert errors(log, model_file, tmp_path) == pytest.approx(ours, rel=1e-5)


def excel(path, columns):
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    book.active.append(list(columns))
    for row in zip(*columns.values(), strict=True):
        book.active.append([float(value) for value in row])
    book.save(path)


def parquet(path, columns):
    pyarrow = pytest.importorskip("pyarrow")
    writer = pytest.importorskip("pyarrow.parquet")
    writer.write_table(pyarrow.table(columns), path)


def matlab(path, columns):
    import scipy.io

    scipy.io.savemat(path, {"run": {name.split(" ")[0]: values for name, values in columns.items()}, "note": "a run"})


def tdms(path, columns):
    nptdms = pytest.importorskip("nptdms")
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment([nptdms.ChannelObject("run", name, values) for name, values in columns.items()])


def hdf5(path, columns):
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        for name, values in columns.items():
            file.create_dataset(name, data=values)
        file["Weg"].attrs["unit"] = "mm"


@pytest.mark.parametrize(
    ("ending", "write"), [(".xlsx", excel), (".parquet", parquet), (".mat", matlab), (".tdms", tdms), (".h5", hdf5)]
)
def test_files_of_other_kinds(signals, model_file, ours, tmp_path, ending, write):
    write(tmp_path / f"lab{ending}", foreign(signals))
    words = [word.replace("Last (g)", "Last") for word in MAP] if ending == ".mat" else MAP
    more = ["--unit", "load_N=g"] if ending == ".mat" else []
    assert errors(tmp_path / f"lab{ending}", model_file, tmp_path, *words, *more) == pytest.approx(ours, rel=1e-6)


@pytest.mark.parametrize("ending", [".xlsx", ".parquet", ".mat", ".tdms", ".h5"])
def test_junk_is_refused_in_a_sentence(model_file, tmp_path, capsys, ending):
    (tmp_path / f"junk{ending}").write_bytes(b"\0\1not a table")
    assert main(["replay", str(tmp_path / f"junk{ending}"), "--config", str(model_file)]) == 1
    said = capsys.readouterr().err
    assert f"junk{ending}: is no readable {ending} file" in said or "holds no column of numbers" in said


def test_a_package_that_is_missing_is_named_with_its_extra(model_file, tmp_path, capsys, monkeypatch):
    (tmp_path / "a.xlsx").write_bytes(b"x")
    monkeypatch.setitem(__import__("sys").modules, "openpyxl", None)
    assert main(["replay", str(tmp_path / "a.xlsx"), "--config", str(model_file)]) == 1
    assert "needs the Python package 'openpyxl' (extra 'formats')" in capsys.readouterr().err


def test_contraction_is_recognised_said_and_turned_round(signals, model_file, ours, tmp_path, capsys):
    s = signals
    zero_m = float(s.reference_displacement_m.max())
    columns = {
        "time_s": s.time_s,
        "resistance_Ohm": s.resistance_Ohm,
        "current_A": s.current_A,
        "load_N": s.load_N,
        "displacement_mm": 1e3 * (zero_m - s.reference_displacement_m),
    }
    log = write_csv(tmp_path / "lab.csv", columns)
    assert main(["replay", str(log), "--config", str(model_file)]) == 0
    said = capsys.readouterr().err
    assert "displacement_m: grows while the wire is heated, so it counts contraction; turned round" in said
    words = ["--unit", "displacement_m=-mm", "--offset", f"displacement_m={zero_m}"]
    assert errors(log, model_file, tmp_path, *words) == pytest.approx(ours, rel=1e-5)


def test_a_folder_and_a_pattern_are_their_logs(flexinol, model_file, tmp_path, capsys):
    for name in ("pulses_0.300N", "pulses_0.600N"):
        (tmp_path / f"{name}.csv").write_bytes((flexinol.folder / f"{name}.csv").read_bytes())
    for place in (tmp_path, tmp_path / "pulses_*.csv"):
        assert main(["replay", str(place), "--config", str(model_file), "--json", "-"]) == 0
        assert [row["name"] for row in json.loads(capsys.readouterr().out)] == [
            "pulses_0.300N.csv",
            "pulses_0.600N.csv",
        ]
    assert main(["replay", str(tmp_path / "none_*.csv"), "--config", str(model_file)]) == 1
    assert "none_*.csv: no file matches\n" in capsys.readouterr().err
    (tmp_path / "none_0001.csv.part").touch()
    assert main(["replay", str(tmp_path / "none_*.csv"), "--config", str(model_file)]) == 1
    assert "none_0001.csv.part is still being written" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("columns", "words", "sentence"),
    [
        pytest.param(
            {"t": 0, "R": 1, "I": 2, "F1": 3, "x": 4},
            [],
            "perhaps: --map 'time_s=t' --map 'resistance_Ohm=R' --map 'current_A=I'",
            id="a question with a proposal",
        ),
        pytest.param(
            {"time": 0, "R": 1, "I": 2, "load": 3, "pos a": 4, "pos b": 5},
            [],
            "--map 'displacement_m=pos a' (or 'pos b')",
            id="two that may be it",
        ),
        pytest.param({"time_s": 0, "time_ms": 0}, [], "both 'time_s' and 'time_ms' may be time_s", id="the same twice"),
        pytest.param(
            {"t": 0, "Pos (mm)": 4},
            ["--map", "displacement_m=Pos (mm)", "--unit", "displacement_m=m"],
            "--unit displacement_m=m, but 'Pos (mm)' says mm",
            id="unit and name contradict",
        ),
        pytest.param({"a": 0}, ["--map", "time_s=b"], "no column 'b' (--map time_s=b); found a", id="no such column"),
        pytest.param(
            {"a": 0}, ["--map", "force_N=a"], "'force_N' is no column here; known are time_s", id="no column of ours"
        ),
        pytest.param({"a": 0}, ["--unit", "load_N=mm"], "unit of load_N: 'mm' is not one of N", id="no such unit"),
        pytest.param(
            {"time_s": 0, "supply_voltage_V": 1, "current_A": 2, "load_N": 3},
            [],
            "name the voltage wire_voltage_V if it is that over the wire alone",
            id="which voltage",
        ),
    ],
)
def test_what_is_not_certain_is_asked_and_not_guessed(model_file, tmp_path, capsys, columns, words, sentence):
    rows = {name: np.arange(100) * 0.05 + 0.01 * i for name, i in columns.items()}
    log = write_csv(tmp_path / "lab.csv", rows)
    assert main(["replay", str(log), "--config", str(model_file), *words]) == 1
    assert sentence in capsys.readouterr().err


@pytest.mark.parametrize(
    ("header", "row", "words", "sentence"),
    [
        (
            ["Time", "R"],
            ["10 s", "x1"],
            [],
            "holds no column of numbers: 'Time' holds text such as '10 s', 'R' holds text such as 'x1'",
        ),
        (
            ["Time", "R"],
            ["noon", 1.5],
            ["--map", "time_s=Time"],
            "--map time_s=Time, but 'Time' holds text such as 'noon', not numbers",
        ),
        (["Time", "R"], ["noon", 1.5], ["--map", "time_s=Zeit"], "no column 'Zeit' (--map time_s=Zeit); found R"),
    ],
    ids=["nothing but text", "a column of text", "no such column"],
)
@pytest.mark.parametrize("ending", [".csv", ".parquet"])
def test_of_columns_of_text_it_says_what_they_hold(model_file, tmp_path, capsys, ending, header, row, words, sentence):
    log = tmp_path / f"lab{ending}"
    if ending == ".csv":
        log.write_text("\n".join(",".join(map(str, each)) for each in (header, row, row, row)) + "\n")
    else:
        parquet(log, {name: [value] * 3 for name, value in zip(header, row)})
    assert main(["replay", str(log), "--config", str(model_file), *words]) == 1
    if ending == ".parquet":  # whose texts are not read
        sentence = re.sub(r" such as '[^']*'", "", sentence)
    assert sentence in capsys.readouterr().err


def test_no_command_overwrites_a_file_unasked(flexinol, model_file, tmp_path, capsys):
    log = str(flexinol.folder / "pulses_0.600N.csv")
    for option in ("--json", "--csv", "--report", "--save-log"):
        (tmp_path / "mine").write_text("mine")
        words = ["replay", log, "--config", str(model_file), option, str(tmp_path / "mine")]
        assert main(words) == 1
        assert "mine: exists already; --force overwrites it" in capsys.readouterr().err
        assert (tmp_path / "mine").read_text() == "mine"
        assert main([*words, "--force"]) == 0
        assert (tmp_path / "mine").read_text() != "mine"
        assert main([*words[:-1], str(tmp_path), "--force"]) == 1
        assert f"{option} {tmp_path}: is a folder; name a file, in it or elsewhere" in capsys.readouterr().err
    assert (
        main(["identify", log, "--config", str(flexinol.folder / "bench.yaml"), "--model", "flexinol", "--out", log])
        == 1
    )
    assert "exists already; --force overwrites it" in capsys.readouterr().err
