"""A table of steady points is made a log, fitted, and judged; and what a real wire has shown is still so."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from steady_points import write_table

from sma_actuator.cli.main import main
from sma_actuator.config import Config, read_parameter_file
from sma_actuator.identify import identify
from sma_actuator.logs.mapping import column_map
from sma_actuator.logs.reading import ReadingOptions, read_logs
from sma_actuator.logs.static import ROUNDS, PERIOD_s, _along, log_of_points

ROOT = Path(__file__).parents[2]
WORDS = [
    "--map",
    "wire_voltage_V=voltage_V",
    "--map",
    "displacement_m=contraction_mm",
    "--unit",
    "displacement_m=-mm",
    "--map",
    "load_N=5",
]
WIRE = ["--alloy", "ni-ti", "--length", "0.42", "--diameter", "0.381e-3"]


def test_it_goes_through_the_points_one_after_the_other_and_says_so(tmp_path):
    said = []
    reading = ReadingOptions(column_map([*WORDS[1:4:2], "load_N=5"], ["displacement_m=-mm"], [], None), static_s=10.0)
    (log,) = read_logs([write_table(tmp_path / "loop.csv")], reading, said.append)
    at = np.round(np.arange(50) * 10.0 / PERIOD_s).astype(int)
    table = np.genfromtxt(tmp_path / "loop.csv", delimiter=",", names=True, dtype=None, encoding="utf-8")
    np.testing.assert_allclose(log["displacement_m"][at], -1e-3 * table["contraction_mm"])
    np.testing.assert_allclose(log["current_A"][at], table["current_A"])
    hot = table["current_A"] > 0.15
    np.testing.assert_allclose(
        log["resistance_Ohm"][at][hot], (table["voltage_V"] / np.maximum(table["current_A"], 1e-9))[hot]
    )
    assert log["time_s"][-1] == pytest.approx((50 * ROUNDS - 1) * 10.0)
    assert np.isfinite(log["resistance_Ohm"]).all()  # no current, no resistance: that of the neighbours
    assert [s for s in said if "50 steady points" in s and "smooth curve" in s]


def test_a_table_gives_a_model_that_says_it_was_judged_on_what_it_has_seen(tmp_path, capsys):
    table, out = write_table(tmp_path / "loop.csv"), tmp_path / "wire.yaml"
    words = [
        "identify",
        str(table),
        "--static",
        "10",
        *WORDS,
        *WIRE,
        "--model",
        "flexinol",
        "--no-extension",
        "--out",
        str(out),
    ]
    assert main([*words, "-q"]) == 0
    said = capsys.readouterr().out
    assert "on the cycles it was fitted on" in said and "for one load, 5 N" in said
    assert Config.for_tools(read_parameter_file(out)).model_type == "flexinol"


def test_too_few_points_and_no_time_at_all_are_refused_in_a_sentence(tmp_path, capsys):
    table = write_table(tmp_path / "loop.csv", 4)
    words = ["identify", str(table), *WORDS, *WIRE, "--out", str(tmp_path / "m.yaml")]
    assert main([*words, "--static", "10"]) == 1
    assert "at least 8 are wanted" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main([*words, "--static", "-1"])
    assert "-1' is not a number from 0 to 86400" in capsys.readouterr().err
    assert main(words) == 1  # without --static it is a log without times
    assert "time_s" in capsys.readouterr().err


def test_between_points_of_a_bend_the_log_is_nearer_to_it_than_a_straight_line():
    at = np.linspace(0.0, 0.5 * np.pi, 5)
    between = np.linspace(0.0, 4.0, 41)
    x, y = _along(np.column_stack((np.cos(at), np.sin(at))), between).T
    np.testing.assert_allclose(np.hypot(x, y)[::10], 1.0)
    assert np.abs(np.hypot(x, y) - 1.0)[10:31].max() < 0.002  # a straight line: 0.019
    assert _along(np.array([[0.0], [1.0], [1.0], [0.0]]), np.array([1.0, 1.25, 1.5, 2.0])).ravel() == pytest.approx(1.0)


def test_the_thesiss_model_meets_a_real_wire_on_both_branches():
    """docs/results.md: the thesis's model on its part of the stroke."""
    benchmark = _benchmark()
    table, heating = benchmark.read(60.0)
    result = identify([log_of_points(table, 60.0, {})], {"wire": benchmark.WIRE}, "flexinol")
    measured_m = table.columns["displacement_m"]
    error = 100.0 * np.abs(benchmark.estimates_m(result.config, table, 60.0) - measured_m) / np.ptp(measured_m)
    low_m, high_m = result.config.model.displacement_range
    inside = (low_m <= measured_m) & (measured_m <= high_m)
    assert (high_m - low_m) / np.ptp(measured_m) > 0.78
    assert error[inside & heating].mean() < 0.6 and error[inside & ~heating].mean() < 1.5


@pytest.mark.long
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("half", (0, 1))
def test_between_the_points_of_a_real_wire_the_whole_range_errs_by_less_than_a_percent(half):
    benchmark = _benchmark()
    table, heating = benchmark.read(60.0)
    measured_m = table.columns["displacement_m"]
    kept = benchmark.halves(heating)[half]
    log = log_of_points(benchmark.only(table, kept), 60.0, {})
    found_m = benchmark.estimates_m(identify([log], {"wire": benchmark.WIRE}, "whole_range").config, table, 60.0)
    error = 100.0 * np.abs(found_m - measured_m) / np.ptp(measured_m)
    assert error[~kept & heating].mean() < 1.0 and error[~kept & ~heating].mean() < 1.0


def _benchmark():
    spec = importlib.util.spec_from_file_location("static_loop", ROOT / "benchmarks" / "static_loop.py")
    benchmark = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(benchmark)
    if not benchmark.RECORD.exists():
        pytest.skip("../shared/data/static_loop is not here: it has no licence and is not shipped")
    return benchmark
