"""A model file whose tables somebody cut: what does not fit is named, whoever asks first, and nothing ends in another
way."""

import copy

import pytest
from rig import Rig

from sma_actuator.base.parameters import ConfigError
from sma_actuator.base.share import shared_file
from sma_actuator.config import Config, read_parameter_file
from sma_actuator.plant.loads import Weight

SHIPPED = ("flexinol", "coil")  #: a model of the thesis, and one of the whole range


def tables(wire):
    """Section and name of every table of a shipped calibration."""
    for section, values in read_parameter_file(shared_file(f"config/{wire}.yaml"))["calibration"].items():
        if isinstance(values, dict):
            yield from (
                pytest.param(wire, section, name, id=f"{wire} {section}.{name}")
                for name, value in values.items()
                if isinstance(value, (list, tuple)) and len(value) > 1
            )


@pytest.mark.parametrize("left", [0, 1, -1], ids=["none", "one", "all but one"])
@pytest.mark.parametrize(("wire", "section", "name"), [each for wire in SHIPPED for each in tables(wire)])
def test_a_table_that_was_cut_is_named_or_not_needed(wire, section, name, left):
    mapping = copy.deepcopy(read_parameter_file(shared_file(f"config/{wire}.yaml")))
    mapping["controller"] = {"type": "pid"}  # the gains are derived, from the calibration too
    table = mapping["calibration"][section]
    table[name] = table[name][:left]
    said = ""
    try:
        config = Config.for_tools(mapping)
    except ConfigError as error:
        said = str(error)
    assert not said or f"calibration.{section}." in said
    if not said:
        Rig(config.to_mapping(), wire, Weight(0.13 if wire == "coil" else 0.98)).enable()
