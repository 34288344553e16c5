"""Parameter files as ROS 2 reads them."""

import pytest

from sma_actuator.base.parameter_file import parameters_in, read_parameter_file
from sma_actuator.base.parameters import ConfigError

OURS = "sma_actuator:\n  ros__parameters:\n    loop: {rate: 20.0}\n"


@pytest.mark.parametrize("stray", ["loop: {rate: 1.3}", "loop.rate: 1.3"])
def test_what_stands_beside_the_section_of_the_node_is_named_and_refused(stray, tmp_path):
    """As written at the end of a file where `check` says what to write: it would change nothing, and nobody say so."""
    file = tmp_path / "bench.yaml"
    file.write_text(f"{OURS}{stray}\n")
    with pytest.raises(ConfigError, match=r"loop.*: stands beside 'sma_actuator: ros__parameters:'"):
        read_parameter_file(file)
    assert parameters_in(file) == {"loop": {"rate": 20.0}}, "what switches a supply off reads it all the same"


def test_sections_of_other_nodes_may_stand_beside_it(tmp_path):
    file = tmp_path / "robot.yaml"
    file.write_text(f"{OURS}camera:\n  ros__parameters: {{fps: 30}}\nleft:\n  arm:\n    ros__parameters: {{}}\n")
    assert read_parameter_file(file) == {"loop": {"rate": 20.0}}
