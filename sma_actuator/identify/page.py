"""The page of an identification."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np

from sma_actuator.base.parameters import Declaration, declaration_of
from sma_actuator.estimation.chain import Chain
from sma_actuator.logs.kinds import PARTIAL
from sma_actuator.report import Page, figure

from .fatigue import EXTREMES
from .fitters.fitting import predict
from .identification import Identification
from .ranges import full_cycles
from .verdict import REGIONS


def write_page(path: Path, result: Identification) -> None:
    """Write the HTML page."""
    wire, model = result.config.wire, result.config.model.build(result.config.wire)
    first, *others = [f"{sentence[:1].upper()}{sentence[1:]}." for sentence in result.verdict.sentences]
    page = Page(f"Identification: {result.mapping['model']['type']}", first)
    if hasattr(model, "limits_m"):
        _loops(page, result, model)
    else:
        _transitions(page, result, model)
    page.lines(others)
    low_m, high_m = model.displacement_range_m
    stress_lo, stress_hi = model.stress_range_Pa
    page.text(
        f"Wire {wire.alloy}, {wire.words}. Working range "
        f"{low_m * 1e3:.2f} to {high_m * 1e3:.2f} mm, "
        f"stress {stress_lo / 1e6:.0f} to {stress_hi / 1e6:.0f} MPa."
    )
    for note in filter(None, (result.chosen or result.beside, *result.notes)):
        page.text(f"Note: {note}.")
    page.heading("Errors")
    page.table(
        ("log", "load [N]", "working range [%]", "share of samples in it", "full range [%]"),
        [(e.name, e.load_N, e.working_percent, f"{e.working_share:.0%}", e.full_percent) for e in result.errors],
        f"Mean absolute error in % of the full stroke of {wire.full_stroke_m * 1e3:.3g} mm, on the logs that were "
        f"fitted.",
    )
    page.table(
        ("load [N]", *(f"{name} [%]" for name in REGIONS)),
        [
            ("all" if np.isnan(row["load_N"]) else row["load_N"], *(row.get(name, float("nan")) for name in REGIONS))
            for row in (*result.verdict.loads, {"load_N": float("nan"), **result.verdict.regions})
        ],
        f"The same, on {result.verdict.left_out} left out of the fit: what the verdict judges.",
    )
    _coefficients(page, result)
    if hasattr(model, "limits_m"):
        page.heading("Transition curves")
        _transitions(page, result, model)
    _orders(page, result)
    _experiments(page, result)
    _fatigue(page, result)
    page.write(path)


def _loops(page: Page, result: Identification, model) -> None:
    drawing, axes = figure(2, width_in=5.5, height_in=4.2)
    for ax, heating in zip(axes[0], (True, False), strict=True):
        for experiment in full_cycles(result.experiments):
            resistance_Ohm = np.linspace(experiment.resistance_Ohm.min(), experiment.resistance_Ohm.max(), 60)
            curve_m = model.limits_m(resistance_Ohm, np.full(60, experiment.mean_stress_Pa))[0 if heating else 1]
            branch = experiment.driven == heating
            (line,) = ax.plot(experiment.resistance_Ohm[branch], experiment.displacement_m[branch] * 1e3, ".", ms=2)
            ax.plot(
                resistance_Ohm,
                curve_m * 1e3,
                lw=1,
                color=line.get_color(),
                label=f"{np.mean(experiment.signals.load_N):.3g} N",
            )
        ax.set(title="heating" if heating else "cooling", xlabel="resistance [Ω]", ylabel="displacement [mm]")
        low_mm = 1e3 * min(float(t.displacement_m.min()) for t in result.experiments)
        high_mm = 1e3 * max(float(t.displacement_m.max()) for t in result.experiments)
        ax.set_ylim(low_mm - 0.05 * (high_mm - low_mm), high_mm + 0.05 * (high_mm - low_mm))
    axes[0, 0].legend(fontsize=7)
    page.figure(drawing, "Full cycles at every load (dots) and the model's curves (lines).", zoom=True)


def _stresses_Pa(result: Identification) -> np.ndarray:
    """The range of stresses that the coefficients rest on."""
    lo_Pa, hi_Pa = result.mapping["model"]["stress_range"]
    return np.linspace(lo_Pa, hi_Pa, 50)


def _declared(result: Identification) -> dict[str, Declaration]:
    """What the model's section says of its coefficients."""
    section: Any = result.config.model
    return {f.name: declaration_of(f) for f in dataclasses.fields(section)}


def _label(result: Identification, name: str) -> str:
    """A coefficient with its unit."""
    return f"{name.replace('_', ' ')} [{_declared(result)[name].unit}]"


