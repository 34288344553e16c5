"""What is promised: the table of docs/faults.md, read as a user reads it."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

DOCUMENT = Path(__file__).resolve().parents[1] / "docs" / "faults.md"
_NAME = re.compile(r"[a-z_]+(?:\.[a-z_]+)+")
_ALLOWED = re.compile(r"(?:max|min|[0-9.e+\-*/(), ])*")


@dataclass(frozen=True, slots=True)
class Promise:
    """One row of the table."""

    fault: str
    within: str  #: seconds, an expression in parameters
    switches_off: bool


class Promises:
    """The table of faults, with its times worked out for one set of parameters."""

    def __init__(self, parameters: Mapping[str, Any], document: Path = DOCUMENT):
        self.rows = read_table(document)
        self._values = dict(flat(parameters))

    def within_s(self, fault: str) -> float:
        """Seconds after its cause within which the driver has done what the row of ``fault`` says."""
        expression = self.rows[fault].within
        numbers = _NAME.sub(lambda name: repr(float(self._values[name[0]])), expression)
        if not _ALLOWED.fullmatch(numbers):
            raise ValueError(f"docs/faults.md, {fault}: '{expression}' is no time in seconds")
        return float(eval(numbers, {"__builtins__": {}}, {"max": max, "min": min}))

    def switches_off(self, fault: str) -> bool:
        """Whether the row of ``fault`` says that it switches the output off."""
        return self.rows[fault].switches_off


def read_table(document: Path = DOCUMENT) -> dict[str, Promise]:
    """The rows of the table of faults by their names.  Raises ValueError where there is no such table."""
    rows: dict[str, Promise] = {}
    columns: list[str] = []
    for line in document.read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip().strip("|").split("|")] if line.startswith("|") else []
        if not cells:
            columns = []
        elif not columns:
            columns = cells
        elif columns[0] == "fault" and not set(cells[0]) <= {"-", ":", " "}:
            row = {name: cell.strip("`") for name, cell in zip(columns, cells, strict=True)}
            rows[row["fault"]] = Promise(row["fault"], row["within"], row["action"].startswith("off"))
    if not rows:
        raise ValueError(f"{document}: has no table whose first column is 'fault'")
    return rows


def flat(parameters: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested parameters by their dotted names."""
    out: dict[str, Any] = {}
    for name, value in parameters.items():
        if isinstance(value, Mapping):
            out |= flat(value, f"{prefix}{name}.")
        else:
            out[prefix + name] = value
    return out
