"""Every ``sma-actuator`` command that a page shows is one that the program takes: its name, its options, their
values."""

import argparse
import re
import shlex
from pathlib import Path

import pytest

from sma_actuator.cli.main import COMMANDS, _load

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")), *sorted((ROOT / "docs" / "tutorials").glob("*.md"))]
BLOCK = re.compile(r"^```\w*\n(.*?)^```$|((?:^    .*\n)+)", re.DOTALL | re.MULTILINE)


def commands_of(text):
    """The words of every command in the blocks of a page, continued lines joined, comments and prompts off."""
    for block in BLOCK.finditer(text):
        lines = re.sub(r"\\[ \t]*(#.*)?\n\s*", " ", block[0])
        for line in lines.splitlines():
            found = re.match(r"\s*(?:\$ )?(?:[A-Z_]+=\S+ )*sma-actuator (.+)", line)
            if found:
                yield shlex.split(found[1].rstrip(" &"), comments=True)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_page_shows_only_commands_that_the_program_takes(page, capsys):
    wrong = []
    for words in commands_of(page.read_text(encoding="utf-8")):
        if not words or words[0].startswith("-") or words[0] == "COMMAND":
            continue
        name, *rest = words
        if name not in COMMANDS:
            wrong.append(f"{name}: no such command")
            continue
        parser = argparse.ArgumentParser(prog=name)
        _load(name, parser)
        try:
            parser.parse_args([word for word in rest if word not in ("…", "&")])
        except SystemExit:
            wrong.append(f"{' '.join(words)}: {capsys.readouterr().err.splitlines()[-1]}")
    assert not wrong


def test_it_sees_an_option_that_is_none():
    assert list(commands_of("```\nsma-actuator identify a.csv --modell x   # so\n```\n")) == [
        ["identify", "a.csv", "--modell", "x"]
    ]
