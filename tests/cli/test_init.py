"""A few answers make a bench file that is complete: limits and gains follow from them, and the file says how."""

import dataclasses
import math
import multiprocessing
import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from rig import Rig

from sma_actuator.base.errors import UserError
from sma_actuator.base.parameters import ConfigError
from sma_actuator.base.sections import Loop, ThermalParameters
from sma_actuator.base.share import shared_file
from sma_actuator.characterise.plan import QUICK_READINGS
from sma_actuator.cli.init import QUESTIONS
from sma_actuator.cli.main import main
from sma_actuator.config import Config, bench_from_mapping, read_parameter_file, write_parameter_file
from sma_actuator.console import refuse_to_overwrite
from sma_actuator.derived import HOT_RESISTIVITY_Ohm_m, derived, with_derived, without_derived
from sma_actuator.instruments.dialect import FOLDER, Dialect
from sma_actuator.logs.units import quantity
from sma_actuator.safety.transformed import CAPACITY_WITHIN

ANSWERS = {
    "wire.alloy": "ni-ti",
    "wire.form": "wire",
    "wire.length": "0.1",
    "wire.diameter": "0.1524e-3",
    "circuit.reference_resistance": "1.0",
    "instruments.supply.resource": "TCPIP::127.0.0.1::5025::SOCKET",
    "instruments.supply.dialect": "virtual_bench_supply",
    "instruments.supply.channel": "1",
    "instruments.daq.resource": "TCPIP::127.0.0.1::5026::SOCKET",
    "instruments.daq.dialect": "virtual_bench_daq",
    "instruments.daq.supply_voltage_channel": "101",
    "instruments.daq.reference_voltage_channel": "102",
    "instruments.daq.load_cell_channel": "103",
    "load_cell.slope": "12.7297",
    "load_cell.offset": "-0.0598",
    "instruments.daq.lvdt_channel": "104",
    "thermal.ambient_temperature": "30",
}


def asked(text, *words):
    """The command in a process of its own, with these lines at its standard input (None: closed)."""
    return subprocess.run(
        [sys.executable, "-m", "sma_actuator", "init", *map(str, words)],
        input=text,
        stdin=subprocess.DEVNULL if text is None else None,
        capture_output=True,
        text=True,
        timeout=120,
        env=dict(os.environ),
        check=False,
    )


@pytest.fixture
def given(capsys):
    """The command in this process, which nobody answers: exit code and standard error."""

    def run(*words):
        capsys.readouterr()
        return SimpleNamespace(returncode=main(["init", *map(str, words)]), stderr=capsys.readouterr().err)

    return run


def test_answers_at_a_pipe_make_a_file_that_says_where_every_limit_comes_from(tmp_path):
    out = tmp_path / "bench.yaml"
    lines = list(ANSWERS.values())
    lines.insert(2, "100")  # millimetres: asked again, in a sentence
    done = asked("\n".join(lines) + "\n", "--out", out)
    assert done.returncode == 0, done.stderr
    assert "metres are wanted: 100 mm is 0.100" in done.stderr
    mapping = read_parameter_file(out)
    bench = bench_from_mapping(mapping)
    hot_Ohm = HOT_RESISTIVITY_Ohm_m * bench.wire.length / bench.wire.area_m2
    for current_A, limit_C in (
        (bench.supply.max_current, bench.thermal.derate_temperature),
        (bench.supply.over_current_trip, bench.thermal.max_temperature),
    ):
        settled_C = 30.0 + current_A**2 * hot_Ohm / (CAPACITY_WITHIN * bench.thermal.heat_loss)
        assert limit_C - 8.0 < settled_C <= limit_C
    text = out.read_text()
    for name in derived(mapping):
        (line,) = [one for one in text.splitlines() if one.strip().startswith(f"{name.split('.')[1]}: ")]
        assert "  # " in line, line


@pytest.mark.parametrize(
    ("form", "load_N", "stroke_m"),
    [
        (
            {"wire.form": "coil", "wire.coil_diameter": "1.524mm", "wire.length": "115mm", "wire.diameter": "0.254mm"},
            0.341,
            0.0478,
        ),
        ({"wire.form": "bundle", "wire.wires": "3", "wire.connection": "series"}, 9.58, 0.004),
    ],
    ids=["coil", "bundle"],
)
def test_a_coil_or_a_bundle_gets_limits_of_its_own(tmp_path, capsys, form, load_N, stroke_m):
    out = tmp_path / "bench.yaml"
    answers = ANSWERS | form
    assert main(["init", "--out", str(out), *(w for n, a in answers.items() for w in ("--set", f"{n}={a}"))]) == 0
    text, mapping = out.read_text(), read_parameter_file(out)
    assert f"max_stress: 175000000.0  # a load of {load_N:.3g} N" in text
    assert ("101 MPa as shear" in text) == (form["wire.form"] == "coil")
    bench = bench_from_mapping(mapping)
    assert bench.wire.full_stroke_m == bench.wire.full_stroke == stroke_m
    assert bench.controller.setpoint_rate_limit == pytest.approx(2.5 * stroke_m, rel=0.05)
    hot_Ohm = bench.wire.resistance_Ohm(HOT_RESISTIVITY_Ohm_m)
    settled_C = 30.0 + bench.supply.max_current**2 * hot_Ohm / (CAPACITY_WITHIN * bench.thermal.heat_loss)
    assert settled_C == pytest.approx(bench.thermal.derate_temperature, abs=8.0)


