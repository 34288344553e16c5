"""What is installed is what was looked at: locked, hashed, and asked after."""

import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
LOCK = (ROOT / "requirements.lock").read_text(encoding="utf-8")
MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")


def entries():
    """Each entry of the lock: name, version, and the rest of it."""
    return re.findall(r"(?m)^([a-z0-9._-]+)==(\S+)((?:[^\n]*\\\n)*[^\n]*)", LOCK)


def normal(name):
    return re.sub(r"[-_.]+", "-", name).lower()


def wanted():
    """Names in setup.py, of the package itself and of the extras that `make` installs."""
    text = (ROOT / "setup.py").read_text(encoding="utf-8")
    extras = re.search(r"(?m)^EXTRAS := (.*)", MAKEFILE)[1].split(",")
    lists = [re.search(r"install_requires=\[(.*?)\n    \]", text, re.DOTALL)[1]]
    lists += [re.search(rf'"{extra}": \[(.*?)\](?:,\n        ["#]|,\n    \}})', text, re.DOTALL)[1] for extra in extras]
    return {normal(re.match(r"[\w.-]+", each)[0]) for part in lists for each in re.findall(r'"([^"]+)"', part)}


def test_every_package_that_make_installs_is_locked_with_the_hashes_of_its_files():
    locked = {normal(name) for name, _, _ in entries()}
    assert len(wanted()) > 40
    assert wanted() - locked == set(), "run .ci/lock"
    assert [name for name, _, rest in entries() if not re.search(r"--hash=sha256:[0-9a-f]{64}", rest)] == []
    assert "://" not in LOCK, "only names, versions and hashes: where from is whoever installs it to say"
    assert "pip install --quiet --require-hashes --requirement requirements.lock" in MAKEFILE


def test_the_wheels_of_ros_are_locked_at_the_versions_that_suit_each_other():
    pinned = re.findall(r"(?m)^(ros-[\w.-]+)==(\S+)", (ROOT / "constraints.txt").read_text(encoding="utf-8"))
    versions = {normal(name): version for name, version, _ in entries()}
    assert len(pinned) > 70
    assert {name: versions.get(normal(name), version) for name, version in pinned} == dict(pinned)
    assert {normal(name) for name in versions if name.startswith("ros-")} <= {normal(name) for name, _ in pinned}


@pytest.mark.parametrize(
    ("script", "code", "words"),
    [
        ("exit 0", 0, "no holes are published"),
        ("echo 'numpy 1.0 GHSA-1'; exit 1", 1, "GHSA-1"),
        (
            "echo 'requests.exceptions.ConnectionError: no such host' >&2; exit 1",
            2,
            "nothing is known: osv.dev could not",
        ),
    ],
)
def test_the_audit_tells_no_holes_from_nobody_to_ask(tmp_path, script, code, words):
    (tmp_path / "pip-audit").write_text(f"#!/bin/sh\n{script}\n")
    (tmp_path / "pip-audit").chmod(0o755)
    done = subprocess.run([ROOT / ".ci/audit", tmp_path], capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == code
    assert words in done.stdout
