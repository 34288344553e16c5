"""Running a plan: part after part, each finished for good before the next begins."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

from sma_actuator.config import bench_from_mapping, write_parameter_file
from sma_actuator.instruments import InstrumentLost
from sma_actuator.logs.bench_log import BenchLog, read_bench_log, write_bench_log

from .manifest import Manifest
from .operators import Operator
from .parts import RUN
from .plan import Part
from .rig import Rig, Stalled

BENCH_FILE = "bench.yaml"


def characterise(
    mapping: dict[str, Any],
    plan: Sequence[Part],
    rig: Rig,
    operator: Operator,
    folder: Path,
    progress: Callable[[Part, float], None] = lambda part, elapsed_s: None,
    first: Callable[[], None] = lambda: None,
    say: Callable[[str], None] = lambda words: None,
    virtual: Mapping[str, str] = MappingProxyType({}),
) -> Manifest:
    """Measure every part of ``plan`` that ``folder`` does not hold yet.

    ``first`` is called before the instruments are opened, where anything is left to measure; ``say`` with what a part
    found that a person should know.  ``virtual`` is what a virtual bench was asked for, its wire and physics: logs of
    another one are another wire's.
    Writes ``NAME.csv`` with its metadata for every log, ``manifest.json`` after every part, and
    ``bench.yaml``: ``mapping`` (the bench's parameters) with the calibrations that were measured.
    Raises ConfigError, InstrumentError or BenchLogError; what was finished stays, and the current is off.
    """
    folder = Path(folder)
    wire = rig.config.wire
    manifest = Manifest(folder, {**wire.size, **virtual})
    todo = [part for part in plan if not manifest.finished(part)]
    logs: dict[str, BenchLog] = {}
    for part in plan:
        if part not in todo:
            logs.update({n: read_bench_log(folder / f"{n}.csv") for n in manifest.data["parts"][part.name]["logs"]})
            progress(part, part.duration_s)
    _use_calibration(mapping, manifest, rig, folder)
    if not todo:
        return manifest
    first()
    with rig.opened():
        for part in todo:
            progress(part, 0.0)
            run = partial(RUN[part.kind], part, rig, operator, logs, partial(progress, part))
            try:
                outcome = run()
            except (InstrumentLost, Stalled) as error:  # one answer in an hour; the output is off
                say(f"{error}; {part.name} begins anew")
                rig.supply.open()
                rig.daq.open()
                outcome = run()
            for name, log in outcome.logs.items():
                write_bench_log(folder / f"{name}.csv", log)
            logs.update(outcome.logs)
            manifest.finish(part, list(outcome.logs), outcome.results, outcome.calibration)
            _use_calibration(mapping, manifest, rig, folder)
            progress(part, part.duration_s)
            if outcome.words:
                say(outcome.words)
    return manifest


def _use_calibration(mapping: dict[str, Any], manifest: Manifest, rig: Rig, folder: Path) -> None:
    """Let the rig, and ``bench.yaml``, use the calibrations measured so far."""
    merged = {k: dict(v) if isinstance(v, dict) else v for k, v in mapping.items()}
    for dotted, value in manifest.data["calibration"].items():
        section, name = dotted.split(".")
        merged.setdefault(section, {})[name] = value
    rig.config = bench_from_mapping(merged)
    measured = dict.fromkeys(manifest.data["calibration"], "measured")
    write_parameter_file(folder / BENCH_FILE, merged, "Written by `sma-actuator characterise`.", measured)
