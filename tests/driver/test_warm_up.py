"""Before a wire is driven one that does not exist has been: what is compiled then is all that is asked for later."""

import pytest

from sma_actuator.base.share import shared_file
from sma_actuator.base.signals import Mode
from sma_actuator.config import Config, read_parameter_file
from sma_actuator.driver.warm_up import warm_up


@pytest.mark.parametrize("wire", ["flexinol", "furukawa", "flexinol_normalised", "coil"])
@pytest.mark.parametrize("rate_Hz", [1.0, 20.0, 1000.0])
def test_it_is_driven_to_the_end_and_nothing_is_wrong_with_it(wire, rate_Hz):
    mapping = read_parameter_file(shared_file(f"config/{wire}.yaml"))
    mapping["loop"] = {"rate": rate_Hz, "samples_per_block": round(1000.0 / rate_Hz)}
    mapping["safety"]["reading_timeout"] = mapping["supply"]["watchdog_timeout"] = 3.0
    said = warm_up(Config.from_mapping(mapping))
    assert (said.status.mode, said.status.fault, said.command.output_on) == (Mode.HOLD, "", True)
