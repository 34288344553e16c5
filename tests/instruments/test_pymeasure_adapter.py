"""A supply through pymeasure's own driver class, over TCP."""

import importlib.util
import re
import socket
import sys
from pathlib import Path

import pytest
from accepted import UNSAFE
from stand_in_server import ScpiStandIn

from sma_actuator.base.parameters import ConfigError
from sma_actuator.config import Config
from sma_actuator.instruments import InstrumentLost, InstrumentRefused, LimitsNotHeld, open_supply, pymeasure_adapter

pytest.importorskip("pymeasure", reason="extra 'pymeasure' is not installed")
import pymeasure
from pymeasure.instruments import Instrument

E36312A = "pymeasure.instruments.keysight.KeysightE36312A"


class Chatty(Instrument):
    """A class that speaks as soon as it is made."""

    current_limit = Instrument.control("CURR?", "CURR %g", "")
    voltage_setpoint = Instrument.control("VOLT?", "VOLT %g", "")
    output_enabled = Instrument.control("OUTP?", "OUTP %d", "", cast=int)
    current = Instrument.measurement("MEAS:CURR?", "")
    voltage = Instrument.measurement("MEAS:VOLT?", "")

    id = Instrument.measurement("*IDN?", "", cast=str)

    def __init__(self, adapter):
        super().__init__(adapter, "chatty", includeSCPI=False)
        self.write("*RST")
        self.ask("MODEL?")


class Unfinished(Chatty):
    def __init__(self, adapter):
        raise TypeError("a serial number is wanted")


class Inquisitive(Chatty):
    @property
    def output_enabled(self):
        return False

    @output_enabled.setter
    def output_enabled(self, on):
        raise ValueError("its state is not known")


MADE = []


@pytest.fixture(autouse=True)
def closed():
    yield
    while MADE:
        MADE.pop().close()


@pytest.fixture
def server():
    stand_in = ScpiStandIn({"*IDN?": "Keysight Technologies,E36312A,MY1,1.0"})
    yield stand_in
    stand_in.close()


def supply_of(server, make_config, dotted=E36312A, accepted=True, **more):
    section = {"resource": server.resource if server else "x", "pymeasure_class": dotted, **more}
    changes = {
        "instruments": {"supply": section},
        "supply.allow_no_watchdog": accepted,
        "supply.watchdog_timeout": 0.0 if accepted else 1.0,
        "supply.allow_single_session": accepted,
        "supply.allow_no_trips": accepted,
    }
    MADE.append(open_supply(Config.from_mapping(make_config(**changes))))
    return MADE[-1]


def test_a_pymeasure_class_drives_its_instrument(server, make_config):
    server.replies.update(
        {"VOLT? (@1)": "6.0", "CURR? (@1)": "0.2", "MEASure:VOLTage? (@1)": "1.3", "MEAS:CURRent? (@1)": "0.2"}
    )
    supply = supply_of(server, make_config)
    supply.open()
    supply.set_current(0.2)
    supply.set_output(True)
    state = supply.read_back()
    supply.shut_down()
    supply.close()
    assert (state.current_setting_A, state.output_on, state.voltage_V, state.current_A) == (0.2, True, 1.3, 0.2)
    assert server.heard("CURR 0, (@1)", times=4)  # blind and asked for on opening; at the end; blind on closing
    off = ["OUTPut 0, (@1)", "CURR 0, (@1)"]
    assert server.lines[:3] == [*off, "*IDN?"]
    assert server.lines[-5:] == [*off, "OUTPut? (@1)", *off]
    assert "CURR 0.2, (@1)" in server.lines


def test_what_a_class_of_pymeasure_says_on_opening(server, make_config):
    server.replies.update({"VOLT? (@1)": "6.1"})  # it rounds
    supply_of(server, make_config).open()
    off = ["OUTPut 0, (@1)", "CURR 0, (@1)"]
    assert server.lines == [*off, "*IDN?", *off, "VOLT 6, (@1)", "VOLT? (@1)", "OUTPut? (@1)"]


