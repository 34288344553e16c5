"""Isobaric loops: what is read off them, what is fitted to them, and what the measured wires in shared/data say."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from sma_actuator.base.errors import UserError
from sma_actuator.cli.main import main
from sma_actuator.kinetics import command
from sma_actuator.kinetics.fitting import FAMILIES, both, fit, guess
from sma_actuator.kinetics.reading import read_loop
from sma_actuator.kinetics.temperatures import slopes_Pa_K, temperatures
from sma_actuator.logs.unpacking import SMALL_B
from sma_actuator.plant.kinetics import LiangRogers, Logistic, Measured, follow
from sma_actuator.plant.measured import FLEXINOL_381UM

DATA = Path(__file__).resolve().parents[4] / "shared" / "data"
FLEXINOL = [DATA / "flexinol_381um" / f"trained_{stress}MPa.csv" for stress in (50, 150, 200)]
NI_TI_CO = [DATA / "nitico_isobaric" / f"NiTiCo_{stress}_MPa.txt" for stress in (7, 50, 150, 200)]
measured_wires = pytest.mark.skipif(
    not all(path.exists() for path in FLEXINOL + NI_TI_CO), reason="the measured loops of shared/data are not here"
)


def made(kinetics, stress_MPa, size=0.04, cold_C=20.0, hot_C=130.0, seed=0):
    """Temperature, strain and stress of a loop, heated first, with a little noise."""
    temperature_C = np.concatenate((np.arange(cold_C, hot_C, 0.5), np.arange(hot_C, cold_C, -0.5)))
    stress_Pa = np.full(len(temperature_C), stress_MPa * 1e6)
    first = np.concatenate(([cold_C], temperature_C))
    fraction = follow(kinetics, first, np.full(len(first), stress_MPa * 1e6))
    noise = np.random.default_rng(seed).normal(0.0, 1e-5, len(temperature_C))
    return np.column_stack((temperature_C, 0.001 + size * fraction[1:] + noise, stress_Pa / 1e6))


def written(path, rows, header="temperature_C,strain,stress_MPa", delimiter=","):
    np.savetxt(path, rows, delimiter=delimiter, header=header, comments="")
    return path


COSINES = LiangRogers(
    austenite_start_C=60.0,
    austenite_finish_C=80.0,
    martensite_start_C=50.0,
    martensite_finish_C=36.0,
    stress_slope_Pa_K=8e6,
)


@pytest.fixture
def loops(tmp_path):
    return [read_loop(written(tmp_path / f"made_{s}.csv", made(COSINES, s))) for s in (40, 100, 160)]


def test_a_file_is_read_with_a_header_in_any_order_or_without(tmp_path):
    rows = made(COSINES, 100)
    plain = read_loop(written(tmp_path / "a.csv", rows))
    turned = read_loop(written(tmp_path / "b.csv", rows[:, ::-1], "stress_MPa,strain,temperature_C"))
    bare = read_loop(written(tmp_path / "c.txt", rows, header="", delimiter=" "))
    for other in (turned, bare):
        assert other.temperature_C == pytest.approx(plain.temperature_C)
        assert other.strain == pytest.approx(plain.strain)
        assert other.mean_stress_Pa == pytest.approx(100e6)


def test_cooling_first_gives_the_same_branches(tmp_path):
    rows = made(COSINES, 100)
    half = len(rows) // 2
    first = read_loop(written(tmp_path / "a.csv", rows))
    second = read_loop(written(tmp_path / "b.csv", np.concatenate((rows[half:], rows[:half]))))
    for loop in (first, second):
        heating, cooling = (loop.temperature_C[branch] for branch in loop.branches)
        assert np.diff(heating).mean() > 0.0 > np.diff(cooling).mean()


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "is empty"),
        (" , ,\n" * 50, "is empty"),
        ("temperature_C,strain\n1,2\n", "line 1: no column stress_Pa"),
        ("1 2\n" * 50, "line 1: 2 columns and no header"),
        ("1 2 3\n" * 5, "5 samples are no loop"),
        ("20 0.01 100\n" * 50, "spans 0.0 K"),
        ("20 0.01 100\n" + "20 x 100\n" + "20 0.01 100\n" * 50, "line 2: temperature, strain and stress"),
        ("".join(f"{t} 0.01 100\n" for t in [*range(100), *range(100, 0, -1), *range(100)]), "3 times"),
    ],
)
def test_what_is_no_loop_is_refused_by_file_and_line(tmp_path, text, sentence):
    path = tmp_path / "wrong.txt"
    path.write_text(text)
    with pytest.raises(UserError, match="wrong.txt") as refused:
        read_loop(path)
    assert sentence in str(refused.value)


def test_what_is_no_file_or_longer_than_a_loop_is_not_read(tmp_path):
    os.mkfifo(tmp_path / "pipe.csv")
    with pytest.raises(UserError, match=r"pipe\.csv: cannot be read \(it is a pipe\)"):
        read_loop(tmp_path / "pipe.csv")
    (tmp_path / "long.csv").touch()
    os.truncate(tmp_path / "long.csv", SMALL_B + 1)
    with pytest.raises(UserError, match=r"long\.csv: is longer than 50 MB"):
        read_loop(tmp_path / "long.csv")


def test_temperatures_and_slopes_of_a_known_wire_are_read_off(loops):
    found = [temperatures(loop) for loop in loops]
    for t, stress in zip(found, (40e6, 100e6, 160e6), strict=True):
        assert t.heating_C[1] == pytest.approx(70.0 + stress / 8e6, abs=0.3)
        assert t.cooling_C[1] == pytest.approx(43.0 + stress / 8e6, abs=0.3)
        assert t.hysteresis_K == pytest.approx(27.0, abs=0.4)
        assert t.widths_K == pytest.approx((0.59 * 20.0, 0.59 * 14.0), abs=0.5)
        assert t.stroke == pytest.approx(0.04, abs=1e-4)
        assert t.austenite_start_C == pytest.approx(70.0 - 10.0 * 0.64 + stress / 8e6, abs=0.6)
    for slopes in slopes_Pa_K(found).values():
        assert slopes == pytest.approx((8e6, 8e6, 8e6), rel=0.03)
    assert slopes_Pa_K(found[:1]) == {}


def test_a_fit_finds_the_kinetics_that_made_the_loops(loops):
    found = fit(FAMILIES["liang_rogers"], loops)
    k = found.kinetics
    assert (k.austenite_start_C, k.austenite_finish_C) == pytest.approx((60.0, 80.0), abs=0.3)
    assert (k.martensite_start_C, k.martensite_finish_C) == pytest.approx((50.0, 36.0), abs=0.3)
    assert k.stress_slope_Pa_K == pytest.approx(8e6, rel=0.01)
    assert max(both(found.rms(loop)) for loop in loops) < 2e-3


def test_a_distribution_is_found_again_where_its_tails_have_their_own_slope(tmp_path):
    wire = Measured(
        heating=(Logistic(0.6, 70.0, 1.5, 8e6), Logistic(0.4, 72.0, 8.0, 14e6)),
        cooling=(Logistic(0.6, 50.0, 1.5, 7e6), Logistic(0.4, 48.0, 8.0, 7e6)),
    )
    loops = [read_loop(written(tmp_path / f"made_{s}.csv", made(wire, s, cold_C=-10.0))) for s in (40, 100, 160)]
    found = fit(FAMILIES["measured"], [loops[0], loops[2]])
    assert both(found.rms(loops[1])) < 5e-3
    assert both(fit(FAMILIES["liang_rogers"], [loops[0], loops[2]]).rms(loops[1])) > 15e-3


@measured_wires
def test_on_the_trained_flexinol_wire_a_distribution_holds_at_a_stress_it_has_not_seen():
    loops = [read_loop(path) for path in FLEXINOL]
    found = fit(FAMILIES["measured"], [loops[0], loops[2]])
    assert both(found.rms(loops[1])) < 0.015
    cosines = fit(FAMILIES["liang_rogers"], [loops[0], loops[2]])
    assert both(cosines.rms(loops[1])) > 0.03


@measured_wires
def test_what_the_readme_of_the_trained_wire_says_is_read_off_it():
    found = [temperatures(read_loop(path)) for path in FLEXINOL]
    for t in found:
        assert 24.0 < t.widths_K[0] < 36.0 and 18.0 < t.hysteresis_K < 21.5
    slopes = slopes_Pa_K(found)
    assert slopes["heating"][1] == pytest.approx(8.1e6, rel=0.03)
    assert slopes["cooling"][1] == pytest.approx(7.5e6, rel=0.03)
    assert slopes["heating"][0] > 15e6  # the tail that stress hardly moves


@measured_wires
def test_the_distribution_that_the_bench_ships_is_that_of_the_trained_wire():
    """Nothing is fitted here but the size and the zero of each loop's strain."""
    for loop in (read_loop(path) for path in FLEXINOL):
        fraction = follow(FLEXINOL_381UM, loop.temperature_C, loop.smooth_stress_Pa)
        line = np.polyfit(fraction, loop.strain, 1)
        assert np.sqrt(np.mean((np.polyval(line, fraction) - loop.strain) ** 2)) / loop.stroke < 0.01


