"""The page over HTTP, and what it shows and asks over a WebSocket.

Only a page of this server that was opened with its token is answered: the name in ``Host`` must be one of this
server's (a foreign name that was pointed at this machine is not), ``Origin`` must be the page's own (another site's
script has another), and the token must be right.  Everything that is asked comes over the page's one WebSocket and
ends with it.
"""

from __future__ import annotations

import asyncio
import collections
import hmac
import json
import logging
import math
import secrets
import time
from collections.abc import Awaitable, Callable, Sequence
from importlib import resources
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from aiohttp import WSMsgType, web

from sma_actuator.base.errors import UserError
from sma_actuator.base.signals import Quality
from sma_actuator.config import Config, text_with
from sma_actuator.logs.files import write_atomically

from .asymptotes import Asymptotes, asymptotes_of
from .logs import LogDesk, bench_log_of
from .watched import COLUMNS, Refused, WatchedNode

_log = logging.getLogger(__name__)

PROTOCOL = "sma-view"
TOKEN_PREFIX = "token."  #: what stands before it in Sec-WebSocket-Protocol
TICK_s = 0.1
#: Of one page that waits for answers; a stop is always taken.
MOST_ASKED = 20
MOST_WAITING = 100  #: messages for a page that does not take them; the oldest go
LONGEST_QUESTION_B = 10_000
_FILES = {
    "/": ("index.html", "text/html"),
    "/view.js": ("view.js", "text/javascript"),
    "/view.css": ("view.css", "text/css"),
    "/uPlot.js": ("uPlot.iife.min.js", "text/javascript"),
    "/uPlot.css": ("uPlot.min.css", "text/css"),
}
_HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
    "img-src data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
    "Cross-Origin-Resource-Policy": "same-origin",
}
_REPORT_HEADERS = _HEADERS | {
    "Content-Security-Policy": "default-src 'none'; style-src 'unsafe-inline'; img-src data:; sandbox"
}
_LAW = "controller."
_LOOPBACK = ("127.0.0.1", "localhost", "::1")
_QUALITY = {
    Quality.DETERMINATE: "determinate: the resistance tells where the wire is",
    Quality.INDETERMINATE_COLD: "indeterminate, cold: near full extension the resistance does not tell where the wire "
    "is",
    Quality.INDETERMINATE_HOT: "indeterminate, hot: near full contraction the resistance does not tell where the wire "
    "is",
    Quality.OUTSIDE_CALIBRATION: "outside the calibration: the model has seen nothing like this",
    Quality.INVALID: "invalid: the position is not known",
}


class _Page:
    """One open page: what waits to be sent to it, and what it has asked."""

    def __init__(self) -> None:
        self.waiting: collections.deque[str] = collections.deque(maxlen=MOST_WAITING)
        self.more = asyncio.Event()
        self.asked: set[asyncio.Task[None]] = set()

    def tell(self, message: str) -> None:
        """Queue a message; one that nobody takes displaces the oldest."""
        self.waiting.append(message)
        self.more.set()