@pytest.mark.parametrize(
    ("answers", "form"), [({"wire.coil_diameter": "1.5mm"}, "coil"), ({"wire.wires": "3"}, "bundle"), ({}, "wire")]
)
def test_who_says_the_size_says_the_form(tmp_path, answers, form):
    out = tmp_path / "bench.yaml"
    known = ANSWERS | {"wire.connection": "series"} | answers
    del known["wire.form"]
    assert main(["init", "--out", str(out), *(w for n, a in known.items() for w in ("--set", f"{n}={a}"))]) == 0
    assert read_parameter_file(out)["wire"]["form"] == form


def test_numbers_may_have_a_unit_enter_takes_the_usual_and_a_question_mark_explains(tmp_path):
    out = tmp_path / "bench.yaml"
    typed = {
        **ANSWERS,
        "wire.length": "100mm",
        "wire.diameter": "?\n0.15 mm",
        "circuit.reference_resistance": "100 mOhm",
        "instruments.daq.supply_voltage_channel": "",
        "instruments.daq.reference_voltage_channel": "?\n202",
    }
    done = asked("\n".join(typed.values()) + "\n", "--out", out, "--set", "supply.max_current=300mA")
    assert done.returncode == 0, done.stderr
    mapping = read_parameter_file(out)
    assert (mapping["wire"]["length"], mapping["wire"]["diameter"]) == (0.1, 0.15e-3)
    assert mapping["circuit"]["reference_resistance"] == 0.1 and mapping["supply"]["max_current"] == 0.3
    daq = mapping["instruments"]["daq"]
    assert [daq[f"{name}_channel"] for name in ("supply_voltage", "reference_voltage", "load_cell")] == [101, 202, 103]
    assert "As on the packet" in done.stderr and "  0.00015 m" in done.stderr, "explained, and shown as understood"
    assert "U2 in the drawing" in done.stderr
    assert "max_voltage" in done.stdout, "what was derived is shown"
    assert f"sma-actuator check --config {shlex.quote(str(out))}" in done.stderr


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("0.15 mm", "m", 0.15e-3),
        ("0,15mm", "m", 0.15e-3),
        ("0.006in", "m", 0.1524e-3),
        ("1 ohm", "Ω", 1.0),
        ("75 °F", "°C", pytest.approx(23.889, abs=1e-3)),
        ("12.7 N/V", "N/V", 12.7),
        ("1e-3", "A", 1e-3),
        ("400 mV", "A", None),
        ("a lot", "A", None),
        ("nan", "A", None),
    ],
)
def test_a_number_that_was_typed(text, unit, value):
    assert quantity(text, unit) == value


def test_answers_may_stand_in_a_file_with_any_other_parameter(tmp_path, capsys):
    answers = tmp_path / "answers.yaml"
    answers.write_text("".join(f"{name}: {text}\n" for name, text in ANSWERS.items()) + "wire.max_stress: 150.0e6\n")
    words = ["init", "--answers", str(answers), "--set", "controller.kp=500", "--out", str(tmp_path / "bench.yaml")]
    assert main(words) == 0
    mapping = read_parameter_file(tmp_path / "bench.yaml")
    assert mapping["wire"]["max_stress"] == 150e6 and mapping["controller"]["kp"] == 500.0
    assert mapping["controller"]["ki"] == pytest.approx(500.0 / (0.25 * 5.9), rel=0.05), "built upon what is given"
    capsys.readouterr()
    assert main(["init", "--set", "wire.length=abc", "--out", str(tmp_path / "other.yaml")]) == 1
    assert "wire.length: 'abc' is not a number" in capsys.readouterr().err, "before anything is asked"
    answers.write_text("wire.lenght: 0.1\n")
    assert main([*words[:-1], str(tmp_path / "other.yaml")]) == 1
    assert "wire.lenght: no such parameter; did you mean wire.length?" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("load_cell.slope", "load_cell.slope: 0 N/V makes the same of every voltage; what one V means is wanted"),
        ("reference_sensor.slope", "reference_sensor.slope: 0 m/A makes the same of every"),
    ],
)
def test_a_sensor_that_would_tell_nothing_is_refused(tmp_path, capsys, name, said):
    """`check` ended in a traceback at a load cell of 0 N/V."""
    words = [word for each in {**ANSWERS, name: "0"}.items() for word in ("--set", "=".join(each))]
    assert main(["init", *words, "--out", str(tmp_path / "bench.yaml")]) == 1
    assert said in " ".join(capsys.readouterr().err.split())


