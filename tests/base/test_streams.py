"""A program that is started without standard streams, or whose words nobody reads."""

import os
import subprocess
import sys

import pytest

_PROGRAM = """
import os, sys
from sma_actuator.base.streams import keep_standard_streams
keep_standard_streams()
file = os.open(sys.argv[1], os.O_WRONLY | os.O_CREAT)  # as the next connection is
assert file > 2, file
print("results", flush=True)
print("words", file=sys.stderr, flush=True)
os.write(2, b"words of a library below Python")
sys.exit(7)
"""


@pytest.mark.parametrize("closed", ["<&-", ">&-", "2>&-", "<&- >&- 2>&-"])
def test_what_it_says_does_not_go_where_it_is_connected_to(tmp_path, closed):
    command = f'exec "$@" {closed}'
    connection = tmp_path / "connection"
    run = subprocess.run(
        ["sh", "-c", command, "sh", sys.executable, "-c", _PROGRAM, str(connection)],
        capture_output=True,
        text=True,
        timeout=150,
        check=False,
    )
    assert run.returncode == 7, run.stderr
    assert connection.read_text() == ""
    assert run.stdout == ("" if ">&-" in closed.replace("2>&-", "") else "results\n")


def test_a_letter_that_the_locale_lacks_ends_nothing():
    words = "from sma_actuator.base.streams import keep_standard_streams as keep; keep(); print('15.09 \\u03a9')"
    ascii_only = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    run = subprocess.run(
        [sys.executable, "-c", words], capture_output=True, env={**os.environ, **ascii_only}, timeout=150, check=False
    )
    assert (run.returncode, run.stdout) == (0, rb"15.09 \u03a9" + b"\n"), run.stderr


_WORDY = """
import contextlib, os, sys
from sma_actuator.base.streams import unblockable_streams
with unblockable_streams():
    for _ in range(100):
        with contextlib.suppress(BlockingIOError):
            os.write(2, 65536 * b"x")
    print("said all", flush=True)
sys.exit(7)
"""


def test_words_that_nobody_reads_hold_nothing_up():
    reader, writer = os.pipe()  # and nobody reads
    try:
        run = subprocess.run(
            [sys.executable, "-c", _WORDY], stdout=subprocess.PIPE, stderr=writer, timeout=150, check=False
        )
        assert (run.returncode, run.stdout) == (7, b"said all\n")
    finally:
        os.close(reader)
        os.close(writer)


def test_words_that_are_read_arrive_in_order_and_whole():
    program = """
import os, sys
from sma_actuator.base.streams import unblockable_streams
with unblockable_streams():
    for number in range(1000):
        print(number, file=sys.stderr, flush=True)
    os.write(1, b"and a library\\n")
print("afterwards")
"""
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=150, check=False)
    assert run.stderr.split() == [str(number) for number in range(1000)]
    assert run.stdout == "and a library\nafterwards\n"