class Desk:
    """One node, and the pages that show it.

    ``config``: the model for dropped logs where the node tells none; ``file``: where gains are saved to.
    """

    def __init__(self, wire: WatchedNode, config: Config | None = None, file: Path | None = None):
        self.wire = wire
        self.pages: set[_Page] = set()
        self.desks: Sequence[Desk] = (self,)  #: of all nodes of this server
        self.logs = LogDesk(lambda said: self._tell_all({"log": said}))
        self._config = config
        self._file = file
        self._asymptotes: Asymptotes | None = None
        self._no_asymptotes = ""
        self._curves: dict[str, Any] | None = None
        self._shown: tuple[Any, ...] = (None, None, None)
        self._acts: dict[str, Callable[[dict[str, Any]], Awaitable[str]]] = {
            "stop": lambda _: self._stop(),
            "enable": lambda _: wire.enable(True),
            "disable": lambda _: wire.enable(False),
            "setpoint": lambda asked: wire.send_setpoint(float(asked["position_m"])),
            "angle": lambda asked: wire.send_angle(float(asked["angle_rad"])),
            "parameter": lambda asked: wire.set_parameter(str(asked["name"]), asked["value"]),
            "trigger": lambda asked: wire.trigger(str(asked["name"])),
            "save": lambda _: self._save(),
            "forget_log": lambda _: self._forget_log(),
        }

    # --- what is asked ----------------------------------------------------------------------------

    async def _stop(self) -> str:
        """Every wire of every node's process off.  Raises Refused where one did not confirm it."""
        answers = await asyncio.gather(*(desk.wire.stop() for desk in self.desks), return_exceptions=True)
        for error in answers:
            if isinstance(error, BaseException) and not isinstance(error, UserError | TimeoutError):
                raise error
        words = "; ".join(dict.fromkeys(str(answer) or "ROS did not answer in time" for answer in answers))
        if any(isinstance(answer, BaseException) for answer in answers):
            raise Refused(words)
        return words

    def take(self, page: _Page, text: str) -> None:
        """Begin to do what a page asks."""
        try:
            asked = json.loads(text)
            number, what = asked["id"], asked["do"]
            act = self._acts[what]
            if isinstance(number, dict | list):
                raise TypeError("a number or text is wanted, by which the answer is known")
        except (ValueError, KeyError, TypeError, RecursionError):  # of text that is nested a thousand levels deep
            page.tell(_json({"answer": {"ok": False, "sentence": f"not understood: {text[:80]}"}}))
            return
        if len(page.asked) >= MOST_ASKED and what != "stop":
            page.tell(_answer(number, False, "too much is asked at once; wait for the answers"))
            return
        task = asyncio.create_task(self._do(page, number, act, asked))
        page.asked.add(task)
        task.add_done_callback(page.asked.discard)

    async def _do(self, page: _Page, number: Any, act: Callable[..., Awaitable[str]], asked: dict[str, Any]) -> None:
        try:
            page.tell(_answer(number, True, await act(asked)))
        except UserError as error:
            page.tell(_answer(number, False, str(error)))
        except TimeoutError:
            page.tell(_answer(number, False, "ROS did not answer in time"))
        except Exception as error:  # noqa: BLE001 - whatever ROS makes of it, a page waits for an answer
            page.tell(_answer(number, False, f"not understood: {type(error).__name__}: {error}"))

    async def _save(self) -> str:
        """The law's numbers as they are in the node, into the parameter file; those of before stay as a comment."""
        if self._file is None:
            raise UserError("no file to save to: start sma-actuator view with --config FILE")
        if self.wire.angle_range_rad is not None:
            raise UserError("gains of a joint are not saved; write them into its parameter file")
        now = {
            name.removeprefix(_LAW): value["value"]
            for name, value in self.wire.live.items()
            if name.startswith(_LAW) and type(value["value"]) in (int, float)
        }
        before = Config.load(self._file, self.wire.node.rpartition("/")[2]).to_mapping()["controller"]
        changed = {name: value for name, value in now.items() if before.get(name) != value}
        if not changed:
            return f"{self._file} has these gains already"
        were = ", ".join(f"{name} {before[name]:g}" for name in changed if name in before)
        text = text_with(
            self._file,
            "controller",
            changed,
            f"Saved from the page; before: {were}",
            self.wire.node.rpartition("/")[2],
        )
        try:
            write_atomically(self._file, lambda stream: stream.write(text.encode()))
        except OSError as error:
            raise UserError(f"{self._file}: not written ({error.strerror or error})") from error
        return (
            f"saved to {self._file}: {', '.join(f'{name} {value:g}' for name, value in changed.items())} (before: "
            f"{were})"
        )

    async def _forget_log(self) -> str:
        await self.logs.give_up()
        self._tell_all({"log": None})
        return "the log is forgotten"

    # --- what is shown ----------------------------------------------------------------------------

    def _hello(self) -> dict[str, Any]:
        words = {int(quality): words for quality, words in _QUALITY.items()}
        return {"hello": {"node": self.wire.node, "columns": COLUMNS, "quality": words}}

    def whole_state(self) -> list[dict[str, Any]]:
        """Everything that a page which has just come is told."""
        out = [self._hello(), self._state(), self._parameters()]
        if self._curves is not None:
            out.append({"curves": self._curves})
        if self.logs.said is not None:
            out.append({"log": self.logs.said})
        return out

    @property
    def config(self) -> Config | None:
        """The model of dropped logs: the node's, or that of the file."""
        return self._asymptotes.config if self._asymptotes else self._config

    def _tabs(self) -> list[list[Any]]:
        """Name and level of every node; none of one that is silent."""
        wires = [desk.wire for desk in self.desks]
        return [[w.node, w.status.get("level") if w.present and w.status else None] for w in wires]

    def _state(self) -> dict[str, Any]:
        wire = self.wire
        diagnostics = sorted(wire.diagnostics.values(), key=lambda said: said["name"])
        return {
            "state": {
                "present": wire.present,
                "status": wire.status,
                "diagnostics": diagnostics,
                "services": wire.services,
                "tabs": self._tabs(),
            }
        }

    def _parameters(self) -> dict[str, Any]:
        model = self._asymptotes
        return {
            "parameters": {
                "live": self.wire.live,
                "range_m": model.range_m if model else None,
                "angle_range_rad": self.wire.angle_range_rad,
                "full_stroke_m": model.full_stroke_m if model else None,
                "note": self._no_asymptotes,
                "file": str(self._file) if self._file else None,
            }
        }

    async def tick(self) -> None:
        """Tell all pages what is new."""
        wire = self.wire
        state, parameters, tabs = self._shown
        if wire.parameters_version != parameters:
            # Building a model takes a moment: not in the thread that must pass on a stop.
            found = await asyncio.to_thread(asymptotes_of, wire.parameters)
            self._asymptotes, self._no_asymptotes = found
            self._curves = None
            parameters = wire.parameters_version
            self._tell_all(self._parameters())
        if (wire.version, self._tabs()) != (state, tabs):
            state, tabs = wire.version, self._tabs()
            self._tell_all(self._state())
        self._shown = state, parameters, tabs
        if not self.pages:
            return
        rows = [wire.rows.popleft() for _ in range(len(wire.rows))]
        if rows:
            stress_Pa = rows[-1][COLUMNS.index("stress_Pa")]
            curves = self._asymptotes.at(stress_Pa) if self._asymptotes and stress_Pa is not None else None
            if curves is not None:
                self._curves = curves
                self._tell_all({"curves": curves})
            self._tell_all({"rows": rows})

    def _tell_all(self, message: dict[str, Any]) -> None:
        if self.pages:
            text = _json(message)
            for page in self.pages:
                page.tell(text)

    async def watch(self) -> None:
        """Look after the node for ever."""
        while True:
            try:
                await self.wire.watch()
            except (TimeoutError, Refused) as error:
                _log.warning("ROS did not answer: %s", error)


