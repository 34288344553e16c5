"""The report as one page with pictures."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sma_actuator.estimation.effects import EFFECTS, QUANTITIES
from sma_actuator.report import Page, figure

from .evidence import Comparison
from .experiments import NOTHING_TELLS
from .isolability import size_in_words, tells_in_words
from .quantities import quantities
from .report import LEAST_SAID, explained
from .tracing import Tracing

REFUSED_SHOWN = 8  #: rows of the table of candidates
_MM = 1e3
_MOST_POINTS = 6000
BEFORE, AFTER = {"color": "tab:red", "label": "before"}, {"color": "tab:blue", "label": "after"}


def write_page(path: Path, tracing: Tracing, report: dict[str, Any], explain: Sequence[str] = ()) -> None:
    """Write the page, whole or not at all; ``explain``: names of which it says in a picture what speaks for and
    against."""
    page = Page("What the model lacks", report["sentence"])
    _residual(page, tracing)
    _what_to_do(page, report)
    _numbers(page, report)
    _probable(page, report)
    _loop(page, tracing)
    _why(page, report)
    _for_and_against(page, explained(report, explain))
    if tracing.fit is not None:
        _tell_tale(page, tracing, tracing.fit.names)
    _rests(page, tracing, report)
    _dependence(page, report)
    _the_rest(page, report)
    page.write(path)


def write_isolability(path: Path, report: dict[str, Any]) -> None:
    """Write the page of what some logs would show; ``report``: of :func:`.isolability.as_numbers`."""
    effects, best = report["effects"], report["experiments"][0]
    alike = [e for e in effects if e["not_told_from"]]
    said = "; ".join(f"{_words([e['name']])} from {_words(e['not_told_from'])}" for e in alike)
    page = Page(
        "What these logs would show",
        f"Not told apart, whatever the size: {said}."
        if said
        else "Every effect can be told from every other, if it is large enough.",
    )
    names = [e["name"] for e in effects]
    times = np.array([[_times(e, name) for name in names] for e in effects])
    drawing, axes = figure(1, 1, width_in=9.0, height_in=8.0)
    ax = axes[0, 0]
    picture = ax.imshow(np.log10(times), cmap="viridis_r", vmin=0.0, vmax=2.0)
    ax.set_xticks(range(len(names)), [_words([n]) for n in names], rotation=90)
    ax.set_yticks(range(len(names)), [_words([n]) for n in names])
    ax.set(xlabel="told from", ylabel="effect")
    drawing.colorbar(picture, ax=ax, label="log10 of the size from which it is told, over that from which it shows")
    page.figure(
        drawing, "How much larger an effect must be to be told from another than to be seen. White: no size would do."
    )
    page.table(
        ("effect", "shows from", "told from all others from", "last from", "cannot be told from"),
        [
            (
                _words([e["name"]]),
                size_in_words(e, e["seen_from"]),
                size_in_words(e, e["told_from_all"]),
                _words([e["told_last_from"]]),
                ", ".join(_words([n]) for n in e["not_told_from"]),
            )
            for e in effects
        ],
        caption="For a probability of 90 %, of logs like these and what the calibration repeated.",
    )
    page.heading("The experiment that would tell most")
    page.table(
        ("experiment", "takes", "bits more", "what it gives"),
        [
            (t["what"], f"{t['duration_s']:.0f} s", f"{t['adds_bits']:.2f}", tells_in_words(t))
            for t in report["experiments"]
        ],
        caption=f"Of an effect that is just large enough to be seen; {report['most_bits']:.1f} bits say which it is, "
        f"{report['known_bits']:.2f} are known from these logs. {best['what'].capitalize()} comes first.",
    )
    if report["untestable"]:
        page.heading("What these logs could not show")
        page.table(("effect", "why"), [(_words([u["name"]]), u["reason"]) for u in report["untestable"]])
    page.write(path)


def _times(effect: dict[str, Any], name: str) -> float:
    """How much larger than to be seen an effect must be to be told from another."""
    if name == effect["name"]:
        return 1.0
    told, seen = effect["told_from"][name], effect["seen_from"]
    return max(told / seen, 1.0) if told and seen else np.nan


def _words(names: Sequence[str]) -> str:
    """Effects as a person reads them."""
    return " + ".join(name.replace("_", " ") for name in names)


def _what_to_do(page: Page, report: dict[str, Any]) -> None:
    if not report["effects"]:
        return
    page.heading("What it means, and what to do")
    page.table(
        ("effect", "probability", "what is the matter", "where", "what to do"),
        [
            (_words([e["name"]]), f"{e['probability']:.0%}", e["what"], e["part"], e["remedy"])
            for e in report["effects"]
        ],
    )


def _numbers(page: Page, report: dict[str, Any]) -> None:
    page.heading("How much it was, and how sure that is")
    before, after = report["error_before_interval"], report["error_after_interval"]
    page.table(
        ("mean absolute error, % of full stroke", "before", "after"),
        [
            ("cycles that the fit had not seen", report["error_before_pct_stroke"], report["error_after_pct_stroke"]),
            ("95 % interval over cycles", f"{before[0]:.3f} – {before[1]:.3f}", f"{after[0]:.3f} – {after[1]:.3f}"),
            (
                "sensors' noise carried through the model",
                *(report[f"residual_{w}"]["sensor_noise_pct_stroke"] for w in ("before", "after")),
            ),
            (
                "share that repeats every cycle",
                *(report[f"residual_{w}"]["share_repeating_every_cycle"] for w in ("before", "after")),
            ),
            ("beyond what is expected", report["unexpected_before_pct_stroke"], report["unexpected_after_pct_stroke"]),
            ("of which so much is usual", report["floor_pct_stroke"], report["floor_pct_stroke"]),
        ],
    )
    rows = [
        (
            _words([e["name"]]),
            p["what"],
            p["value"],
            f"{p['interval'][0]:.4g} … {p['interval'][1]:.4g}",
            p["unit"],
            f"{e['share']:.0%}",
        )
        for e in report["effects"]
        for name, p in e["parameters"].items()
    ]
    if rows:
        page.table(
            (
                "effect",
                "parameter",
                "value",
                "95 % interval",
                "unit",
                "share of the excess",
            ),
            rows,
        )


def _probable(page: Page, report: dict[str, Any]) -> None:
    likely = [one for one in report["probabilities"] if one["probability"] >= LEAST_SAID]
    page.heading("How probable each is")
    drawing, axes = figure(1, 1, width_in=8.0, height_in=0.8 + 0.4 * len(likely))
    ax = axes[0, 0]
    given = report["verdict"] == "none" or {*likely[0]["hypothesis"]} <= {*report["names"]}
    for number, one in enumerate(reversed(likely)):
        color = "tab:green" if given else "tab:orange"
        ax.barh(_words(one["hypothesis"]), one["probability"], color=color if one is likely[0] else "0.7")
        ax.text(one["probability"], number, f" {one['probability']:.0%}", va="center")
    ax.set(xlabel="probability", xlim=(0.0, 1.1))
    caption = "green: given" if given else "orange: the most probable, and not given, or not all of it"
    page.figure(drawing, f"Of all that may have happened, by what the logs say; {caption}.")


def _both(tracing: Tracing) -> list[tuple[Comparison, dict[str, str]]]:
    """The model before and after, with how each is drawn."""
    return [(tracing.before.comparison, BEFORE), (tracing.after.comparison, AFTER)]


def _some(n: int) -> slice:
    return slice(None, None, max(1, n // _MOST_POINTS))


def _residual(page: Page, tracing: Tracing) -> None:
    drawing, axes = figure(1, 1, width_in=10.0)
    ax, evidence = axes[0, 0], tracing.evidence
    offset_s, one_session = 0.0, len(evidence.logs.sessions) == 1
    for i, experiment in enumerate(evidence.logs.experiments):
        time_s = experiment.signals.time_s - (
            evidence.logs.start_s if one_session else experiment.signals.time_s[0] - offset_s
        )
        offset_s = float(time_s[-1]) * 1.02
        few = _some(len(time_s))
        for one, style in _both(tracing):
            error_m = evidence.logs.measured_m[i] - one.predictions[i].shown_m
            label = style["label"] if i == 0 else None
            ax.plot(time_s[few], error_m[few] * _MM, lw=0.7, color=style["color"], label=label)
    ax.set(xlabel="time [s]" + ("" if one_session else ", log after log"), ylabel="measured − estimated [mm]")
    ax.legend()
    page.figure(drawing, "What the model leaves over time, before and after what was found.", zoom=True)


def _loop(page: Page, tracing: Tracing) -> None:
    page.heading("Resistance and displacement")
    evidence, (drawing, axes) = tracing.evidence, figure(2, 1)
    worst = int(
        np.argmax(
            [
                np.mean(np.abs(m - p.shown_m))
                for m, p in zip(evidence.logs.measured_m, tracing.before.comparison.predictions, strict=True)
            ]
        )
    )
    experiment = evidence.logs.experiments[worst]
    few = _some(len(experiment.log))
    for ax, (one, style) in zip(axes[0], _both(tracing), strict=True):
        p = one.predictions[worst]
        ax.plot(experiment.resistance_Ohm[few], p.shown_m[few] * _MM, lw=0.8, color=style["color"], label="model")
        ax.plot(
            experiment.resistance_Ohm[few],
            evidence.logs.measured_m[worst][few] * _MM,
            lw=0.4,
            color="black",
            label="measured",
        )
        ax.set(xlabel="measured resistance [Ω]", ylabel="displacement [mm]", title=style["label"])
        ax.legend()
    page.figure(drawing, f"The log with the largest error, {experiment.name}.", zoom=True)


def _why(page: Page, report: dict[str, Any]) -> None:
    """Of every candidate why it was given, or was not."""
    rows = [row for row in report["candidates"] if row["nats"] is not None]
    page.heading("Why this, and nothing else")
    page.table(
        ("hypothesis", "nats beside the most probable", "answer", "why"),
        [(_words(row["effects"]), f"{row['nats']:.1f}", row["answer"], row["reason"]) for row in rows[:REFUSED_SHOWN]],
        caption="report.json has them all, under candidates; trace --explain NAME … draws what speaks for and against "
        "a name.",
    )


def _for_and_against(page: Page, rows: Sequence[dict[str, Any]]) -> None:
    """By witness and by stretch of the logs, what each of some names takes off."""
    if rows:
        page.heading("For and against")
    for row in rows:
        page.text(f"{_words(row['effects'])}, {row['answer']}: {row['reason']}")
    shown = [row for row in rows if row["nats"] is not None]
    if not shown:
        return
    drawing, axes = figure(2, 1, height_in=4.0)
    width = 0.8 / len(shown)
    for number, row in enumerate(shown):
        for ax, nats in zip(axes[0], (list(row["nats_by_witness"].values()), row["nats_by_stretch"]), strict=True):
            ax.barh(np.arange(len(nats)) + number * width, nats, height=width, label=_words(row["effects"]))
    for ax, labels in zip(
        axes[0],
        (list(shown[0]["nats_by_witness"]), [str(k + 1) for k in range(len(shown[0]["nats_by_stretch"]))]),
        strict=True,
    ):
        ax.set_yticks(np.arange(len(labels)) + 0.4 - 0.5 * width, labels)
        ax.set(xlabel="nats beside the most probable hypothesis")
        ax.axvline(0.0, color="black", lw=0.8)
        ax.legend()
    axes[0, 1].set(ylabel="stretch of the logs")
    page.figure(drawing, "Left of the line a witness, or a stretch of the logs, speaks against the name.")


def _tell_tale(page: Page, tracing: Tracing, names: Sequence[str]) -> None:
    page.heading("What gives it away")
    values = quantities(tracing.before.comparison)
    drawing, axes = figure(len(names), 1)
    for ax, effect in zip(axes[0], names, strict=True):
        tell_tale = EFFECTS[effect].TELL_TALE
        name = tell_tale if tell_tale in values else "time_s"  # it may stand still in these logs
        x = values[name]
        edges = np.unique(np.quantile(x, np.linspace(0.0, 1.0, 21)))
        place = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, len(edges) - 2)
        for one, style in _both(tracing):
            error_m = one.unexpected_m * _MM
            number = np.bincount(place, minlength=len(edges) - 1)
            good = number > 0
            mean = np.bincount(place, error_m, minlength=len(edges) - 1)[good] / number[good]
            at = np.bincount(place, x, minlength=len(edges) - 1)[good] / number[good]
            ax.plot(at, mean, "o-", ms=3, color=style["color"], label=style["label"])
        ax.set(xlabel=QUANTITIES[name], ylabel="mean residual [mm]", title=_words([effect]))
        ax.legend()
    page.figure(drawing, "The residual against the quantity that gives each effect away.")


def _rests(page: Page, tracing: Tracing, report: dict[str, Any]) -> None:
    page.heading("The signature")
    page.table(
        ("witness", "off before", "off after", "of that explained"),
        [
            (
                w["name"],
                f"{w['off_before']:.1f}",
                f"{w['off_after']:.1f}",
                "it was not unusual" if w["explained"] is None else f"{w['explained']:.0%}",
            )
            for w in report["witnesses"]
        ],
        caption="In standard deviations of the calibration (rms), on cycles that the fit had not seen.",
    )
    evidence = tracing.evidence
    if not any(evidence.logs.rests):
        return
    drawing, axes = figure(2, 1)
    when = np.array(
        [
            t.signals.time_s[r.stop - 1] - evidence.logs.start_s
            for t, rs in zip(evidence.logs.experiments, evidence.logs.rests, strict=True)
            for r in rs
        ]
    )
    for one, style in _both(tracing):
        z = evidence.of_rests.off(one.predictions).reshape(-1, 2)
        for k, ax in enumerate(axes[0]):
            ax.plot(when, z[:, k], "o", ms=3, color=style["color"], label=style["label"])
    for ax, what in zip(axes[0], ("resistance", "displacement"), strict=True):
        ax.set(
            xlabel="time [s]",
            ylabel="standard deviations of the calibration",
            title=f"{what} against the calibration's",
        )
        ax.legend()
    page.figure(drawing, "Cold at the bias current and hot at full contraction, where both repeat best.")


def _dependence(page: Page, report: dict[str, Any]) -> None:
    page.heading("What the residual depends on")
    before = report["residual_before"]["share_explained_by"]
    after = report["residual_after"]["share_explained_by"]
    page.table(
        ("quantity", "before", "after"),
        [
            (QUANTITIES[name], f"{share:.0%}", f"{after[name]:.0%}" if name in after else "less than the others")
            for name, share in before.items()
        ],
        caption="Share of the mean square that each quantity alone explains, on cycles its means were not taken from.",
    )


def _the_rest(page: Page, report: dict[str, Any]) -> None:
    if report["alternatives"]:
        page.heading("What this log cannot tell apart")
        page.table(
            ("instead of", "could be", "probability", "experiment", "takes", "then they differ by"),
            [
                (
                    _words([a["instead_of"]]),
                    _words([a["name"]]),
                    f"{a['probability']:.0%}",
                    *(
                        (x["what"], f"{x['duration_s']:.0f} s", f"{x['predicted_difference_m'] * _MM:.3f} mm")
                        if (x := a["experiment"])
                        else (NOTHING_TELLS, "", "")
                    ),
                )
                for a in report["alternatives"]
            ],
        )
    if report["untestable"]:
        page.heading("What these logs could not have shown")
        page.table(("effect", "why"), [(_words([u["name"]]), u["reason"]) for u in report["untestable"]])
