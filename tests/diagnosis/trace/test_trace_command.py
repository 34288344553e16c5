"""``sma-actuator trace`` as a user runs it: logs and a model in, a verdict, a page and an extended model out."""

import argparse
import dataclasses
import json
import re
import shlex
from pathlib import Path

import numpy as np
import pytest
import yaml
from sessions import session, write, write_model

from sma_actuator.actuator import Actuator
from sma_actuator.base.signals import Reading
from sma_actuator.cli.main import main
from sma_actuator.config import Config
from sma_actuator.diagnosis.trace import Evidence
from sma_actuator.diagnosis.trace.command import _next
from sma_actuator.fleet.table import read_table
from sma_actuator.logs.bench_log import read_bench_log, to_reading
from sma_actuator.logs.experiments import make_experiment
from sma_actuator.plant.loads import Weight
from sma_actuator.replay import estimate_m


@pytest.fixture(scope="module")
def traced(wire, tmp_path_factory):
    """(folder, logs, model) of a session with a zero error of the voltage channel, traced."""
    folder = tmp_path_factory.mktemp("traced")
    logs = write(session(wire[0], {"voltage_offset": 0.004}, logs=1), folder)
    model = write_model(wire[1], folder / "wire.yaml")
    assert main(["trace", *logs, "--config", model, "--out", str(folder / "out"), "--jobs", "1"]) == 0
    return folder, logs, model


@pytest.fixture(scope="module")
def report(traced):
    return json.loads((traced[0] / "out" / "report.json").read_text())


def test_the_report_says_how_probable_each_hypothesis_is(report, traced):
    shares = [each["probability"] for each in report["probabilities"]]
    assert sum(shares) == pytest.approx(1.0) and shares == sorted(shares, reverse=True)
    assert max(report["probable"], key=report["probable"].get) == "voltage_offset"
    assert report["names"][0] == "voltage_offset"
    best = report["probabilities"][0]
    assert best["hypothesis"] == ["voltage_offset"] == report["candidates"][0]["effects"]
    assert best["probability"] == report["candidates"][0]["probability"] > 0.5
    assert "How probable each is" in (traced[0] / "out" / "report.html").read_text()


def test_the_report_says_what_was_found_and_how_sure_it_is(report):
    assert report["verdict"] == "traced"
    (effect,) = report["effects"]
    assert (effect["name"], effect["part"]) == ("voltage_offset", "circuit")
    offset = effect["parameters"]["offset"]
    assert offset["unit"] == "V"
    assert offset["interval"][0] <= 0.004 <= offset["interval"][1] or offset["value"] == pytest.approx(0.004, rel=0.05)
    assert effect["share"] > 0.9
    explained = 1.0 - report["unexpected_after_pct_stroke"] / report["unexpected_before_pct_stroke"]
    assert explained > 0.8
    assert report["sentence"].startswith(
        f"A voltage channel has a zero error (voltage_offset): that explains {explained:.0%} of what is unusual"
    )
    assert "Look at leads, contacts and channels" in report["sentence"]
    assert "resistance at cold rest and resistance at hot rest are as at the calibration with it" in report["sentence"]
    (at_rest,) = (w for w in report["witnesses"] if w["name"] == "resistance at cold rest")
    assert at_rest["off_before"] > 2.0 > at_rest["off_after"] and at_rest["explained"] > 0.9
    assert (
        report["unexpected_after_pct_stroke"]
        <= 1.75 * report["floor_pct_stroke"]
        < report["unexpected_before_pct_stroke"]
    )
    low, high = report["error_before_interval"]
    assert low < report["error_before_pct_stroke"] < high
    low, high = report["error_after_interval"]
    assert low < report["error_after_pct_stroke"] < high < report["error_before_interval"][0]
    assert isinstance(report["alternatives"], list)
    assert report["untestable"] == []  # several loads, a spring and the surroundings are in these logs
    assert 0.0 < report["residual_before"]["sensor_noise_pct_stroke"] < report["error_after_pct_stroke"]
    assert report["residual_before"]["share_explained_by"]


