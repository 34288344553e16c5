"""``sma-actuator check-log`` says what a lab's logs have and lack, as a lab would meet it."""

import dataclasses
import json
import re
import shlex

import numpy as np
import pytest

from sma_actuator.cli.main import main
from sma_actuator.config import bench_from_mapping
from sma_actuator.logs.bench_log import averaged, write_bench_log
from sma_actuator.logs.experiments import make_experiment
from sma_actuator.logs.fitness import judge
from sma_actuator.logs.mapping import column_map
from sma_actuator.logs.reading import ReadingOptions, read_logs


@pytest.fixture(scope="module")
def logs(flexinol):
    """Three weights with full cycles, one of them with partial cycles too."""
    return flexinol.only("pulses", "partial")


def changed(logs, **columns):
    """The logs with some columns made anew: ``name=function of the log``."""
    return [
        dataclasses.replace(log, columns={**log.columns, **{name: make(log) for name, make in columns.items()}})
        for log in logs
    ]


def lacking(logs, length_m=0.1):
    return [f.requirement for f in judge(logs, length_m) if not f.met and f.needed]


def test_logs_of_a_whole_calibration_are_fit(logs, tmp_path, capsys):
    assert lacking(logs) == []
    folder = tmp_path / "Müller's wire 7"  # the next command is typed as it is said
    for log in logs:
        write_bench_log(folder / log.name, log)
    found = tmp_path / "found.json"
    assert main(["check-log", str(folder), "--length", "0.1", "--json", str(found)]) == 0
    said, told = capsys.readouterr()
    assert "These logs are fit" in said
    assert shlex.split(told.splitlines()[-1])[:4] == ["next:", "sma-actuator", "identify", str(folder)]
    assert all(row["met"] for row in json.loads(found.read_text()) if row["needed"])


@pytest.mark.parametrize(
    ("change", "requirement"),
    [
        (lambda logs: [log.slice(0, len(log)) for log in logs if "partial" not in log.name], "4 partial cycles"),
        (lambda logs: [log for log in logs if "0.6" in log.name], "3 loads"),
        (
            lambda logs: changed(logs, displacement_m=lambda log: np.round(log["lvdt_current_A"] * 0.3158, 4)),
            "displacement resolved to 0.2% of the stroke",
        ),
        (
            lambda logs: changed(
                logs, lvdt_current_A=lambda log: np.minimum(log["lvdt_current_A"], np.median(log["lvdt_current_A"]))
            ),
            "the displacement sensor does not reach its end",
        ),
        (
            lambda logs: changed(logs, lvdt_current_A=lambda log: -log["lvdt_current_A"]),
            "displacement grows when the wire gets longer",
        ),
        (
            lambda logs: changed(
                logs,
                supply_voltage_V=lambda log: (
                    log["supply_voltage_V"] * (1.0 + 0.02 * np.random.default_rng(0).normal(size=len(log)))
                ),
            ),
            "noise of the resistance below 1% of its range",
        ),
        (
            lambda logs: [
                dataclasses.replace(log, columns={k: v[::3] for k, v in log.columns.items()}) for log in logs
            ],
            "20 readings a second or more",
        ),
        (
            lambda logs: changed(
                logs,
                reference_voltage_V=lambda log: np.where(
                    log["reference_voltage_V"] > 0.1, log["reference_voltage_V"], 0.0
                ),
            ),
            "resistance is measured all the time",
        ),
    ],
    ids=["no partial", "one load", "coarse", "clipped", "turned round", "noisy", "slow", "no bias current"],
)
def test_what_is_missing_is_named(logs, change, requirement):
    assert requirement in lacking(change(logs))


def found(logs, requirement):
    (finding,) = (f for f in judge(logs) if f.requirement == requirement)
    return finding


def later(log, name, late_s):
    """A channel as another clock would stamp it."""
    return np.interp(log["time_s"] - late_s, log["time_s"], log[name])


