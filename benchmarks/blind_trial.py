"""Does tracing find what is hidden?  The command is run on sessions with undeclared effects, and its answer is judged.

    python benchmarks/blind_trial.py [--seeds N] [--quick] [--leave-out] [--json FILE]     (make blind-trial)

Every case is one session of ``blind_cases``: its logs are written, ``sma-actuator trace`` is run on
them with a model identified on calibration logs without the effect, and ``report.json`` is read.
``--leave-out`` takes the true effect out of the candidates: what should come then is *unexplained*,
or a name that these logs cannot tell from the true one.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import os
import tempfile
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
import yaml
from blind_cases import ALLOYS, LOADS, Case, cases, identified, make_logs
from rich.console import Console
from rich.progress import track
from rich.table import Table

from sma_actuator.bench.hidden import FOREIGN, TWINS
from sma_actuator.cli.main import main as sma_actuator
from sma_actuator.config import NODE_NAME
from sma_actuator.logs.files import write_atomically

DOUBLED = 2.0  #: error over that of none, from which an effect must be found
ALIKE_BEST = 1.25


def model_file(alloy: str, folder: Path) -> Path:
    """The model identified on calibration logs, as a parameter file."""
    path = folder / f"{alloy}.yaml"
    text = yaml.safe_dump(
        {NODE_NAME: {"ros__parameters": identified(alloy).to_mapping()}}, sort_keys=False, allow_unicode=True
    )
    write_atomically(path, lambda stream: stream.write(text.encode()))
    return path


def _traced(*words: str) -> dict:
    with contextlib.redirect_stderr(io.StringIO()) as said:
        code = sma_actuator(["trace", *words, "--jobs", "1", "--force"])
    if code:
        raise RuntimeError(said.getvalue())
    return json.loads((Path(words[words.index("--out") + 1]) / "report.json").read_text())


def judge(case: Case, models: str, leave_out: bool) -> dict:
    """Run the command on one case; what it said, and what knowing the truth would have given."""
    with tempfile.TemporaryDirectory(prefix="sma_blind_") as name:
        folder = Path(name)
        logs = [str(p) for p in make_logs(case, folder)]
        words = [*logs, "--config", str(Path(models) / f"{case.alloy}.yaml"), "--out", str(folder / "out")]
        left_out = ["--without", *case.hidden] if leave_out else []
        report = _traced(*words, *left_out)
        best = None
        possible = set(case.hidden) - {u["name"] for u in report["untestable"]}
        if case.kind in ("single", "pair") and possible == set(case.hidden) and not leave_out:
            best = _traced(*words[:-1], str(folder / "best"), "--only", *case.hidden)["error_after_pct_stroke"]
    return {
        "case": case.name,
        "kind": case.kind,
        "alloy": case.alloy,
        "load": case.load,
        "hidden": case.hidden,
        "ambient_logged": case.ambient_logged,
        "verdict": report["verdict"],
        "effects": [e["name"] for e in report["effects"]],
        "alternatives": [a["name"] for a in report["alternatives"]],
        "untestable": [u["name"] for u in report["untestable"]],
        "before": report["error_before_pct_stroke"],
        "after": report["error_after_pct_stroke"],
        "best": best,
        "floor": report["floor_pct_stroke"],
        "explained": report["excess_explained"],
        "loss": report["loss_after_over_calibration"],
        "best_names": [n for r in report["race"][-1:] for t in r["trials"][:1] for n in t["effects"]],
    }


def main() -> int:
    """Run the trial and print it; returns 0."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--seeds", type=int, default=1, help="times the whole list, with other seeds and loads (default %(default)s)"
    )
    parser.add_argument("--quick", action="store_true", help="strength 1 alone instead of 0.5, 1 and 2")
    parser.add_argument("--leave-out", action="store_true", help="take the true effect out of the candidates")
    parser.add_argument("--only", nargs="*", default=[], help="cases with these effects alone")
    parser.add_argument("--kinds", nargs="*", default=["none", "single", "pair", "foreign"])
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write every case here")
    args = parser.parse_args()
    chosen = cases(args.seeds, (1,) if args.quick else (0.5, 1, 2))
    chosen = [c for c in chosen if c.kind in args.kinds and (not args.only or set(args.only) & set(c.hidden))]
    if args.leave_out:
        chosen = [c for c in chosen if c.kind == "single"]
    console = Console(width=160)
    with tempfile.TemporaryDirectory(prefix="sma_blind_models_") as models:
        for alloy in ALLOYS:
            model_file(alloy, Path(models))
        with ProcessPoolExecutor(args.jobs) as pool:
            futures = [pool.submit(judge, case, models, args.leave_out) for case in chosen]
            answers = [f.result() for f in track(futures, "cases", console=Console(stderr=True))]
    if args.json:
        text = json.dumps(answers, indent=1) + "\n"
        write_atomically(args.json, lambda stream: stream.write(text.encode()))
    show(console, answers, args.leave_out)
    return 0


