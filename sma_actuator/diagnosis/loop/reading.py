"""An isobaric loop: strain and stress while the temperature goes to its other end and comes back."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from sma_actuator.base.errors import UserError

COLUMNS = ("temperature_C", "strain", "stress_MPa")
SHORTEST = 40  #: samples
_SMOOTHED = 9  #: samples over which the stress of a loop is averaged: the load frame hunts


@dataclass(frozen=True)
class Loop:
    """Samples as measured, in the order in which they were."""

    name: str
    temperature_C: np.ndarray
    strain: np.ndarray
    stress_Pa: np.ndarray
    turn: int  #: index at which it begins to come back

    @cached_property
    def mean_stress_Pa(self) -> float:
        """What the loop was meant to be at."""
        return float(self.stress_Pa.mean())

    @cached_property
    def smooth_stress_Pa(self) -> np.ndarray:
        """The stress at each sample, without the noise of the load cell."""
        padded = np.pad(self.stress_Pa, _SMOOTHED // 2, mode="edge")
        return np.convolve(padded, np.full(_SMOOTHED, 1.0 / _SMOOTHED), mode="valid")

    @cached_property
    def branches(self) -> tuple[slice, slice]:
        """Heating and cooling."""
        first, second = slice(0, self.turn + 1), slice(self.turn, len(self.temperature_C))
        return (first, second) if self.temperature_C[self.turn] > self.temperature_C[0] else (second, first)

    @cached_property
    def ends(self) -> tuple[float, float]:
        """Strain at the hot end and at the cold one."""
        order = np.argsort(self.temperature_C)
        few = max(3, len(order) // 50)
        return float(np.median(self.strain[order[-few:]])), float(np.median(self.strain[order[:few]]))

    @property
    def stroke(self) -> float:
        """Strain between the two ends."""
        return self.ends[1] - self.ends[0]


def read_loop(path: str | Path) -> Loop:
    """Read temperature [°C], strain and stress [MPa]: CSV with these columns, or three columns without a header.

    Raises UserError, which names file and line, for what is no isobaric loop.
    """
    path = Path(path)
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise UserError(f"{path}: cannot be read ({getattr(error, 'strerror', None) or error})") from error
    rows = [(number, line.replace(",", " ").split()) for number, line in enumerate(lines, 1) if line.strip()]
    if not rows:
        raise UserError(f"{path}: is empty")
    places: tuple[int, ...] = (0, 1, 2)
    if not _is_number(rows[0][1][0]):
        places = _places(path, rows.pop(0)[1])
    elif len(rows[0][1]) != len(COLUMNS):
        raise UserError(
            f"{path}: line {rows[0][0]}: {len(rows[0][1])} columns and no header; a header that names {', '.join(COLUMNS)} is "
            "wanted, or these three and no more"
        )
    values = np.array([_numbers(path, number, words, places) for number, words in rows])
    if len(values) < SHORTEST:
        raise UserError(f"{path}: {len(values)} samples are no loop; at least {SHORTEST} are wanted")
    temperature_C, strain, stress_Pa = values[:, 0].copy(), values[:, 1].copy(), 1e6 * values[:, 2]
    return Loop(path.stem, temperature_C, strain, stress_Pa, _turn(path, temperature_C))


def _places(path: Path, names: list[str]) -> tuple[int, ...]:
    missing = [name for name in COLUMNS if name not in names]
    if missing:
        raise UserError(f"{path}: line 1: no column {missing[0]}; {', '.join(COLUMNS)} are wanted")
    return tuple(names.index(name) for name in COLUMNS)


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _numbers(path: Path, number: int, words: list[str], places: tuple[int, ...]) -> list[float]:
    try:
        values = [float(words[place]) for place in places]
    except (ValueError, IndexError):
        values = [np.nan]
    if not np.isfinite(values).all():
        raise UserError(f"{path}: line {number}: temperature, strain and stress are wanted, three numbers")
    return values


def _turn(path: Path, temperature_C: np.ndarray) -> int:
    low_C, high_C = float(temperature_C.min()), float(temperature_C.max())
    if high_C - low_C < 10.0:
        raise UserError(f"{path}: the temperature spans {high_C - low_C:.1f} K; a loop wants at least 10 K")
    middle_C = 0.5 * (low_C + high_C)
    # A little hysteresis, so that noise about the middle does not count as a crossing.
    side = np.where(temperature_C > middle_C + 2.0, 1, np.where(temperature_C < middle_C - 2.0, -1, 0))
    side = side[side != 0]
    crossings = int((np.diff(side) != 0).sum())
    if crossings != 2:
        raise UserError(
            f"{path}: the temperature passes {middle_C:.0f} °C {crossings} times; one loop passes its middle twice: there and back"
        )
    return int(np.argmax(temperature_C) if temperature_C[0] < middle_C else np.argmin(temperature_C))
