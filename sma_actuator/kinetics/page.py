"""The page of isobaric loops: strain over temperature, transformation temperatures over stress, errors."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from sma_actuator.plant.kinetics import Measured
from sma_actuator.report import Page, figure

from .fitting import Comparison, both
from .reading import Loop
from .temperatures import SHARES, Temperatures, slopes_Pa_K


def write_page(
    path: Path, loops: Sequence[Loop], found: Sequence[Temperatures], compared: Sequence[Comparison]
) -> None:
    """Write the HTML page."""
    best = min(compared, key=lambda c: float(np.mean([both(e) for e in c.seen])))
    page = Page("Isobaric loops: strain against temperature", _verdict(found, best))
    _drawn(page, loops, best)
    _read_off(page, loops, found)
    _slopes(page, found)
    _errors(page, loops, compared)
    for c in compared:
        page.heading(c.all.family)
        if c is not best:
            _drawn(page, loops, c)
        _kinetics(page, c)
    page.write(path)


def _verdict(found: Sequence[Temperatures], best: Comparison) -> str:
    """What the loops say, in one sentence."""
    strokes = [100.0 * t.stroke for t in found]
    low, high = min(t.stress_Pa for t in found) / 1e6, max(t.stress_Pa for t in found) / 1e6
    lags = [t.hysteresis_K for t in found]
    span = f"between {low:.0f} and {high:.0f} MPa" if high > low else f"at {low:.0f} MPa"
    return (
        f"{_span(strokes, '.2f')} % of strain and {_span(lags, '.1f')} K of hysteresis {span}; the {best.all.family} "
        f"kinetics fit to {100 * float(np.mean([both(e) for e in best.seen])):.2f} % of the stroke."
    )


def _span(values: Sequence[float], how: str) -> str:
    low, high = format(min(values), how), format(max(values), how)
    return low if low == high else f"{low} to {high}"


def _read_off(page: Page, loops: Sequence[Loop], found: Sequence[Temperatures]) -> None:
    page.heading("Read off the loops")
    header = ["loop", "stress [MPa]", "stroke [%]"]
    header += [f"{direction} {100 * share:.0f} % [°C]" for direction in ("heating", "cooling") for share in SHARES]
    header += ["width heating [K]", "width cooling [K]", "hysteresis [K]"]
    header += [f"{name} [°C]" for name in ("A_s", "A_f", "M_s", "M_f")]
    rows = [
        (
            loop.name,
            t.stress_Pa / 1e6,
            100.0 * t.stroke,
            *t.heating_C,
            *t.cooling_C,
            *t.widths_K,
            t.hysteresis_K,
            t.austenite_start_C,
            t.austenite_finish_C,
            t.martensite_start_C,
            t.martensite_finish_C,
        )
        for loop, t in zip(loops, found, strict=True)
    ]
    page.table(
        header,
        rows,
        "Shares of the stroke that are martensite; starts and finishes where the steepest tangent meets the ends.",
    )


def _slopes(page: Page, found: Sequence[Temperatures]) -> None:
    slopes = slopes_Pa_K(found)
    if not slopes:
        page.text("One stress alone does not tell a Clausius-Clapeyron slope.")
        return
    drawing, axes = figure(2)
    stress_MPa = np.array([t.stress_Pa for t in found]) / 1e6
    for ax, direction in zip(axes[0], ("heating", "cooling"), strict=True):
        for i, share in enumerate(SHARES):
            at_C = np.array([getattr(t, f"{direction}_C")[i] for t in found])
            label = f"{100 * share:.0f} %: {slopes[direction][i] / 1e6:.1f} MPa/K"
            ax.plot(at_C, stress_MPa, "o", label=label, color=f"C{i}")
            ax.plot(np.polyval(np.polyfit(stress_MPa, at_C, 1), stress_MPa), stress_MPa, color=f"C{i}", lw=0.8)
        ax.set(xlabel="temperature [°C]", ylabel="stress [MPa]", title=direction)
        ax.legend(fontsize=7)
    page.figure(drawing, "Clausius-Clapeyron: where so much of the stroke is martensite.")


def _errors(page: Page, loops: Sequence[Loop], compared: Sequence[Comparison]) -> None:
    page.heading("Kinetics, fitted to all stresses jointly")
    header = ["loop"]
    for c in compared:
        header += [f"{c.all.family} [%]"] + [f"{c.all.family}, left out [%]"] * bool(c.left_out)
    rows = []
    for i, loop in enumerate(loops):
        row: list[object] = [loop.name]
        for c in compared:
            row += [100.0 * both(c.seen[i])] + ([100.0 * both(c.left_out[i])] if c.left_out else [])
        rows.append(row)
    page.table(
        header,
        rows,
        "RMS in % of the loop's stroke, mean of heating and cooling; left out: after a fit to the other stresses.",
    )


def _drawn(page: Page, loops: Sequence[Loop], c: Comparison) -> None:
    columns = min(len(loops), 3)
    drawing, axes = figure(columns, -(-len(loops) // columns), width_in=4.5)
    for ax, loop in zip(axes.flat, loops, strict=False):
        ax.plot(loop.temperature_C, 100.0 * loop.strain, "k.", ms=2, label="measured")
        modelled = 100.0 * c.all.strain(loop)
        for branch, colour in zip(loop.branches, ("C3", "C0"), strict=True):
            ax.plot(loop.temperature_C[branch], modelled[branch], colour, lw=1)
        ax.set(
            xlabel="temperature [°C]", ylabel="strain [%]", title=f"{loop.name}, {loop.mean_stress_Pa / 1e6:.0f} MPa"
        )
    page.figure(
        drawing, f"Measured (dots), and the {c.all.family} kinetics on heating (red) and cooling (blue).", zoom=True
    )


def _kinetics(page: Page, c: Comparison) -> None:
    kinetics = c.all.kinetics
    if isinstance(kinetics, Measured):
        page.table(
            ("direction", "weight", "centre at zero stress [°C]", "width [K]", "slope [MPa/K]"),
            [
                (direction, p.weight, p.centre_C, p.width_K, p.slope_Pa_K / 1e6)
                for direction, parts in (("heating", kinetics.heating), ("cooling", kinetics.cooling))
                for p in parts
            ],
            "The distribution of transformation temperatures, a sum of logistics.",
        )