def test_one_channel_for_two_voltages_is_refused_with_both_parameters(tmp_path, capsys):
    answers = {**ANSWERS, "instruments.daq.reference_voltage_channel": "101"}
    words = [word for name, text in answers.items() for word in ("--set", f"{name}={text}")]
    assert main(["init", *words, "--out", str(tmp_path / "bench.yaml")]) == 1
    said = capsys.readouterr().err
    assert (
        "instruments.daq.supply_voltage_channel and instruments.daq.reference_voltage_channel: are both channel 101"
        in said
    )
    assert not (tmp_path / "bench.yaml").exists()


def test_channels_that_are_not_there_are_none_twice(tmp_path):
    """0 says of the LVDT and of the room's sensor that there is none."""
    answers = {**ANSWERS, "instruments.daq.lvdt_channel": "0", "instruments.daq.ambient_temperature_channel": "0"}
    words = [word for name, text in answers.items() for word in ("--set", f"{name}={text}")]
    assert main(["init", *words, "--out", str(tmp_path / "bench.yaml")]) == 0


def test_nobody_to_answer_is_a_sentence(tmp_path):
    done = asked(None, "--set", "wire.alloy=ni-ti", "--out", tmp_path / "bench.yaml")
    assert done.returncode == 1 and "Traceback" not in done.stderr
    assert "'wire.length' was asked, and standard input is closed" in done.stderr
    assert not (tmp_path / "bench.yaml").exists()


def test_where_nobody_answers_what_has_a_usual_answer_gets_it(tmp_path, given):
    usual = {question.name for question in QUESTIONS if question.default is not None}
    words = [word for name, text in ANSWERS.items() if name not in usual for word in ("--set", f"{name}={text}")]
    done = given(*words, "--out", tmp_path / "bench.yaml")
    assert done.returncode == 0, done.stderr
    assert "nobody can answer: as Enter" in done.stderr
    assert read_parameter_file(tmp_path / "bench.yaml")["instruments"]["daq"]["supply_voltage_channel"] == 101


def test_a_dialect_of_ones_own_is_found_from_every_folder(tmp_path, monkeypatch, capsys):
    (tmp_path / "bench").mkdir()
    shutil.copy(FOLDER / "virtual_bench_supply.yaml", tmp_path / "bench" / "mine.yaml")
    monkeypatch.chdir(tmp_path / "bench")
    said = {**ANSWERS, "instruments.supply.dialect": "mine.yaml"}
    words = [word for name, answer in said.items() for word in ("--set", f"{name}={answer}")]
    assert main(["init", *words, "--out", "bench.yaml"]) == 0
    monkeypatch.chdir(tmp_path)
    written = read_parameter_file(tmp_path / "bench" / "bench.yaml")["instruments"]["supply"]["dialect"]
    assert Dialect.load(written, "supply").family == "SMA Actuator virtual supply"
    with pytest.raises(ConfigError, match=f"mine.yaml: cannot be read .*, looked for from {tmp_path}, is wanted"):
        Dialect.load("mine.yaml", "supply")


def test_a_supply_without_a_watchdog_wants_a_word(tmp_path, capsys):
    def with_answer(text):
        said = {
            **ANSWERS,
            "instruments.supply.dialect": "rigol_dp800",
            "supply.allow_no_watchdog": text,
            "supply.allow_single_session": "true",
        }
        words = [word for name, answer in said.items() for word in ("--set", f"{name}={answer}")]
        return main(["init", *words, "--out", str(tmp_path / "bench.yaml")])

    assert with_answer("false") == 1
    assert "supply.allow_no_watchdog" in capsys.readouterr().err
    assert with_answer("true") == 0
    assert read_parameter_file(tmp_path / "bench.yaml")["supply"]["watchdog_timeout"] == 0.0


@pytest.mark.parametrize(
    ("dialect", "asked_for"),
    (
        ("virtual_bench_supply", set()),
        ("keysight_n6700", {"allow_shared_watchdog", "allow_no_trips"}),
        ("rigol_dp800", {"allow_no_watchdog", "allow_single_session"}),
        ("kepco_bop", {"allow_no_watchdog", "allow_single_session", "allow_no_trips"}),
    ),
)
def test_all_that_the_supply_is_not_opened_without_is_asked(dialect, asked_for):
    mapping = {"instruments": {"supply": {"dialect": dialect}}}
    acknowledgements = [question for question in QUESTIONS if question.name.startswith("supply.allow_")]
    assert {q.name.removeprefix("supply.") for q in acknowledgements if q.when(mapping)} == asked_for


