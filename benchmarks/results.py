"""Make the figures of ``docs/results.md`` and the pages beside it again: run their commands and put what they print into the page.

    python benchmarks/results.py [NAME …]     (make results, RESULTS="control replay")

Everything between the markers ``<!-- NAME -->`` and ``<!-- end -->`` is replaced by the output of the
command that stands there; the words around it are kept.  Without names all of them are run, one after
the other, which takes an hour on two cores.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGES = sorted((ROOT / "docs").glob("*.md"))
SECTION = re.compile(r"<!-- (?P<name>[\w-]+): (?P<command>[^>]+?) -->\n.*?<!-- end -->", re.DOTALL)
WIDTH = "150"


def output_of(command: str) -> str:
    """What ``command`` prints on standard output; raises CalledProcessError where it fails."""
    words = [sys.executable, *command.split()]
    # Wide enough that no table is broken; without colours.
    environment = {**os.environ, "COLUMNS": WIDTH, "NO_COLOR": "1", "TERM": "dumb"}
    done = subprocess.run(words, cwd=ROOT, env=environment, stdout=subprocess.PIPE, text=True, check=True)
    return "\n".join(line.rstrip() for line in done.stdout.strip().splitlines())


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    known = {
        match["name"]: (page, match["command"])
        for page in PAGES
        for match in SECTION.finditer(page.read_text(encoding="utf-8"))
    }
    parser.add_argument("names", nargs="*", choices=[[], *known], metavar="NAME", help=", ".join(known))
    for name in parser.parse_args().names or known:
        page, command = known[name]
        print(f"{name}: python {command}", file=sys.stderr)
        printed = output_of(command)
        block = f"<!-- {name}: {command} -->\n```text\n$ python {command}\n{printed}\n```\n<!-- end -->"
        text = SECTION.sub(
            lambda m, name=name, block=block: block if m["name"] == name else m[0], page.read_text(encoding="utf-8")
        )
        page.write_text(text, encoding="utf-8")  # after each: an hour's work is not lost to the last command
    return 0


if __name__ == "__main__":
    sys.exit(main())
