"""The page of a node: what it is asked over its WebSocket, and what a person does with it in a real browser."""

import asyncio
import contextlib
import http.client
import math
import time
from urllib.parse import urlsplit

import numpy as np
import pytest

pytest.importorskip("aiohttp", reason="aiohttp is not installed (extra 'view')")
pytest.importorskip("rclpy", reason="ROS 2 is not installed (extra 'ros')")
import aiohttp
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import WrenchStamped
from processes import SOON_s, wait_until
from rcl_interfaces.msg import Parameter, ParameterEvent, ParameterValue
from std_msgs.msg import Float64
from waiting import Elapsed

from benchmarks.chromium import Chromium, find_chromium
from sma_actuator.base.parameters import walk
from sma_actuator.base.share import shared_file
from sma_actuator.bench import InProcessDaq, InProcessSupply, VirtualBench, VirtualClock
from sma_actuator.characterise import Rig
from sma_actuator.characterise.programs import Drive
from sma_actuator.cli.main import main
from sma_actuator.config import Config
from sma_actuator.logs.bench_log import read_bench_log, write_bench_log
from sma_actuator.view.asymptotes import Asymptotes, asymptotes_of, config_of

NAME = "/sma_actuator"
STOP_s = 0.5  #: from the press of STOP to no current at the supply
NO_CURRENT_A = 1e-3


class Page:
    """What a page is to the server: one WebSocket, and what came over it."""

    def __init__(self, socket):
        self.socket = socket
        self.told = {}
        self.rows = []
        self.answers = {}
        self._number = 0

    async def take(self):
        """The next message."""
        message = await self.socket.receive_json(timeout=SOON_s)
        for kind, content in message.items():
            if kind == "rows":
                self.rows += content
            elif kind == "answer":
                self.answers[content.get("id")] = content
            else:
                self.told[kind] = content

    async def until(self, condition):
        """Take messages until the condition holds; its value."""
        deadline_s = time.monotonic() + SOON_s
        while not (value := condition()):
            assert time.monotonic() < deadline_s, self.told
            await self.take()
        return value

    async def ask(self, what, **more):
        """The answer to what is asked."""
        self._number += 1
        await self.socket.send_json({"id": self._number, "do": what, **more})
        return await self.until(lambda: self.answers.get(self._number))

    async def enabled(self):
        """Enable the wire, once the node is there and has readings: a node that has just come may not be reached at
        first."""
        await self.until(lambda: self.told.get("state", {}).get("present") and self.rows)
        for _ in range(5):
            answer = await self.ask("enable")
            if answer["ok"]:
                return
        raise AssertionError(answer)

    async def send(self, position_m):
        """Send a setpoint, again where the first was lost: DDS drops what comes before a reader knows its writer."""

        async def arrives():
            while self.latest("setpoint_m") != position_m:
                await self.take()

        for _ in range(10):
            answer = await self.ask("setpoint", position_m=position_m)
            assert answer["ok"], answer
            with contextlib.suppress(TimeoutError):
                return await asyncio.wait_for(arrives(), 3.0)
        raise AssertionError(self.told["state"]["status"])

    def latest(self, name):
        """The value of a column in the last row."""
        return self.rows[-1][self.told["hello"]["columns"].index(name)]


def _live(stand, **headers):
    """Headers with which a page opens its WebSocket."""
    return {"Origin": stand.url, "Sec-WebSocket-Protocol": f"sma-view, token.{stand.token}", **headers}


def with_page(stand, work):
    """Run ``work(page)`` with an open page."""

    async def run():
        async with (
            aiohttp.ClientSession() as http,
            http.ws_connect(f"{stand.url}/live", headers=_live(stand)) as socket,
        ):
            return await work(Page(socket))

    return asyncio.run(run())


def _seconds_to_no_current(stand):
    elapsed = Elapsed()

    def is_off():
        elapsed.look()
        return abs(stand.bench.current_A()) < NO_CURRENT_A

    wait_until(is_off, what="no current")
    return elapsed.look()


