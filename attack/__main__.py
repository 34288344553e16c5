"""``python -m attack``: run attacks, print what they broke, and write their figures to docs/attack.md.

Without a name of an attack all of them are run, side by side, in pieces that are kept with their commit in
attack/kept.json; with one, it alone, and kept only ``--into`` a file.  The page is of attack/kept.json, and is written
whenever something is kept there, and by ``--show``; what is kept elsewhere does not touch it.  ``--again`` does once
more what broke a promise on code that is older than today's.
"""

from __future__ import annotations

import argparse
import contextlib
import math
import os
import subprocess
import sys
import textwrap
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path

from sma_actuator.bench.bench import VirtualBench

from .heat import UNITS, table
from .kept import ROOT, Kept, Piece, add_to, tried_again
from .kept import table as table_of_pieces
from .lines import ALL
from .result import Result, Violation
from .units import RUNNERS

PAGE = ROOT / "docs" / "attack.md"
KEPT = Path(__file__).with_name("kept.json")
#: The mischief of `lines` is done in so many parts.
LINES_PARTS = 4
TITLES = {
    "heat": "heat: how hot at half the loss, how far at the full",
    "ends": "ends of the way",
    "hours": "virtual hours",
    "lies": "sensors that lie",
    "lines": "lines between driver and instruments",
    "kills": "kills",
    "boards": "kills with a board",
    "fuzz": "ROS fuzz",
    "soak": "soak",
    "node_soak": "soak of a node",
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Attack; 0 where nothing was broken."""
    options = _options().parse_args(arguments)
    into = options.into or (KEPT if options.what == "all" or options.show or options.again else None)
    kept = Kept.read(into) if into else Kept()
    results = {} if into is None else kept.results()
    if options.again:
        kept = _try_again(into, kept, options.minutes)
    elif not options.show:
        work: list[tuple[str, tuple]] = []
        for name in TITLES if options.what == "all" else (options.what,):
            work += [(name, unit) for unit in _units(name, options, kept.next_seed.get(name, 0))]
        VirtualBench.from_name("flexinol").advance(0.01)  # compiled once, before many want it at the same time
        with _busy(options.beside):
            for name, unit, part in _run(work, options.jobs, options.minutes):
                if into is None:
                    results.setdefault(name, Result()).add(part)
                    continue
                kept = add_to(into, name, part, unit[0] + (unit[1] if name == "hours" else 1))
                results = kept.results()
                # after every part: an attack that is interrupted has its page
                _write_page(into, kept)
    whole = Result()
    for name, result in results.items():
        print(f"{TITLES[name]}: {dict(result.counts)}\n  worst: {result.worst}\n{result.verdict()}", flush=True)
        whole.add(result)
    if into is not None:
        _write_page(into, kept)
        for title, commit, on, done, why_older in table_of_pieces(kept, TITLES):
            print(f"{title}: {done}; at {commit} on {on}{why_older and f', {why_older}'}")
        print(f"kept: {into}; written: {PAGE}" if into.resolve() == KEPT else f"kept: {into}")
    return 1 if whole.violations else 0


def _try_again(into: Path, kept: Kept, minutes: float) -> Kept:
    """Do once more what broke a promise on other code, one after the other; what is kept then."""
    ends_s = time.monotonic() + 60.0 * minutes
    for name, replay in kept.to_try_again():
        if time.monotonic() > ends_s:
            break
        words = replay.removeprefix("python ").split()
        ended = subprocess.run([sys.executable, *words], cwd=ROOT, stdout=subprocess.DEVNULL, check=False).returncode
        print(f"{'held' if ended == 0 else 'broken'}: {replay}", file=sys.stderr, flush=True)
        kept = tried_again(into, name, replay, ended == 0)
        _write_page(into, kept)
    return kept


def _write_page(into: Path, kept: Kept) -> None:
    """The page tells of all that is kept in the repository, and of nothing else."""
    if into.resolve() == KEPT:
        PAGE.write_text(page(kept), encoding="utf-8")


def _units(name: str, options: argparse.Namespace, next_seed: int) -> list[tuple]:
    """The arguments of an attack's parts: small ones, so that there is something to show whenever the time is over."""
    seed = next_seed if options.seed is None else options.seed
    if name == "lines":
        numbers = list(options.only) or list(range(len(ALL)))
        parts = [numbers[part::LINES_PARTS] for part in range(min(LINES_PARTS, len(numbers)))]
        return [(seed + number, part) for number in range(options.rounds) for part in parts]
    if name == "heat":
        return [(number,) for number in options.only or range(len(UNITS))]
    if name == "lies":
        return [(number,) for number in options.only or range(len(UNITS))]
    if name == "ends":
        return [(number, options.seconds) for number in options.only or range(len(UNITS))]
    if name == "soak":
        return [(seed, options.hours)]
    if name == "node_soak":
        return [(seed, options.minutes_of_node)]
    first, whole, part = {
        "hours": (seed, options.sessions, 2),
        "kills": (seed, options.count, 20),
        "boards": (seed, options.count, 10),
        "fuzz": (seed, options.messages, 20_000),
    }[name]
    step = part if name == "hours" else 1  # a session is its own seed
    return [(first + number * step, min(part, whole - number * part)) for number in range(math.ceil(whole / part))]


def _run(work: list[tuple[str, tuple]], jobs: int, minutes: float) -> Iterator[tuple[str, tuple, Result]]:
    """An attack, the arguments of one of its parts and what it brings home, as they end; what has not begun when the
    time is over is left out."""
    # Taken in turns, so that each attack has its share where the time does not suffice for all.
    by_name = {name: [arguments for kind, arguments in work if kind == name] for name in RUNNERS}
    order = sorted(
        (number / len(jobs_of), name, arguments)
        for name, jobs_of in by_name.items()
        for number, arguments in enumerate(jobs_of)
    )
    ends_s = time.monotonic() + 60.0 * minutes
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn"), max_tasks_per_child=1) as pool:
        futures = {pool.submit(RUNNERS[name], *arguments): (name, arguments) for _, name, arguments in order}
        for future in as_completed(futures):
            name, unit = futures[future]
            if future.cancelled():
                continue
            try:
                result = future.result()
            except Exception as error:  # noqa: BLE001 - one part that breaks does not take the others' figures along
                result = Result(
                    violations=[Violation("the attack could not go on", repr(error), f"python -m attack {name}")]
                )
            done = sum(each.done() for each in futures)
            print(f"{done} of {len(futures)}: {name}", file=sys.stderr, flush=True)
            if time.monotonic() > ends_s:
                for each in futures:
                    each.cancel()
            yield name, unit, result


@contextlib.contextmanager
def _busy(number: int) -> Iterator[None]:
    """So many processes that want a core all the time."""
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(number)]
    try:
        yield
    finally:
        for each in busy:
            each.kill()
            each.wait()


