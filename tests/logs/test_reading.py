"""Logs as they come: stamps that stand twice, one bad file among good ones, columns in capitals, one map for all."""

import datetime

import numpy as np
import pytest
import scipy.io

from sma_actuator.cli.main import main
from sma_actuator.logs.bench_log import BenchLog, averaged, with_rising_stamps
from sma_actuator.logs.cycles import cycle_numbers, cycles_of, is_driven, which_are_full
from sma_actuator.logs.errors import BenchLogError
from sma_actuator.logs.fitness import judge
from sma_actuator.logs.mapping import column_map
from sma_actuator.logs.reading import ReadingOptions, read_logs
from sma_actuator.logs.units import unit_in_words

HEADER = "time_s,resistance_Ohm,current_A,load_N,displacement_m"


def pulses(count, noise=0.0, partial_every=0, rate_Hz=50.0, seed=0):
    """Time, resistance, current, load and displacement of heating for 3 s and cooling for 5 s, over and over."""
    random = np.random.default_rng(seed)
    time_s = np.arange(round(count * 8.0 * rate_Hz)) / rate_Hz
    number, phase_s = (time_s - 5.0) // 8.0, time_s % 8.0
    depth = np.where(partial_every and number % partial_every == 0, 0.6, 1.0) if partial_every else 1.0
    on = phase_s >= 5.0
    contracted = depth * np.where(on, 1.0 - np.exp(-(phase_s - 5.0) / 0.3), np.exp(-phase_s / 0.5))
    contracted[time_s < 5.0] = 0.0
    moved_m = 0.004 * (1.0 - contracted) + noise * 0.004 * random.normal(size=len(time_s))
    return BenchLog(
        {
            "time_s": time_s,
            "resistance_Ohm": 4.5 + 200.0 * moved_m,
            "current_A": np.where(on, 0.3, 0.05),
            "load_N": np.full(len(time_s), 1.0) + 0.005 * random.normal(size=len(time_s)),
            "displacement_m": moved_m,
        },
        source="pulses.csv",
    )


def full_share(log):
    driven = is_driven(log["current_A"])
    cycles = cycles_of(log["displacement_m"], driven, cycle_numbers(driven))
    return float(which_are_full([cycles], [1.0])[0].mean())


@pytest.mark.parametrize("noise", (0.0, 0.01))
def test_thirty_pulses_are_thirty_full_cycles_for_check_log_too(noise):
    log = pulses(30, noise)
    assert full_share(log) > 0.9
    (finding,) = [f for f in judge([log]) if "full cycles at each load" in f.requirement]
    assert finding.met and int(finding.found.split()[0]) >= 27


@pytest.mark.parametrize(("begins_m", "first"), [(0.008, True), (0.0042, True), (0.0025, False)])
def test_how_long_an_earlier_load_left_the_wire_makes_no_other_cycle_partial(begins_m, first):
    log = pulses(6)
    driven, displacement_m = is_driven(log["current_A"]), log["displacement_m"].copy()
    number = cycle_numbers(driven)
    left = np.minimum.accumulate(np.clip((displacement_m - displacement_m.min()) / np.ptp(displacement_m), 0.0, 1.0))
    cycles = cycles_of(displacement_m + left * (begins_m - 0.004), driven, number)
    assert which_are_full([cycles], [1.0])[0].tolist() == [first, *[True] * 4, False], "the log ends before the sixth"


def test_a_wire_that_is_switched_off_for_a_moment_has_not_gone_a_full_cycle():
    log = pulses(6)
    driven = is_driven(log["current_A"])
    at = int(np.flatnonzero(driven)[0]) + 100
    driven[at : at + 2] = False
    cycles = cycles_of(log["displacement_m"], driven, cycle_numbers(driven))
    assert which_are_full([cycles], [1.0])[0].tolist() == [False, False, *[True] * 4, False]


def test_a_log_in_which_some_cycles_are_partial_now_and_then_is_one_of_full_cycles(config):
    from sma_actuator.logs.kinds import FULL, make_experiments

    log = pulses(54, partial_every=6)
    assert 0.7 < full_share(log) < 0.95
    (experiment,) = make_experiments([log], config)
    assert experiment.kind == FULL


