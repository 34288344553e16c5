"""What the driver says of its model's health: drifts hidden in the bench, and virtual hours without any.

    python benchmarks/health.py [--wire flexinol furukawa] [--physics NAME …] [--hours 3] [--drifts] [--json FILE]
    (make health)

For each physics each wire is characterised and identified on that bench; then it is used as on a robot, without a
reference sensor: switched on, moved about for a minute or two, switched off for a while, again and again.  Without
``--drifts``: false alarms over ``--hours`` for each physics.  With it: each drift at home in growing strength, when the
driver speaks, and what the position was wrong by until then (the bench knows it, the driver does not).  What a wire
came to in so many hours is kept (`kept.py`), so that a table may be made a physics at a time.
"""

from __future__ import annotations

import argparse
import json
import logging
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from blind_cases import ALLOYS, UNITS
from kept import MODEL, kept
from rich.console import Console
from rich.table import Table
from users_way import digest
from whole_range import CALIBRATION, WIRES, OneWire, logs_of

from sma_actuator.base.share import shared_file
from sma_actuator.base.signals import Health, Output, Quality
from sma_actuator.bench import InProcessDaq, InProcessSupply, VirtualClock, Weight
from sma_actuator.bench.hidden.hiding import HiddenBench
from sma_actuator.config import Config, read_parameter_file
from sma_actuator.console import write_json
from sma_actuator.driver import Driver
from sma_actuator.identify import identify
from sma_actuator.plant.worlds import HOME, WORLDS

LOAD_N = 0.98
REST_s, HELD_s = 40.0, 5.0
MOVES = 8
SESSION_s = 125.0  #: that a session takes, about
STRENGTHS = (0.5, 1.0, 2.0, 4.0)  #: of the unit in which the blind trial measures each effect
#: What has anything to do with the wire, its circuit or its mount; the reference sensor's faults are not the driver's.
DRIFTS = (
    "lead_resistance", "contact_drift", "voltage_offset", "reference_self_heating", "shunt", "self_heating",
    "ambient_temperature", "fatigue", "load_cell_drift", "load_cell_gain", "slip", "creep", "elastic_compliance",
    "thermal_expansion", "minor_loop_memory",
)  # fmt: skip
SESSIONS = 6
#: What decides what comes of a use, beside bench and model.
USED_BY = (
    "control/pid", "control/commanding", "control/setpoints", "safety", "config", "driver", "actuator", "derived",
    "health", "whole_range",
)  # fmt: skip


@dataclass
class Life:
    """What was seen of one wire."""

    hours: float
    state: str
    words: str
    spoke_s: float  #: bench time at which a calibration was first called due, NaN where never
    sessions: float  #: switchings-on until then
    error_percent: float  #: mean absolute error of the position, over the working range, in % of full stroke
    alarms: int  #: times that it went to due


def live(config: Config, wire: str, physics: str, hidden: dict[str, float], sessions: int, seed: int) -> Life:
    """Use one wire for so many sessions."""
    bench = HiddenBench.from_name(
        wire, seed=seed, load=Weight(LOAD_N), physics=physics, hidden=hidden, session_s=130.0 * sessions
    )
    rng = np.random.default_rng(seed)
    low_m, high_m = config.model.build(config.wire).displacement_range_m
    errors_m: list[float] = []
    seen: dict[str, Any] = {"state": Health.UNKNOWN, "alarms": 0, "spoke": (np.nan, np.nan), "session": 0}

    def look(output: Output) -> None:
        state = output.health.state
        if state is Health.DUE and seen["state"] is not Health.DUE:
            seen["alarms"] += 1
            if seen["alarms"] == 1:
                seen["spoke"] = (output.signals.time_s, seen["session"])
        seen["state"], seen["verdict"] = state, output.health
        if output.estimate.quality is Quality.DETERMINATE:
            errors_m.append(abs(output.estimate.displacement_m - output.signals.reference_displacement_m))

    clock = VirtualClock(bench)
    with Driver(config, InProcessSupply(bench, config), InProcessDaq(bench, config), clock, look) as driver:
        driver.run_for(REST_s)
        for _ in range(sessions):
            seen["session"] += 1
            driver.clear_fault()
            driver.enable(True)
            driver.run_for(HELD_s)
            for _ in range(MOVES):
                driver.offer_setpoint(float(rng.uniform(low_m, high_m)))
                driver.run_for(float(rng.uniform(4.0, 16.0)))
            driver.enable(False)
            driver.run_for(REST_s)
    return Life(
        bench.time_s / 3600.0,
        seen["state"].name.lower(),
        seen["verdict"].words,
        *seen["spoke"],
        float(np.mean(errors_m)) / config.wire.full_stroke_m * 100.0,
        seen["alarms"],
    )


