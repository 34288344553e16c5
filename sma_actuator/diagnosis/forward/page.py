"""The page of a forward model: measured against modelled, the race, and what gives the winner away."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sma_actuator.report import Page, figure

from .fitting import ForwardFit, predict
from .kernel import TEMPERATURE, simulate
from .race import ForwardTracing
from .report import observations, percent, power_off_index, verdict_sentence

_SHOWN = 30  #: competitors


def write_page(path: Path, found: ForwardTracing) -> None:
    """Write the HTML page."""
    page = Page("Forward model: power in, displacement out", verdict_sentence(found))
    _traces(page, found)
    _what_to_do(page, found)
    _errors(page, found)
    _also(page, found)
    _power_off(page, found)
    _race(page, found)
    _telltale(page, found)
    _values(page, found)
    page.write(path)


def _what_to_do(page: Page, found: ForwardTracing) -> None:
    if not found.named:
        return
    page.heading("What it means, and what to do")
    page.table(
        ("effect", "what is the matter", "where", "how much", "what to do"),
        [
            (
                c.name,
                c.sentence,
                c.part,
                ", ".join(
                    f"{f.name.partition('.')[2].rpartition('_')[0].replace('_', ' ')} "
                    f"{found.fitted.wire.value(f.name):.3g} {f.unit}".strip()
                    for f in c.free
                ),
                c.remedy,
            )
            for c in found.named
        ],
    )


def _also(page: Page, found: ForwardTracing) -> None:
    """The rest of what was found, a line each."""
    page.heading("What else the runs say")
    page.lines(observations(found))


def _errors(page: Page, found: ForwardTracing) -> None:
    page.heading("Errors on unseen runs")
    rows = []
    for i, (run, j) in enumerate(zip(found.judged, found.by_run, strict=True)):
        before, after = found.before_m[i], found.after_m[i]
        rows.append(
            (
                run.name,
                1e3 * found.heats_m("mean")[i],
                1e3 * found.heats_m("rms")[i],
                1e3 * found.rigid_m[i],
                1e3 * after,
                percent(run, before),
                percent(run, after),
                " + ".join(j.choice.winner.names) or "none",
            )
        )
    page.table(
        (
            "judged on",
            "mean voltage [mm]",
            "RMS voltage [mm]",
            "without thermal expansion [mm]",
            "chosen effects [mm]",
            "before [%]",
            "after [%]",
            "chosen without this run",
        ),
        rows,
        "RMS on runs on which nothing was chosen or fitted, in mm and in % of the stroke.",
    )
    choice = found.choice
    if choice.winner.names:
        page.table(
            ("left out", "plain [mm]", f"{' + '.join(choice.winner.names)} [mm]"),
            [
                (r.name, 1e3 * b, 1e3 * a)
                for r, b, a in zip(choice.runs, choice.plain.held_out_m, choice.winner.held_out_m, strict=True)
            ],
            "For comparison: the leave-one-out errors on which this choice was made. They always fall, and are not the "
            "result.",
        )


def _pairs(found: ForwardTracing) -> list[tuple]:
    """(run, plain fit, fit with the chosen effects) for every judged run, each chosen and fitted without it."""
    return [(run, j.choice.fitted_plain, j.choice.fitted) for j in found.judgements for run in j.judged]


def _traces(page: Page, found: ForwardTracing) -> None:
    pairs = _pairs(found)
    drawing, axes = figure(2, len(pairs), width_in=6.0, height_in=2.6)
    for row, (run, plain, full) in zip(axes, pairs, strict=True):
        t, measured = run.coarse_time_s, run.coarse_position_m
        row[0].plot(t, 1e3 * measured, "k", lw=1.2, label="measured")
        for fit, color, label in ((plain, "C0", "plain"), (full, "C1", "with the effects chosen")):
            modelled = predict(fit.wire, run)
            row[0].plot(t, 1e3 * modelled, color, lw=0.9, label=label)
            row[1].plot(t, 1e3 * (measured - modelled), color, lw=0.9, label=label)
        row[1].axhline(0.0, color="0.7", lw=0.8)
        row[0].set(title=run.name, ylabel="position [mm]", xlabel="time [s]")
        row[1].set(title=f"{run.name}: residual", ylabel="measured − modelled [mm]", xlabel="time [s]")
    axes[0, 0].legend(fontsize=7)
    page.figure(
        drawing,
        "Each run as the model chosen and fitted without it gives it; right, what is left over time.",
        zoom=True,
    )


def _power_off(page: Page, found: ForwardTracing) -> None:
    pairs = [(p, off) for p in _pairs(found) if (off := power_off_index(p[0])) is not None]
    if not pairs:
        return
    page.heading("After power off")
    drawing, axes = figure(len(pairs), width_in=5.5)
    for ax, ((run, plain, full), off) in zip(axes[0], pairs, strict=True):
        part = slice(max(off - int(2.0 / run.step_s), 0), off + int(10.0 / run.step_s))
        t = run.coarse_time_s[part]
        ax.plot(t, 1e3 * run.coarse_position_m[part], "k", label="measured")
        rigid = {"wire.martensite_expansion_1_K": 0.0, "wire.austenite_expansion_1_K": 0.0}
        for wire, style, label in (
            (plain.wire, "C0", "plain"),
            (full.wire, "C1", "with the effects chosen"),
            (full.wire.with_values(rigid), "C1--", "the same, no thermal expansion"),
        ):
            ax.plot(t, 1e3 * predict(wire, run)[part], style, label=label)
        ax.axvline(run.coarse_time_s[off], color="0.7", lw=0.8)
        ax.set(title=run.name, xlabel="time [s]", ylabel="position [mm]")
        ax.legend(fontsize=7)
    page.figure(
        drawing, "The hot wire cools, and shrinks before it transforms; the kinetics alone would hold still.", zoom=True
    )


def _race(page: Page, found: ForwardTracing) -> None:
    page.heading("The race of candidates")
    entries = found.choice.entries[:_SHOWN]
    drawing, axes = figure(1, width_in=9.0, height_in=max(2.0, 0.24 * len(entries)))
    ax = axes[0, 0]
    ax.barh(
        [" + ".join(e.names) for e in entries][::-1],
        [e.ratio for e in entries][::-1],
        color=["C2" if e.earns else "0.7" for e in entries][::-1],
    )
    ax.axvline(1.0, color="k", lw=0.8)
    ax.set(xlim=(0.0, 1.5), xlabel="leave-one-out error over that of the plain model")
    page.figure(drawing, f"The choice on {', '.join(r.name for r in found.choice.runs)}: green earns its parameters.")
    page.table(
        ("candidate", "ratio", *(f"{run.name} [mm]" for run in found.choice.runs), "verdict"),
        [
            (" + ".join(e.names), e.ratio, *(1e3 * v for v in e.held_out_m), e.verdict or "earns its parameters")
            for e in entries
        ],
        f"The best {len(entries)} of {len(found.choice.entries)}.",
    )


def _telltale(page: Page, found: ForwardTracing) -> None:
    """Measured position over modelled temperature: where friction, spread and shoulders show."""
    page.heading("What gives it away")
    for c in found.named:
        page.text(f"{c.name}: {c.signature}.")
    pairs = _pairs(found)
    drawing, axes = figure(2, -(-len(pairs) // 2), width_in=5.5, height_in=3.2)
    for ax, (run, plain, full) in zip(axes.flat, pairs, strict=False):
        temperature_C = _temperature(full, run)
        ax.plot(temperature_C, 1e3 * run.coarse_position_m, "k.", ms=2, label="measured")
        ax.plot(_temperature(plain, run), 1e3 * predict(plain.wire, run), "C0", lw=0.9, label="plain")
        ax.plot(temperature_C, 1e3 * predict(full.wire, run), "C1", lw=0.9, label="with the effects chosen")
        ax.set(title=run.name, xlabel="modelled mean temperature [°C]", ylabel="position [mm]")
    axes[0, 0].legend(fontsize=7)
    page.figure(
        drawing,
        "Position over the wire's modelled temperature (measured points placed by the model with the named effects).",
        zoom=True,
    )


def _temperature(fit: ForwardFit, run) -> np.ndarray:
    return simulate(fit.wire, run.coarse_duty, run.step_s)[:, TEMPERATURE]


def _values(page: Page, found: ForwardTracing) -> None:
    page.heading("Fitted values")
    plain = dict(zip([f.name for f in found.choice.fitted_plain.free], found.choice.fitted_plain.values, strict=True))
    rows = []
    for f, value in zip(found.fitted.free, found.fitted.values, strict=True):
        before = f"{plain[f.name]:.4g}" if f.name in plain else ""
        rows.append(
            (
                f.name.rpartition(".")[2].replace("_", " "),
                f.unit,
                before,
                f"{value:.4g}",
                f"{f.lo:.4g} to {f.hi:.4g}",
                "at its bound" if f.at_bound(value) else "",
            )
        )
    page.table(
        ("value", "unit", "plain", "with the named effects", "bounds", ""), rows, "Fitted on all the runs given to fit."
    )