@pytest.mark.parametrize(
    ("rate_Hz", "timeout_s", "reading_timeout_s", "watchdog_s"),
    [(20.0, 0.2, None, 1.0), (5.0, 0.2, 0.6, 1.0), (4.0, 0.2, 0.65, 1.0), (1.0, 0.4, 2.0, 2.0), (1.0, 0.6, 2.2, 2.0)],
)
def test_a_slow_loop_gets_the_times_that_it_wants(tmp_path, rate_Hz, timeout_s, reading_timeout_s, watchdog_s):
    said = {**ANSWERS, "loop.rate": rate_Hz, "instruments.supply.timeout": timeout_s}
    said["instruments.daq.timeout"] = timeout_s
    words = [word for name, answer in said.items() for word in ("--set", f"{name}={answer}")]
    assert main(["init", *words, "--out", str(tmp_path / "bench.yaml")]) == 0
    written = read_parameter_file(tmp_path / "bench.yaml")
    assert written["safety"].get("reading_timeout") == reading_timeout_s
    assert written["supply"]["watchdog_timeout"] == watchdog_s


def test_a_trip_above_a_given_current_says_that_the_wire_does_not_survive_it():
    """It said that this was the current of 195 °C."""
    wire = {"alloy": "ni-ti", "length": 0.1, "diameter": 150e-6}
    survived = derived({"wire": wire, "supply": {"watchdog_timeout": 0.0}})["supply.over_current_trip"]
    trip = derived({"wire": wire, "supply": {"watchdog_timeout": 0.0, "max_current": 2.0}})["supply.over_current_trip"]
    assert trip.value == 2.0 and f"more than the {survived.value:g} A that the wire survives" in trip.why


@pytest.mark.parametrize("times", [0.6, 1.0, 1.2, 1.9, 30.0])
def test_limits_hold_for_still_air_whatever_loss_is_measured(times):
    """A fan may stop: a loss beyond a quarter more than usual, which still air may take, lets no more current flow."""
    wire = {"alloy": "ni-ti", "length": 0.1, "diameter": 0.1524e-3}
    still = derived({"wire": wire})
    mapping = {"wire": wire, "thermal": {"heat_loss": still["thermal.heat_loss"].value * times}}
    found = derived(mapping)
    share = min(times, 1.0) ** 0.5
    for name in ("supply.max_current", "supply.over_current_trip"):
        assert found[name].value == pytest.approx(still[name].value * share, rel=0.01)
        assert found[name].value <= still[name].value
    least_W_K = mapping["thermal"]["heat_loss"] / found["thermal.heat_loss_margin"].value
    assert least_W_K == pytest.approx(still["thermal.heat_loss"].value * min(times, 1.25) / 2.5, rel=0.01)
    for name, each in found.items():
        section, _, key = name.partition(".")
        mapping.setdefault(section, {}).setdefault(key, each.value)
    bench_from_mapping(mapping | {"instruments": {}})  # and such a file is taken


def test_a_watchdog_lets_a_wire_contract_that_loses_more_than_by_geometry():
    """As far as that is known; the gains stay, and without a watchdog a dead computer's current flows on."""
    mapping = {"wire": {"alloy": "ni-ti", "length": 0.1, "diameter": 0.1524e-3}}
    watched = derived(mapping)
    unwatched = derived(mapping | {"supply": {"watchdog_timeout": 0.0}})
    for name in ("supply.max_current", "supply.over_current_trip"):
        assert (watched[name].value / unwatched[name].value) ** 2 == pytest.approx(CAPACITY_WITHIN, rel=0.01)
    assert watched["controller.kp"].value == unwatched["controller.kp"].value


@pytest.mark.parametrize("times", [0.6, 1.0, 1.2, 1.9])
def test_without_a_watchdog_the_current_of_a_dead_computer_is_what_a_wire_in_still_air_survives(times):
    """By what is known of its heat loss, within a quarter, however much more a fan takes away now."""
    wire = {"alloy": "ni-ti", "length": 0.1, "diameter": 0.1524e-3}
    still_W_K = derived({"wire": wire})["thermal.heat_loss"].value
    mapping = {"wire": wire, "thermal": {"heat_loss": still_W_K * times}}
    assert "thermal.unwatched_margin" not in derived(mapping)
    margin = derived({**mapping, "supply": {"watchdog_timeout": 0.0}})["thermal.unwatched_margin"].value
    assert still_W_K * times / margin == pytest.approx(still_W_K * min(times, 1.25) / 1.25, rel=0.01)


