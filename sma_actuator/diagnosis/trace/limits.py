"""The limits by which ``trace`` decides, each declared once: what it is, in which unit, and why it lies where it does.

``python -m sma_actuator.diagnosis.trace.limits > docs/tracing_limits.md`` prints them.  They were chosen on designed
sessions of the virtual bench at home (``benchmarks/blind_cases.py``); those of a trial's drawn physics have seen none
of them.  Those of the probabilities were chosen on drawn worlds of their own (``docs/tracing_method.md``). A deviation
is the rms of what a witness shows, in standard deviations of the calibration ("σ").
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

from sma_actuator.base.parameters import declaration_of, parameter


@dataclass(frozen=True, slots=True)
class Limits:
    """By what it is decided whether there is an error, which names compete for it, and which is given."""

    # Is there an error?
    gate: float = parameter(
        1.75,
        "news above which an error is real; a fresh log is another log, and may leave more than its calibration",
        "floors",
        1.0,
    )
    hint: float = parameter(
        1.3,
        "news above which there is an error if one name explains it, and nothing of it is left above the floor",
        "floors",
        1.0,
    )
    hint_share: float = parameter(0.9, "what such a name must explain of the excess", "1", 0.0, 1.0)
    certain_deviation: float = parameter(
        3.0, "deviation of a witness that says that something happened, however small the error", "σ", 0.0
    )
    hopeless: float = parameter(
        50.0, "error above which a model is not of this wire, or the bench is another", "% of full stroke", 0.0
    )

    # How far off is a witness?
    usual_deviation: float = parameter(
        2.0, "deviation of a witness up to which it is usual; one that was, stays as well as it was", "σ", 0.0
    )
    well_deviation: float = parameter(1.5, "deviation up to which nobody asks what it was before", "σ", 0.0)
    worse: float = parameter(1.3, "how much worse than before a usual witness may become", "1", 1.0)
    left_share: float = parameter(
        0.35, "what may be left of the deviation of a witness that was not usual", "1", 0.0, 1.0
    )
    linear_from: float = parameter(
        3.0, "deviation of a row above which it counts linearly (Huber): one bad reading decides nothing", "σ", 0.0
    )
    largest: float = parameter(30.0, "deviation of a row that counts at all", "σ", 0.0)
    floor: float = parameter(1.5, "floor of a model whose file does not say how good it was", "% of full stroke", 0.0)
    straight: float = parameter(
        0.003, "how straight the line of a spring is, in the mean over a heating or cooling", "of full stroke", 0.0
    )
    heat_balance: float = parameter(
        0.05, "how well the heat balance of another log is known, whatever its calibration repeated", "of the rise", 0.0
    )
    other_speed: float = parameter(
        1.0,
        "the same, per share of the stroke that a passage is more or less ahead of its lag than the calibration's: "
        "latent heat and heat capacity were learned at one speed",
        "of the rise",
        0.0,
    )

    # Which name explains it?
    least_of_rest: float = parameter(0.1, "what an effect must explain of what is still in excess", "1", 0.0, 1.0)
    least_of_all: float = parameter(0.03, "and of what was in excess at first", "1", 0.0, 1.0)
    significant: float = parameter(
        2.5, "standard errors over held-out cycles that its gain must be above nothing", "1", 0.0
    )
    decisive: float = parameter(
        30.0, "fall of the loss in all cycles but the best together that needs no standard error", "nats", 0.0
    )
    alike: float = parameter(
        0.05, "difference of gain, over the gain, within which two names do as well", "1", 0.0, 1.0
    )
    alike_if_clean: float = parameter(0.1, "the same where both leave nothing unusual", "1", 0.0, 1.0)
    tie: float = parameter(0.99, "share of the best gain from which the simpler of two names is taken", "1", 0.0, 1.0)
    most_names: int = parameter(3, "names that one effect may have: a longer list says nothing", "1", 1)

    # Are there two?
    least_beside: float = parameter(
        0.13,
        "share of what two effects explain that is each one's own: a second name for a small rest, chosen among all "
        "there are, makes a first name look clean that is wrong",
        "1",
        0.0,
        1.0,
    )
    most_beside: float = parameter(
        0.04,
        "what a second name may take off beside a first that leaves nothing unusual, of what the first does: a "
        "relative of the true effect leaves what the two differ by",
        "1",
        0.0,
    )
    leaders: int = parameter(3, "best names that are tried in pairs with every other", "1", 1)
    sketched: int = parameter(8, "pairs that are fitted in earnest", "1", 1)
    most_new: int = parameter(2, "effects that are looked for: so much happens to a wire at once", "1", 1)
    most_missing: int = parameter(
        3, "effects that a model may lack from its beginning; many together imitate anything", "1", 1
    )

    # Does nothing remain?
    most_loss: float = parameter(3.0, "loss that a name may leave", "losses of a calibration's log", 0.0)
    most_loss_share: float = parameter(0.125, "or share of what there was", "1", 0.0, 1.0)
    trend: float = parameter(
        0.6, "mean square that may still go with time, or with the quantity that gives the effect away", "σ²", 0.0
    )
    trend_share: float = parameter(0.05, "or share of what there was, with that quantity", "1", 0.0, 1.0)
    trend_share_in_time: float = parameter(
        0.01, "and with time: a slip that is called a drift leaves a saw's tooth", "1", 0.0, 1.0
    )
    trend_elsewhere: float = parameter(1.0, "mean square that may still go with any other quantity", "σ²", 0.0)
    trend_share_elsewhere: float = parameter(0.03, "or share of what there was", "1", 0.0, 1.0)
    fewest_for_time: int = parameter(8, "cycles from which a trend over time is judged", "1", 1)
    last_block: float = parameter(
        0.15, "share of the cycles, the latest, that is looked at once, when all is chosen", "1", 0.0, 1.0
    )

    # How probable is it?  Chosen on the sessions that docs/tracing_method.md names.
    tempering: float = parameter(
        0.002,
        "of every nat that counts as one: neighbouring cycles, and what no form fits, say the same again",
        "1",
        0.0,
        1.0,
    )
    size: float = parameter(3.0, "standard deviation of an effect's size before the logs", "typical sizes", 0.0)
    else_size: float = parameter(
        1.0, "standard deviation of each of the smooth errors that something else may make, before the logs", "σ", 0.0
    )
    nothing: float = parameter(0.3, "probability before the logs that nothing has happened", "1", 0.0, 1.0)
    something_else: float = parameter(0.1, "that something has that is none of the effects", "1", 0.0, 1.0)
    pair: float = parameter(0.1, "that two effects have; single ones have the rest, each as much", "1", 0.0, 1.0)
    enough: float = parameter(0.9, "probability that a set of names must have to be given", "1", 0.0, 1.0)


LIMITS = Limits()


def markdown() -> str:
    """The text of ``docs/tracing_limits.md``."""
    out = [
        "# Limits of tracing",
        "",
        (
            "Printed by `python -m sma_actuator.diagnosis.trace.limits > docs/tracing_limits.md`. News, floor, excess "
            "and witness are in the"
        ),
        (
            "[glossary](glossary.md); σ is a standard deviation of the calibration. They were chosen on the designed "
            "sessions of the virtual"
        ),
        "bench at home, and on none of a drawn physics.",
        "",
        "| limit | is | unit | what, and why |",
        "|---|---|---|---|",
    ]
    for field in dataclasses.fields(Limits):
        declared = declaration_of(field)
        unit = "" if declared.unit == "1" else declared.unit
        out.append(f"| `{field.name}` | {field.default:g} | {unit} | {declared.description} |")
    return "\n".join(out) + "\n"


if __name__ == "__main__":
    print(markdown(), end="")  # noqa: T201
