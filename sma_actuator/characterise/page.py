"""The calibration page: every point, the line through them, and what is left over (Figs. 118, 119)."""

from __future__ import annotations

from pathlib import Path

from sma_actuator.report import Page, figure

from .manifest import Manifest

_LINES = {
    "load_cell": ("Load cell (appendix A)", "voltage [V]", "load [N]"),
    "lvdt": ("LVDT (appendix B)", "current [A]", "displacement [m]"),
}


def write_page(folder: Path, manifest: Manifest) -> None:
    """Write ``calibration.html`` into the folder of logs."""
    page = Page("Characterisation of a wire")
    wire = manifest.data["wire"]
    page.text(f"{wire['alloy']}, {wire['length_m'] * 1e3:g} mm × {wire['diameter_m'] * 1e3:g} mm")
    for name, (title, x_label, y_label) in _LINES.items():
        if name not in manifest.data["parts"]:
            continue
        line = manifest.data["parts"][name]["results"]
        drawing, axes = figure(2)
        axes[0, 0].plot(line["x"], line["y"], "o")
        axes[0, 0].axline((line["x"][0], line["slope"] * line["x"][0] + line["offset"]), slope=line["slope"], lw=1)
        axes[0, 1].stem(line["x"], line["residuals"])
        axes[0, 0].set(xlabel=x_label, ylabel=y_label)
        axes[0, 1].set(xlabel=x_label, ylabel=f"residual of {y_label}")
        page.heading(title)
        page.text(f"slope {line['slope']:.6g}, offset {line['offset']:.6g}, correlation {line['correlation']:.7f}")
        page.figure(drawing, "points, fitted line and residuals")
    page.heading("Parts")
    rows = [
        (n, p["kind"], ", ".join(f"{k} {v:.5g}" for k, v in p["results"].items() if isinstance(v, float)))
        for n, p in manifest.data["parts"].items()
    ]
    page.table(("part", "kind", "result"), rows)
    page.write(Path(folder) / "calibration.html")
