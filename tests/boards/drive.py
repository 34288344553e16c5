"""A program that drives the wire of a board until it is ended: ``drive.py RESOURCE``.  It prints a line once current
flows."""

import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))
from ending import signals_end_the_program
from virtual_board import CONFIG

from sma_actuator.base.parameter_file import read_parameter_file
from sma_actuator.config import Config
from sma_actuator.driver import Driver
from sma_actuator.instruments import open_instruments
from sma_actuator.instruments.clock import MonotonicClock


def config_at(resource):
    """The parameters, for a line with another name and a machine that is busy with other things."""
    mapping = read_parameter_file(CONFIG)
    for role in ("supply", "daq"):
        mapping["instruments"][role] |= {"resource": resource, "timeout": 1.0}
    mapping["safety"]["reading_timeout"] = 3.0
    return Config.from_mapping(mapping)


def main():
    config, clock = config_at(sys.argv[1]), MonotonicClock()
    with signals_end_the_program(), Driver(config, *open_instruments(config, clock), clock) as driver:
        driver.start()
        time.sleep(0.5)
        done, words = driver.enable(True, timeout_s=30.0)
        assert done, words
        print("it flows", flush=True)
        while True:
            driver.offer_setpoint(0.003)
            time.sleep(0.1)


if __name__ == "__main__":
    main()
