"""What a kelvin of another room counts, by the logs, and what will tell of other surroundings as the wire is used.

See :mod:`sma_actuator.estimation.models.surroundings`.  Geometry tells what a wire loses to still air when it is warm;
the heat balance takes that for its loss near the surroundings' temperature and lets it grow, so that it has the wire
less warm than it is.  Logs of more than one room tell the rest.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sma_actuator.derived import RISE_K
from sma_actuator.estimation.models.heat_content import APPARENT
from sma_actuator.estimation.models.surroundings import LEAST_K, WITHIN, nothing_seen, off_K, tell

from .data import Data
from .judged import PLACES, near_places
from .learner import Team

UNITS, ITERATIONS = 14, 60  #: of each learner: with 32 it tells the same


class Expected(NamedTuple):
    """What tells of other surroundings."""

    team: Team
    widths: np.ndarray  #: how far off it is, one standard deviation over its spread and the floor, (2, PLACES)
    floor_K: float
    counts: float
    counts_within: float
    off_K: np.ndarray  #: by how much the heat balance has the wire too warm in every row


def expected(z: np.ndarray, data: Data, growth_1_K: float, scale_K: float) -> Expected:
    """Learn which apparent temperature a wire has by all else, and how surely, in the room that most logs are of.

    ``z``: scaled features of the rows (rows, features); ``growth_1_K``: of the heat loss; ``scale_K``: of the apparent
    temperature.
    """
    ambient_C = data.ambient[: sum(data.lengths)]  # what copies have wrong is no room
    other_K = (ambient_C - np.median(ambient_C))[data.rows % len(ambient_C)]
    own, fold = data.measured, data.log_fold[data.rows]
    few = own & data.fewer
    usual = few & (np.abs(other_K) <= max(LEAST_K, float(np.median(np.abs(other_K)))))
    rest, apparent_K = z.copy(), scale_K * z[:, APPARENT]
    rest[:, APPARENT] = 0.0

    def learned(rows: np.ndarray) -> Team:
        rows = rows if rows.any() else few  # of the usual room there is but what was left out
        return Team(rest[rows], apparent_K[rows], ITERATIONS, data.along_stress, units=UNITS)

    beyond_K, spread_K = apparent_K.copy(), np.zeros(len(z))
    for number in np.unique(fold[own]):
        out = own & (fold == number)
        value_K, spread_K[out] = learned(usual & ~out).values(rest[out])
        beyond_K[out] -= value_K
    floor_K = float(np.median(spread_K[own]))
    place, heating = data.displacement[data.rows], data.heating[data.rows].astype(bool)
    first, last = np.percentile(data.displacement, (0.1, 99.9))
    places = np.linspace(first, last, PLACES)
    score = beyond_K / (floor_K + spread_K)
    widths = near_places(place[usual], heating[usual], score[usual], places, _rms)
    within_K = (floor_K + spread_K) * np.where(heating, *(np.interp(place, places, row) for row in widths[::-1]))
    of_log = np.searchsorted(np.cumsum(data.lengths), data.rows, side="right")
    counts, within = 1.0 / (1.0 + RISE_K * growth_1_K), WITHIN
    told = own & (np.abs(other_K) > LEAST_K)
    for log in np.unique(of_log[told]):  # each a run, which begins with what those before it have told
        memory = nothing_seen((counts, within))
        rows = np.flatnonzero(told & (of_log == log))
        time_s, share = data.time[data.rows[rows]], data.share[data.rows[rows]]
        for row, step_s, here in zip(rows, np.diff(time_s, prepend=time_s[0]), share, strict=True):
            off, _ = off_K(other_K[row], 0.0, memory)
            tell(beyond_K[row], within_K[row], off, other_K[row], 0.0, step_s, here, memory)
        off, within = off_K(1.0, 0.0, memory)
        counts = 1.0 - off
    return Expected(learned(usual), widths, floor_K, counts, within, (1.0 - counts) * other_K)


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))
