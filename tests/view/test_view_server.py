"""The server of the page without a node: who is answered, and with what."""

import asyncio
import collections
import errno
import json
import math
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("aiohttp", reason="aiohttp is not installed (extra 'view')")
pytest.importorskip("rclpy", reason="ROS 2 is not installed (extra 'ros')")
from aiohttp.test_utils import TestClient, TestServer
from rig import Rig

from benchmarks.chromium import Chromium, find_chromium
from sma_actuator.base.errors import UserError
from sma_actuator.base.share import shared_file
from sma_actuator.cli.main import main
from sma_actuator.config import Config, read_parameter_file
from sma_actuator.logs.bench_log import read_bench_log
from sma_actuator.ros.named_signals import named_signals
from sma_actuator.view import logs, server
from sma_actuator.view.server import MOST_ASKED, MOST_WAITING, Desk, TICK_s, ViewServer, _Page
from sma_actuator.view.watched import COLUMNS, Refused

HOST = "127.0.0.1"


class StillWire:
    """A node that says what it is told to say, and does nothing."""

    node = "/sma_actuator"

    def __init__(self):
        self.rows = collections.deque()
        self.version = self.parameters_version = 0
        self.present = True
        self.status = None
        self.diagnostics, self.parameters, self.live, self.services = {}, {}, {}, []
        self.done = []
        self.rows_recorded = {}
        self.angle_range_rad = None

    async def listen(self, wanted):
        self.done.append(("listen", wanted))

    async def watch(self):
        await asyncio.Event().wait()

    async def stop(self):
        self.done.append("stop")
        return "every wire is off"

    async def enable(self, on):
        self.done.append(("enable", on))
        return "on" if on else "off"

    async def send_setpoint(self, position_m):
        self.done.append(position_m)
        return "sent"

    async def send_angle(self, angle_rad):
        self.done.append(("angle", angle_rad))
        return "sent"

    async def set_parameter(self, name, value):
        self.done.append((name, value))
        return "set"

    async def trigger(self, name):
        self.done.append(name)
        return "done"

    async def recorded(self):
        return self.rows_recorded


def with_server(work, config=None, file=None, others=()):
    """``work(client, server, wire, *others)`` with a server that listens."""

    async def run():
        wires = [StillWire(), *others]
        server = ViewServer([Desk(wire, config, file) for wire in wires], HOST)
        async with TestClient(TestServer(server.app, host=HOST)) as client:
            return await work(client, server, *wires)

    return asyncio.run(run())


def origin_of(client):
    return f"http://{HOST}:{client.port}"


def headers_of(client, server, **headers):
    return {"Origin": origin_of(client), "Authorization": f"Bearer {server.token}", **headers}


def strict(text):
    """What a browser makes of a message: JSON has no NaN."""

    def refuse(word):
        raise AssertionError(f"{word} is no JSON")

    return json.loads(text, parse_constant=refuse)


async def told(socket, what):
    """The next of the messages that tells of something."""
    while True:
        message = strict(await asyncio.wait_for(socket.receive_str(), 20.0))
        if what in message:
            return message[what]


async def asked(socket, number, **question):
    """The answer to a question."""
    await socket.send_json({"id": number, **question})
    while (answer := await told(socket, "answer")).get("id") != number:
        pass
    return answer


@pytest.mark.parametrize("path", ["/", "/view.js", "/live", "/log", "/recording", "/report/x", "/no_such_page"])
def test_another_sites_page_is_answered_nowhere_and_the_token_wanted_where_something_is_told_or_done(path):
    async def work(client, server, wire):
        method = "POST" if path in ("/log", "/recording") else "GET"

        async def status(**headers):
            async with client.request(method, path, headers=headers) as response:
                return response.status

        assert await status(**headers_of(client, server, Origin="http://attacker.example")) == 403
        assert await status(**headers_of(client, server, Origin="null")) == 403
        assert await status(**headers_of(client, server, Host="attacker.example")) == 403
        acts = path in ("/live", "/log", "/recording")
        assert (await status() == 403) is acts
        assert (await status(Authorization=f"Bearer {server.token}") == 403) is acts  # no page: it says no Origin
        assert (await status(**headers_of(client, server, Authorization="Bearer wrong")) == 403) is acts
        assert await status(**headers_of(client, server)) != 403
        assert wire.done == []

    with_server(work)


