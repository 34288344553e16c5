"""Logs of one wire as they are traced: cut at their pauses, without what says nothing, thinned where they are long."""

from __future__ import annotations

import copy
import dataclasses
import itertools
import math
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from sma_actuator.base.signals import Quality, Signals
from sma_actuator.calibration.rest import Rest, find_rests
from sma_actuator.config import Config
from sma_actuator.estimation.chain import Chain, Judged
from sma_actuator.logs.bench_log import BenchLog
from sma_actuator.logs.cycles import cycle_numbers
from sma_actuator.logs.errors import BenchLogError
from sma_actuator.logs.experiments import Experiment, make_experiment, sessions

UNIT_TIMES = 4.0  #: a unit lasts at least so many times as long as errors remember themselves
FEWEST_CYCLES = 3  #: in all logs together
FEWEST_UNITS = 8
MOVES = 1e-3  #: of its median: a channel whose readings differ by no more never moves
MOST_SAMPLES = 40_000  #: samples that the chain sees; longer logs are thinned …
MOST_COMPARED = 4_000  #: … and so many of them at the most are compared with the measured displacement


class Prepared:
    """Logs of one wire: of one session in the order of their clocks, else as they are given, session after session.

    Raises BenchLogError: no reference, another wire, a channel that does not move, less than a cycle.
    """

    def __init__(
        self, logs: Sequence[BenchLog], config: Config, chain: Callable[[], Chain], independent_s: float = 0.0
    ):
        """``chain``: makes a chain of the model as it is, which drops what it cannot judge; ``independent_s``: how far
        apart two samples are whose errors are independent."""
        by_clock = sorted(logs, key=lambda log: float(log["time_s"][0]))
        if all(log["time_s"][0] > before["time_s"][-1] for before, log in itertools.pairwise(by_clock)):
            logs = by_clock
        self._time_constant_s = config.thermal.heat_capacity / config.thermal.heat_loss
        self._period_s = max((log.period_s for log in logs if len(log) > 1), default=math.inf)
        self._least_thin = max(1, math.ceil(sum(map(len, logs)) / MOST_SAMPLES))
        self._independent_s = independent_s
        self._judged = []
        for log in logs:
            experiment = make_experiment(log, config)
            pieces = sessions(experiment)
            self._judged += _with_a_cycle(pieces, chain)
        moving = [_moving(counted) for _, _, counted in self._judged]
        cycles = sum(int(experiment.cycle.max()) for experiment in moving)
        if cycles < FEWEST_CYCLES:
            names = ", ".join(experiment.log.source for experiment in moving)
            raise BenchLogError(
                f"{names}: {cycles} cycles in all are too few to hold some out; at least {FEWEST_CYCLES} are wanted"
            )
        self._thin(self._least_thin)

    def seldom(self, readings: float) -> Prepared:
        """The same with so many readings within the wire's time constant, where there are more."""
        out = copy.copy(self)
        out._thin(max(self._least_thin, int(self._time_constant_s / (readings * self._period_s))))
        return out

    def _thin(self, thin: int) -> None:
        """Take every ``thin``-th of the samples."""
        #: Where the wire rests, in every log.
        self.rests = [_settled(experiment, self._time_constant_s, thin) for _, _, experiment in self._judged]
        #: What the chain is given of every log, and which of it is judged.
        self.seen = [_thinned(experiment, rows, thin) for experiment, rows, _ in self._judged]
        #: That.
        self.experiments = [_every(thin, experiment) for _, _, experiment in self._judged]
        #: Displacement by the reference sensor, of every log.
        self.measured_m = [np.ascontiguousarray(t.displacement_m) for t in self.experiments]
        starts = [float(t.signals.time_s[0]) for t in self.experiments]
        ends = [float(t.signals.time_s[-1]) for t in self.experiments]
        #: Of every log, whether a session begins with it; else its clock goes on from the one before it.
        self.begins = [i == 0 or start <= ends[i - 1] for i, start in enumerate(starts)]
        every = max(1, math.ceil(sum(map(len, self.measured_m)) / MOST_COMPARED))
        #: Samples of every log that a residual is made of: neighbours say the same.
        self.compared = [np.arange(every // 2, len(m), every) for m in self.measured_m]
        #: The same among all that the chain is given.
        self.compared_seen = [
            np.arange(len(signals.time_s))[kept][rows]
            for (signals, kept), rows in zip(self.seen, self.compared, strict=True)
        ]
        #: Number of the unit of every sample, over all logs; and how many units there are.
        self.unit, self.units = _units(self.experiments, UNIT_TIMES * self._independent_s)

    def followed_by(self, chain: Chain, given: Callable[[Signals], Signals] = lambda s: s) -> Iterator[Judged]:
        """What a chain makes of every log, or of what is ``given`` it in its place.

        Between two logs of a session nobody saw the wire: only its position is forgotten.
        """
        sessions = zip(self.seen, self.begins, self.before_s, strict=True)
        for (signals, _), begins, before_s in sessions:
            chain.begin_session(before_s) if begins else chain.reset()
            yield chain.judge(given(signals))

    @property
    def lasts_s(self) -> np.ndarray:
        """How long each unit lasts, shape (units,)."""
        out_s = np.zeros(self.units)
        for experiment, of_sample in zip(self.experiments, self.unit, strict=True):
            time_s = experiment.signals.time_s
            out_s += np.bincount(of_sample, np.diff(time_s, prepend=time_s[0]), minlength=self.units)
        return out_s

    @property
    def start_s(self) -> float:
        """When the first session began."""
        return float(self.experiments[0].signals.time_s[0])

    @property
    def sessions(self) -> list[list[int]]:
        """Numbers of the logs of each session."""
        number = np.cumsum(self.begins)
        return [[int(i) for i in np.flatnonzero(number == k)] for k in range(1, int(number[-1]) + 1)]

    @property
    def duration_s(self) -> float:
        """Length of the longest session."""
        return max(self._sessions_last_s)

    @property
    def together_s(self) -> float:
        """Length of all sessions, one after the other."""
        return sum(self._sessions_last_s)

    @property
    def before_s(self) -> list[float]:
        """Of every log, how long the sessions before its own lasted."""
        before_s = [0.0, *itertools.accumulate(self._sessions_last_s)]
        return [before_s[number] for number, on in enumerate(self.sessions) for _ in on]

    @property
    def _sessions_last_s(self) -> list[float]:
        time_s = [t.signals.time_s for t in self.experiments]
        return [float(time_s[on[-1]][-1] - time_s[on[0]][0]) for on in self.sessions]


def _settled(experiment: Experiment, time_constant_s: float, thin: int) -> list[Rest]:
    """The rests of an experiment at which the wire has come to rest, in every ``thin``-th of its samples."""
    settled = [rest for rest in find_rests(experiment, time_constant_s) if rest.settled]
    thinned = [dataclasses.replace(rest, start=-(-rest.start // thin), stop=rest.stop // thin) for rest in settled]
    return [rest for rest in thinned if rest.stop > rest.start]


def _with_a_cycle(
    pieces: Sequence[Experiment], chain: Callable[[], Chain]
) -> list[tuple[Experiment, np.ndarray, Experiment]]:
    """Of the pieces of a log that paused, those that have a cycle of what counts, or the first if none has; which of
    its samples count; and these."""
    judged = [(piece, rows, _counted(piece, rows)) for piece in pieces for rows in [_judged(piece, chain())]]
    return [each for each in judged if _cycled(each[2].driven)] or judged[:1]


def _counted(experiment: Experiment, rows: np.ndarray) -> Experiment:
    """The samples that count; where a controller never let go of the current, in cycles of the branches."""
    counted = experiment.rows(rows)
    if _cycled(counted.driven):
        return counted
    return dataclasses.replace(counted, driven=counted.heating, cycle=cycle_numbers(counted.heating))


def _cycled(driven: np.ndarray) -> bool:
    """Whether the wire was heated and cooled again, or the other way round."""
    turns = np.diff(driven.astype(int))
    return bool((turns > 0).any() and (turns < 0).any())


def _judged(experiment: Experiment, chain: Chain) -> np.ndarray:
    """Which samples count, bool, shape (n,): those with a reference that the chain does not drop."""
    quality = chain.run(experiment.signals).quality
    return (quality != Quality.INVALID) & np.isfinite(experiment.displacement_m)


def _thinned(experiment: Experiment, good: np.ndarray, thin: int) -> tuple[Signals, np.ndarray | slice]:
    """Every ``thin``-th of the good samples, with what the chain drops between them; and which of these are good."""
    if good.all() and thin == 1:
        return experiment.signals, slice(None)
    fed = ~good | ((np.cumsum(good) - 1) % thin == 0)
    return experiment.rows(fed).signals, good[fed]


def _every(thin: int, experiment: Experiment) -> Experiment:
    """Every ``thin``-th of its samples."""
    return experiment if thin == 1 else experiment.rows(np.arange(len(experiment.log)) % thin == 0)


def _units(experiments: Sequence[Experiment], least_s: float) -> tuple[list[np.ndarray], int]:
    """Number of the unit of every sample: a cycle, or as many as last ``least_s``, which say something new together.

    Blocks of time where there are too few of these.
    """
    parts, number = [], 0
    for experiment in experiments:
        unit = _lasting(experiment, least_s)
        parts.append(unit + number)
        number += int(unit[-1]) + 1
    if number >= FEWEST_UNITS:
        return parts, number
    total = sum(len(t.log) for t in experiments)
    block = np.minimum(np.arange(total) * FEWEST_UNITS // total, FEWEST_UNITS - 1)
    bounds = np.cumsum([0, *(len(t.log) for t in experiments)])
    return [block[a:b] for a, b in itertools.pairwise(bounds)], FEWEST_UNITS


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
        if not np.ptp(values) > MOVES * abs(float(np.median(values))):
            raise BenchLogError(
                f"{experiment.log.source}: {name} never moves ({values[0]:.4g} {unit} throughout); a log of a wire "
                f"that is driven is wanted"
            )
    if not _cycled(experiment.driven):
        raise BenchLogError(
            f"{experiment.log.source}: is shorter than a cycle: the wire must be heated and cool again at least once"
        )
    return experiment
