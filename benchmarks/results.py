"""Make the files of ``docs/results`` again: run the command in each, and put what it prints below it.

    python benchmarks/results.py [NAME …]     (make results, RESULTS="control replay")

Every file there has its command in a line ``$ python …``; a comment before the first one stays.  Without names all are
run, one after the other, which takes hours on two cores.  The pages of ``docs`` state figures of these files; the tests
say where one is no longer in them.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
FILES = {path.stem: path for path in sorted((ROOT / "docs" / "results").glob("*.txt"))}
PROMPT = "$ python "
WIDTH = "150"


def output_of(command: str) -> str:
    """What ``command`` prints on standard output; raises CalledProcessError where it fails."""
    words = [sys.executable, *command.split()]
    # Wide enough that no table is broken; without colours.
    environment = {**os.environ, "COLUMNS": WIDTH, "NO_COLOR": "1", "TERM": "dumb"}
    done = subprocess.run(words, cwd=ROOT, env=environment, stdout=subprocess.PIPE, text=True, check=True)
    return "\n".join(line.rstrip() for line in done.stdout.strip().splitlines())


def parts_of(text: str) -> tuple[str, list[str]]:
    """The comment at the top of a file, and its commands."""
    commands = [line.removeprefix(PROMPT) for line in text.splitlines() if line.startswith(PROMPT)]
    return text[: text.index(PROMPT)], commands


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", choices=[[], *FILES], metavar="NAME", help=", ".join(FILES))
    for name in parser.parse_args().names or FILES:
        comment, commands = parts_of(FILES[name].read_text(encoding="utf-8"))
        blocks = []
        for command in commands:
            print(f"{name}: python {command}", file=sys.stderr)
            blocks.append(f"{PROMPT}{command}\n{output_of(command)}\n")
        FILES[name].write_text(comment + "\n".join(blocks), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