def test_numbers_that_are_none_reach_a_page_as_null_also_when_it_opens_later():
    async def work(client, server, wire):
        async def opened():
            return await client.ws_connect("/live", headers=headers_of(client, server))

        wire.live = {"controller.kp": {"value": math.nan, "range": [-math.inf, math.inf]}}
        wire.status = {"values": {"x": math.nan}}
        wire.version += 1
        first = await opened()
        await told(first, "hello")
        for socket in (first, await opened()):
            assert (await told(socket, "state"))["status"] == {"values": {"x": None}}
            assert (await told(socket, "parameters"))["live"] == {
                "controller.kp": {"value": None, "range": [None, None]}
            }
            await socket.close()

    with_server(work)


@pytest.mark.parametrize(
    ("question", "did"),
    [
        ({"do": "stop"}, "stop"),
        ({"do": "enable"}, ("enable", True)),
        ({"do": "disable"}, ("enable", False)),
        ({"do": "setpoint", "position_m": 0.002}, 0.002),
        ({"do": "angle", "angle_rad": -0.1}, ("angle", -0.1)),
        ({"do": "parameter", "name": "controller.kp", "value": 1.0}, ("controller.kp", 1.0)),
        ({"do": "trigger", "name": "tare_load"}, "tare_load"),
    ],
)
def test_what_a_page_asks_is_done_once_and_answered(question, did):
    async def work(client, server, wire):
        socket = await client.ws_connect("/live", headers=headers_of(client, server))
        assert (await asked(socket, 7, **question))["ok"]
        assert wire.done == [("listen", True), did]
        await socket.close()

    with_server(work)


@pytest.mark.parametrize(
    "text",
    [
        '{"id": 1, "do": "setpoint", "position_m": 1' + "0" * 400 + "}",
        '{"id": 1, "do": "setpoint"}',
        '{"id": 1, "do": "setpoint", "position_m": {}}',
        '{"id": 1, "do": "parameter", "name": 1}',
        '{"id": ' + "[" * 500 + "]" * 500 + ', "do": "stop"}',
        '{"id": {}, "do": "enable"}',
        "[]",
        '"stop"',
    ],
)
def test_what_cannot_be_meant_is_answered_and_not_done(text):
    async def work(client, server, wire):
        socket = await client.ws_connect("/live", headers=headers_of(client, server))
        await socket.send_str(text)
        answer = await told(socket, "answer")
        assert not answer["ok"] and "not understood" in answer["sentence"]
        assert wire.done == [("listen", True)]
        assert (await asked(socket, 2, do="stop"))["ok"]
        await socket.close()

    with_server(work)


class Held(StillWire):
    """A node that answers no setpoint until it may."""

    def __init__(self):
        super().__init__()
        self.may = asyncio.Event()

    async def send_setpoint(self, position_m):
        await self.may.wait()
        return await super().send_setpoint(position_m)


def test_a_page_that_asks_too_much_at_once_is_told_so_and_may_stop_and_ask_again_later():
    async def work(client, server, wire, held):
        socket = await client.ws_connect(f"/live?node={held.node}", headers=headers_of(client, server))
        for number in range(MOST_ASKED + 1):
            await socket.send_json({"id": number, "do": "setpoint", "position_m": 1e-3 * number})
        answer = await told(socket, "answer")
        assert (answer["id"], answer["ok"]) == (MOST_ASKED, False) and "too much" in answer["sentence"]
        assert (await asked(socket, "stop", do="stop"))["ok"]
        held.may.set()
        answered = [(await told(socket, "answer"))["id"] for _ in range(MOST_ASKED)]
        assert sorted(answered) == list(range(MOST_ASKED))
        assert (await asked(socket, 99, do="setpoint", position_m=0.002))["ok"]
        await socket.close()

    held = Held()
    held.node = "/held"
    with_server(work, others=[held])


