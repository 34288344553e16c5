"""What logs with a true displacement say about a model with some effects in it.

Four kinds of witness: the residual of the displacement through the whole chain, R and δ where the wire
stands still, the power that it takes to transform the wire, and, where the wire pulls a spring, the load against the
displacement.  All but the last are measured against what was at the calibration, which is frozen, and are weighted by
how well they repeated there; the last needs no model: a spring is straight.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sma_actuator.base.signals import Quality, Signals
from sma_actuator.calibration.expectation import Expectation, always_so_m
from sma_actuator.calibration.power import passages, warmer_K
from sma_actuator.calibration.rest import SPREAD, AtRest, Rest, Usual, find_rests
from sma_actuator.calibration.training import SINCE_THEN, SINCE_THEN_WITHIN
from sma_actuator.config import Config
from sma_actuator.estimation.calibration import Calibration, left_in_place
from sma_actuator.estimation.chain import Chain, Judged, place_of
from sma_actuator.estimation.effects import Effect, Effects
from sma_actuator.estimation.effects.frame import Frame, Place
from sma_actuator.logs.bench_log import BenchLog
from sma_actuator.logs.errors import BenchLogError
from sma_actuator.logs.experiments import Experiment, make_experiment, sessions

INDEPENDENT = (
    8.0  #: samples of one unit that say something new, where the calibration does not say how long errors last
)
UNIT_TIMES = 4.0  #: a unit lasts at least so many times as long as errors remember themselves
LIMIT = 3.0  #: residual, in standard deviations, above which it counts linearly (Huber)
WORST = 30.0  #: and the largest that counts at all
FLOOR_percent = 1.5  #: of full stroke, where the model does not say how good it was
#: Who says, beside the displacement all along, whether an effect is there: what a wire at rest shows, and a spring.
WITNESSES = (
    "resistance at cold rest",
    "displacement at cold rest",
    "resistance at hot rest",
    "displacement at hot rest",
    "load against displacement",
    "power in the transformation",
)
AFTER_THE_MODEL = ("at_displacement", "shown")  #: stages of the chain
LINE = WITNESSES.index("load against displacement")
POWER = WITNESSES.index("power in the transformation")
#: How well the heat balance of another log can be trusted, whatever its calibration repeated: of the rise above ambient.
BALANCE = 0.05
#: And the same of a passage faster or slower than those of the calibration in their middle, per share of the stroke that it is more
#: or less ahead of its lag: latent heat and heat capacity were learned at one speed.
OTHER_SPEED = 1.0
LOADS_DIFFER = 0.1  #: spread of the load, over the load, from which it counts as changing
SPRING = 0.9  #: correlation squared of load and displacement from which the load is that of a spring
STRAIGHT = 0.003  #: of full stroke: how straight a spring's line is, in the mean over a unit's heating or cooling
ON_ITS_WAY = 0.1  #: of full stroke: so far from where it will rest, a wire still transforms
FEWEST_CYCLES = 3  #: in all logs together
FEWEST_UNITS = 8
HOPELESS_percent = 50.0  #: of full stroke: an error of a model that is not of this wire
SMOOTHED_s = 0.3  #: within which a wire does not go to and fro
LARGEST = 60_000  #: samples that the chain sees; longer logs are thinned …
COMPARED = 4_000  #: … and so many of them at the most are compared with the measured displacement


@dataclass(frozen=True, slots=True)
class Prediction:
    """A model with effects on one log, arrays of shape (n,)."""

    shown_m: np.ndarray  #: displacement that the reference sensor should show
    model_m: np.ndarray  #: displacement of the strain model alone
    sensor_m: np.ndarray  #: what it should show beyond what the load pulls at
    beside_m: np.ndarray  #: how much further than the wire it should show the joint, where the wire is as expected
    expected_m: np.ndarray  #: residual that is no news, of the samples that are compared (:attr:`Evidence.compared`)
    heating: np.ndarray
    resistance_Ohm: np.ndarray  #: as the strain model sees it
    power_W: np.ndarray
    heat_W: np.ndarray  #: what of it the calibration's heat balance sees
    stress_Pa: np.ndarray
    elapsed_s: np.ndarray


class Evidence:
    """Logs of one wire, prepared; :meth:`residual` is what a fit makes small.

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
        logs = sorted(logs, key=lambda log: float(log["time_s"][0]))
        thin = max(1, math.ceil(sum(map(len, logs)) / LARGEST))
        seen = [piece for log in logs for piece in sessions(make_experiment(log, self.config))]
        judged = [self._judged(experiment) for experiment in seen]
        self.experiments = [_moving(experiment.rows(good)) for experiment, good in zip(seen, judged, strict=True)]
        cycles = sum(int(experiment.cycle.max()) for experiment in self.experiments)
        if cycles < FEWEST_CYCLES:
            names = ", ".join(experiment.log.source for experiment in self.experiments)
            raise BenchLogError(
                f"{names}: {cycles} cycles in all are too few to hold some out; at least {FEWEST_CYCLES} are wanted"
            )
        self.rests = [
            [r for r in find_rests(experiment, config.thermal.heat_capacity / config.thermal.heat_loss) if r.settled]
            for experiment in self.experiments
        ]
        if thin > 1:
            self.rests = [
                [dataclasses.replace(r, start=-(-r.start // thin), stop=r.stop // thin) for r in rests]
                for rests in self.rests
            ]
            self.rests = [[r for r in rests if r.stop > r.start] for rests in self.rests]
            self.experiments = [
                experiment.rows(np.arange(len(experiment.log)) % thin == 0) for experiment in self.experiments
            ]
        #: What the chain is given of every log, and which of it is judged.
        self._seen = [_thinned(experiment, good, thin) for experiment, good in zip(seen, judged, strict=True)]
        self._measured_m = [np.ascontiguousarray(t.displacement_m) for t in self.experiments]
        starts = [t.signals.time_s[0] for t in self.experiments]
        ends = [t.signals.time_s[-1] for t in self.experiments]
        #: One session where the logs follow each other on one clock; else each log is one.
        self.one_session = all(end < start for end, start in zip(ends, starts[1:], strict=False))
        every = max(1, math.ceil(sum(map(len, self._measured_m)) / COMPARED))
        #: Samples of every log that a residual is made of: neighbours say the same.
        self.compared = [np.arange(every // 2, len(m), every) for m in self._measured_m]
        known = self.calibration.expects and not beyond_floor
        self._expectation = Expectation(config) if known else None
        #: Of every log, for the model as it is: how far it is from half the way to one whose load was always what it is.
        self._always_so_m = [always_so_m(signals, self.chain({})) for signals, _ in self._seen] if known else []
        if beyond_floor:
            self._floor_m = [np.ones(len(rows)) for rows in self.compared]
            typical_m = np.sqrt(np.mean(np.concatenate(self.news_m(self.predict({}))) ** 2)) / SPREAD
            self._floor_m = [np.full(len(rows), typical_m) for rows in self.compared]
        else:
            self._floor_m = self._floors()
        self.unit, self.units = self._cut()
        self._rows()
        error = float(np.mean(self.errors_percent(self.predict({}))))
        if error > HOPELESS_percent:
            raise BenchLogError(
                f"{self.experiments[0].log.source}: the model errs by {error:.0f} % of full stroke on these logs; it is not of this wire, or "
                "circuit, load_cell or reference_sensor are those of another bench"
            )

    def _judged(self, experiment: Experiment) -> np.ndarray:
        """Which samples count, bool, shape (n,): those with a reference that the chain does not drop."""
        quality = self.chain({}).run(experiment.signals).quality
        return (quality != Quality.INVALID) & np.isfinite(experiment.displacement_m)

    def _cut(self) -> tuple[list[np.ndarray], int]:
        """Number of the unit of every sample, over all logs: a cycle, or as many as it takes to say something new.

        Blocks of time where there are too few of these.
        """
        parts, number = [], 0
        for experiment in self.experiments:
            unit = _lasting(experiment, UNIT_TIMES * self.independent_s)
            parts.append(unit + number)
            number += int(unit[-1]) + 1
        if number >= FEWEST_UNITS:
            return parts, number
        total = sum(len(t.log) for t in self.experiments)
        block = np.minimum(np.arange(total) * FEWEST_UNITS // total, FEWEST_UNITS - 1)
        bounds = np.cumsum([0, *(len(t.log) for t in self.experiments)])
        return [block[a:b] for a, b in itertools.pairwise(bounds)], FEWEST_UNITS

    @property
    def independent_s(self) -> float:
        """How far apart two samples are whose errors are independent, as the calibration has it; 0 where it is not known."""
        known = self.calibration.independent_time
        return known if math.isfinite(known) else 0.0

    def _rows(self) -> None:
        """Which unit each row of the residual belongs to, and its weight."""
        samples = np.concatenate([unit[rows] for unit, rows in zip(self.unit, self.compared, strict=True)])
        per_unit = np.maximum(np.bincount(samples, minlength=self.units), 1)
        #: Samples of every unit that say something new, shape (units,).
        self.independent = np.minimum(self._independent(), per_unit)
        self.sample_weight = np.sqrt(self.independent / per_unit)[samples]
        rests = [int(self.unit[i][r.start]) for i, rests in enumerate(self.rests) for r in rests]
        hot = np.array([r.hot for rests in self.rests for r in rests], dtype=int)
        self._springs = self._find_springs()
        #: Of each sample on a spring, which half of a unit it lies in: cooling or heating.
        halves = [2 * np.concatenate([self.unit[i] for i in logs]) + self._driven(logs) for logs in self._springs]
        self._half = [np.unique(half, return_inverse=True) for half in halves]
        straight = np.concatenate([half // 2 for half, _ in self._half] or [np.empty(0, dtype=int)])
        self._passages = [self._find_passages(i) for i in range(len(self.experiments))]
        powered = [int(self.unit[i][rows[0]]) for i, found in enumerate(self._passages) for _, rows in found]
        self.unit_of_row = np.concatenate(
            (samples, np.repeat(rests, 2).astype(int), straight, np.array(powered, dtype=int))
        )
        self.rows_of_samples = len(samples)
        # Of each row after those of the samples, into WITNESSES.
        self._witness = np.concatenate(
            (
                np.repeat(2 * hot, 2) + np.tile((0, 1), len(hot)),
                np.full(len(straight), LINE),
                np.full(len(powered), POWER),
            )
        )

    def _find_passages(self, number: int) -> list[tuple[bool, np.ndarray]]:
        """Where a log's power is held against the calibration's: see :func:`passages`."""
        if not self.knows_the_power:
            return []
        stress_Pa = self.experiments[number].stress_Pa
        return passages(self.calibration.share_of_stroke(self._measured_m[number], stress_Pa))

    @property
    def knows_the_power(self) -> bool:
        """Whether the calibration says what it takes to transform the wire, and how surely."""
        c = self.calibration
        sure = math.isfinite(c.transformation_scatter) and len(c.transformation_speed) == 4
        return c.transformation_known and sure

    def off_the_power(self, predictions: Sequence[Prediction]) -> np.ndarray:
        """How much warmer than at the calibration the heat balance calls the wire in each passage, in standard deviations."""
        out = [np.empty(0)]
        c, thermal = self.calibration, self.config.thermal
        if math.isfinite(c.ambient_temperature):  # where none is logged, it is that until an effect says otherwise
            thermal = dataclasses.replace(thermal, ambient_temperature=c.ambient_temperature)
        for i, (found, p) in enumerate(zip(self._passages, predictions, strict=True)):
            if not found:
                continue
            signals = dataclasses.replace(self.experiments[i].signals, stress_Pa=p.stress_Pa)
            share = c.share_of_stroke(self._measured_m[i] - p.beside_m, p.stress_Pa)
            off_K, ahead = warmer_K(signals, p.heat_W, share, c, thermal, found)
            usual = np.mean(np.reshape(c.transformation_speed, (2, 2)), axis=1)[[int(heating) for heating, _ in found]]
            rise_K = np.mean([*c.transformation_heating, *c.transformation_cooling]) - thermal.ambient_temperature
            known_K = math.hypot(c.transformation_scatter, BALANCE * rise_K)
            out.append(off_K / np.hypot(known_K, OTHER_SPEED * rise_K * (ahead - usual)))
        return np.concatenate(out)

    def _driven(self, logs: Sequence[int]) -> np.ndarray:
        return np.concatenate([self.experiments[i].driven for i in logs])

    def _find_springs(self) -> list[list[int]]:
        """Numbers of the logs in which the wire pulls a spring; those of one session together."""
        every = list(range(len(self.experiments)))
        found = []
        for logs in [every] if self.one_session else [[i] for i in every]:
            load_N = np.concatenate([self.experiments[i].signals.load_N for i in logs])
            measured_m = np.concatenate([self._measured_m[i] for i in logs])
            changes = np.subtract(*np.percentile(load_N, (99.0, 1.0))) > LOADS_DIFFER * abs(np.median(load_N))
            if changes and np.corrcoef(load_N, measured_m)[0, 1] ** 2 >= SPRING:
                found.append(logs)
        return found

    def off_the_line(self, predictions: Sequence[Prediction]) -> np.ndarray:
        """How far displacement and load lie off a straight line, in STRAIGHT: the mean of every heating and cooling.

        What drifts or lags in sensor or load cell bends the line of a spring; what the wire does, does not.
        """
        out = [np.empty(0)]
        for logs, (half, which) in zip(self._springs, self._half, strict=True):
            true_m = np.concatenate([self._measured_m[i] - predictions[i].sensor_m for i in logs])
            stress_Pa = np.concatenate([predictions[i].stress_Pa for i in logs])
            good = np.isfinite(true_m + stress_Pa)
            x, y = stress_Pa - stress_Pa[good].mean(), true_m - true_m[good].mean()
            off_m = np.where(good, y - x * (x[good] @ y[good]) / (x[good] @ x[good]), 0.0)
            mean_m = np.bincount(which, off_m, minlength=len(half)) / np.bincount(which, minlength=len(half))
            out.append(mean_m / (STRAIGHT * self.full_stroke_m))
        return np.concatenate(out)

    def _independent(self) -> np.ndarray:
        if not self.independent_s > 0.0:
            return np.full(self.units, INDEPENDENT)
        lasts_s = np.zeros(self.units)
        for experiment, unit in zip(self.experiments, self.unit, strict=True):
            step_s = np.diff(experiment.signals.time_s, prepend=experiment.signals.time_s[0])
            lasts_s += np.bincount(unit, step_s, minlength=self.units)
        return np.maximum(lasts_s / self.independent_s, 1.0)

    @property
    def expects_what_repeats(self) -> bool:
        """Whether what the model always leaves is expected; where it is not, that goes with all kinds of quantities itself."""
        return self._expectation is not None and any(self.calibration.expected_weights)

    @property
    def knows_its_scatter(self) -> bool:
        """Whether the calibration says how far off every witness usually is, and so what is unusual."""
        return self._expectation is not None

    @property
    def changed_percent(self) -> float:
        """How far the wire's hot end moved while it was calibrated, % of full stroke."""
        return self.calibration.changed / self.full_stroke_m * 100

    @property
    def start_s(self) -> float:
        """When the first session began."""
        return float(self.experiments[0].signals.time_s[0])

    @property
    def duration_s(self) -> float:
        """Length of the longest session."""
        first, last = self.experiments[0].signals.time_s[0], self.experiments[-1].signals.time_s[-1]
        return (
            float(last - first) if self.one_session else max(float(np.ptp(t.signals.time_s)) for t in self.experiments)
        )

    @property
    def measured_m(self) -> list[np.ndarray]:
        """Displacement by the reference sensor, of every log."""
        return self._measured_m

    def predict(self, effects: Mapping[str, Effect]) -> list[Prediction]:
        """Every log through the chain with ``effects`` beside those that the model has."""
        return self.through(self.chain(effects))

    def chain(self, effects: Mapping[str, Effect]) -> Chain:
        """The model's chain with ``effects`` beside those that it has."""
        return Chain(self.config, {**self.base, **effects})

    def through(self, chain: Chain) -> list[Prediction]:
        """Every log through a chain.  Between two logs of a session nobody saw the wire: only its position is forgotten."""
        out = []
        # What other surroundings do is news, until they are what is held against it.
        ambient_counts = any(effect.ALLOWS_FOR_AMBIENT for effect in chain.effects)
        for i, ((p, kept), rows) in enumerate(zip(self._judgements(chain), self.compared, strict=True)):
            here = np.arange(len(p.time_s))[kept][rows]
            expected_m = np.zeros(len(p.time_s))
            if self._expectation is not None:
                usual_m = self._expectation.residual_m(p, here, ambient_counts)
                expected_m = np.interp(p.time_s, p.time_s[here], usual_m)
                expected_m = expected_m + self._always_so_m[i] + SINCE_THEN * self._changed_m(p)
            where = _Where(chain, self.place, p, expected_m)
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

    def shown_m(self, lighter: float = 1.0) -> list[np.ndarray]:
        """What the reference sensor should show of every log by the model as it is, if the load were so many times less."""
        chain, out = self.chain({}), []
        for signals, kept in self._seen:
            chain.reset() if self.one_session else chain.begin_session()
            load_N, stress_Pa = signals.load_N / lighter, signals.stress_Pa / lighter
            out.append(chain.judge(dataclasses.replace(signals, load_N=load_N, stress_Pa=stress_Pa)).shown_m[kept])
        return out

    def _judgements(self, chain: Chain) -> Iterator[tuple[Judged, np.ndarray | slice]]:
        """What a chain makes of every log, and which samples of it count."""
        for signals, kept in self._seen:
            chain.reset() if self.one_session else chain.begin_session()
            yield chain.judge(signals), kept

    def _floors(self) -> list[np.ndarray]:
        """Mean absolute size of what is left of a residual beside what is expected [m], of every sample compared.

        That of the model as it is, whatever effect is looked for: all candidates are held against the same measure.
        """
        c = self.calibration
        if self._expectation is None:
            percent = max(c.error, c.largest_error) if c.known else FLOOR_percent
            return [np.full(len(rows), percent / 100 * self.full_stroke_m) for rows in self.compared]
        out = []
        for i, ((p, kept), rows) in enumerate(zip(self._judgements(self.chain({})), self.compared, strict=True)):
            here = np.arange(len(p.time_s))[kept][rows]
            floor_m = np.hypot(self._expectation.floor_m(p, here), self._always_so_m[i][here])
            out.append(np.hypot(floor_m, SINCE_THEN_WITHIN * self._changed_m(p)[here]))
        return out

    def _changed_m(self, found: Judged) -> np.ndarray:
        """How far the wire moved while it was calibrated, where it is now, of n samples: the hot end most."""
        if not self.calibration.changed:  # of most wires, and every step of every fit asks
            return np.zeros(len(found.time_s))
        frame = Frame.of(found.signals, float(found.time_s[0]))
        frame.displacement_m = found.model_m
        return self.calibration.changed * np.nan_to_num(left_in_place(self.place.share_of_stroke(frame)), nan=1.0)

    def residual(self, effects: Mapping[str, Effect]) -> np.ndarray:
        """Rows to be made small by a fit of ``effects`` (see :meth:`rows`)."""
        return self.rows(self.predict(effects))

    def rows(self, predictions: Sequence[Prediction]) -> np.ndarray:
        """Rows of which half the squares, summed over a cycle, are that cycle's loss.

        Samples first, log after log, then R and δ of every rest, then how straight a spring is; each in standard
        deviations, Huber-limited.
        """
        samples = [
            news_m / (SPREAD * floor_m) for news_m, floor_m in zip(self.news_m(predictions), self._floor_m, strict=True)
        ]
        others = np.concatenate(
            (self.at_rest(predictions), self.off_the_line(predictions), self.off_the_power(predictions))
        )
        return np.concatenate((limited(np.concatenate(samples)) * self.sample_weight, limited(others)))

    def news_m(self, predictions: Sequence[Prediction]) -> list[np.ndarray]:
        """Measured less shown displacement beyond what the calibration lets expect, of the samples compared, log by log."""
        return [
            (measured_m - p.shown_m)[rows] - p.expected_m
            for measured_m, p, rows in zip(self._measured_m, predictions, self.compared, strict=True)
        ]

    def at_rest(self, predictions: Sequence[Prediction]) -> np.ndarray:
        """R and δ of every rest against the calibration's, in its standard deviations, shape (2 · rests,)."""
        rests = [self._rest(i, rest, p) for i, p in enumerate(predictions) for rest in self.rests[i]]
        c = self.calibration
        range_Ohm = c.resistance_range if math.isfinite(c.resistance_range) else self._range_Ohm()
        return Usual(c, self.place.heat_loss_W_K, range_Ohm, self.full_stroke_m).off(rests).ravel()

    def _rest(self, number: int, rest: Rest, p: Prediction) -> AtRest:
        """What a rest of a log shows, if a prediction is right about circuit, load cell and sensor."""
        here = slice(rest.start, rest.stop)
        thermal = self.config.thermal
        time_constant_s = thermal.heat_capacity / thermal.heat_loss
        signals, stress_Pa = self.experiments[number].signals, float(np.mean(p.stress_Pa[here]))
        creeps_m = self._measured_m[number] - (p.shown_m - p.model_m)
        further_Ohm, further_m = (
            rest.further(values, signals.time_s, time_constant_s) for values in (p.resistance_Ohm, creeps_m)
        )
        read_C = np.broadcast_to(signals.ambient_temperature_C, len(creeps_m))[here]
        warmer_K = float(np.mean(read_C)) - self.calibration.ambient_temperature
        shown_m = self._measured_m[number] - p.beside_m
        return AtRest(
            hot=rest.hot,
            resistance_Ohm=float(np.mean(p.resistance_Ohm[here])) + (further_Ohm if rest.hot else 0.0),
            displacement_m=float(np.mean(shown_m[here])) + (0.0 if rest.hot else further_m),
            further_m=further_m,
            stress_Pa=stress_Pa,
            since_Pa=stress_Pa - float(p.stress_Pa[self._on_its_way(number, rest)]),
            heat_W=float(np.mean(p.heat_W[here])),
            beside_W=float(np.mean(p.heat_W[here] - p.power_W[here])),
            warmer_K=warmer_K if math.isfinite(warmer_K) else 0.0,
        )

    def _on_its_way(self, number: int, rest: Rest) -> int:
        """The last sample before a rest at which the wire was still a good way from it; the rest's first, where it never was."""
        measured_m = self._measured_m[number]
        away_m = np.abs(measured_m[: rest.start] - measured_m[rest.start])
        moving = np.flatnonzero(away_m > ON_ITS_WAY * self.full_stroke_m)
        return int(moving[-1]) if len(moving) else rest.start

    def _range_Ohm(self) -> float:
        return float(max(np.subtract(*np.nanpercentile(t.resistance_Ohm, (99.5, 0.5))) for t in self.experiments))

    def losses(self, rows: np.ndarray) -> np.ndarray:
        """Loss of every unit, shape (units,)."""
        return 0.5 * np.bincount(self.unit_of_row, rows**2, minlength=self.units)

    def rows_by_witness(self) -> dict[str, np.ndarray]:
        """Which rows each witness has (bool): the residual first, then those of WITNESSES of which there is something."""
        of_row = np.concatenate((np.full(self.rows_of_samples, -1), self._witness))
        named = {"residual": of_row == -1} | {name: of_row == k for k, name in enumerate(WITNESSES)}
        return {name: rows for name, rows in named.items() if rows.any()}

    def witnesses(self, rows: np.ndarray, units: np.ndarray) -> dict[str, float]:
        """How far each of WITNESSES is off in some units (bool), rms in standard deviations of the calibration.

        Without those of which there is nothing.
        """
        chosen = units[self.unit_of_row[self.rows_of_samples :]]
        witness, off = self._witness[chosen], rows[self.rows_of_samples :][chosen]
        number = np.bincount(witness, minlength=len(WITNESSES))
        squares = np.bincount(witness, off**2, minlength=len(WITNESSES))
        return {name: math.sqrt(s / n) for name, s, n in zip(WITNESSES, squares, number, strict=True) if n}

    def errors_percent(self, predictions: Sequence[Prediction]) -> np.ndarray:
        """Mean absolute error of every unit, % of full stroke, shape (units,)."""
        error_m = np.concatenate([np.abs(m - p.shown_m) for m, p in zip(self._measured_m, predictions, strict=True)])
        return self._per_unit(error_m) / self.full_stroke_m * 100

    def _per_unit(self, values: np.ndarray) -> np.ndarray:
        """Mean of every unit, shape (units,)."""
        unit, good = np.concatenate(self.unit), np.isfinite(values)
        number = np.bincount(unit[good], minlength=self.units)
        return np.bincount(unit[good], values[good], minlength=self.units) / np.maximum(number, 1)

    def news_percent(self, predictions: Sequence[Prediction]) -> np.ndarray:
        """Mean absolute size of the news of every unit, % of full stroke, shape (units,)."""
        return self._per_unit_compared(np.abs(np.concatenate(self.news_m(predictions)))) / self.full_stroke_m * 100

    @property
    def floor_percent(self) -> float:
        """What that is in the mean where there are none, at these places and with these histories, % of full stroke."""
        if self.beyond_floor:
            return 0.0
        return float(self._per_unit_compared(np.concatenate(self._floor_m)).mean()) / self.full_stroke_m * 100

    def _per_unit_compared(self, values: np.ndarray) -> np.ndarray:
        unit = self.unit_of_row[: self.rows_of_samples]
        number = np.bincount(unit, minlength=self.units)
        return np.bincount(unit, np.nan_to_num(values), minlength=self.units) / np.maximum(number, 1)

    @property
    def samples_of_unit(self) -> np.ndarray:
        """Number of samples of every unit, shape (units,)."""
        return np.bincount(np.concatenate(self.unit), minlength=self.units)


@dataclass(frozen=True, slots=True)
class _Where:
    """Where the wire is on a log, as far as is known: the model's displacement with the residual that is expected there.

    What follows it with a memory (play, a lag, a filter) follows the wire and not the model.
    """

    chain: Chain
    place: Place
    found: Judged
    expected_m: np.ndarray

    def shown_beside_the_model_m(self) -> np.ndarray:
        """What the reference sensor shows of the expected residual."""
        if not any(hasattr(effect, stage) for effect in self.chain.effects for stage in AFTER_THE_MODEL):
            return self.expected_m
        model_m = self.found.model_m
        # A model has nothing but the resistance to tell when the wire turns, and near its ends that is late.
        turns = dataclasses.replace(self, place=dataclasses.replace(self.place, resistance_range_Ohm=math.nan))
        return turns._through(model_m + self.expected_m, steady=True) - self._through(model_m)

    def beyond_the_load_m(self) -> np.ndarray:
        """How much further than where the load pulls the sensor shows the joint."""
        true_m = self.found.model_m + self.expected_m
        return self._through(true_m, steady=True, beyond_the_load=True) - true_m

    def _through(self, displacement_m: np.ndarray, steady: bool = False, beyond_the_load: bool = False) -> np.ndarray:
        """What the sensor shows of a displacement; ``beyond_the_load``: by what comes after the place that the load pulls at.

        ``steady``: what lies behind the load follows the wire, and not the noise of the resistance that tells where the
        wire is: a wire at rest leaves the play as it is, and noise would take it up.
        """
        acts = [
            (getattr(effect, stage), np.full(effect.STATES, np.nan), steady and effect.BEHIND_THE_LOAD)
            for stage in AFTER_THE_MODEL
            for effect in self.chain.effects
            if hasattr(effect, stage) and (stage == "shown" or effect.BEHIND_THE_LOAD or not beyond_the_load)
        ]
        if not acts:
            return displacement_m
        found = self.found
        frame = Frame.of(found.signals, float(found.time_s[0] - found.elapsed_s[0]))
        frame.heating, frame.cycles = found.branch.astype(bool), np.ones(len(displacement_m))
        frame.displacement_m = displacement_m.copy()
        for act, state, steadily in acts:
            noise_m = frame.displacement_m - smooth(frame.displacement_m, self._period_s) if steadily else 0.0
            frame.displacement_m = frame.displacement_m - noise_m
            act(frame, state, self.place)
            frame.displacement_m = frame.displacement_m + noise_m
        return frame.displacement_m

    @property
    def _period_s(self) -> float:
        return float(np.median(np.diff(self.found.time_s)))


def smooth(values: np.ndarray, period_s: float) -> np.ndarray:
    """Running mean over SMOOTHED_s of n values that are so far apart."""
    n = max(1, round(SMOOTHED_s / period_s))
    return np.convolve(np.pad(values, (n // 2, n - 1 - n // 2), mode="edge"), np.full(n, 1.0 / n), mode="valid")


def limited(z: np.ndarray) -> np.ndarray:
    """``z`` with Huber's loss as half its square; what is not finite counts as WORST."""
    z = np.clip(np.nan_to_num(z, nan=WORST, posinf=WORST, neginf=-WORST), -WORST, WORST)
    size = np.abs(z)
    return np.where(size <= LIMIT, z, np.sign(z) * np.sqrt(np.maximum(LIMIT * (2.0 * size - LIMIT), 0.0)))


def _thinned(experiment: Experiment, good: np.ndarray, thin: int) -> tuple[Signals, np.ndarray | slice]:
    """Every ``thin``-th of the good samples, with what the chain drops between them; and which of these are good."""
    if good.all() and thin == 1:
        return experiment.signals, slice(None)
    fed = ~good | ((np.cumsum(good) - 1) % thin == 0)
    return experiment.rows(fed).signals, good[fed]


def _lasting(experiment: Experiment, least_s: float) -> np.ndarray:
    """Number of the unit of every sample: cycles, as many together as last at least ``least_s``."""
    cycle = np.maximum(experiment.cycle, min(1, int(experiment.cycle.max())))
    starts = np.concatenate(([0], np.flatnonzero(np.diff(cycle)) + 1))
    time_s = experiment.signals.time_s
    kept = [0]
    for start in starts[1:]:
        if time_s[start] - time_s[kept[-1]] >= least_s and time_s[-1] - time_s[start] >= 0.5 * least_s:
            kept.append(int(start))
    return np.searchsorted(kept, np.arange(len(cycle)), side="right") - 1


def _moving(experiment: Experiment) -> Experiment:
    """The experiment; raises BenchLogError where a channel never moves or the log is shorter than a cycle."""
    for name, values, unit in (
        ("the resistance", experiment.resistance_Ohm, "Ω"),
        ("the measured displacement", experiment.displacement_m, "m"),
        ("the current", experiment.signals.current_A, "A"),
    ):
        if not np.ptp(values) > 1e-3 * abs(float(np.median(values))):
            raise BenchLogError(
                f"{experiment.log.source}: {name} never moves ({values[0]:.4g} {unit} throughout); a log of a wire that is driven is wanted"
            )
    turns = np.diff(experiment.driven.astype(int))
    if not ((turns > 0).any() and (turns < 0).any()):
        raise BenchLogError(
            f"{experiment.log.source}: is shorter than a cycle: the current must be switched on and off again at least once"
        )
    return experiment