class ViewServer:
    """Serves the pages of some nodes, the first where none is named."""

    def __init__(self, desks: Sequence[Desk], host: str):
        self.token = secrets.token_urlsafe(24)
        self._hosts = {*_LOOPBACK, host}
        self._desks = {desk.wire.node: desk for desk in desks}
        for desk in desks:
            desk.desks = desks
        self.app = web.Application(middlewares=[self._guarded], client_max_size=LONGEST_QUESTION_B)
        files = resources.files(__package__) / "page"
        for address, (name, kind) in _FILES.items():
            text = (files / name).read_text(encoding="utf-8")
            self.app.router.add_get(address, _file(text, kind))
        self.app.router.add_get("/live", self._live)
        self.app.router.add_post("/log", self._take_log)
        self.app.router.add_post("/recording", self._recording)
        self.app.router.add_get("/report/{name}", self._report)
        self.app.cleanup_ctx.append(self._background)

    def _desk(self, request: web.Request) -> Desk:
        name = request.query.get("node", next(iter(self._desks)))
        if name not in self._desks:
            raise web.HTTPNotFound(text=f"'{name}' is none of {', '.join(self._desks)}\n")
        return self._desks[name]

    # --- who may ----------------------------------------------------------------------------------

    @web.middleware
    async def _guarded(self, request: web.Request, handler: Any) -> web.StreamResponse:
        if _name_of(request.host) not in self._hosts:
            raise web.HTTPForbidden(text=f"Host {request.host!r} is not this server\n")
        acts = request.path in ("/live", "/log", "/recording")
        origin = request.headers.get("Origin")
        if (acts or origin is not None) and origin != f"http://{request.host}":
            raise web.HTTPForbidden(text=f"Origin {origin!r} is not a page of this server\n")
        if acts and not hmac.compare_digest(_token_of(request), self.token.encode()):
            raise web.HTTPForbidden(
                text="the token is missing or wrong: open the address that sma-actuator view prints\n"
            )
        return await handler(request)

    # --- pages ------------------------------------------------------------------------------------

    async def _live(self, request: web.Request) -> web.WebSocketResponse:
        desk = self._desk(request)
        socket = web.WebSocketResponse(heartbeat=10.0, protocols=(PROTOCOL,), max_msg_size=LONGEST_QUESTION_B)
        await socket.prepare(request)
        page = _Page()
        for part in desk.whole_state():
            page.tell(_json(part))
        desk.pages.add(page)
        sender = asyncio.create_task(_send(socket, page))
        try:
            await desk.wire.listen(True)
            async for message in socket:
                if message.type is WSMsgType.TEXT:
                    desk.take(page, message.data)
        finally:
            desk.pages.discard(page)
            for task in (sender, *page.asked):
                task.cancel()
            if not desk.pages:
                await desk.wire.listen(False)
        return socket

    async def _background(self, _: web.Application) -> Any:
        async def tick(desk: Desk) -> None:
            while True:
                try:
                    await desk.tick()
                except Exception:  # noqa: BLE001 - said; the next turn is as good as any
                    _log.exception("the pages were not told what is new")
                await asyncio.sleep(TICK_s)

        desks = self._desks.values()
        tasks = [asyncio.create_task(work) for desk in desks for work in (tick(desk), desk.watch())]
        yield
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        for desk in desks:
            await desk.logs.give_up()

    # --- logs -------------------------------------------------------------------------------------

    async def _take_log(self, request: web.Request) -> web.Response:
        desk = self._desk(request)
        try:
            await desk.logs.take(request.query.get("name", "log.csv"), request.content.iter_any(), desk.config)
        except UserError as error:
            return web.Response(status=400, text=str(error))
        except OSError as error:
            return web.Response(status=507, text=f"the log cannot be kept ({error.strerror or error})")
        return web.Response(status=202, text="taken")

    async def _recording(self, request: web.Request) -> web.Response:
        """What the wire did in the last two minutes, as a bench log."""
        wire = self._desk(request).wire
        try:
            body = await asyncio.to_thread(bench_log_of, await wire.recorded())
        except UserError as error:
            return web.Response(status=409, text=str(error))
        name = f"{wire.node.strip('/').replace('/', '_')}_{time.strftime('%Y%m%d_%H%M%S')}.csv"
        return web.Response(
            body=body,
            content_type="text/csv",
            headers={**_HEADERS, "Content-Disposition": f'attachment; filename="{name}"'},
        )

    async def _report(self, request: web.Request) -> web.Response:
        path = next((p for desk in self._desks.values() if (p := desk.logs.reports.get(request.path))), None)
        if path is None:
            raise web.HTTPNotFound(text="no such report; drop the log again\n")
        return web.Response(text=path.read_text(encoding="utf-8"), content_type="text/html", headers=_REPORT_HEADERS)