def test_an_answer_that_ros_owes_is_no_success():
    async def work(client, server, wire):
        async def late(_):
            raise TimeoutError

        wire.enable = late
        socket = await client.ws_connect("/live", headers=headers_of(client, server))
        answer = await asked(socket, 1, do="enable")
        assert not answer["ok"] and answer["sentence"] == "ROS did not answer in time"
        await socket.close()

    with_server(work)


def test_whatever_ros_raises_at_a_question_the_page_is_answered():
    """A number of more than 64 bits: rclpy raises SystemError, and the page waited for ever."""

    async def work(client, server, wire):
        async def broken(name, value):
            raise SystemError("returned a result with an exception set")

        wire.set_parameter = broken
        socket = await client.ws_connect("/live", headers=headers_of(client, server))
        answer = await asked(socket, 1, do="parameter", name="controller.kp", value=2**70)
        assert not answer["ok"] and answer["sentence"].startswith("not understood: SystemError: returned a result")
        await socket.close()

    with_server(work)


def test_a_page_that_comes_later_is_told_of_the_log_if_there_is_one():
    desk = Desk(StillWire())
    assert not any("log" in part for part in desk.whole_state())
    desk.logs.said = {"name": "a.csv"}
    assert {"log": {"name": "a.csv"}} in desk.whole_state()


def test_the_node_is_looked_after_for_ever_and_whatever_it_owes():
    wire, seen = StillWire(), []

    async def watch():
        seen.append(len(seen))
        if len(seen) == 4:
            raise asyncio.CancelledError
        if len(seen) < 3:
            raise (TimeoutError, Refused("not now"))[len(seen) - 1]

    wire.watch = watch
    with pytest.raises(asyncio.CancelledError):
        asyncio.run(Desk(wire).watch())
    assert seen == [0, 1, 2, 3]


def test_who_looks_after_the_node_has_ended_when_the_server_has():
    class Slow(StillWire):
        async def watch(self):
            try:
                await asyncio.Event().wait()
            finally:
                await asyncio.sleep(0.05)
                self.done.append("ended")

    slow = Slow()

    async def run():
        server = ViewServer([Desk(slow)], HOST)
        async with TestClient(TestServer(server.app, host=HOST)):
            await asyncio.sleep(0)
        return list(slow.done)

    assert asyncio.run(run()) == ["ended"]


def test_the_curves_are_those_of_the_latest_stress():
    class Curves:
        config = range_m = full_stroke_m = None

        def at(self, stress_Pa):
            return {"stress_Pa": stress_Pa}

    wire = StillWire()
    desk = Desk(wire)
    desk._asymptotes, desk._shown = Curves(), (0, 0, [])
    page = _Page()
    desk.pages.add(page)
    for stress_Pa in (1e6, 2e6, 3e6):
        wire.rows.append([stress_Pa if name == "stress_Pa" else 0.0 for name in COLUMNS])
    asyncio.run(desk.tick())
    assert [strict(each)["curves"] for each in page.waiting if "curves" in each] == [{"stress_Pa": 3e6}]


def test_the_page_and_its_files_are_served():
    async def work(client, server, wire):
        for address, kind in (("/", "text/html"), ("/view.js", "text/javascript"), ("/view.css", "text/css")):
            async with client.get(address) as response:
                assert (response.status, response.content_type) == (200, kind)
                assert await response.text()

    with_server(work)


