"""One HTML page with pictures in it, for every tool that reports: no files beside it, no network.

A page begins with one sentence, the verdict, and one picture.  A picture of lines may hold their data (``zoom``): a
reader with a browser can then look into it.
"""

from __future__ import annotations

import base64
import io
import json
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from sma_actuator.base.parameters import ConfigError
from sma_actuator.logs.files import write_atomically

try:
    import jinja2
    import markupsafe
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.colors import to_hex
    from matplotlib.figure import Figure
    from matplotlib.image import imsave
except ModuleNotFoundError as error:
    raise ConfigError(f"the page with pictures needs the Python package '{error.name}' (extra 'report')") from error

__all__ = ["Page", "figure"]

_DPI = 110
_MOST_POINTS = 5000  #: of a line that can be looked into
_WORDS = 18  #: characters from which a cell is read as text and not as a number


def figure(columns: int = 1, rows: int = 1, width_in: float = 5.0, height_in: float = 3.6, **options: Any):
    """A matplotlib figure and its axes, sized for the page."""
    size_in = width_in * columns, height_in * rows
    drawing = Figure(figsize=size_in, dpi=_DPI, layout="constrained")
    return drawing, drawing.subplots(rows, columns, squeeze=False, **options)


class Page:
    """Collects headings, text, tables and figures in order, then writes them."""

    def __init__(self, title: str, verdict: str):
        """``verdict``: what a reader should know who reads one sentence; the first part must be a picture of it."""
        self.title, self.verdict = title, verdict
        self.parts: list[dict[str, Any]] = []

    def heading(self, text: str) -> None:
        """Begin a section."""
        self.parts.append({"kind": "heading", "text": text})

    def text(self, text: str) -> None:
        """A paragraph of plain text."""
        self.parts.append({"kind": "text", "text": text})

    def lines(self, lines: Sequence[str]) -> None:
        """Short lines of plain text, one below the other."""
        self.parts.append({"kind": "list", "lines": lines})

    def table(self, header: Sequence[str], rows: Sequence[Sequence[Any]], caption: str = "") -> None:
        """A table; floats are shown with four digits, what is not finite as a dash."""
        shown = [[_cell(cell) for cell in row] for row in rows]
        self.parts.append({"kind": "table", "header": header, "rows": shown, "caption": caption})

    def figure(self, drawing: Figure, caption: str = "", zoom: bool = False) -> None:
        """Embed a matplotlib figure as PNG; with ``zoom`` its lines can be looked into."""
        for ax in drawing.axes:
            ax.set_visible(ax.has_data())  # a grid may have more places than pictures
        # savefig would draw it twice: once for the layout alone.
        canvas, stream = FigureCanvasAgg(drawing), io.BytesIO()
        canvas.draw()
        imsave(stream, canvas.buffer_rgba(), format="png", dpi=_DPI)
        data = base64.b64encode(stream.getvalue()).decode()
        self.parts.append({"kind": "figure", "data": data, "caption": caption, "zoom": zoom and _lines_of(drawing)})

    def write(self, path: str | Path) -> None:
        """Write the page; it appears whole or not at all."""
        kinds = [part["kind"] for part in self.parts]
        if "figure" in kinds[1:] and kinds[0] != "figure":
            raise ValueError("a page begins with a picture, after its verdict")
        here = resources.files(__package__)
        template = jinja2.Environment(autoescape=True).from_string(here.joinpath("page.html").read_text("utf-8"))
        html = template.render(
            title=self.title,
            verdict=self.verdict,
            parts=[{**part, "zoom": _in_a_script(part.get("zoom"))} for part in _filled(self.parts)],
            zooms=any(part.get("zoom") for part in self.parts),
            script=_safe(here.joinpath("zoom.js").read_text("utf-8")),
        )
        write_atomically(path, lambda stream: stream.write(html.encode("utf-8")))


def _filled(parts: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """The parts without lists of nothing, and without headings of nothing."""
    kept: list[dict[str, Any]] = []
    for part in reversed([part for part in parts if part.get("lines") != []]):
        if part["kind"] != "heading" or (kept and kept[-1]["kind"] != "heading"):
            kept.append(part)
    return kept[::-1]


def _cell(value: Any) -> tuple[str, bool]:
    """What is shown, and whether it is words."""
    if isinstance(value, float | np.floating):
        return (f"{value:.4g}" if np.isfinite(value) else "–"), False
    text = str(value)
    return text, len(text) >= _WORDS


def _safe(script: str) -> Any:
    return markupsafe.Markup(script)


def _in_a_script(data: Any) -> Any:
    """JSON that cannot end the element it stands in."""
    return _safe(json.dumps(data, separators=(",", ":")).replace("<", "\\u003c")) if data else ""


def _lines_of(drawing: Figure) -> dict[str, Any]:
    """The lines of every panel, their numbers as 32-bit floats in base64, each array once."""
    arrays: dict[bytes, int] = {}

    def number_of(values: np.ndarray) -> int:
        return arrays.setdefault(np.asarray(values, dtype="<f4").tobytes(), len(arrays))

    panels, columns = [], 1
    for ax in drawing.axes:
        if not ax.get_visible():
            continue
        lines = []
        for line in ax.get_lines():
            x, y = (np.asarray(v, dtype=float) for v in line.get_data())
            if line.get_transform() != ax.transData or not len(x):
                continue  # a mark across the panel
            few = slice(None, None, -(-len(x) // _MOST_POINTS))
            name = str(line.get_label())
            lines.append(
                {
                    "x": number_of(x[few]),
                    "y": number_of(y[few]),
                    "label": "" if name.startswith("_") else name,
                    "color": to_hex(line.get_color()),
                    "width": float(max(line.get_linewidth(), 0.8)),
                    "dashed": line.get_linestyle() == "--",
                    "joined": line.get_linestyle() not in ("None", ""),
                    "dots": line.get_marker() not in ("None", "", None),
                }
            )
        place: Any = ax.get_subplotspec()
        columns = place.get_gridspec().ncols
        panels.append(
            {
                "row": place.rowspan.start,
                "column": place.colspan.start,
                "title": ax.get_title(),
                "x": ax.get_xlabel(),
                "y": ax.get_ylabel(),
                "lines": lines,
                "view": {"x": [*map(float, ax.get_xlim())], "y": [*map(float, ax.get_ylim())]},
            }
        )
    return {"columns": columns, "panels": panels, "arrays": [base64.b64encode(a).decode() for a in arrays]}