def test_readings_closer_than_a_wire_moves_are_averaged_and_tell_the_same_cycles():
    log = pulses(10, 0.01, rate_Hz=1000.0)
    short = averaged(log)
    assert len(short) == len(log) // 20 and short.period_s == pytest.approx(0.02)
    assert full_share(short) >= 0.9  # the last one is cut off
    assert averaged(short) is short
    gap = BenchLog({**log.columns, "time_s": log["time_s"] + np.where(log["time_s"] > 7.005, 60.0, 0.0)})
    assert len(averaged(gap)) == len(short) - 1  # no block holds the pause


def test_rows_that_stand_twice_count_once():
    log = pulses(2)
    twice = BenchLog({name: np.repeat(values, 2) for name, values in log.columns.items()}, source="twice.csv")
    said = []
    mended = with_rising_stamps(twice, said.append)
    assert all(np.array_equal(mended[name], log[name]) for name in log.columns)
    assert said == [f"twice.csv: {len(log)} rows stand twice, with all they hold; each counts once"]


def test_stamps_of_a_coarse_clock_are_spread_until_the_next_but_not_over_a_pause():
    log = pulses(2)
    coarse_s = np.floor(log["time_s"] * 10.0) / 10.0
    coarse_s[coarse_s >= 6.0] += 30.0
    said = []
    mended = with_rising_stamps(BenchLog({**log.columns, "time_s": coarse_s}, source="coarse.csv"), said.append)
    steps_s = np.diff(mended["time_s"])
    assert (steps_s > 0.0).all() and np.sort(steps_s)[-2] < 0.05 and steps_s.max() == pytest.approx(30.0, abs=0.1)
    assert "have the stamp of the one before" in said[0]
    backwards = BenchLog({**log.columns, "time_s": coarse_s[::-1].copy()})
    assert with_rising_stamps(backwards) is backwards  # it is refused by its line, as ever


def write(path, log, header=HEADER):
    table = np.column_stack([log[name] for name in HEADER.split(",")])
    np.savetxt(path, table, delimiter=",", header=header, comments="", fmt="%.9g")


def test_one_bad_file_does_not_stop_a_folder_and_alone_it_is_refused(tmp_path):
    for k in range(2):
        write(tmp_path / f"good_{k}.csv", pulses(3, seed=k))
    (tmp_path / "notes.txt").write_text("what we did on Monday\nmeasured\n")
    said = []
    logs = read_logs([tmp_path], ReadingOptions(), said.append)
    assert [log.name for log in logs] == ["good_0.csv", "good_1.csv"]
    assert [s for s in said if s.startswith("left out: ") and "notes.txt" in s]
    with pytest.raises(BenchLogError, match=r"notes\.txt"):
        read_logs([tmp_path / "notes.txt"], ReadingOptions())


def test_a_copy_of_a_log_counts_once(tmp_path):
    """The same readings twice would make everything that is said of them twice as sure."""
    for name, seed in (("first", 0), ("first - copy", 0), ("second", 1)):
        write(tmp_path / f"{name}.csv", pulses(3, seed=seed))
    said = []
    logs = read_logs([tmp_path / "first.csv", tmp_path], ReadingOptions(), said.append)
    assert [log.name for log in logs] == ["first.csv", "second.csv"]
    assert "left out: first - copy.csv: its readings are those of first.csv; they count once" in said


@pytest.mark.parametrize(
    "header",
    (
        "TIME_S,RESISTANCE_OHM,CURRENT_A,LOAD_N,DISPLACEMENT_M",
        "Time (s),Resistance (Ohm),Current [A],Load (N),Displacement (m)",
    ),
)
def test_capitals_and_brackets_leave_no_choice_either(tmp_path, header):
    write(tmp_path / "log.csv", pulses(3), header)
    (log,) = read_logs([tmp_path / "log.csv"], ReadingOptions())
    assert set(log.columns) == set(HEADER.split(","))


