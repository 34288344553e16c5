"""Another VISA library than pyvisa-py: the simulated one of pyvisa's authors, over every interface that it has."""

import pytest
import pyvisa
from accepted import UNSAFE
from counterpart import HERE
from pyvisa.ctwrapper import IVIVisaLibrary

from sma_actuator.config import Config
from sma_actuator.instruments import InstrumentRefused, open_supply

RESOURCES = (
    "GPIB0::6::INSTR",
    "TCPIP0::localhost::2268::SOCKET",
    "ASRL7::INSTR",
    "USB0::0x0483::0x1234::1405537::INSTR",
)
SIMULATED = f"{HERE / 'simulated.yaml'}@sim"


@pytest.fixture
def make_supply(make_config):
    made = []

    def make(backend, resource=RESOURCES[0]):
        section = {"resource": resource, "backend": backend, "dialect": "keithley_2260b", "timeout": 10.0}
        changes = {
            "instruments.supply": section,
            "safety.reading_timeout": 30.0,
            "supply.watchdog_timeout": 0.0,
            **UNSAFE,
        }
        made.append(open_supply(Config.from_mapping(make_config(**changes))))
        return made[-1]

    yield make
    for supply in made:
        supply.close()


@pytest.mark.parametrize("resource", RESOURCES)
def test_a_supply_of_pyvisa_sim_is_opened_driven_and_switched_off(make_supply, resource):
    pytest.importorskip("pyvisa_sim", reason="pyvisa-sim is not installed")
    supply = make_supply(SIMULATED, resource)
    supply.open()
    supply.set_current(0.2)
    supply.set_output(True)
    state = supply.read_back()
    assert (state.current_setting_A, state.output_on, state.voltage_V, state.current_A) == (0.2, True, 1.3, 0.2)
    bystander = pyvisa.ResourceManager(SIMULATED).open_resource(resource, read_termination="\n", write_termination="\n")
    try:
        assert bystander.query("OUTP?") == "ON"
        assert supply.shut_down()
        assert (bystander.query("OUTP?"), float(bystander.query("SOUR:CURR?"))) == ("OFF", 0.0)
    finally:
        bystander.close()


@pytest.mark.parametrize("backend", ("ivi", "nonsense", "/nowhere/devices.yaml@sim"))
def test_a_backend_that_cannot_be_loaded_is_refused_in_a_sentence(make_supply, backend):
    if backend == "ivi" and IVIVisaLibrary.get_library_paths():
        pytest.skip("a VISA library is installed here")
    with pytest.raises(
        InstrumentRefused, match=f"instruments.supply.backend: '{backend}' cannot be loaded .*; py needs"
    ):
        make_supply(backend).open()
