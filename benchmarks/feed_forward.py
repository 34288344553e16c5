"""What feed-forward takes off the error of the PID alone, on every physics, and with a model whose heat is wrong.

    python benchmarks/feed_forward.py [--physics NAME …] [--wire flexinol furukawa] [--load weight spring]
                                      [--law feed_forward_pid] [--json FILE]                        (make feed-forward)

Wires come the user's way (`users_way.py`) with models of the whole range; steps and sine are those of `driven.py`.
Control errors are means in % of full stroke.

* fastest: of the steps, the way that no law can shorten
* going: of the sine from its second period on; the first begins with the way from the cold to it
* less: by how much the law's error is below that of the PID
* wrong: the law's error over that of the PID alone where both are given a heat loss, or a heat capacity, that is 30 %
  too large or too small, the worst of the four; the PID needs neither, but its estimate and its limits do
* unrest: the command at held positions from sample to sample, rms, PID and law [% of max_current]
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from driven import LAWS, LOADS, Case, Found, fastest_once, once
from rich.console import Console
from rich.table import Table
from users_way import WIRES, prepared

from sma_actuator.console import write_json
from sma_actuator.plant.worlds import WORLDS

MODEL = "whole_range"
PID = "pid"
WRONG = tuple((name, times) for name in ("heat_loss", "heat_capacity") for times in (0.7, 1.3))
HEADERS = ("PID", "law", "fastest", "less", "wrong", "PID", "law", "less", "wrong", "PID", "law", "less", "unrest %")


def both(case: Case, law: str, program: str, wrong: tuple[tuple[str, float], ...] = ()) -> tuple[Found, Found]:
    """The PID and the law on the same program with the same parameters."""
    found = [once(replace(case, law=each, program=program, wrong=wrong)) for each in (PID, law)]
    return found[0], found[1]


def compared(job: tuple[Case, str]) -> dict[str, Any]:
    """The numbers of a wire under a load."""
    case, law = job
    row: dict[str, Any] = {"physics": case.physics, "wire": case.wire, "load": case.load, "law": law}
    for program in ("steps", "sine"):
        pid, own = both(case, law, program)
        row[f"{program} pid"], row[f"{program} law"] = pid.control, own.control
        row[f"{program} less"] = 1.0 - own.control / pid.control
        row[f"{program} output"] = pid.output, own.output
        wrong = [both(case, law, program, (each,)) for each in WRONG]
        row[f"{program} wrong"] = max(law.control / pid.control for pid, law in wrong)
        found = [pid, own, *(each for two in wrong for each in two)]
        row[f"{program} faults"] = sorted({f"{each.case.law}: {each.fault}" for each in found if each.fault})
        if program == "steps":
            row["unrest"] = pid.unrest, own.unrest
        else:
            row["going pid"], row["going law"] = pid.going, own.going
            row["going less"] = 1.0 - own.going / pid.going
    row["steps fastest"] = fastest_once(replace(case, program="steps"))
    return row


def table_of(rows: list[dict[str, Any]]) -> Table:
    """A row for each wire and load."""
    table = Table(
        title="Control error, % of full stroke: steps (five columns), the sine (four), and the sine going (three)",
        title_justify="left",
    )
    for header in ("physics", "wire", "load"):
        table.add_column(header)
    for header in HEADERS:
        table.add_column(header, justify="right")
    for row in rows:
        table.add_row(
            row["physics"],
            row["wire"],
            row["load"],
            *(f"{row[f'steps {name}']:.2f}" for name in ("pid", "law", "fastest")),
            f"{row['steps less']:.0%}",
            f"{row['steps wrong']:.2f}",
            *(f"{row[f'sine {name}']:.2f}" for name in ("pid", "law")),
            f"{row['sine less']:.0%}",
            f"{row['sine wrong']:.2f}",
            *(f"{row[f'going {name}']:.2f}" for name in ("pid", "law")),
            f"{row['going less']:.0%}",
            "{:.1f} {:.1f}".format(*row["unrest"]),
        )
    return table


def main() -> int:
    """Print the tables, a law after the other; returns 0."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--physics", nargs="*", choices=tuple(WORLDS), default=tuple(WORLDS))
    parser.add_argument("--wire", nargs="*", choices=WIRES, default=WIRES)
    parser.add_argument("--load", nargs="*", choices=LOADS, default=("weight", "spring"))
    parser.add_argument("--law", nargs="*", choices=LAWS, default=("feed_forward_pid",))
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write every number here")
    args = parser.parse_args()
    pairs = [(wire, physics, (MODEL,)) for physics in args.physics for wire in args.wire]
    wires = [Case(wire, physics, MODEL, load, "steps", PID) for wire, physics, _ in pairs for load in args.load]
    rows = prepared(pairs, compared, [(case, law) for law in args.law for case in wires], args.jobs)
    for law in args.law:
        its = [row for row in rows if row["law"] == law]
        print(f"{PID} and {law}")
        Console(width=150).print(table_of(its))
        less = {
            name: [row[f"{name} less"] for row in its if np.isfinite(row[f"{name} less"])]
            for name in ("steps", "sine", "going")
        }
        words = (
            f"{name} {np.mean(values):.0%} ({min(values):.0%} to {max(values):.0%})" for name, values in less.items()
        )
        print("less on average (from, to): " + ", ".join(words))
        worst = (f"{name} {max(row[f'{name} wrong'] for row in its):.2f}" for name in ("steps", "sine"))
        print("at the worst, over the PID, with a heat that is wrong: " + ", ".join(worst))
        for row in its:
            for fault in (*row["steps faults"], *row["sine faults"]):
                print(f"{row['physics']}, {row['wire']}, {row['load']}: {fault}")
    write_json(args, rows)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
