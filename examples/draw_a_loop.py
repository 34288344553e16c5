"""Draw how resistance and displacement of a driven wire go together: the loop that the estimator knows.

python examples/draw_a_loop.py loop.png
"""

import sys

import numpy as np

from sma_actuator.base.share import shared_file
from sma_actuator.bench import InProcessDaq, InProcessSupply, VirtualBench, VirtualClock
from sma_actuator.config import Config
from sma_actuator.driver import Driver
from sma_actuator.report import figure

config = Config.load(shared_file("config/flexinol.yaml"))
bench = VirtualBench.from_name("flexinol", seed=1)
rows = []
with Driver(config, InProcessSupply(bench, config), InProcessDaq(bench, config), VirtualClock(bench)) as driver:
    driver.run_for(1.0)
    driver.enable(True)
    driver.run_for(1.0)
    for setpoint_m in (0.0007, 0.0027, 0.0011, 0.0024, 0.0015, 0.0020, 0.0027):
        driver.offer_setpoint(setpoint_m)
        for _ in range(round(15.0 * config.loop.rate)):
            output = driver.run_for(1.0 / config.loop.rate)
            rows.append(
                (
                    bench.time_s,
                    setpoint_m,
                    output.estimate.displacement_m,
                    bench.truth.displacement_m,
                    output.signals.resistance_Ohm,
                )
            )
time_s, setpoint_m, estimate_m, truth_m, resistance_Ohm = np.array(rows).T
drawing, axes = figure(2, width_in=4.5, height_in=3.2)
over_time, loop = axes[0]
over_time.plot(time_s, setpoint_m * 1e3, lw=0.8, color="0.6", label="setpoint")
over_time.plot(time_s, truth_m * 1e3, lw=2.5, color="#9ecae1", label="true displacement")
over_time.plot(time_s, estimate_m * 1e3, lw=0.9, color="#08306b", label="estimate from resistance")
over_time.set(xlabel="time [s]", ylabel="displacement [mm]")
over_time.legend(fontsize=7)
loop.plot(resistance_Ohm, truth_m * 1e3, lw=2.5, color="#9ecae1")
loop.plot(resistance_Ohm, estimate_m * 1e3, lw=0.9, color="#08306b")
loop.set(xlabel="resistance [Ω]", ylabel="displacement [mm]")
drawing.savefig(sys.argv[1], dpi=110)
error_pct = 100.0 * np.abs(estimate_m - truth_m).mean() / config.wire.full_stroke_m
print(
    f"{sys.argv[1]}: the estimate is {error_pct:.2f} % of the stroke from the truth, in the mean of {len(rows)} samples"
)