def test_what_a_trace_of_a_log_says_is_told_with_the_address_of_its_page(monkeypatch):
    """Of real processes, in the long tests: test_view.py."""
    told = []

    async def run(command, _):
        if "trace" not in command:
            Path(command[-1]).write_text('{"words": "replayed", "columns": {}, "traceable": true}')
            return
        assert command[command.index("trace") + 1].endswith("x.csv") and "--config" in command
        folder = Path(command[command.index("--out") + 1])
        folder.mkdir()
        (folder / "report.json").write_text('{"verdict": "none", "sentence": "Nothing is missing."}')
        (folder / "report.html").write_text("the page")

    async def work():
        async def chunks():
            yield b"a log"

        desk = logs.LogDesk(told.append)
        await desk.take("x.csv", chunks(), Config.load(shared_file("config/flexinol.yaml")))
        await desk._task
        page = desk.reports[told[-1]["report"]].read_text()
        await desk.give_up()
        return page

    monkeypatch.setattr(logs, "_run", run)
    assert asyncio.run(work()) == "the page"
    assert [each["trace"] for each in told] == ["", "tracing …", "none: Nothing is missing."]


def test_a_report_is_served_at_its_address_and_nowhere_else(tmp_path):
    async def work(client, server, wire):
        (tmp_path / "report.html").write_text("traced")
        server._desks[wire.node].logs.reports["/report/abc"] = tmp_path / "report.html"
        async with client.get("/report/abc") as response:
            assert (response.status, await response.text()) == (200, "traced")
        async with client.get("/report/abd") as response:
            assert response.status == 404

    with_server(work)


def test_a_page_that_is_closed_is_told_nothing_more_and_what_it_asked_ends():
    async def until(condition):
        async with asyncio.timeout(20.0):
            while not condition():
                await asyncio.sleep(0.005)

    async def work(client, server, wire, held):
        pages, address = server._desks[held.node].pages, f"/live?node={held.node}"
        first, second = [await client.ws_connect(address, headers=headers_of(client, server)) for _ in range(2)]
        await first.send_json({"id": 1, "do": "setpoint", "position_m": 0.002})
        await until(lambda: any(page.asked for page in pages))
        asked_of_it = [task for page in pages for task in page.asked]
        await first.close()
        await until(lambda: len(pages) == 1)
        await until(lambda: all(task.done() for task in asked_of_it))
        assert ("listen", False) not in held.done  # the other page listens still
        await second.close()
        await until(lambda: ("listen", False) in held.done)
        assert not pages

    held = Held()
    held.node = "/held"
    with_server(work, others=[held])


def test_new_parameters_are_told_to_pages_that_are_open():
    wire = StillWire()
    wire.parameters_version = 1
    desk = Desk(wire)
    page = _Page()
    desk.pages.add(page)
    asyncio.run(desk.tick())  # the first of all is as new
    told_before = sum("parameters" in each for each in map(strict, page.waiting))
    asyncio.run(desk.tick())
    assert sum("parameters" in each for each in map(strict, page.waiting)) == told_before == 1
    wire.parameters_version += 1
    asyncio.run(desk.tick())
    assert sum("parameters" in each for each in map(strict, page.waiting)) == 2


def test_a_page_that_comes_later_is_told_the_curves_of_the_load_there_is():
    desk = Desk(StillWire())
    desk._asymptotes = SimpleNamespace(at=lambda stress_Pa: {"stress_Pa": stress_Pa}, range_m=None, full_stroke_m=None)
    desk._shown = (0, 0, [])
    desk.pages.add(_Page())
    desk.wire.rows.append(row(stress_Pa=54e6))
    asyncio.run(desk.tick())
    assert [each["curves"] for each in desk.whole_state() if "curves" in each] == [{"stress_Pa": 54e6}]
    desk.wire.parameters_version += 1
    asyncio.run(desk.tick())
    assert not any("curves" in each for each in desk.whole_state()), "those of another model"


def test_a_log_that_is_forgotten_is_given_up_and_so_it_is_at_the_end(monkeypatch):
    given_up = []

    async def give_up(self):
        given_up.append(self)

    async def work(client, server, wire):
        socket = await client.ws_connect("/live", headers=headers_of(client, server))
        await socket.send_json({"id": 1, "do": "forget_log"})
        assert await told(socket, "log") is None
        assert len(given_up) == 1

    monkeypatch.setattr(logs.LogDesk, "give_up", give_up)
    with_server(work)
    assert len(given_up) == 2


