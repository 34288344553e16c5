"""The coefficients in ``config/``: every wire characterised on the virtual bench, then identified.

    python benchmarks/coefficients.py     (make coefficients)

The exclusive models come from the wire of ``config/<wire>_bench.yaml``, the normalised ones from
three other wires of the alloy, of other lengths and diameters, so that neither is judged on a wire
it was fitted on when it is used there.  Logs and pages are left in ``out/coefficients``.
"""

from __future__ import annotations

import copy
import sys
from collections.abc import Iterable
from pathlib import Path

import yaml

from sma_actuator.base.parameter_file import parameters_in
from sma_actuator.base.yaml_text import yaml_of
from sma_actuator.cli.main import main as sma_actuator
from sma_actuator.config import NODE_NAME, read_parameter_file
from sma_actuator.plant.worlds import HOME

ROOT = Path(__file__).resolve().parents[1]
OUT = ROOT / "out" / "coefficients"
#: Length and diameter as parts of those of the bench's wire; the LVDT's 5 mm leave no room for longer ones.
OTHER_SIZES = ((0.6, 1.0), (0.8, 0.85), (0.9, 1.15))
#: On the bench of `sma-actuator bench --load joint:0.004,0.0017`.
JOINT = {
    "joint_name": "joint",
    "wires": ["left", "right"],
    "pulley_radius": 0.004,
    "displacement_at_zero": [0.0017, 0.0017],
    "series_stiffness": 2.0e4,
    "tension_limit": 2.2,
    "cocontraction": 0.8,
    "least_cocontraction": 0.3,
}


def resized(parameters: dict, length: float, diameter: float) -> dict:
    """Parameters of a wire of another size: what depends on the size is scaled with it."""
    out = copy.deepcopy(parameters)
    out["wire"]["length"] *= length
    out["wire"]["diameter"] *= diameter
    out["thermal"]["heat_capacity"] *= length * diameter**2
    out["thermal"]["heat_loss"] *= length * diameter
    for bound in ("resistance_min", "resistance_max"):
        out["safety"][bound] *= length / diameter**2
    # Power per surface decides how hot a wire gets: I² R ∝ I² L/d², surface ∝ L d.
    for current in ("max_current", "over_current_trip"):
        out["supply"][current] *= diameter**1.5
    out["supply"]["max_voltage"] *= max(1.0, length / diameter**0.5)
    return out


def characterised(name: str, parameters: dict, seed: int) -> list[str]:
    """Logs of one wire of the virtual bench; those of an earlier run are used again."""
    folder = OUT / HOME / f"{name}_{parameters['wire']['length'] * 1e3:.0f}x{parameters['wire']['diameter'] * 1e6:.0f}"
    folder.mkdir(parents=True, exist_ok=True)
    config = folder / "wire.yaml"
    config.write_text(yaml.safe_dump({NODE_NAME: {"ros__parameters": parameters}}, sort_keys=False))
    _run(
        "characterise",
        "--virtual",
        name,
        "--config",
        str(config),
        "--out",
        str(folder),
        "--skip",
        "fatigue",
        "--skip",
        "levels",
        "--seed",
        str(seed),
    )
    return sorted(str(path) for kind in ("pulses", "partial") for path in folder.glob(f"{kind}_*.csv"))


def bench_of(name: str) -> Path:
    """The parameter file of the bench with this wire."""
    return ROOT / "config" / f"{name}_bench.yaml"


def identified(name: str, model: str, logs: Iterable[str]) -> None:
    """Write the parameter file of the wire with this model, and its page."""
    written = ["--out", str(ROOT / "config" / f"{model}.yaml"), "--report", str(OUT / f"{model}.html")]
    given = ["--config", str(bench_of(name)), "--model", model, "--no-extension", "--force"]
    _run("identify", *logs, *given, *written)


def _run(*words: str) -> None:
    if code := sma_actuator(list(words)):
        sys.exit(code)


def write_pair(wire: Path, out: Path) -> None:
    """Write the parameter file of a joint that two wires like the one of a file turn, on the virtual bench."""
    sections = {}
    for number, name in enumerate(("left", "right")):
        mapping = parameters_in(wire) | {"joint_name": name}  # the tables stay where they are: beside both
        for each, port in (("supply", 5025), ("daq", 5026)):
            mapping["instruments"][each]["resource"] = f"TCPIP::127.0.0.1::{port + 2 * number}::SOCKET"
        sections[name] = {"ros__parameters": mapping}
    sections["joint"] = {"ros__parameters": JOINT}
    header = f"# Written by `python benchmarks/coefficients.py`: the wire of {wire.name} twice, and the joint.\n"
    out.write_text(header + yaml_of(sections), encoding="utf-8")


def main() -> None:
    """Write the four parameter files of wires, and that of a joint."""
    for name in ("flexinol", "furukawa"):
        parameters = read_parameter_file(bench_of(name))
        identified(name, name, characterised(name, parameters, seed=1))
        others = [
            log
            for seed, size in enumerate(OTHER_SIZES, start=2)
            for log in characterised(name, resized(parameters, *size), seed)
        ]
        identified(name, f"{name}_normalised", others)
    write_pair(ROOT / "config" / "flexinol.yaml", ROOT / "config" / "pair.yaml")


if __name__ == "__main__":
    main()
