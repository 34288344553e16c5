"""The command line: every command explains itself, and says what is wrong in a sentence, not a traceback."""

import csv
import io
import json
import os
import re
import signal
import subprocess
import sys

import pytest

from sma_actuator.base.share import shared_file
from sma_actuator.cli.main import COMMANDS, main


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_explains_itself(command, capsys):
    with pytest.raises(SystemExit) as ended:
        main([command, "--help"])
    assert ended.value.code == 0
    assert "usage: sma-actuator" in capsys.readouterr().out


def test_help_lists_the_commands_and_loads_none_of_them():
    code = (
        "import sys; from sma_actuator.cli.main import main\ntry: main(['--help'])\nexcept SystemExit: "
        "pass\nprint('numba' in sys.modules)"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=150).stdout
    assert all(command in out for command in COMMANDS)
    assert out.endswith("False\n")


@pytest.mark.parametrize(
    ("words", "sentence"),
    (
        (
            ["identify", "no.csv", "--config", "config/flexinol.yaml", "--model", "flexinol", "--out", "x.yaml"],
            "no.csv",
        ),
        (["replay", "no.csv", "--config", "nowhere.yaml"], "nowhere.yaml: cannot be read"),
    ),
)
def test_what_a_user_can_mend_is_one_sentence_and_code_1(words, sentence, capsys, tmp_path, monkeypatch):
    root = __file__.rsplit("/tests/", 1)[0]
    monkeypatch.chdir(tmp_path)
    code = main([f"{root}/{word}" if word.startswith("config/") else word for word in words])
    error = capsys.readouterr().err
    assert code == 1
    assert sentence in error
    assert "Traceback" not in error


@pytest.mark.parametrize("command", [["watch"], ["stop"], ["status"], ["call", "tare_load"], ["view"]])
@pytest.mark.parametrize("name", ["a b", "", "/", "9", "a//b", "a" * 201, "a\n", "\x1b[2J", "\udcff"])
def test_a_name_that_no_node_has_is_refused_before_ros_is_joined(command, name, capsys):
    for option in ("--node", "--namespace"):
        if option == "--namespace" and not name.strip("/"):
            continue  # which is the usual one
        with pytest.raises(SystemExit) as ended:
            main([*command, option, name])
        error = capsys.readouterr().err
        assert ended.value.code == 2 and "\x1b" not in error
        assert "letters, digits and _ are wanted, no digit first, 200 characters at the most" in error


def test_what_the_system_refuses_is_a_sentence_and_with_v_says_where(flexinol, tmp_path, capsys):
    """Here a name that is too long; as well a disk that is full, or a folder of another user."""
    too_long = tmp_path / f"{300 * 'a'}.csv"
    log, config = flexinol.folder / "pulses_0.600N.csv", shared_file("config/flexinol.yaml")
    words = ["replay", str(log), "--config", str(config), "--csv", str(too_long)]
    assert main(words) == 1
    assert f"sma-actuator replay: {too_long}: " in capsys.readouterr().err
    with pytest.raises(OSError):
        main([*words, "-v"])


def sma_actuator(*words, **environment):
    return subprocess.run(
        [sys.executable, "-m", "sma_actuator", *map(str, words)],
        capture_output=True,
        text=True,
        timeout=120,
        env={**os.environ, **environment},
    )


def test_called_bare_it_lists_the_commands():
    said = sma_actuator()
    assert said.returncode == 0
    assert all(f"    {command}" in said.stdout for command in COMMANDS)


@pytest.mark.parametrize("program", ["main", "node"])
def test_what_a_program_leaves_in_memory_is_not_looked_through_as_it_ends(program):
    if program == "node":
        pytest.importorskip("rclpy")
    last = "import atexit, gc; atexit.register(lambda: print('looked through:', len(gc.get_objects())))"
    code = f"{last}\nimport sys; sys.argv[1:] = ['--help']; from sma_actuator.__main__ import {program}; {program}()"
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=150.0)
    assert int(ended.stdout.rpartition("looked through: ")[2]) < 100, "thousands are there"


def test_it_says_its_version():
    assert re.fullmatch(r"sma-actuator \S.*\n", sma_actuator("--version").stdout)


def test_a_slip_in_a_command_is_answered_with_the_nearest():
    said = sma_actuator("reply", "a.csv")
    assert said.returncode == 2 and "'reply' is no command; did you mean replay?" in said.stderr


def test_whoever_asks_a_node_does_not_wait_for_what_drives_a_wire():
    """Numba is most of what such a command would import."""
    asking = [module for module, _ in COMMANDS.values() if module.startswith("sma_actuator.cli.remote.")]
    assert len(asking) > 5
    script = f"import sys, {', '.join(asking)}; sys.exit('numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", script], timeout=60.0).returncode == 0


def test_a_slip_in_an_option_is_answered_with_the_usage_of_that_command():
    said = sma_actuator("replay", "a.csv", "--config", "m.yaml", "--jsn", "x")
    assert said.returncode == 2
    assert "usage: sma-actuator replay" in said.stderr and "unrecognized arguments: --jsn x" in said.stderr


