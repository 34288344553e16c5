"""A signal is noted wherever it comes, and what the program does with it is up to the program."""

import contextlib
import os
import signal
import subprocess
import sys
import threading

import pytest

from sma_actuator.base.interrupts import noted_signals

SIGNALS = [
    *(signal.SIGINT, signal.SIGTERM, signal.SIGQUIT, signal.SIGHUP, signal.SIGUSR1, signal.SIGUSR2, signal.SIGVTALRM),
    *(signal.SIGPROF, signal.SIGIO, signal.SIGPWR, signal.SIGXCPU, signal.SIGSTKFLT, signal.SIGRTMIN, signal.SIGRTMAX),
]


@pytest.mark.parametrize("number", SIGNALS, ids=lambda n: n.name)
def test_it_is_noted_also_where_every_exception_is_swallowed(number):
    with noted_signals() as interrupts:
        assert not interrupts
        with contextlib.suppress(BaseException):  # as a library's callback may
            os.kill(os.getpid(), number)
        assert interrupts.number == number
        os.kill(os.getpid(), signal.SIGTERM)
        assert interrupts.number == number
        with pytest.raises(KeyboardInterrupt):
            interrupts.raise_noted()


def test_afterwards_signals_do_what_they_did_before():
    before = [signal.getsignal(number) for number in SIGNALS]
    with noted_signals():
        pass
    assert [signal.getsignal(number) for number in SIGNALS] == before


def test_what_has_a_handler_of_its_own_keeps_it_and_one_block_in_another_notes_too():
    heard = []
    before = signal.signal(signal.SIGUSR1, lambda number, _: heard.append(number))
    try:
        with noted_signals() as outer, noted_signals() as inner:
            os.kill(os.getpid(), signal.SIGUSR1)
            assert not outer and not inner
            os.kill(os.getpid(), signal.SIGUSR2)
            assert inner.number == signal.SIGUSR2 and not outer
    finally:
        signal.signal(signal.SIGUSR1, before)
    assert heard == [signal.SIGUSR1]


def test_another_thread_than_the_main_one_is_left_alone():
    noted = []

    def run():
        with noted_signals() as interrupts:
            interrupts.raise_noted()
            noted.append(bool(interrupts))

    thread = threading.Thread(target=run)
    thread.start()
    thread.join(10.0)
    assert noted == [False]


_PROGRAM = """
import os, signal
from sma_actuator.base.interrupts import noted_signals
with noted_signals() as interrupts:
    os.kill(os.getpid(), signal.SIGHUP)
    print(interrupts.number)
    os.kill(os.getpid(), signal.SIGINT)
    print(interrupts.number)
"""


def test_under_nohup_a_hang_up_stays_ignored_and_ctrl_c_is_noted_also_in_the_background():
    def as_a_background_job_under_nohup():
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
        signal.signal(signal.SIGINT, signal.SIG_IGN)

    done = subprocess.run(
        [sys.executable, "-c", _PROGRAM],
        preexec_fn=as_a_background_job_under_nohup,
        capture_output=True,
        text=True,
        timeout=150,
        check=True,
    )
    assert done.stdout.split() == ["0", str(int(signal.SIGINT))]