def test_the_pages_are_told_at_times_and_not_all_the_time():
    assert 0.0 < TICK_s <= 0.1, "a picture that moves"


def test_what_a_page_does_not_take_displaces_the_oldest():
    async def work():
        page = _Page()
        for number in range(MOST_WAITING + 5):
            page.tell(str(number))
        assert list(page.waiting) == [str(number) for number in range(5, MOST_WAITING + 5)]
        assert page.more.is_set()

    asyncio.run(work())
    assert (MOST_ASKED, MOST_WAITING) == (20, 100)


class TestGainsThatAreSaved:
    """From the node into the parameter file."""

    @pytest.fixture
    def saved(self, tmp_path):
        def save(live, angle_range_rad=None, named=True):
            file = tmp_path / "wire.yaml"
            file.write_bytes(shared_file("config/flexinol.yaml").read_bytes())
            tables = shared_file("config/flexinol.tables.npz")
            (tmp_path / tables.name).write_bytes(tables.read_bytes())

            async def work(client, server, wire):
                wire.live = {name: {"value": value} for name, value in live.items()}
                wire.angle_range_rad = angle_range_rad
                socket = await client.ws_connect("/live", headers=headers_of(client, server))
                answer = await asked(socket, 1, do="save")
                await socket.close()
                return answer

            return with_server(work, file=file if named else None), Config.load(file).controller

        return save

    def test_those_that_have_changed_are_written(self, saved):
        answer, law = saved({"controller.kp": 123.0, "controller.ki": 320.0, "safety.load_spike": 9.0})
        assert answer["ok"] and "kp 123 (before: kp 400)" in answer["sentence"]
        assert (law.kp, law.ki) == (123.0, 320.0)

    def test_where_none_has_that_is_said(self, saved):
        answer, _ = saved({"controller.kp": 400.0, "controller.type": "pid"})
        assert answer["ok"] and answer["sentence"].endswith("has these gains already")

    def test_where_the_disk_takes_them_not_that_is_said(self, saved, monkeypatch):
        def full(*_):
            raise OSError(errno.ENOSPC, "No space left on device")

        monkeypatch.setattr(server, "write_atomically", full)
        answer, law = saved({"controller.kp": 123.0})
        assert not answer["ok"] and answer["sentence"].endswith("not written (No space left on device)")
        assert law.kp == 400.0

    def test_those_of_a_joint_are_not(self, saved):
        answer, law = saved({"controller.kp": 123.0}, angle_range_rad=(-1.0, 1.0))
        assert not answer["ok"] and law.kp == 400.0

    def test_nor_any_without_a_file(self, saved):
        answer, _ = saved({"controller.kp": 123.0}, named=False)
        assert not answer["ok"] and "--config FILE" in answer["sentence"]


@pytest.mark.parametrize("name", ["x" * 5000, "ä" * 150 + ".csv", "\n" * 201])
def test_a_log_with_a_name_that_no_disk_takes_is_refused_in_words(name):
    async def work(client, server, wire):
        headers = headers_of(client, server)
        async with client.post("/log", params={"name": name}, data=b"x", headers=headers) as response:
            assert response.status == 400
            assert "give the file a shorter one" in await response.text()

    with_server(work, Config.load(shared_file("config/flexinol.yaml")))


def test_a_log_that_comes_while_another_is_dropped_gives_way_in_words(monkeypatch):
    """It was said that the disk has no such folder; one that was too large took the newer one with it."""

    async def work():
        desk = logs.LogDesk(lambda said: None)
        worked_on = []
        monkeypatch.setattr(desk, "_work", lambda log, model: worked_on.append(log.name) or asyncio.sleep(0))
        config = Config.load(shared_file("config/flexinol.yaml"))
        begun, dropped = asyncio.Event(), asyncio.Event()

        async def slow():
            yield b"time_s\n"
            begun.set()
            await dropped.wait()
            yield b"1\n"

        async def whole():
            yield b"time_s\n1\n"

        first = asyncio.create_task(desk.take("first.csv", slow(), config))
        await begun.wait()
        await desk.take("second.csv", whole(), config)
        dropped.set()
        with pytest.raises(UserError, match=r"first\.csv: another log was dropped meanwhile"):
            await first
        assert worked_on == ["second.csv"]
        await desk.give_up()

    asyncio.run(work())