def test_the_page_is_one_file_with_its_pictures_in_it(traced):
    page = (traced[0] / "out" / "report.html").read_text()
    assert page.count("data:image/png;base64,") >= 5
    assert "voltage offset" in page and 'src="http' not in page


def test_a_name_that_was_not_given_is_explained(traced, capsys):
    folder, logs, model = traced
    out = folder / "explained"
    words = ["--only", "voltage_offset", "--explain", "slip", "elastic_compliance", "--json", str(folder / "why.json")]
    assert main(["trace", *logs, "--config", model, "--out", str(out), "--jobs", "1", *words]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "voltage_offset, given: It has a probability of" in said and "slip, refused: " in said
    assert "stretch 6 of the logs" in said
    report = json.loads((folder / "why.json").read_text())
    rows = {" ".join(row["effects"]): row for row in report["candidates"]}
    assert next(iter(rows)) == "voltage_offset" and {"slip", "elastic_compliance"} < set(rows)
    assert rows["slip"]["nats"] < 0.0 == rows["voltage_offset"]["nats"]
    by_witness = rows["slip"]["nats_by_witness"]
    assert min(by_witness.values()) < -1.0
    assert sum(rows["slip"]["nats_by_stretch"]) == pytest.approx(sum(by_witness.values()), abs=1e-4)
    page = (out / "report.html").read_text()
    assert "Why this, and nothing else" in page and "speaks against the name" in page
    assert rows["slip"]["reason"].split(" (")[0].split(";")[0][:40] in page


def test_the_extended_model_runs_in_every_tool_and_has_the_error_that_was_reported(traced, report):
    folder, logs, _ = traced
    model = folder / "out" / "model.yaml"
    assert report["model_file"] == str(model)
    config = Config.load(model)
    assert list(config.effects.active) == ["voltage_offset"]
    (history,) = config.effects.history
    assert "voltage_offset" in history and "session_1.csv" in history and "% of full stroke" in history
    means = []
    for path in logs:
        trace_ = make_experiment(read_bench_log(path), config)
        errors_m = np.abs(estimate_m(trace_, config) - trace_.displacement_m)
        means.append(np.nanmean(errors_m) / config.wire.full_stroke_m * 100)
    assert config.calibration.error == pytest.approx(np.mean(means), rel=0.05)  # of the model as it is now
    assert config.calibration.largest_error == pytest.approx(max(means), rel=0.05)
    evidence = Evidence([read_bench_log(path) for path in logs], config)
    own = evidence.compare({}).errors_percent.mean()  # of all cycles, as the report has it
    low, high = report["error_after_interval"]  # on cycles held out
    assert low < own < high
    assert main(["replay", *logs, "--config", str(model), "--report", str(folder / "replay.html")]) == 0


@pytest.mark.long
def test_tracing_again_with_the_extended_model_finds_nothing_more(traced):
    folder, logs, _ = traced
    out = folder / "again"
    assert main(["trace", *logs, "--config", str(folder / "out" / "model.yaml"), "--out", str(out), "--jobs", "1"]) == 0
    assert json.loads((out / "report.json").read_text())["verdict"] == "none"
    assert not (out / "model.yaml").exists()


@pytest.mark.long
def test_rerunning_writes_the_same_files(traced):
    folder, logs, model = traced
    assert main(["trace", *logs, "--config", model, "--out", str(folder / "out2"), "--jobs", "2"]) == 0
    for name in ("model.yaml", "report.json"):
        assert (folder / "out2" / name).read_text().replace("out2", "out") == (folder / "out" / name).read_text()


@pytest.mark.long
def test_a_model_that_does_not_say_how_good_it_was_takes_its_calibration_logs(wire, traced, capsys):
    """Without a floor of its own 1.5 % of the stroke counts; --calibration gives it one."""
    folder, logs, _ = traced
    bare = write_model({k: v for k, v in wire[1].items() if k != "calibration"}, folder / "bare.yaml")
    clean = write(session(wire[0], seed=9), folder / "..")
    out = folder / "calibrated"
    words = ["--config", bare, "--out", str(out), "--jobs", "1"]
    assert main(["trace", *logs, *words]) == 0
    without = json.loads((out / "report.json").read_text())
    assert without["floor_pct_stroke"] == pytest.approx(1.5) and not without["floor_from_calibration"]
    # with errors that only a guess is known of, it is the most probable name, and not always enough for a verdict
    assert max(without["probable"], key=without["probable"].__getitem__) == "voltage_offset"
    assert main(["trace", *logs, *words, "--force", "--calibration", *clean]) == 0
    with_ = json.loads((out / "report.json").read_text())
    assert with_["floor_from_calibration"] and with_["effects"][0]["name"] == "voltage_offset"


@pytest.mark.parametrize(
    ("change", "words", "said"),
    [
        ({}, ["--only", "gremlins"], "--only: 'gremlins' is no effect"),
        ({}, ["--explain", "gremlins"], "--explain: 'gremlins' is no effect"),
        ({}, ["--explain", "slip", "--table", "t.parquet"], "--explain: not with --table"),
        ({"file_format": 7}, [], "file_format.*newer version"),
        ({"effects": {"gremlins": {}}}, [], "effects.gremlins: no such effect"),
    ],
    ids=["unknown effect", "nothing to explain", "to explain a fleet", "a newer file", "an effect of a newer version"],
)
def test_bad_input_is_refused_in_a_sentence(wire, traced, tmp_path, capsys, change, words, said):
    model = write_model({**wire[1], **change}, tmp_path / "model.yaml")
    assert main(["trace", *traced[1], "--config", model, "--out", str(tmp_path / "out"), *words]) == 1
    assert re.search(said, capsys.readouterr().err.replace("\n", " "))
    assert not (tmp_path / "out").exists()


def test_the_written_model_is_plain_yaml(traced):
    text = (traced[0] / "out" / "model.yaml").read_text()
    assert text.startswith("# Written by `sma-actuator trace`")
    assert yaml.safe_load(text)["sma_actuator"]["ros__parameters"]["effects"]["order"] == ["voltage_offset"]


def test_the_node_estimates_with_the_extended_model_what_replay_does(traced):
    """Reading by reading through the actuator's own step, as the node drives it."""
    folder, logs, _ = traced
    config = Config.load(folder / "out" / "model.yaml")
    log = read_bench_log(logs[0])
    trace_ = make_experiment(log, config)
    whole = estimate_m(trace_, config)
    actuator, reading = Actuator(config), to_reading(log)
    for i in range(len(log)):
        one = Reading(*(float(getattr(reading, f.name)[i]) for f in dataclasses.fields(Reading)))
        output = actuator.step(one.time_s, one, None)
        assert output.estimate.displacement_m == pytest.approx(whole[i], abs=1e-12), f"reading {i}"


@pytest.mark.long
def test_a_dask_cluster_gives_the_same_report(traced):
    distributed = pytest.importorskip("distributed")
    folder, logs, model = traced
    with distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address="127.0.0.1:0") as cluster:
        words = ["--jobs", "2", "--dask", cluster.scheduler_address]
        assert main(["trace", *logs, "--config", model, "--out", str(folder / "out3"), *words]) == 0
    assert (folder / "out3" / "report.json").read_text().replace("out3", "out") == (
        folder / "out" / "report.json"
    ).read_text()


