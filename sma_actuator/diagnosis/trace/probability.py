"""The probability of each hypothesis: nothing, each effect, pairs of them, and something else, by one principle.

Rows are in standard deviations of the calibration.  An effect moves them by its sizes, of which a normal distribution
is known before the logs; *something else* moves them by smooth errors over what a residual goes with, and by an offset
of each other witness (Kennedy and O'Hagan 2001).  The evidence of each is Laplace's after one step (Kass and Raftery
1995).  One exponent tempers all likelihoods, so that what is said holds as often as is said.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import log

import numpy as np

from .analysis import quantities
from .candidates import candidate, scales_of
from .evidence import Evidence, limited
from .limits import LIMITS
from .sensitivity import RIDGE, Step, steps

NOTHING, SOMETHING_ELSE = "nothing", "something else"
#: What something else goes with smoothly.
SMOOTH_OVER = (
    "time_s",
    "displacement_m",
    "stress_Pa",
    "branch",
    "distance_from_reversal_m",
    "power_W",
    "power_lagged_10_s_W",
    "power_lagged_100_s_W",
    "resistance_rate_Ohm_s",
)
KNOTS = 6  #: of the hat functions over each quantity, at its quantiles
LEADERS = 4  #: best single effects that are tried in pairs with every other


@dataclass(frozen=True, slots=True)
class Probabilities:
    """Of all hypotheses, which exclude each other."""

    of: dict[tuple[str, ...], float]  #: by the names that a hypothesis has, best first; they sum to one

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
        """None, traced or unexplained by these alone; and the smallest set of names of which one is there probably
        enough."""
        best = next(iter(self.of))
        if best == (NOTHING,):
            return "none", []
        of_best = [name for name in self.by_name if name in best]
        names = of_best + [n for n in self.by_name if n not in (*best, NOTHING, SOMETHING_ELSE)]
        for number in range(len(of_best), LIMITS.most_names + 1):
            if best != (SOMETHING_ELSE,) and self._with_one_of(names[:number]) >= LIMITS.enough:
                return "traced", names[:number]
        return "unexplained", []

    def _with_one_of(self, names: Sequence[str]) -> float:
        return sum(share for some, share in self.of.items() if set(some) & set(names))


def probabilities(evidence: Evidence, names: Sequence[str]) -> Probabilities:
    """Of nothing, of these effects, of their pairs and of something else, by what the logs say."""
    scales, predictions = scales_of(evidence), evidence.predict({})
    base = evidence.off(predictions)
    singles = [step for name in names for step in steps(evidence, candidate(name, scales), base, scales.duration_s)]
    found = {n: v for n, v in quantities(evidence, predictions).items() if n in SMOOTH_OVER}
    smooth = smooth_errors(found, evidence.sample_weight, evidence.witness_of_row[evidence.rows_of_samples :])
    return weighed(limited(base), singles, smooth)


def weighed(base: np.ndarray, singles: Sequence[Step], smooth: np.ndarray) -> Probabilities:
    """Of hypotheses by their steps; ``base``: limited rows without an effect, ``smooth``: what something else moves, a
    column each."""
    names = list(dict.fromkeys(step.name for step in singles))
    several = {name: sum(step.name == name for step in singles) for name in names}
    paired = list(_pairs(singles, names))
    pairs = {p for p, _, _ in paired}
    single = (1.0 - LIMITS.nothing - LIMITS.something_else - LIMITS.pair) / max(len(names), 1)
    u, s, _ = np.linalg.svd(smooth, full_matrices=False)
    gain = LIMITS.tempering * (LIMITS.else_size * s) ** 2
    taken = LIMITS.tempering * float(np.sum(gain / (1.0 + gain) * (u.T @ base) ** 2))
    nothing = -0.5 * LIMITS.tempering * float(base @ base)
    logarithm: dict[tuple[str, ...], list[float]] = {
        (NOTHING,): [nothing + log(LIMITS.nothing)],
        (SOMETHING_ELSE,): [nothing + 0.5 * taken - 0.5 * float(np.sum(np.log1p(gain))) + log(LIMITS.something_else)],
    }
    for step in singles:
        prior = single / several[step.name]
        logarithm.setdefault((step.name,), []).append(_evidence(step) + log(prior))
    for both, step, times in paired:
        logarithm.setdefault(both, []).append(_evidence(step) + log(LIMITS.pair / len(pairs) / times))
    total = {some: float(np.logaddexp.reduce(values)) for some, values in logarithm.items()}
    whole = float(np.logaddexp.reduce(list(total.values())))
    share = {some: float(np.exp(value - whole)) for some, value in total.items()}
    return Probabilities(dict(sorted(share.items(), key=lambda item: -item[1])))


def _evidence(step: Step) -> float:
    """Laplace's logarithm of the evidence, up to what is common to all."""
    information = LIMITS.tempering * LIMITS.size**2 * (step.slopes.T @ step.slopes)
    occam = float(np.linalg.slogdet(np.eye(len(step.values)) + information)[1])
    squares = LIMITS.tempering * float(step.rows @ step.rows) + float(np.sum((step.values / LIMITS.size) ** 2))
    return -0.5 * (squares + occam)


def _pairs(singles: Sequence[Step], names: Sequence[str]):
    """(both names, the two together, how many such there are): the best few with every other, which takes a step beside
    them."""
    best = {name: min((x for x in singles if x.name == name), key=lambda x: float(x.rows @ x.rows)) for name in names}
    leaders = sorted(names, key=lambda name: float(best[name].rows @ best[name].rows))[:LEADERS]
    several = {name: sum(step.name == name for step in singles) for name in names}
    for position, first in enumerate(leaders):
        for other in singles:
            if other.name in leaders[: position + 1]:
                continue
            a, rows = other.slopes, best[first].rows
            step = -np.linalg.solve(a.T @ a + RIDGE * np.eye(a.shape[1]), a.T @ rows)
            both = Step(
                first,
                np.column_stack((best[first].slopes, a)),
                np.concatenate((best[first].values, step)),
                rows + a @ step,
            )
            yield (first, other.name), both, several[other.name]


def smooth_errors(found: dict[str, np.ndarray], weight: np.ndarray, witness: np.ndarray) -> np.ndarray:
    """What something else moves, shape (n, m): hats over each quantity of the samples, and an offset of each other
    witness.

    ``weight`` of every sample's row, shape (k,); ``witness``: number of the witness of each of the n - k rows behind
    them.
    """
    columns = []
    for values in found.values():
        knots = np.unique(np.quantile(values, np.linspace(0.0, 1.0, KNOTS)))
        if len(knots) > 1:
            columns += [np.interp(values, knots, hat) * weight for hat in np.eye(len(knots))]
    of_samples = np.column_stack(columns)
    of_others = np.equal.outer(witness, np.unique(witness)).astype(float)
    out = np.zeros((len(weight) + len(witness), of_samples.shape[1] + of_others.shape[1]))
    out[: len(weight), : of_samples.shape[1]] = of_samples
    out[len(weight) :, of_samples.shape[1] :] = of_others
    return out
