"""One word for one thing: names keep to docs/glossary.md."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

HERE = Path(__file__).resolve().parents[1]
FILES = sorted(
    f for top in ("sma_actuator", "sma_msgs_py", "attack", "benchmarks", "examples") for f in (HERE / top).rglob("*.py")
)
GLOSSARY = (HERE / "docs" / "glossary.md").read_text(encoding="utf-8")
AVOIDED = {
    word.strip()
    for row in re.findall(r"^\| ([^|*]+) \|", GLOSSARY.split("## Not these")[1], re.MULTILINE)
    for word in row.split(",")
} - {"not"}
#: A constant's unit in capitals, which hides whether K_S is kelvins per second or per siemens.
SHOUTED_UNIT = re.compile(r"^[A-Z_0-9]+_(S|M|PA|HZ|OHM|MS|MM|DEG|PERCENT)$")


def names(path: Path) -> Iterator[tuple[str, int]]:
    """Names that a file gives: of variables, arguments, attributes, functions and classes."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Name | ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield (node.id if isinstance(node, ast.Name) else node.attr), node.lineno
        elif isinstance(node, ast.arg):
            yield node.arg, node.lineno
        elif isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield node.name, node.lineno


def words(name: str) -> list[str]:
    """The words of ``a_name`` or ``AName``."""
    return [word.lower() for word in re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])", name)]


def test_names_keep_to_the_glossary():
    assert len(AVOIDED) > 20 and len(FILES) > 300
    wrong = [
        f"{path.relative_to(HERE)}:{line}: {name}"
        for path in FILES
        for name, line in names(path)
        if AVOIDED & set(words(name)) or SHOUTED_UNIT.match(name)
    ]
    assert not wrong, f"docs/glossary.md has other words: {'; '.join(wrong)}"
