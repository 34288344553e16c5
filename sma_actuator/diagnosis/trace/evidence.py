"""What logs with a true displacement say about a model with some effects in it.

Four kinds of witness (:mod:`.witnesses`): the residual of the displacement through the whole chain, R and δ where the
wire stands still, where the wire pulls a spring the load against the displacement, and the power that it takes to
transform the wire.  All but the spring are measured against what was at the calibration, which is frozen, and are
weighted by how well they repeated there; that one needs no model: a spring is straight.
"""

from __future__ import annotations

import copy
import dataclasses
import math
from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag

from sma_actuator.base.calibration import Calibration
from sma_actuator.base.remembered import Remembered
from sma_actuator.calibration.expectation import correlation_time_s
from sma_actuator.config import Config
from sma_actuator.estimation.chain import Chain, place_of
from sma_actuator.estimation.effects import Effect, Effects
from sma_actuator.logs.bench_log import BenchLog
from sma_actuator.logs.errors import BenchLogError

from .limits import LIMITS
from .prediction import FollowedAnew, Prediction, Where
from .prepared import Prepared
from .witnesses import WITNESSES, Power, Residual, Rests, Springs, Witness, limited

#: Error above which a model is not of this wire, or the bench is another: half the stroke.
HOPELESS_percent = 50.0
#: Readings within the wire's time constant in which effects are looked for, before they are held against all.
SOUGHT_IN_READINGS = 5.0


class Evidence:
    """Logs of one wire and what they witness; :meth:`compare` holds a model with some effects against that.

    Raises BenchLogError: no reference, another wire, a channel that does not move, less than a cycle.
    """

    def __init__(self, logs: Sequence[BenchLog], config: Config, beyond_floor: bool = False):
        """``beyond_floor``: count also what was there at the calibration, as the model's and not as its floor."""
        self.beyond_floor = beyond_floor
        self.config = dataclasses.replace(config, effects=Effects())
        self.base: Mapping[str, Effect] = config.effects.active
        self.calibration = Calibration() if beyond_floor else config.calibration
        self.place = place_of(config)
        self.full_stroke_m = config.wire.full_stroke_m
        self._followed = Remembered()
        known_s = self.calibration.expectation.independent_time
        known = math.isfinite(known_s)
        prepared = Prepared(logs, self.config, lambda: self.chain({}), known_s if known else 0.0)
        #: How far apart two samples are whose errors are independent; where the calibration does not say, the logs do.
        self._independent_s = known_s if known else self._remembered_s(prepared)
        self._witnessed_by(prepared)
        error = float(np.mean(self.compare({}).errors_percent))
        if error > HOPELESS_percent:
            raise BenchLogError(
                f"{self.logs.experiments[0].log.source}: the model errs by {error:.0f} % of full stroke on these logs; "
                "it is not of this wire, or circuit, load_cell or reference_sensor are those of another bench"
            )

    def seldom_and_anywhere(self) -> Evidence:
        """The same logs in as many readings as it takes to look for effects, with one floor wherever the wire was."""
        out = copy.copy(self)
        out._followed = Remembered()
        out._witnessed_by(self.logs.seldom(SOUGHT_IN_READINGS))
        out.of_displacement.take_one_floor()
        return out

    def held_where(self, effects: Mapping[str, Effect]) -> Evidence:
        """The same logs, with the floor of where the wire was if these effects have happened."""
        out = copy.copy(self)
        out.of_displacement = copy.copy(self.of_displacement)
        out.of_displacement.take_floor(self.chain(effects))
        return out

    def _witnessed_by(self, logs: Prepared) -> None:
        """What logs witness, a row each: how far off, in which unit, by which witness and of what weight."""
        self.logs, config = logs, self.config
        self.unit, self.units = logs.unit, logs.units
        self.of_displacement = Residual(logs, config, self.calibration, self.place, self.chain({}))
        if self.beyond_floor:
            self.of_displacement.take_typical(self.predict({}))
        else:
            self.of_displacement.take_floor(self.chain({}))
        self.of_rests = Rests(logs, config, self.calibration)
        self.of_springs = Springs(logs, self.full_stroke_m)
        self.of_power = Power(logs, config, self.calibration)
        samples = self.of_displacement.row_units
        per_unit = np.maximum(np.bincount(samples, minlength=self.units), 1)
        #: Samples of every unit that say something new, shape (units,).
        self.independent = np.minimum(self.independent_in(logs.lasts_s), per_unit)
        self.sample_weight = np.sqrt(self.independent / per_unit)[samples]
        self.unit_of_row = np.concatenate((samples, *(witness.row_units for witness in self.others)))
        self.rows_of_samples = len(samples)
        of_others = [w.row_names + WITNESSES.index(w.names[0]) for w in self.others]
        #: Number of the witness of every row, into WITNESSES; -1 of the residual's.
        self.witness_of_row = np.concatenate((np.full(len(samples), -1), *of_others))

    @property
    def others(self) -> tuple[Witness, ...]:
        """The witnesses beside the displacement, in the order of their rows."""
        return self.of_rests, self.of_springs, self.of_power

    def _remembered_s(self, logs: Prepared) -> float:
        """How long the errors of the model as it is remember themselves in some logs."""
        followed = zip(logs.followed_by(self.chain({})), logs.seen, logs.measured_m, strict=True)
        error_m = np.concatenate([measured_m - found.shown_m[kept] for found, (_, kept), measured_m in followed])
        time_s = np.concatenate([t.signals.time_s for t in logs.experiments])
        log = np.repeat(np.arange(len(logs.measured_m)), [len(m) for m in logs.measured_m])
        good = np.isfinite(error_m)
        return correlation_time_s(time_s[good], error_m[good], log[good])

    def independent_in(self, lasts_s: np.ndarray | float) -> np.ndarray:
        """How many samples say something new within stretches that last so long, at least one."""
        return np.maximum(lasts_s / self._independent_s, 1.0)

    @property
    def readings(self) -> float:
        """As how many readings without a common error the logs count: a session as so many at the most."""
        return min(float(self.independent.sum()), LIMITS.readings * sum(self.logs.begins))

    def compare(self, effects: Mapping[str, Effect]) -> Comparison:
        """Every log beside the model with ``effects`` beside those that it has."""
        return Comparison(self, self.predict(effects))

    def predict(self, effects: Mapping[str, Effect]) -> list[Prediction]:
        """What that model predicts of every log."""
        return self.through(self.chain(effects))

    def chain(self, effects: Mapping[str, Effect]) -> Chain:
        """Its chain."""
        return FollowedAnew(self.config, {**self.base, **effects}, self._followed)

    def through(self, chain: Chain) -> list[Prediction]:
        """What a chain predicts of every log."""
        # What other surroundings do is unexpected, until they are what is held against it.
        ambient_counts = any(effect.ALLOWS_FOR_AMBIENT for effect in chain.effects)
        followed = zip(self.logs.followed_by(chain), self.logs.seen, self.logs.compared_seen, strict=True)
        return [
            Where(chain, self.place, found, expected_m).predicted(kept, here)
            for i, (found, (_, kept), here) in enumerate(followed)
            for expected_m in [self.of_displacement.expected_m(i, found, here, ambient_counts)]
        ]

    def means(self, of_compared: np.ndarray) -> np.ndarray:
        """Mean in every unit of something of the samples compared, shape (units,)."""
        return _means(of_compared, self.of_displacement.row_units, self.units)

    @property
    def floor_percent(self) -> float:
        """Unexpected residual of a model that lacks nothing, in the mean, % of full stroke."""
        if self.beyond_floor:
            return 0.0
        floor_m = self.means(np.concatenate(self.of_displacement.floor_m))
        return float((floor_m / self.full_stroke_m * 100).mean())

    @property
    def expected_loss(self) -> float:
        """Mean loss of a cycle that is like those of the calibration."""
        if self.beyond_floor:
            return 0.0
        others = len(self.unit_of_row) - self.rows_of_samples
        return 0.5 * (float(self.independent.mean()) + others / self.units)

    def rows_by_witness(self) -> dict[str, np.ndarray]:
        """Which rows each witness has (bool): the residual first, then those of WITNESSES of which there is
        something."""
        named = {name: self.witness_of_row == k for k, name in enumerate((*Residual.names, *WITNESSES), -1)}
        return {name: rows for name, rows in named.items() if rows.any()}


