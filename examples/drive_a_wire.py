"""Hold a wire of the virtual bench at three positions, in this process and in the bench's own time.

python examples/drive_a_wire.py
"""

from sma_actuator.base.share import shared_file
from sma_actuator.bench import InProcessDaq, InProcessSupply, VirtualBench, VirtualClock
from sma_actuator.config import Config
from sma_actuator.driver import Driver

config = Config.load(shared_file("config/flexinol.yaml"))
bench = VirtualBench.from_name("flexinol", seed=1)
with Driver(config, InProcessSupply(bench, config), InProcessDaq(bench, config), VirtualClock(bench)) as driver:
    driver.run_for(1.0)
    print(driver.enable(True)[1])
    for setpoint_m in (0.0026, 0.0012, 0.0021):
        driver.offer_setpoint(setpoint_m)
        output = driver.run_for(20.0)
        print(
            f"setpoint {setpoint_m * 1e3:.2f} mm, estimate {output.estimate.displacement_m * 1e3:.2f} mm, "
            f"truth {bench.truth.displacement_m * 1e3:.2f} mm at {output.command.current_A:.3f} A"
        )
