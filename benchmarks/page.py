"""The page of the node in a headless Chromium for a while: its memory, what it costs, and its picture.

    python benchmarks/page.py [--minutes 30] [--picture docs/pictures/view.png] [--json FILE]     (make page)

Starts the demonstration with its page, opens it, and looks once a minute: JavaScript in use after its garbage is
collected, elements of the page, CPU time of the process that serves it and of the node, of which the latter is also
measured before the page is opened.  The first three minutes fill what the page keeps; the memory is judged from then
on.
"""

from __future__ import annotations

import argparse
import asyncio
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from chromium import Chromium

from sma_actuator.console import write_json

FILLING_s = 180.0  #: until all that is kept is full
ALONE_s = 20.0  #: how long the node is watched before the page is opened
READY_TIMEOUT_s = 300.0


def main() -> int:
    """Run for as long as was asked; 0 when the page was live to the end."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--picture", type=Path, help="PNG to write, after a minute")
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    command = [sys.executable, "-m", "sma_actuator", "demo", "--view", "--duration", "0"]
    with tempfile.NamedTemporaryFile(prefix="demo_") as said:
        demo = subprocess.Popen(command, stdout=said)
        try:
            rows = asyncio.run(_look(_address(demo, Path(said.name)), demo.pid, args))
        finally:
            demo.send_signal(signal.SIGINT)
            demo.wait(60.0)
    settled = [row for row in rows if row["time_s"] >= FILLING_s]
    write_json(args, rows)
    if len(settled) < 2:
        print(f"too short to judge the memory: more than {FILLING_s / 60.0 + 1.0:g} minutes are wanted")
        return 0
    kB = [row["heap_B"] / 1e3 for row in settled]
    minutes = (settled[-1]["time_s"] - settled[0]["time_s"]) / 60.0
    print(
        f"over {minutes:.1f} min after filling: JavaScript {min(kB):.0f} to {max(kB):.0f} kB, at the end {kB[-1]:.0f} "
        f"kB"
    )
    return 0


def _address(demo: subprocess.Popen[bytes], said: Path) -> str:
    """What the demonstration prints: where the page is."""
    deadline_s = time.monotonic() + READY_TIMEOUT_s
    while not (found := re.search("^open (http.+)$", said.read_text(), re.MULTILINE)):
        assert demo.poll() is None, "the demonstration ended"
        assert time.monotonic() < deadline_s, "the page did not say its address"
        time.sleep(0.1)
    return found[1].strip()


async def _look(address: str, demo: int, args: argparse.Namespace) -> list[dict[str, float]]:
    rows = []
    node, server = _child(demo, "sma_actuator.ros.node"), _child(demo, "view")
    await asyncio.sleep(5.0)  # starting takes CPU time of its own
    alone_s = _cpu_s(node)
    await asyncio.sleep(ALONE_s)
    print(f"CPU of the node without a page {(_cpu_s(node) - alone_s) / ALONE_s:.1%}")
    async with Chromium() as browser:
        await browser.open(address)
        await browser.wait_for("document.querySelector('#point').textContent.startsWith('R ')")
        began_s, next_s = time.monotonic(), 0.0
        cpu_s, node_s = _cpu_s(server), _cpu_s(node)
        print("  time   JavaScript  elements   CPU of the serving process, of the node")
        while (elapsed_s := time.monotonic() - began_s) <= 60.0 * args.minutes + 1.0:
            if elapsed_s >= next_s:
                row = {"time_s": elapsed_s, "heap_B": await browser.heap_B(), "nodes": await browser.nodes()}
                row["cpu_share"] = (_cpu_s(server) - cpu_s) / max(elapsed_s, 1.0)
                row["node_cpu_share"] = (_cpu_s(node) - node_s) / max(elapsed_s, 1.0)
                rows.append(row)
                print(
                    f"{elapsed_s / 60.0:5.1f} min {row['heap_B'] / 1e3:7.0f} kB {row['nodes']:8.0f} "
                    f"{row['cpu_share']:10.1%} {row['node_cpu_share']:10.1%}",
                    flush=True,
                )
                next_s += 60.0
                if args.picture and elapsed_s >= 59.0:
                    await browser.picture(args.picture)
                    args.picture = None
            await asyncio.sleep(0.5)
        before = await browser.text("#point")
        await browser.wait_for(f"document.querySelector('#point').textContent !== {before!r}")  # it is live to the end
    return rows


def _child(pid: int, word: str) -> int:
    """The child of a process that has a word in its command line."""
    for place in Path("/proc").glob("[0-9]*"):
        try:
            parent = int((place / "stat").read_text().rpartition(")")[2].split()[1])
            if parent == pid and word.encode() in (place / "cmdline").read_bytes().split(b"\0"):
                return int(place.name)
        except OSError:
            continue
    raise AssertionError(f"no process '{word}' below {pid}")


def _cpu_s(pid: int) -> float:
    """CPU time that a process has used."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


if __name__ == "__main__":
    sys.exit(main())
