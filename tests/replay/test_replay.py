"""Replay: the same numbers as the node's estimator, honest errors, baselines that learn, recordings that become
logs."""

import dataclasses
import json
import math
import warnings

import numpy as np
import pytest
from characterised import virtual_rig

from sma_actuator.base.signals import Signals
from sma_actuator.cli.identify import write_model
from sma_actuator.cli.main import main
from sma_actuator.estimation.chain import Chain
from sma_actuator.identify.fitters.fitting import make_data
from sma_actuator.identify.verdict.errors import log_error
from sma_actuator.logs.bench_log import read_bench_log
from sma_actuator.logs.errors import BenchLogError
from sma_actuator.logs.experiments import make_experiment
from sma_actuator.logs.kinds import make_experiments
from sma_actuator.replay import estimate_m, log_from_bag, replay
from sma_actuator.replay.baselines import Duhem, NeuralNetwork, PolynomialInResistance, TwoLines, all_baselines
from sma_actuator.replay.replaying import verdict, winners


@pytest.fixture
def model(identified_flexinol):
    """The identified Ni-Ti wire."""
    return identified_flexinol


def test_a_replay_gives_what_the_node_would_have_given(flexinol, model):
    log = flexinol.only("partial_0.600N")[0]
    experiment = make_experiment(log, model.config)
    estimator = Chain(model.config)
    s = experiment.signals
    one_by_one = []
    for k in range(len(log)):
        fields = (s.time_s, s.resistance_Ohm, s.current_A, s.power_W, s.load_N, s.stress_Pa)
        one_by_one.append(estimator.step(Signals(*(float(f[k]) for f in fields)))[1].displacement_m)
    np.testing.assert_allclose(estimate_m(experiment, model.config), one_by_one, rtol=1e-12)


def test_errors_are_counted_as_the_thesis_counts_them():
    measured_mm = np.array([0.0, 1.0, 2.0, 3.0, np.nan])
    estimate_mm = np.array([1.0, 1.2, 1.9, 2.0, 1.0])
    nothing = np.zeros(5)
    signals = Signals(nothing, nothing, nothing, nothing, nothing + 0.5, nothing, measured_mm * 1e-3)
    error = log_error("a", signals, estimate_mm * 1e-3, (0.5e-3, 2.5e-3), 4e-3)
    assert error.working_percent == pytest.approx((0.2 + 0.1) / 2 / 4 * 100)
    assert error.working_share == 2 / 5
    assert error.full_percent == pytest.approx((1.0 + 0.2 + 0.1 + 1.0) / 4 / 4 * 100)


def test_taking_a_changing_load_for_constant_costs_accuracy(flexinol, model):
    experiment = make_experiment(flexinol.only("partial_2.000N")[0], model.config)
    right, wrong = estimate_m(experiment, model.config), estimate_m(experiment, model.config, constant_load_N=0.3)
    assert np.abs(wrong - experiment.displacement_m).mean() > 5 * np.abs(right - experiment.displacement_m).mean()


def test_a_log_without_an_estimate_is_not_taken_for_one_without_a_displacement(flexinol, model):
    log = flexinol.only("partial_0.600N")[0]
    (judged,) = replay([log], {"flexinol": model.config})
    errors = {"flexinol": dataclasses.replace(judged.errors["flexinol"], full_percent=math.nan)}
    word, said = verdict([dataclasses.replace(judged, errors=errors)], model.config)
    assert word == "not judged" and said.startswith("flexinol has no estimate anywhere in this log")


def test_a_log_is_held_to_a_calibration_by_the_error_that_it_would_have_there(flexinol, model):
    """A bench without a sensor of the room: replayed as in a node, its own log was 0.79 % off, and 0.46 there; `replay`
    said that something has changed."""
    (found,) = replay(flexinol.only("partial_0.600N"), {"flexinol": model.config})
    largest = max(model.config.calibration.error, model.config.calibration.largest_error)
    assert 0.0 < found.judged_percent < 1.5 * largest
    errors = {"flexinol": dataclasses.replace(found.errors["flexinol"], full_percent=2.0 * largest)}
    word, said = verdict([dataclasses.replace(found, errors=errors)], model.config)
    assert word == "as calibrated" and "learns from motion of its surroundings" in said
    changed = dataclasses.replace(found, errors=errors, judged_percent=2.0 * largest)
    assert verdict([changed], model.config)[0] == "changed"


def in_the_world_of(experiments, rule):
    """Experiments whose displacement follows ``rule(experiment)`` [m]."""
    return [
        dataclasses.replace(t, signals=dataclasses.replace(t.signals, reference_displacement_m=rule(t)))
        for t in experiments
    ]


def make_all_count(data, experiments):
    """Data in which every sample counts."""
    displacement_m = np.concatenate([t.displacement_m for t in experiments])
    return dataclasses.replace(
        data, experiments=tuple(experiments), displacement_m=displacement_m, counts=np.ones(len(displacement_m), bool)
    )


