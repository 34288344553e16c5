"""A headless Chromium, driven over its own debugging protocol: no driver and no package beside aiohttp."""

from __future__ import annotations

import asyncio
import base64
import contextlib
import io
import os
import shutil
import tempfile
import time
from pathlib import Path
from typing import Any

import aiohttp

PROGRAMS = ("chromium", "chromium-browser", "google-chrome", "chrome")
START_TIMEOUT_s = 60.0
ANSWER_TIMEOUT_s = 30.0


def find_chromium() -> str | None:
    """The program, or None where none is installed."""
    return next(filter(None, map(shutil.which, PROGRAMS)), None)


class Chromium:
    """One browser with one tab; an asynchronous context manager."""

    def __init__(self, width: int = 1280, height: int = 1000):
        self._size = width, height
        self._number = 0
        self._stack = contextlib.AsyncExitStack()

    async def __aenter__(self) -> Chromium:
        """Start it."""
        program = find_chromium()
        assert program, "no Chromium is installed"
        folder = Path(
            self._stack.enter_context(tempfile.TemporaryDirectory(prefix="chromium_", ignore_cleanup_errors=True))
        )
        sandbox = ["--no-sandbox"] if os.geteuid() == 0 else []  # as root it cannot have one
        size = "{},{}".format(*self._size)
        self._process = await asyncio.create_subprocess_exec(
            program, "--headless=new", *sandbox, "--disable-gpu", "--disable-dev-shm-usage", "--no-first-run",
            "--hide-scrollbars",
            "--disable-background-networking", "--disable-component-update", "--disable-extensions", "--disable-sync",
            "--remote-debugging-port=0", f"--user-data-dir={folder}", f"--window-size={size}", "about:blank",
            stdout=asyncio.subprocess.DEVNULL, stderr=asyncio.subprocess.DEVNULL, start_new_session=True,
            # Where a locale is ASCII alone, its storage crashes for ever in a folder with any other letter.
            env={**os.environ, "LC_ALL": "C.UTF-8"},
        )  # fmt: skip
        self._stack.push_async_callback(self._end)
        port_file = folder / "DevToolsActivePort"
        deadline_s = time.monotonic() + START_TIMEOUT_s
        while not (port_file.exists() and port_file.read_text().strip()):
            assert self._process.returncode is None, f"{program} ended with code {self._process.returncode}"
            assert time.monotonic() < deadline_s, f"{program} did not start within {START_TIMEOUT_s:g} s"
            await asyncio.sleep(0.05)
        port = port_file.read_text().split()[0]
        self._http = await self._stack.enter_async_context(aiohttp.ClientSession())
        async with self._http.get(f"http://127.0.0.1:{port}/json/list") as response:
            tab = next(t for t in await response.json() if t["type"] == "page")
        self._socket = await self._stack.enter_async_context(
            self._http.ws_connect(tab["webSocketDebuggerUrl"], max_msg_size=0)
        )
        return self

    async def __aexit__(self, *what: object) -> None:
        """End it."""
        await self._stack.aclose()

    async def _end(self) -> None:
        if self._process.returncode is None:
            self._process.kill()
        await self._process.wait()

    async def command(self, method: str, **parameters: Any) -> dict[str, Any]:
        """One command of the protocol; its result."""
        self._number += 1
        await self._socket.send_json({"id": self._number, "method": method, "params": parameters})
        while True:
            answer = await self._socket.receive_json(timeout=ANSWER_TIMEOUT_s)
            if answer.get("id") == self._number:
                assert "error" not in answer, f"{method}: {answer['error']}"
                return answer["result"]

    async def open(self, address: str) -> None:
        """Go to a page, and wait until it is there."""
        await self.command("Page.navigate", url=address)
        await self.wait_for("location.protocol !== 'about:' && document.readyState === 'complete'")

    async def value(self, expression: str) -> Any:
        """What an expression of JavaScript is in the page (a promise is awaited)."""
        answer = await self.command("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    async def text(self, selector: str) -> str:
        """The text of an element; empty where there is none."""
        return await self.value(f"document.querySelector({selector!r})?.textContent ?? ''")

    async def wait_for(self, expression: str, timeout_s: float = 60.0) -> None:
        """Poll until an expression is true."""
        deadline_s = time.monotonic() + timeout_s
        while not await self.value(f"Boolean({expression})"):
            if time.monotonic() > deadline_s:
                shown = await self.value("document.body.innerText")
                raise AssertionError(
                    f"{expression} did not become true within {timeout_s:g} s; the page shows:\n{shown}"
                )
            await asyncio.sleep(0.05)

    async def click(self, selector: str) -> None:
        """Press the mouse in the middle of an element, as a person does: what covers it gets the press."""
        place = await self.value(
            f"(() => {{ const e = document.querySelector({selector!r}); e.scrollIntoView({{block: 'nearest'}}); "
            "const r = e.getBoundingClientRect(); return [r.x + r.width / 2, r.y + r.height / 2]; })()"
        )
        for kind in ("mousePressed", "mouseReleased"):
            await self.command(
                "Input.dispatchMouseEvent", type=kind, x=place[0], y=place[1], button="left", clickCount=1
            )

    async def heap_B(self) -> float:
        """Bytes of JavaScript that are used, after the garbage is collected."""
        await self.command("HeapProfiler.collectGarbage")
        return (await self.command("Runtime.getHeapUsage"))["usedSize"]

    async def nodes(self) -> int:
        """Elements in the page."""
        return (await self.command("Memory.getDOMCounters"))["nodes"]

    async def picture(self, path: Path) -> None:
        """Write the whole page as a PNG of few colours."""
        from PIL import Image

        size = (await self.command("Page.getLayoutMetrics"))["cssContentSize"]
        clip = {"x": 0, "y": 0, "width": size["width"], "height": size["height"], "scale": 1}
        answer = await self.command("Page.captureScreenshot", format="png", captureBeyondViewport=True, clip=clip)
        Image.open(io.BytesIO(base64.b64decode(answer["data"]))).convert("RGB").quantize(64).save(path, optimize=True)
