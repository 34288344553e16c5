"""``loop.realtime``: what the thread of the loop is given, and the sentence where the system does not allow it."""

import os
import subprocess
import sys
import threading

import pytest
from stand_ins import RealClock, StandInDaq, StandInSupply

from sma_actuator.base import realtime
from sma_actuator.base.realtime import RealtimeRefused
from sma_actuator.base.sections import Realtime
from sma_actuator.config import Config
from sma_actuator.driver import Driver

HERE = sorted(os.sched_getaffinity(0))
MAY_HAVE_PRIORITY = os.geteuid() == 0


def in_a_thread(work):
    """What ``work`` returned or raised in a thread of its own, which takes its priority with it when it ends."""
    found = []

    def run():
        try:
            found.append(work())
        except RealtimeRefused as error:
            found.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    thread.join(60.0)
    return found[0]


def test_nothing_is_changed_where_nothing_is_asked_for():
    assert in_a_thread(lambda: (realtime.begin(Realtime()), os.sched_getscheduler(0))[1]) == os.SCHED_OTHER


def test_a_thread_runs_on_the_processors_that_it_was_given():
    assert in_a_thread(lambda: (realtime.begin(Realtime(cpus=(HERE[-1],))), os.sched_getaffinity(0))[1]) == {HERE[-1]}


def test_processors_that_do_not_exist_are_named():
    refused = in_a_thread(lambda: realtime.begin(Realtime(cpus=(1023,))))
    assert "loop.realtime.cpus: this process may not run on processor 1023; it may on processor" in str(refused)


@pytest.mark.skipif(not MAY_HAVE_PRIORITY, reason="real-time priority wants root, or rtprio in limits.conf")
def test_the_loop_has_its_priority_and_the_rest_of_the_process_none(make_config):
    supply = StandInSupply()
    config = Config.from_mapping(make_config(**{"loop.realtime": {"priority": 20, "lock_memory": True}}))
    seen, stepped = [], threading.Event()

    def look(_):
        seen.append((os.sched_getscheduler(0), os.sched_getparam(0).sched_priority))
        stepped.set()

    driver = Driver(config, supply, StandInDaq(supply), RealClock(), on_output=look)
    driver.start()
    try:
        assert stepped.wait(60.0)
    finally:
        driver.stop()
    assert seen[0] == (os.SCHED_FIFO, 20)
    assert os.sched_getscheduler(0) == os.SCHED_OTHER


#: A program without privileges, as most are.
WITHOUT = """
import os, resource
from sma_actuator.base import realtime
from sma_actuator.base.sections import Realtime
resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0))
resource.setrlimit(resource.RLIMIT_MEMLOCK, (0, 0))
if os.geteuid() == 0:
    os.setgid(65534); os.setuid(65534)
for wanted in (Realtime(priority=20), Realtime(lock_memory=True)):
    try:
        realtime.begin(wanted)
    except realtime.RealtimeRefused as error:
        print(error)
"""


def test_where_the_system_does_not_allow_it_the_sentence_says_what_would():
    done = subprocess.run([sys.executable, "-c", WITHOUT], capture_output=True, text=True, timeout=120)
    priority, memory = done.stdout.splitlines()
    assert "loop.realtime.priority" in priority and "rtprio 20" in priority and "LimitRTPRIO=20" in priority
    assert "loop.realtime.lock_memory" in memory and "memlock unlimited" in memory


def test_a_driver_that_is_refused_it_ends_with_the_output_off(make_config):
    supply = StandInSupply()
    config = Config.from_mapping(make_config(**{"loop.realtime": {"cpus": [1023]}}))
    driver = Driver(config, supply, StandInDaq(supply), RealClock())
    with pytest.raises(RealtimeRefused, match="processor 1023"):
        driver.start()
    assert driver.output_is_off
