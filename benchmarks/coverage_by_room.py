"""Run tests under coverage, child processes included, and print what is covered, room by room.

    python benchmarks/coverage_by_room.py [--guards] [--report FILE.json]     (make coverage, make floor)

Without options all tests; ``--guards`` takes the rooms that say what current may flow, with their own tests alone.
Either fails where less of a room is covered than its floor; the second not where a test does (``make test`` judges
that).  Kernels that numba compiles are left out (coverage does not see compiled code); ``--report`` reads the report of
an earlier run instead of running the tests.
"""

from __future__ import annotations

import argparse
import collections
import json
import re
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
REPORT = ROOT / "out" / "coverage.json"
TESTS = ("-n", "4", "--dist", "loadscope", "--no-loadscope-reorder", "-m", "not long")
#: Without those that drive a wire's whole physics: half of the time, and one line in a hundred.
GUARDS = (
    *("tests/safety", "tests/control", "tests/base", "tests/test_actuator.py"),
    *(f"--ignore=tests/safety/test_{name}.py" for name in ("hot_end", "heat", "contradicted")),
)
ROOMS = ("sma_actuator", "sma_msgs_py")
#: Lines of a room that the tests of :data:`GUARDS` reach at the least [%]: about one below what they did when this was
#: written (docs/results/coverage.txt), so that a change is not refused for a line, and a guard without a test is.
FLOOR = {"sma_actuator/safety": 98, "sma_actuator/control": 97, "sma_actuator/actuator": 97, "sma_actuator/base": 91}
#: What all tests reached of every room, as it was printed …
PRINTED = ROOT / "docs" / "results" / "coverage.txt"
#: … and how far below that a room may fall [%]: twice what its own tests may, since these lines are also reached by
#: tests of processes, which do not always come by the same; of rooms with so few lines, one may be more than that.
BELOW, FEW_LINES = 2.0, 100


def floors(guards: bool) -> dict[str, float]:
    """Share of its lines that the tests are to reach of each room [%]."""
    if guards:
        return dict(FLOOR)
    _, of_all_tests = PRINTED.read_text(encoding="utf-8").split("coverage_by_room.py\n")
    rooms = re.findall(r"^(sma\S+) +(\d+) +(\d+\.\d) %", of_all_tests, re.MULTILINE)
    return {room: float(percent) - BELOW for room, lines, percent in rooms if int(lines) >= FEW_LINES}


def room_of(file: str) -> str:
    """``sma_actuator/safety`` of ``sma_actuator/safety/guards/wire.py``; a file at the top is its own room."""
    return "/".join(Path(file).parts[:2])


def measured(tests: tuple[str, ...], rooms: Iterable[str], report: Path) -> int:
    """Run the tests, looking at these rooms alone, which costs a third of looking at all; their exit code."""
    report.parent.mkdir(exist_ok=True)
    looked_at = [f"--cov={room}" for room in rooms]
    page = f"--cov-report=html:{report.with_suffix('')}"
    command = [sys.executable, "-m", "pytest", *TESTS, *tests, *looked_at, f"--cov-report=json:{report}", page]
    return subprocess.run(command, check=False, cwd=ROOT, stdout=sys.stderr).returncode


def shares(found: collections.Counter) -> tuple[str, str]:
    """Of a room's lines, and of its branches."""
    kinds = (("covered_lines", "num_statements"), ("covered_branches", "num_branches"))
    return tuple(f"{100.0 * found[covered] / found[of]:.1f} %" if found[of] else "" for covered, of in kinds)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--report", type=Path, help="report of an earlier run")
    parser.add_argument("--guards", action="store_true", help="the rooms with a floor, by their own tests")
    args = parser.parse_args()
    if args.report is None:
        args.report = REPORT
        args.report.unlink(missing_ok=True)
        code = measured(*((GUARDS, FLOOR) if args.guards else ((), ROOMS)), args.report)
        if code and not (args.guards and args.report.exists()):
            return code
    rooms: dict[str, collections.Counter] = collections.defaultdict(collections.Counter)
    for file, found in json.loads(args.report.read_text(encoding="utf-8"))["files"].items():
        for room in (room_of(file), "everything"):
            rooms[room].update({name: n for name, n in found["summary"].items() if isinstance(n, int)})
    wanted = floors(args.guards)
    if args.guards:
        rooms = {room: rooms[room] for room in wanted}
    print(f"{'room':<28}{'lines':>8}{'covered':>10}{'branches':>10}{'covered':>10}")
    low = []
    for room, n in sorted(rooms.items(), key=lambda item: (item[0] == "everything", item[0])):
        lines, branches = shares(n)
        print(f"{room:<28}{n['num_statements']:>8}{lines:>10}{n['num_branches']:>10}{branches:>10}")
        if 100.0 * n["covered_lines"] < wanted.get(room, 0.0) * n["num_statements"]:
            low.append(f"{room}: {lines} of its lines are covered; {wanted[room]:g} % is wanted")
    print(*low, sep="\n", end="", file=sys.stderr)
    return 1 if low else 0


if __name__ == "__main__":
    sys.exit(main())
