"""The driver against power supplies that others wrote: driven, told to stop, killed, slowed, answered late, cut off.

What is judged is the emulator's own state, asked through its back door, not what anybody says about it.
"""

import contextlib
import json
import signal
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
import yaml
from accepted import UNSAFE
from counterpart import HERE, Emulator, Rig, SerialLine, SOON_s, python_with
from emulators import EMULATORS
from liar import Liar
from waiting import STARTS_SOON, Elapsed, Stalls

from sma_actuator.config import Config
from sma_actuator.instruments import InstrumentRefused, open_supply
from sma_actuator.instruments.dialect import FOLDER
from sma_actuator.safety.faults import FAULTS

TIMEOUT_s = 0.5  #: instruments.supply.timeout here
#: What the back door's question adds to a time, and a busy machine to every switch of threads; half of the shortest
#: promise.
MEASURING_s = 0.5
STOP_s = 1.0  #: Driver.stop()
STOOD_STILL_s = 0.3  #: a third of safety.reading_timeout here: less of it is never most of the time between two steps


@dataclass(frozen=True)
class Counterpart:
    """What its owner would write into the parameter file."""

    dialect: str  #: shipped, or a file in ``dialects``
    unknown: tuple[
        str, ...
    ] = ()  #: commands of the real instrument, or lines of them, that the emulator's author left out
    supply: dict = field(default_factory=dict)  #: more of instruments.supply
    emulator: str = ""  #: where that has another name
    serial: bool = False  #: whether it is reached over a serial line
    zero_A: float = 0.0  #: what it takes for 0 A
    rate_Hz: float = 10.0  #: that it can be driven at
    slow_rate_Hz: float = 5.0  #: where every answer takes 20 ms more

    def dialect_file(self, folder):
        """The dialect without what the emulator does not know."""
        own = HERE / "dialects" / f"{self.dialect}.yaml"
        source = own if own.exists() else FOLDER / own.name
        document = yaml.safe_load(source.read_text())
        for name, lines in list(document["commands"].items()):
            if name in self.unknown:
                del document["commands"][name]
            elif isinstance(lines, list):
                document["commands"][name] = [line for line in lines if line not in self.unknown]
        path = folder / own.name
        path.write_text(yaml.safe_dump(document))
        return str(path)


COUNTERPARTS = {
    "instro": Counterpart("instro"),
    "rigol_dp832": Counterpart("rigol_dp800", unknown=("prepare", "lock", "unlock")),
    "siglent_spd3303x": Counterpart("siglent_spd", rate_Hz=5.0, slow_rate_Hz=3.4),
    "siglent_spd1168x": Counterpart("siglent_spd1000x", rate_Hz=5.0, slow_rate_Hz=3.4),
    "tti_pl303": Counterpart("aimtti_pl", supply={"read_termination": "lf"}),
    "keithley_2400": Counterpart("keithley_2400", unknown=("OUTP:SMOD HIMP", "SOUR:CLE:AUTO OFF", "SENS:VOLT:RANG 20")),
    "keithley_2450": Counterpart("keithley_2450"),
    "labwire": Counterpart("labwire", zero_A=1e-4),
    "scpi_control": Counterpart("siglent_spd", rate_Hz=5.0, slow_rate_Hz=3.4),
    "lewis_genesys": Counterpart("tdk_genesys", supply={"channel": 6}, rate_Hz=5.0, slow_rate_Hz=4.0),
    "lewis_genesys_serial": Counterpart(
        "tdk_genesys",
        supply={"channel": 6, "serial": {"baud_rate": 19200}},
        emulator="lewis_genesys",
        serial=True,
        rate_Hz=5.0,
        slow_rate_Hz=4.0,
    ),
    # 20 ms an answer
}


# That over a serial line only where all are (`make counterparts`): the line of the boards is one too.
@pytest.fixture(
    scope="module",
    params=[pytest.param(name, marks=pytest.mark.long) if of.serial else name for name, of in COUNTERPARTS.items()],
)
def running(request):
    """An emulator for all tests; each leaves it switched off."""
    name = COUNTERPARTS[request.param].emulator or request.param
    module = EMULATORS[name][1]
    python = python_with(module)
    if python is None:
        pytest.skip(f"{module} is not installed; `make counterparts` installs it and runs these tests")
    one = Emulator(name, python)
    yield request.param, one
    one.close()


@pytest.fixture
def emulator(running):
    """The same, with a line of its own that no test before has disturbed."""
    _, one = running
    one.liar = Liar(one.ports["port"])
    assert not one.back_door.state().on
    yield one
    one.liar.close()


@pytest.fixture
def counterpart(running):
    return COUNTERPARTS[running[0]]


@pytest.fixture
def resource(emulator, counterpart):
    if not counterpart.serial:
        yield emulator.liar.resource
        return
    line = SerialLine(emulator.liar.port, b"\r")
    yield line.resource
    line.close()


@pytest.fixture
def make_mapping(resource, counterpart, make_config, tmp_path):
    """The parameters of its owner."""
    supply = {
        "resource": resource,
        "dialect": counterpart.dialect_file(tmp_path),
        "timeout": TIMEOUT_s,
        **counterpart.supply,
    }
    common = {
        "instruments.supply": supply,
        "loop.rate": counterpart.rate_Hz,
        "safety.reading_timeout": 1.0,
        "supply.watchdog_timeout": 0.0,
        **UNSAFE,
    }
    return lambda **changes: make_config(**{**common, **changes})