def test_a_cluster_that_does_not_answer_is_named(traced, capsys):
    folder, logs, model = traced
    assert main(["trace", *logs, "--config", model, "--out", str(folder / "out4"), "--dask", "tcp://127.0.0.1:1"]) == 1
    assert "--dask: no scheduler answers at 'tcp://127.0.0.1:1'" in capsys.readouterr().err.replace("\n", " ")


def test_replay_gives_every_model_its_own_circuit(traced):
    """The model and the extended one beside each other: the first thing a user looks at."""
    folder, logs, model = traced
    out = folder / "beside.json"
    words = [
        "--config",
        model,
        "--config",
        str(folder / "out" / "model.yaml"),
        "--report",
        str(folder / "beside.html"),
        "--json",
        str(out),
    ]
    assert main(["replay", logs[0], *words]) == 0
    text = json.dumps(json.loads(out.read_text()))
    errors = [float(x) for x in re.findall(r'"full_percent": ([\d.]+)', text)]
    assert len(errors) == 2 and errors[1] < 0.5 * errors[0]


def test_fitting_one_effect_alone_is_no_verdict_for_it(traced):
    folder, logs, model = traced
    out = folder / "only"
    assert main(["trace", *logs, "--config", model, "--out", str(out), "--jobs", "1", "--only", "rate"]) == 0
    assert json.loads((out / "report.json").read_text())["verdict"] == "unexplained"
    assert not (out / "model.yaml").exists()


