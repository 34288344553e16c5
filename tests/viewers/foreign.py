"""Node with the packages of `package-lock.json`: programs that others wrote, run on what is recorded and served
here."""

from __future__ import annotations

import json
import math
import shutil
import subprocess
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parent


def need_node() -> None:
    """Skip with a sentence where Node or the packages are not there."""
    if shutil.which("node") is None:
        pytest.skip("no Node.js: what others' viewers make of it was not tried")
    if not (HERE / "node_modules").exists():
        pytest.skip("`make viewers` installs the viewers' packages: what they make of it was not tried")


def run(script: str, *arguments: object, stdin: str = "") -> str:
    """What a script prints."""
    done = subprocess.run(
        ["node", HERE / script, *map(str, arguments)], input=stdin, capture_output=True, text=True, timeout=60.0
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def lines(text: str) -> list[dict]:
    """Lines of JSON as ``decoded.mjs`` writes them, with every number."""
    return [json.loads(line, object_hook=_number) for line in text.splitlines()]


def _number(value: dict) -> object:
    return float(value["number"]) if value.keys() == {"number"} else value


def plain(value: object) -> object:
    """A message of rclpy as nested dicts, lists, numbers and text: what every reader of it should see."""
    if hasattr(value, "get_fields_and_field_types"):
        return {name: plain(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if isinstance(value, bytes):
        return value[0]
    return value if isinstance(value, (str, int, float)) else [plain(each) for each in value]


def same(found: object, expected: object) -> bool:
    """Whether two of :func:`plain` are the same to the last bit; NaN is NaN."""
    if isinstance(expected, dict):
        return found.keys() == expected.keys() and all(same(found[name], expected[name]) for name in expected)
    if isinstance(expected, list):
        return len(found) == len(expected) and all(map(same, found, expected))
    if isinstance(expected, float):
        return (math.isnan(found) and math.isnan(expected)) or (
            found == expected and math.copysign(1, found) == math.copysign(1, expected)
        )
    return found == expected
