"""One HTML page with pictures in it, for every tool that reports: no files beside it, no network."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any

from sma_actuator.base.parameters import ConfigError
from sma_actuator.logs.files import write_atomically

try:
    import jinja2
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib.figure import Figure
except ModuleNotFoundError as error:
    raise ConfigError(f"the page with pictures needs the Python package '{error.name}' (extra 'report')") from error

__all__ = ["Page", "figure"]


def figure(columns: int = 1, rows: int = 1, width_in: float = 5.0, height_in: float = 3.6, **options: Any):
    """A matplotlib figure and its axes, sized for the page."""
    drawing = Figure(figsize=(width_in * columns, height_in * rows), layout="constrained")
    return drawing, drawing.subplots(rows, columns, squeeze=False, **options)


@dataclass
class Page:
    """Collects headings, text, tables and figures in order, then writes them."""

    title: str
    parts: list[dict[str, Any]] = field(default_factory=list)

    def heading(self, text: str) -> None:
        """Begin a section."""
        self.parts.append({"kind": "heading", "text": text})

    def text(self, text: str) -> None:
        """A paragraph of plain text."""
        self.parts.append({"kind": "text", "text": text})

    def table(self, header: Sequence[str], rows: Sequence[Sequence[Any]], caption: str = "") -> None:
        """A table; floats are shown with four digits."""
        shown = [[f"{cell:.4g}" if isinstance(cell, float) else str(cell) for cell in row] for row in rows]
        self.parts.append({"kind": "table", "header": header, "rows": shown, "caption": caption})

    def figure(self, drawing: Figure, caption: str = "") -> None:
        """Embed a matplotlib figure as PNG."""
        for ax in drawing.axes:
            ax.set_visible(ax.has_data())  # a grid may have more places than pictures
        stream = io.BytesIO()
        drawing.savefig(stream, format="png", dpi=110)
        data = base64.b64encode(stream.getvalue()).decode()
        self.parts.append({"kind": "figure", "data": data, "caption": caption})

    def write(self, path: str | Path) -> None:
        """Write the page; it appears whole or not at all."""
        template = jinja2.Environment(autoescape=True).from_string(
            resources.files(__package__).joinpath("page.html").read_text(encoding="utf-8")
        )
        html = template.render(title=self.title, parts=self.parts)
        write_atomically(path, lambda stream: stream.write(html.encode("utf-8")))
