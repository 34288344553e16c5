"""The logs as the whole-range model learns from them: thinned, with copies in which something is off, and cut into
folds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sma_actuator.estimation.models.heat_content import (
    DIRECT,
    PLAYS_K,
    PLAYS_OF_RANGE,
    REMEMBERED,
    at_usual_load,
    features_all,
    resistances_of,
    thermal_numbers,
)
from sma_actuator.estimation.models.orientation import OHM_PER_m, longer_all_m, nothing_known
from sma_actuator.identify.ranges import ONE_LOAD
from sma_actuator.logs.experiments import Experiment, IdentificationError, begins_anew
from sma_actuator.logs.kinds import load_numbers

from .cold_wire import begins_cold, cold_wire
from .earlier_load import of_earlier_load
from .learner import ROBUST, AlongStress

FOLDS = 3
NEVER = -1  #: left out
#: That the learners of the model see, logs of more are thinned; and that those see which judge it or find its heat
#: balance, which is most of the work.  With as few as these the model was off by a quarter more.
MOST_ROWS, FEWER_ROWS = 27000, 9000
#: Readings closer together are averaged, since they say the same; of a quick wire in this part of its time constant.
#: Learned from steps three times as long as those of its loop, 37 µm was off by 1.6 % there, from steps as long by 0.6.
SHORTEST_STEP_s, SHORTEST_STEP = 0.045, 1.0 / 30.0
#: Bends along stress are shrunk the more the fewer loads there are than usual, by the square of how much further these
#: are apart, as what is between two of them goes with it.
USUAL_LOADS = 5
#: Share of the widest range of the resistance that the narrowest under another load has at least: of four wires it was
#: 0.65 to 0.92.
LEAST_SPAN = 0.3
#: A heat balance fitted to pulses is off by some tenths of a kelvin or more when the wire is driven otherwise.  Copies
#: of the logs with such an error [K] teach the learners not to lean on it where the resistance says more; copies with
#: the other one are for the intervals alone.
LEARNED_ERROR_K, JUDGED_ERROR_K = 0.5, 1.5


class _Samples(NamedTuple):
    """Of a log, or of all one after the other; each (n,)."""

    time_s: np.ndarray
    power_W: np.ndarray
    ambient_C: np.ndarray
    resistance_Ohm: np.ndarray
    stress_Pa: np.ndarray
    displacement_m: np.ndarray
    heating: np.ndarray  #: bool
    cycle: np.ndarray  #: its number
    earlier: np.ndarray  #: bool: an earlier load has moved it


class Data:
    """The logs' samples one after the other, thinned to what a fit needs; displacement in % of the full stroke."""

    def __init__(self, experiments: Sequence[Experiment], config):
        self.config, self.wire, self.thermal = config, config.wire, config.thermal
        self.percent_m = config.wire.full_stroke_m / 100.0
        cycles = sum(int(t.cycle[-1]) for t in experiments)
        if len(experiments) < FOLDS and cycles < FOLDS:
            raise IdentificationError(
                f"whole_range: {FOLDS} logs or cycles at least are needed, some to be left out while the others are "
                f"fitted; there {'is' if cycles == 1 else 'are'} {cycles}: heat and cool the wire more often"
            )
        step_s = min(SHORTEST_STEP_s, SHORTEST_STEP * config.thermal.balance.time_constant_s)
        # An error counts as it is up to ROBUST.
        earlier = of_earlier_load(experiments, config.thermal.balance.time_constant_s, ROBUST * self.percent_m)
        own = [
            _thinned(t, others, config.thermal.ambient_temperature, step_s)
            for t, others in zip(experiments, earlier, strict=True)
        ]
        load = load_numbers(experiments)
        loads = int(load.max()) + 1
        parts = [*own, *_copies(own, loads == 1)]
        copies = len(parts) // len(own)
        every = _Samples(*(np.concatenate(column) for column in zip(*parts, strict=True)))
        self.time, self.power, self.ambient = every.time_s, every.power_W, every.ambient_C
        self.resistance, self.stress = every.resistance_Ohm, every.stress_Pa
        self.displacement, self.heating, self.cycle = every.displacement_m / self.percent_m, every.heating, every.cycle
        ends_m, self.ends_Ohm = _ends(experiments, parts)
        self.ends = ends_m / self.percent_m
        lengths = [len(p.time_s) for p in parts]
        self.lengths = lengths[: len(experiments)]
        self.first = np.zeros(len(self.time), dtype=np.bool_)
        self.first[np.cumsum([0, *lengths[:-1]])] = begins_anew(experiments) * copies
        self.cold_wire = cold_wire(experiments, config, self.ends * self.percent_m)
        if self.cold_wire is not None:
            self._without_what_it_is_longer(parts)
        #: Between which stresses the model is, and its resistances are.
        self.stress_Pa = float(self.stress.min()), float(self.stress.max())
        if not _alike(self.ends_Ohm, self.stress_Pa):
            self.ends_Ohm = np.array([[0.0, 0.0], [1.0, 0.0]])
        hot_Ohm, cold_Ohm = self.ends_Ohm
        resistances = resistances_of(hot_Ohm, cold_Ohm, self.stress_Pa)
        self.resistance = at_usual_load(self.resistance, self.stress, resistances)
        powers = self.stress[:, None] ** np.arange(3)
        hot, cold = powers @ self.ends[0], powers @ self.ends[1]
        self.share = np.clip((self.displacement - hot) / (cold - hot), 0.0, 1.0)
        of_log = np.repeat(np.tile(np.arange(len(experiments)), copies), lengths)
        folds = _log_folds(experiments, own, load)
        self.cuts_logs = any(len(np.unique(each)) > 1 for each in folds)  #: whole ones are not left out
        self.log_fold = np.concatenate(folds * copies)
        self.load, self.load_fold = load[of_log], _load_folds(load)[of_log]
        self.cycle = self.cycle + of_log
        stride = max(1, -(-len(self.time) // MOST_ROWS))
        rows = np.arange(0, len(self.time), stride)
        self.rows = rows[~every.earlier[rows]]
        self.fewer = np.arange(len(self.rows)) % -(-len(self.rows) // FEWER_ROWS) == 0
        self.measured = self.rows < sum(self.lengths)  # the others are of copies
        self.learned = self.rows < 2 * sum(self.lengths)
        #: Rows whose spread is the unit of a feature; a single load has none but in the copies.
        self.scaling_rows = self.rows if loads == 1 else self.rows[self.measured]
        self.along_stress = AlongStress(max(1.0, ((USUAL_LOADS - 1) / max(loads - 1, 1)) ** 2), straight=loads == 2)
        self.span_Ohm = float(np.subtract(*np.percentile(self.resistance, (99, 1))))

    def along_stress_of(self, learned: np.ndarray) -> AlongStress:
        """The same where only those rows are learned: of three loads without the one between, two tell of a line."""
        straight = len(np.unique(self.load[self.rows[learned]])) == 2
        return self.along_stress._replace(straight=straight)

    def _without_what_it_is_longer(self, parts: Sequence[_Samples]) -> None:
        """Leave displacement and resistance as if all martensite had formed under the load of its sample."""
        assert self.cold_wire is not None
        longer_m = np.empty(len(self.time))
        cold = [begins_cold(p.power_W / self.thermal.heat_loss, p.displacement_m, p.stress_Pa) for p in parts]
        of_cold = np.repeat(cold, [len(p.time_s) for p in parts])
        usual_m = np.interp(self.stress, self.cold_wire.stress_Pa, self.cold_wire.displacement_m)
        longer_all_m(
            self.displacement * self.percent_m,
            self.stress,
            self.first,
            np.where(of_cold, usual_m, np.nan),
            self.ends * self.percent_m,
            self.cold_wire.known,
            nothing_known(),
            longer_m,
        )
        self.displacement = self.displacement - longer_m / self.percent_m
        self.resistance = self.resistance - self.cold_wire.resistance[OHM_PER_m] * longer_m

    def thermal_numbers(self, known: np.ndarray) -> np.ndarray:
        """The heat balance for the kernels, from numbers in units of what is known."""
        return thermal_numbers(known, self.thermal, self.span_Ohm)

    @property
    def plays_Ohm(self) -> np.ndarray:
        """Half-widths of the plays in resistance."""
        return np.array(PLAYS_OF_RANGE) * self.span_Ohm

    def features(self, known: np.ndarray, measured: bool = False) -> np.ndarray:
        """What the model sees of every sample, shape (n, features); of what was ``measured``, without the copies."""
        n = sum(self.lengths) if measured else len(self.time)
        out = np.empty((n, DIRECT + len(PLAYS_K) + len(PLAYS_OF_RANGE)))
        features_all(
            time=self.time[:n],
            power=self.power[:n],
            ambient=self.ambient[:n],
            resistance=self.resistance[:n],
            stress=self.stress[:n],
            share=self.share[:n],
            first=self.first[:n],
            thermal=self.thermal_numbers(known),
            widths_K=np.array(PLAYS_K),
            widths_Ohm=self.plays_Ohm,
            state=np.zeros(REMEMBERED + out.shape[1] - DIRECT),
            out=out,
        )
        return out


def _thinned(experiment: Experiment, earlier: np.ndarray, ambient_C: float, step_s: float) -> _Samples:
    """A log's good samples, as many together as make a step of that; their power is the mean.

    ``earlier``: those that an earlier load has moved, bool, shape (n,).
    """
    s = experiment.signals
    good = np.isfinite(s.resistance_Ohm + s.stress_Pa + s.power_W + s.reference_displacement_m + s.time_s)
    time_s = s.time_s[good]
    together = max(1, round(step_s / max(float(np.median(np.diff(time_s))), 1e-6)))
    n = len(time_s) // together * together
    ambient = np.broadcast_to(s.ambient_temperature_C, good.shape)[good]
    ambient = np.where(np.isfinite(ambient), ambient, ambient_C)

    def last(values: np.ndarray) -> np.ndarray:
        return np.ascontiguousarray(values[:n].reshape(-1, together)[:, -1])

    return _Samples(
        last(time_s),
        s.power_W[good][:n].reshape(-1, together).mean(axis=1),
        last(ambient).astype(float),
        last(s.resistance_Ohm[good]),
        last(s.stress_Pa[good]),
        last(s.reference_displacement_m[good]),
        last(experiment.heating[good]),
        last(experiment.cycle[good]),
        last(earlier[good]),
    )


def _ends(experiments: Sequence[Experiment], parts: Sequence[_Samples]) -> tuple[np.ndarray, np.ndarray]:
    """Hot and cold end of the stroke [m] as quadratics in stress, shape (2, 3), and the wire's resistance there [Ω] as
    lines, shape (2, 2); lower orders where there are fewer loads."""
    logs = list(zip(experiments, parts, strict=False))
    # A log throughout which the wire is as an earlier load left it says nothing of its own load's ends.
    known = [(t, p) for t, p in logs if not p.earlier.all()] or logs
    load, full = load_numbers([t for t, _ in known]), np.array([t.kind != "partial" for t, _ in known])
    # Partial cycles come to the cold end, if to any.
    at_hot_end = full if full.any() else ~full
    at_cold_end = full | ~np.isin(load, load[full])
    ends_m, ends_Ohm = np.zeros((2, 3)), np.zeros((2, 2))
    for end, which in enumerate((at_hot_end, at_cold_end)):
        found = np.array([_end(part, end) for (_, part), counts in zip(known, which, strict=True) if counts])
        most = len(np.unique(load[which])) - 1
        ends_m[end] = _in_stress(found[:, 0], found[:, 1], 2, most)
        ends_Ohm[end] = _in_stress(found[:, 0], found[:, 2], 1, most)
    return ends_m, ends_Ohm


def _end(part: _Samples, end: int) -> tuple[float, float, float]:
    """Stress [Pa], place [m] and resistance [Ω] where a log has the wire nearest to its hot (0) or cold end (1)."""
    own = ~part.earlier | part.earlier.all()
    displacement_m = part.displacement_m[own]
    ends_m = np.percentile(displacement_m, (0.5, 99.5))
    away_m = (displacement_m - ends_m[0]) if end == 0 else (ends_m[1] - displacement_m)
    near = away_m <= 0.02 * (ends_m[1] - ends_m[0])
    stress_Pa, resistance_Ohm = (float(np.median(x[own][near])) for x in (part.stress_Pa, part.resistance_Ohm))
    return stress_Pa, float(ends_m[end]), resistance_Ohm


def _in_stress(stress_Pa: np.ndarray, values: np.ndarray, order: int, most: int) -> np.ndarray:
    """A polynomial of an order in stress, or of the ``most`` that the loads allow; shape (order + 1,)."""
    out, fitted = np.zeros(order + 1), min(order, most)
    out[: fitted + 1] = np.polynomial.polynomial.polyfit(stress_Pa / 1e8, values, fitted) / 1e8 ** np.arange(fitted + 1)
    return out


def _alike(ends_Ohm: np.ndarray, stress_Pa: tuple[float, float]) -> bool:
    """Whether what is between the hot and the cold wire's resistance is of one size and sign under all loads; logs of
    parts of the stroke do not show it."""
    spans_Ohm = np.polynomial.polynomial.polyval(np.array(stress_Pa), ends_Ohm[1] - ends_Ohm[0])
    spans_Ohm *= np.sign(spans_Ohm[0])
    return bool(min(spans_Ohm) > LEAST_SPAN * max(spans_Ohm))


def _copies(parts: Sequence[_Samples], one_load: bool) -> list[_Samples]:
    """The same logs with what the heat balance may have wrong: those that are learned, then those that judge."""
    rng = np.random.default_rng(0)
    out = [_with_other_surroundings(p, error_K, rng) for error_K in (LEARNED_ERROR_K, JUDGED_ERROR_K) for p in parts]
    return [_with_another_load(p, rng) for p in out] if one_load else out


def _with_other_surroundings(part: _Samples, error_K: float, rng: np.random.Generator) -> _Samples:
    """The same log as if the heat balance were off by a slowly changing temperature."""
    off_K = np.zeros(len(part.time_s))
    for period_s in (11.0, 37.0, 131.0):
        off_K += rng.normal() * np.sin(2.0 * np.pi * (part.time_s / period_s + rng.uniform()))
    return part._replace(ambient_C=part.ambient_C + error_K * off_K)


def _with_another_load(part: _Samples, rng: np.random.Generator) -> _Samples:
    """The same log as if the load slowly wandered about, within ONE_LOAD: of how the loop goes with it one load says
    nothing."""
    phase = 2.0 * np.pi * (part.time_s / 23.0 + rng.uniform())
    return part._replace(stress_Pa=part.stress_Pa * (1.0 + ONE_LOAD * np.sin(phase)))


def _thirds(cycle: np.ndarray) -> np.ndarray:
    """A fold for every sample of a log: its cycles in as many stretches, one after the other."""
    return np.minimum(np.maximum(cycle - 1, 0) * FOLDS // max(int(cycle[-1]), 1), FOLDS - 1)


def _log_folds(experiments: Sequence[Experiment], own: Sequence[_Samples], load: np.ndarray) -> list[np.ndarray]:
    """A fold for every sample of each log, so that none leaves a load out: logs of neighbouring loads, and of one load,
    are in different ones; a log that is its load's only one is cut in three, as are all of a few long ones."""
    number = np.empty(len(load), dtype=int)
    number[np.argsort([t.mean_stress_Pa for t in experiments], kind="stable")] = np.arange(len(load)) % FOLDS
    alone = (np.bincount(load)[load] == 1) | (len(load) < FOLDS)
    return [
        _thirds(p.cycle) if cut else np.full(len(p.cycle), fold)
        for p, cut, fold in zip(own, alone, number, strict=True)
    ]


def _load_folds(load: np.ndarray) -> np.ndarray:
    """A fold for every log: all logs of a load in one, but those of the lightest and of the heaviest load in none."""
    return np.where((load == 0) | (load == load.max()), NEVER, (load - 1) % FOLDS)
