"""A displacement that counts contraction is refused, by `identify` and by whatever loads a model: it would heat without
end."""

import copy
import dataclasses

import numpy as np
import pytest
from characterised import virtual_rig

from sma_actuator.base.parameters import ConfigError
from sma_actuator.base.share import shared_file
from sma_actuator.characterise.programs import square_pulses
from sma_actuator.cli.main import main
from sma_actuator.config import Config, read_parameter_file
from sma_actuator.estimation.lag import lagged
from sma_actuator.identify import IdentificationError, identify
from sma_actuator.identify.identification import _refuse_contraction as refuse_contraction
from sma_actuator.logs.bench_log import BenchLog, signals_from_log, write_bench_log
from sma_actuator.logs.kinds import make_experiments
from sma_actuator.logs.sense import log_counts_contraction
from sma_actuator.plant.loads import Weight

TURNED = (
    "heating_slope",
    "heating_intercept",
    "cooling_slope",
    "cooling_intercept",
    "mechanical_strain",
    "stroke_strain",
)
TURNED += tuple(f"{branch}_G{power}" for branch in ("heating", "cooling") for power in range(3))


def in_physical_units(log, config, sign=1.0):
    """A log of another maker: time, resistance, current, load and a displacement that counts as its sensor does."""
    signals = signals_from_log(log, config)
    columns = {
        "time_s": signals.time_s,
        "resistance_Ohm": signals.resistance_Ohm,
        "current_A": signals.current_A,
        "load_N": signals.load_N,
        "displacement_m": sign * signals.reference_displacement_m,
    }
    return BenchLog(columns, source=log.source)


@pytest.mark.parametrize("model", ("flexinol", "whole_range"))
def test_identify_refuses_logs_that_count_contraction_and_says_how_to_turn_them(flexinol, model):
    mapping = copy.deepcopy(flexinol.mapping)
    for name in ("slope", "offset"):
        mapping["reference_sensor"][name] *= -1.0
    with pytest.raises(
        IdentificationError, match=r"all 9 logs: .* counts contraction.* Turn the signs of reference_sensor.slope"
    ):
        identify(flexinol.logs, mapping, model)


@pytest.mark.parametrize("model", ("flexinol", "whole_range"))
def test_identify_refuses_logs_in_which_nothing_moves(flexinol, model):
    logs = [
        dataclasses.replace(log, columns={**log.columns, "lvdt_current_A": np.full(len(log), 0.01)})
        for log in flexinol.logs
    ]
    with pytest.raises(IdentificationError, match="the displacement does not move; see whether the sensor"):
        identify(logs, flexinol.mapping, model)


def test_the_command_that_asked_for_the_wrong_sign_is_told_the_right_option(flexinol, tmp_path, capsys):
    config = Config.load(shared_file("config/flexinol.yaml"))
    for log in flexinol.only("pulses"):
        write_bench_log(tmp_path / log.name, in_physical_units(log, config, -1.0))
    words = [
        "identify",
        str(tmp_path),
        "--alloy",
        "ni-ti",
        "--length",
        "0.1",
        "--diameter",
        "0.1524e-3",
        "--model",
        "flexinol",
    ]
    out = ["--out", str(tmp_path / "wire.yaml")]
    assert main([*words, "--unit", "displacement_m=m", *out]) == 1
    said = capsys.readouterr().err
    assert "counts contraction" in said and "--unit displacement_m=-mm" in said
    assert not (tmp_path / "wire.yaml").exists()
    assert main(["check-log", str(tmp_path), "--unit", "displacement_m=m"]) == 1  # it says the same
    assert "grows with the heat" in capsys.readouterr().out
    assert main(["check-log", str(tmp_path), "--unit", "displacement_m=-m"]) in (0, 1)
    assert "grows with the heat" not in capsys.readouterr().out


@pytest.mark.parametrize("file", ("flexinol", "flexinol_normalised", "furukawa", "furukawa_normalised"))
def test_a_model_file_that_is_turned_round_is_not_loaded(file):
    mapping = read_parameter_file(shared_file(f"config/{file}.yaml"))
    Config.from_mapping(mapping)
    model = mapping["model"]
    for name in TURNED:
        if name in model:
            model[name] = [-value for value in model[name]]
    for name in ("displacement_range", "strain_range"):
        if name in model:
            model[name] = [-value for value in reversed(model[name])]
    mapping.pop("calibration", None)
    with pytest.raises(
        ConfigError, match=r"model: its displacement falls as the resistance rises.*--unit displacement_m=-mm"
    ):
        Config.from_mapping(mapping)


