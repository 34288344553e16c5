"""An isobaric loop: strain and stress while the temperature goes to its other end and comes back."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from sma_actuator.base.content import content_of
from sma_actuator.base.errors import UserError
from sma_actuator.logs.mapping import ColumnMap
from sma_actuator.logs.sense import MOST_STROKE
from sma_actuator.logs.text import read_text
from sma_actuator.logs.unpacking import SMALL_B

COLUMNS = ("temperature_C", "strain", "stress_Pa")
HOTTEST_C, MOST_STRESS_Pa = 300.0, 1.5e9  #: what no wire does: above 200 °C there is no loop to see, and 1 GPa tears it
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


def read_loop(path: str | Path, columns: ColumnMap = ColumnMap(known=COLUMNS)) -> Loop:  # noqa: B008 - it is frozen
    """Read temperature, strain and stress: a table with these columns in any unit that their names say, as ``strain_%``
    or ``Stress (MPa)``, or that ``columns`` says; or three columns without a header, in °C, 1 and MPa.

    Raises UserError, which names file and line, for what is no isobaric loop, and for what no wire can do.
    """
    path = Path(path)
    try:
        content = content_of(path, SMALL_B)
        lines = content.decode("utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise UserError(f"{path}: cannot be read ({getattr(error, 'strerror', None) or error})") from error
    if len(content) > SMALL_B:
        raise UserError(f"{path}: is longer than {SMALL_B / 1e6:g} MB; one loop is wanted")
    rows = [(number, words) for number, line in enumerate(lines, 1) if (words := line.replace(",", " ").split())]
    if not rows:
        raise UserError(f"{path}: is empty")
    if _is_number(rows[0][1][0]):
        temperature_C, strain, stress_Pa = _without_a_header(path, rows)
    else:
        table = columns.apply(read_text(path))
        missing = [name for name in COLUMNS if name not in table.columns]
        if missing:
            raise UserError(
                f"{path}: line 1: no column {missing[0]}; {', '.join(COLUMNS)} are wanted, in any unit that the name "
                f"says (strain_%, stress_MPa), or say which it is: --map {missing[0]}=THEIRS --unit {missing[0]}=UNIT"
            )
        temperature_C, strain, stress_Pa = (table.columns[name] for name in COLUMNS)
        bad = ~np.isfinite(temperature_C + strain + stress_Pa)
        if bad.any():
            line = table.first_line + int(np.argmax(bad))
            raise UserError(f"{path}: line {line}: temperature, strain and stress are wanted, three numbers")
    if len(strain) < SHORTEST:
        raise UserError(f"{path}: {len(strain)} samples are no loop; at least {SHORTEST} are wanted")
    _possible(path, temperature_C, strain, stress_Pa)
    return Loop(path.stem, temperature_C, strain, stress_Pa, _turn(path, temperature_C))


def _without_a_header(path: Path, rows: list[tuple[int, list[str]]]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    if len(rows[0][1]) != len(COLUMNS):
        raise UserError(
            f"{path}: line {rows[0][0]}: {len(rows[0][1])} columns and no header; a header that names "
            f"{', '.join(COLUMNS)} is wanted, or these three and no more"
        )
    values = np.array([_numbers(path, number, words) for number, words in rows])
    return values[:, 0].copy(), values[:, 1].copy(), 1e6 * values[:, 2]


def _possible(path: Path, temperature_C: np.ndarray, strain: np.ndarray, stress_Pa: np.ndarray) -> None:
    """Raise UserError where a unit must be another than was taken."""
    stroke = float(np.subtract(*np.percentile(strain, (99.0, 1.0))))
    if stroke > MOST_STROKE:
        raise UserError(
            f"{path}: a strain of {stroke:.0%} from end to end is more than any wire has (at most {MOST_STROKE:.0%}); "
            "is it in percent? Name the column strain_%, or say --unit strain=%"
        )
    if (hottest_C := float(temperature_C.max())) > HOTTEST_C:
        raise UserError(
            f"{path}: {hottest_C:.0f} °C is hotter than any loop of a wire; is it in kelvin or fahrenheit? Name the "
            "column temperature_K, or say --unit temperature_C=K"
        )
    if (largest_Pa := float(np.abs(stress_Pa).max())) > MOST_STRESS_Pa:
        raise UserError(
            f"{path}: {largest_Pa / 1e6:.0f} MPa is more than a wire bears; is the stress in another unit? Name the "
            "column stress_Pa, or say --unit stress_Pa=kPa"
        )


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _numbers(path: Path, number: int, words: list[str]) -> list[float]:
    try:
        values = [float(word) for word in words]
    except ValueError:
        values = [np.nan]
    if len(values) != len(COLUMNS) or not np.isfinite(values).all():
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
            f"{path}: the temperature passes {middle_C:.0f} °C {crossings} times; one loop passes its middle twice: "
            f"there and back"
        )
    return int(np.argmax(temperature_C) if temperature_C[0] < middle_C else np.argmin(temperature_C))
