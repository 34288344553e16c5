"""A program that is started without standard streams."""

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
        timeout=60,
        check=False,
    )
    assert run.returncode == 7, run.stderr
    assert connection.read_text() == ""
    assert run.stdout == ("" if ">&-" in closed.replace("2>&-", "") else "results\n")