@pytest.mark.parametrize(
    "baseline, rule",
    [
        (PolynomialInResistance(1), lambda t: 3e-3 * t.resistance_Ohm - 12e-3),
        (PolynomialInResistance(3), lambda t: 1e-3 * (t.resistance_Ohm - 4.8) ** 3),
        (TwoLines(), lambda t: np.where(t.heating, 3e-3, 5e-3) * (t.resistance_Ohm - 4.2)),
        (NeuralNetwork(), lambda t: 3e-3 * np.tanh(t.resistance_Ohm - 4.8) + 2e-12 * t.stress_Pa),
    ],
    ids=lambda value: getattr(value, "name", ""),
)
def test_a_baseline_learns_the_world_it_was_made_for(flexinol, model, baseline, rule):
    experiments = make_experiments(flexinol.only("partial"), model.config)
    data = make_data(make_experiments(flexinol.only("partial", "pulses"), model.config), 4e-3)
    experiments = in_the_world_of(experiments, rule)
    baseline.fit(make_all_count(data, experiments))
    for experiment in experiments:
        assert np.abs(baseline.predict(experiment) - experiment.displacement_m).mean() < 0.01 * 4e-3


def test_the_duhem_model_learns_a_loop_that_lines_cannot(flexinol, model):
    experiments = make_experiments(flexinol.only("pulses_0.600N", "partial_0.600N"), model.config)
    data = make_data(experiments, model.config.wire.full_stroke_m)
    errors = {}
    for baseline in (Duhem(), PolynomialInResistance(1)):
        baseline.fit(data)
        estimate = np.concatenate([baseline.predict(t) for t in experiments])
        errors[type(baseline)] = np.abs(estimate - data.displacement_m)[data.counts].mean()
    assert errors[Duhem] < 0.5 * errors[PolynomialInResistance]


def test_the_identified_model_wins_over_what_ignores_the_load(flexinol, model):
    logs = flexinol.only("partial")
    replays = replay(logs, {"flexinol": model.config}, flexinol.only("pulses", "partial"))
    names = {b.name for b in all_baselines()} | {"flexinol"}
    assert all(set(r.errors) == names for r in replays)
    for r in replays:
        assert r.errors["flexinol"].working_percent < r.errors["linear in λ (2.16, 2.17)"].working_percent
    assert {row[0] for row in winners(replays)} == {log.name for log in logs}


def test_missing_readings_are_bridged_and_not_judged(flexinol, model):
    log = flexinol.only("partial_0.600N")[0]
    columns = {k: v.copy() for k, v in log.columns.items()}
    columns["load_cell_voltage_V"][100:110] = np.nan
    with_gap = dataclasses.replace(log, columns=columns)
    (r,) = replay([with_gap], {"flexinol": model.config}, flexinol.only("pulses"))
    assert r.errors["flexinol"].working_percent < 2.0
    assert np.isfinite(r.estimates_m["flexinol"]).all()
    assert np.isnan(r.estimates_m["linear in λ (2.16, 2.17)"]).sum() == 10


def test_the_command_replays_and_reports(flexinol, model, tmp_path, capsys):
    write_model(tmp_path / "model.yaml", model)
    log = str(flexinol.folder / "partial_0.600N.csv")
    code = main(
        [
            "replay",
            log,
            "--config",
            str(tmp_path / "model.yaml"),
            "--json",
            str(tmp_path / "e.json"),
            "--report",
            str(tmp_path / "r.html"),
        ]
    )
    assert code == 0
    rows = json.loads((tmp_path / "e.json").read_text())
    assert rows[0]["model"] == "flexinol" and rows[0]["working_percent"] < 2.0
    assert "data:image/png" in (tmp_path / "r.html").read_text()


# --- recordings ----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def readings():
    """Half a minute of the virtual bench, 20 Hz."""
    from sma_actuator.characterise.programs import square_pulses

    _, rig, _ = virtual_rig("flexinol")
    with rig.opened():
        return rig.record(square_pulses(1, 0.3, 0.05, 3.0, 6.0))


