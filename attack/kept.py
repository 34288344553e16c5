"""What attacks have brought home, commit by commit, and what of it is older than the code that it tried.

A long attack is run in pieces, on whatever commit there is at the time: a million messages today, a thousand kills
tomorrow.  Each piece goes on with the seeds after the last, and is kept with its commit; a piece says nothing of code
that came later.
"""

from __future__ import annotations

import contextlib
import datetime
import fcntl
import json
import subprocess
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from .result import Result

ROOT = Path(__file__).resolve().parents[1]
#: Rooms that no attack drives a wire with.
_ELSEWHERE = ("cli", "view", "report", "diagnosis", "identify", "replay", "fleet", "console")
#: Those that only attacks on a process of a node run.
_OF_NODES = ("ros",)
IN_PROCESS = ("heat", "ends", "hours", "lies", "lines", "soak")


@dataclass(slots=True)
class Piece:
    """What one attack has brought home on one commit."""

    on: str  #: the day of the last of it
    result: Result = field(default_factory=Result)


@dataclass(frozen=True, slots=True)
class Again:
    """What came of trying once more, on later code, what had broken a promise."""

    commit: str
    held: bool  #: nothing was broken


@dataclass(slots=True)
class Kept:
    """Pieces by attack and commit, the first seed of each attack that was not tried yet, and by the command that shows
    a broken promise what it came to when it was last tried again."""

    pieces: dict[str, dict[str, Piece]] = field(default_factory=dict)
    next_seed: dict[str, int] = field(default_factory=dict)
    again: dict[str, Again] = field(default_factory=dict)

    @classmethod
    def read(cls, path: Path) -> Kept:
        """What a file has; nothing where there is none."""
        if not path.exists():
            return cls()
        document = json.loads(path.read_text(encoding="utf-8"))
        pieces = {
            name: {commit: Piece(piece["on"], Result.from_mapping(piece)) for commit, piece in by_commit.items()}
            for name, by_commit in document["pieces"].items()
        }
        again = {replay: Again(**tried) for replay, tried in document.get("again", {}).items()}
        return cls(pieces, document["next_seed"], again)

    def write(self, path: Path) -> None:
        """Put it into a file."""
        pieces = {
            name: {commit: {"on": piece.on, **piece.result.to_mapping()} for commit, piece in by_commit.items()}
            for name, by_commit in self.pieces.items()
        }
        again = {replay: asdict(tried) for replay, tried in self.again.items()}
        document = {"next_seed": self.next_seed, "again": again, "pieces": pieces}
        path.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")

    def add(self, name: str, part: Result, next_seed: int, commit: str, on: str) -> None:
        """Take in what a part of an attack has brought home."""
        self.pieces.setdefault(name, {}).setdefault(commit, Piece(on)).result.add(part)
        self.pieces[name][commit].on = on
        self.next_seed[name] = max(next_seed, self.next_seed.get(name, 0))

    def results(self) -> dict[str, Result]:
        """Of each attack, what all its pieces have brought home."""
        whole: dict[str, Result] = {}
        for name, by_commit in self.pieces.items():
            whole[name] = Result()
            for piece in by_commit.values():
                whole[name].add(piece.result)
        return whole

    def to_try_again(self, root: Path = ROOT) -> list[tuple[str, str]]:
        """Attack, and the command of each promise that broke, where the code is another by now than the one that was
        last tried; of commands that say nothing of which part, none: they would begin with another."""
        out = {}
        for name, by_commit in self.pieces.items():
            for commit, piece in by_commit.items():
                for violation in piece.result.violations:
                    tried = self.again.get(violation.replay)
                    if " --" in violation.replay and older(name, tried.commit if tried else commit, root):
                        out[violation.replay] = name
        return [(name, replay) for replay, name in out.items()]


def add_to(path: Path, name: str, part: Result, next_seed: int) -> Kept:
    """Add a part to what a file keeps, also beside other runs that do; all that is kept then."""
    with _changed(path) as kept:
        kept.add(name, part, next_seed, commit_now(name), datetime.date.today().isoformat())
    return kept


def tried_again(path: Path, name: str, replay: str, held: bool) -> Kept:
    """Keep in a file what a broken promise came to when it was tried again; all that is kept then."""
    with _changed(path) as kept:
        kept.again[replay] = Again(commit_now(name), held)
    return kept


@contextlib.contextmanager
def _changed(path: Path) -> Iterator[Kept]:
    """What a file keeps, to be changed, also beside other runs that do."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.with_name(path.name + ".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        kept = Kept.read(path)
        yield kept
        kept.write(path)


def commit_now(name: str, root: Path = ROOT) -> str:
    """The commit whose code an attack tries now; with a plus where that was changed and not committed."""
    commit = _git(root, "rev-parse", "--short=10", "HEAD")
    return f"{commit}+" if commit and _git(root, "status", "--porcelain", "--", *_tried(name)) else commit or "unknown"


def older(name: str, commit: str, root: Path = ROOT) -> str:
    """Why what was found on a commit need not hold of the code there is now; empty where it does."""
    if commit.endswith("+"):
        return "on code that was not committed"
    if not _git(root, "rev-parse", "--verify", "--quiet", f"{commit}^{{commit}}"):
        return "on a commit that is not here"
    since = _git(root, "rev-list", "--count", f"{commit}..HEAD", "--", *_tried(name))
    if since not in ("", "0"):
        return f"older than the code: {since} commit{'s' * (since != '1')} since"
    return "older than what is changed and not committed" if commit_now(name, root).endswith("+") else ""


def table(kept: Kept, titles: Mapping[str, str], root: Path = ROOT) -> list[list[str]]:
    """Attack, commit, day, what was done, and whether that is older than the code; a row for each piece."""
    return [
        [title, commit, piece.on, amounts(piece.result), older(name, commit, root)]
        for name, title in titles.items()
        for commit, piece in sorted(kept.pieces.get(name, {}).items(), key=lambda item: item[1].on)
    ]


def amounts(result: Result) -> str:
    """How much was done, the most frequent first."""
    counts: dict[str, Any] = dict(result.counts)
    hours = [f"{counts.pop('virtual seconds') / 3600.0:.1f} virtual hours"] if "virtual seconds" in counts else []
    most = sorted(counts.items(), key=lambda count: -count[1])[:3]
    return ", ".join(hours + [f"{number} {what}" for what, number in most])


def _tried(name: str) -> list[str]:
    but = _ELSEWHERE if name not in IN_PROCESS else (*_ELSEWHERE, *_OF_NODES)
    return [
        "sma_actuator",
        *([] if name in IN_PROCESS else ["sma_msgs_py"]),
        *(f":!sma_actuator/{room}" for room in but),
    ]


def _git(root: Path, *words: str) -> str:
    done = subprocess.run(["git", *words], cwd=root, capture_output=True, text=True, check=False)
    return done.stdout.strip() if done.returncode == 0 else ""