@measured_wires
def test_another_alloy_is_served():
    loops = [read_loop(path) for path in NI_TI_CO]
    found = [temperatures(loop) for loop in loops]
    assert all(30.0 < t.hysteresis_K < 48.0 for t in found)
    assert 5e6 < slopes_Pa_K(found)["cooling"][1] < 9e6
    distribution, cosines = (fit(FAMILIES[name], loops) for name in ("measured", "liang_rogers"))
    for loop in loops:
        assert both(distribution.rms(loop)) < min(0.045, both(cosines.rms(loop)))


def test_a_guess_needs_no_second_stress(loops):
    one = guess([temperatures(loops[1])])
    assert one.heating_C == pytest.approx(70.0 + 100.0 / 8.0 - 12.0, abs=0.3)


@pytest.mark.parametrize(
    "families",
    [
        [name for name in FAMILIES if name != "measured"],  # which is fitted and found again above, and takes longest
        pytest.param(list(FAMILIES), marks=pytest.mark.long),
    ],
    ids=("some", "all"),
)
def test_the_command_writes_a_page_and_all_numbers(families, tmp_path, monkeypatch):
    monkeypatch.setattr(command, "FAMILIES", {name: FAMILIES[name] for name in families})
    files = [written(tmp_path / f"made_{s}.csv", made(COSINES, s)[::6]) for s in (40, 100, 160)]
    page, numbers = tmp_path / "page.html", tmp_path / "numbers.json"
    assert main(["loop", *map(str, files), "--report", str(page), "--json", str(numbers), "--kinetics"]) == 0
    found = json.loads(numbers.read_text())
    assert set(found["fits"]) == set(families) and set(found["loops"]) == {"made_40", "made_100", "made_160"}
    of = found["fits"]["liang_rogers"]["rms_of_stroke"]["made_100"]
    assert max(of["seen"]) < 2e-3 and max(of["left_out"]) < 4e-3
    assert found["slopes_Pa_K"]["heating"][1] == pytest.approx(8e6, rel=0.03)
    text = page.read_text()
    assert "Clausius-Clapeyron" in text and "left out" in text and text.count("<img") >= 1 + len(families)