def test_the_shell_completes_commands_and_their_options(tmp_path):
    pytest.importorskip("argcomplete")

    def completions(line):
        path = tmp_path / "completions"
        completing = {"_ARGCOMPLETE": "1", "COMP_LINE": line, "COMP_POINT": str(len(line)), "_ARGCOMPLETE_IFS": " "}
        sma_actuator(_ARGCOMPLETE_STDOUT_FILENAME=str(path), **completing)
        return path.read_text().split()

    assert completions("sma-actuator rep") == ["replay"]
    assert "--map-file" in completions("sma-actuator replay --map")


def test_results_go_to_standard_output_in_full_width_and_notes_to_the_other(flexinol, tmp_path, capsys):
    """In a pipe nothing is broken, cut or coloured; with -q nothing else is said."""
    model = shared_file("config/flexinol.yaml")
    name = "a_log_with_a_name_that_is_longer_than_any_terminal_is_wide_" * 2 + ".csv"
    (tmp_path / name).write_bytes((flexinol.folder / "pulses_0.600N.csv").read_bytes())
    words = ["replay", tmp_path / name, flexinol.folder / "pulses_1.200N.csv", "--config", model]
    said = sma_actuator(*words)
    assert said.returncode == 0
    assert name in said.stdout and "mean" in said.stdout and "\x1b" not in said.stdout
    assert "reading" in said.stderr and "Mean absolute error" not in said.stderr
    quiet = sma_actuator(*words, "-q", "--csv", "-")
    assert "reading" not in quiet.stderr
    rows = list(csv.DictReader(io.StringIO(quiet.stdout)))
    assert [row["name"] for row in rows] == [name, "pulses_1.200N.csv"] and float(rows[0]["full_percent"]) < 5.0
    assert main([*map(str, words), "--json", "-"]) == 0
    assert [row["name"] for row in json.loads(capsys.readouterr().out)] == [name, "pulses_1.200N.csv"]


def test_an_interrupt_stays_one_where_a_library_stumbles_as_it_tidies_up(monkeypatch, capsys):
    def stumbles(_):
        try:
            raise KeyboardInterrupt(signal.SIGTERM)
        finally:
            raise RuntimeError("cannot join thread before it is started")

    monkeypatch.setattr("sma_actuator.replay.run", stumbles)
    assert main(["replay", "log.csv", "--config", "wire.yaml"]) == 128 + signal.SIGTERM
    assert capsys.readouterr().err == "sma-actuator replay: interrupted\n"


_NODE = ["-c", "import sys; from sma_actuator.__main__ import node; sys.exit(node())"]


@pytest.mark.parametrize(
    "program", [["-m", "sma_actuator", "demo"], ["-m", "sma_actuator", "replay"], _NODE], ids=["demo", "replay", "node"]
)
def test_ctrl_c_while_a_program_is_loaded_ends_it_without_a_traceback(program, tmp_path):
    """Whatever an import does with exceptions: this one catches all that it meets."""
    (tmp_path / "numpy.py").write_text(
        "import time\n"
        "print('loading', flush=True)\n"
        "for _ in range(60):\n"
        "    try:\n"
        "        time.sleep(1.0)\n"
        "    except BaseException:\n"
        "        pass\n"
    )
    words = [sys.executable, *program, "--help"]
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment) as process:
        try:
            assert process.stdout.readline() == "loading\n"
            process.send_signal(signal.SIGINT)
            assert process.communicate(timeout=30.0) == ("", "")
        finally:
            process.kill()
    assert process.returncode == 130


def test_without_ros_the_node_says_what_the_commands_say(tmp_path):
    (tmp_path / "rclpy.py").write_text("raise ModuleNotFoundError(\"No module named 'rclpy'\", name='rclpy')\n")
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    done = subprocess.run([sys.executable, *_NODE], capture_output=True, text=True, env=environment, timeout=60.0)
    said = "needs ROS 2, and Python finds no 'rclpy': source a ROS 2 installation, or pip install 'sma_actuator[ros]'"
    assert (done.returncode, done.stderr) == (1, f"sma_actuator_node: {said}\n")


@pytest.mark.parametrize(
    ("command", "missing", "said"),
    [
        ("demo", "rclpy", "needs ROS 2, and Python finds no 'rclpy': source a ROS 2 installation, or pip install"),
        ("status", "rclpy", "needs ROS 2, and Python finds no 'rclpy': source a ROS 2 installation, or pip install"),
        pytest.param(
            *("view", "rclpy", "needs ROS 2, and Python finds no 'rclpy': source a ROS 2 installation, or pip install"),
            marks=pytest.mark.long,
        ),
        ("view", "aiohttp", "needs the Python package 'aiohttp' (extra 'view')"),
    ],
)
def test_without_an_extra_a_command_says_in_a_sentence_which_it_wants(command, missing, said, tmp_path):
    (tmp_path / f"{missing}.py").write_text(f"raise ModuleNotFoundError('No {missing}', name='{missing}')\n")
    path = os.pathsep.join(filter(None, (str(tmp_path), os.environ.get("PYTHONPATH", ""))))
    words = [sys.executable, "-m", "sma_actuator", command]
    environment = {**os.environ, "PYTHONPATH": path}
    done = subprocess.run(words, capture_output=True, text=True, env=environment, timeout=60.0)
    assert done.returncode == 1 and done.stderr.startswith(f"sma-actuator {command}: {said}")
    assert done.stderr.count("\n") == 1