@pytest.mark.parametrize("diameter_m", [37e-6, 50e-6])
def test_a_quick_wire_is_read_as_often_as_it_wants(diameter_m):
    """Ten readings in its time constant, as a calibration without ramps has; the blocks fit in between."""
    wire = {"alloy": "ni-ti", "length": 0.1, "diameter": diameter_m}
    found = {name: each.value for name, each in derived({"wire": wire}).items()}
    time_constant_s = found["thermal.heat_capacity"] / found["thermal.heat_loss"]
    assert Loop().rate * time_constant_s < QUICK_READINGS <= found["loop.rate"] * time_constant_s
    assert 0.8 < found["loop.samples_per_block"] / Loop().sample_rate * found["loop.rate"] <= 1.0
    slower = derived({"wire": wire, "loop": {"rate": 25.0}})  # as slow instruments want it
    assert slower["loop.samples_per_block"].value == 40


@pytest.mark.parametrize(("rate_Hz", "samples"), [(10.0, None), (50.0, 20), (100.0, 10)])
def test_a_rate_that_somebody_gives_gets_blocks_that_fit_in_between(tmp_path, rate_Hz, samples):
    """Of a wire that needs no quicker one too: `init` refused 50 Hz for the 50 samples that nobody had given."""
    words = [word for name, answer in ANSWERS.items() for word in ("--set", f"{name}={answer}")]
    assert main(["init", *words, "--set", f"loop.rate={rate_Hz}", "--out", str(tmp_path / "bench.yaml")]) == 0
    assert read_parameter_file(tmp_path / "bench.yaml")["loop"].get("samples_per_block") == samples


@pytest.mark.parametrize(
    ("diameter_m", "rate_Hz", "share"), [(50e-6, None, 1.0), (50e-6, 20.0, 0.45), (25e-6, None, 0.64)]
)
def test_gains_are_less_where_a_wire_is_not_read_as_often_as_it_wants(diameter_m, rate_Hz, share):
    """25 µm at 100 Hz, 7 readings in its time constant: with the usual gains the loop swings by 7 % of the stroke."""
    loop = {} if rate_Hz is None else {"loop": {"rate": rate_Hz}}
    found = derived({"wire": {"alloy": "ni-ti", "length": 0.1, "diameter": diameter_m}, **loop})
    usual = 4.0 * found["supply.max_current"].value / CAPACITY_WITHIN**0.5 / 4e-3
    assert found["controller.kp"].value == pytest.approx(share * usual, rel=0.05)
    assert ("readings" in found["controller.kp"].why) == (share < 1.0)


def test_a_wire_that_transforms_within_few_kelvins_gets_the_gain_with_which_it_comes_to_rest():
    """With the usual one a foreign wire of 12 K swung about its setpoint, by 4 % of the stroke, for as long as it was
    held."""
    mapping = read_parameter_file(shared_file("config/flexinol.yaml"))
    del mapping["controller"]
    home = mapping["calibration"]["power"]
    usual = derived(mapping)["controller.kp"]
    assert "a quarter of the full stroke" in usual.why
    for narrow in (0.3, 0.15):
        power = home | {
            name: [float(np.mean(home[name]) + narrow * (each_C - np.mean(home[name]))) for each_C in home[name]]
            for name in ("transformation_heating", "transformation_cooling")
        }
        mapping["calibration"]["power"] = power | {"latent_rise": narrow * home["latent_rise"]}
        found = derived(mapping)
        assert found["controller.kp"].value < usual.value and "few kelvins" in found["controller.kp"].why
        lag_s, kp, ki = mapping["estimator"]["thermal_time_constant"], found["controller.kp"], found["controller.ki"]
        assert ki.value == pytest.approx(3.0 * kp.value / lag_s, rel=0.03) and "a third" in ki.why
        assert _phase_left_deg(mapping, found["controller.kp"].value) == pytest.approx(30.0, abs=2.0)
        mapping["calibration"]["power"] = power | {"latent_rise": -15.0}  # by a heat capacity that is half too large
        least = derived(mapping)["controller.kp"]
        mapping["calibration"]["power"] = power | {"latent_rise": 0.0}
        assert least == derived(mapping)["controller.kp"] and 0.0 < least.value < found["controller.kp"].value
        mapping["calibration"]["power"] = power | {"latent_rise": narrow * home["latent_rise"]}
        # Also where the heat balance follows from the geometry, as in an `identify` that could not measure it.
        by_geometry = mapping | {"thermal": {"ambient_temperature": 24.0}}
        told = {name.partition(".")[2]: each.value for name, each in derived(by_geometry).items() if "thermal." in name}
        both = (by_geometry, mapping | {"thermal": told | by_geometry["thermal"]})
        assert len({derived(each)["controller.kp"] for each in both}) == 1
        assert "few kelvins" in derived(by_geometry)["controller.kp"].why