def test_a_file_that_is_no_loop_ends_the_command_with_a_sentence(tmp_path):
    path = tmp_path / "wrong.csv"
    path.write_text("a,b\n1,2\n")
    done = subprocess.run(
        [sys.executable, "-m", "sma_actuator", "loop", str(path)], capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 1 and "wrong.csv: line 1: no column temperature_C" in done.stderr
    assert "Traceback" not in done.stderr


def test_one_loop_alone_is_drawn_and_says_that_it_tells_no_slope(tmp_path, capsys):
    path = written(tmp_path / "only.csv", made(COSINES, 100)[::4])
    page = tmp_path / "page.html"
    command = ["loop", str(path), "--report", str(page)]
    assert main(command) == 0
    said = capsys.readouterr().out
    assert "only" in said and "MPa/K" not in said
    assert "does not tell a Clausius-Clapeyron slope" in page.read_text()
    assert main(command) == 1 and "exists already; --force overwrites it" in capsys.readouterr().err


def written_loop(path, strain_factor=1.0, header="temperature_C,strain,stress_MPa"):
    """A loop of 4 % between 20 and 120 °C at 150 MPa."""
    heating, cooling = np.linspace(20.0, 120.0, 80), np.linspace(120.0, 20.0, 80)
    rows = [(t, 0.04 / (1.0 + np.exp((t - 80.0) / 4.0)), 150.0) for t in heating]
    rows += [(t, 0.04 / (1.0 + np.exp((t - 60.0) / 4.0)), 150.0) for t in cooling]
    lines = [f"{t},{strain_factor * s},{p}" for t, s, p in rows]
    path.write_text("\n".join([header, *lines] if header else lines) + "\n")
    return path


@pytest.mark.parametrize(
    "header",
    (
        "temperature_C,strain_%,stress_MPa",
        "Temperature_C,Strain (%),Stress [MPa]",
        "TEMPERATURE_C,STRAIN_PERCENT,stress_mpa",
    ),
)
def test_strain_in_percent_is_read_where_the_column_says_so(tmp_path, header):
    loop = read_loop(written_loop(tmp_path / "loop.csv", 100.0, header))
    assert loop.stroke == pytest.approx(0.04, rel=0.01) and loop.mean_stress_Pa == pytest.approx(150e6)


@pytest.mark.parametrize("header", ("temperature_C,strain,stress_MPa", ""))
def test_a_strain_that_no_wire_has_is_asked_about(tmp_path, header):
    with pytest.raises(UserError, match=r"a strain of 4\d\d% .* is it in percent\? Name the column strain_%"):
        read_loop(written_loop(tmp_path / "loop.csv", 100.0, header))


def test_the_command_takes_the_unit_that_it_asks_for(tmp_path, capsys):
    path = written_loop(tmp_path / "loop.csv", 100.0)
    assert main(["loop", str(path)]) == 1
    assert "--unit strain=%" in capsys.readouterr().err
    assert main(["loop", str(path), "--unit", "strain=%"]) == 0
    assert capsys.readouterr().err.endswith(
        "next: the same with --report loops.html, to see where a fit leaves the loops\n"
    )
    assert main(["loop", str(path), "--unit", "strain=%", "-q"]) == 0
    assert capsys.readouterr().err == ""
