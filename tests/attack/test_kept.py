"""What attacks bring home is kept with the commit that they tried, and what is older than the code says so."""

import os
import subprocess
from collections import Counter
from pathlib import Path

import pytest

from attack import __main__ as attack
from attack.kept import Kept, add_to, amounts, commit_now, older, table
from attack.result import Result, Violation


@pytest.fixture
def repository(tmp_path):
    """A repository with one commit, and how to make another that changes a file."""

    def git(*words):
        identity = ("-c", "user.name=n", "-c", "user.email=e", "-c", "commit.gpgsign=false")
        done = subprocess.run(["git", *identity, *words], cwd=tmp_path, check=True, capture_output=True, text=True)
        return done.stdout.strip()

    def change(place, commits=True):
        path = tmp_path / place
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"{path.read_text() if path.exists() else ''}x\n")
        if commits:
            git("add", "-A")
            git("commit", "-qm", place)
        return git("rev-parse", "--short=10", "HEAD")

    git("init", "-q")
    change("sma_actuator/actuator.py")
    return tmp_path, change


def test_what_is_older_than_the_code_that_an_attack_tries_says_so(repository):
    root, change = repository
    first = commit_now("hours", root)
    assert older("hours", first, root) == ""
    change("docs/a.md")
    change("sma_actuator/cli/a.py")
    assert older("hours", first, root) == "", "it drives no wire by these"
    change("sma_actuator/ros/node.py")
    assert older("hours", first, root) == "", "sessions run in one process"
    assert older("fuzz", first, root) == "older than the code: 1 commit since"
    last = change("sma_actuator/driver.py")
    assert older("hours", first, root) == "older than the code: 1 commit since"
    assert older("fuzz", first, root) == "older than the code: 2 commits since"
    assert older("fuzz", last, root) == ""
    change("sma_actuator/driver.py", commits=False)
    assert commit_now("fuzz", root) == f"{last}+"
    assert "not committed" in older("fuzz", last, root)
    assert older("fuzz", f"{last}+", root) == "on code that was not committed"
    assert older("fuzz", "0123456789", root) == "on a commit that is not here"


def test_pieces_add_up_and_go_on_with_the_seeds_after_the_last(tmp_path, repository):
    root, change = repository
    path = tmp_path / "kept.json"
    broken = Violation("late", "by a second", "python -m attack kills")
    add_to(path, "kills", Result(Counter(kills=20), {"off after SIGKILL [s]": 1.0}), 7)
    kept = add_to(path, "kills", Result(Counter(kills=15), {"off after SIGKILL [s]": 0.5}, [broken]), 3)
    assert kept == Kept.read(path)
    assert kept.next_seed == {"kills": 7}
    whole = kept.results()["kills"]
    assert (whole.counts, whole.worst, whole.violations) == (
        Counter(kills=35),
        {"off after SIGKILL [s]": 1.0},
        [broken],
    )
    kept = Kept()
    kept.add("fuzz", Result(Counter(messages=10, offs=1)), 1, commit_now("fuzz", root), "2026-01-01")
    kept.add("fuzz", Result(Counter(messages=5)), 2, change("sma_actuator/ros/node.py"), "2026-01-02")
    rows = table(kept, {"kills": "kills", "fuzz": "ROS fuzz"}, root)
    assert [row[2:] for row in rows] == [
        ["2026-01-01", "10 messages, 1 offs", "older than the code: 1 commit since"],
        ["2026-01-02", "5 messages", ""],
    ]
    assert amounts(Result(Counter({"virtual seconds": 5400.0, "sessions": 9}))) == "1.5 virtual hours, 9 sessions"