def _phase_left_deg(mapping, kp_A_m):
    """Of the loop on its flatter branch, at its gain of one: an integrator that is 1.5 periods late."""
    config = Config.for_tools(mapping)
    power, thermal, hot_Ohm = (
        config.calibration.power,
        config.thermal,
        config.wire.resistance_Ohm(HOT_RESISTIVITY_Ohm_m),
    )
    flat_K = min(np.ptp(power.transformation_heating), np.ptp(power.transformation_cooling))
    hottest_K = max(power.transformation_heating) + power.transformation_shift[1] * config.wire.max_stress - 24.0
    moved_W = 2.0 * math.sqrt(thermal.heat_loss * hottest_K * hot_Ohm)  # per ampere
    (_, short_m), (_, long_m) = config.calibration.ends
    m_J = (np.mean(long_m) - np.mean(short_m)) / (thermal.heat_capacity * (power.latent_rise + flat_K))
    crossover_1_s = kp_A_m * moved_W * m_J
    return 180.0 - 90.0 - math.degrees(crossover_1_s * 1.5 / config.loop.rate)


def test_a_section_with_nothing_in_it_is_none(tmp_path):
    start = tmp_path / "start.yaml"
    text = shared_file("config/flexinol_bench.yaml").read_text(encoding="utf-8")
    assert "    controller:\n" in text
    lines = [line for line in text.splitlines() if not line.startswith(("      kp:", "      ki:"))]
    start.write_text("\n".join(lines) + "\n", encoding="utf-8")
    words = ["init", "--start", str(start), "--set", "thermal.ambient_temperature=24"]
    assert main([*words, "--out", str(tmp_path / "wire.yaml")]) == 0
    assert read_parameter_file(tmp_path / "wire.yaml")["controller"]["kp"] == 400.0


@pytest.mark.parametrize("loop", [{}, {"rate": 40.0}], ids=["derived", "given"])
def test_how_often_a_wire_is_read_stays_when_what_was_derived_gives_way(loop):
    mapping = {"wire": {"alloy": "ni-ti", "length": 0.1, "diameter": 50e-6}, "loop": dict(loop)}
    for name, each in derived(mapping).items():
        section, _, key = name.partition(".")
        mapping.setdefault(section, {}).setdefault(key, each.value)
    left, names = without_derived(mapping)
    assert left["loop"] == mapping["loop"] and "thermal.heat_loss" in names
    bench_from_mapping(with_derived(left) | {"instruments": {}})


def test_how_old_a_reading_may_be_stays_too():
    """`check` says it of slow instruments, and `identify` ended at a file that had just what follows from them."""
    mapping = {
        "wire": {"alloy": "ni-ti-cu", "length": 0.06, "diameter": 0.2e-3},
        "loop": {"rate": 3.5, "samples_per_block": 1},
        "instruments": {"daq": {"timeout": 0.35}},
    }
    mapping["safety"] = {"reading_timeout": derived(mapping)["safety.reading_timeout"].value}
    left, _ = without_derived(mapping)
    assert bench_from_mapping(with_derived(left)).safety.reading_timeout == 0.84


def test_a_wire_that_is_no_quicker_than_usual_is_read_as_usual():
    assert not [
        name for name in derived({"wire": {"alloy": "ni-ti", "length": 0.1, "diameter": 0.1e-3}}) if "loop" in name
    ]


def test_limits_and_gains_that_were_derived_drive_the_wire(tmp_path):
    known = read_parameter_file(shared_file("config/flexinol.yaml"))
    kept = ("wire", "circuit", "load_cell", "reference_sensor", "estimator", "instruments", "model", "calibration")
    write_parameter_file(tmp_path / "model.yaml", {name: known[name] for name in kept}, "without limits and gains")
    out = tmp_path / "wire.yaml"
    words = ["init", "--start", str(tmp_path / "model.yaml"), "--set", "thermal.ambient_temperature=24"]
    assert main([*words, "--out", str(out)]) == 0
    mapping = read_parameter_file(out)
    assert Config.load(out).model_type == "flexinol"
    rig = Rig(mapping)
    rig.enable()
    for position_m in (2.5e-3, 1.2e-3, 2.0e-3):
        rig.track(position_m)
        rig.run(8.0)
        assert rig.status.fault == "", rig.status.message
        away_m = rig.bench.truth.displacement_m - position_m
        assert abs(away_m) < 0.03 * rig.config.wire.full_stroke_m


def test_a_rate_of_nothing_for_a_quick_wire_is_told(tmp_path, capsys):
    words = [word for name, answer in ANSWERS.items() for word in ("--set", f"{name}={answer}")]
    start = tmp_path / "start.yaml"
    start.write_text("sma_actuator: {ros__parameters: {thermal: {heat_capacity: 0.0005}, loop: {rate: 0.0}}}")
    assert main(["init", "--start", str(start), *words, "--out", str(tmp_path / "bench.yaml")]) == 1
    assert "loop.rate: 0 is outside its range" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("written", "instead", "said"),
    [
        ("load_cell:\n      slope: 12.7297\n      offset: -0.0598", "load_cell:", "load_cell: None is not a section"),
        ("max_current: 0.4", f"max_current: {10**400}", "supply.max_current"),
        ("dialect: virtual_bench_supply", "dialect: 5.0", "5.0"),
        ("branch_decision: heat_balance\n      thermal_time_constant: 5.0", "- none", "estimator holds ['none']"),
    ],
    ids=["an empty section", "more digits than a number has", "a dialect that is a number", "a list for a section"],
)
def test_what_is_wrong_in_the_file_that_it_starts_from_is_told(tmp_path, capsys, written, instead, said):
    text = shared_file("config/flexinol.yaml").read_text()
    assert written in text
    (start := tmp_path / "start.yaml").write_text(text.replace(written, instead).partition("    tables:")[0])
    assert main(["init", "--start", str(start), "--out", str(tmp_path / "wire.yaml")]) == 1
    assert said in capsys.readouterr().err


