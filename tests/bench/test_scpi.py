"""The command language: spellings, chains, numbers, errors, and what each command does."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sma_actuator.bench import VirtualBench
from sma_actuator.bench.scpi import QUEUE_DEPTH, Client, ScpiDaq, ScpiSupply, accepted_headers


class Session:
    """One connection to an instrument without a socket."""

    def __init__(self, instrument):
        self.instrument, self.client = instrument, Client()

    def __call__(self, line):
        return self.instrument.execute(line, self.client)

    def error(self):
        return int(self("SYST:ERR?").split(",")[0])


@pytest.fixture
def bench():
    return VirtualBench.from_name("flexinol")


@pytest.fixture
def supply(bench):
    return Session(ScpiSupply(bench, serial="42"))


@pytest.fixture
def daq(bench):
    return Session(ScpiDaq(bench, serial="42"))


def test_they_say_who_they_are(supply, daq):
    assert re.fullmatch(r"SMA Actuator,Virtual Supply,42,\d+\.\d+", supply("*IDN?"))
    assert re.fullmatch(r"SMA Actuator,Virtual DAQ,42,\d+\.\d+", daq("*idn?"))


def test_optional_parts_and_short_forms_spell_the_same_header():
    assert set(accepted_headers("[SOURce:]CURRent[:LEVel]")) == {
        f"{s}{c}{lv}" for s in ("", "SOURCE:", "SOUR:") for c in ("CURRENT", "CURR") for lv in ("", ":LEVEL", ":LEV")
    }


@pytest.mark.parametrize(
    "line",
    [
        "CURR 0.25",
        "curr 250mA",
        ":SOURce:CURRent:LEVel:IMMediate:AMPLitude 2.5E-1",
        "SOUR:CURR:LEV .25 A",
        "VOLT 5;CURR 0.25",
        "  CURR   0.25  ",
    ],
)
def test_one_setting_has_many_spellings(supply, line):
    supply(line)
    assert float(supply("CURR?")) == pytest.approx(0.25) and supply.error() == 0


def test_a_header_after_a_semicolon_continues_the_path_or_begins_anew(supply):
    assert (
        supply("OUTP:PROT:WDOG:DEL 2;:OUTP:PROT:WDOG ON;WDOG?;:CURR?;:OUTP:PROT:WDOG:DEL?")
        == "1;0.000000E+00;2.000000E+00"
    )
    assert supply.error() == 0


@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("FOO", -113),
        ("CURR:FOO 1", -113),
        ("*FOO?", -113),
        ("CURRE 1", -113),
        ("é", -113),
        ("CURR", -109),
        ("CURR 0.1,0.2", -108),
        ("OUTP:PROT:CLE 1", -108),
        ("CURR abc", -104),
        ("CURR 1 parsec", -104),
        ("CURR nan", -104),
        ("OUTP maybe", -141),
        ("CURR 1.5", -222),
        ("CURR -0.1", -222),
        ("CURR 1e999", -222),
        ("VOLT 100", -222),
        ("OUTP:PROT:WDOG:DEL 0", -222),
        ("BENC:FAUL earthquake", -222),
        ("BENC:LOAD:WEIG -1", -222),
    ],
)
def test_what_cannot_be_obeyed_is_reported_and_changes_nothing(supply, bench, line, code):
    before = vars(bench.supply).copy()
    assert supply(line) is None
    assert supply.error() == code and supply.error() == 0
    assert {k: v for k, v in vars(bench.supply).items() if k != "last_command_s"} == {
        k: v for k, v in before.items() if k != "last_command_s"
    }


def test_the_error_queue_is_finite_and_says_so(supply):
    for _ in range(QUEUE_DEPTH + 5):
        supply("FOO")
    codes = [supply.error() for _ in range(QUEUE_DEPTH)]
    assert codes[:-1] == [-113] * (QUEUE_DEPTH - 1) and codes[-1] == -350 and supply.error() == 0
    supply("FOO")
    assert int(supply("*STB?")) & 4
    supply("*CLS")
    assert supply.error() == 0 and supply("*ESR?") == "0"


def test_event_status_tells_command_from_execution_errors(supply):
    supply("FOO;CURR 5;*OPC")
    assert int(supply("*ESR?")) == 32 + 16 + 1
    assert supply("*OPC?;*TST?") == "1;0"


def test_min_and_max(supply):
    assert [float(supply(f"CURR? {w}")) for w in ("MIN", "MAX")] == [0.0, 1.0]
    supply("VOLT MAX")
    assert float(supply("VOLT?")) == 20.0


def test_the_output_drives_the_wire_and_is_measured(supply, bench):
    supply("VOLT 6;CURR 0.2;:OUTP ON")
    bench.advance(0.1)
    assert float(supply("MEAS:CURR?")) == pytest.approx(0.2, rel=1e-3)
    assert float(supply("MEAS:VOLT?")) == pytest.approx(0.2 * (bench.truth.resistance_Ohm + 1.25), rel=1e-3)
    assert supply("STAT:OPER:COND?") == "1024"
    supply("VOLT 1")
    bench.advance(0.2)
    assert supply("STAT:OPER:COND?") == "256"
    supply("*RST")
    assert supply("OUTP?;CURR?") == "0;0.000000E+00"


def test_a_trip_is_told_latches_and_is_cleared(supply, bench):
    supply("VOLT 6;CURR 0.3;CURR:PROT 0.2;:OUTP ON")
    bench.advance(0.05)
    assert supply("OUTP?;:OUTP:PROT:TRIP?;:CURR:PROT:TRIP?;:VOLT:PROT:TRIP?;:STAT:QUES:COND?") == "0;OCP;1;0;2"
    supply("OUTP ON")
    assert supply.error() == -221 and supply("OUTP?") == "0"
    supply("*RST")
    assert supply("OUTP:PROT:TRIP?") == "OCP"
    supply("OUTP:PROT:CLE")
    assert supply("OUTP:PROT:TRIP?;:OUTP?") == "NONE;0"


def test_a_protection_can_be_switched_off(supply, bench):
    supply("VOLT 6;CURR 0.3;:CURR:PROT 0.2;:CURR:PROT:STAT OFF;:OUTP ON")
    bench.advance(0.05)
    assert supply("OUTP?;:CURR:PROT:STAT?") == "1;0"


def test_the_watchdog_counts_from_the_last_command_of_anyone(supply, bench):
    supply("VOLT 6;CURR 0.1;:OUTP ON;:OUTP:PROT:WDOG:DEL 0.5;:OUTP:PROT:WDOG ON")
    bench.advance(0.4)
    Session(supply.instrument)("*IDN?")
    bench.advance(0.8)
    assert supply("OUTP?") == "1"
    bench.advance(1.31)
    assert supply("OUTP:PROT:TRIP?") == "WDOG"


def test_the_benchs_own_commands_do_not_feed_the_watchdog(supply, bench):
    supply("VOLT 6;CURR 0.1;:OUTP ON;:OUTP:PROT:WDOG:DEL 0.5;:OUTP:PROT:WDOG ON")
    bench.advance(0.4)
    supply("BENC:TRUT?")
    bench.advance(0.6)
    assert bench.supply.trips == ["WDOG"]


def test_a_dead_watchdog_may_read_back_off(supply):
    supply("BENC:FAUL watchdog_dead,0;:OUTP:PROT:WDOG ON")
    assert supply("OUTP:PROT:WDOG?") == "0" and supply.error() == 0


def test_the_lock_keeps_others_out_until_its_owner_goes(supply):
    other = Session(supply.instrument)
    supply("SYST:RWL")
    assert supply("SYST:LOCK:OWN?") == "SELF" and other("SYST:LOCK:OWN?") == "OTHER"
    for line in ("CURR 0.1", "OUTP ON", "*RST", "SYST:RWL", "SYST:LOC", "OUTP:PROT:CLE"):
        other(line)
        assert other.error() == -203
    assert float(other("CURR?")) == 0.0
    supply("CURR 0.1")
    supply.instrument.disconnected(supply.client)
    assert other("SYST:LOCK:OWN?") == "NONE"
    other("CURR 0.2")
    assert float(other("CURR?")) == pytest.approx(0.2)


def test_a_block_holds_the_scan_in_its_order(daq, bench):
    bench.advance(0.2)
    assert daq("ROUT:SCAN (@103,101:102);SCAN?;:SAMP:COUN 3;COUN?") == "(@103,101,102);3"
    mean = [float(x) for x in daq("FETC:AVER?").split(",")]
    raw = [float(x) for x in daq("FETC?").split(",")]
    assert len(mean) == 4 and len(raw) == 12
    assert mean[0] == raw[8] == pytest.approx(0.2)
    assert raw[0] == pytest.approx(0.198)
    assert mean[1] == pytest.approx(sum(raw[1::4]) / 3) == pytest.approx((0.98 + 0.0598) / 12.7297, abs=1e-3)
    assert len(daq("FORM:READ:TIME OFF;:FETC?").split(",")) == 9


def test_read_waits_for_a_block_that_begins_now(daq, bench):
    bench.advance(0.2)
    daq("SAMP:COUN 50")
    assert float(daq("READ:AVER?").split(",")[0]) == pytest.approx(0.25)


def test_a_block_that_is_not_there_yet_is_an_error(daq, bench):
    assert daq("SAMP:COUN 50;:FETC:AVER?") is None
    assert daq.error() == -230


@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("ROUT:SCAN 101", -102),
        ("ROUT:SCAN (@99)", -222),
        ("ROUT:SCAN (@101:99)", -222),
        ("SAMP:COUN 0", -222),
        ("SAMP:COUN 2.5", -222),
        ("SAMP:COUN 5001", -222),
    ],
)
def test_an_impossible_scan_is_refused(daq, line, code):
    daq(line)
    assert daq.error() == code and daq("SAMP:COUN?;:ROUT:SCAN?") == "1;(@101,102,103,104,105)"


def test_saturated_and_failed_channels_are_marked(daq, bench):
    bench.advance(0.2)
    daq("BENC:FAUL channel_saturated,103;:BENC:FAUL channel_nan,101;:SAMP:COUN 10")
    fields = daq("FETC:AVER?").split(",")
    assert fields[1] == "NAN" and fields[3] == "9.90000000E+37"
    assert daq("BENC:FAUL?") == "channel_saturated=103,channel_nan=101"
    assert daq("BENC:FAUL:CLE;:BENC:FAUL?") == "NONE"


def test_loads_and_truth_over_scpi(supply, bench):
    for line, load_N in (("BENC:LOAD:WEIG 1.5", 1.5), ("BENC:LOAD:SCH 0,0.7,99,2", 0.7)):
        supply(line)
        bench.advance(bench.time_s + 0.01)
        assert float(supply("BENC:TRUT?").split(",")[7]) == pytest.approx(load_N)
    supply("BENC:LOAD:SPR 100,1.0;:BENC:AMB 30")
    assert "stiffness_N_m=100" in supply("BENC:LOAD?") and supply("BENC:AMB?") == "30" and supply.error() == 0


@given(
    st.lists(
        st.one_of(
            st.text(max_size=30),
            st.sampled_from(["CURR", "CURR?", "OUTP ", ";", ":", "MAX", " ", ",", "*RST", "READ?", "1e400", "(@101)"]),
        ),
        max_size=8,
    )
)
def test_no_line_whatsoever_breaks_the_instruments(parts):
    bench = VirtualBench.from_name("flexinol")
    for kind in (ScpiSupply, ScpiDaq):
        session = Session(kind(bench))
        session("".join(parts))
        session("*CLS")
        assert session("*OPC?") == "1"
    assert 0.0 <= bench.supply.current_A <= 1.0
