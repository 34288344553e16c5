"""A Keysight 34970A as another author has simulated it."""

import pytest
from emulators import serve

from sma_actuator.config import Config
from sma_actuator.instruments import open_daq
from sma_actuator.instruments.clock import MonotonicClock


def test_a_34970a_of_another_author_is_told_its_channels_and_read(make_config):
    mock = pytest.importorskip("scpi_control.connection.mock", reason="SCPI-Instrument-Control is not installed")
    foreign = mock.MockConnection(daq_mode=True, daq_readings="+1.10E+00,+1.1E-01,+5.0E-01,+1.30E+00,+1.3E-01,+7.0E-01")
    foreign.connect()
    port = serve(lambda line: foreign.query(line) if "?" in line else foreign.write(line))
    section = {"resource": f"TCPIP::127.0.0.1::{port}::SOCKET", "dialect": "keysight_daq970a", "timeout": 10.0}
    changes = {"instruments.daq": section, "loop.samples_per_block": 2, "safety.reading_timeout": 30.0}
    daq = open_daq(Config.from_mapping(make_config(**changes)), MonotonicClock())
    try:
        daq.open()
        reading = daq.read_block()
    finally:
        daq.close()
    assert "34970A" in daq.identity
    assert (foreign.daq_scan_list, foreign.daq_trigger_source) == ([101, 102, 103], "IMM")
    assert (reading.supply_voltage_V, reading.reference_voltage_V, reading.load_cell_voltage_V) == pytest.approx(
        (1.2, 0.12, 0.6)
    )
