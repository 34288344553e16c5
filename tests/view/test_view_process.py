"""The process that serves the page: a port that another has, and its end."""

import asyncio
import contextlib
import signal
import subprocess
import sys
import time
from types import SimpleNamespace

import pytest

pytest.importorskip("aiohttp", reason="aiohttp is not installed (extra 'view')")
pytest.importorskip("rclpy", reason="ROS 2 is not installed (extra 'ros')")

from sma_actuator.view.command import END_s
from sma_actuator.view.watched import WatchedNode

VIEW = (sys.executable, "-m", "sma_actuator", "view", "--quiet", "--port")


@pytest.mark.parametrize(
    "number", [signal.SIGTERM, pytest.param(signal.SIGINT, marks=pytest.mark.long)], ids=lambda number: number.name
)
def test_a_port_in_use_is_said_and_a_signal_ends_it(number):
    with subprocess.Popen([*VIEW, "0"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as view:
        try:
            port = view.stdout.readline().partition("/#token")[0].rpartition(":")[2]
            second = subprocess.run([*VIEW, port], capture_output=True, text=True, timeout=60, check=False)
            assert second.returncode == 1 and f"port {port} is in use on 127.0.0.1" in second.stderr
            assert "Traceback" not in second.stderr and not second.stdout
            view.send_signal(number)
            began_s = time.monotonic()
            assert view.wait(60.0) == 0
            assert time.monotonic() - began_s < END_s
        finally:
            view.kill()
        assert not view.stderr.read()


def test_a_cancellation_that_comes_with_an_answer_of_ros_is_not_lost():
    """Lost, the task that watches the node goes on, and the process that waits for its end never ends."""

    async def run():
        wire, loop = WatchedNode.__new__(WatchedNode), asyncio.get_running_loop()

        def answer_and_cancel(work):
            work()
            loop.call_soon(task.cancel)

        wire._tasks = SimpleNamespace(put=answer_and_cancel)
        task = asyncio.create_task(wire._in_ros(lambda: "answer"))
        with contextlib.suppress(asyncio.CancelledError):
            await task
        assert task.cancelled()

    asyncio.run(run())


def test_what_does_not_end_is_ended():
    code = (
        "import asyncio, contextlib\n"
        "from sma_actuator.cli.main import main\n"
        "from sma_actuator.view import command, server\n"
        "async def watch(desk):\n"
        "    while True:\n"
        "        with contextlib.suppress(asyncio.CancelledError):\n"
        "            await asyncio.sleep(60.0)\n"
        "server.Desk.watch, command.END_s = watch, 0.5\n"
        "main(['view', '--quiet', '--port', '0'])\n"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as view:
        try:
            view.stdout.readline()
            view.terminate()
            assert view.wait(60.0) == 1
        finally:
            view.kill()
        assert b"Timeout" in view.stderr.read()
