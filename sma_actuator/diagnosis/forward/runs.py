"""A run of a bench: time, duty of the bridge, position of the slider."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from sma_actuator.base.errors import UserError
from sma_actuator.logs.formats import read_table
from sma_actuator.logs.mapping import ColumnMap

from .wire import nearest

COLUMNS = ("time_s", "duty_cycle", "slider_position_m")
SHORTEST = 100  #: samples
IDLE_DUTY = 1e-3  #: below it nothing heats
_STEP_s = 0.1  #: of the fit; the position moves 1 mm in it at most, and is averaged over it


@dataclass(frozen=True)
class Run:
    """Samples as measured."""

    name: str
    time_s: np.ndarray
    duty: np.ndarray
    position_m: np.ndarray

    @property
    def period_s(self) -> float:
        """Mean sampling period."""
        return float((self.time_s[-1] - self.time_s[0]) / (len(self.time_s) - 1))

    @cached_property
    def block(self) -> int:
        """Samples averaged into one step of the fit."""
        return max(1, round(_STEP_s / self.period_s))

    @cached_property
    def step_s(self) -> float:
        """Step of the fit."""
        return self.block * self.period_s

    def _mean(self, values: np.ndarray) -> np.ndarray:
        n = len(values) // self.block
        return values[: n * self.block].reshape(n, self.block).mean(axis=1)

    @cached_property
    def coarse_duty(self) -> np.ndarray:
        """Duty averaged over each step of the fit."""
        return self._mean(self.duty)

    @cached_property
    def coarse_time_s(self) -> np.ndarray:
        """Middle of each step of the fit."""
        return self._mean(self.time_s)

    @cached_property
    def coarse_position_m(self) -> np.ndarray:
        """Position above the run's zero, averaged over each step of the fit."""
        return self._mean(self.position_m) - self.zero_m

    @cached_property
    def zero_m(self) -> float:
        """Position before any power: known without looking at how the wire then moves."""
        idle = int(np.argmax(self.duty > IDLE_DUTY)) if (self.duty > IDLE_DUTY).any() else len(self.duty)
        return float(np.median(self.position_m[: max(idle, 1)]))

    @property
    def stroke_m(self) -> float:
        """Largest excursion."""
        return float(np.ptp(self.coarse_position_m))


def read_run(
    path: str | Path,
    columns: ColumnMap = ColumnMap(known=COLUMNS),  # noqa: B008 - it is frozen
    say: Callable[[str], None] = lambda sentence: None,
) -> Run:
    """Read and check a run; every complaint names file, line and column."""
    table = columns.apply(read_table(Path(path)))
    for note in table.notes:
        say(f"{Path(path).name}: {note}")
    for column in COLUMNS:
        if column not in table.columns:
            names = list(table.columns)
            raise UserError(
                f"{path}: line 1: column {column} is missing{nearest(column, names)}; found {', '.join(names)}"
            )
    time_s, duty, position_m = (table.columns[column] for column in COLUMNS)
    for column in COLUMNS:
        values = table.columns[column]
        if not np.isfinite(values).all():
            bad = int(np.argmin(np.isfinite(values)))
            raise UserError(
                f"{path}: line {table.first_line + bad}, column {column}: {values[bad]:g} is not a finite number"
            )
    step_s = np.diff(time_s)
    if (step_s <= 0.0).any():
        bad = int(np.argmax(step_s <= 0.0))
        raise UserError(
            f"{path}: line {table.first_line + bad + 1}, column time_s: time does not advance, {time_s[bad]:.6g} s "
            f"then {time_s[bad + 1]:.6g} s"
        )
    outside = (duty < 0.0) | (duty > 1.0)
    if outside.any():
        bad = int(np.argmax(outside))
        raise UserError(
            f"{path}: line {table.first_line + bad}, column duty_cycle: {duty[bad]:g} is outside 0 to 1; is it in "
            f"percent?"
        )
    if len(time_s) < SHORTEST:
        raise UserError(f"{path}: {len(time_s)} samples; a run of at least {SHORTEST} is wanted")
    if step_s.max() > 5.0 * np.median(step_s) + 1e-9:
        bad = int(np.argmax(step_s))
        raise UserError(
            f"{path}: line {table.first_line + bad + 1}, column time_s: a gap of {step_s[bad]:.4g} s where "
            f"{np.median(step_s):.4g} s is usual"
        )
    if np.ptp(position_m) == 0.0:
        raise UserError(f"{path}: column slider_position_m: the slider never moves; there is nothing to fit")
    return Run(Path(path).stem, *(np.ascontiguousarray(values) for values in (time_s, duty, position_m)))
