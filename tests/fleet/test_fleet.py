"""Many wires at once, as a user has them judged: logs behind an S3-compatible server, a cluster, a table, a page."""

import importlib.util
import json
import logging
import os
import shutil

import dying
import pytest
from joblib.externals.loky import get_reusable_executor

from sma_actuator.cli.main import main
from sma_actuator.config import write_parameter_file
from sma_actuator.fleet.table import OF_THE_WORKER, read_table
from sma_actuator.identify import identify
from sma_actuator.replay import command as replay_command

fsspec = pytest.importorskip("fsspec")
if importlib.util.find_spec("moto") is None:  # imported where it is wanted: every worker collects this file
    pytest.skip("no S3-compatible server is installed (moto)", allow_module_level=True)


@pytest.fixture(scope="module")
def fleet(flexinol, tmp_path_factory):
    """Two wires with four logs each, and the model of both: a folder; the logs of one are as its load cell shows too
    much."""
    import pandas

    folder = tmp_path_factory.mktemp("fleet")
    result = identify(flexinol.only("pulses", "partial"), flexinol.mapping, "flexinol", order=1)
    write_parameter_file(folder / "model.yaml", result.mapping, "with its tables beside it")
    paths = [path for path in flexinol.paths if path.name.startswith("partial")]
    for wire in ("sound", "worn"):
        (folder / "logs" / wire).mkdir(parents=True)
        for day, path in enumerate(paths, 1):
            log = folder / "logs" / wire / path.name
            shutil.copy(path, log)
            metadata = json.loads(path.with_suffix(".json").read_text())
            log.with_suffix(".json").write_text(
                json.dumps({**metadata, "started": f"2026-05-{day:02d}T08:00:00+00:00"})
            )
            if wire == "worn" and day > 2:
                rows = pandas.read_csv(log)
                rows["supply_voltage_V"] += 0.02
                rows.to_csv(log, index=False)
    return folder


@pytest.fixture(scope="module")
def bucket(fleet):
    """The same behind an S3-compatible server, which the environment names."""
    from moto.server import ThreadedMotoServer

    logging.getLogger("werkzeug").setLevel(logging.ERROR)
    server = ThreadedMotoServer(port=0, verbose=False)
    server.start()
    with pytest.MonkeyPatch.context() as patch:
        for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"):
            patch.setenv(name, "fleet")
        patch.setenv("AWS_DEFAULT_REGION", "us-east-1")
        patch.setenv("AWS_ENDPOINT_URL", "http://{}:{}".format(*server.get_host_and_port()))
        files = fsspec.filesystem("s3")
        files.mkdir("fleet")
        for path in sorted(fleet.rglob("*")):
            if path.is_file():
                files.put_file(str(path), f"fleet/{path.relative_to(fleet)}")
        yield "s3://fleet"
        server.stop()


def replay(place, table, *words, logs="logs", model="model.yaml"):
    return main(["replay", f"{place}/{logs}", "--config", f"{place}/{model}", "--table", str(table), "-q", *words])


def found(table, names=(*OF_THE_WORKER,)):
    return sorted(repr({k: v for k, v in row.items() if k not in names}) for row in read_table(table))


@pytest.fixture(scope="module")
def alone(bucket, tmp_path_factory):
    """The table of one process."""
    table = tmp_path_factory.mktemp("alone") / "table.parquet"
    assert replay(bucket, table, "--jobs", "1") == 0
    return table


def test_there_is_a_row_for_every_log_with_wire_date_hashes_and_verdict(alone):
    import pandas

    rows = pandas.read_parquet(alone)  # as anybody reads it
    assert len(rows) == 8 and set(rows.wire) == {"sound", "worn"} and rows.log.str.startswith("s3://fleet/logs/").all()
    assert rows.log_sha256.nunique() == 6 and rows.model_sha256.nunique() == 1  # the first two days are the same
    worn = rows[rows.wire == "worn"].sort_values("date")
    assert list(worn.verdict) == ["as calibrated"] * 2 + ["changed"] * 2
    assert str(worn.date.iloc[2].date()) == "2026-05-03"
    assert (rows.seconds > 0).all() and (rows.peak_memory_MB > 1).all() and (rows.error_percent > 0).all()


def test_local_folders_give_the_same_findings(fleet, alone, tmp_path):
    table = tmp_path / "table.parquet"
    assert replay(fleet, table, "--jobs", "1") == 0
    assert found(table, (*OF_THE_WORKER, "log")) == found(alone, (*OF_THE_WORKER, "log"))