def show(console: Console, answers: list[dict], leave_out: bool = False) -> None:
    """Confusion matrix, rates against the aims, errors before, after and at best."""
    none = {
        (a, load): [x["before"] for x in answers if x["kind"] == "none" and x["alloy"] == a and x["load"] == load]
        for a in ALLOYS
        for load in LOADS
    }
    everything = [e for es in none.values() for e in es]

    def ratio(x):
        base = none[x["alloy"], x["load"]] or everything or [x["floor"] / 1.25]
        return x["before"] / np.mean(base)

    _confusion(console, [x for x in answers if x["kind"] == "single"], leave_out)
    if leave_out:
        doubled = [x for x in answers if ratio(x) >= DOUBLED]
        _rate(
            console,
            "unexplained said, where the error at least doubles",
            [x["verdict"] == "unexplained" for x in doubled],
            "",
        )
        others = [x for x in doubled if x["verdict"] == "traced"]
        _rate(console, "else: a single name that leaves the log clean", [len(x["effects"]) == 1 for x in others], "")
        _rate(console, "else: not the only name, alternatives are given", [bool(x["alternatives"]) for x in others], "")
        return
    doubled = [x for x in answers if x["kind"] == "single" and ratio(x) >= DOUBLED]
    _rate(console, "right effect first, where the error at least doubles", [_first(x) for x in doubled], ">= 95 %")
    _rate(console, "  or named as alternative", [_among(x) for x in doubled], "")
    weak = [x for x in answers if x["kind"] == "single" and ratio(x) < DOUBLED]
    _rate(
        console,
        "right effect first or none, where it does not",
        [_first(x) or x["verdict"] == "none" for x in weak],
        "",
    )
    _rate(console, "false alarms on none", [x["verdict"] == "traced" for x in answers if x["kind"] == "none"], "<= 5 %")
    foreign = [x for x in answers if x["kind"] == "foreign"]
    _rate(
        console,
        "unexplained said of a foreign effect above the floor",
        [x["verdict"] == "unexplained" for x in foreign if x["before"] > x["floor"]],
        ">= 90 %",
    )
    _rate(console, "confidently wrong name for a foreign effect", [x["verdict"] == "traced" for x in foreign], "")
    both = [x for x in answers if x["kind"] == "pair" and x["before"] > x["floor"]]
    _rate(
        console,
        "both effects found, of pairs above the floor",
        [set(x["hidden"]) == set(x["effects"]) for x in both],
        ">= 80 %",
    )
    _rate(
        console,
        "  or among effects and alternatives",
        [set(x["hidden"]) <= {*x["effects"], *x["alternatives"]} for x in both],
        "",
    )
    known = [x for x in answers if x["best"] and x["before"] > x["floor"]]
    _rate(
        console,
        "error after within 1.25 of the best possible",
        [x["after"] <= ALIKE_BEST * x["best"] for x in known],
        "all",
    )
    table = Table(title="mean error, % of full stroke")
    for header in ("cases", "number", "before", "after", "with the true effect known"):
        table.add_column(header, justify="left" if header == "cases" else "right")
    for kind in ("none", "single", "pair", "foreign"):
        some = [x for x in answers if x["kind"] == kind]
        if some:
            best = [x["best"] for x in some if x["best"] is not None]
            table.add_row(
                kind,
                str(len(some)),
                *(f"{np.mean([x[w] for x in some]):.2f}" for w in ("before", "after")),
                f"{np.mean(best):.2f}" if best else "",
            )
    console.print(table)
    for x in both + foreign:
        console.print(
            f"{x['kind']}: {', '.join(x['hidden'])} ({x['alloy']}, {x['load']}): {x['verdict']} {' + '.join(x['effects'])}"
        )


def _first(x: dict) -> bool:
    return bool(x["effects"]) and x["effects"][0] in x["hidden"]


def _among(x: dict) -> bool:
    return bool(set(x["hidden"]) & {*x["effects"], *x["alternatives"]})


def _rate(console: Console, what: str, right: list[bool], aim: str) -> None:
    share = f"{np.mean(right):.0%} ({sum(right)} of {len(right)})" if right else "no such case"
    console.print(f"{what}: [bold]{share}[/bold]" + (f"   aim {aim}" if aim else ""))


def _confusion(console: Console, single: list[dict], leave_out: bool) -> None:
    table = Table(
        title="what was hidden and what was said first" + (" (the true effect was no candidate)" if leave_out else "")
    )
    table.add_column("hidden")
    table.add_column("cases", justify="right")
    table.add_column("said")
    for name in (*TWINS, *FOREIGN):
        said = Counter(x["effects"][0] if x["effects"] else x["verdict"] for x in single if name in x["hidden"])
        if said:
            table.add_row(name, str(sum(said.values())), ", ".join(f"{k} {n}" for k, n in said.most_common()))
    console.print(table)


if __name__ == "__main__":
    raise SystemExit(main())