@pytest.fixture
def make_rig(emulator, make_mapping):
    with contextlib.ExitStack() as stack:

        def make(**changes):
            one = Rig(make_mapping(**changes), emulator.back_door, emulator.liar)
            stack.callback(one.close)
            one.driver.start()
            return one

        yield make


@pytest.fixture
def rig(make_rig):
    return make_rig()


def off_within(rig, promised_s):
    """The emulator's output is off within the promised time from now on."""
    with contextlib.closing(Stalls()) as stalls:
        begun_s = time.monotonic()
        while rig.is_on:
            assert stalls.since(begun_s) < promised_s + MEASURING_s, rig.status
            time.sleep(0.002)


def test_it_is_driven_to_a_setpoint_and_switched_off(rig, counterpart):
    rig.drive()
    start_m = rig.wire.bench.truth.displacement_m
    rig.reach(0.0025)
    assert abs(start_m - 0.0025) > 5e-4
    assert rig.status.fault == "" and rig.driver.refusals() == []
    assert rig.driver.enable(False)[0]
    assert not rig.is_on
    assert rig.driver.stop()
    state = rig.back_door.state()
    assert (state.on, state.setting_A) == (False, counterpart.zero_A)


def test_answers_that_come_too_late_switch_it_off_and_are_said_so(rig):
    with contextlib.closing(Stalls()) as stalls:
        for _ in range(10):
            rig.drive()
            stood_s = stalls.lost_s
            rig.liar.late_s = 2.0 * TIMEOUT_s
            off_within(rig, FAULTS["supply_lost"].within(rig.config))
            rig.until(lambda: rig.status.fault)
            if stalls.lost_s - stood_s < STOOD_STILL_s:
                break
            rig.liar.late_s = 0.0  # a machine that stood still is named itself: once more
    assert rig.status.fault in ("supply_lost", "output_not_confirmed"), rig.status.message
    rig.liar.late_s = 0.0
    rig.until(lambda: not rig.driver.lost_instruments)
    assert not rig.is_on
    rig.drive()


def test_a_slow_one_is_driven_all_the_same(make_rig, counterpart):
    rig = make_rig(**{"loop.rate": counterpart.slow_rate_Hz})
    rig.liar.late_s = 0.02
    rig.drive()
    rig.reach(0.0025)
    assert rig.status.fault == ""
    assert rig.driver.enable(False)[0] and not rig.is_on


def test_a_connection_that_is_cut_is_made_anew_with_off_first(rig):
    rig.drive()
    rig.liar.hang_up()
    off_within(rig, FAULTS["supply_lost"].within(rig.config))


def test_stop_has_it_off_and_confirmed_within_its_second(rig):
    rig.drive()
    begun_s = time.monotonic()
    with contextlib.closing(Stalls()) as stalls:
        confirmed = rig.driver.stop()
        took_s = stalls.since(begun_s)
    assert confirmed and not rig.is_on
    assert took_s < STOP_s + MEASURING_s


@pytest.fixture
def program(emulator, make_mapping):
    """Starts a program that drives through the emulator; current flows when it is handed out."""
    started = []

    def start():
        one = subprocess.Popen(
            [sys.executable, str(HERE / "drive.py"), str(emulator.ports["back_door"])],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=STARTS_SOON,
        )
        started.append(one)
        one.stdin.write(json.dumps(make_mapping()))
        one.stdin.close()
        assert one.stdout.readline() == "it flows\n"
        assert emulator.back_door.state().on
        return one

    yield start
    for one in started:
        one.kill()
        one.wait()
        one.stdout.close()


def test_a_program_that_is_told_to_end_switches_it_off(emulator, program, counterpart):
    one = program()
    one.send_signal(signal.SIGTERM)
    one.wait(60.0)
    state = emulator.back_door.state()
    assert (state.on, state.setting_A) == (False, counterpart.zero_A)


def is_free(supply):
    """Whether no other process speaks to it."""
    try:
        with supply.claimed():
            return True
    except InstrumentRefused:
        return False


def test_after_a_killed_program_it_is_off_and_the_next_ones_first_words_are_off(emulator, program, make_mapping):
    one = program()
    one.kill()
    one.wait()
    mapping = make_mapping()
    dialect = yaml.safe_load(Path(mapping["instruments"]["supply"]["dialect"]).read_text())
    last_words = np.atleast_1d(dialect["commands"].get("unlock", [])).tolist()
    supply = open_supply(Config.from_mapping(mapping))
    elapsed = Elapsed()  # it has no watchdog: a process of its own says off, and reads it back
    while emulator.back_door.state().on or not is_free(supply):
        assert elapsed.look() < SOON_s
        time.sleep(0.005)
    heard = len(emulator.liar.heard)
    try:
        supply.open()
        assert not emulator.back_door.state().on
        first = [line for _, line in emulator.liar.heard[heard:]]
        while first[0] in last_words:  # of the process that said off: a serial line carries them later
            first.pop(0)
        assert first[: len(supply._session.off_lines)] == list(supply._session.off_lines)
    finally:
        supply.close()
