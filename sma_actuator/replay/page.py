"""The page of a replay: errors, curves, loops."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from sma_actuator.config import Config
from sma_actuator.report import Page, figure

from .replaying import Replay, winners


def write_page(path: Path, replays: Sequence[Replay], config: Config) -> None:
    """Write the HTML page."""
    page = Page("Replay")
    low_m, high_m = config.model.build(config.wire).displacement_range_m
    page.text(
        f"Working range {low_m * 1e3:.2f} to {high_m * 1e3:.2f} mm; 100 % is {config.wire.full_stroke_m * 1e3:.2f} mm."
    )
    names = list(replays[0].errors)
    for title, value in (("working range", "working_percent"), ("full range", "full_percent")):
        page.heading(f"Mean absolute error, {title} [% of full stroke]")
        page.table(
            ("log", "share judged", *names),
            [
                (r.experiment.name, r.errors[names[0]].working_share, *(getattr(r.errors[n], value) for n in names))
                for r in replays
            ],
        )
    if len(names) > 1:
        best = [(log, " or ".join(working) or "–", " or ".join(full) or "–") for log, working, full in winners(replays)]
        page.table(("log", "best in the working range", "best in the full range"), best)
    for r in replays:
        page.heading(r.experiment.name)
        drawing, axes = figure(2, width_in=6.0, height_in=4.0)
        time_s, measured_mm = r.experiment.signals.time_s, r.experiment.displacement_m * 1e3
        axes[0, 0].plot(time_s, measured_mm, "k", lw=1, label="measured")
        axes[0, 1].plot(r.experiment.resistance_Ohm, measured_mm, "k", lw=0.8)
        for name in names:
            axes[0, 0].plot(time_s, r.estimates_m[name] * 1e3, lw=0.8, label=name)
            axes[0, 1].plot(r.experiment.resistance_Ohm, r.estimates_m[name] * 1e3, lw=0.7)
        axes[0, 0].set(xlabel="time [s]", ylabel="displacement [mm]")
        axes[0, 1].set(xlabel="resistance [Ω]", ylabel="displacement [mm]")
        axes[0, 0].legend(fontsize=6)
        page.figure(drawing, "Displacement over time, and over resistance.")
    page.write(path)
