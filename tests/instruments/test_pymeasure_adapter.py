"""A supply through pymeasure's own driver class, over TCP."""

import pytest
from stand_in_server import ScpiStandIn

from sma_actuator.base.parameters import ConfigError
from sma_actuator.config import Config
from sma_actuator.instruments import InstrumentRefused, open_supply

pytest.importorskip("pymeasure", reason="extra 'pymeasure' is not installed")
E36312A = "pymeasure.instruments.keysight.KeysightE36312A"


@pytest.fixture
def server():
    stand_in = ScpiStandIn({"*IDN?": "Keysight Technologies,E36312A,MY1,1.0"})
    yield stand_in
    stand_in.close()


def supply_of(server, make_config, dotted=E36312A, accepted=True):
    changes = {
        "instruments": {"supply": {"resource": server.resource if server else "x", "pymeasure_class": dotted}},
        "supply.allow_no_watchdog": accepted,
        "supply.allow_single_session": accepted,
        "supply.allow_no_trips": accepted,
    }
    return open_supply(Config.from_mapping(make_config(**changes)))


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
