"""What hangs on the wire."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf


def _check(name: str, value: float) -> None:
    if not 0.0 <= value < inf:
        raise ValueError(f"{name} {value:g} is not a number of at least zero")


@dataclass(frozen=True, slots=True)
class Weight:
    """A constant tension [N]."""

    force_N: float

    def __post_init__(self) -> None:
        _check("weight", self.force_N)

    def at(self, time_s: float) -> tuple[float, float, float]:
        """Tension [N], stiffness [N/m] and the displacement [m] where the tension holds."""
        return self.force_N, 0.0, 0.0


@dataclass(frozen=True, slots=True)
class Spring:
    """A spring that the wire stretches as it contracts: F = preload + k (δ_preload − δ), never below zero."""

    stiffness_N_m: float
    preload_N: float
    preload_displacement_m: float = 0.004

    def __post_init__(self) -> None:
        _check("stiffness", self.stiffness_N_m)
        _check("preload", self.preload_N)
        _check("displacement of the preload", self.preload_displacement_m)

    def at(self, time_s: float) -> tuple[float, float, float]:
        """As :meth:`Weight.at`."""
        return self.preload_N, self.stiffness_N_m, self.preload_displacement_m


@dataclass(frozen=True, slots=True)
class Schedule:
    """Loads that replace one another: ``[(time_s, load), ...]``, in order of time; the first holds before too."""

    steps: Sequence[tuple[float, Weight | Spring]]

    def __post_init__(self) -> None:
        times = [time_s for time_s, _ in self.steps]
        if not times or times != sorted(times):
            raise ValueError("a schedule of loads needs at least one (time_s, load), in order of time")

    def at(self, time_s: float) -> tuple[float, float, float]:
        """As :meth:`Weight.at`."""
        current = self.steps[0][1]
        for start_s, load in self.steps:
            if start_s <= time_s + 1e-9:
                current = load
        return current.at(time_s)


Load = Weight | Spring | Schedule


def parse_load(text: str) -> Load:
    """A load in words: ``weight:N``, ``spring:N/m,N[,m]`` or ``schedule:s,N,s,N,…``.  Raises ValueError."""
    kind, _, values = text.partition(":")
    try:
        numbers = [float(v) for v in values.split(",")]
        if kind == "weight" and len(numbers) == 1:
            return Weight(*numbers)
        if kind == "spring" and len(numbers) in (2, 3):
            return Spring(*numbers)
        if kind == "schedule" and len(numbers) % 2 == 0:
            return Schedule([(t, Weight(f)) for t, f in zip(numbers[::2], numbers[1::2], strict=True)])
    except ValueError as error:
        raise ValueError(f"'{text}' is no load: {error}") from error
    raise ValueError(f"'{text}' is no load; weight:N, spring:N/m,N[,m] or schedule:s,N,s,N is wanted")