FOREIGN = "Zeit (ms);U_Draht [mV];Strom (mA);Dehnung [%];Masse (g)"
THEIRS = (
    "time_s=Zeit (ms)",
    "current_A=Strom (mA)",
    "wire_voltage_V=U_Draht [mV]",
    "load_N=Masse (g)",
    "displacement_m=Dehnung [%]",
)
MAPPED = [word for column in THEIRS for word in ("--map", column)]


@pytest.fixture
def foreign(tmp_path):
    """Two logs as somebody else writes them: other words, milli-units, decimal commas, percent of a wire of 100 mm."""
    log = pulses(3)
    voltage_mV = 1e3 * log["resistance_Ohm"] * log["current_A"]
    columns = (
        1e3 * log["time_s"],
        voltage_mV,
        1e3 * log["current_A"],
        1e3 * log["displacement_m"],
        102 * log["load_N"],
    )
    rows = "".join(";".join(f"{x:.4f}" for x in row) + "\n" for row in zip(*columns, strict=True)).replace(".", ",")
    for name in ("a.csv", "b.csv"):
        (tmp_path / name).write_text(f"{FOREIGN}\n{rows}")
    return log, tmp_path


def test_other_words_and_units_are_asked_for_and_taken(foreign, capsys):
    log, folder = foreign
    assert main(["check-log", str(folder)]) == 1
    said = capsys.readouterr().err
    assert all(f"--map '{column}'" in said for column in THEIRS)
    assert main(["check-log", str(folder), *MAPPED]) == 1
    assert "'Dehnung [%]' is in %, which is no unit of displacement_m" in (said := capsys.readouterr().err)
    assert "1 % of a wire of 100 mm is --unit displacement_m=1mm" in said
    assert main(["check-log", str(folder), *MAPPED, "--unit", "displacement_m=1mm", "--length", "100mm"]) in (0, 1)
    assert "a.csv and 1 more: wire_voltage_V: 'U_Draht [mV]' is in mV" in capsys.readouterr().err
    columns = column_map(THEIRS, ("displacement_m=1mm",), (), None)
    (read,) = read_logs([folder], ReadingOptions(columns))  # the second file is a copy
    np.testing.assert_allclose(read["displacement_m"], log["displacement_m"], atol=1e-6)
    np.testing.assert_allclose(read["load_N"], log["load_N"], rtol=1e-3)


@pytest.mark.parametrize(("text", "metres"), (("mm", 1e-3), ("-mm", -1e-3), ("2.5mm", 2.5e-3), ("-1e-1mm", -1e-4)))
def test_a_unit_may_count_the_other_way_and_say_what_one_of_it_is(text, metres):
    assert unit_in_words(text, "m").factor == pytest.approx(metres)


@pytest.mark.parametrize("text", ("", "-", "3", "3V", "mm3", "%", "nanm"))
def test_what_is_no_unit_of_a_length_is_refused(text):
    assert unit_in_words(text, "m") is None
    with pytest.raises(BenchLogError, match="unit of displacement_m"):
        column_map((), (f"displacement_m={text}",), (), None)


def test_check_log_writes_the_map_that_it_went_by(tmp_path, capsys):
    contraction = pulses(3)
    turned = {**contraction.columns, "displacement_m": 1e3 * (0.005 - contraction["displacement_m"])}
    write(tmp_path / "log.csv", BenchLog(turned), "time_s,R,current_A,load_N,displacement_mm")
    words = ["check-log", str(tmp_path / "log.csv"), "--map", "resistance_Ohm=R"]
    assert main([*words, "--write-map", str(tmp_path / "map.yaml")]) in (0, 1)
    assert "--map-file" in capsys.readouterr().err
    again = ReadingOptions(column_map((), (), (), tmp_path / "map.yaml"))
    (log,) = read_logs([tmp_path / "log.csv"], again)
    assert again.columns.units == {"displacement_m": "-mm"}
    moved_m = contraction["displacement_m"]
    np.testing.assert_allclose(log["displacement_m"] - log["displacement_m"].max(), moved_m - moved_m.max(), atol=1e-8)


def with_load(folder, stands):
    """A log of a load that rises by 1 N/s, which stands only in some rows."""
    rows = [f"{0.02 * i:.2f},5.0,0.1,{0.02 * i if stands(i) else ''},0.002" for i in range(301)]
    (folder / "log.csv").write_text("\n".join([HEADER, *rows]))
    said = []
    (log,) = read_logs([folder / "log.csv"], ReadingOptions(), said.append)
    return log, said