@pytest.mark.parametrize("late_s", [2.2, -1.0])
def test_the_clock_of_a_channel_that_is_late_is_named_with_its_delay(logs, late_s):
    delayed = changed(logs, lvdt_current_A=lambda log: later(log, "lvdt_current_A", late_s))
    finding = found(delayed, "all channels on one clock")
    assert finding.needed and not finding.met
    number, way = re.search(r"the displacement is ([\d.]+) s (\w+) against the resistance", finding.found).groups()
    assert float(number) == pytest.approx(abs(late_s), abs=0.11) and way == ("late" if late_s > 0.0 else "early")


def test_a_wire_whose_resistance_tells_a_little_early_has_one_clock(logs):
    assert found(
        changed(logs, lvdt_current_A=lambda log: later(log, "lvdt_current_A", 0.1)), "all channels on one clock"
    ).met


def test_a_late_load_shows_where_the_wire_pulls_a_spring(logs):
    spring = changed(logs, load_cell_voltage_V=lambda log: -later(log, "lvdt_current_A", 1.5) * 20.0 + 0.3)
    assert re.search(r"the load is 1\.[456] s late", found(spring, "all channels on one clock").found)


def test_a_tone_is_named_with_its_frequency_and_size(logs):
    def hums(log):
        time_s = np.arange(log["time_s"][0], log["time_s"][-1], 0.005)
        columns = {name: np.interp(time_s, log["time_s"], values) for name, values in log.columns.items()}
        swing = np.ptp(columns["lvdt_current_A"])
        columns["lvdt_current_A"] += 0.005 * swing * np.sin(2.0 * np.pi * 66.0 * time_s)
        return dataclasses.replace(log, columns={**columns, "time_s": time_s})

    assert found(logs, "no tone in a channel").met
    finding = found([hums(log) for log in logs[:2]], "no tone in a channel")
    size = re.search(r"66 Hz in the displacement, ([\d.]+)% of its range", finding.found).group(1)
    assert not finding.met and float(size) == pytest.approx(0.5, abs=0.03)


def test_repeated_rows_are_counted(logs):
    def doubled(log):
        rows = np.sort(np.concatenate((np.arange(len(log)), np.arange(0, len(log), 4))))
        columns = {name: values[rows] for name, values in log.columns.items()}
        time_s = np.linspace(log["time_s"][0], log["time_s"][-1], len(rows))
        return dataclasses.replace(log, columns={**columns, "time_s": time_s})

    assert found(logs, "every row is a new reading").met
    finding = found([doubled(log) for log in logs], "every row is a new reading")
    assert not finding.met and finding.found.startswith("20% of the rows")


def test_a_stroke_that_no_wire_has_is_a_wrong_unit(logs):
    metres = changed(logs, displacement_m=lambda log: log["lvdt_current_A"] * 0.3158)
    assert lacking(metres) == []
    assert "a stroke of 0.5% to 9% of the length" in lacking(metres, length_m=100.0)


def test_the_command_says_what_would_mend_it(logs, tmp_path, capsys):
    log = next(log for log in logs if "partial" not in log.name)
    write_bench_log(tmp_path / "one.csv", log)
    assert main(["check-log", str(tmp_path / "one.csv")]) == 1
    said = capsys.readouterr().out
    assert "These logs are not fit yet" in said
    assert "hang three weights" in said and "turn back half-way" in said


def test_a_load_that_pushes_is_turned_round(logs):
    (finding,) = [
        f for f in judge(changed(logs, load_N=lambda log: np.full(len(log), -0.98))) if "pulls" in f.requirement
    ]
    assert not finding.met and finding.remedy.endswith("--unit load_N=-N")


