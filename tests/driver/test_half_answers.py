"""The whole driver, in real time over TCP, with a supply that hears everything and cannot be understood.

The oracle is the bench itself, asked on a connection of its own: what flows through the wire, not
what anybody says about it.
"""

import contextlib
import itertools
import socket
import threading
import time

import pytest
from liar import Liar
from stand_ins import RealClock
from waiting import Elapsed, Stalls

from sma_actuator.bench import VirtualBench
from sma_actuator.bench.server import background
from sma_actuator.config import Config
from sma_actuator.driver import Driver
from sma_actuator.instruments import InstrumentError, open_daq, open_supply
from sma_actuator.safety.faults import FAULTS

SOON_s = 60.0  #: bound of every wait; none is expected to take long
TRIES = 10  #: to open the instruments
#: What the bench's tick and the oracle's question add to a time, and a busy machine to every switch of threads.
MEASURING_s = 0.15
#: The oracle answers in a tenth of a millisecond; while it takes longer, this thread had no turn, nor had the loop.
MOST_OF_A_LOOK_s = 0.05
OFF_s = 4.0  #: within which the output must be off: what is promised, and the stalls of a busy machine


class Oracle:
    """Asks the bench for the truth."""

    def __init__(self, port):
        self._socket = socket.create_connection(("127.0.0.1", port), SOON_s)
        self._stream = self._socket.makefile("rw", newline="\n")

    @property
    def current_A(self):
        self._stream.write("BENC:TRUT?\n")
        self._stream.flush()
        return float(self._stream.readline().split(",")[9])

    @property
    def off(self):
        return self.current_A < 1e-3  # it dies away

    def close(self):
        self._stream.close()
        self._socket.close()


class Rig:
    """A driver that drives a wire through a liar before each instrument."""

    def __init__(self, server, mapping):
        self.server = server
        self.liars = {name: Liar(server.ports[0][name]) for name in ("supply", "daq")}
        self.oracle = Oracle(server.ports[0]["daq"])
        for name, liar in self.liars.items():
            mapping["instruments"][name]["resource"] = liar.resource
        self.config = Config.from_mapping(mapping)
        self.outputs = []
        for tries_left in reversed(range(TRIES)):
            clock = RealClock()
            supply, daq = open_supply(self.config), open_daq(self.config, clock)
            self.driver = Driver(self.config, supply, daq, clock, on_output=self.outputs.append)
            try:
                self.driver.start()
                break
            except InstrumentError:  # a machine that stalls takes longer to open them than these time-outs allow
                if not tries_left:
                    raise
        self.until(self.drives, 3 * SOON_s)

    def off_within(self, fault):
        """The current is off within the time that is promised for a fault, from now on."""
        elapsed = Elapsed(MOST_OF_A_LOOK_s)
        while not self.oracle.off:
            assert elapsed.look() < FAULTS[fault].within(self.config) + MEASURING_s, self.status
            time.sleep(0.005)

    def drives(self):
        """Whether current flows; a machine that stalls may have lost an instrument meanwhile."""
        self.driver.clear_fault()
        self.driver.enable(True)
        return self.oracle.current_A > 0.04

    @property
    def status(self):
        return self.outputs[-1].status

    def until(self, condition, within_s=SOON_s):
        """Seconds until it holds."""
        elapsed = Elapsed()
        while not condition():
            assert elapsed.look() < within_s, self.status
            time.sleep(0.005)
        return elapsed.look()

    def close(self):
        self.driver.stop()
        self.oracle.close()
        for liar in self.liars.values():
            liar.close()


@pytest.fixture(scope="module")
def compiled():
    """On a fresh machine the bench's physics is compiled first."""
    VirtualBench.from_name("flexinol").advance(0.01)


@pytest.fixture
def driving(make_config, compiled):
    """A rig with current flowing; its supply's watchdog is so slow that it helps in no test."""
    with contextlib.ExitStack() as stack:

        def make(**changes):
            server = stack.enter_context(background(VirtualBench.from_name("flexinol")))
            mapping = make_config(
                **{
                    "instruments": {"supply": {"timeout": 0.4}, "daq": {"timeout": 0.4}},
                    "safety.reading_timeout": 1.0,
                    "supply.watchdog_timeout": 60.0,
                    **changes,
                }
            )
            rig = Rig(server, mapping)
            stack.callback(rig.close)
            return rig

        yield make