#: One class of each family that fits → its questions and the answers, which say 6 V and 0.2 A; what it is switched off
#: by.
FAMILIES = {
    "aimtti.PL303P": (
        {"V1?": "V1 6.00", "I1?": "I1 0.200", "V1O?": "1.30V", "I1O?": "0.200A"},
        ["OP1 1", "OP1 0", "I1 0", "OP1?"],
    ),
    "keithley.Keithley2200": (
        {
            "INST:SEL CH1;VOLT?": "6.0",
            "INST:SEL CH1;CURR?": "0.2",
            "INST:SEL CH1;MEAS:VOLT?": "1.3",
            "INST:SEL CH1;MEAS:CURR?": "0.2",
        },
        [
            "INST:SEL CH1;SOURCE:OUTP:ENAB 1",
            "INST:SEL CH1;SOURCE:OUTP:ENAB 0",
            "INST:SEL CH1;CURR 0",
            "INST:SEL CH1;SOURCE:OUTP:ENAB?",
        ],
    ),
    "keithley.Keithley2260B": (
        {":SOUR:VOLT?": "6.0", ":SOUR:CURR?": "0.2", ":MEAS:VOLT?": "1.3", ":MEAS:CURR?": "0.2"},
        ["OUTPut 1", "OUTPut 0", ":SOUR:CURR 0", "OUTPut?"],
    ),
    "kepco.KepcoBOP3612": (
        {"VOLTage?": "6.0", "CURRent?": "0.2", "MEASure:VOLTage?": "1.3", "MEASure:CURRent?": "0.2"},
        ["OUTPut 1", "OUTPut 0", "CURRent 0", "OUTPut?"],
    ),
    "keysight.KeysightE36312A": (
        {"VOLT? (@1)": "6.0", "CURR? (@1)": "0.2", "MEASure:VOLTage? (@1)": "1.3", "MEAS:CURRent? (@1)": "0.2"},
        ["OUTPut 1, (@1)", "OUTPut 0, (@1)", "CURR 0, (@1)", "OUTPut? (@1)"],
    ),
    "keysight.KeysightE3631A": (
        {
            "INST:NSEL 1;:VOLT?": "6.0",
            "INST:NSEL 1;:CURR?": "0.2",
            "INST:NSEL 1;:MEAS:VOLT?": "1.3",
            "INST:NSEL 1;:MEAS:CURR?": "0.2",
        },
        ["OUTPut 1, (@1)", "OUTPut 0, (@1)", "INST:NSEL 1;:CURR 0", "INST:NSEL 1;:OUTPut?"],
    ),
    "texio.TexioPSW360L30": (
        {":SOUR:VOLT?": "6.0", ":SOUR:CURR?": "0.2", ":MEAS:VOLT?": "1.3", ":MEAS:CURR?": "0.2"},
        ["OUTPut 1", "OUTPut 0", ":SOUR:CURR 0", "OUTPut?"],
    ),
}


@pytest.mark.parametrize("family", FAMILIES)
def test_every_family_that_fits_is_opened_driven_and_switched_off(server, make_config, family):
    replies, (on, *off, question) = FAMILIES[family]
    server.replies.update({**replies, question: "0"})
    supply = supply_of(server, make_config, f"pymeasure.instruments.{family}")
    supply.open()
    assert server.lines[: len(off)] == off
    supply.set_current(0.2)
    supply.set_output(True)
    assert server.heard(on)
    server.replies[question] = "1"
    state = supply.read_back()
    assert (state.current_setting_A, state.output_on, state.voltage_V, state.current_A) == (0.2, True, 1.3, 0.2)
    server.replies[question] = "0"
    assert supply.shut_down()
    assert server.lines[-1 - len(off) :] == [*off, question]


def test_the_page_of_classes_says_what_fits_and_every_family_of_it_is_driven_above():
    page = (Path(__file__).parents[2] / "docs" / "pymeasure.md").read_text()
    drive, lack = pymeasure_adapter.survey()
    fits, fits_not = page.split("What looks like")
    if f"of pymeasure {pymeasure.__version__} " in page:  # another one may have others
        assert set(re.findall(r"`(pymeasure\.instruments\.\S+)`", fits)) - {"pymeasure.instruments"} == set(drive)
        assert set(re.findall(r"`(pymeasure\.instruments\.\S+)`", fits_not)) == set(lack)
    makers = {name.split(".")[2] for name in drive}
    assert makers == {family.partition(".")[0] for family in FAMILIES}


@pytest.mark.parametrize(
    ("dotted", "why"),
    [
        ("tdk.TDK_Gen40_38", "reads an answer to 'ADR 6', which does not ask"),
        ("eurotest.EurotestHPP120256", "reads an answer to 'STATUS,I', which does not ask"),
        ("hp.HP6632A", "has no current setting"),
        ("siglenttechnologies.SPD1168X", "has no output"),
    ],
)
def test_a_class_that_does_not_fit_is_refused_without_a_word_to_it(server, make_config, dotted, why):
    with pytest.raises(InstrumentRefused, match=f"{why}.*; write a dialect for it instead"):
        supply_of(server, make_config, f"pymeasure.instruments.{dotted}").open()
    assert server.lines == []


def test_lines_end_as_the_parameters_say(make_config):
    with socket.create_server(("127.0.0.1", 0)) as listening:
        section = {
            "resource": f"TCPIP::127.0.0.1::{listening.getsockname()[1]}::SOCKET",
            "pymeasure_class": E36312A,
            "timeout": 0.2,
            "write_termination": "crlf",
        }
        accepted = {**UNSAFE, "supply.watchdog_timeout": 0.0}
        supply = open_supply(Config.from_mapping(make_config(**{"instruments.supply": section, **accepted})))
        with pytest.raises(InstrumentLost):
            supply.open()
        with listening.accept()[0] as connection:
            heard = connection.recv(1000)
    assert heard.startswith(b"OUTPut 0, (@1)\r\nCURR 0, (@1)\r\n*IDN?\r\n")


