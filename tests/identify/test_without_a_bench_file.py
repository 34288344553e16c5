"""Logs in physical units and three words about the wire are enough; raw channels want their calibrations."""

import dataclasses
import json

import pytest
from characterised import virtual_rig

from sma_actuator.base.balance import Balance
from sma_actuator.base.sections import Wire
from sma_actuator.characterise.programs import held_currents
from sma_actuator.cli.main import main
from sma_actuator.config import Config, bench_from_mapping, read_parameter_file
from sma_actuator.derived import DENSITY_kg_m3, still_air_W_K, with_derived
from sma_actuator.identify.measured import _Contracted, _heat_capacity, _may_be, heat_balance
from sma_actuator.logs.bench_log import BenchLog, read_bench_log, signals_from_log, write_bench_log
from sma_actuator.logs.kinds import make_experiments
from sma_actuator.plant.loads import Weight

WIRE = ["--alloy", "ni-ti", "--length", "0.1", "--diameter", "0.1524e-3"]


def as_a_stranger_has_them(characterised, folder):
    """The wire's logs in SI units, nothing beside them, surroundings not measured."""
    config = bench_from_mapping(characterised.mapping)
    for log in characterised.only("pulses", "partial"):
        s = signals_from_log(log, config)
        columns = {
            "time_s": s.time_s,
            "resistance_Ohm": s.resistance_Ohm,
            "current_A": s.current_A,
            "load_N": s.load_N,
            "displacement_m": s.reference_displacement_m,
        }
        write_bench_log(folder / log.name, BenchLog(columns))
    return folder


def model_of(logs, out):
    """The model file that the command writes from them, second order."""
    assert main(["identify", str(logs), *WIRE, "--order", "2", "--no-extension", "--out", str(out), "-q"]) == 0
    return out


@pytest.fixture(scope="module")
def foreign(flexinol, tmp_path_factory):
    return as_a_stranger_has_them(flexinol, tmp_path_factory.mktemp("foreign"))


@pytest.fixture(scope="module")
def model(foreign, tmp_path_factory):
    return model_of(foreign, tmp_path_factory.mktemp("model") / "my_wire.yaml")


def test_a_wire_that_goes_on_transforming_while_it_cools_tells_its_heat_loss_too(flexinol, model):
    """The one of home: nowhere does its resistance move with the temperature alone."""
    known, found = flexinol.mapping["thermal"], read_parameter_file(model)["thermal"]
    assert found["heat_capacity"] / found["heat_loss"] == pytest.approx(
        known["heat_capacity"] / known["heat_loss"], rel=0.1
    )
    assert found["heat_loss"] == pytest.approx(known["heat_loss"], rel=0.2)


@pytest.mark.parametrize("every, told", [(4, True), (20, False)])
def test_slow_logs_tell_the_heat_loss_or_nothing(textbook, tmp_path, every, told):
    """At 5 Hz as at 20 Hz; where a second passes between two readings there are too few of the contracted wire."""
    folder = as_a_stranger_has_them(textbook, tmp_path)
    bench = bench_from_mapping(with_derived({"wire": {"alloy": "ni-ti", "length": 0.1, "diameter": 0.1524e-3}}))
    logs = [read_bench_log(path) for path in sorted(folder.glob("*.csv"))]
    slow = [dataclasses.replace(log, columns={name: v[::every] for name, v in log.columns.items()}) for log in logs]
    found = heat_balance(make_experiments(slow, bench), bench)
    known = textbook.mapping["thermal"]
    assert (found is not None) == told
    if found is not None:
        assert found.time_constant_s == pytest.approx(known["heat_capacity"] / known["heat_loss"], rel=0.1)
        assert found.near_share == 0.0, "it hangs in the open"


def test_a_wire_that_is_held_part_of_the_way_tells_nothing_of_a_contracted_one(flexinol):
    """What moves its resistance there is that it transforms."""
    _, rig, _ = virtual_rig("flexinol", seed=4, load=Weight(0.98))
    with rig.opened():
        held = rig.record(held_currents([0.05, 0.15, 0.16, 0.18], 8.0, 12.0))
    bench = bench_from_mapping(flexinol.mapping)
    pulses, more = (make_experiments(logs, bench) for logs in (flexinol.only("pulses"), [held]))
    assert len(_Contracted(more[:1], bench).rows) > 100, "as near to its shortest, for long"
    found = heat_balance(pulses, bench)
    assert found is not None
    assert heat_balance([*pulses, *more], bench) == found