def record(path, log, mcap, spare=b""):
    """Write a rosbag2 recording as a robot would: floats without a stamp, a wrench and a joint state with one."""
    rosbag2 = pytest.importorskip("rosbags.rosbag2")
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    t = store.types
    plugin = rosbag2.StoragePlugin.MCAP if mcap else rosbag2.StoragePlugin.SQLITE3

    def header(time_s):
        stamp = t["builtin_interfaces/msg/Time"](sec=int(time_s), nanosec=round((time_s % 1.0) * 1e9))
        return t["std_msgs/msg/Header"](stamp=stamp, frame_id="")

    def vector(x):
        return t["geometry_msgs/msg/Vector3"](x=x, y=0.0, z=0.0)

    with rosbag2.Writer(path, version=9, storage_plugin=plugin) as writer:
        kinds = {
            "/supply_voltage": "std_msgs/msg/Float64",
            "/reference_voltage": "std_msgs/msg/Float64",
            "/load": "geometry_msgs/msg/WrenchStamped",
            "/joint_states": "sensor_msgs/msg/JointState",
        }
        connections = {topic: writer.add_connection(topic, kind, typestore=store) for topic, kind in kinds.items()}
        for k in range(len(log)):
            time_s = 100.0 + float(log["time_s"][k])
            load_N = 12.7297 * float(log["load_cell_voltage_V"][k]) - 0.0598
            position_m = 0.315842 * float(log["lvdt_current_A"][k]) - 0.0012195
            wrench = t["geometry_msgs/msg/Wrench"](force=vector(load_N), torque=vector(0.0))
            joint = t["sensor_msgs/msg/JointState"](
                header=header(time_s),
                name=["sma_joint"],
                position=np.array([position_m]),
                velocity=np.array([]),
                effort=np.array([]),
            )
            messages = {
                "/supply_voltage": t["std_msgs/msg/Float64"](data=float(log["supply_voltage_V"][k])),
                "/reference_voltage": t["std_msgs/msg/Float64"](data=float(log["reference_voltage_V"][k])),
                "/load": t["geometry_msgs/msg/WrenchStamped"](header=header(time_s), wrench=wrench),
                "/joint_states": joint,
            }
            for topic, message in messages.items():
                raw = bytes(store.serialize_cdr(message, kinds[topic])) + spare
                writer.write(connections[topic], round(time_s * 1e9), raw)
    return path


TOPICS = {
    "supply_voltage_V": "/supply_voltage:data",
    "reference_voltage_V": "/reference_voltage:data",
    "load_N": "/load:wrench.force.x",
    "displacement_m": "/joint_states:position.0",
}


@pytest.mark.parametrize(
    "spare", [b"", b"\x49\x7f\x00\x00", b"\xf0\x9f\x45\x3f" * 2], ids=["exact", "4 bytes", "8 bytes"]
)
@pytest.mark.parametrize("mcap", [False, True], ids=["sqlite3", "mcap"])
def test_a_recording_of_a_robot_becomes_a_bench_log(readings, tmp_path, mcap, spare):
    """Behind a message rclpy's ``serialize_message`` leaves up to 8 bytes of memory that mean nothing."""
    log = log_from_bag(record(tmp_path / "bag", readings, mcap, spare), TOPICS)
    assert len(log) == len(readings)
    np.testing.assert_allclose(log["time_s"], readings["time_s"], atol=1e-6)
    np.testing.assert_allclose(log["supply_voltage_V"], readings["supply_voltage_V"], rtol=1e-12)
    np.testing.assert_allclose(log["load_N"], 12.7297 * readings["load_cell_voltage_V"] - 0.0598, rtol=1e-9)


def test_a_recording_is_replayed_and_saved_by_the_command(readings, model, tmp_path):
    bag = record(tmp_path / "bag", readings, mcap=True)
    write_model(tmp_path / "model.yaml", model)
    words = [f"--topic={column}={spec}" for column, spec in TOPICS.items()]
    code = main(
        [
            "replay",
            str(bag),
            "--config",
            str(tmp_path / "model.yaml"),
            *words,
            "--save-log",
            str(tmp_path / "log.csv"),
            "--json",
            str(tmp_path / "e.json"),
        ]
    )
    assert code == 0
    assert len(read_bench_log(tmp_path / "log.csv")) == len(readings)
    assert json.loads((tmp_path / "e.json").read_text())[0]["working_percent"] < 2.0


@pytest.mark.parametrize(
    "topics, sentence",
    [
        (
            {**TOPICS, "load_N": "/lode:wrench.force.x"},
            "topic /lode .for load_N. is not recorded; recorded are /joint_states, /load",
        ),
        ({**TOPICS, "load_N": "/load:wrench.forces.x"}, "no field wrench.forces.x"),
        ({**TOPICS, "load_N": "/load:wrench"}, "field wrench is not a number"),
        ({**TOPICS, "load_N": "load"}, "does not name a topic and a field"),
        ({}, "no node's ~/signals is recorded .recorded are /joint_states.*name a topic for every column"),
    ],
    ids=["no such topic", "no such field", "not a number", "no field", "no topics"],
)
def test_a_recording_that_lacks_what_was_named_is_refused(readings, tmp_path, topics, sentence):
    bag = record(tmp_path / "bag", readings, mcap=True)
    with pytest.raises(BenchLogError, match=sentence):
        log_from_bag(bag, topics)


_MCAP = b"\x89MCAP0\r\n"


@pytest.mark.parametrize(
    "content",
    [b"", b"not a recording", _MCAP, _MCAP + bytes(range(256)) * 40 + _MCAP, b"SQLite format 3\0" + bytes(5000)],
    ids=["empty", "text", "magic alone", "junk between magic", "half a database"],
)
@pytest.mark.parametrize("ending", ["mcap", "db3"])
def test_a_file_that_is_no_recording_is_refused(tmp_path, content, ending):
    pytest.importorskip("rosbags")
    path = tmp_path / f"a.{ending}"
    path.write_bytes(content)
    with warnings.catch_warnings(), pytest.raises(BenchLogError, match="no readable rosbag2 recording"):
        warnings.simplefilter("ignore")
        log_from_bag(path, TOPICS)
