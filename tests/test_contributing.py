"""The worked examples of CONTRIBUTING.md work."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

PAGE = Path(__file__).resolve().parents[1] / "CONTRIBUTING.md"
BLOCKS = {
    heading: "\n".join(blocks)
    for heading, section in re.findall(r"\n## (.+?)\n(.*?)(?=\n## |\Z)", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    if (blocks := re.findall(r"```python\n(.*?)```", section, re.DOTALL))
}
#: What must hold once the block has been executed.
HOLDS = {
    "Add an effect": """
import numpy as np
from sma_actuator.base.signals import Signals
from sma_actuator.base.share import shared_file
from sma_actuator.config import Config
from sma_actuator.estimation.chain import Chain
config = Config.load(shared_file("config/flexinol.yaml"))
sample = Signals(0.0, 5.0, 0.2, 0.2, 1.0, 1.0 / config.wire.area_m2)
plain = Chain(config, {}).step(sample)[1].displacement_m
creeping = Chain(config, {"crimp_creep": CrimpCreep(compliance=1e-4)})
assert np.isclose(creeping.step(sample)[1].displacement_m, plain + 1e-4)
from sma_actuator.bench import HiddenBench, require_twins
require_twins({"crimp_creep": CrimpCreep.PART})
assert HiddenBench.from_name("flexinol", hidden={"crimp_creep": 1e-4}).hidden[0].strength == 1e-4
""",
    "Add a control law": """
from sma_actuator.base.share import shared_file
from sma_actuator.bench import InProcessDaq, InProcessSupply, VirtualBench, VirtualClock
from sma_actuator.config import Config, read_parameter_file
from sma_actuator.driver import Driver
mapping = read_parameter_file(shared_file("config/flexinol.yaml"))
config = Config.from_mapping({**mapping, "controller": {"type": "constant", "current": 0.12}})
bench = VirtualBench.from_name("flexinol")
with Driver(config, InProcessSupply(bench, config), InProcessDaq(bench, config), VirtualClock(bench)) as driver:
    driver.run_for(1.0)
    assert driver.enable(True)[0]
    driver.offer_setpoint(0.002)
    assert driver.run_for(2.0).command.current_A == 0.12
""",
    "Add a fault": """
assert freezing.name == "freezing" and freezing.latches
""",
    "Add a parameter": "",
}


def test_every_example_is_held_to_something():
    assert set(BLOCKS) == set(HOLDS)


@pytest.mark.parametrize("heading", BLOCKS)
def test_an_example_does_what_it_says(heading):
    # In a process of its own: what it registers is nobody else's.
    code = BLOCKS[heading] + HOLDS[heading]
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