def test_what_is_said_overrules_the_file_that_it_starts_from(tmp_path, capsys):
    out, elsewhere = tmp_path / "wire.yaml", "TCPIP::192.168.0.9::5025::SOCKET"
    words = ["init", "--start", str(shared_file("config/flexinol.yaml")), "--set", "thermal.ambient_temperature=24"]
    assert main([*words, "--set", f"instruments.supply.resource={elsewhere}", "--out", str(out)]) == 0
    before, after = read_parameter_file(shared_file("config/flexinol.yaml")), read_parameter_file(out)
    assert after["instruments"]["supply"]["resource"] == elsewhere
    assert after["instruments"]["daq"] == before["instruments"]["daq"], "nothing else is asked anew"
    assert f"{elsewhere}, instead of the TCPIP::127.0.0.1::5025::SOCKET of" in " ".join(capsys.readouterr().err.split())


def test_another_instrument_is_asked_for_its_own_channels_and_for_what_it_lacks(tmp_path, capsys):
    """It kept the watchdog of the virtual bench, and the channel of a thermometer that the new DAQ has not."""
    out = tmp_path / "wire.yaml"
    words = ["init", "--start", str(shared_file("config/flexinol.yaml")), "--set", "thermal.ambient_temperature=24"]
    words += ["--set", "instruments.supply.dialect=rigol_dp800", "--set", "instruments.daq.dialect=keysight_daq970a"]
    assert main([*words, "--out", str(out)]) == 1
    assert "'supply.allow_no_watchdog' was asked" in " ".join(capsys.readouterr().err.split())
    for name in ("allow_no_watchdog", "allow_single_session"):
        words += ["--set", f"supply.{name}=true"]
    words += ["--set", "load_cell.slope=2.0", "--set", "loop.rate=1.5", "--set", "safety.reading_timeout=2.0"]
    words += ["--set", "loop.samples_per_block=1"]
    assert main([*words, "--out", str(out)]) == 0
    after = read_parameter_file(out)
    assert after["supply"]["watchdog_timeout"] == 0.0
    assert after["instruments"]["daq"].get("ambient_temperature_channel", 0) == 0
    assert after["instruments"]["daq"]["supply_voltage_channel"] == 101


@pytest.mark.parametrize("rate_Hz", ["3", "50"])
def test_what_follows_in_the_file_that_it_starts_from_follows_what_is_said_now(tmp_path, rate_Hz):
    """A thinner wire kept the current of the thicker one, and a slower loop its gains, as if somebody had given them;
    a quicker one was refused for the blocks."""
    changes = {"wire.diameter": "50e-6", "loop.rate": rate_Hz}

    def written(name, answers, *words):
        said = [word for each in answers.items() for word in ("--set", "=".join(each))]
        assert main(["init", *words, *said, "--out", str(tmp_path / name)]) == 0
        return read_parameter_file(tmp_path / name)

    given = {**ANSWERS, "safety.load_spike": "0.5"}
    thick = written("thick.yaml", given | {"wire.diameter": "75e-6"})
    thin = written("thin.yaml", changes, "--start", str(tmp_path / "thick.yaml"))
    assert "samples_per_block" in thick["loop"] and thin == written("anew.yaml", given | changes)
    assert thin["supply"]["max_current"] < thick["supply"]["max_current"]


@pytest.mark.parametrize(
    "name", [f"{wire}{kind}" for wire in ("flexinol", "furukawa") for kind in ("", "_bench", "_normalised")]
)
def test_the_shipped_files_carry_the_gains_that_follow_from_their_wire(name):
    mapping = read_parameter_file(shared_file(f"config/{name}.yaml"))
    follows = {
        key.removeprefix("controller."): each.value for key, each in derived(mapping).items() if "controller." in key
    }
    assert mapping["controller"] == follows


def _refused(folder):
    """Run in a process of its own, which becomes a user whom permissions bind."""
    if os.geteuid() == 0:
        os.setuid(65534)
    with pytest.raises(UserError, match=rf"{folder}/new/bench.yaml: cannot be written, .* in {folder}; name a file"):
        refuse_to_overwrite(SimpleNamespace(force=True), Path(folder) / "new" / "bench.yaml")