# --- who may -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("headers", "word"),
    [
        ({"Host": "attacker.example:8765"}, "Host"),
        ({"Host": "127.0.0.1.attacker.example"}, "Host"),
        ({"Origin": "http://attacker.example"}, "Origin"),
        ({"Origin": "null"}, "Origin"),
        ({"Origin": ""}, "Origin"),
        ({"Sec-WebSocket-Protocol": "sma-view"}, "token"),
        ({"Sec-WebSocket-Protocol": "sma-view, token.wrong"}, "token"),
    ],
)
def test_only_a_page_of_this_server_with_its_token_is_answered(stand, headers, word):
    async def refusals():
        async with aiohttp.ClientSession() as http:
            upgrade = {"Connection": "Upgrade", "Upgrade": "websocket", "Sec-WebSocket-Version": "13"}
            upgrade["Sec-WebSocket-Key"] = "AAAAAAAAAAAAAAAAAAAAAA=="
            async with http.get(f"{stand.url}/live", headers={**upgrade, **_live(stand, **headers)}) as response:
                live = response.status, await response.text()
            sent = {"Origin": stand.url, "Authorization": f"Bearer {stand.token}", **headers}
            if word == "token":
                sent["Authorization"] = "Bearer wrong"
            async with http.post(f"{stand.url}/log?name=x.csv", data=b"x", headers=sent) as response:
                return live, (response.status, await response.text())

    for status, text in asyncio.run(refusals()):
        assert status == 403
        assert word in text


@pytest.mark.parametrize(("header", "word"), [("Host", "Host"), ("Origin", "Origin"), ("Authorization", "token")])
def test_headers_that_are_no_text_are_refused_as_others(stand, header, word):
    headers = {"Host": urlsplit(stand.url).netloc, "Origin": stand.url, header: b"Bearer \xff\xfe"}
    connection = http.client.HTTPConnection(urlsplit(stand.url).netloc, timeout=SOON_s)
    connection.putrequest("POST", "/log?name=x.csv", skip_host=True)
    for name, value in headers.items():
        connection.putheader(name, value)
    connection.endheaders()
    answer = connection.getresponse()
    assert answer.status == 403 and word in answer.read().decode()
    connection.close()


def test_the_page_brings_nothing_from_elsewhere_and_nobody_may_frame_it(stand):
    async def get():
        async with aiohttp.ClientSession() as http:
            for path in ("/", "/view.js", "/view.css", "/uPlot.js", "/uPlot.css"):
                async with http.get(stand.url + path) as response:
                    assert response.status == 200
                    policy = response.headers["Content-Security-Policy"]
                    assert "default-src 'none'" in policy
                    assert "frame-ancestors 'none'" in policy
                    assert stand.token not in await response.text()

    asyncio.run(get())


@pytest.mark.parametrize(
    ("host", "word"), [("0.0.0.0", "every address"), ("::", "every address"), ("robot", "no address")]
)
def test_it_listens_on_one_address_that_is_named(host, word, capsys):
    assert main(["view", "--host", host]) == 1
    assert word in capsys.readouterr().err


# --- what a page sees and asks ---------------------------------------------------------------------------


def test_what_the_wire_does_arrives_and_a_refused_gain_is_answered_in_the_nodes_words(stand):
    async def work(page):
        await page.until(lambda: page.told.get("parameters", {}).get("live") and page.rows)
        declared = page.told["parameters"]["live"]["controller.kp"]
        assert declared["range"] == [0.0, 1e6]
        assert "proportional gain" in declared["description"]
        assert not any(name.startswith("model.") for name in page.told["parameters"]["live"])

        for value in ("abc", -1.0, 1e9):
            answer = await page.ask("parameter", name="controller.kp", value=value)
            assert not answer["ok"]
            assert "controller.kp" in answer["sentence"]
        assert (await page.ask("parameter", name="controller.kp", value=810))["ok"]
        await page.until(lambda: page.told["parameters"]["live"]["controller.kp"]["value"] == 810.0)

        refused = await page.ask("trigger", name="no_such_thing")
        assert not refused["ok"]
        assert "does not offer" in refused["sentence"]
        for odd in ("explode", "parameter", "setpoint"):
            await page.socket.send_json({"id": odd, "do": odd})
        await page.until(lambda: {"parameter", "setpoint"} <= set(page.answers))
        assert not page.answers["setpoint"]["ok"]

        await page.enabled()
        assert {"self_test", "tare_load"} <= set(page.told["state"]["services"])
        await page.send(0.0025)
        await page.until(lambda: abs((page.latest("displacement_estimate_m") or 0.0) - 0.0025) < 2e-4)
        assert stand.bench.truth()[0] == pytest.approx(0.0025, abs=5e-4)
        assert page.latest("setpoint_m") == 0.0025
        assert page.latest("shortest_m") < 0.0025 < page.latest("longest_m"), "how far it can go at its load"
        await page.until(lambda: page.told["state"]["status"]["mode"] == "tracking")
        curves = page.told["curves"]
        assert curves["stress_Pa"] == pytest.approx(page.latest("stress_Pa"), rel=0.1)
        assert len(curves["heating_m"]) == len(curves["resistance_Ohm"])

    with_page(stand, work)


