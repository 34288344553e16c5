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

import numpy as np

from sma_actuator.base.calibration import Calibration
from sma_actuator.base.remembered import Remembered
from sma_actuator.config import Config
from sma_actuator.estimation.chain import Chain, place_of
from sma_actuator.estimation.effects import Effect, Effects
from sma_actuator.logs.bench_log import BenchLog
from sma_actuator.logs.errors import BenchLogError

from .following import FollowedAnew, Where
from .limits import LIMITS
from .prepared import Prepared
from .witnesses import WITNESSES, Power, Prediction, Residual, Rests, Springs, Witness, limited

#: Error above which a model is not of this wire, or the bench is another: half the stroke.
HOPELESS_percent = 50.0
#: Readings within the wire's time constant in which effects are looked for, before they are held against all.
SOUGHT_IN_READINGS = 5.0


class Evidence:
    """Logs of one wire and what they witness; :meth:`residual` is what a fit makes small.

    Raises BenchLogError: no reference, another wire, a channel that does not move, less than a cycle.
    """

    def __init__(
        self, logs: Sequence[BenchLog], config: Config, beyond_floor: bool = False, readings: float = math.inf
    ):
        """``beyond_floor``: count also what was there at the calibration, as the model's and not as its floor;
        ``readings``: so many within the wire's time constant are enough."""
        self._given = logs, config
        self.beyond_floor = beyond_floor
        self.config = dataclasses.replace(config, effects=Effects())
        self.base: Mapping[str, Effect] = config.effects.active
        self.calibration = Calibration() if beyond_floor else config.calibration
        self.place = place_of(config)
        self.full_stroke_m = config.wire.full_stroke_m
        self._followed = Remembered()
        self.logs = Prepared(logs, self.config, lambda: self.chain({}), readings)
        self.unit, self.units = self.logs.units(self._independent_s)
        self.of_displacement = Residual(self.logs, self.unit, config, self.calibration, self.place, self.chain({}))
        if beyond_floor:
            self.of_displacement.take_typical(self.predict({}))
        else:
            self.of_displacement.take_floor(self.chain({}))
        self.of_rests = Rests(self.logs, self.unit, config, self.calibration)
        self.of_springs = Springs(self.logs, self.unit, self.full_stroke_m)
        self.of_power = Power(self.logs, self.unit, config, self.calibration)
        self._rows()
        error = float(np.mean(errors_percent(self, self.predict({}))))
        if error > HOPELESS_percent:
            raise BenchLogError(
                f"{self.logs.experiments[0].log.source}: the model errs by {error:.0f} % of full stroke on these logs; "
                "it is not of this wire, or circuit, load_cell or reference_sensor are those of another bench"
            )

    def seldom_and_anywhere(self) -> Evidence:
        """The same logs in as many readings as it takes to look for effects, with one floor wherever the wire was."""
        out = Evidence(*self._given, readings=SOUGHT_IN_READINGS)
        out.of_displacement.take_one_floor()
        return out

    def held_where(self, effects: Mapping[str, Effect]) -> Evidence:
        """The same logs, with the floor of where the wire was if these effects have happened."""
        out = copy.copy(self)
        out.of_displacement = copy.copy(self.of_displacement)
        out.of_displacement.take_floor(self.chain(effects))
        return out

    def _rows(self) -> None:
        """Which unit and which witness each row of the residual belongs to, and its weight."""
        samples = self.of_displacement.row_units
        per_unit = np.maximum(np.bincount(samples, minlength=self.units), 1)
        #: Samples of every unit that say something new, shape (units,).
        self.independent = np.minimum(self.independent_in(self.logs.lasts_s(self.unit, self.units)), per_unit)
        self.sample_weight = np.sqrt(self.independent / per_unit)[samples]
        self.unit_of_row = np.concatenate((samples, *(witness.row_units for witness in self._others)))
        self.rows_of_samples = len(samples)
        of_others = [w.row_names + WITNESSES.index(w.names[0]) for w in self._others]
        #: Number of the witness of every row, into WITNESSES; -1 of the residual's.
        self.witness_of_row = np.concatenate((np.full(len(samples), -1), *of_others))

    @property
    def _others(self) -> tuple[Witness, ...]:
        """The witnesses beside the displacement, in the order of their rows."""
        return self.of_rests, self.of_springs, self.of_power

    @property
    def _independent_s(self) -> float:
        """How far apart two samples are whose errors are independent, as the calibration has it; 0 where it is not
        known."""
        known = self.calibration.expectation.independent_time
        return known if math.isfinite(known) else 0.0

    def independent_in(self, lasts_s: np.ndarray | float) -> np.ndarray:
        """How many samples say something new within stretches that last so long, at least one."""
        if not self._independent_s > 0.0:
            return np.full(np.shape(lasts_s), LIMITS.independent)
        return np.maximum(lasts_s / self._independent_s, 1.0)

    @property
    def readings(self) -> float:
        """As how many readings without a common error the logs count: a session as so many at the most."""
        return min(float(self.independent.sum()), LIMITS.readings * sum(self.logs.begins))

    def predict(self, effects: Mapping[str, Effect]) -> list[Prediction]:
        """Every log through the chain with ``effects`` beside those that the model has."""
        return self.through(self.chain(effects))

    def chain(self, effects: Mapping[str, Effect]) -> Chain:
        """The model's chain with ``effects`` beside those that it has."""
        return FollowedAnew(self.config, {**self.base, **effects}, self._followed)

    def through(self, chain: Chain) -> list[Prediction]:
        """Every log through a chain."""
        out = []
        # What other surroundings do is unexpected, until they are what is held against it.
        ambient_counts = any(effect.ALLOWS_FOR_AMBIENT for effect in chain.effects)
        for i, (p, (_, kept), here) in enumerate(
            zip(self.logs.followed_by(chain), self.logs.seen, self.logs.compared_seen, strict=True)
        ):
            expected_m = self.of_displacement.expected_m(i, p, here, ambient_counts)
            where = Where(chain, self.place, p, expected_m)
            shown_beside_m = where.shown_beside_the_model_m()
            out.append(
                Prediction(
                    shown_m=p.shown_m[kept],
                    model_m=p.model_m[kept],
                    sensor_m=where.beyond_the_load_m()[kept],
                    beside_m=(p.shown_m - p.model_m + shown_beside_m - expected_m)[kept],
                    expected_m=shown_beside_m[here],
                    heating=p.branch[kept].astype(bool),
                    resistance_Ohm=p.resistance_Ohm[kept],
                    power_W=p.signals.power_W[kept],
                    heat_W=p.heat_W[kept],
                    stress_Pa=p.signals.stress_Pa[kept],
                    elapsed_s=p.elapsed_s[kept],
                )
            )
        return out

    def residual(self, effects: Mapping[str, Effect]) -> np.ndarray:
        """Rows to be made small by a fit of ``effects`` (see :meth:`rows`)."""
        return self.rows(self.predict(effects))

    def rows(self, predictions: Sequence[Prediction]) -> np.ndarray:
        """Rows of which half the squares, summed over a cycle, are that cycle's loss.

        Samples first, log after log, then each of the other witnesses; in standard deviations, Huber-limited.
        """
        samples = limited(self.of_displacement.off(predictions)) * self.sample_weight
        others = np.concatenate([witness.off(predictions) for witness in self._others])
        return np.concatenate((samples, limited(others)))

    def off(self, predictions: Sequence[Prediction]) -> np.ndarray:
        """The same rows without Huber's limit: in proportion to what an effect moves."""
        samples = np.nan_to_num(self.of_displacement.off(predictions)) * self.sample_weight
        return np.concatenate((samples, *(np.nan_to_num(witness.off(predictions)) for witness in self._others)))

    def late(self, predictions: Sequence[Prediction]) -> np.ndarray:
        """The rows after those of the samples: how much further off each is where the load is read one reading
        later."""
        return np.concatenate([witness.late(predictions) for witness in self._others])

    def losses(self, rows: np.ndarray) -> np.ndarray:
        """Loss of every unit, shape (units,)."""
        return 0.5 * np.bincount(self.unit_of_row, rows**2, minlength=self.units)

    def rows_by_witness(self) -> dict[str, np.ndarray]:
        """Which rows each witness has (bool): the residual first, then those of WITNESSES of which there is
        something."""
        named = {name: self.witness_of_row == k for k, name in enumerate((*Residual.names, *WITNESSES), -1)}
        return {name: rows for name, rows in named.items() if rows.any()}

    def witnesses(self, rows: np.ndarray, units: np.ndarray) -> dict[str, float]:
        """How far each of WITNESSES is off in some units (bool), rms in standard deviations of the calibration.

        Without those of which there is nothing.
        """
        chosen = units[self.unit_of_row] & (self.witness_of_row >= 0)
        witness, off = self.witness_of_row[chosen], rows[chosen]
        number = np.bincount(witness, minlength=len(WITNESSES))
        squares = np.bincount(witness, off**2, minlength=len(WITNESSES))
        return {name: math.sqrt(s / n) for name, s, n in zip(WITNESSES, squares, number, strict=True) if n}


def errors_percent(evidence: Evidence, predictions: Sequence[Prediction]) -> np.ndarray:
    """Mean absolute error of every unit, % of full stroke, shape (units,)."""
    error_m = np.concatenate(
        [np.abs(m - p.shown_m) for m, p in zip(evidence.logs.measured_m, predictions, strict=True)]
    )
    unit, good = np.concatenate(evidence.unit), np.isfinite(error_m)
    number = np.bincount(unit[good], minlength=evidence.units)
    sums_m = np.bincount(unit[good], error_m[good], minlength=evidence.units)
    return sums_m / np.maximum(number, 1) / evidence.full_stroke_m * 100
