"""Processes that a command had work for it end with it, whatever ends it."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from waiting import SOON_s, wait_until

SCAN_s = 0.05  #: between looks through all processes
MARK = "SMA_TEST_OF_SPREADING"
MODEL = Path(__file__).parents[2] / "config/flexinol.yaml"

#: Another way to end it beside those that the quick tests look at.
LONG = pytest.mark.long


def marked(value):
    """The command lines of all processes with this mark in their environment."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        try:
            if f"{MARK}={value}".encode() in (process / "environ").read_bytes().split(b"\0"):
                found.append((process / "cmdline").read_bytes().replace(b"\0", b" ").decode())
        except OSError:
            pass
    return found


def started(command, mark):
    environment = {**os.environ, MARK: str(mark)}
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, env=environment)


def both_workers(mark):
    return sum("LokyProcess" in line for line in marked(mark)) == 2


@pytest.mark.parametrize(
    "number",
    # What a command makes of each of them, tests/base/test_interrupts.py looks at.
    [*(pytest.param(each, marks=pytest.mark.long) for each in (signal.SIGTERM, signal.SIGHUP)), signal.SIGINT],
    ids=lambda n: n.name,
)
def test_a_trace_that_is_ended_takes_its_workers_with_it_in_good_order(number, flexinol, tmp_path):
    logs = [str(path) for path in flexinol.paths if path.name.startswith("partial")]
    command = [sys.executable, "-m", "sma_actuator", "trace", *logs, "--config", str(MODEL), "--jobs", "2"]
    command += ["--out", str(tmp_path / "traced")]
    with started(command, tmp_path) as process:
        wait_until(lambda: both_workers(tmp_path) or process.poll() is not None, what="both workers", every_s=SCAN_s)
        process.send_signal(number)
        words = process.communicate(timeout=SOON_s)[1]  # ends when nobody has the stream any more
    wait_until(lambda: not marked(tmp_path), what="the end of all workers", every_s=SCAN_s)
    assert process.returncode == 128 + number, words
    assert words.strip().endswith("sma-actuator trace: interrupted") and "Traceback" not in words


_INTERRUPTED = """
import os, signal, time
from joblib.externals.loky.backend import fork_exec
from sma_actuator.fleet import spread
begin = fork_exec.fork_exec
def interrupted(*args, **kwargs):
    process = begin(*args, **kwargs)
    os.kill(os.getpid(), signal.SIGINT)
    return process
fork_exec.fork_exec = interrupted
with spread(2) as do:
    list(do([(time.sleep, (600.0,))] * 4))
"""


def test_a_worker_that_is_begun_as_ctrl_c_comes_is_not_left_half_begun(tmp_path):
    """It had said with a traceback what it was not told."""
    environment = {**os.environ, MARK: str(tmp_path)}
    program = [sys.executable, "-c", _INTERRUPTED]
    done = subprocess.run(program, capture_output=True, text=True, env=environment, timeout=SOON_s, check=False)
    wait_until(lambda: not marked(tmp_path), what="the end of all workers", every_s=SCAN_s)
    assert done.returncode == -signal.SIGINT and done.stdout == ""
    assert done.stderr.strip().endswith("KeyboardInterrupt: 2")


_PROGRAM = """
import time
from sma_actuator.fleet import spread
with spread(2) as do:
    {}
"""


@pytest.mark.parametrize(
    ("program", "number", "code"),
    [
        ("list(do([(time.sleep, (600.0,))] * 4))", signal.SIGKILL, -signal.SIGKILL),
        pytest.param("list(do([(time.sleep, (600.0,))]))", signal.SIGKILL, -signal.SIGKILL, marks=LONG),
        pytest.param("list(do([(time.sleep, (600.0,))] * 4))", signal.SIGUSR1, -signal.SIGUSR1, marks=LONG),
        ("list(do([(time.sleep, (0.0,))] * 4)); time.sleep(600.0)", signal.SIGKILL, -signal.SIGKILL),
        ("list(do([(time.sleep, (0.0,))] * 4)); 1 / 0", None, 1),
    ],
    ids=["killed at work", "and one has none", "a signal without a handler", "killed in between", "an exception"],
)
def test_workers_end_with_their_parent_whatever_ends_it(program, number, code, tmp_path):
    with started([sys.executable, "-c", _PROGRAM.format(program)], tmp_path) as process:
        if number is not None:
            wait_until(
                lambda: both_workers(tmp_path) or process.poll() is not None, what="both workers", every_s=SCAN_s
            )
            process.send_signal(number)
        process.communicate(timeout=SOON_s)
    wait_until(lambda: not marked(tmp_path), what="the end of all workers", every_s=SCAN_s)
    assert process.returncode == code


def test_a_process_that_is_replaced_is_no_warning_to_a_person():
    """`trace` printed joblib's, with the path of its file and a line of its code."""
    said = """
import warnings, sma_actuator.fleet.spreading
for words in ("A worker stopped while some jobs were given to the executor. This can be", "something else"):
    warnings.warn(words, UserWarning)
"""
    done = subprocess.run([sys.executable, "-c", said], capture_output=True, text=True, check=True)
    assert "something else" in done.stderr and "worker" not in done.stderr