@pytest.mark.parametrize("text", ["", "{", "null", '{"id": 1}', '{"id": 1, "do": []}', "[" * 5000, '{"a":' * 1500])
def test_what_a_page_cannot_mean_is_answered_and_the_page_stays(stand, text):
    async def work(page):
        await page.socket.send_str(text)
        assert "not understood" in (await page.until(lambda: page.answers.get(None)))["sentence"]
        assert (await page.ask("forget_log"))["ok"]

    with_page(stand, work)


def test_stop_switches_the_output_off_at_the_supply_within_half_a_second(stand):
    async def work(page):
        took_s = []
        for _ in range(3):  # a machine that is busy with other things may stand still once
            await page.enabled()
            await asyncio.to_thread(wait_until, lambda: stand.bench.current_A() > 0.01, what="current")
            await page.socket.send_json({"id": 0, "do": "stop"})
            took_s.append(await asyncio.to_thread(_seconds_to_no_current, stand))
            assert (await page.until(lambda: page.answers.pop(0, None)))["ok"]
            if took_s[-1] < STOP_s:
                break
        assert min(took_s) < STOP_s

    with_page(stand, work)


def test_a_closed_page_commands_nothing_and_costs_the_node_nothing(stand, client):
    setpoints = client.listen(f"{NAME}/setpoint", Float64)

    async def work(page):
        await page.enabled()
        for _ in range(200):  # until who listens here is known there: what was said before, nobody hears
            assert (await page.ask("setpoint", position_m=0.003))["ok"]
            await asyncio.to_thread(client.next, f"{NAME}/load", WrenchStamped)
            if setpoints:
                break

    with_page(stand, work)
    assert {message.data for message in setpoints} == {0.003}
    signals = f"{NAME}/signals"
    client.spin_until(lambda: not client.node.get_subscriptions_info_by_topic(signals), what="the end of listening")
    loads = client.listen(f"{NAME}/load", WrenchStamped)
    client.spin_until(lambda: len(loads) > 10, what="loads, and what was still on its way")
    heard = len(setpoints)
    loads.clear()
    client.spin_until(lambda: len(loads) > 40, what="loads")
    assert len(setpoints) == heard


def test_whatever_diagnoses_the_wire_is_shown(stand, client):
    said = DiagnosticStatus(level=DiagnosticStatus.WARN, name=f"{NAME}: model", message="calibration is due")
    said.values.append(KeyValue(key="since", value="yesterday"))

    async def work(page):
        await asyncio.to_thread(client.publish, "/diagnostics", DiagnosticArray(status=[said]))
        names = {said.name, f"{NAME}: model health"}  # the latter is the node's own
        await page.until(lambda: names <= {d["name"] for d in page.told.get("state", {}).get("diagnostics", [])})
        shown = next(d for d in page.told["state"]["diagnostics"] if d["name"] == said.name)
        assert shown == {"level": 1, "name": said.name, "message": said.message, "values": {"since": "yesterday"}}

    with_page(stand, work)


def test_what_anybody_says_that_a_parameter_is_the_node_is_asked_for(stand, client):
    """False events made the page show what is no number, and forget the node's model."""
    odd = [
        ParameterValue(type=3, double_value=math.nan),
        ParameterValue(type=4, string_value="x"),
        ParameterValue(type=99),
    ]
    lies = [Parameter(name=name, value=value) for name in ("controller.kp", "wire.length") for value in odd]

    async def work(page):
        before = await page.until(lambda: page.told.get("parameters", {}).get("range_m") and page.told["parameters"])
        del page.told["parameters"]
        event = ParameterEvent(node=NAME, changed_parameters=lies)
        await asyncio.to_thread(client.publish, "/parameter_events", event)
        assert await page.until(lambda: page.told.get("parameters")) == before

    with_page(stand, work)