UNUSABLE = ("mute", "empty", "garbage", "endless", "flood")


@pytest.mark.parametrize("manner", UNUSABLE)
def test_a_supply_that_hears_but_cannot_be_understood_is_off_and_not_called_off(driving, manner):
    rig = driving()
    rig.liars["supply"].manner = manner
    rig.off_within("supply_lost")
    rig.until(lambda: rig.status.fault)
    assert rig.status.fault == "supply_lost"
    assert "told to be off, not confirmed" in rig.status.message
    assert "told to be off, not confirmed" in rig.driver.lost_instruments["supply"]
    done, words = rig.driver.enable(False)
    assert not done
    assert "told to be off, not confirmed" in words
    assert not rig.driver.clear_fault()[0]
    rig.liars["supply"].manner = "honest"
    assert rig.driver.stop(), "the session made for the end reads it back"


@pytest.mark.parametrize("manner", UNUSABLE)
def test_switching_off_says_whether_it_was_confirmed(driving, manner):
    rig = driving()
    rig.liars["supply"].manner = manner
    done, words = rig.driver.enable(False)
    assert not done
    assert "told to be off, not confirmed" in words
    assert rig.until(lambda: rig.oracle.off) < OFF_s
    rig.until(lambda: rig.status.fault in ("output_not_confirmed", "supply_lost"))
    assert not rig.driver.stop()


def test_switching_off_is_confirmed_by_an_honest_supply(driving):
    rig = driving()
    assert rig.driver.enable(False) == (True, "the output is off")
    assert rig.until(lambda: rig.oracle.off) < 1.0
    rig.until(lambda: rig.status.values["output"] == "off")
    assert rig.driver.stop()


@pytest.mark.parametrize("manner", UNUSABLE)
def test_stop_tells_a_supply_that_cannot_be_understood_and_says_that_it_is_not_confirmed(driving, manner):
    rig = driving()
    rig.liars["supply"].manner = manner
    start_s = time.monotonic()
    assert not rig.driver.stop()
    assert time.monotonic() - start_s < OFF_s
    assert rig.until(lambda: rig.oracle.off) < 1.0


def test_a_supply_that_comes_back_is_confirmed_off_before_it_is_driven_again(driving):
    rig = driving(**{"supply.watchdog_timeout": 0.4})
    rig.liars["supply"].manner = "mute"
    rig.until(lambda: rig.driver.lost_instruments)
    rig.liars["supply"].manner = "honest"
    rig.until(lambda: not rig.driver.lost_instruments)
    rig.until(lambda: rig.status.values["output"] == "off")
    assert rig.status.fault == "supply_lost"
    rig.until(rig.drives)


def test_attempts_to_reach_a_supply_that_may_be_on_leave_its_watchdog_the_time_to_cut(driving):
    rig = driving(**{"supply.watchdog_timeout": 0.4})
    liar = rig.liars["supply"]
    liar.manner = "mute"
    rig.until(lambda: rig.driver.lost_instruments)
    heard = len(liar.heard)
    with contextlib.closing(Stalls()) as stalls:  # in which a word is noted later than it was said
        rig.until(lambda: liar.opened >= 5)
    times_s = [when_s for when_s, _ in liar.heard[heard:]]
    pauses_s = [b - a for a, b in itertools.pairwise(times_s)]
    assert max(pauses_s) + stalls.lost_s > 0.4
    attempts = [when_s for when_s, line in liar.heard[heard:] if line == "*IDN?"]
    assert all(b - a + stalls.lost_s > 0.4 for a, b in itertools.pairwise(attempts[1:]))


def test_a_supply_that_obeys_nothing_is_left_in_silence_until_its_watchdog_has_cut(driving):
    rig = driving(**{"supply.watchdog_timeout": 0.4})
    liar = rig.liars["supply"]
    openings = liar.times_heard("*IDN?")
    liar.manner = "stubborn"
    with contextlib.closing(Stalls()) as stalls:  # in which a word is noted later than it was said
        done, words = rig.driver.enable(False)
        assert not done
        assert "told to be off, not confirmed" in words
        rig.until(lambda: liar.times_heard("*IDN?") > openings)
    questions = [(when_s, line) for when_s, line in liar.heard if "?" in line]
    opening = [number for number, (_, line) in enumerate(questions) if line == "*IDN?"][openings]
    silence_s = questions[opening][0] - questions[opening - 1][0]
    assert silence_s + stalls.lost_s > rig.config.supply.watchdog_timeout
    rig.until(lambda: rig.oracle.off)  # which nothing but that watchdog does; a bench that stood still is late with it
    rig.until(lambda: rig.status.fault)
    assert rig.status.fault == "output_not_confirmed"


