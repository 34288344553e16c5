"""A run of a bench: time, duty of the bridge, position of the slider."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from sma_actuator.base.errors import UserError

from .wire import nearest

COLUMNS = ("time_s", "duty_cycle", "slider_position_m")
SHORTEST = 100  #: samples
IDLE_DUTY = 1e-3  #: below it nothing heats
_STEP_S = 0.1  #: of the fit; the position moves 1 mm in it at most, and is averaged over it


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
        return max(1, int(round(_STEP_S / self.period_s)))

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


def read_run(path: str | Path) -> Run:
    """Read and check a CSV; every complaint names file, line and column."""
    path = Path(path)
    try:
        with path.open(newline="", encoding="utf-8-sig") as stream:
            rows = list(csv.reader(stream))
    except OSError as error:
        raise UserError(f"{path}: cannot be read ({error.strerror or error})") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise UserError(f"{path}: is not a CSV file in UTF-8 ({error})") from error
    if not rows:
        raise UserError(f"{path}: line 1: the file is empty; a header row with {', '.join(COLUMNS)} is wanted")
    names = [name.strip() for name in rows[0]]
    for column in COLUMNS:
        if column not in names:
            raise UserError(
                f"{path}: line 1: column {column} is missing{nearest(column, names)}; found {', '.join(names)}"
            )
    where = [names.index(column) for column in COLUMNS]
    values = np.empty((len(rows) - 1, 3))
    count = 0
    for line, row in enumerate(rows[1:], 2):
        if not any(field.strip() for field in row):
            continue
        if len(row) != len(names):
            raise UserError(f"{path}: line {line}: {len(row)} fields where the header has {len(names)}")
        for j, (column, index) in enumerate(zip(COLUMNS, where, strict=True)):
            try:
                values[count, j] = float(row[index])
            except ValueError:
                raise UserError(f"{path}: line {line}, column {column}: '{row[index]}' is not a number") from None
            if not np.isfinite(values[count, j]):
                raise UserError(f"{path}: line {line}, column {column}: {row[index].strip()} is not a finite number")
        if count and values[count, 0] <= values[count - 1, 0]:
            raise UserError(
                f"{path}: line {line}, column time_s: time does not advance, {values[count - 1, 0]:.6g} s then {values[count, 0]:.6g} s"
            )
        if not 0.0 <= values[count, 1] <= 1.0:
            raise UserError(
                f"{path}: line {line}, column duty_cycle: {values[count, 1]:g} is outside 0 to 1; is it in percent?"
            )
        count += 1
    if count < SHORTEST:
        raise UserError(f"{path}: {count} samples; a run of at least {SHORTEST} is wanted")
    values = values[:count]
    step_s = np.diff(values[:, 0])
    if step_s.max() > 5.0 * np.median(step_s) + 1e-9:
        bad = int(np.argmax(step_s))
        raise UserError(
            f"{path}: line {bad + 3}, column time_s: a gap of {step_s[bad]:.4g} s where {np.median(step_s):.4g} s is usual"
        )
    if np.ptp(values[:, 2]) == 0.0:
        raise UserError(f"{path}: column slider_position_m: the slider never moves; there is nothing to fit")
    return Run(path.stem, values[:, 0].copy(), values[:, 1].copy(), values[:, 2].copy())
