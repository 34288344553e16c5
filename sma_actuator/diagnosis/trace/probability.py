"""How probable each hypothesis is, and what follows from that."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import log

import numpy as np

from .limits import LIMITS
from .rows import NOTHING, SOMETHING_ELSE, Hypothesis

NO_NAMES = (NOTHING, SOMETHING_ELSE)


@dataclass(frozen=True, slots=True)
class Probabilities:
    """Of all hypotheses, which exclude each other."""

    of: dict[tuple[str, ...], float]  #: by the names that a hypothesis has, best first; they sum to one

    @property
    def best(self) -> tuple[str, ...]:
        """Names of the most probable hypothesis."""
        return next(iter(self.of))

    @property
    def by_name(self) -> dict[str, float]:
        """Probability that each name is there, alone or in a pair; best first."""
        out: dict[str, float] = {}
        for names, share in self.of.items():
            for name in names:
                out[name] = out.get(name, 0.0) + share
        return dict(sorted(out.items(), key=lambda item: -item[1]))

    @property
    def verdict(self) -> tuple[str, list[str]]:
        """None where nothing is the most probable and no less so than before the logs, traced or unexplained; and the
        names that are given: the smallest set among which all that has happened is probably enough, or where there is
        none, those of the most probable hypothesis that are so by themselves."""
        if self.best == (NOTHING,) and self.of[self.best] >= LIMITS.nothing:
            return "none", []
        likely = [name for name in self.by_name if name not in NO_NAMES]
        of_best = [name for name in likely if name in self.best]
        names = of_best + [name for name in likely if name not in of_best]
        sets = [names[:number] for number in range(len(of_best), LIMITS.names + 1) if of_best]
        certain = [name for name in of_best if self.by_name[name] >= LIMITS.enough]
        given = next((some for some in sets if self.within(some) >= LIMITS.enough), certain)
        return ("traced", given) if given else ("unexplained", [])

    def within(self, names: Sequence[str]) -> float:
        """Probability that as many of some names are there as the most probable hypothesis has, or all that are."""
        number = len(self.best)
        return sum(share for some, share in self.of.items() if len({*some} & {*names}) >= min(number, len(some)))


def weighed(hypotheses: Sequence[tuple[float, Hypothesis]]) -> Probabilities:
    """Probabilities of hypotheses, each with what it had before the logs; one that is none has none."""
    logarithm = {one.names: -np.inf if one.why_none else one.log_evidence + log(before) for before, one in hypotheses}
    whole = float(np.logaddexp.reduce(list(logarithm.values())))
    share = {names: float(np.exp(value - whole)) for names, value in logarithm.items()}
    return Probabilities(dict(sorted(share.items(), key=lambda item: -item[1])))