@pytest.mark.parametrize(("zero_N", "is_met"), [(-0.01, True), (-0.1, False)])
def test_the_drifted_zero_of_an_unloaded_cell_is_no_pull_that_counts_as_negative(zero_N, is_met, logs):
    heaviest, unloaded = logs[0], logs[-1]
    loads_N = {heaviest.name: 0.98, unloaded.name: zero_N}
    both = changed([heaviest, unloaded], load_N=lambda log: np.full(len(log), loads_N[log.name]))
    (finding,) = [f for f in judge(both) if "pulls" in f.requirement]
    assert finding.met is is_met


def test_of_a_displacement_that_stands_still_nothing_else_is_asked(logs):
    still = changed(logs, displacement_m=lambda log: np.full(len(log), 2e-3))
    assert judge(still)[0].met and lacking(still) == ["the displacement moves"]


def test_without_a_witness_nothing_else_is_asked(logs):
    alone = [
        dataclasses.replace(log, columns={k: v for k, v in log.columns.items() if k != "lvdt_current_A"})
        for log in logs
    ]
    (finding,) = judge(alone)
    assert not finding.met and "LVDT" in finding.remedy


@pytest.mark.parametrize(
    ("column", "factor", "unit", "said"),
    [
        ("load_N", -1.0, "-N", "a wire only pulls; of a load cell that counts pull as negative say --unit load_N=-N"),
        ("current_A", -1.0, "-A", " A; of one that is measured the other way round say --unit current_A=-A"),
        ("time_s", 1.0 / 3600.0, "h", "in which no wire does anything; is the time in hours (--unit time_s=h)?"),
    ],
)
def test_a_column_turned_round_or_in_hours_is_refused_with_the_option_that_mends_it(
    column, factor, unit, said, flexinol, logs, tmp_path, capsys
):
    config = bench_from_mapping(flexinol.mapping)
    names = {"time_s": "t", "resistance_Ohm": "R", "current_A": "I", "load_N": "F", "displacement_m": "x"}
    for log in logs:
        s = make_experiment(log, config).signals
        rows = np.column_stack((s.time_s, s.resistance_Ohm, s.current_A, s.load_N, s.reference_displacement_m))
        rows[:, list(names).index(column)] *= factor
        np.savetxt(tmp_path / log.name, rows, delimiter=",", header=",".join(names.values()), comments="", fmt="%.12g")
    maps = [f"{ours}={theirs}" for ours, theirs in names.items()]
    words = ["--alloy", "ni-ti", "--length", "0.1", "--diameter", "0.15mm", "--out", str(tmp_path / "model.yaml")]
    assert main(["identify", str(tmp_path), *words, *(word for each in maps for word in ("--map", each))]) == 1
    assert said in capsys.readouterr().err
    for mended in read_logs([tmp_path], ReadingOptions(column_map(maps, [f"{column}={unit}"], (), None))):
        make_experiment(averaged(mended), config)


@pytest.mark.parametrize("rows", [1, 2, 40], ids=lambda n: f"{n} rows")
def test_a_log_in_which_nothing_happens_is_told_so(rows, tmp_path, capsys):
    log = tmp_path / "still.csv"
    steady = "".join(f"{0.05 * i:.2f},{'nan' if i == 1 else 5.0},0.2,1.0,0.002\n" for i in range(rows))
    log.write_text("time_s,resistance_Ohm,current_A,load_N,displacement_m\n" + steady)
    assert main(["check-log", str(log)]) == 1
    said = capsys.readouterr()
    assert "still.csv" in said.err or (
        "switch the current on and off" in said.out and "next: record that" in said.err.splitlines()[-1]
    )


@pytest.mark.parametrize("length", ["0", "-0.1", "0mm", "inf", "nan", "long"])
def test_a_length_that_no_wire_has_is_refused_before_a_log_is_read(length, capsys):
    with pytest.raises(SystemExit):
        main(["check-log", "none.csv", f"--length={length}"])
    assert f"{length!r} is no length: 0.1 (metres), 100mm or 4in is wanted" in capsys.readouterr().err
