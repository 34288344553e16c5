"""What a newcomer types: the README's "Drive a wire" runs as it stands, and the commands of a first real wire exist."""

import contextlib
import io
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from ports import free_port
from waiting import AS_ARGUMENTS

from sma_actuator.bench import VirtualBench
from sma_actuator.bench.server import background
from sma_actuator.cli.main import COMMANDS, main

ROOT = Path(__file__).resolve().parents[1]
PATIENCE_s = 300.0


def blocks(page, after=""):
    """Blocks of commands of a page, those of one section where ``after`` names it."""
    text = (ROOT / page).read_text(encoding="utf-8")
    section = re.split(r"^## ", text.split(after)[1], flags=re.MULTILINE)[0] if after else text
    return re.findall(r"^```\n(.*?)^```", section, flags=re.MULTILINE | re.DOTALL)


@pytest.mark.long  # .ci/run and tests/test_examples.py drive one
def test_drive_a_wire_as_it_is_written(tmp_path):
    ports = {"5025": free_port(), "5026": free_port()}

    def elsewhere(text):
        """On ports of its own: other tests run beside this one."""
        return re.sub(rf"(?<![\d.])({'|'.join(ports)})(?!\d)", lambda found: ports[found[0]], text)

    (tmp_path / ".venv").symlink_to(sys.prefix)
    (tmp_path / "config").mkdir()
    (tmp_path / "config" / "flexinol.yaml").write_text(elsewhere((ROOT / "config/flexinol.yaml").read_text()))
    shutil.copy(ROOT / "config/flexinol.tables.npz", tmp_path / "config")
    one, other = map(elsewhere, blocks("README.md", "## Drive a wire\n"))
    one = one.rstrip() + AS_ARGUMENTS
    with (tmp_path / "node.log").open("w") as log:
        node = subprocess.Popen(["bash", "-c", one], cwd=tmp_path, stdout=log, stderr=log, start_new_session=True)
    try:
        other = other.replace("sma-actuator enable", f"sma-actuator enable --patience {PATIENCE_s:g}")
        done = subprocess.run(
            ["bash", "-ec", other], cwd=tmp_path, capture_output=True, text=True, timeout=2 * PATIENCE_s, check=False
        )
    finally:
        os.killpg(node.pid, signal.SIGTERM)  # in a terminal: Ctrl-C, and kill %1
        node.wait(timeout=PATIENCE_s)
    assert done.returncode == 0, done.stdout + done.stderr + (tmp_path / "node.log").read_text()
    said = done.stdout.splitlines()
    assert said[0] == "/sma_actuator: the output is on; the wire is held where it is"
    (there,) = [at for at, line in enumerate(said) if line.startswith("there after")]
    assert float(re.search(r"position +([\d.]+) mm", said[there + 1])[1]) == pytest.approx(2.1, abs=0.15)
    assert said[-1] == "/sma_actuator: the output is off"


def test_a_first_real_wire_is_asked_for_looked_at_and_told_what_comes_next(tmp_path, monkeypatch, capsys):
    """The page's ``init`` and ``check``, on a bench behind its sockets."""
    monkeypatch.chdir(tmp_path)
    with background(VirtualBench.from_name("flexinol")) as server:
        addresses = [f"TCPIP::127.0.0.1::{server.ports[0][name]}::SOCKET" for name in ("supply", "daq")]
        answers = ["ni-ti", "", "100mm", "0.006in", "1ohm", addresses[0], "virtual_bench_supply", ""]
        answers += [addresses[1], "virtual_bench_daq", "", "", "", "", "104", ""]
        asked = subprocess.run(
            [sys.executable, "-m", "sma_actuator", *command("first_wire.md", "init")],
            input="\n".join(answers) + "\n", capture_output=True, text=True, timeout=PATIENCE_s, check=True,
        )  # fmt: skip
        assert "sma-actuator check --config bench.yaml" in asked.stderr
        assert main(command("first_wire.md", "check")) == 0
    assert shlex.join(["sma-actuator", *command("first_wire.md", "characterise")]) in capsys.readouterr().err


def commands(page):
    """The words of every ``sma-actuator`` command on a page."""
    lines = "\n".join(blocks(f"docs/{page}")).splitlines()
    return [shlex.split(line, comments=True)[1:] for line in lines if line.startswith("sma-actuator ")]


def command(page, name):
    """The first of them that is called so."""
    return next(words for words in commands(page) if words[0] == name)


def test_its_commands_have_the_options_that_the_page_gives_them():
    assert {words[0] for words in commands("first_wire.md")} >= {"characterise", "identify", "replay", "enable", "move"}
    for name, *words in commands("first_wire.md"):
        assert name in COMMANDS
        with contextlib.redirect_stdout(io.StringIO()) as help_, pytest.raises(SystemExit):
            main([name, "--help"])
        for option in (word for word in words if word.startswith("--")):
            assert option in help_.getvalue(), f"sma-actuator {name} {option}"


def test_two_makes_at_once_make_one_environment(tmp_path):
    """`make demo` in one terminal, `make test` in another, of a fresh clone: the second waits for the first."""
    for name in ("Makefile", "setup.py", "constraints.txt", "requirements.lock"):
        shutil.copy(ROOT / name, tmp_path)
    python = tmp_path / "python"
    python.write_text(
        '#!/bin/sh\necho "$@" >> asked\n[ "$2" != venv ] || { mkdir -p $3/bin; cp $0 $3/bin; cat goes_on; }\n'
    )
    python.chmod(0o755)
    os.mkfifo(tmp_path / "goes_on")  # until this one is opened and closed, the environment is being made
    command = ["make", "PYTHON=./python", ".venv/ready"]
    environment = {name: value for name, value in os.environ.items() if not name.startswith("MAKE")}
    with contextlib.ExitStack() as stack:

        def make(says):
            process = subprocess.Popen(command, cwd=tmp_path, stdout=-1, text=True, env=environment)
            stack.enter_context(process)
            assert any(says in line for line in process.stdout)
            return process

        first, second = make("-m venv .venv"), make("another make makes .venv: waiting for it")
        (tmp_path / "goes_on").write_text("")
        assert [makes.wait(PATIENCE_s) for makes in (first, second)] == [0, 0]
    assert (tmp_path / "asked").read_text().count("-m venv") == 1
