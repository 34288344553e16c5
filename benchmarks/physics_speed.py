"""How fast the virtual bench runs in each of its physics: bench seconds per second of processor time.

Both wires, a weight and a spring, four currents in turn; the best of a few rounds, taken in turn, since the machine is
shared.
"""

from __future__ import annotations

import time

from sma_actuator.bench import Spring, VirtualBench, Weight
from sma_actuator.plant.materials import WIRES
from sma_actuator.plant.worlds import HOME, WORLDS

ROUNDS = 3
SECONDS = 40.0
CURRENTS_A = (0.05, 0.3, 0.1, 0.25)


def speed(wire: str, physics: str) -> float:
    """Bench seconds per second of processor time, mean of both loads."""
    spent_s = 0.0
    for load in (Weight(0.98), Spring(200.0, 0.6)):
        bench = VirtualBench.from_name(wire, load=load, physics=physics)
        bench.supply.set_voltage(6.0)
        bench.supply.set_output(True)
        bench.advance(0.1)
        began_s = time.process_time()
        for step in range(round(SECONDS)):
            bench.supply.set_current(CURRENTS_A[step % len(CURRENTS_A)])
            bench.advance(bench.time_s + 1.0)
        spent_s += time.process_time() - began_s
    return 2.0 * SECONDS / spent_s


def main() -> None:
    """Print the table."""
    best = {(wire, name): 0.0 for wire in WIRES for name in WORLDS}
    for _ in range(ROUNDS):
        for wire, name in list(best):
            best[wire, name] = max(best[wire, name], speed(wire, name))
    print("| physics | " + " | ".join(f"{wire}, × real time | of home" for wire in WIRES) + " |")
    print("|---" * (1 + 2 * len(WIRES)) + "|")
    for name in WORLDS:
        cells = [f"{best[wire, name]:.0f} | {best[wire, name] / best[wire, HOME]:.2f}" for wire in WIRES]
        print(f"| `{name}` | " + " | ".join(cells) + " |")


if __name__ == "__main__":
    main()
