"""Short characterisations of the virtual bench, for all tests that want logs or a model."""

from __future__ import annotations

import json

from sma_actuator.base.share import shared_file
from sma_actuator.bench import InProcessDaq, InProcessSupply, VirtualBench, VirtualClock
from sma_actuator.characterise import PlanOptions, Rig, characterise, make_plan
from sma_actuator.characterise.operators import BenchOperator
from sma_actuator.cli.main import main
from sma_actuator.config import bench_from_mapping, read_parameter_file
from sma_actuator.logs.bench_log import read_bench_log

SHORT = PlanOptions(
    loads_N=(0.3, 0.6, 1.2, 2.0),
    masses_kg=(0.02, 0.1, 0.2),
    pulses=2,
    set_points=3,
    training_cycles=0,
    fatigue_cycles=6,
    probe_places=4,
    average_s=1.0,
)


def bench_mapping(wire):
    """The parameters of the bench with one of its two wires."""
    return read_parameter_file(shared_file(f"config/{wire}_bench.yaml"))


def virtual_rig(wire, seed=0, **bench_options):
    """(bench, rig, operator) in virtual time."""
    config = bench_from_mapping(bench_mapping(wire))
    bench = VirtualBench.from_name(wire, seed=seed, **bench_options)
    rig = Rig(config, InProcessSupply(bench, config), InProcessDaq(bench, config), VirtualClock(bench))
    return bench, rig, BenchOperator(bench, config.wire.max_stress * config.wire.area_m2, config.wire.full_stroke_m)


class Characterised:
    """A folder of logs with what is needed to use it."""

    def __init__(self, wire, folder, **bench_options):
        self.wire, self.folder = wire, folder
        _, rig, operator = virtual_rig(wire, **bench_options)
        self.manifest = characterise(bench_mapping(wire), make_plan(rig.config, SHORT), rig, operator, folder)
        self.mapping = read_parameter_file(folder / "bench.yaml")
        self.paths = sorted(folder.glob("*.csv"))
        self.logs = [read_bench_log(path) for path in self.paths]

    def only(self, *words):
        """The logs whose name contains one of the words."""
        return [log for log in self.logs if any(word in log.name for word in words)]


def identified(logs, bench, out, *words, model="flexinol"):
    """What ``sma-actuator identify`` finds in logs, order 2, as its ``--json`` has it; the model is in ``out``."""
    found = out.with_suffix(".json")
    command = ["identify", *map(str, logs), "--config", str(bench), "--model", model, "--order", "2", "--jobs", "1"]
    assert main([*command, "--out", str(out), "--json", str(found), *words]) == 0
    return json.loads(found.read_text())
