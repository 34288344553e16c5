"""The page of a replay: errors, curves, loops."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from sma_actuator.config import Config
from sma_actuator.report import Page, figure

from .replaying import Replay, verdict, winners

_TOGETHER = 2  #: models that share a picture; more have one each
_ACROSS = 3  #: pictures beside each other


def write_page(path: Path, replays: Sequence[Replay], config: Config) -> None:
    """Write the HTML page."""
    page = Page("Replay", verdict(replays, config)[1])
    names = list(replays[0].errors)
    if len(names) > 1:
        _bars(page, replays, names)
    else:
        worst = max(replays, key=lambda r: np.nan_to_num(r.errors[names[0]].full_percent))
        _together(page, worst, names, f"{worst.experiment.name}, the log with the largest error.")
    low_m, high_m = config.model.build(config.wire).displacement_range_m
    page.heading("Errors")
    page.text(
        f"Mean absolute errors in % of the full stroke of {config.wire.full_stroke_m * 1e3:.2f} mm; the working range "
        f"goes from {low_m * 1e3:.2f} to {high_m * 1e3:.2f} mm."
    )
    if len(names) == 1:
        page.table(
            ("log", "load [N]", "working range [%]", "samples in it", "full range [%]"),
            [
                (e.name, e.load_N, e.working_percent, f"{e.working_share:.0%}", e.full_percent)
                for e in (r.errors[names[0]] for r in replays)
            ],
        )
    else:
        _compared(page, replays, names)
    for r in replays:
        page.heading(r.experiment.name)
        if len(names) > _TOGETHER:
            _apart(page, r, names)
        else:
            _together(page, r, names, "Displacement over time, and over resistance.")
    page.write(path)


def _means(replays: Sequence[Replay], name: str, which: str) -> tuple[float, float]:
    """Mean and largest error of a model over the logs that judge it."""
    values = np.array([getattr(r.errors[name], which) for r in replays])
    known = values[np.isfinite(values)]
    return (float(known.mean()), float(known.max())) if len(known) else (float("nan"), float("nan"))


def _bars(page: Page, replays: Sequence[Replay], names: Sequence[str]) -> None:
    drawing, axes = figure(1, width_in=9.0, height_in=0.8 + 0.5 * len(names))
    ax, places = axes[0, 0], np.arange(len(names))[::-1]
    for which, label, up, colour in (
        ("working_percent", "working range", 0.2, "tab:blue"),
        ("full_percent", "full range", -0.2, "tab:gray"),
    ):
        bars = ax.barh(places + up, [_means(replays, n, which)[0] for n in names], 0.38, label=label, color=colour)
        ax.bar_label(bars, fmt="%.2f", padding=3, fontsize=8)
    ax.margins(x=0.12)
    ax.set(yticks=places, yticklabels=names, xlabel="mean absolute error [% of full stroke], mean over the logs")
    ax.legend()
    page.figure(drawing, "Every model's error; shorter is better.")


def _compared(page: Page, replays: Sequence[Replay], names: Sequence[str]) -> None:
    page.table(
        ("model", "working range: mean [%]", "worst log [%]", "full range: mean [%]", "worst log [%]"),
        [(n, *_means(replays, n, "working_percent"), *_means(replays, n, "full_percent")) for n in names],
    )
    page.table(
        ("log", "samples in the working range", "best there", "best in the full range"),
        [
            (r.experiment.name, f"{r.errors[names[0]].working_share:.0%}", " or ".join(w) or "–", " or ".join(f) or "–")
            for r, (_, w, f) in zip(replays, winners(replays), strict=True)
        ],
        "Those as good as the best are all named.",
    )


def _together(page: Page, r: Replay, names: Sequence[str], caption: str) -> None:
    drawing, axes = figure(2, width_in=6.0, height_in=4.0)
    time_s, measured_mm = r.experiment.signals.time_s, r.experiment.displacement_m * 1e3
    axes[0, 0].plot(time_s, measured_mm, "k", lw=1, label="measured")
    axes[0, 1].plot(r.experiment.resistance_Ohm, measured_mm, "k", lw=0.8)
    for name in names:
        axes[0, 0].plot(time_s, r.estimates_m[name] * 1e3, lw=0.8, label=name)
        axes[0, 1].plot(r.experiment.resistance_Ohm, r.estimates_m[name] * 1e3, lw=0.7)
    axes[0, 0].set(xlabel="time [s]", ylabel="displacement [mm]")
    axes[0, 1].set(xlabel="resistance [Ω]", ylabel="displacement [mm]")
    axes[0, 0].legend(fontsize=8)
    page.figure(drawing, caption, zoom=True)


def _apart(page: Page, r: Replay, names: Sequence[str]) -> None:
    """A small picture for every model, all with the same axes."""
    rows = -(-len(names) // _ACROSS)
    measured_mm = r.experiment.displacement_m * 1e3
    seen_mm = measured_mm if np.isfinite(measured_mm).any() else r.estimates_m[names[0]] * 1e3
    low, high = np.nanmin(seen_mm), np.nanmax(seen_mm)
    margin = 0.15 * (high - low)  # what a bad model makes of it may lie far away
    for what, x in (("time [s]", r.experiment.signals.time_s), ("resistance [Ω]", r.experiment.resistance_Ohm)):
        drawing, axes = figure(_ACROSS, rows, width_in=3.6, height_in=2.3, sharex=True, sharey=True)
        for i, (ax, name) in enumerate(zip(axes.flat, names, strict=False)):
            ax.plot(x, measured_mm, "k", lw=0.8, label="measured")
            ax.plot(x, r.estimates_m[name] * 1e3, "tab:red", lw=0.7, label="model")
            ax.set_title(f"{name}: {r.errors[name].full_percent:.2f} %", fontsize=9)
            ax.set(ylim=(low - margin, high + margin))
            if i % _ACROSS == 0:
                ax.set_ylabel("displacement [mm]")
            if i >= len(names) - _ACROSS:
                ax.set_xlabel(what)
                ax.tick_params(labelbottom=True)
        axes[0, 0].legend(fontsize=7)
        page.figure(
            drawing,
            f"Displacement over {what.split(' [')[0]}; beside each name its error over the full range.",
            zoom=True,
        )