class Comparison:
    """Evidence beside a model with some effects: what it predicts, and how far off that is.

    Rows of a log's samples first, log after log, then of each of the other witnesses; in standard deviations of what is
    usual.
    """

    def __init__(self, evidence: Evidence, predictions: list[Prediction]):
        self.evidence, self.predictions = evidence, predictions

    @cached_property
    def rows(self) -> np.ndarray:
        """Huber-limited: half their squares, summed over a cycle, are that cycle's loss, which a fit makes small."""
        others = np.concatenate([witness.off(self.predictions) for witness in self.evidence.others])
        return np.concatenate((limited(self._of_samples) * self.evidence.sample_weight, limited(others)))

    @cached_property
    def off(self) -> np.ndarray:
        """The same without that limit: in proportion to what an effect moves."""
        others = (np.nan_to_num(witness.off(self.predictions)) for witness in self.evidence.others)
        return np.concatenate((np.nan_to_num(self._of_samples) * self.evidence.sample_weight, *others))

    @property
    def unknown(self) -> np.ndarray:
        """The rows after those of the samples: how much further off each is where something is otherwise that no
        calibration shows, a column for each witness that has such a thing, (rows, …)."""
        columns = [witness.unknown(self.predictions)[:, None] for witness in self.evidence.others]
        together = block_diag(*columns)
        return together[:, together.any(axis=0)]

    @property
    def _of_samples(self) -> np.ndarray:
        return self.evidence.of_displacement.off(self.predictions)

    @property
    def unexpected_m(self) -> np.ndarray:
        """Measured less shown displacement beyond what the calibration lets expect, of the samples compared."""
        return np.concatenate(self.evidence.of_displacement.unexpected_m(self.predictions))

    @property
    def unexpected_percent(self) -> np.ndarray:
        """Mean absolute size of that in every unit, % of full stroke, shape (units,)."""
        mean_m = self.evidence.means(np.abs(self.unexpected_m))
        return mean_m / self.evidence.full_stroke_m * 100

    @property
    def errors_percent(self) -> np.ndarray:
        """Mean absolute error of every unit, % of full stroke, shape (units,)."""
        e = self.evidence
        error_m = np.concatenate(
            [np.abs(m - p.shown_m) for m, p in zip(e.logs.measured_m, self.predictions, strict=True)]
        )
        good = np.isfinite(error_m)
        return _means(error_m[good], np.concatenate(e.unit)[good], e.units) / e.full_stroke_m * 100


def _means(values: np.ndarray, unit: np.ndarray, units: int) -> np.ndarray:
    """Mean in every unit, shape (units,); what is not finite counts as nothing."""
    number = np.bincount(unit, minlength=units)
    return np.bincount(unit, np.nan_to_num(values), minlength=units) / np.maximum(number, 1)