@pytest.fixture(params=[2, pytest.param(3, marks=pytest.mark.long)])
def log(request, tmp_path_factory):
    """A bench log of some seconds; three cycles are the fewest that can be traced."""
    config = Config.load(shared_file("config/flexinol.yaml"))
    bench = VirtualBench.from_name("flexinol", seed=3)
    rig = Rig(config, InProcessSupply(bench, config), InProcessDaq(bench, config), VirtualClock(bench))
    path = tmp_path_factory.mktemp("log") / "pulses.csv"
    with rig.opened():
        write_bench_log(
            path, rig.record(Drive(float(a)) for a in np.tile(np.repeat([0.05, 0.32], [40, 60]), request.param))
        )
    return path, request.param


def test_a_log_that_is_sent_is_replayed_and_traced_with_the_nodes_model(stand, log):
    log, cycles = log

    async def work(page):
        await page.until(lambda: page.told.get("parameters", {}).get("range_m"))
        headers = {"Origin": stand.url, "Authorization": f"Bearer {stand.token}"}
        async with aiohttp.ClientSession() as http:
            url = f"{stand.url}/log"
            async with http.post(url, params={"name": "../../x.csv"}, data=b"no log", headers=headers) as response:
                assert response.status == 202
            await page.until(lambda: (page.told.get("log") or {}).get("words", "").startswith("not replayed"))
            assert page.told["log"]["name"] == "x.csv"
            async with http.post(url, params={"name": log.name}, data=log.read_bytes(), headers=headers) as response:
                assert response.status == 202
            await page.until(lambda: "columns" in (page.told.get("log") or {}))
            columns = page.told["log"]["columns"]
            assert len(columns["at_s"]) == 100 * cycles
            errors = [
                abs(a - b)
                for a, b in zip(columns["displacement_estimate_m"], columns["displacement_m"])
                if a is not None
            ]
            assert np.mean(errors) < 2e-4
            assert "mean absolute error" in page.told["log"]["words"]
            await page.until(lambda: page.told["log"]["trace"] not in ("", "tracing …"))
        verdict = page.told["log"]["trace"]
        # Of what a trace makes of it, test_view_server.py sees that its page is served.
        verdicts = ("not traced",) if cycles < 3 else ("none", "traced", "unexplained", "not traced")
        assert verdict.partition(":")[0] in verdicts, verdict
        if "report" in page.told["log"]:
            async with aiohttp.ClientSession() as http, http.get(stand.url + page.told["log"]["report"]) as response:
                assert response.status == 200
                assert "sandbox" in response.headers["Content-Security-Policy"]
        assert (await page.ask("forget_log"))["ok"]
        await page.until(lambda: page.told["log"] is None)

    with_page(stand, work)


def test_what_was_just_seen_is_downloaded_as_a_bench_log(stand, tmp_path):
    async def work(page):
        await page.enabled()
        await page.send(0.0024)
        await page.until(lambda: abs((page.latest("displacement_estimate_m") or 0.0) - 0.0024) < 2e-4)
        await page.until(lambda: len(page.rows) > 60)
        headers = {"Origin": stand.url, "Authorization": f"Bearer {stand.token}"}
        async with aiohttp.ClientSession() as http, http.post(f"{stand.url}/recording", headers=headers) as response:
            assert response.status == 200, await response.text()
            assert "sma_actuator_" in response.headers["Content-Disposition"]
            (tmp_path / "seen.csv").write_bytes(await response.read())
        return {row[0] for row in page.rows}, page.latest("setpoint_m")

    rows, setpoint_m = with_page(stand, work)
    log = read_bench_log(tmp_path / "seen.csv", allow_gaps=True)
    # the page draws a part of them; the last may still be on their way to one of the two
    assert len(log) >= len(rows) - 5
    assert log["setpoint_m"][-1] == setpoint_m
    assert np.nanmin(np.abs(log["displacement_estimate_m"] - 0.0024)) < 2e-4


# --- the model -------------------------------------------------------------------------------------------


def test_the_asymptotes_are_those_of_the_model_that_the_parameters_say():
    config = Config.load(shared_file("config/flexinol.yaml"))
    parameters = {name: value for name, value, *_ in walk(config) if value != ()}
    assert repr(config_of({**parameters, "use_sim_time": False})) == repr(config)
    found, why = asymptotes_of(parameters)
    assert why == ""
    curves = found.at(60e6)
    heating_m, cooling_m = config.model.build(config.wire).limits_m(np.array(curves["resistance_Ohm"]), 60e6)
    np.testing.assert_allclose(curves["heating_m"], heating_m, atol=1e-8)
    np.testing.assert_allclose(curves["cooling_m"], cooling_m, atol=1e-8)
    assert found.at(60.1e6) is None  # too little has changed to draw it again
    assert found.at(80e6) is not None
    assert found.at(math.nan) is None


