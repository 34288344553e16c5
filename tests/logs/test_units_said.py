"""A column's unit stands in its name, beside it in the file, or is said: the load comes out in newtons and the
displacement in metres, or a sentence asks."""

import numpy as np
import pytest

from sma_actuator.logs.errors import BenchLogError
from sma_actuator.logs.mapping import column_map
from sma_actuator.logs.reading import ReadingOptions, read_logs
from sma_actuator.logs.tables import Table

N = 60
POUND_N, GRAM_N = 4.4482216152605, 9.80665e-3
LOAD_N, DISPLACEMENT_m = 0.98, 3e-3
COLUMNS = {"time_s": np.arange(N) * 0.05, "resistance_Ohm": np.full(N, 6.0), "current_A": np.full(N, 0.05)}


def written(path, load, displacement, time="time_s", stamps=None):
    """A log whose columns of load and displacement have these names; what each is 1 of stays 0.98 N and 3 mm."""
    (load_name, one_N), (displacement_name, one_m) = load, displacement
    lines = [f"{time};resistance_Ohm;current_A;{load_name};{displacement_name}"]
    stamps = stamps or [f"{t:.2f}" for t in COLUMNS["time_s"]]
    lines += [f"{stamp};6.0;0.05;{LOAD_N / one_N:.9g};{DISPLACEMENT_m / one_m:.9g}" for stamp in stamps]
    path.write_text("\n".join(lines))
    return path


def read(path, *names, units=()):
    ours = ("load_N", "displacement_m", "time_s")
    maps = [f"{a}={b}" for a, b in zip(ours, names) if b]
    (log,) = read_logs([path], ReadingOptions(column_map(maps, units, (), None)))
    return log


@pytest.mark.parametrize(
    ("load", "displacement"),
    [
        (("Force [lbs]", POUND_N), ("Pos [Inches]", 0.0254)),
        (("Force (oz)", POUND_N / 16), ("Pos (thou)", 25.4e-6)),
        (("Kraft_cN", 0.01), ("Weg_nm", 1e-9)),
        (("Force (grams)", GRAM_N), ("Position (millimeters)", 1e-3)),
        (("Newtons", 1.0), ("Pos (mm) filtered", 1e-3)),
        (("Force [daN]", 10.0), ("Pos [microns]", 1e-6)),
        (("effort[0]", 1.0), ("pos[1] mm", 1e-3)),
    ],
)
def test_units_of_the_trade_and_words_for_them_are_known(load, displacement, tmp_path):
    log = read(written(tmp_path / "log.csv", load, displacement), load[0], displacement[0])
    np.testing.assert_allclose(log["load_N"], LOAD_N, rtol=1e-6)
    np.testing.assert_allclose(log["displacement_m"], DISPLACEMENT_m, rtol=1e-6)


@pytest.mark.parametrize(
    ("load", "displacement", "ours", "unit"),
    [
        (("Force [pond]", GRAM_N), ("Pos [mm]", 1e-3), "load_N", "g"),
        (("Force [mN]", 1e-3), ("Weg [1/100 mm]", 1e-5), "displacement_m", "0.01mm"),
        (("Force (ch 3)", 1.0), ("Pos [mm]", 1e-3), "load_N", "N"),
        (("Force [N]", 1.0), ("Pos [counts]", 2e-6), "displacement_m", "2e-6m"),
    ],
)
def test_what_stands_in_brackets_and_is_no_unit_is_asked_for(load, displacement, ours, unit, tmp_path):
    path = written(tmp_path / "log.csv", load, displacement)
    with pytest.raises(BenchLogError, match=f"which is no unit of {ours}; say its own with --unit"):
        read(path, load[0], displacement[0])
    log = read(path, load[0], displacement[0], units=[f"{ours}={unit}"])
    np.testing.assert_allclose(log["load_N"], LOAD_N, rtol=1e-6)
    np.testing.assert_allclose(log["displacement_m"], DISPLACEMENT_m, rtol=1e-6)


@pytest.mark.parametrize("name", ["Strain (-)", "Strain [–]", "Strain [1]", "Strain [0-1]", "strain[3]"])
def test_a_dash_a_range_or_an_index_in_brackets_is_no_unit(name):
    table = Table({name: np.full(3, 0.02)}, "loop.csv")
    given = column_map([f"strain={name}"], (), (), None, ("strain",)).apply(table)
    np.testing.assert_array_equal(given.columns["strain"], 0.02)


def test_a_word_for_a_unit_agrees_with_its_symbol_and_contradicts_another(tmp_path):
    path = written(tmp_path / "log.csv", ("Force [lbs]", POUND_N), ("displacement_m", 1.0))
    np.testing.assert_allclose(read(path, "Force [lbs]", units=["load_N=lbf"])["load_N"], LOAD_N, rtol=1e-6)
    with pytest.raises(BenchLogError, match=r"--unit load_N=N, but 'Force \[lbs\]' says lbs"):
        read(path, "Force [lbs]", units=["load_N=N"])


@pytest.mark.parametrize("name", ["Timestamp [ms]", "Time (hh:mm:ss.000)"])
def test_dates_are_seconds_whatever_the_header_says_of_how_they_are_written(name, tmp_path):
    stamps = [f"2026-03-28 23:59:{50 + 0.05 * i:06.3f}" for i in range(N)]
    path = written(tmp_path / "log.csv", ("load_N", 1.0), ("displacement_m", 1.0), name, stamps)
    np.testing.assert_allclose(read(path, "", "", name)["time_s"], COLUMNS["time_s"], atol=1e-6)


def test_the_units_of_a_tdms_file_with_several_groups_are_kept(tmp_path):
    nptdms = pytest.importorskip("nptdms")

    def channel(group, name, values, unit):
        return nptdms.ChannelObject(group, name, values, properties={"unit_string": unit})

    electrical = [channel("DMM", name, values, "") for name, values in COLUMNS.items()]
    force = channel("Bridge", "Force", np.full(N, LOAD_N / POUND_N), "Pounds")
    position = channel("Laser", "Position", np.full(N, DISPLACEMENT_m * 1e3), "mm")
    with nptdms.TdmsWriter(tmp_path / "log.tdms") as file:
        file.write_segment([*electrical, force, position])
    maps = [f"{ours}=DMM/{ours}" for ours in COLUMNS]
    maps += ["load_N=Bridge/Force", "displacement_m=Laser/Position"]
    (log,) = read_logs([tmp_path / "log.tdms"], ReadingOptions(column_map(maps, (), (), None)))
    np.testing.assert_allclose(log["load_N"], LOAD_N)
    np.testing.assert_allclose(log["displacement_m"], DISPLACEMENT_m)


def test_a_unit_that_hdf5_keeps_in_bytes_of_fixed_length_is_one(tmp_path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "log.h5", "w") as file:
        for name, values in COLUMNS.items():
            file[name] = values
        file["force"], file["position"] = np.full(N, LOAD_N / GRAM_N), np.full(N, DISPLACEMENT_m * 1e3)
        file["force"].attrs["units"], file["position"].attrs["units"] = np.bytes_("g"), np.bytes_("mm")
    log = read(tmp_path / "log.h5", "force", "position")
    np.testing.assert_allclose(log["load_N"], LOAD_N)
    np.testing.assert_allclose(log["displacement_m"], DISPLACEMENT_m)