def test_the_load_of_a_slower_instrument_is_known_between_its_readings_but_not_where_one_is_missing(tmp_path):
    log, said = with_load(tmp_path, lambda i: i % 10 == 0 and i != 150)
    missing = np.isnan(log["load_N"])
    assert list(np.flatnonzero(missing)) == [*range(141, 160)]
    np.testing.assert_allclose(log["load_N"][~missing], log["time_s"][~missing], atol=1e-12)
    assert "log.csv: load_N stands in 10% of the rows; between them it is on the line that joins them" in said


@pytest.mark.parametrize(
    "stands", [lambda i: i % 100 == 0, lambda i: i % 3 != 0, lambda i: i < 100], ids=["2 s", "most", "then none"]
)
def test_of_a_load_that_is_slower_than_a_wire_or_only_missing_nothing_is_made(stands, tmp_path):
    log, _ = with_load(tmp_path, stands)
    np.testing.assert_array_equal(np.isfinite(log["load_N"]), [stands(i) for i in range(301)])


def in_files(folder, pause_s):
    """One recording in two files, the clock of the second ``pause_s`` behind the first's last reading."""
    log = pulses(2)
    rows = np.column_stack([log[name] for name in HEADER.split(",")])
    half = len(rows) // 2
    rows[half:, 0] += pause_s - (rows[half, 0] - rows[half - 1, 0])
    for name, part in (("run_001.csv", rows[:half]), ("run_002.csv", rows[half:])):
        np.savetxt(folder / name, part, delimiter=",", header=HEADER, comments="", fmt="%.9g")
    return rows


def test_files_of_a_logger_whose_clock_goes_on_are_one_recording(tmp_path):
    rows, said = in_files(tmp_path, pause_s=0.02), []
    (log,) = read_logs([tmp_path], ReadingOptions(), said.append)
    np.testing.assert_allclose(log["time_s"], rows[:, 0], rtol=1e-8)
    np.testing.assert_allclose(log["displacement_m"], rows[:, 4], rtol=1e-8)
    assert "run_002.csv: goes on from run_001.csv" in said


@pytest.mark.parametrize("again", [0, 3], ids=["every row once", "rows that stand in both"])
def test_files_of_a_logger_that_writes_dates_are_one_recording(again, tmp_path):
    rows, said = in_files(tmp_path, pause_s=0.02), []
    half, noon = len(rows) // 2, datetime.datetime(2026, 3, 14, 12)
    for name, part in (("run_001.csv", rows[:half]), ("run_002.csv", rows[half - again :])):
        lines = [f"{noon + datetime.timedelta(seconds=t)},{','.join(map(repr, row))}" for t, *row in part.tolist()]
        (tmp_path / name).write_text("\n".join([HEADER, *lines]) + "\n")
    (log,) = read_logs([tmp_path], ReadingOptions(), said.append)
    np.testing.assert_allclose(log["time_s"], rows[:, 0] - rows[0, 0], atol=2e-6)
    np.testing.assert_array_equal(log["displacement_m"], rows[:, 4])
    assert "run_002.csv: goes on from run_001.csv" in said
    assert ("run_002.csv: begins with the last 3 rows of run_001.csv; they count once" in said) is bool(again)


@pytest.mark.parametrize("pause_s", [-5.0, 0.0, 30.0])
def test_files_with_a_pause_between_them_or_a_clock_that_begins_again_are_two(pause_s, tmp_path):
    in_files(tmp_path, pause_s)
    assert len(read_logs([tmp_path], ReadingOptions())) == 2


def test_a_matrix_without_names_is_said_with_what_to_do(tmp_path):
    scipy.io.savemat(tmp_path / "log.mat", {"data": np.ones((20, 5)), "names": ["t", "U", "I", "F", "x"], "rate": 20.0})
    with pytest.raises(
        BenchLogError, match=r"holds a matrix, 'data' \(20 × 5\); save each of its columns under a name"
    ):
        read_logs([tmp_path / "log.mat"], ReadingOptions())
