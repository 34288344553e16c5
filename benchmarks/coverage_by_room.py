"""Run every test under coverage, child processes included, and print what is covered, room by room.

    python benchmarks/coverage_by_room.py [--report FILE.json]     (make coverage)

Kernels that numba compiles are left out (coverage does not see compiled code); ``--report`` reads the
report of an earlier run instead of running the tests.
"""

from __future__ import annotations

import argparse
import collections
import json
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
REPORT = ROOT / "out" / "coverage.json"
TESTS = ("-n", "4", "--dist", "loadscope", "--no-loadscope-reorder", "-m", "not long")


def room_of(file: str) -> str:
    """``sma_actuator/safety`` of ``sma_actuator/safety/guards/wire.py``; a file at the top is its own room."""
    return "/".join(Path(file).parts[:2])


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--report", type=Path, help="report of an earlier run")
    report = parser.parse_args().report
    if report is None:
        report = REPORT
        report.parent.mkdir(exist_ok=True)
        page = f"--cov-report=html:{report.with_suffix('')}"
        tests = [sys.executable, "-m", "pytest", *TESTS, "--cov", f"--cov-report=json:{report}", page]
        code = subprocess.run(tests, check=False, cwd=ROOT, stdout=sys.stderr).returncode
        if code:
            return code
    rooms: dict[str, collections.Counter] = collections.defaultdict(collections.Counter)
    for file, found in json.loads(report.read_text(encoding="utf-8"))["files"].items():
        for room in (room_of(file), "everything"):
            rooms[room].update({name: n for name, n in found["summary"].items() if isinstance(n, int)})
    print(f"{'room':<28}{'lines':>8}{'covered':>10}{'branches':>10}{'covered':>10}")
    for room, n in sorted(rooms.items(), key=lambda item: (item[0] == "everything", item[0])):
        lines, branches = n["num_statements"], n["num_branches"]
        shares = [
            f"{100.0 * c / of:.1f} %" if of else ""
            for c, of in ((n["covered_lines"], lines), (n["covered_branches"], branches))
        ]
        print(f"{room:<28}{lines:>8}{shares[0]:>10}{branches:>10}{shares[1]:>10}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
