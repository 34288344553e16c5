"""Does tracing find what is hidden?  The command is run on sessions with undeclared effects, and its answer is judged.

    python benchmarks/blind_trial.py [--physics NAME …] [--models TYPE …] [--every N] [--minutes M] (make blind-trial)

Every case is a session of ``blind_cases``, or a set of some: its logs are written, ``sma-actuator trace`` is run on
them with a model identified on calibration logs of the same physics without the effect, and ``report.json`` is read.
Each effect is traced three times: blind, with the true effect taken out of the candidates, and with it alone.

Of the single effects only those count that raise the error by half or more over the same session without them.

What is kept on disk (``out/kept``) makes the next run cheap, so that a trial may be run in pieces: with ``--minutes``
no case is begun after so long, and what is printed is of all cases that are judged by then.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import io
import itertools
import json
import math
import os
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
import yaml
from blind_cases import ALLOYS, Case, cases, make_logs, sessions_of, undisturbed
from fits_from_nothing import THESIS, WHOLE_RANGE, identified
from kept import MODEL, kept
from rich.console import Console
from rich.progress import track
from rich.table import Table
from scipy.stats import binomtest

from sma_actuator.bench.hidden import FOREIGN, TWINS, require_twins
from sma_actuator.cli.main import main as sma_actuator
from sma_actuator.config import NODE_NAME, Config
from sma_actuator.console import write_json
from sma_actuator.diagnosis.trace.limits import LIMITS
from sma_actuator.estimation.effects import EFFECTS
from sma_actuator.logs.bench_log import read_bench_log
from sma_actuator.logs.experiments import IdentificationError
from sma_actuator.plant.worlds import DRAWN, HOME, WORLDS, world_of
from sma_actuator.replay import replay
from sma_actuator.report import figure

RAISED = 1.5  #: error over that of the same session without the effect, from which it must be found
KINDS = ("none", "single", "pair", "foreign")
MOST_COLUMNS = 8  #: of the table, so many physics can be read beside each other
MOST_NAMES = 3  #: in a set that still says something
DRAWS = 200  #: of what may be true where probabilities hold
#: What should come, beside every figure.
AIMS = {
    "noticed": ">= 95 %",
    "right first": ">= 85 %",
    "in a set of 3": ">= 95 %",
    "false alarms": "<= 3 %",
    "foreign unexplained": ">= 90 %",
    "wrong name left out": "<= 25 %",
    "of those told apart": "<= 25 %",
    "after / known": "<= 1.15",
    "most probable is true": "",
    "p / of the true": ">= 0.75",
    "p / calibration error": "<= 0.08",
    "p / that of what holds": "",
    "said 80-100 %, true": ">= 85 %",
    "seconds / a session": "",
}
#: What is hidden, as the probabilities call it, of the kinds of which it has no name.
TRUTH = {"none": "nothing", "foreign": "something else"}


def _traced(logs: Sequence[str], model: str, out: Path, *words: str) -> dict:
    command = ["trace", *logs, "--config", model, "--out", str(out), "--jobs", "1", "--force", *words]
    with contextlib.redirect_stderr(io.StringIO()) as said, contextlib.redirect_stdout(io.StringIO()):
        code = sma_actuator(command)
    if code:
        raise RuntimeError(said.getvalue())
    return json.loads((out / "report.json").read_text())


def judge(case: Case, model: str, only_blind: bool, until_s: float = math.inf) -> dict | None:
    """What the command says of one case, and what knowing the truth would give; kept, so that a trial may be run in
    parts.

    ``model``: THESIS, the alloy's own, or WHOLE_RANGE.  None where it is not kept and, by the monotonic clock, it is
    too late to begin.
    """
    late = time.monotonic() > until_s
    of_model = "" if model == THESIS else f" {model}"
    return kept(
        f"judged {case} {only_blind}{of_model}",
        (*MODEL, "diagnosis"),
        None if late else lambda: _judge(case, model, only_blind),
    )


def _judge(case: Case, model_type: str, only_blind: bool) -> dict:
    with tempfile.TemporaryDirectory(prefix="sma_blind_") as name:
        folder = Path(name)
        logs = [str(p) for p in make_logs(case, folder)]
        config = identified(case.alloy, case.physics, model_type)
        parameters = {NODE_NAME: {"ros__parameters": config.to_mapping()}}
        (folder / "model.yaml").write_text(yaml.safe_dump(parameters, sort_keys=False))
        model = str(folder / "model.yaml")
        begun_s = time.process_time()
        report = _traced(logs, model, folder / "out")
        spent_s = time.process_time() - begun_s
        without, best = None, None
        single = case.kind == "single"
        possible = set(case.hidden) <= set(TWINS) - {u["name"] for u in report["untestable"]}
        raised = 1.0
        if case.hidden:
            sessions = sessions_of(case)
            raised = _error_percent(sessions, config) / _error_percent([undisturbed(s) for s in sessions], config)
        if single and raised >= RAISED and not only_blind:
            without = _traced(logs, model, folder / "without", "--without", *case.hidden)
            if possible:
                best = _traced(logs, model, folder / "best", "--only", *case.hidden)["error_after_pct_stroke"]
    return {
        "case": case.name,
        "kind": case.kind,
        "physics": case.physics,
        "model": model_type,
        "alloy": case.alloy,
        "load": case.load,
        "program": case.program,
        "hidden": case.hidden,
        "ambient_logged": case.ambient_logged,
        "raised": raised,
        "verdict": report["verdict"],
        "sentence": report["sentence"],
        "effects": [e["name"] for e in report["effects"]],
        "names": report["names"],
        "untestable": [u["name"] for u in report["untestable"]],
        "before": report["error_before_pct_stroke"],
        "after": report["error_after_pct_stroke"],
        "best": best,
        "explained": report["excess_explained"],
        "left_out": None if without is None else without["verdict"],
        "said_instead": None if without is None else [e["name"] for e in without["effects"]],
        "probable": report["probable"],
        "seconds": spent_s,
    }


def _error_percent(sessions: Sequence[Case], config: Config) -> float:
    """Mean |estimate − measurement| of sessions, in % of the full stroke, over the full range."""
    with tempfile.TemporaryDirectory(prefix="sma_blind_") as folder:
        logs = [read_bench_log(path) for session in sessions for path in make_logs(session, Path(folder))]
    errors = [r.errors["model"].full_percent for r in replay(logs, {"model": config})]
    return float(np.average(errors, weights=[len(log) for log in logs]))


def _with_every_kind(chosen: Sequence[Case], every: int, turn: int, turns: int) -> list[Case]:
    """Every so-many-th case of each kind, at least one; the first of them hold every kind too.

    The turns begin spread over what is skipped, so that together they see as many effects as they can.
    """
    kinds = [[c for c in chosen if c.kind == kind] for kind in KINDS]
    parts = [part[turn * min(every, len(part)) // turns :: every] for part in kinds]
    placed = [(i / len(part), case) for part in parts for i, case in enumerate(part)]
    return [case for _, case in sorted(placed, key=lambda x: x[0])]


def _options() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--physics",
        nargs="*",
        type=_physics,
        default=(HOME,),
        metavar="NAME",
        help=f"of the bench (default {HOME}): {', '.join(WORLDS)}, or {DRAWN} and a number: one that nobody chose",
    )
    parser.add_argument(
        "--models",
        nargs="*",
        choices=(THESIS, WHOLE_RANGE),
        default=(THESIS,),
        help="the type of model that is identified and traced (default %(default)s: the alloy's own)",
    )
    parser.add_argument(
        "--seeds",
        type=int,
        nargs="*",
        default=(0,),
        metavar="K",
        help="the whole list once for each K, with other seeds, loads and signs (default %(default)s)",
    )
    parser.add_argument(
        "--strengths", type=float, nargs="*", default=(0.5, 1.0, 2.0), help="of the single effects, at home 1 doubles"
    )
    parser.add_argument(
        "--elsewhere", action="store_true", help="sessions of other currents, under other loads, logged more rarely"
    )
    parser.add_argument(
        "--sessions", type=int, default=1, metavar="K", help="in each case, under one load after the other"
    )
    parser.add_argument(
        "--one-alloy", action="store_true", help="one alloy of each physics, in turn: half as many models to identify"
    )
    parser.add_argument("--every", type=int, default=1, metavar="N", help="every Nth case of each kind alone")
    parser.add_argument("--only", nargs="*", default=[], help="cases with these effects alone")
    parser.add_argument("--kinds", nargs="*", choices=KINDS, default=KINDS)
    parser.add_argument(
        "--only-blind",
        action="store_true",
        help="neither without the true effect nor with it alone: in a third of the time",
    )
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--minutes", type=float, default=math.inf, metavar="M", help="begin no case after so long")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write every case here")
    parser.add_argument(
        "--picture", type=Path, metavar="FILE", help="draw the probabilities said against what was true"
    )
    return parser


def main() -> int:
    """Run the trial and print it; returns 0."""
    args = _options().parse_args()
    require_twins({name: effect.PART for name, effect in EFFECTS.items()})
    until_s = time.monotonic() + 60.0 * args.minutes
    todo = _that_have_a_model([(case, model) for case in _asked(args) for model in args.models])
    found = track(_answers(todo, args.jobs, args.only_blind, until_s), "cases", len(todo), console=Console(stderr=True))
    answers = [answer for answer in found if answer is not None]
    write_json(args, answers)
    if len(answers) < len(todo):
        print(f"{len(answers)} of {len(todo)} cases: the same command goes on")
    show(Console(width=160), answers)
    if args.picture:
        draw(args.picture, [_most_probable(x) for x in answers if _asked_for(x)])
    return 0


def _physics(name: str) -> str:
    try:
        world_of(name)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from error
    return name


def _asked(args: argparse.Namespace) -> list[Case]:
    """The cases that were asked for, every physics in turn: a part of them is a part of each."""
    lists = []
    for turn, physics in enumerate(args.physics):
        listed = cases(args.seeds, tuple(args.strengths), physics, args.elsewhere)
        listed = [c for c in listed if not args.one_alloy or c.alloy == ALLOYS[turn % len(ALLOYS)]]
        listed = [dataclasses.replace(c, sessions=args.sessions) for c in listed]
        listed = [c for c in listed if c.kind in args.kinds and (not args.only or set(args.only) & set(c.hidden))]
        lists.append(_with_every_kind(listed, args.every, turn, len(args.physics)))
    return [case for row in itertools.zip_longest(*lists) for case in row if case is not None]


def _that_have_a_model(asked: Sequence[tuple[Case, str]]) -> list[tuple[Case, str]]:
    """The cases of wires that can be identified, each with a type of model; says of which not, and why."""
    lacking = set()
    for wire in sorted({(c.alloy, c.physics, model) for c, model in asked}):
        try:
            identified(*wire)  # here, so that not every process does
        except IdentificationError as error:
            lacking.add(wire)
            print(f"left out, {', '.join(wire)}: {error}")
    return [(c, model) for c, model in asked if (c.alloy, c.physics, model) not in lacking]


def _answers(todo: Sequence[tuple[Case, str]], jobs: int, only_blind: bool, until_s: float) -> Iterator[dict | None]:
    """What is said of each case; None of those that are neither kept nor begun in time."""
    if jobs == 1:
        yield from (judge(*case, only_blind, until_s) for case in todo)
        return
    with ProcessPoolExecutor(jobs) as pool:
        for future in [pool.submit(judge, *case, only_blind, until_s) for case in todo]:
            yield future.result()


def figures(answers: Sequence[dict]) -> dict[str, tuple[float, int]]:
    """Every figure of :data:`AIMS` with the number of cases that it stands on."""
    none = [x for x in answers if x["kind"] == "none"]
    raised = [x for x in answers if x["kind"] == "single" and x["raised"] >= RAISED]
    foreign = [x for x in answers if x["kind"] == "foreign" and x["raised"] >= RAISED]
    known = [x for x in raised if x["best"]]
    rates = {
        "noticed": [x["verdict"] != "none" for x in raised],
        "right first": [_first(x) for x in raised],
        "in a set of 3": [_among(x) for x in raised],
        "false alarms": [x["verdict"] != "none" for x in none],
        "foreign unexplained": [x["verdict"] == "unexplained" for x in foreign],
        "wrong name left out": [x["left_out"] == "traced" for x in raised if x["left_out"]],
        "of those told apart": [x["left_out"] == "traced" for x in raised if x["left_out"] and _told_apart(x)],
        "after / known": [x["after"] / x["best"] for x in known],
        "seconds / a session": [x["seconds"] for x in answers],
    }
    said = [(*_most_probable(x), _of_the_true(x)) for x in answers if _asked_for(x)]
    rates |= {
        "most probable is true": [true for _, true, _ in said],
        "p / of the true": [share for _, _, share in said],
        "said 80-100 %, true": [true for share, true, _ in said if share >= 0.8],
    }
    out = {name: (float(np.mean(values)) if values else np.nan, len(values)) for name, values in rates.items()}
    best = [(share, true) for share, true, _ in said]
    out["p / calibration error"] = (calibration_error(best), len(said))
    out["p / that of what holds"] = (calibration_error_by_chance([share for share, _ in best]), len(said))
    return out


def _asked_for(x: dict) -> bool:
    """Whether it was said how probable the truth is: that these logs could show it, and that it is one thing."""
    return bool(x["probable"]) and x["kind"] != "pair" and not set(x["hidden"]) & set(x["untestable"])


def _true_name(x: dict) -> str:
    return TRUTH.get(x["kind"]) or next(iter(x["hidden"]))


def _most_probable(x: dict) -> tuple[float, bool]:
    """Probability of what was most probable, and whether that is true."""
    name = max(x["probable"], key=lambda n: x["probable"][n])
    return x["probable"][name], name == _true_name(x)


def _of_the_true(x: dict) -> float:
    return x["probable"].get(_true_name(x), 0.0)


def _told_apart(x: dict) -> bool:
    """Whether these logs tell the true effect from every other name where all are tried; where they do not, what
    another name leaves is no more than a session without any leaves, and nobody can tell."""
    others = [share for name, share in x["probable"].items() if name not in (*TRUTH.values(), *x["hidden"])]
    return _of_the_true(x) >= math.exp(LIMITS.told) * max(others, default=0.0)


def by_tenth(said: Sequence[tuple[float, bool]]) -> list[tuple[int, int, float, float]]:
    """(tenth, cases, probability said in the mean, share that was true) of what was said with such a probability."""
    out = []
    for tenth in range(10):
        some = [(p, true) for p, true in said if min(int(10.0 * p), 9) == tenth]
        if some:
            out.append((tenth, len(some), float(np.mean([p for p, _ in some])), float(np.mean([t for _, t in some]))))
    return out


def calibration_error(said: Sequence[tuple[float, bool]]) -> float:
    """Expected calibration error: how far what is said is from what is true, in the mean over tenths by their
    cases."""
    return sum(n * abs(p - true) for _, n, p, true in by_tenth(said)) / len(said) if said else math.nan


def calibration_error_by_chance(shares: Sequence[float]) -> float:
    """Mean calibration error of so many cases in which each of these probabilities holds: few cases show one too."""
    rng = np.random.default_rng(0)
    drawn = rng.random((DRAWS, len(shares))) < np.array(shares)
    return float(np.mean([calibration_error(list(zip(shares, true, strict=True))) for true in drawn]))


def draw(path: Path, said: Sequence[tuple[float, bool]]) -> None:
    """Write a picture of what was said against what was true."""
    drawing, axes = figure(1, 1)
    ax, found = axes[0, 0], by_tenth(said)
    ax.plot([0.0, 1.0], [0.0, 1.0], color="0.7")
    ax.scatter([p for _, _, p, _ in found], [true for *_, true in found], s=[20.0 * n for _, n, _, _ in found])
    ax.set(xlabel="probability said", ylabel="share that was true", xlim=(0.0, 1.05), ylim=(-0.05, 1.05))
    drawing.savefig(path)


def show(console: Console, answers: Sequence[dict]) -> None:
    """The figures per physics, if these are few, and per model, of all with 95 % intervals of the shares; what was
    said of each effect, pair and nothing."""
    parts: dict[str, Sequence[dict]] = {}
    for key in ("physics", "model"):
        values = list(dict.fromkeys(x[key] for x in answers))
        if 1 < len(values) <= MOST_COLUMNS:
            parts |= {value: [x for x in answers if x[key] == value] for value in values}
    physics = list(dict.fromkeys(x["physics"] for x in answers))
    parts["all" if parts else ", ".join(physics)] = answers
    table = Table(title=f"tracing, blind: share (of so many cases); physics {', '.join(physics)}")
    table.add_column("")
    table.add_column("aim")
    for header in parts:
        table.add_column(header, justify="right")
    columns = [(figures(part), part is answers or part[0]["model"] == value) for value, part in parts.items()]
    for name, aim in AIMS.items():
        table.add_row(name, aim, *(_cell(name, *column[name], interval) for column, interval in columns))
    console.print(table)
    models = list(dict.fromkeys(x["model"] for x in answers))
    for model in (*models, None) if len(models) > 1 else (None,):
        _tenths(console, [x for x in answers if model in (x["model"], None)], model)
    _said(console, [x for x in answers if x["kind"] == "single" and x["raised"] >= RAISED])
    both = [x for x in answers if x["kind"] == "pair" and x["raised"] >= RAISED]
    if both:
        found = [set(x["hidden"]) == set(x["effects"]) for x in both]
        among = [set(x["hidden"]) <= set(x["names"]) for x in both]
        console.print(f"pairs: both named {np.mean(found):.0%}, both in the set {np.mean(among):.0%} of {len(both)}")
    for x in answers:
        if x["kind"] == "none" and x["verdict"] != "none":
            what = f"{x['model']}, {x['alloy']}, {x['load']}, {x['program']}"
            console.print(f"false alarm: {x['physics']}, {what}: {x['verdict']} {' + '.join(x['effects'])}")


def _cell(name: str, value: float, number: int, interval: bool) -> str:
    """A figure as it stands in the table: of how many cases, and a share with its binomial 95 % interval."""
    if not number:
        return ""
    if "/" in name:
        return f"{value:.2f} ({number})"
    low, high = binomtest(round(value * number), number).proportion_ci()
    return f"{value:.0%} ({number}{f': {100 * low:.0f}-{100 * high:.0f}' if interval else ''})"


def _tenths(console: Console, answers: Sequence[dict], model: str | None) -> None:
    tenths = Table(
        title="what was said to be most probable, and how often it was true" + (f", {model}" if model else "")
    )
    for header in ("said with", "cases", "said in the mean", "true"):
        tenths.add_column(header, justify="right")
    for tenth, n, p, true in by_tenth([_most_probable(x) for x in answers if _asked_for(x)]):
        tenths.add_row(f"{10 * tenth}-{10 * tenth + 10} %", str(n), f"{p:.0%}", f"{true:.0%}")
    console.print(tenths)


def _said(console: Console, raised: Sequence[dict]) -> None:
    table = Table(title=f"what was said first of the effects that raise the error at least {RAISED:g} times")
    for header in ("hidden", "cases", "said", "said where it was no candidate"):
        table.add_column(header, justify="right" if header == "cases" else "left")
    for name in (*TWINS, *FOREIGN):
        some = [x for x in raised if name in x["hidden"]]
        if not some:
            continue
        said = Counter(x["effects"][0] if x["effects"] else x["verdict"] for x in some)
        instead = Counter((x["said_instead"][0] if x["said_instead"] else x["left_out"]) for x in some if x["left_out"])
        words = [", ".join(f"{k} {n}" for k, n in c.most_common()) for c in (said, instead)]
        table.add_row(name, str(len(some)), *words)
    console.print(table)


def _first(x: dict) -> bool:
    return bool(x["effects"]) and x["effects"][0] in x["hidden"]


def _among(x: dict) -> bool:
    return len(x["names"]) <= MOST_NAMES and bool(set(x["hidden"]) & set(x["names"]))


if __name__ == "__main__":
    raise SystemExit(main())
