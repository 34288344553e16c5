"""The page that every report is: one file, a verdict and a picture first, pictures that can be looked into."""

import base64
import json
import re
import shutil
import subprocess
from importlib import resources

import numpy as np
import pytest

from sma_actuator.report import Page, figure


def zoomable(values):
    drawing, axes = figure(2)
    axes[0, 0].plot(np.arange(len(values)), values, label="a < b", color="tab:red")
    axes[0, 1].plot([0, 1], [2, 3], "k.")
    axes[0, 0].set(title="one", xlabel="time [s]", ylim=(-2, 2))
    return drawing


@pytest.fixture
def page(tmp_path):
    page = Page("Title", "It is so.")
    page.figure(zoomable(np.sin(np.arange(20_000) / 500.0)), "Look at it.", zoom=True)
    page.table(("log", "error [%]"), [("a", float("nan")), ("b", 1.23456)])
    page.write(tmp_path / "page.html")
    return (tmp_path / "page.html").read_text()


def data_of(page):
    return json.loads(re.search(r'<script type="application/json">(.*?)</script>', page, re.DOTALL)[1])


def test_it_is_one_file_that_begins_with_a_verdict_and_a_picture(page):
    assert not re.search(r"""(src|href)=["'](?!data:)""", page) and "@import" not in page and "fetch(" not in page
    assert page.index("It is so.") < page.index("<img") < page.index("<table")
    assert "<td>–</td>" in page and "<td>1.235</td>" in page


def test_a_page_that_does_not_begin_with_its_picture_is_refused(tmp_path):
    page = Page("Title", "It is so.")
    page.heading("Much to read first")
    page.figure(zoomable(np.zeros(3)))
    with pytest.raises(ValueError, match="begins with a picture"):
        page.write(tmp_path / "page.html")
    assert not (tmp_path / "page.html").exists()


def test_the_picture_holds_its_lines_thinned_to_what_a_screen_shows(page):
    data = data_of(page)
    first, second = data["panels"]
    assert (first["title"], first["x"], first["view"]["y"]) == ("one", "time [s]", [-2.0, 2.0])
    (line,) = first["lines"]
    assert line["label"] == "a < b" and line["joined"] and not line["dots"] and second["lines"][0]["dots"]
    x, y = (np.frombuffer(base64.b64decode(data["arrays"][line[axis]]), "<f4") for axis in "xy")
    assert 2000 < len(x) <= 5000
    np.testing.assert_allclose(y, np.sin(x / 500.0), atol=1e-3)


DRIVE = """
const {numbers, ticks, zoomed, scale, draw} = require(process.argv[2]);
const data = JSON.parse(require("fs").readFileSync(process.argv[3], "utf8")), panel = data.panels[0];
for (const line of panel.lines) for (const axis of ["x", "y"]) line[axis] = numbers(data.arrays[line[axis]]);
const said = [], points = [];
const context = new Proxy({}, { get: (_, name) => name in context_ ? context_[name] : () => {}, set: () => true });
const context_ = { fillText: text => said.push(text), lineTo: (x, y) => points.push([x, y]) };
const view = { x: zoomed(panel.view.x, 1000, 0.01), y: panel.view.y }, s = scale(view, 600, 340);
draw(context, panel, view, 600, 340, null);
console.log(JSON.stringify({ said, back: s.x(s.px(1234.5)), view, ticks: ticks(0, 1, 5).at, points: points.length }));
"""


@pytest.mark.skipif(shutil.which("node") is None, reason="wants node to run the page's script")
def test_zooming_shows_a_part_of_the_data_with_its_own_numbers(page, tmp_path):
    script = tmp_path / "zoom.js"
    script.write_text(resources.files("sma_actuator.report").joinpath("zoom.js").read_text())
    (tmp_path / "data.json").write_text(json.dumps(data_of(page)))
    (tmp_path / "drive.js").write_text(DRIVE)
    words = ["node", str(tmp_path / "drive.js"), str(script), str(tmp_path / "data.json")]
    done = subprocess.run(words, capture_output=True, text=True, timeout=150)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    low, high = found["view"]["x"]
    assert high - low == pytest.approx(0.01 * 1.1 * 19_999, rel=0.01) and low < 1000 < high
    assert {"one", "time [s]", "a < b", "1000"} <= set(found["said"]) and found["points"] > 1000
    assert found["back"] == pytest.approx(1234.5) and found["ticks"] == pytest.approx([0, 0.2, 0.4, 0.6, 0.8, 1.0])


def test_no_heading_stands_over_nothing(tmp_path):
    page = Page("Title", "It is so.")
    page.heading("over nothing")
    page.heading("over an empty list")
    page.lines([])
    page.heading("over words")
    page.text("Words.")
    page.heading("last, over nothing")
    page.write(tmp_path / "page.html")
    assert re.findall("<h2>(.*?)</h2>", (tmp_path / "page.html").read_text()) == ["over words"]