INTRODUCTION = """
# The attack

An attacker does at random what instruments, operating systems and ROS 2 can do. A judge that knows only
[faults.md](faults.md), the parameter file and the virtual bench's true temperature, stress and current looks whether
the promises hold; it asks nothing of the code under test. `make attack` runs all of it in pieces and writes this page,
`python -m attack --help` says how to run one, and `tests/attack` is a short one with every test run. Every attack is
seeded; what broke a promise is listed with the command that shows it again, and `python -m attack --again` does each
of these once more on newer code.

Lines, kills and fuzz run in real time: the longest that the machine stood still is taken off once, so on a busy one its
other stalls are among what is listed here.
"""
WORST = """
The worst of each unit; `python -m attack --show` prints everything. Which lies of a sensor are found, and what they do
until then: [guards.md](guards.md#sensors-that-lie). The soaks drive a wire and its recorder for a virtual day, and a
node that is listened to and configured anew again and again: a leak would be objects by the million, or memory that
goes on growing. What a node takes each time that it is configured does not level off and is no object of Python's;
where it goes is not known.
"""
HEAT = """
Limits as `sma-actuator init` writes them; shares are of the stroke from the cold to where the wire is shortest, the
least that was held for ten minutes under a light, a middle and the largest load. Shown are the hottest wires and those
that held the least.
"""
RUN = """
Each piece is kept with its commit in `attack/kept.json`; `python -m attack --show` says what is older than the code by
now.
"""
#: Of the wires that were heated, so many of the hottest and so many of those that held the least are on the page.
EXTREMES = 5


