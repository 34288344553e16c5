"""What ``make coverage`` and ``make floor`` refuse."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


@pytest.mark.parametrize(
    ("options", "room", "covered", "said"),
    [
        ((), "sma_actuator/logs", 990, ""),
        ((), "sma_actuator/logs", 940, "sma_actuator/logs: 94.0 % of its lines are covered"),
        ((), "sma_actuator/a_new_one", 500, ""),  # until it is printed
        (("--guards",), "sma_actuator/safety", 985, ""),
        (("--guards",), "sma_actuator/safety", 970, "sma_actuator/safety: 97.0 % of its lines are covered"),
    ],
)
def test_a_room_below_its_floor_is_refused(options, room, covered, said, tmp_path):
    summary = {"covered_lines": covered, "num_statements": 1000, "covered_branches": 0, "num_branches": 0}
    report = tmp_path / "coverage.json"
    report.write_text(json.dumps({"files": {f"{room}/a.py": {"summary": summary}}}))
    command = [sys.executable, ROOT / "benchmarks" / "coverage_by_room.py", *options, "--report", report]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stderr.split(";")[0]) == (bool(said), said)