def test_a_log_that_is_dropped_is_taken(monkeypatch):
    async def take(self, name, chunks, config):
        assert (name, [chunk async for chunk in chunks]) == ("a.csv", [b"x"])

    async def work(client, server, wire):
        headers = headers_of(client, server)
        async with client.post("/log", params={"name": "a.csv"}, data=b"x", headers=headers) as response:
            assert (response.status, await response.text()) == (202, "taken")

    monkeypatch.setattr(logs.LogDesk, "take", take)
    with_server(work)


def test_a_log_that_the_disk_does_not_take_is_answered_in_words(monkeypatch):
    async def work(client, server, wire):
        async with client.post(
            "/log", params={"name": "a.csv"}, data=b"x", headers=headers_of(client, server)
        ) as response:
            assert response.status == 507
            assert "No space left" in await response.text()

    def full(**_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(logs.tempfile, "TemporaryDirectory", full)
    with_server(work, Config.load(shared_file("config/flexinol.yaml")))


def test_what_works_on_a_log_has_a_bound_of_memory_and_says_so(monkeypatch):
    monkeypatch.setattr(logs, "LARGEST_PROCESS_B", 500_000_000)
    hungry = [sys.executable, "-c", "bytearray(1_000_000_000)"]
    with pytest.raises(UserError, match=r"more than 0\.5 GB of memory; use sma-actuator"):
        asyncio.run(logs._run(hungry, 60.0))


def test_a_download_before_there_is_anything_says_so():
    async def work(client, server, wire):
        async with client.post("/recording", headers=headers_of(client, server)) as response:
            assert response.status == 409
            assert "nothing is recorded yet" in await response.text()

    with_server(work)


def test_what_is_downloaded_holds_every_step_and_check_log_takes_it(tmp_path):
    rig = Rig(read_parameter_file(shared_file("config/flexinol.yaml")))
    rig.enable()
    rig.track(0.0035)
    rig.track(0.0025)
    rows = {
        (named := named_signals(output))["time_s"]: (named, "enabled" if number == 3 else "")
        for number, output in enumerate(rig.outputs)
    }
    path = tmp_path / "seen.csv"
    path.write_bytes(logs.bench_log_of(rows))
    log = read_bench_log(path)
    assert len(log) == len(rows)
    for name in ("supply_voltage_V", "load_cell_voltage_V", "setpoint_m", "quality", "output_on"):
        np.testing.assert_allclose(log[name], [named[name] for named, _ in rows.values()], rtol=1e-8, err_msg=name)
    assert log.events == ((log["time_s"][3], "enabled"),)
    assert all(np.isfinite(log[name]).any() for name in log.columns), "channels that are wired"
    main(["check-log", str(path), "--quiet", "--json", str(tmp_path / "found.json")])
    found = {each["requirement"]: each["met"] for each in json.loads((tmp_path / "found.json").read_text())}
    assert found["20 readings a second or more"] and found["every row is a new reading"]


# --- several nodes -----------------------------------------------------------------------------------------


def joint():
    """A joint that two wires turn, at an angle of 0.1 rad."""
    wire = StillWire()
    wire.node = "/joint"
    wire.parameters_version = 1
    wire.parameters = {"wires": ["left", "right"], "joint_name": "joint"}
    wire.angle_range_rad = (-0.4, 0.4)
    wire.live = {
        "cocontraction": {"value": 0.8, "range": [0.0, 5.0], "description": "tension", "choices": [], "whole": False}
    }
    wire.status = {"level": 0, "message": "holding", "mode": "hold", "fault": None, "limits": [], "values": {}}
    return wire


def row(**values):
    """A row of what a page draws."""
    return [values.get(name) for name in COLUMNS]


def test_a_page_shows_and_asks_its_own_node_and_stops_all_of_them():
    async def work(client, server, wire, other):
        sockets = [
            await client.ws_connect("/live", params=params, headers=headers_of(client, server))
            for params in ({}, {"node": "/joint"})
        ]
        assert [(await told(socket, "hello"))["node"] for socket in sockets] == ["/sma_actuator", "/joint"]
        other.status = {**other.status, "level": 2}
        other.version += 1
        for socket in sockets:  # each page shows how every node is
            while (await told(socket, "state"))["tabs"] != [["/sma_actuator", None], ["/joint", 2]]:
                pass
        assert (await asked(sockets[1], 1, do="angle", angle_rad=0.2))["ok"]
        assert (await asked(sockets[0], 1, do="stop"))["sentence"] == "every wire is off"
        assert wire.done == [("listen", True), "stop"]
        assert other.done == [("listen", True), ("angle", 0.2), "stop"]

        async def refuse():
            raise Refused("/joint does not offer ~/stop now")

        other.stop = refuse
        answer = await asked(sockets[0], 2, do="stop")
        assert not answer["ok"]
        assert answer["sentence"] == "every wire is off; /joint does not offer ~/stop now"
        assert wire.done[-1] == "stop"

        async def break_off():
            raise RuntimeError("provoked")

        other.stop = break_off
        answer = await asked(sockets[0], 3, do="stop")
        assert (answer["ok"], answer["sentence"]) == (False, "not understood: RuntimeError: provoked")
        async with client.get("/live", params={"node": "/none"}, headers=headers_of(client, server)) as response:
            assert response.status == 404
            assert "'/none' is none of /sma_actuator, /joint" in await response.text()
        for socket in sockets:
            await socket.close()

    with_server(work, others=[joint()])


@pytest.mark.skipif(find_chromium() is None, reason="no Chromium is installed: the tabs were not tried in a browser")
def test_in_the_browser_a_joint_is_a_tab_and_is_turned_in_degrees(tmp_path):
    async def work(client, server, wire, other):
        async with Chromium() as browser:
            await browser.open(f"{origin_of(client)}/#token={server.token}")
            await browser.wait_for("document.querySelectorAll('#tabs a').length === 2 && kind === WIRE")
            await browser.open(await browser.value("document.querySelector('#tabs a:last-child').href"))
            await browser.wait_for(
                "document.querySelector('#tabs a[aria-current]')?.textContent === '/joint' && kind === JOINT"
            )
            assert await browser.value("location.hash") == ""
            assert await browser.value(
                "$('loop-section').hidden && document.querySelector('.unit').textContent === '°'"
            )
            for step in range(30):
                other.rows.append(
                    row(
                        at_s=1e9 + 0.05 * step,
                        angle_rad=0.1,
                        uncertainty_rad=0.02,
                        asked_angle_rad=0.11,
                        cocontraction_N=0.8,
                    )
                )
            await browser.wait_for("document.querySelector('#values').textContent.startsWith('angle5.73 °')")
            await browser.wait_for("$('grip').textContent === '6.30' && !$('grip').disabled")
            await browser.value("$('setpoint-mm').value = '-9'; $('setpoint-mm').dispatchEvent(new Event('input'))")
            await browser.click("#setpoint-send")
            await browser.wait_for("document.querySelector('#said li')?.textContent === 'sent'")
            what, angle_rad = other.done[-1]
            assert what == "angle" and math.degrees(angle_rad) == pytest.approx(-9.0)
            assert wire.done[-1] == ("listen", False), "the page of before has gone"
            await browser.value("dispatchEvent(new KeyboardEvent('keydown', {code: 'Space'}))")
            await browser.wait_for("document.querySelector('#said li').textContent === 'every wire is off'")
            assert wire.done[-1] == other.done[-1] == "stop"

    with_server(work, others=[joint()])