def test_the_next_command_names_one_file_whatever_is_in_its_name():
    said = _next(argparse.Namespace(), {"verdict": "traced"}, Path("mein Draht/model.yaml"))
    assert shlex.split(said)[-2:] == ["--params-file", "mein Draht/model.yaml"]


def test_a_file_in_the_place_of_the_folder_is_said_before_anything_is_traced(traced, tmp_path, capsys):
    _folder, logs, model = traced
    (tmp_path / "out").write_text("")
    for words in ([], ["--force"]):
        assert main(["trace", *logs, "--config", model, "--out", str(tmp_path / "out"), *words]) == 1
        said = capsys.readouterr().err
        assert said == f"sma-actuator trace: {tmp_path / 'out'}: is a file; a folder for report.json is wanted\n"


def test_a_failure_leaves_no_earlier_result_behind(wire, traced, tmp_path, tmp_path_factory, capsys):
    *_, model = traced
    logs = write(session(wire[0], load=Weight(0.98), logs=1), tmp_path_factory.mktemp("one_load"))
    (tmp_path / "report.json").write_text("{}")
    (tmp_path / "model.yaml").write_text("old")
    assert main(["trace", *logs, "--config", model, "--out", str(tmp_path), "--only", "elastic_compliance"]) == 1
    assert "report.json: exists already; --force overwrites it" in capsys.readouterr().err
    assert (tmp_path / "model.yaml").read_text() == "old"
    words = ["--out", str(tmp_path), "--only", "elastic_compliance", "--force"]
    assert main(["trace", *logs, "--config", model, *words]) == 1
    assert "elastic_compliance cannot be fitted on these logs" in capsys.readouterr().err.replace("\n", " ")
    assert not list(tmp_path.iterdir())


def test_of_a_fleet_every_log_has_a_row_that_names_the_effect_and_the_fleet_says_what_to_do(traced, tmp_path, capsys):
    _, logs, model = traced
    table = tmp_path / "table.parquet"
    words = ["--table", str(table), "--jobs", "1", "--only", "voltage_offset", "--wire-name", "(session)", "--out"]
    assert main(["trace", *logs, "--config", model, *words, str(tmp_path / "{wire}.yaml")]) == 0
    rows = read_table(table)
    assert len(rows) == len(logs) and {row["verdict"] for row in rows} == {"traced"}
    assert all(row["effects"] == ["voltage_offset"] and row["wire"] == "session" for row in rows)
    assert all(row["error_after_percent"] < 0.5 * row["error_percent"] for row in rows)
    assert "voltage_offset" in (tmp_path / "session.yaml").read_text()
    capsys.readouterr()
    assert main(["fleet", str(table)]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "1 of 1 wire drifts: session by voltage offset since" in said and "DAQ calibrate its zero" in said