def test_a_model_that_cannot_be_built_here_is_said_so():
    config = Config.load(shared_file("config/flexinol.yaml"))
    parameters = {name: value for name, value, *_ in walk(config) if value != ()}
    found, why = asymptotes_of({**parameters, "model.type": "of_another_package"})
    assert found is None
    assert "of_another_package" in why
    assert isinstance(asymptotes_of(parameters)[0], Asymptotes)


# --- in a browser ----------------------------------------------------------------------------------------


class Browser:
    """A browser with the page open, for tests that are no coroutines."""

    def __init__(self, stand):
        self._loop = asyncio.new_event_loop()
        self._chromium = Chromium()
        self._loop.run_until_complete(self._chromium.__aenter__())
        self.open(stand.address)

    def __getattr__(self, name):
        method = getattr(self._chromium, name)
        return lambda *arguments, **more: self._loop.run_until_complete(method(*arguments, **more))

    def mouse(self, kind, x, y):
        """What a mouse does at a place of the page, its button held down."""
        self.command("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=1, clickCount=1)

    def point(self):
        """Resistance [Ω] and displacement [mm] of the moving point, or None."""
        words = self.text("#point").split()
        return (float(words[1]), float(words[4])) if words[:1] == ["R"] else None

    def close(self):
        self._loop.run_until_complete(self._chromium.__aexit__(None, None, None))
        self._loop.close()


@pytest.fixture(scope="module")
def browser(stand):
    if find_chromium() is None:
        pytest.skip("no Chromium is installed (apt-get install chromium): the page was not tried in a browser")
    browser = Browser(stand)
    yield browser
    browser.close()


def _enabled_by_hand(browser, stand):
    browser.wait_for("document.querySelector('#mode').textContent !== '–'")
    deadline_s = time.monotonic() + SOON_s
    while not stand.bench.current_A() > 0.01:
        assert time.monotonic() < deadline_s, browser.text("#said")
        browser.click("#enable")
        browser.wait_for("document.querySelector('#said').children.length > 0")
        # Not clicked again while a click may still be on its way: one that comes after a setpoint holds the wire where
        # it is.
        again_s = time.monotonic() + 10.0
        while not stand.bench.current_A() > 0.01 and time.monotonic() < again_s:
            time.sleep(0.1)
        if stand.bench.current_A() > 0.01:  # on a slow machine the answer comes later, and after that to what is next
            browser.wait_for("document.querySelector('#said li').textContent.includes('the output is on')")


def _sent_by_hand(browser, goal_mm):
    """Send a setpoint and see that the node follows it; again where it does not, as a person does."""
    field, send = (f"document.querySelector('{name}')" for name in ("#setpoint-mm", "#setpoint-send"))
    followed = f"Math.abs(live.last('setpoint_m') - {goal_mm}) < 1e-6 && $('mode').textContent === 'tracking'"
    for _ in range(10):
        browser.wait_for(f"!{send}.disabled")  # as it is until the page knows how far the wire may go
        browser.value(f"{field}.value = '{goal_mm}'; {field}.dispatchEvent(new Event('input'))")
        browser.click("#setpoint-send")
        for _ in range(50):
            if browser.value(followed):
                return
            time.sleep(0.1)
    raise AssertionError(browser.value("document.body.innerText"))


def test_in_the_browser_the_point_moves_where_it_is_sent(browser, stand):
    _enabled_by_hand(browser, stand)
    assert browser.value("location.hash") == ""  # the token does not stay in the address
    for goal_mm in (2.6, 2.2):
        _sent_by_hand(browser, goal_mm)
        wait_until(lambda g=goal_mm: (p := browser.point()) and abs(p[1] - g) < 0.2, what=f"{goal_mm} mm")
        assert stand.bench.truth()[0] * 1e3 == pytest.approx(goal_mm, abs=0.5)
    assert browser.text("#quality").startswith("determinate")
    assert browser.text("#mode") == "tracking"


def test_in_the_browser_a_zoom_stays_while_data_arrive_and_the_legend_has_the_values_of_now(browser):
    browser.wait_for("live.times.length > 40")
    shown = "JSON.stringify([positionPlot.scales.x.min, positionPlot.scales.x.max])"
    place = browser.value(
        "(() => { const r = positionPlot.over.getBoundingClientRect(); return [r.left, r.width, r.top + r.height / 2]; "
        "})()"
    )
    for kind, share in (("mousePressed", 0.4), ("mouseMoved", 0.6), ("mouseReleased", 0.6)):
        browser.mouse(kind, place[0] + share * place[1], place[2])
    browser.wait_for("zoom !== null && !$('zoom').hidden")
    browser.wait_for("positionPlot.scales.x.max === zoom.max")
    before, newest = browser.value(shown), browser.value("live.last('at_s')")
    browser.wait_for(f"live.last('at_s') > {newest} + 1")
    assert browser.value(shown) == before
    assert browser.value("heatPlot.scales.x.max === zoom.max")
    browser.click("#zoom")
    browser.wait_for("zoom === null && positionPlot.scales.x.max >= live.last('at_s') - 1")
    browser.command("Input.dispatchMouseEvent", type="mouseMoved", x=1, y=1)  # away from the plots
    legend = "[...document.querySelectorAll('#position-plot .u-series')].at(-1).querySelector('.u-value').textContent"
    browser.wait_for(f"Number({legend}) === Number(live.last('displacement_estimate_m').toFixed(3))")


def _grabbed(browser):
    """Press on the grip, and where; until then the plot makes room for what arrives, and the grip moves with it."""
    browser.value("$('grip').scrollIntoView({block: 'center'})")
    for _ in range(50):
        x, y = browser.value(
            "(() => { const r = $('grip').getBoundingClientRect(); return [r.x + r.width / 2, r.y + r.height / 2]; })()"
        )
        browser.mouse("mousePressed", x, y)
        if browser.value("grabbed !== null"):
            return x, y
        browser.mouse("mouseReleased", x, y)
    raise AssertionError("the grip was not grabbed")


def test_in_the_browser_the_setpoint_is_dragged_on_the_plot(browser, stand):
    _enabled_by_hand(browser, stand)
    _sent_by_hand(browser, 2.4)
    x, y = _grabbed(browser)
    px_per_mm = browser.value("positionPlot.valToPos(2, 'y') - positionPlot.valToPos(3, 'y')")  # which stands by now
    for kind, mm in [("mouseMoved", 0.1), ("mouseMoved", 0.2), ("mouseReleased", 0.2)]:
        browser.mouse(kind, x, y - mm * px_per_mm)
    browser.wait_for("!grabbed && Math.abs(live.last('setpoint_m') - 2.6) < 0.02")  # a tenth of a millimetre is some px
    browser.wait_for("Math.abs(Number($('grip').textContent) - 2.6) < 0.02")


def test_in_the_browser_steps_and_sines_end_with_stop_and_with_any_other_command(browser, stand):
    browser.value("$('generator').open = true")

    def begin(form, amplitude, period):
        browser.value(
            f"$('wave').value = {form!r}; $('amplitude').value = {amplitude!r}; $('period').value = {period!r}"
        )
        browser.click("#generate")

    said = "document.querySelector('#said li').textContent"
    _enabled_by_hand(browser, stand)
    _sent_by_hand(browser, 2.2)
    begin("steps", "5", "2")
    browser.wait_for(f"{said}.startsWith('not started: ±5 mm around 2.2')")
    assert browser.value("wave === null")
    begin("steps", "0.1", "1")
    for goal in (2.3, 2.1, 2.3):
        browser.wait_for(f"Math.abs(live.last('setpoint_m') - {goal}) < 1e-3")
    browser.wait_for("/^error over the last [01].[0-9] s: mean 0/.test($('error').textContent)")
    _sent_by_hand(browser, 2.4)
    assert browser.value("wave === null")
    begin("sine", "0.2", "2")
    browser.wait_for("live.last('setpoint_m') > 2.5")
    browser.wait_for("live.last('setpoint_m') < 2.3")
    browser.click("#stop")
    assert browser.value("wave === null")
    assert _seconds_to_no_current(stand) < SOON_s
    browser.wait_for("$('mode').textContent === 'off'")
    begin("sine", "0.2", "2")
    browser.wait_for(f"{said} === 'not started: enable the wire first'")
    browser.value("$('generator').open = false")


def test_in_the_browser_a_refused_gain_shows_the_nodes_sentence_and_its_value_again(browser, stand):
    browser.wait_for("document.querySelector('[name=\"controller.kd\"]')")
    field = "document.querySelector('[name=\"controller.kd\"]')"
    before = browser.value(f"{field}.value")
    browser.value(f"{field}.value = 'much'; {field}.dispatchEvent(new Event('change'))")
    answer = f"{field}.parentElement.querySelector('.answer').textContent"
    browser.wait_for(answer)
    assert "controller.kd: 'much' is not a number" in browser.value(answer)
    assert browser.value(f"{field}.value") == before


def test_in_the_browser_stop_is_seen_at_the_supply_within_half_a_second(browser, stand):
    took_s = []
    for _ in range(3):
        _enabled_by_hand(browser, stand)
        browser.value("window.scrollTo(0, document.body.scrollHeight)")  # it is there wherever the page is
        browser.click("#stop")
        took_s.append(_seconds_to_no_current(stand))
        if took_s[-1] < STOP_s:
            break
    assert min(took_s) < STOP_s


def test_in_the_browser_the_space_bar_stops_wherever_the_cursor_stands(browser, stand):
    _enabled_by_hand(browser, stand)
    browser.value("document.querySelector('#enable').focus()")  # of which a blank would be a press
    for kind in ("keyDown", "keyUp"):
        browser.command(
            "Input.dispatchKeyEvent", type=kind, code="Space", key=" ", text=" " if kind == "keyDown" else ""
        )
    assert _seconds_to_no_current(stand) < SOON_s
    browser.wait_for("document.querySelector('#mode').textContent === 'off'")
    browser.wait_for("document.querySelector('#said li').textContent.includes('the output is off')")


def test_in_the_browser_gains_are_saved_to_the_parameter_file(browser, stand):
    before = Config.load(stand.file).controller.kp
    field = "document.querySelector('[name=\"controller.kp\"]')"
    browser.wait_for(f"{field} && !document.querySelector('#save').disabled")
    browser.value(f"{field}.value = '640'; {field}.dispatchEvent(new Event('change'))")
    browser.wait_for("document.querySelector('#said li').textContent === 'controller.kp is 640'")
    browser.click("#save")
    browser.wait_for("document.querySelector('#said li').textContent.startsWith('saved to')")
    assert Config.load(stand.file).controller.kp == 640.0
    assert f"# Saved from the page; before: kp {before:g}" in stand.file.read_text()
    stand.parameters["controller"]["kp"] = 640.0  # for who starts the node again


@pytest.mark.parametrize(("width", "height", "mobile"), [(1366, 640, False), (390, 700, True)], ids=["laptop", "phone"])
def test_in_the_browser_commands_and_plot_are_seen_at_once(browser, width, height, mobile):
    """A window of 1366 × 768, less what a browser puts around it; and a phone."""
    size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": mobile}
    browser.command("Emulation.setDeviceMetricsOverride", **size)
    try:
        browser.value("scrollTo(0, 0)")
        browser.wait_for(f"innerWidth === {width}")  # and nothing is wider, or a phone would show it smaller
        for part in (
            "#stop",
            "#enable",
            "#setpoint",
            "#setpoint-send",
            "#said",
            "#position-plot canvas",
            "#heat-plot canvas",
        ):
            browser.wait_for(
                f"(() => {{ const r = document.querySelector('{part}').getBoundingClientRect(); "
                "return r.height > 0 && r.top >= 0 && r.bottom <= innerHeight && r.right <= innerWidth; })()"
            )
    finally:
        browser.command("Emulation.clearDeviceMetricsOverride")


#: Of everything that a person sees: what is beyond the window, or beyond what holds it and shows no more.
_CUT_OFF = """(() => {
  const cut = [], wide = document.documentElement.clientWidth;
  for (const e of document.querySelectorAll('body *')) {
    const r = e.getBoundingClientRect();
    if (!r.width || e.closest('.u-wrap')) continue;
    const hidden = getComputedStyle(e).overflowX !== 'visible' && e.scrollWidth > e.clientWidth + 1;
    const cut_off = r.right > wide + 1 || r.left < -1 || hidden;
    if (cut_off) cut.push(`${e.tagName}#${e.id}.${e.className} ${r.left}…${r.right}`);
  }
  for (const u of document.querySelectorAll('.u-wrap')) {
    if (u.getBoundingClientRect().right > wide + 1) cut.push('a plot');
  }
  return innerWidth === WIDTH ? cut.join('; ') : 'wider than the window';
})()"""


def test_in_the_browser_nothing_is_cut_off_at_any_width(browser):
    browser.value("for (const d of document.querySelectorAll('details')) d.open = true")
    try:
        for width in (360, 390, 480, 600, 768, 959, 961, 1024, 1366, 1920, 2560):
            size = {"width": width, "height": 700, "deviceScaleFactor": 1, "mobile": width < 800}
            browser.command("Emulation.setDeviceMetricsOverride", **size)
            browser.wait_for(f"{_CUT_OFF.replace('WIDTH', str(width))} === ''")
    finally:
        browser.command("Emulation.clearDeviceMetricsOverride")
        browser.value("for (const d of document.querySelectorAll('details')) d.open = false")


def test_in_the_browser_it_is_dark_where_the_system_is(browser):
    def light(of):
        """How bright a colour is, of 255."""
        return browser.value(
            f"(() => {{ const g = document.createElement('canvas').getContext('2d'); g.fillStyle = {of}; g.fillRect(0, "
            f"0, 1, 1); "
            "const [r, b, c] = g.getImageData(0, 0, 1, 1).data; return (r + b + c) / 3; })()"
        )

    for scheme in ("dark", "light"):
        browser.command("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
        paper, ink = (light(f"getComputedStyle($('command')).{each}") for each in ("backgroundColor", "color"))
        assert (paper < 60 and ink > 200) if scheme == "dark" else (paper > 200 and ink < 60)
        browser.wait_for("theme.ink === getComputedStyle(document.documentElement).getPropertyValue('--ink')")


def test_in_the_browser_the_last_two_minutes_are_downloaded(browser, tmp_path):
    browser.command("Browser.setDownloadBehavior", behavior="allow", downloadPath=str(tmp_path))
    browser.click("#record")
    browser.wait_for("document.querySelector('#said li').textContent.includes('check-log')")
    wait_until(lambda: any(tmp_path.glob("*.csv")), what="the file")
    (path,) = tmp_path.glob("*.csv")
    log = read_bench_log(path, allow_gaps=True)
    assert len(log) > 20


def test_in_the_browser_a_file_that_is_no_log_is_answered_in_sight(browser):
    browser.value(
        "(() => { const d = new DataTransfer(); d.items.add(new File(['nothing'], 'nothing.csv')); "
        "document.querySelector('#drop').dispatchEvent(new DragEvent('drop', {dataTransfer: d, bubbles: true})); })()"
    )
    browser.wait_for("/nothing.csv/.test($('said').textContent) || !$('log').hidden")
    browser.wait_for(
        "[...document.querySelectorAll('#said li'), $('log')].some((e) => /no |not |nothing/.test(e.textContent) && "
        "e.getBoundingClientRect().top < innerHeight)"
    )


def test_in_the_browser_a_log_that_is_dropped_is_drawn(browser, log):
    text = log[0].read_text()
    browser.value(
        f"(() => {{ const d = new DataTransfer(); d.items.add(new File([{text!r}], 'pulses.csv')); "
        "document.querySelector('#drop').dispatchEvent(new DragEvent('drop', {dataTransfer: d, bubbles: true})); })()"
    )
    browser.wait_for("document.querySelector('#log-words').textContent.includes('mean absolute error')")
    browser.wait_for("document.querySelector('#point').textContent.startsWith('orange: measured')")
    browser.click("#log-close")
    browser.wait_for("document.querySelector('#log').hidden")


# Last: it kills the node.
def test_a_node_that_was_killed_is_found_again(stand, request):
    browser = request.getfixturevalue("browser") if find_chromium() else None
    not_there = "document.querySelector('#status').textContent.includes('not there')"

    async def work(page):
        await page.until(lambda: page.told.get("state", {}).get("present"))
        stand.kill_node()
        await page.until(lambda: not page.told["state"]["present"])
        refused = await page.ask("enable")
        assert not refused["ok"]
        assert NAME in refused["sentence"]
        if browser:
            await asyncio.to_thread(browser.wait_for, not_there)
            await asyncio.to_thread(browser.wait_for, "Number(getComputedStyle($('values')).opacity) < 0.5")
        stand.start_node()
        page.rows.clear()
        await page.enabled()
        if browser:
            await asyncio.to_thread(browser.wait_for, f"!{not_there}")
            await asyncio.to_thread(wait_until, browser.point, what="the point")
        assert (await page.ask("stop"))["ok"]

    with_page(stand, work)