def calibrated(wire: str, physics: str) -> Config:
    """The wire's own model on that bench."""
    mapping = read_parameter_file(shared_file(f"config/{wire}_bench.yaml"))
    return identify(logs_of(OneWire(wire, physics, 0.0), CALIBRATION, 1), mapping, wire).config


def unharmed(wire: str, physics: str, hours: float) -> Life:
    """So many hours without a drift, or what they came to the last time."""

    def make() -> Life:
        config = calibrated(wire, physics)
        return live(config, wire, physics, {}, max(1, round(hours * 3600.0 / SESSION_s)), seed=11)

    return kept(f"health {wire} {physics} {hours:g} h {digest(USED_BY)}", MODEL, make)


def false_alarms(args: argparse.Namespace, console: Console) -> list[dict]:
    """Hours without a drift, on each physics."""
    table = Table(title="Used, and nothing hidden", title_justify="left")
    for header in (
        "physics",
        "wire",
        "hours",
        "alarms",
        "first after",
        "verdict at the end",
        "mean error, % of stroke",
    ):
        table.add_column(header, justify="left" if header in ("physics", "wire", "verdict at the end") else "right")
    rows = []
    for physics in args.physics:
        for wire in args.wire:
            life = unharmed(wire, physics, args.hours)
            rows.append({"physics": physics, "wire": wire, **vars(life)})
            table.add_row(
                physics,
                wire,
                f"{life.hours:.1f}",
                str(life.alarms),
                "" if np.isnan(life.spoke_s) else f"{life.spoke_s:.0f} s",
                life.words[:60],
                f"{life.error_percent:.2f}",
            )
    console.print(table)
    alarmed = [f"{row['physics']}, {row['wire']}: {row['words']}" for row in rows if row["alarms"]]
    print(f"{sum(row['hours'] for row in rows):.0f} h in all; alarms in {len(alarmed)} of {len(rows)} rows")
    for words in alarmed:
        print(words)
    return rows


def drifts(args: argparse.Namespace, console: Console) -> list[dict]:
    """Each drift in growing strength."""
    (wire,) = args.wire
    config = calibrated(wire, HOME)
    usual = live(config, wire, HOME, {}, SESSIONS, seed=12).error_percent
    table = Table(title=f"{wire} at home: drifts; without one the mean error is {usual:.2f} % of stroke")
    for header in ("effect", "strength", "mean error, %", "speaks in session", "after, s"):
        table.add_column(header)
    rows = []
    for name in args.effects or DRIFTS:
        for multiple in STRENGTHS:
            strength = multiple * UNITS[name][ALLOYS.index(wire)]
            life = live(config, wire, HOME, {name: strength}, SESSIONS, seed=12)
            rows.append({"effect": name, "strength": strength, "usual_percent": usual, **vars(life)})
            spoke = "never" if np.isnan(life.spoke_s) else f"{life.sessions:.0f}"
            table.add_row(name, f"{strength:.3g}", f"{life.error_percent:.2f}", spoke, f"{life.spoke_s:.0f}")
            print(json.dumps(rows[-1]), flush=True)
    console.print(table)
    return rows


def main() -> int:
    """Print a table; returns 0."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--wire", nargs="*", choices=WIRES, default=WIRES[:1])
    parser.add_argument("--physics", nargs="*", choices=tuple(WORLDS), default=tuple(WORLDS))
    parser.add_argument("--hours", type=float, default=3.0, help="of bench time, for each physics (default 3)")
    parser.add_argument("--drifts", action="store_true", help="hide drifts instead")
    parser.add_argument("--effects", nargs="*", choices=DRIFTS, help="of these alone")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write every number here")
    args = parser.parse_args()
    if args.drifts and len(args.wire) != 1:
        parser.error("--drifts: one wire at a time")
    logging.disable(logging.CRITICAL)  # refused setpoints and the like are not what is asked
    console = Console(width=150)
    rows = drifts(args, console) if args.drifts else false_alarms(args, console)
    write_json(args, rows)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
