"""Supplies in other people's lists: what docs/supplies.md says of each, and that the ones that can be written are."""

import re
from pathlib import Path

import pytest

from sma_actuator.instruments.dialect import FOLDER, Dialect

TESTS = Path(__file__).parents[1]
SKETCHES = sorted((TESTS / "instruments" / "sketches").glob("*.yaml"))
TABLE = (
    (TESTS.parent / "docs" / "supplies.md")
    .read_text(encoding="utf-8")
    .partition("## Supplies in other people's lists")[2]
)
ROWS = [row.split("|")[3] for row in TABLE.splitlines() if row.startswith("| ")][1:]


@pytest.mark.parametrize("path", SKETCHES, ids=lambda path: path.stem)
def test_a_family_that_has_the_three_can_be_written(path):
    dialect = Dialect.load(str(path), "supply")
    assert {"output_on", "output_off", "set_current", "set_voltage"} <= dialect.commands.keys()
    assert {"output", "voltage", "current", "current_setting"} <= dialect.queries.keys()


def test_the_page_names_the_dialects_that_there_are():
    named = {match[1] for row in ROWS if (match := re.match(r" `([\w.]+)`", row))}
    theirs = {path.name for path in (TESTS / "counterparts" / "dialects").glob("*.yaml")}
    shipped = {path.stem for path in FOLDER.glob("*.yaml")}
    assert {path.name for path in SKETCHES} <= named
    assert named <= {path.name for path in SKETCHES} | theirs | shipped
    assert all(row.startswith((" `", " none: ", " not gone into: ")) for row in ROWS)
