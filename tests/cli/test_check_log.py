"""``sma-actuator check-log`` says what a lab's logs have and lack, as a lab would meet it."""

import dataclasses
import json

import numpy as np
import pytest

from sma_actuator.cli.main import main
from sma_actuator.logs.bench_log import write_bench_log
from sma_actuator.logs.fitness import judge


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
    for log in logs:
        write_bench_log(tmp_path / log.name, log)
    found = tmp_path / "found.json"
    assert main(["check-log", str(tmp_path), "--length", "0.1", "--json", str(found)]) == 0
    said = capsys.readouterr().out
    assert "These logs are fit" in said
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


def test_without_a_witness_nothing_else_is_asked(logs):
    alone = [
        dataclasses.replace(log, columns={k: v for k, v in log.columns.items() if k != "lvdt_current_A"})
        for log in logs
    ]
    (finding,) = judge(alone)
    assert not finding.met and "LVDT" in finding.remedy


@pytest.mark.parametrize("rows", [1, 2, 40], ids=lambda n: f"{n} rows")
def test_a_log_in_which_nothing_happens_is_told_so(rows, tmp_path, capsys):
    log = tmp_path / "still.csv"
    steady = "".join(f"{0.05 * i:.2f},{'nan' if i == 1 else 5.0},0.2,1.0,0.002\n" for i in range(rows))
    log.write_text("time_s,resistance_Ohm,current_A,load_N,displacement_m\n" + steady)
    assert main(["check-log", str(log)]) == 1
    said = capsys.readouterr()
    assert "switch the current on and off" in said.out or "still.csv" in said.err