@pytest.mark.parametrize("where", ["processes", pytest.param("a Dask cluster", marks=pytest.mark.long)])
def test_a_worker_that_is_killed_loses_nothing_and_changes_no_result(where, bucket, alone, tmp_path, monkeypatch):
    monkeypatch.setattr(replay_command, "judge_logs", dying.judge_logs_and_die_once)
    monkeypatch.setenv(dying.MARK, str(tmp_path / "died"))
    table = tmp_path / "table.parquet"
    if where == "processes":
        get_reusable_executor().shutdown(wait=True)  # those of an earlier test have the environment of then
        assert replay(bucket, table, "--jobs", "2") == 0
    else:
        distributed = pytest.importorskip("distributed")
        with distributed.LocalCluster(
            n_workers=2,
            threads_per_worker=1,
            dashboard_address="127.0.0.1:0",
            local_directory=str(tmp_path / "workers"),
        ) as cluster:
            assert replay(bucket, table, "--dask", cluster.scheduler_address) == 0
    assert (tmp_path / "died").exists()
    assert found(table) == found(alone)


def test_what_is_in_the_table_is_left_out_and_what_has_changed_is_not(bucket, fleet, alone, tmp_path):
    table = tmp_path / "table.parquet"
    assert replay(bucket, table, "--jobs", "1", logs="logs/sound") == 0
    assert len(read_table(table)) == 4
    assert replay(bucket, table, "--jobs", "1") == 0
    assert found(table) == found(alone)
    before = table.read_bytes()
    assert replay(bucket, table, "--jobs", "1") == 0
    assert table.read_bytes() == before
    fsspec.filesystem("s3").pipe_file("fleet/other.yaml", (fleet / "model.yaml").read_bytes() + b"\n# another\n")
    assert replay(bucket, table, "--jobs", "1", logs="logs/worn/*.csv", model="other.yaml") == 0
    assert len(read_table(table)) == 12


def test_the_page_says_which_wires_drift_by_what_and_since_when(alone, tmp_path, capsys):
    page, states = tmp_path / "fleet.html", tmp_path / "states.json"
    assert main(["fleet", str(alone), "--report", str(page), "--json", str(states)]) == 0
    assert "1 of 2 wires drifts: worn by something without a name since 2026-05-03." in capsys.readouterr().out
    assert "worn by something without a name since 2026-05-03" in page.read_text().split("<figure")[0]
    worn, sound = json.loads(states.read_text())
    assert worn["wire"] == "worn" and worn["drifts"] and not sound["drifts"] and worn["logs"] == 4


# That processes change no result, above.
@pytest.mark.parametrize("jobs", ["1", pytest.param("2", marks=pytest.mark.long)])
def test_identify_fits_every_wire_and_writes_its_model(flexinol, tmp_path, jobs):
    for wire in ("a", "b"):
        (tmp_path / "logs" / wire).mkdir(parents=True)
        for path in flexinol.paths:
            if path.name.startswith(("pulses", "partial")):
                os.link(path, tmp_path / "logs" / wire / path.name)
                os.link(path.with_suffix(".json"), tmp_path / "logs" / wire / path.with_suffix(".json").name)
    words = [
        "--config",
        str(flexinol.folder / "bench.yaml"),
        "--model",
        "flexinol",
        "--order",
        "1",
        "--no-extension",
        "-q",
    ]
    words += ["--table", str(tmp_path / "table.parquet"), "--jobs", jobs, "--out"]
    assert main(["identify", str(tmp_path / "logs"), *words, str(tmp_path / "{wire}.yaml")]) == 0
    rows = read_table(tmp_path / "table.parquet")
    assert len(rows) == 16 and {row["verdict"] for row in rows} <= {"good for control", "not good for control"}
    one, two = ((tmp_path / f"{wire}.yaml").read_text() for wire in ("a", "b"))
    assert one == two and "heating_slope" in one
    assert main(["identify", str(tmp_path / "logs"), *words, str(tmp_path / "one.yaml")]) == 1  # for two wires


def test_bad_input_is_said_in_a_sentence(fleet, bucket, tmp_path, capsys):
    table = tmp_path / "table.parquet"
    assert replay(bucket, table, logs="nowhere/*.csv") == 1
    assert "no log there" in capsys.readouterr().err
    assert main(["replay", f"{bucket}/logs", "--config", str(fleet / "model.yaml")]) == 1
    assert "a URL is read with --table" in capsys.readouterr().err
    assert main(["fleet", str(table)]) == 1
    assert "there is no table" in capsys.readouterr().err
    (fleet / "broken").mkdir()
    (fleet / "broken" / "cut.csv").write_text("time_s,resistance_Ohm\n0,1\n")
    assert replay(fleet, table, "--jobs", "1", logs="broken") == 0  # what it refuses is a finding too
    (row,) = read_table(table)
    assert row["verdict"] == "refused" and "is missing" in row["sentence"]
    assert main(["fleet", str(table), "--report", str(tmp_path / "page.html")]) == 0
    assert "cut.csv" in (tmp_path / "page.html").read_text()
