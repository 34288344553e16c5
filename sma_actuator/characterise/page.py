"""The calibration page: every point, the line through them, and what is left over."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sma_actuator.report import Page, figure

from .manifest import Manifest

_LINES = {
    "load_cell": ("Load cell", "voltage [V]", "load [N]"),
    "lvdt": ("LVDT", "current [A]", "displacement [m]"),
}


def write_page(folder: Path, manifest: Manifest) -> None:
    """Write ``calibration.html`` into the folder of logs."""
    wire, parts = manifest.data["wire"], manifest.data["parts"]
    form = f", {wire['form']}" if "form" in wire else ""
    page = Page(
        "Characterisation of a wire",
        f"{len(parts)} part{'s' * (len(parts) != 1)} measured on a {wire['alloy']} wire of {wire['length_m'] * 1e3:g} "
        f"mm × {wire['diameter_m'] * 1e3:g} mm{form}{_correlations(parts)}.",
    )
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
        x_unit, y_unit = (label[label.index("[") + 1 : -1] for label in (x_label, y_label))
        page.figure(
            drawing,
            f"{title}: points, fitted line and residuals; slope {line['slope']:.6g} {y_unit}/{x_unit}, offset "
            f"{line['offset']:.6g} {y_unit}, correlation {line['correlation']:.7f}.",
        )
    if "training" in parts:
        _training(page, parts["training"]["results"])
    page.heading("Parts")
    rows = [
        (n, p["kind"], ", ".join(f"{k} {v:.5g}" for k, v in p["results"].items() if isinstance(v, float)))
        for n, p in manifest.data["parts"].items()
    ]
    page.table(("part", "kind", "result"), rows)
    page.write(Path(folder) / "calibration.html")


def _training(page: Page, results: Mapping[str, Any]) -> None:
    """The ends of the wire in its first cycles, each from where it was first."""
    drawing, axes = figure(1)
    for name, ends_m in (("hot", results["hot_m"]), ("cold", results["cold_m"])):
        axes[0, 0].plot([1e3 * (end_m - ends_m[0]) for end_m in ends_m], ".-", label=f"{name} end")
    axes[0, 0].set(xlabel="cycle", ylabel="moved [mm]")
    axes[0, 0].legend()
    left = f"; at most {1e3 * results['left_m']:.3g} mm are left" if "left_m" in results else ""
    page.figure(drawing, f"Training: where the ends of the wire went, cycle by cycle{left}.")


def _correlations(parts) -> str:
    found = [
        f"{title} {parts[name]['results']['correlation']:.5f}"
        for name, (title, _, _) in _LINES.items()
        if name in parts
    ]
    return f"; correlation of the calibrations: {', '.join(found)}" if found else ""