def test_a_folder_that_is_not_ours_is_named_before_anything_is_asked():
    child = multiprocessing.get_context("spawn").Process(target=_refused, args=("/etc",), daemon=True)
    child.start()
    child.join(60.0)
    assert child.exitcode == 0, "what it said is on standard error"


def test_what_a_file_leaves_out_counts_as_what_its_section_has_by_default():
    wire = {"alloy": "ni-ti", "length": 0.1, "diameter": 0.1524e-3}
    defaults = {f.name: f.default for f in dataclasses.fields(ThermalParameters)}
    written = {name: defaults[name] for name in ("ambient_temperature", "derate_temperature", "max_temperature")}
    spelled_out = derived({"wire": wire, "thermal": written, "supply": {"watchdog_timeout": 1.0}})
    assert derived({"wire": wire}) == spelled_out


@pytest.mark.parametrize(
    ("said", "wanted"),
    [
        ("192.168.1.5", "TCPIP::192.168.1.5::5025::SOCKET, with the port that its manual has, is wanted"),
        ("192.168.1.5:5555", "TCPIP::192.168.1.5::5555::SOCKET is wanted"),
        ("/dev/ttyUSB0", "ASRL/dev/ttyUSB0::INSTR is wanted"),
        ("the supply", "TCPIP::192.168.0.5::5025::SOCKET or ASRL/dev/ttyUSB0::INSTR (docs/dialects.md) is wanted"),
    ],
)
@pytest.mark.parametrize("instrument", ["supply", "daq"])
def test_an_address_that_is_no_resource_is_refused_with_what_it_is_as_one(tmp_path, given, said, wanted, instrument):
    name, out = f"instruments.{instrument}.resource", tmp_path / "bench.yaml"
    words = [word for key, value in (ANSWERS | {name: said}).items() for word in ("--set", f"{key}={value}")]
    done = given(*words, "--out", out)
    assert f"{name}: '{said}' is no VISA resource; {wanted}" in done.stderr and done.returncode == 1
    assert not out.exists()


def test_a_device_of_a_makers_package_has_a_name_of_its_own(tmp_path):
    answers = {name: value for name, value in ANSWERS.items() if name != "instruments.daq.dialect"}
    answers |= {"instruments.daq.package": "nidaqmx", "instruments.daq.resource": "Dev1"}
    words = [word for key, value in answers.items() for word in ("--set", f"{key}={value}")]
    assert main(["init", *words, "--out", str(tmp_path / "bench.yaml")]) == 0


def test_more_volts_than_there_are_are_blamed_on_the_resistance_that_wants_them(tmp_path, given):
    words = [word for key, value in ANSWERS.items() for word in ("--set", f"{key}={value}")]
    out = ("--out", tmp_path / "bench.yaml")
    done = given(*words, "--set", "circuit.reference_resistance=1kohm", *out)
    assert "init: circuit.reference_resistance: 1000 Ω and a wire of 5.48 Ω want" in done.stderr
    assert "a fifth of the wire's resistance or less" in done.stderr
    done = given(*words, "--set", "wire.length=3m", *out)
    assert "init: wire.length, wire.diameter: a wire of 164 Ω and its sense resistor want" in done.stderr


def test_a_control_law_and_its_own_parameters_may_be_asked_for(tmp_path, given):
    words = [word for key, value in ANSWERS.items() for word in ("--set", f"{key}={value}")]
    out = tmp_path / "bench.yaml"
    law = ("--set", "controller.type=feed_forward_pid", "--set", "controller.feed_forward=0.5")
    assert main(["init", *words, *law, "--out", str(out)]) == 0
    assert read_parameter_file(out)["controller"]["feed_forward"] == 0.5
    done = given(*words, "--set", "controller.type=quick", "--out", tmp_path / "other.yaml")
    assert "controller.type: 'quick' is not one of" in done.stderr and "feed_forward_pid" in done.stderr


def test_the_compliance_voltage_is_enough_for_leads_that_nobody_has_measured_yet():
    """0.25 Ω beside the 0.7 of a cold coil of 0.5 mm: 1.9 V did not drive what it may have: the node went off."""
    coil = {"alloy": "ni-ti-cu", "form": "coil", "length": 0.132, "diameter": 0.5e-3, "coil_diameter": 3.5e-3}
    mapping = {"wire": coil, "circuit": {"reference_resistance": 0.1}}
    found = derived(mapping)
    cold_Ohm = 0.695 + 0.1 + 0.25
    assert found["supply.max_voltage"].value > 1.05 * cold_Ohm * found["supply.max_current"].value
    measured = derived({**mapping, "circuit": {"reference_resistance": 0.1, "lead_resistance": 0.25}})
    assert measured["supply.max_voltage"].value < found["supply.max_voltage"].value
