"""Two wires against each other on one joint of the virtual bench: how well angle and co-contraction are held.

    python benchmarks/pair.py [--physics NAME …]     (make pair)

The joint of ``config/pair.yaml``, whose mechanism the bench has too; in the physics of home with the model of that
file, in another with the thesis's model identified from the logs of that physics (``benchmarks/users_way.py`` keeps
them), and no less co-contraction than these were.  Steps of 20 s over ±0.25 rad and sines of ±0.25 rad, with several
co-contractions and with a torque from outside.

* angle: mean absolute, every sample from the first command on, against the truth, of what was asked for (control and
  output error: of the estimate and of the truth) and of the estimate; as a displacement of the wires, in % of full
  stroke;
* covered: share of the samples in which the truth was inside the interval that was stated;
* co-contraction: mean absolute difference of what was asked for;
* tension: the highest of either wire, after every step, beside the limit.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table
from users_way import identified

from sma_actuator.bench import InProcessDaq, InProcessSupply, VirtualClock
from sma_actuator.bench.joint import JointBench
from sma_actuator.config import Config, read_parameter_file
from sma_actuator.control.pair import PairParameters
from sma_actuator.control.setpoints import Setpoint, sine, steps
from sma_actuator.pair import SteppedPair
from sma_actuator.plant.joint import Joint
from sma_actuator.plant.worlds import HOME, WORLDS

FILE = Path(__file__).resolve().parents[1] / "config" / "pair.yaml"
STEPS_rad = (0.25, -0.25, 0.1, -0.1, 0.0)
SETTLING_s, DURATION_s, PERIOD_s = 8.0, 120.0, 0.05


@dataclass(frozen=True)
class Case:
    """One run."""

    program: str
    setpoint: Setpoint
    cocontraction_N: float = 0.8
    torque_Nm: float = 0.0


CASES = (
    Case("steps of 20 s", steps(STEPS_rad, 20.0)),
    Case("steps of 20 s", steps(STEPS_rad, 20.0), cocontraction_N=0.5),
    Case("steps of 20 s", steps(STEPS_rad, 20.0), cocontraction_N=1.5),
    Case("steps of 20 s", steps(STEPS_rad, 20.0), torque_Nm=0.002),
    Case("steps of 20 s", steps(STEPS_rad, 20.0), torque_Nm=-0.004),
    Case("sine of 40 s", sine(0.0, 0.25, 40.0)),
    Case("sine of 20 s", sine(0.0, 0.25, 20.0)),
    Case("sine of 10 s", sine(0.0, 0.25, 10.0)),
)


def joint_of(parameters: PairParameters) -> Joint:
    """The mechanism, as the parameters have it."""
    first_m, second_m = parameters.displacement_at_zero
    return Joint(parameters.pulley_radius, (first_m, second_m), parameters.series_stiffness)


def run(case: Case, physics: str) -> list[str]:
    """A row of the table."""
    parameters = PairParameters.from_mapping(read_parameter_file(FILE, "joint"))
    if physics == HOME:
        config = Config.load(FILE, "left")
    else:
        config = Config.from_mapping(identified("flexinol", physics, "thesis"))
        least_N = 1.01 * config.model.build(config.wire).stress_range_Pa[0] * config.wire.area_m2
        parameters = parameters.replace({"least_cocontraction": max(parameters.least_cocontraction, least_N)})
    stand = JointBench.from_name("flexinol", joint_of(parameters), seed=7, physics=physics)
    instruments = [(InProcessSupply(bench, config), InProcessDaq(bench, config)) for bench in stand.benches]
    clock = VirtualClock(stand.benches[0])
    rows, highest_N, fault = [], 0.0, ""
    with SteppedPair(parameters, (config, config), instruments, clock) as pair:
        pair.run_for(1.0)
        done, words = pair.switch_on()
        assert done, words
        pair.run_for(SETTLING_s)
        stand.torque_Nm = case.torque_Nm
        start_s = clock.now_s()
        while (time_s := clock.now_s() - start_s) < DURATION_s and not fault:
            asked_rad = case.setpoint(time_s)
            pair.command(asked_rad, case.cocontraction_N)
            output = pair.run_for(PERIOD_s)
            fault = output.status.fault
            seen = output.estimate
            loads_N = [bench.truth.load_N for bench in stand.benches]
            highest_N = max(highest_N, *loads_N)
            rows.append((asked_rad, stand.angle_rad, seen.angle_rad, seen.uncertainty_rad, min(loads_N)))
    asked, true, seen_rad, uncertain, tension_N = np.array(rows).T
    percent = 100.0 * parameters.pulley_radius / config.wire.full_stroke_m

    def error(values: np.ndarray) -> str:
        return f"{1e3 * np.nanmean(abs(values)):.0f} ({percent * np.nanmean(abs(values)):.2f})"

    known = np.isfinite(seen_rad)
    return [
        case.program,
        f"{case.cocontraction_N:g}",
        f"{1e3 * case.torque_Nm:+g}" if case.torque_Nm else "",
        error(asked - seen_rad),
        error(asked - true),
        error(seen_rad - true),
        f"{np.mean(abs(seen_rad - true)[known] <= uncertain[known]):.0%}",
        f"{np.mean(abs(tension_N - case.cocontraction_N)):.2f}",
        f"{highest_N:.2f}",
        fault,
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--physics", nargs="+", choices=WORLDS, default=[HOME], metavar="NAME", help=", ".join(WORLDS))
    limit_N = PairParameters.from_mapping(read_parameter_file(FILE, "joint")).tension_limit
    for physics in parser.parse_args().physics:
        table = Table(title=f"{physics}: errors of the angle in mrad (% of full stroke)")
        for name in (
            "program",
            "asked N",
            "torque mN m",
            "control",
            "output",
            "estimate",
            "covered",
            "co-contraction N",
            f"highest N (of {limit_N:g})",
            "fault",
        ):
            table.add_column(name, justify="left" if name == "program" else "right")
        for case in CASES:
            table.add_row(*run(case, physics))
        Console().print(table)


if __name__ == "__main__":
    main()