def test_a_run_begins_after_what_is_kept_prints_what_was_tried_where_and_shows_it_again(tmp_path, monkeypatch, capsys):
    tried = []

    def run(work, jobs, minutes):
        for name, unit in work:
            tried.append(unit)
            yield name, unit, Result(Counter(kills=unit[1]))

    monkeypatch.setattr(attack, "_run", run)
    monkeypatch.setattr(attack, "PAGE", tmp_path / "attack.md")
    monkeypatch.setattr(attack, "KEPT", tmp_path / "kept.json")
    words = ["kills", "--count", "30", "--into", str(tmp_path / "kept.json")]
    assert attack.main(words) == attack.main(words) == 0
    assert tried == [(0, 20), (1, 10), (2, 20), (3, 10)]
    said = capsys.readouterr().out
    assert f"kills: 60 kills; at {commit_now('kills')} on 20" in said
    assert "| kills | " in (tmp_path / "attack.md").read_text()
    assert attack.main(["--show", "--into", str(tmp_path / "kept.json")]) == 0
    assert "kills: 60 kills; at" in capsys.readouterr().out
    assert len(tried) == 4
    written = (tmp_path / "attack.md").read_text()
    assert attack.main(["kills", "--count", "7", "--into", str(tmp_path / "elsewhere.json")]) == 0
    assert "written" not in capsys.readouterr().out
    assert (tmp_path / "attack.md").read_text() == written, "what is kept elsewhere is not what the page tells of"


def test_the_page_tells_of_all_that_is_kept():
    """But for what is older than the code: that changes with every commit, and is as of when the page was written."""

    def lasting(text):
        return [line.rpartition(" | ")[0] if line.count("|") == 6 else line for line in text.splitlines()]

    assert lasting(attack.PAGE.read_text()) == lasting(attack.page(Kept.read(attack.KEPT)))


def test_what_keeps_the_cores_busy_is_there_while_it_attacks_and_ends_with_it(monkeypatch):
    children = Path(f"/proc/self/task/{os.getpid()}/children")
    before, meanwhile = set(children.read_text().split()), []

    def run(work, jobs, minutes):
        meanwhile.append(set(children.read_text().split()) - before)
        yield "kills", (0, 1), Result()

    monkeypatch.setattr(attack, "_run", run)
    assert attack.main(["kills", "--beside", "2"]) == 0
    assert len(meanwhile[0]) == 2 and not meanwhile[0] & set(children.read_text().split())


def test_a_promise_that_broke_stands_with_the_commit_that_broke_it():
    kept = Kept()
    broken = Result(Counter(kills=1), {}, [Violation("late", "by a second", "python -m attack kills --seed 1")])
    kept.add("kills", broken, 1, "0123456789", "2026-01-01")
    kept.add("kills", Result(Counter(kills=1)), 2, "abcdef0123", "2026-01-02")
    entries = [line for line in attack.page(kept).splitlines() if line.startswith("- ")]
    assert entries == ["- 1 × late: by a second [python -m attack kills --seed 1] at 0123456789"]


def test_what_broke_a_promise_is_done_again_and_the_page_says_what_held(tmp_path):
    path = tmp_path / "kept.json"
    kept = Kept()
    mended, broken, unknown = (
        Violation(rule, "0.1 A", f"python -c {what}")
        for rule, what in (("a", "0 --only"), ("b", "1/0 --only"), ("c", "0"))
    )
    kept.add("kills", Result(Counter(kills=3), {}, [mended, broken, unknown]), 0, "0123456789", "2026-01-01")
    kept.write(path)
    assert attack.main(["--again", "--into", str(path)]) == 1
    kept = Kept.read(path)
    assert {replay: again.held for replay, again in kept.again.items()} == {mended.replay: True, broken.replay: False}
    written = " ".join(attack.page(kept).split())
    assert "3 in all; 1 of 2 held when they were tried again." in written
    now = commit_now("kills")
    assert f"[python -c 0 --only] at 0123456789; tried again at {now}: 1 of 1 held" in written
    assert f"[python -c 1/0 --only] at 0123456789; tried again at {now}: 0 of 1 held" in written
    assert "[python -c 0] at 0123456789 - " in written or "[python -c 0] at 0123456789 ##" in written
