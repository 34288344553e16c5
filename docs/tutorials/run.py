"""Run the commands of ``a_strangers_log.md`` one after the other, as its reader would, and put what they print into it.

    python docs/tutorials/run.py     (make tutorial)

A command stands in a block ``console`` after ``$ ``; one that ends with ``&`` runs on until all are done.  One that is
expected to end with another code than 0 says so in a comment.  A block ``yaml`` whose first line is a comment with a
name is written to a file of that name.
"""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

PAGE = Path(__file__).with_name("a_strangers_log.md")
ROOT = PAGE.parents[2]
BLOCK = re.compile(r"```(?P<kind>console|yaml)\n(?P<text>.*?)```", re.DOTALL)
EXPECTED = re.compile(r"#\s*ends with (\d+)")
LONGEST_s = 240
STARTING_s = 60  #: for a command in the background to say something


def run_page(folder: Path, change: Callable[[str], str] = lambda text: text) -> str:
    """The page with what its commands print now; ``change``: what to put in place of parts of a command or file.

    Raises RuntimeError where a command ends otherwise than the page says.
    """
    running: list[subprocess.Popen[bytes]] = []

    def block(match: re.Match[str]) -> str:
        if match["kind"] == "yaml":
            named = re.match(r"# (\S+\.yaml)\n", match["text"])
            if named:
                (folder / named[1]).write_text(change(match["text"]))
            return match[0]
        commands = [line[2:] for line in match["text"].splitlines() if line.startswith("$ ")]
        return "```console\n" + "".join(_ran(command, folder, change, running) for command in commands) + "```"

    try:
        return BLOCK.sub(block, PAGE.read_text(encoding="utf-8"))
    finally:
        for process in reversed(running):
            process.send_signal(signal.SIGINT)
        for process in running:
            try:
                process.wait(30)
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, signal.SIGKILL)


def _ran(command: str, folder: Path, change: Callable[[str], str], running: list[subprocess.Popen[bytes]]) -> str:
    """A command and what it printed, as they stand in the page."""
    words, _, comment = change(command).partition(" #")
    words = words.replace("docs/tutorials", str(ROOT / "docs" / "tutorials")).strip()
    words = re.sub(r"^sma-actuator\b", f"{sys.executable} -m sma_actuator", words)
    words = re.sub(r"^sma_actuator_node\b", f"{sys.executable} -m sma_actuator.ros.node", words)
    words = re.sub(r"^python\b", sys.executable, words)
    environment = {**os.environ, "COLUMNS": "110", "NO_COLOR": "1", "TERM": "dumb", "ROS_LOG_DIR": str(folder / "ros")}
    environment["PYTHONPATH"] = os.pathsep.join([str(ROOT), environment.get("PYTHONPATH", "")])
    if words.endswith("&"):
        said = folder / f"background_{len(running)}.txt"
        with said.open("wb") as log:
            # A command of its own, not a shell's: the signal must reach it.
            running.append(
                subprocess.Popen(
                    words[:-1].split(), cwd=folder, env=environment, stdout=log, stderr=log, start_new_session=True
                )
            )
        deadline_s = time.monotonic() + STARTING_s
        while not said.stat().st_size and running[-1].poll() is None and time.monotonic() < deadline_s:
            time.sleep(0.1)  # a reader waits for its first line, too
        return f"$ {command}\n"
    done = subprocess.run(
        words, shell=True, cwd=folder, env=environment, capture_output=True, text=True, timeout=LONGEST_s, check=False
    )
    expected = int(found[1]) if (found := EXPECTED.search("#" + comment)) else 0
    if done.returncode != expected:
        more = "\n".join(said.read_text(errors="replace")[-2000:] for said in sorted(folder.glob("background_*.txt")))
        raise RuntimeError(
            f"{command}: ended with {done.returncode}, not {expected}:\n{done.stdout}{done.stderr}\n{more}"
        )
    printed = "".join(f"{line.rstrip()}\n" for line in done.stdout.replace(str(folder), ".").splitlines())
    return f"$ {command}\n{printed}"


def main() -> int:
    """Run the page and write it."""
    with tempfile.TemporaryDirectory(prefix="sma_tutorial_") as folder:
        text = run_page(Path(folder))
    PAGE.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
