"""Turn a joint of the virtual bench with two wires against each other, in this process and in the bench's own time.

python examples/turn_a_joint.py
"""

from sma_actuator.base.share import shared_file
from sma_actuator.bench import InProcessDaq, InProcessSupply, VirtualClock
from sma_actuator.bench.joint import JointBench
from sma_actuator.config import Config, read_parameter_file
from sma_actuator.control.pair import PairParameters
from sma_actuator.pair import SteppedPair
from sma_actuator.plant.joint import parse_joint

file = shared_file("config/pair.yaml")
# A command here stands until the next; from another process they must keep coming.
parameters = PairParameters.from_mapping({**read_parameter_file(file, "joint"), "joint_command_timeout": 0.0})
configs = [Config.load(file, name) for name in parameters.wires]
stand = JointBench.from_name("flexinol", parse_joint("0.004,0.0017"), seed=1)
instruments = [(InProcessSupply(b, c), InProcessDaq(b, c)) for b, c in zip(stand.benches, configs, strict=True)]
with SteppedPair(parameters, configs, instruments, VirtualClock(stand.benches[0])) as pair:
    pair.run_for(1.0)
    print(pair.switch_on()[1])
    pair.run_for(5.0)
    for angle_rad, cocontraction_N in ((0.25, 0.8), (-0.25, 0.8), (-0.25, 1.4)):
        pair.command(angle_rad, cocontraction_N)
        seen = pair.run_for(15.0).estimate
        print(
            f"asked {angle_rad:+.2f} rad and {cocontraction_N:.1f} N, estimate {seen.angle_rad:+.2f} ± "
            f"{seen.uncertainty_rad:.2f} rad, truth {stand.angle_rad:+.2f} rad at {seen.cocontraction_N:.2f} N"
        )
