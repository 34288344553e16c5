"""Logs as another lab might send them, of a wire whose physics this project has not been made on.

    python docs/tutorials/strangers_logs.py FOLDER

Eight CSV files and nothing beside them: four weights, full pulses and partial ones.  50 Hz, time in ms, voltage over
the wire in V, current in mA, load in grams, contraction in mm; readings are missing here and there.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from sma_actuator.base.share import shared_file
from sma_actuator.bench import InProcessDaq, InProcessSupply, VirtualBench, VirtualClock, Weight
from sma_actuator.characterise import Rig
from sma_actuator.characterise.programs import Drive
from sma_actuator.config import bench_from_mapping, read_parameter_file
from sma_actuator.logs.bench_log import signals_from_log

RATE_Hz, COLD_A, HOT_A = 50.0, 0.05, 0.36
GRAMS = (50, 100, 150, 200)
FULL = [(COLD_A, 1.0)] + [(HOT_A, 5.0), (COLD_A, 7.0)] * 3
LONGEST_m = 0.0052


def partial(rng: np.random.Generator) -> list[tuple[float, float]]:
    """Pulses that turn back early, in the heat and in the cold."""
    steps = [(COLD_A, 1.0), (HOT_A, 5.0), (COLD_A, 7.0)]
    for _ in range(7):
        steps += [(HOT_A * rng.uniform(0.9, 1.0), rng.uniform(0.7, 1.8)), (COLD_A, rng.uniform(0.7, 2.4))]
    return [*steps, (COLD_A, 6.0)]


def main() -> int:
    """Write the files."""
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    mapping = read_parameter_file(shared_file("config/flexinol_bench.yaml"))
    config = bench_from_mapping({**mapping, "loop": {"rate": RATE_Hz, "samples_per_block": 10}})
    for number, grams in enumerate(GRAMS):
        for name in ("full", "partial"):
            rng = np.random.default_rng((number, name == "full"))
            bench = VirtualBench.from_name("flexinol", number, Weight(grams * 9.80665e-3), physics="foreign")
            rig = Rig(config, InProcessSupply(bench, config), InProcessDaq(bench, config), VirtualClock(bench))
            steps = FULL if name == "full" else partial(rng)
            with rig.opened():
                currents_A = np.concatenate([np.full(round(s * RATE_Hz), amperes) for amperes, s in steps])
                s = signals_from_log(rig.record(Drive(float(amperes)) for amperes in currents_A), config)
            columns = {
                "t": 1e3 * (s.time_s - s.time_s[0]),
                "U_wire": s.current_A * s.resistance_Ohm,
                "I": 1e3 * s.current_A,
                "weight": s.load_N / 9.80665e-3,
                "stroke": 1e3 * (LONGEST_m - s.reference_displacement_m),
            }
            kept = np.ones(len(s.time_s), dtype=bool)
            for start in rng.integers(100, len(kept) - 20, 4):
                kept[start : start + rng.integers(1, 8)] = False
            table = np.column_stack([column[kept] for column in columns.values()])
            header = ";".join(columns)
            np.savetxt(folder / f"{name}_{grams}g.csv", table, "%.6g", ";", header=header, comments="")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