def _file(text: str, kind: str) -> Any:
    async def handler(_: web.Request) -> web.Response:
        return web.Response(text=text, content_type=kind, headers=_HEADERS)

    return handler


def _name_of(host: str) -> str | None:
    """The name in a ``Host`` header, without the port; None where there is none."""
    try:
        return urlsplit(f"//{host}").hostname
    except ValueError:
        return None


def _token_of(request: web.Request) -> bytes:
    """The token of a request, which may be no text: browsers let a WebSocket carry it only among its protocols."""
    bearer = request.headers.get("Authorization", "").removeprefix("Bearer ")
    protocols = [p.strip() for p in request.headers.get("Sec-WebSocket-Protocol", "").split(",")]
    token = bearer or next((p.removeprefix(TOKEN_PREFIX) for p in protocols if p.startswith(TOKEN_PREFIX)), "")
    return token.encode(errors="surrogateescape")


def _answer(number: Any, ok: bool, sentence: str) -> str:
    return _json({"answer": {"id": number, "ok": ok, "sentence": sentence}})


def _json(message: Any) -> str:
    """What a browser can read: JSON has no NaN, and whatever ROS says may hold one."""
    return json.dumps(_finite(message), allow_nan=False)


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: _finite(each) for key, each in value.items()}
    return [_finite(each) for each in value] if isinstance(value, list | tuple) else value


async def _send(socket: web.WebSocketResponse, page: _Page) -> None:
    """Send what waits, no faster than the page takes it."""
    while not socket.closed:
        await page.more.wait()
        page.more.clear()
        while page.waiting:
            await socket.send_str(page.waiting.popleft())
