"""A run of tests that is broken off leaves nothing running."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest
from waiting import wait_until

TESTS = Path(__file__).parent
_RUN = """
import os, subprocess, sys
sys.path.insert(0, sys.argv[1])
from left_behind import end_with_this_process
watcher = end_with_this_process()
child = '''
import subprocess, sys
print(subprocess.Popen(['sleep', '300'], start_new_session=True).pid, flush=True)
sys.stdin.read()
'''
started = subprocess.Popen([sys.executable, "-c", child], stdin=subprocess.PIPE, start_new_session=True)
print(started.pid, flush=True)
started.wait()
"""


def _runs(pid):
    try:
        return "\nState:\tZ" not in Path(f"/proc/{pid}/status").read_text()
    except FileNotFoundError:
        return False


@pytest.mark.skipif(not Path("/proc/self/environ").exists(), reason="there is no /proc")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL], ids=lambda number: number.name)
def test_what_was_started_ends_with_who_started_it_also_children_of_children_in_sessions_of_their_own(number):
    run = subprocess.Popen(
        [sys.executable, "-c", _RUN, TESTS], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    )
    pids = [int(run.stdout.readline()) for _ in range(2)]
    assert all(map(_runs, pids))
    run.send_signal(number)
    run.wait()
    wait_until(lambda: not any(map(_runs, pids)), what="the end of what was started")
    run.stdout.close()
