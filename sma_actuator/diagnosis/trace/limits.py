"""The constants by which ``trace`` decides, each declared once: what it is, in which unit, and why it lies where it
does.

``python -m sma_actuator.diagnosis.trace.limits > docs/tracing_limits.md`` prints them.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from sma_actuator.base.parameters import declaration_of, parameter


@dataclass(frozen=True, slots=True)
class Limits:
    """How far off readings usually are, and what is known before the logs."""

    # How far off is a reading?
    linear_from: float = parameter(
        3.0, "deviation of a row above which it counts linearly (Huber): one bad reading decides nothing", "σ", 0.0
    )
    largest: float = parameter(
        30.0,
        "deviation that counts at all: a sensor that is cut off says no more than one that is far off; something else "
        "has smooth errors, readings or a witness so many times as far off at the most, at any scale, each as likely",
        "σ",
        0.0,
    )
    straight: float = parameter(
        0.003,
        "how straight the line of a spring is, in the mean over a heating or cooling and over the middle of its way",
        "of full stroke",
        0.0,
    )
    heat_balance: float = parameter(
        0.05, "how well the heat balance of another log is known, whatever its calibration repeated", "of the rise", 0.0
    )

    # How far off are they together?
    smooth: float = parameter(
        0.5, "standard deviation of each smooth error that a model makes on any session, over the floor", "σ", 0.0
    )
    readings: float = parameter(
        40.0,
        "readings without a common error as which a session counts at the most: a wire that comes to the same place by "
        "the same way again is off there as before",
        "1",
        1.0,
    )

    # What is known before the logs?
    size: float = parameter(3.0, "standard deviation of an effect's size", "typical sizes", 0.0)
    form: float = parameter(
        0.1,
        "how far off the form of an effect may be, smoothly over any one thing that errors may go with; something else "
        "that only looks like it is further off, up to all of that, at any scale, each as likely",
        "of what it moves",
        0.0,
        1.0,
    )
    nothing: float = parameter(
        0.3,
        "probability that nothing has happened; where it is the most probable and has no less with the logs, they do "
        "not say that anything has",
        "1",
        0.0,
        1.0,
    )
    rare: float = parameter(
        0.1,
        "probability that something has happened that is like none of the effects, as much that it looks like one and "
        "is not it, and as much that two things have, of which both or one has a name; single effects have the rest",
        "1",
        0.0,
        0.2,
    )
    enough: float = parameter(0.9, "probability that a set of names must have to be given", "1", 0.0, 1.0)
    names: int = parameter(
        3, "effects that are named together at the most: more say nothing, and many together imitate anything", "1", 1
    )

    @property
    def forms(self) -> tuple[float, ...]:
        """Shares of what it moves by which the form of an effect may be off."""
        return 0.0, 0.5 * self.form, self.form

    @property
    def told(self) -> float:
        """Nats between two names from which one of the two has ``enough``."""
        return math.log(self.enough / (1.0 - self.enough))

    @property
    def nearly(self) -> tuple[float, ...]:
        """The same of what only looks like it."""
        return _scales(self.form, 1.0)

    @property
    def larger(self) -> tuple[float, ...]:
        """How many times as far off as usual something else may be."""
        return _scales(1.0, self.largest)


def _scales(first: float, last: float) -> tuple[float, ...]:
    """Three scales beyond the first, up to the last, each as far from the one before."""
    return tuple(float(scale) for scale in np.geomspace(first, last, 4)[1:])


LIMITS = Limits()


def markdown() -> str:
    """The text of ``docs/tracing_limits.md``."""
    out = [
        "# Limits of tracing",
        "",
        "Printed by `python -m sma_actuator.diagnosis.trace.limits > docs/tracing_limits.md`: the constants by which a",
        "name is given. [Method](tracing_method.md) says on which sessions they were chosen; σ is a standard deviation",
        "of the calibration.",
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