def page(kept: Kept) -> str:
    """docs/attack.md: what it is, which promises broke, the worst that was seen, and what was run."""
    results = kept.results()
    results = {name: results[name] for name in TITLES if name in results}
    violations = [violation for result in results.values() for violation in result.violations]
    tried = [kept.again[v.replay] for v in violations if v.replay in kept.again]
    held = f"; {sum(again.held for again in tried)} of {len(tried)} held when they were tried again" if tried else ""
    lines = [
        *INTRODUCTION.strip().splitlines(),
        "",
        "## Promises broken",
        "",
        f"{len(violations)} in all{held}." if violations else "None.",
    ]
    for name, result in results.items():
        if result.violations:
            lines += ["", f"{TITLES[name]}:", ""]
            for commit, piece in kept.pieces[name].items():
                lines += [_entry(line) for line in _broken(piece, commit, kept)]
    lines += ["", "## Worst seen", *WORST.splitlines(), "", "| attack | what | worst |", "|---|---|---|"]
    for name, result in results.items():
        if name != "heat":  # it has a table of its own
            lines += [f"| {TITLES[name]} | {what} | {value:.3g} |" for what, value in _worst(result.worst)]
    if "heat" in results:
        lines += ["", f"### {TITLES['heat'].capitalize()}", *HEAT.splitlines(), ""]
        lines += table(results["heat"].worst, EXTREMES)
    lines += ["", "## What was run", *RUN.splitlines(), ""]
    lines += [
        "| attack | commit | on | how much | older than the code, when this was written |",
        "|---|---|---|---|---|",
    ]
    for *row, why_older in table_of_pieces(kept, TITLES):
        lines.append(f"| {' | '.join(row)} | {why_older.removeprefix('older than the code: ')} |")
    return "\n".join(lines) + "\n"


def _broken(piece: Piece, commit: str, kept: Kept) -> Iterator[str]:
    """What a piece broke, a line for each promise, and what came of it when that was tried again."""
    by_rule: dict[str, list[Violation]] = {}
    for violation in piece.result.violations:
        by_rule.setdefault(violation.rule, []).append(violation)
    for each in sorted(by_rule.values(), key=len, reverse=True):
        tried = [again for v in each if (again := kept.again.get(v.replay)) is not None]
        line = f"{len(each)} × {each[0]} at {commit}"
        if tried:
            held = sum(again.held for again in tried)
            line += f"; tried again at {', '.join(sorted({t.commit for t in tried}))}: {held} of {len(tried)} held"
        yield line


def _worst(worst: dict[str, float]) -> list[tuple[str, float]]:
    """The largest of each unit, which stands in brackets at the end of a name."""
    largest: dict[str, tuple[str, float]] = {}
    for what, value in sorted(worst.items(), key=lambda item: item[1]):
        largest[what.rpartition(" [")[2] if "[" in what else what] = (what, value)
    return list(largest.values())


def _entry(line: str) -> str:
    return textwrap.fill(f"- {line}", 120, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False)


def _options() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m attack", description=__doc__)
    parser.add_argument("what", nargs="?", choices=(*TITLES, "all"), default="all")
    parser.add_argument(
        "--seed", type=int, help="of the first session, mischief, kill …; without: the one after what is kept"
    )
    parser.add_argument("--sessions", type=int, default=600, help="hours: sessions of ten virtual minutes")
    parser.add_argument("--rounds", type=int, default=5, help="lines: how often every mischief is done")
    parser.add_argument(
        "--only",
        type=int,
        nargs="*",
        default=(),
        help="lines, heat, ends: numbers of the mischief, or of the wires, to take",
    )
    parser.add_argument("--seconds", type=float, default=6000.0, help="ends: virtual seconds for each load and start")
    parser.add_argument("--count", type=int, default=1000, help="kills, boards")
    parser.add_argument("--messages", type=int, default=1_000_000, help="fuzz: messages")
    parser.add_argument("--hours", type=float, default=24.0, help="soak: virtual hours")
    parser.add_argument("--minutes-of-node", type=float, default=8.0, help="node_soak: minutes that the node drives")
    parser.add_argument("--jobs", type=int, default=max(1, os.cpu_count() or 1), help="attacks side by side")
    parser.add_argument("--beside", type=int, default=0, help="processes that keep a core busy meanwhile")
    parser.add_argument("--minutes", type=float, default=math.inf, help="begin nothing more after so many minutes")
    parser.add_argument(
        "--into",
        type=Path,
        metavar="FILE",
        help=f"keep it here (all: {KEPT.name}, of which {PAGE.name} is written)",
    )
    parser.add_argument(
        "--show", action="store_true", help="attack nothing; say what is kept, and what is older; write its page anew"
    )
    parser.add_argument(
        "--again", action="store_true", help="attack nothing new; do once more what broke a promise on other code"
    )
    return parser


if __name__ == "__main__":
    sys.exit(main())