@pytest.mark.long  # of the wire of home, above
def test_of_the_wire_of_the_textbook_the_logs_tell_the_heat_balance_too(textbook, tmp_path):
    found = read_parameter_file(model_of(as_a_stranger_has_them(textbook, tmp_path), tmp_path / "w.yaml"))["thermal"]
    known = textbook.mapping["thermal"]
    assert found["heat_capacity"] / found["heat_loss"] == pytest.approx(
        known["heat_capacity"] / known["heat_loss"], rel=0.1
    )
    assert found["heat_loss"] == pytest.approx(known["heat_loss"], rel=0.2)


def test_what_the_logs_tell_is_written_with_its_reason(model):
    mapping = read_parameter_file(model)
    assert mapping["supply"] == {"bias_current": pytest.approx(0.05, rel=0.1)}
    assert 1.5 <= mapping["estimator"]["thermal_time_constant"] <= 15.0
    assert mapping["safety"]["resistance_min"] < 4.3 and mapping["safety"]["resistance_max"] > 5.5
    text = model.read_text()
    assert "heat_loss:" in text and "# heat_capacity over" in text
    assert "load_cell" not in mapping and "controller" not in mapping, "nobody measured or chose them"


def test_replay_and_trace_run_on_that_file(model, foreign, tmp_path, capsys):
    log = str(foreign / "partial_1.200N.csv")
    assert main(["replay", log, "--config", str(model), "--json", "-"]) == 0
    (row,) = json.loads(capsys.readouterr().out)
    assert row["working_percent"] < 2.0, "identify calls such a model good"
    out = tmp_path / "traced"
    assert (
        main(
            [
                "trace",
                str(foreign),
                "--config",
                str(model),
                "--only",
                "lead_resistance",
                "--jobs",
                "1",
                "--out",
                str(out),
            ]
        )
        == 0
    )
    assert json.loads((out / "report.json").read_text())["verdict"] in ("none", "traced", "unexplained")


def test_a_node_refuses_that_file_in_sentences_that_name_what_it_lacks(model):
    with pytest.raises(ValueError, match="supply.max_current: missing"):
        Config.load(model)


def raw(flexinol, folder, *channels):
    """A raw log of the bench without some columns, and with the load in newtons unless its channel is left."""
    log = flexinol.only("pulses_1.200N")[0]
    s = signals_from_log(log, bench_from_mapping(flexinol.mapping))
    columns = {name: values for name, values in log.columns.items() if name in ("time_s", *channels)}
    columns.setdefault("displacement_m", s.reference_displacement_m) if "lvdt_current_A" not in channels else None
    columns.setdefault("load_N", s.load_N) if "load_cell_voltage_V" not in channels else None
    if "supply_voltage_V" not in channels:
        columns |= {"resistance_Ohm": s.resistance_Ohm, "current_A": s.current_A}
    write_bench_log(folder / "log.csv", dataclasses.replace(log, columns=columns, metadata={}))
    return str(folder / "log.csv")


@pytest.mark.parametrize(
    "channels, sentence",
    [
        (("supply_voltage_V", "reference_voltage_V"), "circuit.reference_resistance in ohms is wanted"),
        (("load_cell_voltage_V",), "load_cell.slope in N/V and load_cell.offset in N are wanted"),
        (("lvdt_current_A",), "reference_sensor.slope in m/A and reference_sensor.offset in m are wanted"),
    ],
    ids=["sense resistor", "load cell", "displacement"],
)
def test_a_raw_channel_without_its_calibration_is_refused_in_a_sentence(flexinol, tmp_path, capsys, channels, sentence):
    log = raw(flexinol, tmp_path, *channels)
    assert main(["identify", log, *WIRE, "--out", str(tmp_path / "m.yaml")]) == 1
    error = capsys.readouterr().err
    assert sentence in error and "log.csv: line 1, column" in error
    assert not (tmp_path / "m.yaml").exists()


def test_what_is_missing_of_the_wire_is_said(tmp_path, capsys):
    assert main(["identify", "no.csv", "--alloy", "ni-ti", "--out", str(tmp_path / "m.yaml")]) == 1
    assert "--length and --diameter" in capsys.readouterr().err


@pytest.mark.parametrize("text", ["3.7", "abc", "[150e-6]", "null"])
def test_a_file_whose_wire_is_no_section_is_told_so(text, tmp_path, capsys):
    """Whether nothing beside it is said of the wire, or all of it."""
    bench = tmp_path / "bench.yaml"
    bench.write_text(f"sma_actuator:\n  ros__parameters:\n    wire: {text}\n")
    for words in ([], WIRE, ["--set", "wire.length=0.1"]):
        assert main(["identify", "no.csv", "--config", str(bench), *words, "--out", str(tmp_path / "m.yaml")]) == 1
        assert "is not a section of parameters" in capsys.readouterr().err