def test_a_calibration_with_the_hot_wire_longer_than_the_cold_one_is_not_loaded():
    mapping = read_parameter_file(shared_file("config/flexinol.yaml"))
    known = Config.from_mapping(mapping).calibration
    mapping["calibration"] = {
        **mapping["calibration"],
        "rest": {
            **mapping["calibration"]["rest"],
            "hot_displacement": list(known.rest.cold_displacement),
            "cold_displacement": list(known.rest.hot_displacement),
        },
    }
    with pytest.raises(ConfigError, match=r"calibration.rest.hot_displacement: the wire is longer hot than cold"):
        Config.from_mapping(mapping)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("resistance", [1.0, -1.0])
@pytest.mark.parametrize("kind", ["pulses", "partial"])
def test_the_heat_says_which_way_it_counts_whatever_the_resistance_does(flexinol, kind, resistance, sign):
    """There are Ni-Ti wires whose resistance rises as they contract."""
    config = Config.load(shared_file("config/flexinol.yaml"))
    for log in flexinol.only(kind):
        columns = in_physical_units(log, config, sign).columns
        shown_Ohm = 8.0 + resistance * (columns["resistance_Ohm"] - 8.0)
        assert log_counts_contraction(BenchLog({**columns, "resistance_Ohm": shown_Ohm})) is (sign < 0.0)


@pytest.mark.parametrize("seed", range(3))
def test_noise_alone_is_not_told_to_count_contraction(seed):
    random = np.random.default_rng(seed)
    columns = {
        name: random.normal(5.0, 0.1, 2000) for name in ("resistance_Ohm", "current_A", "displacement_m", "load_N")
    }
    assert not log_counts_contraction(BenchLog({"time_s": np.arange(2000) * 0.05, **columns}))


def test_a_wire_that_was_held_back_from_contracting_expands_and_says_nothing(furukawa):
    """By a guard that knows no such wire, or by a weight that needs more heat than was given."""
    config = Config.load(shared_file("config/furukawa.yaml"))
    _, rig, _ = virtual_rig("furukawa", seed=3, load=Weight(2.5))
    with rig.opened():
        columns = in_physical_units(rig.record(square_pulses(3, 0.20, 0.05, 6.0, 6.0)), config).columns
    rise_K = 2e3 * lagged(np.arange(len(columns["time_s"])), columns["current_A"] ** 2, 30.0)
    expands_m = np.max(columns["displacement_m"]) + 11e-6 * rise_K * config.wire.length
    held_back = BenchLog({**columns, "displacement_m": expands_m})
    assert log_counts_contraction(held_back)  # for all that it shows
    logs = [*furukawa.only("pulses", "partial"), held_back]
    assert identify(logs, furukawa.mapping, "furukawa", order=1).mapping["model"]


def test_of_one_sensor_what_most_logs_say_counts_and_of_the_others_it_is_told(flexinol):
    """A log of few motions with a guard in them may look turned; it is no reason to refuse all the others."""
    config = Config.load(shared_file("config/flexinol.yaml"))
    *logs, odd = flexinol.only("pulses", "partial")
    turned = in_physical_units(odd, config)
    turned.columns["displacement_m"] = 5e-3 - turned["displacement_m"]
    said = identify([*logs, turned], flexinol.mapping, "flexinol", order=1).notes
    assert any("grows while the wire is heated, in the others it falls" in sentence for sentence in said)
    with pytest.raises(IdentificationError, match="counts contraction"):
        identify([turned], flexinol.mapping, "flexinol")


def test_a_stretch_in_which_no_displacement_was_measured_says_nothing_of_its_sense(flexinol):
    """A sensor that fell off while one weight of a log hung there."""
    config = Config.load(shared_file("config/flexinol.yaml"))
    *_, last = make_experiments(flexinol.only("pulses"), config)
    signals = dataclasses.replace(last.signals, reference_displacement_m=np.full(len(last.displacement_m), np.nan))
    blind = dataclasses.replace(last, signals=signals)
    refuse_contraction([last, blind], config.wire.strain_length_m, pytest.fail)