def test_a_voltage_that_is_not_held_is_refused_on_opening_and_found_while_driving(server, make_config):
    server.replies["VOLT? (@1)"] = "6.2"
    supply = supply_of(server, make_config)
    with pytest.raises(LimitsNotHeld, match=r"does not hold supply.max_voltage, 6 V: it reads back 6.2 V"):
        supply.open()
    server.replies["VOLT? (@1)"] = "6"
    supply.open()
    server.replies["VOLT? (@1)"] = "12"
    with pytest.raises(LimitsNotHeld):
        supply.check_next_setting()


def test_an_answer_that_is_none_and_one_that_does_not_come_lose_the_supply(server, make_config):
    server.replies.update({"VOLT? (@1)": "6.0", "CURR? (@1)": "much"})
    supply = supply_of(server, make_config)
    supply.open()
    with pytest.raises(InstrumentLost, match="current setting failed"):
        supply.read_back()
    supply.open()
    server.hang_up()
    with pytest.raises(InstrumentLost, match="the connection broke") as caught:
        supply.read_back()
    assert "failed" not in str(caught.value)


def test_what_a_class_says_when_it_is_made_is_not_said_blind(server, make_config):
    server.replies.update({"MODEL?": "7", "VOLT?": "6.0"})
    supply = supply_of(server, make_config, f"{__name__}.Chatty")
    supply.open()
    assert server.lines[:4] == ["OUTP 0", "CURR 0", "*RST", "MODEL?"]


def test_a_supply_that_does_not_answer_its_class_is_lost_not_refused(server, make_config):
    server.silent_on = "MODEL?"
    server.replies["MODEL?"] = "7"
    supply = supply_of(server, make_config, f"{__name__}.Chatty", timeout=0.2)
    with pytest.raises(InstrumentLost, match="no complete answer to 'MODEL[?]'"):
        supply.open()
    server.release.set()


def test_a_class_that_cannot_be_made_or_not_switched_off_unasked_is_refused(server, make_config):
    with pytest.raises(InstrumentRefused, match="Unfinished cannot be made .a serial number is wanted"):
        supply_of(server, make_config, f"{__name__}.Unfinished").open()
    with pytest.raises(InstrumentRefused, match="Inquisitive cannot switch off without asking first .its state"):
        supply_of(server, make_config, f"{__name__}.Inquisitive").open()
    assert server.lines == []


def test_without_pymeasure_a_sentence_says_what_to_install(monkeypatch):
    for name in [name for name in sys.modules if name.partition(".")[0] == "pymeasure"]:
        monkeypatch.setitem(sys.modules, name, None)
    name = pymeasure_adapter.__name__
    spec = importlib.util.spec_from_file_location(name, pymeasure_adapter.__file__)
    bare = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(bare)
    with pytest.raises(ConfigError, match="the extra 'pymeasure' installed"):
        bare._find_class(E36312A)


def test_shut_down_works_through_a_new_connection_when_the_old_one_is_dead(server, make_config, caplog):
    server.replies.update({"VOLT? (@1)": "6.0"})
    supply = supply_of(server, make_config)
    supply.open()
    supply.set_output(True)
    assert server.heard("OUTPut 1, (@1)")
    server.hang_up()
    caplog.clear()
    assert supply.shut_down()
    last_on = len(server.lines) - server.lines[::-1].index("OUTPut 1, (@1)")
    assert {"OUTPut 0, (@1)", "CURR 0, (@1)"} <= set(server.lines[last_on:])
    assert caplog.text == ""
    supply.close()


def test_shut_down_says_so_where_the_output_stays_on(server, make_config, caplog):
    server.replies.update({"VOLT? (@1)": "6.0"})
    supply = supply_of(server, make_config)
    supply.open()
    server.replies.update({"OUTPut? (@1)": "1"})
    assert not supply.shut_down()
    assert "was told to switch off and answers that its output is on" in caplog.text
    supply.close()


def test_more_than_the_limit_is_refused_before_pymeasure_sees_it(server, make_config):
    server.replies["VOLT? (@1)"] = "6.0"
    supply = supply_of(server, make_config)
    supply.open()
    sent = len(server.lines)
    for current_A in (0.41, float("nan"), -0.1):
        with pytest.raises(InstrumentRefused, match="0 to supply.max_current"):
            supply.set_current(current_A)
    assert len(server.lines) == sent
    supply.close()


def test_no_watchdog_must_be_accepted(server, make_config):
    with pytest.raises(InstrumentRefused, match="has no communication watchdog"):
        supply_of(server, make_config, accepted=False).open()


@pytest.mark.parametrize("dotted", ("no.such.Class", "pymeasure.instruments.keysight.Nothing", "nodots"))
def test_a_class_that_is_not_there_is_refused_in_a_sentence(make_config, dotted):
    with pytest.raises(ConfigError, match="the dotted name of a class is wanted"):
        supply_of(None, make_config, dotted)


def test_a_class_that_is_no_supply_is_refused_by_what_it_lacks(server, make_config):
    with pytest.raises(InstrumentRefused, match="Agilent34410A has no current setting"):
        supply_of(server, make_config, "pymeasure.instruments.agilent.Agilent34410A").open()
