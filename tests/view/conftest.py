"""A bench, a node and the page of the node, each in a process of its own."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("aiohttp", reason="aiohttp is not installed (extra 'view')")
pytest.importorskip("rclpy", reason="ROS 2 is not installed (extra 'ros')")

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "ros"))

from processes import Bench, Client, NodeProcess, parameter_file, wait_until

from sma_actuator.config import read_parameter_file

ROOT = Path(__file__).resolve().parents[2]


class Stand:
    """All there is to look at: a wire on a bench, its node, and the process that serves the page."""

    def __init__(self, folder):
        self.folder = folder
        self.bench = Bench(folder, "--load", "weight:0.98")
        self.parameters = read_parameter_file(ROOT / "config" / "flexinol.yaml")
        # A machine that is busy with other things may stop a process for tenths of a second.
        self.parameters |= {"instruments": self.bench.instruments(), "loop": {"overruns_to_fault": 100}}
        self.parameters["safety"]["reading_timeout"] = self.parameters["supply"]["watchdog_timeout"] = 3.0
        for instrument in ("supply", "daq"):
            self.parameters["instruments"][instrument]["timeout"] = 1.4
        self.start_node()
        self.log = folder / "view.log"
        with self.log.open("wb") as log:
            view = ["view", "--quiet", "--port", "0", "--config", str(self.file)]
            self.view = subprocess.Popen([sys.executable, "-m", "sma_actuator", *view], stdout=log, stderr=log)
        wait_until(lambda: "token=" in self.words and self.words.endswith("\n"), what="the address of the page")
        # Fast DDS says in the same file what it finds of other processes.
        self.address = next(word for word in self.words.split() if "token=" in word)
        self.url, _, self.token = self.address.partition("/#token=")

    @property
    def words(self):
        return self.log.read_text()

    def start_node(self):
        self.file = parameter_file(self.folder, {"sma_actuator": self.parameters})
        self.node = NodeProcess(["--ros-args", "--params-file", str(self.file)], self.folder)

    def kill_node(self):
        self.node.popen.kill()
        self.node.popen.wait()

    def close(self):
        self.view.terminate()
        assert self.view.wait(20.0) == 0, self.words
        self.node.close()
        self.bench.close()


@pytest.fixture(scope="module")
def stand(tmp_path_factory):
    stand = Stand(tmp_path_factory.mktemp("view"))
    yield stand
    stand.close()


@pytest.fixture
def client():
    client = Client()
    yield client
    client.close()
