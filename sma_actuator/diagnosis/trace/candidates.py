"""Which effects may have happened in some logs: what they may vary there, and which the logs could not show."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from sma_actuator.estimation.effects import EFFECTS, Effect
from sma_actuator.estimation.effects.free import Free, Scales
from sma_actuator.logs.errors import BenchLogError


@dataclass(frozen=True, slots=True)
class Candidate:
    """An effect as it is tried."""

    name: str
    free: tuple[Free, ...]
    fixed: dict[str, float]

    @property
    def effect(self) -> type[Effect]:
        """What it says of itself."""
        return EFFECTS[self.name]

    @property
    def scanned(self) -> str:
        """Name of a parameter in which the loss is not smooth: it is searched over a grid."""
        return self.effect.SCANNED

    def build(self, values: dict[str, float]) -> Effect:
        """The effect with these parameters."""
        return self.effect(**{**self.fixed, **values})


def candidate(name: str, scales: Scales) -> Candidate:
    """An effect, what is free of it and what the configuration fixes."""
    effect = EFFECTS[name]
    return Candidate(name, tuple(effect.free(scales)), effect.fixed(scales))


def untestable(names: Iterable[str], scales: Scales) -> dict[str, str]:
    """Those of some effects that these logs could not show, and why."""
    reasons = {name: EFFECTS[name].untestable(scales) for name in names}
    return {name: why for name, why in reasons.items() if why}


@dataclass(frozen=True, slots=True)
class Field:
    """The effects that a tracing looks at."""

    candidates: list[Candidate]  #: that may have happened
    explained: list[Candidate]  #: that are tried only to say what speaks for and against them
    untestable: dict[str, str]  #: the others that were asked for, and why these logs cannot tell them


def field(
    scales: Scales, only: Sequence[str], without: Sequence[str], explain: Sequence[str], of_the_beginning: bool = False
) -> Field:
    """Those of all effects, or of ``only`` some, and of those to ``explain``.

    ``of_the_beginning``: that a model may have lacked from its beginning.  Raises BenchLogError where one of ``only``
    cannot be fitted.
    """
    names = [n for n in EFFECTS if (not only or n in only) and n not in without]
    if of_the_beginning:  # what circuit and sensors did at the calibration, it has absorbed
        names = [n for n in names if EFFECTS[n].PART == "wire"]
    reasons = untestable(names, scales)
    if only and reasons:
        raise BenchLogError("; ".join(f"{n} cannot be fitted on these logs: {why}" for n, why in reasons.items()))
    beside = [n for n in explain if n not in names]
    reasons |= untestable(beside, scales)
    candidates, explained = ([candidate(n, scales) for n in some if n not in reasons] for some in (names, beside))
    return Field(candidates, explained, reasons)
