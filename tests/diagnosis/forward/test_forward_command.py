"""``sma-actuator forward``: what it writes, and what it says of bad input."""

import json
import os

import numpy as np
import pytest
from forward_runs import MAKERS, synthetic

from sma_actuator.cli.main import main
from sma_actuator.diagnosis.forward import command
from sma_actuator.diagnosis.forward.candidates import named
from sma_actuator.diagnosis.forward.race import trace_runs
from sma_actuator.diagnosis.forward.wire import read_wire


def _write(path, run, every=1):
    table = np.column_stack([run.time_s, run.duty, run.position_m])[::every]
    np.savetxt(path, table, fmt="%.6g", delimiter=",", header="time_s,duty_cycle,slider_position_m", comments="")
    return path


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs")
    return [_write(folder / f"{run.name}.csv", run, every=5) for run in synthetic({"backlash_m": 5e-4})]


def _forward(*words):
    return main(["forward", *map(str, words)])


def test_it_writes_a_wire_the_figures_and_a_page_in_one_file(runs, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(command, "trace_runs", lambda *args: trace_runs(*args, candidates=(named("backlash"),)))
    out, threads = tmp_path / "out", os.environ.get("OPENBLAS_NUM_THREADS")
    assert (
        _forward(
            *runs[:3], "--judge", *runs[3:], "--wire", MAKERS, "--out", out, "--jobs", 1, "--json", tmp_path / "r.json"
        )
        == 0
    )
    wire = read_wire(out / "forward.yaml")
    report = json.loads((tmp_path / "r.json").read_text())
    assert report["verdict"] == "traced" and [e["name"] for e in report["effects"]] == ["backlash"]
    assert report["wire"]["effects"]["backlash_m"] == wire.effects.backlash_m == pytest.approx(5e-4, rel=0.1)
    assert report["error_after_mm"] < report["error_before_mm"]
    assert report["error_after_pct_stroke"] < report["error_before_pct_stroke"]
    assert [r["run"] for r in report["runs"]] == ["stairs"] and report["runs"][0]["chosen_and_fitted_on"] == [
        "ramp",
        "step",
        "low",
    ]
    assert os.environ.get("OPENBLAS_NUM_THREADS") == threads
    page = (out / "report.html").read_text()
    assert page.count("data:image/png;base64,") >= 3
    assert "http" not in page.replace("http://www.w3.org", "")
    assert "The model lacks backlash" in " ".join(capsys.readouterr().out.split())


def test_a_run_that_will_not_do_is_named_with_line_and_column(runs, tmp_path, capsys):
    lines = runs[0].read_text().splitlines()
    t10, t11 = (line.split(",")[0] for line in lines[10:12])
    cases = {
        "missing": (None, "cannot be read"),
        "column": (["time_s,duty,slider_position_m", *lines[1:]], "line 1: column duty_cycle is missing"),
        "nan": (
            [*lines[:10], f"{t10},0,nan", *lines[11:]],
            "line 11, column slider_position_m: nan is not a finite number",
        ),
        "text": ([*lines[:10], f"{t10},0,up", *lines[11:]], "line 11, column slider_position_m: 'up' is not a number"),
        "back": (
            [*lines[:10], f"{t11},0,0", f"{t10},0,0", *lines[12:]],
            "line 12, column time_s: time does not advance",
        ),
        "duty": ([*lines[:10], f"{t10},20,0", *lines[11:]], "line 11, column duty_cycle: 20 is outside 0 to 1"),
        "short": (lines[:51], "50 samples; a run of at least 100 is wanted"),
        "fields": ([*lines[:10], t10, *lines[11:]], "line 11: 1 fields where the header has 3"),
        "gap": ([*lines[:50], *lines[100:]], "line 51, column time_s: a gap"),
        "empty": ([], "the file is empty"),
        "unpowered": ([lines[0], *(f"{0.1 * i:g},0,{i % 2}" for i in range(150))], "nothing heats the wire"),
        "still": ([lines[0], *(f"{0.1 * i:g},0.1,0" for i in range(150))], "the slider never moves"),
    }
    for name, (text, sentence) in cases.items():
        path = tmp_path / f"{name}.csv"
        if text is not None:
            path.write_text("\n".join(text) + "\n" if text else "")
        assert _forward(path, runs[0], "--judge", runs[1], "--wire", MAKERS, "--out", tmp_path / "out") == 1, name
        error = capsys.readouterr().err
        assert str(path) in error and sentence in error, error
    assert not (tmp_path / "out").exists()


def test_runs_that_cannot_judge_are_refused(runs, tmp_path, capsys):
    for few in (runs[:1], runs[:2]):
        assert _forward(*few, "--wire", MAKERS, "--out", tmp_path) == 1
        assert "cannot choose effects and judge them; give at least 3" in capsys.readouterr().err
    assert _forward(runs[0], "--judge", runs[1], "--wire", MAKERS, "--out", tmp_path) == 1
    assert "give at least 2 runs beside those of --judge" in capsys.readouterr().err
    assert _forward(runs[0], runs[1], "--judge", runs[0], "--wire", MAKERS, "--out", tmp_path) == 1
    assert "given more than once" in capsys.readouterr().err
    assert _forward(*runs, "--wire", tmp_path / "no.yaml", "--out", tmp_path) == 1
    assert "no.yaml: cannot be read" in capsys.readouterr().err