def test_a_node_that_has_no_calibration_of_its_load_cell_drives_nothing(make_rig):
    with pytest.raises(ValueError, match="load_cell.slope, load_cell.offset: missing"):
        make_rig(load_cell={"slope": float("nan"), "offset": float("nan")})


def test_calibrations_may_be_given_one_by_one(flexinol, tmp_path, capsys):
    log = str(flexinol.folder / "pulses_1.200N.csv")
    given = [
        f"{section}.{name}={value}"
        for section in ("circuit", "load_cell", "reference_sensor")
        for name, value in flexinol.mapping[section].items()
    ]
    words = [word for one in given for word in ("--set", one)]
    assert main(["identify", log, *WIRE, *words, "--out", str(tmp_path / "m.yaml")]) == 0
    said = capsys.readouterr().out
    assert "for one load, 1.2 N" in said
    assert "model: flexinol: whole_range: 3 logs or cycles at least" in said  # the log holds two


class TestHeatCapacity:
    """Logs tell how quickly a wire cools; geometry what it loses, and calorimetry between what it holds."""

    WIRE = Wire(alloy="ni-ti", length=0.1, diameter=0.3e-3)

    def found(self, specific_heat_J_kgK, times_still_air=1.0, **thermal):
        """Over the true one; the heat loss follows from it."""
        held_J_K = DENSITY_kg_m3 * self.WIRE.volume_m3 * specific_heat_J_kgK
        loss_W_K = times_still_air * still_air_W_K(self.WIRE)
        mapping = {"wire": {"alloy": "ni-ti", "length": 0.1, "diameter": 0.3e-3}, "thermal": thermal}
        capacity_J_K = _heat_capacity(mapping, self.WIRE, Balance(held_J_K / loss_W_K), "").value
        return capacity_J_K / held_J_K

    @pytest.mark.parametrize("specific_heat_J_kgK", [460.0, 600.0, 830.0])
    def test_is_that_of_a_wire_in_still_air_whatever_it_is_made_of(self, specific_heat_J_kgK):
        """With the maker's figure alone a wire that has what calorimetry gives was called 1.8 times too lossy."""
        assert self.found(specific_heat_J_kgK) == pytest.approx(1.0, rel=0.01)

    def test_errs_as_geometry_does_where_more_is_lost_than_that(self):
        assert self.found(800.0, 1.2) == pytest.approx(1.0 / 1.2, rel=0.01)

    def test_of_one_in_a_fan_s_wind_is_the_least_that_such_wires_have(self):
        assert self.found(500.0, 2.0) == pytest.approx(450.0 / 500.0, rel=0.01)

    def test_goes_with_a_heat_loss_that_was_given(self):
        given_W_K = 1.5 * still_air_W_K(self.WIRE)
        assert self.found(600.0, 1.5, heat_loss=given_W_K) == pytest.approx(1.0, rel=0.01)

    def test_that_was_given_stays(self):
        held_J_K = DENSITY_kg_m3 * self.WIRE.volume_m3 * 600.0
        assert self.found(600.0, heat_capacity=2.0 * held_J_K) == pytest.approx(2.0)

    @pytest.mark.parametrize("specific_heat_J_kgK, times_still_air", [(450.0, 2.4), (837.0, 0.42)])
    def test_a_wire_that_cools_so_quickly_or_slowly_is_believed(self, specific_heat_J_kgK, times_still_air):
        """One with 500 J/(kg K) that loses a fifth more than still air takes was not, and had the maker's figure."""
        held_J_K = DENSITY_kg_m3 * self.WIRE.volume_m3 * specific_heat_J_kgK
        usual_s = held_J_K / still_air_W_K(self.WIRE)
        assert _may_be(Balance(usual_s / times_still_air), self.WIRE)
        assert not _may_be(Balance(usual_s / times_still_air * (0.9 if times_still_air > 1.0 else 1.1)), self.WIRE)


@pytest.mark.parametrize("out", ["", ".", "folder"])
def test_a_folder_is_no_file_of_a_model(tmp_path, monkeypatch, capsys, out):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder").mkdir()
    assert main(["identify", "nowhere.csv", "--force", "--out", out]) == 1
    assert f"--out {out or '.'}: is a folder; name a file, in it or elsewhere" in capsys.readouterr().err