def _coefficients(page: Page, result: Identification) -> None:
    page.heading("Coefficients against stress")
    names = [n for n, v in result.mapping["model"].items() if isinstance(v, list) and n in result.intervals]
    if names:
        columns = 3 if len(names) > 4 else 2
        drawing, axes = figure(columns, -(-len(names) // columns), width_in=3.8, height_in=2.8)
        stress_Pa = _stresses_Pa(result)
        lines = getattr(result.fit, "lines", ())
        for ax, name in zip(axes.flat, names, strict=False):
            ax.plot(stress_Pa / 1e6, np.polynomial.polynomial.polyval(stress_Pa, result.mapping["model"][name]))
            if lines:
                branch, which = name.split("_")
                values = [getattr(line, branch)[0 if which == "slope" else 1] for line in lines]
                ax.plot([line.stress_Pa / 1e6 for line in lines], values, "o")
            ax.set(title=_label(result, name), xlabel="stress [MPa]")
        page.figure(drawing, "Every coefficient as a polynomial in stress.")
    rows = []
    declared = _declared(result)
    for name, intervals in result.intervals.items():
        value = result.mapping["model"].get(name)
        for i, (low, high) in enumerate(intervals):
            named = f"{name.replace('_', ' ')} ({declared[name].description.split(',')[0]})"
            unit = declared[name].unit + (f"/Pa{'' if i == 1 else '²³'[i - 2]}" if i else "")
            rows.append((named, i, f"{np.atleast_1d(value)[i]:.6g}", f"{low:.6g}", f"{high:.6g}", unit))
    if rows:
        page.table(
            ("coefficient", "power of the stress", "value", "low", "high", "unit"),
            rows,
            "95 % intervals, bootstrap over cycles.",
        )
    _material(page, result)


def _material(page: Page, result: Identification) -> None:
    """Fitted slopes beside those from material properties."""
    if result.mapping["model"]["type"] != "flexinol":
        return
    from .fitters.material import RPhaseAlloy, asymptotes_from_material

    wire, model = result.config.wire, result.config.model
    stress_Pa, unit_Ohm = _stresses_Pa(result), wire.resistance_Ohm(1.0)
    from_material = np.array(
        [np.ravel(asymptotes_from_material(RPhaseAlloy(), wire.strain_length_m, unit_Ohm, s)) for s in stress_Pa]
    )
    drawing, axes = figure(4, width_in=3.2, height_in=2.8)
    for i, (ax, name) in enumerate(
        zip(axes[0], ("heating_slope", "heating_intercept", "cooling_slope", "cooling_intercept"), strict=True)
    ):
        ax.plot(stress_Pa / 1e6, np.polynomial.polynomial.polyval(stress_Pa, getattr(model, name)), label="identified")
        ax.plot(stress_Pa / 1e6, from_material[:, i], "--", label="material properties")
        ax.set(title=_label(result, name), xlabel="stress [MPa]")
    axes[0, 0].legend(fontsize=7)
    page.figure(drawing, "Asymptotes as identified, and as material properties would have them.")


def _transitions(page: Page, result: Identification, model) -> None:
    partial = [t for t in result.experiments if t.kind == PARTIAL] or list(result.experiments)
    experiment = partial[len(partial) // 2]
    drawing, axes = figure(1, width_in=7, height_in=4.5)
    axes[0, 0].plot(experiment.resistance_Ohm, experiment.displacement_m * 1e3, lw=0.8, label="measured")
    axes[0, 0].plot(experiment.resistance_Ohm, predict(model, [experiment]) * 1e3, lw=0.8, label="model")
    axes[0, 0].set(xlabel="resistance [Ω]", ylabel="displacement [mm]")
    axes[0, 0].legend()
    page.figure(drawing, f"Minor loops of {experiment.name}.", zoom=True)


def _orders(page: Page, result: Identification) -> None:
    errors = getattr(result.fit, "order_errors", {})
    if not errors:
        return
    page.heading("Error against polynomial order")
    drawing, axes = figure(1, width_in=6)
    labels = [str(order) for order in errors]
    means = [100 * e.mean() for e in errors.values()]
    axes[0, 0].errorbar(labels, means, [100 * e.std() / np.sqrt(len(e)) for e in errors.values()], fmt="o-", capsize=3)
    axes[0, 0].set(xlabel="order in stress (heating, cooling)", ylabel="held-out error [% of full stroke]")
    page.figure(
        drawing,
        "Mean absolute error on cycles that were not fitted; the simplest order as good as the best is used.",
    )


def _experiments(page: Page, result: Identification) -> None:
    page.heading("Replay")
    shown = result.experiments[:: max(1, len(result.experiments) // 6)]
    drawing, axes = figure(2, -(-len(shown) // 2), width_in=5.5, height_in=2.6)
    for ax, experiment in zip(axes.flat, shown, strict=False):
        ax.plot(experiment.signals.time_s, experiment.displacement_m * 1e3, lw=0.9, label="measured")
        estimate_m = Chain(result.config).run(experiment.signals).displacement_m
        ax.plot(experiment.signals.time_s, estimate_m * 1e3, lw=0.9, label="estimated")
        ax.set(title=experiment.name, xlabel="time [s]", ylabel="displacement [mm]")
    axes[0, 0].legend(fontsize=7)
    page.figure(drawing, "Displacement measured and estimated.", zoom=True)


def _fatigue(page: Page, result: Identification) -> None:
    if result.fatigue is None:
        return
    page.heading("Fatigue")
    drawing, axes = figure(2, 2, width_in=4.5, height_in=2.8)
    for ax, (name, drift) in zip(axes.flat, result.fatigue.drift.items(), strict=True):
        ax.semilogx(result.fatigue.cycle, result.fatigue.extremes[name], ".")
        ax.semilogx(result.fatigue.cycle, drift.g1 * np.log(result.fatigue.cycle) + drift.g2)
        ax.set(title=EXTREMES[name], xlabel="cycle")
    page.figure(drawing, "Extremes of every cycle and y = g₁ ln N + g₂.")
    page.table(
        ("quantity", "g₁", "g₂", "g₁ low", "g₁ high"),
        [(EXTREMES[n], d.g1, d.g2, *d.g1_interval) for n, d in result.fatigue.drift.items()],
        "In the unit of the quantity.",
    )
