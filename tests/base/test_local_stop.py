"""``~/stop`` without DDS: who asks on the same computer is answered, by name and domain, and only the same user is."""

import os
import subprocess
import sys
import time

import pytest

from sma_actuator.base import local_stop
from sma_actuator.base.local_stop import StopListener, ask_here

PATIENCE_s = 60.0  #: of a stalled machine
# other runs of the tests have the same names
SERVICES = [f"/arm_{os.getpid()}/{name}/stop" for name in ("left", "right")]


@pytest.fixture
def listen():
    """Listens as a process with the wires ``left`` and ``right`` does."""
    listeners = []

    def begin(stop, domain="7"):
        listeners.append(StopListener(SERVICES, domain, stop))
        return listeners[-1]

    yield begin
    for listener in listeners:
        listener.close()


def test_each_name_of_a_process_is_answered_and_no_other(listen):
    asked = []
    listen(lambda reply: (asked.append(1), reply(True, "left: off; right: off")))
    for service in SERVICES:
        assert ask_here(service, "7", PATIENCE_s) == [(True, "left: off; right: off")]
    assert len(asked) == 2
    assert ask_here("/arm/left/stopped", "7", PATIENCE_s) == []
    assert ask_here(SERVICES[0], "8", PATIENCE_s) == []  # another domain
    assert ask_here(SERVICES[0], "seven", PATIENCE_s) == []  # ROS says what is wrong with it


def test_no_domain_is_domain_0(listen):
    listen(lambda reply: reply(False, "not confirmed"), domain="0")
    assert ask_here(SERVICES[0], "", PATIENCE_s) == [(False, "not confirmed")]


def test_every_process_of_a_name_is_asked(listen):
    listen(lambda reply: reply(True, "one"))
    listen(lambda reply: reply(True, "two"))
    assert {words for _, words in ask_here(SERVICES[0], "7", PATIENCE_s)} == {"one", "two"}


def test_one_that_does_not_answer_is_not_taken_for_absent_and_one_that_ends_is_no_answer(listen):
    kept = []
    listener = listen(kept.append)
    with pytest.raises(TimeoutError):
        ask_here(SERVICES[0], "7", 0.05)
    until_s = time.monotonic() + PATIENCE_s
    while not kept and time.monotonic() < until_s:
        time.sleep(0.01)
    kept[0](True, "nobody listens any more")  # which is no error
    listener.close()
    assert ask_here(SERVICES[0], "7", PATIENCE_s) == []


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can be another user")
def test_another_user_is_not_heard(listen):
    asked = []
    listen(lambda reply: (asked.append(1), reply(True, "off")))
    code = f"""
import os
import sys
from sma_actuator.base import local_stop
os.setuid(65534)  # once all is imported: another user may not read where it lies
print(local_stop.ask_here("{SERVICES[0]}", "7", 60.0))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=PATIENCE_s)
    assert done.stdout == "[]\n", done.stderr
    assert not asked


def test_another_user_is_not_believed(listen, monkeypatch):
    listen(lambda reply: reply(True, "off"))
    monkeypatch.setattr(local_stop, "_is_trusted", lambda connection: False)
    assert ask_here(SERVICES[0], "7", PATIENCE_s) == []