@pytest.mark.parametrize("line", ["CURR:PROT:STAT OFF", "VOLT:PROT:STAT OFF", "CURR:PROT 1.0"])
def test_a_limit_that_somebody_else_switches_off_is_found_in_the_promised_time(driving, line):
    rig = driving(**{"instruments.supply.exclusive_lock": False})
    with socket.create_connection(("127.0.0.1", rig.server.ports[0]["supply"]), SOON_s) as bystander:
        bystander.sendall(f"SYST:REM\n{line}\n".encode())
        rig.off_within("limits_not_held")
    rig.until(lambda: rig.status.fault)
    assert rig.status.fault == "limits_not_held"
    assert ("that protection is switched off" in rig.status.message) == ("STAT" in line)
    rig.until(rig.drives)
    assert rig.server.benches[0].supply.ocp_on and rig.server.benches[0].supply.ovp_on, "opening it anew sets them"


@pytest.mark.parametrize("instrument", ["supply", "daq"])
@pytest.mark.parametrize("manner", UNUSABLE)
def test_no_answer_holds_up_the_loop(driving, instrument, manner):
    rig = driving()
    rig.liars[instrument].manner = manner
    rig.off_within(f"{instrument}_lost")
    rig.until(lambda: rig.status.fault == f"{instrument}_lost")
    steps = rig.driver.statistics().steps
    rig.until(lambda: rig.driver.statistics().steps > steps + 5)


@pytest.mark.parametrize("instrument", ["supply", "daq"])
def test_an_answer_too_many_is_noticed_and_the_connection_made_anew(driving, instrument):
    # The watchdog is no slower than usual: after an opening that failed it is left in silence for so long.
    rig = driving(**{"supply.watchdog_timeout": 1.0})
    liar = rig.liars[instrument]
    opened = liar.opened
    liar.manner = "twice"
    rig.until(lambda: liar.opened > opened)
    rig.until(lambda: rig.status.fault)  # a machine that stalls may give it another
    rig.until(lambda: rig.oracle.off)
    liar.manner = "honest"
    rig.until(lambda: not rig.driver.lost_instruments)


class TestHang:
    """What no time-out reaches: a step that does not come to an end."""

    @pytest.fixture
    def hung(self, driving):
        rig = driving()
        release = threading.Event()
        rig.hanging = threading.Event()

        def hang(*_):
            if not release.is_set():
                rig.hanging.set()
                release.wait(4 * SOON_s)

        rig.hang = hang
        rig.release = release.set
        yield rig
        release.set()

    def hang_in_the_recorder(self, rig):
        rig.driver._loop._recorder = type("Recorder", (), {"record": rig.hang})()

    def hang_in_the_supply(self, rig):
        session = rig.driver._supply._session
        ask_for = session.ask_for

        def hang_with_the_lock(*question, **how):
            with session.lock:
                rig.hang()
                return ask_for(*question, **how)

        session.ask_for = hang_with_the_lock

    @pytest.mark.parametrize("where", ["recorder", "supply"])
    def test_the_watchman_cuts_the_supply_and_the_status_says_so(self, hung, where):
        getattr(self, f"hang_in_the_{where}")(hung)
        assert hung.hanging.wait(SOON_s)
        hung.off_within("loop_hung")
        hung.until(lambda: hung.status.fault == "loop_hung")
        assert hung.status.mode.value == "off"
        assert "the control loop hangs" in hung.status.message
        assert "no step for" in hung.driver.lost_instruments["control loop"]
        hung.release()
        hung.until(lambda: not hung.driver.lost_instruments and hung.status.fault == "loop_hung")
        assert not hung.driver.enable(True)[0]
        assert hung.driver.clear_fault()[0]
        hung.until(lambda: hung.driver.enable(True)[0])

    def test_stop_does_not_wait_for_it(self, hung):
        self.hang_in_the_supply(hung)
        assert hung.hanging.wait(SOON_s)
        start_s = time.monotonic()
        assert hung.driver.stop()
        assert time.monotonic() - start_s < OFF_s
        assert hung.until(lambda: hung.oracle.off) < 1.0
