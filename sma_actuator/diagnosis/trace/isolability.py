"""Which effects some logs would show, and which they could not tell apart: before anything has happened.

Every effect moves the rows of the evidence by its size times a sensitivity, which is asked of the chain.  In standard
deviations of the calibration these are vectors: their length says how well an effect shows, and what is left of one
beside all that another can do says how well the two are told apart (Basseville 1997, isolability from the information
that logs hold).  The experiment that would tell most is the one that adds most to what is known of which effect it is:
the mutual information of effect and readings by its bound over pairs (Kolchinsky and Tracey 2017).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sma_actuator.base.one_thread import one_thread
from sma_actuator.base.parameters import declaration_of
from sma_actuator.calibration.rest import SPREAD
from sma_actuator.estimation.effects import Effect

from .candidates import Candidate, field
from .evidence import Evidence
from .experiments import after_the_session, experiments, shown_m
from .limits import LIMITS
from .rows import Rows
from .scales import scales_of
from .sensitivity import built, probes, shapes, sizes

ALIKE = 1e-9  #: share of a sensitivity below which nothing is left of it
PAIRS_SHOWN = 2


@dataclass(frozen=True, slots=True)
class Apart:
    """How well one effect shows, and is told from the others."""

    name: str
    parameter: str  #: that it is in proportion to
    unit: str
    most: float  #: of it that is possible
    seen_from: float  #: size from which these logs show it; infinite where no size would do
    told_from: dict[str, float]  #: by every other name, size from which it is told from that

    @property
    def nearest(self) -> str:
        """The name that it is told from last; empty where there is no other."""
        return max(self.told_from, key=lambda name: self.told_from[name], default="")

    @property
    def alike(self) -> tuple[str, ...]:
        """Names that no possible size tells it from."""
        return tuple(name for name, size in self.told_from.items() if size > self.most)


@dataclass(frozen=True, slots=True)
class Tells:
    """What an experiment would add."""

    what: str
    duration_s: float
    bits: float  #: of what is not known of which effect it is
    parts: tuple[tuple[str, str, float], ...]  #: pairs that it tells better, with the nats added, most first


@dataclass(frozen=True, slots=True)
class Isolability:
    """Of some logs."""

    effects: tuple[Apart, ...]
    untestable: dict[str, str]
    bits: float  #: that these logs tell of which effect it is, where it is just large enough to be seen …
    most_bits: float  #: … of so many
    experiments: tuple[Tells, ...]  #: best first


@dataclass(frozen=True, slots=True)
class _Moves:
    """What an effect moves, under the covariance of a session without any."""

    candidate: Candidate
    own: np.ndarray  #: by what is typical of each of its sizes, shape (rows, sizes)
    all_: np.ndarray  #: the same for all shapes that are tried, shape (rows, …)


@one_thread()
def isolability(evidence: Evidence, without: Sequence[str] = ()) -> Isolability:
    """What these logs would show.

    Raises BenchLogError as :class:`Evidence` does.
    """
    scales = scales_of(evidence)
    looked_at = field(scales, only=(), without=without, explain=())
    tried = list(experiments(evidence))
    moves, beyond = [], []
    rows = Rows(evidence)
    plain, plain_there = rows.off, _there(rows, {}, tried)
    for c in looked_at.candidates:
        own, all_, there = [], [], []
        for number, shape in enumerate(shapes(c, scales.duration_s)):
            for probe in probes(c):
                effects, share = {c.name: built(c, shape, probe)}, probe[np.flatnonzero(probe)[0]]
                moved = (evidence.compare(effects).off - plain) / share
                all_.append(rows.usual.whiten(moved))
                after = _there(rows, effects, tried)
                there.append([(a - b) / share for a, b in zip(after, plain_there, strict=True)])
                own += [all_[-1]] if number == 0 else []
        moves.append(_Moves(c, np.column_stack(own), np.column_stack(all_)))
        beyond.append([np.column_stack(parts) for parts in zip(*there, strict=True)])
    nats = _apart(moves)
    seen = [_sure_from(0.5 * float(np.sum(m.own**2))) for m in moves]
    apart = tuple(_of(m.candidate, moves, seen[i], nats[i]) for i, m in enumerate(moves))
    just_seen = np.array([size if math.isfinite(size) else 0.0 for size in seen])
    known = _bits(nats * just_seen[:, None] ** 2)
    told = []
    for k, (what, signals) in enumerate(tried):
        longer = [_with(m, parts[k]) for m, parts in zip(moves, beyond, strict=True)]
        more = _apart(longer)
        added = (more - nats) * just_seen[:, None] ** 2
        order = np.argsort(-added, axis=None)[:PAIRS_SHOWN]
        pairs = [np.unravel_index(int(n), added.shape) for n in order]
        told.append(
            Tells(
                what,
                float(np.ptp(signals.time_s)),
                _bits(more * just_seen[:, None] ** 2) - known,
                tuple((moves[i].candidate.name, moves[j].candidate.name, float(added[i, j])) for i, j in pairs),
            )
        )
    told.sort(key=lambda tells: -tells.bits)
    return Isolability(apart, looked_at.untestable, known, math.log2(max(len(moves), 1)), tuple(told))


def _there(rows: Rows, effects: dict[str, Effect], tried: Sequence[tuple[str, Any]]) -> list[np.ndarray]:
    """What the reference sensor would show in each experiment, in standard deviations, weighed as the logs' samples
    are."""
    evidence = rows.evidence
    chain = after_the_session(evidence, effects)
    sigma_m = SPREAD * evidence.floor_percent / 100.0 * evidence.full_stroke_m
    out = []
    for _, signals in tried:
        duration_s, n = float(np.ptp(signals.time_s)), len(signals.time_s)
        weight = math.sqrt(rows.share * min(float(evidence.independent_in(duration_s)), n) / n)
        out.append(shown_m(evidence, chain, signals) / sigma_m * weight)
    return out


def _with(moves: _Moves, there: np.ndarray) -> _Moves:
    """The logs and an experiment after them."""
    sizes = moves.own.shape[1]
    return dataclasses.replace(moves, own=np.vstack((moves.own, there[:, :sizes])), all_=np.vstack((moves.all_, there)))


def _apart(moves: Sequence[_Moves]) -> np.ndarray:
    """Nats, tempered, by which a typical effect (row) does better than anything that another (column) can do."""
    out = np.zeros((len(moves), len(moves)))
    for j, other in enumerate(moves):
        u, s, _ = np.linalg.svd(other.all_, full_matrices=False)
        basis = u[:, s > 1e-6 * max(float(s[0]), ALIKE)]
        for i, m in enumerate(moves):
            if i != j:
                left = m.own - basis @ (basis.T @ m.own)
                squares, whole = float(np.sum(left**2)), float(np.sum(m.own**2))
                out[i, j] = 0.5 * squares if squares > ALIKE * whole else 0.0
    return out


def _sure_from(nats: float) -> float:
    """Size, in what is typical, from which that many nats of a typical one are enough."""
    return math.sqrt(LIMITS.told / nats) if nats > 0.0 else math.inf


def _of(c: Candidate, moves: Sequence[_Moves], seen_from: float, nats: np.ndarray) -> Apart:
    size, typical = sizes(c)[0]
    unit = declaration_of(next(f for f in dataclasses.fields(c.effect) if f.name == size.name)).unit  # type: ignore[arg-type]
    others = {
        m.candidate.name: typical * _sure_from(n) for m, n in zip(moves, nats, strict=True) if m.candidate is not c
    }
    return Apart(c.name, size.name, unit, max(abs(size.low), size.high), seen_from * typical, others)


def _bits(nats: np.ndarray) -> float:
    """What readings tell of which of n effects it is, each as likely; the lower bound over pairs, from nats (n, n)."""
    n = len(nats)
    if not n:
        return 0.0
    distance = 0.5 * np.minimum(nats, nats.T) / 2.0  # of Bhattacharyya, of two normal distributions of one covariance
    np.fill_diagonal(distance, 0.0)
    return float(-np.mean(np.log2(np.mean(np.exp(-distance), axis=1))))


def as_numbers(found: Isolability) -> dict[str, Any]:
    """For machines; a size that no log could show is null."""
    return {
        "effects": [
            {
                "name": e.name,
                "parameter": e.parameter,
                "unit": "" if e.unit == "1" else e.unit,
                "seen_from": _possible(e.seen_from, e.most),
                "told_from_all": _possible(max(e.told_from.values(), default=e.seen_from), e.most),
                "told_last_from": e.nearest,
                "told_from": {name: _possible(size, e.most) for name, size in e.told_from.items()},
                "not_told_from": list(e.alike),
            }
            for e in found.effects
        ],
        "untestable": [{"name": name, "reason": reason} for name, reason in found.untestable.items()],
        "known_bits": found.bits,
        "most_bits": found.most_bits,
        "experiments": [
            {
                "what": t.what,
                "duration_s": t.duration_s,
                "adds_bits": t.bits,
                "tells": [{"name": a, "from": b, "adds_nats": nats} for a, b, nats in t.parts],
            }
            for t in found.experiments
        ],
    }


def _possible(size: float, most: float) -> float | None:
    return size if size <= most else None


def size_in_words(effect: dict[str, Any], size: float | None) -> str:
    """A size of an effect of :func:`as_numbers` with its unit."""
    return "no size" if size is None else f"{effect['parameter']} {size:.2g} {effect['unit']}".strip()


def tells_in_words(experiment: dict[str, Any]) -> str:
    """What an experiment of :func:`as_numbers` would give."""
    return "it tells " + " and ".join(f"{t['name']} from {t['from']}" for t in experiment["tells"])
