"""The layouts for PlotJuggler and Foxglove name signals that there are."""

import json
import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

from sma_actuator.actuator import Actuator
from sma_actuator.base.signals import Reading
from sma_actuator.ros.named_signals import named_signals

LAYOUTS = Path(__file__).resolve().parents[2] / "layouts"


def signals(config):
    reading = Reading(
        time_s=1.0, supply_voltage_V=0.3, reference_voltage_V=0.05, load_cell_voltage_V=0.05, lvdt_current_A=0.01
    )
    return set(named_signals(Actuator(config).step(1.0, reading, None)))


def test_plotjuggler(config):
    root = ElementTree.parse(LAYOUTS / "plotjuggler.xml").getroot()
    curves = root.findall(".//curve")
    drawn = [curve.get(key) for curve in curves for key in ("name", "curve_x", "curve_y")]
    names = {
        match[1] for name in drawn if name and (match := re.fullmatch("/sma_actuator/signals/(.+)/position", name))
    }
    assert len(names) > 10
    assert names <= signals(config)
    assert len(root.findall(".//DockArea")) == len(root.findall(".//plot"))
    for splitter in root.findall(".//DockSplitter"):
        assert int(splitter.get("count")) == len(splitter) == len(splitter.get("sizes").split(";"))


def test_foxglove(config):
    layout = json.loads((LAYOUTS / "foxglove.json").read_text())
    (script,) = layout["userNodes"].values()
    named = set(re.findall(r'named\("(\w+)"\)', script["sourceCode"]))
    assert named <= signals(config)
    output = re.search('output = "(.+)"', script["sourceCode"])[1]
    plots = [panel for name, panel in layout["configById"].items() if name.startswith("Plot!")]
    paths = [path["value"] for plot in plots for path in plot["paths"]]
    paths += [plot["xAxisPath"]["value"] for plot in plots if "xAxisPath" in plot]
    assert {path.partition(".")[0] for path in paths} == {output}
    assert {path.partition(".")[2] for path in paths} <= named

    def places(part):
        return [part] if isinstance(part, str) else places(part["first"]) + places(part["second"])

    assert sorted(places(layout["layout"])) == sorted(layout["configById"])
