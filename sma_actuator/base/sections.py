"""Sections of parameters that several rooms share: the wire, and the time of the loop."""

from __future__ import annotations

import math
from dataclasses import dataclass

from .parameters import parameter


@dataclass(frozen=True, slots=True)
class Wire:
    """The wire itself."""

    alloy: str = parameter(description="alloy of the wire", choices=("ni-ti", "ni-ti-cu"))
    length: float = parameter(
        description="length between the crimps, slack taken out",
        unit="m",
        lo=0.005,
        hi=20.0,
        hint="metres are wanted: 100 mm is 0.100",
    )
    diameter: float = parameter(
        description="diameter of the wire",
        unit="m",
        lo=10e-6,
        hi=2e-3,
        hint="metres are wanted: 0.1524 mm is 0.1524e-3",
    )
    full_stroke_strain: float = parameter(
        0.04, "strain that counts as 100 % of stroke in every error", "1", 0.001, 0.12
    )
    max_stress: float = parameter(175e6, "stress the wire must never see", "Pa", 1e6, 1e9, live=True)

    @property
    def area_m2(self) -> float:
        """Cross-section of the wire."""
        return math.pi * self.diameter**2 / 4.0

    @property
    def full_stroke_m(self) -> float:
        """Displacement that counts as 100 % in every error."""
        return self.full_stroke_strain * self.length


@dataclass(frozen=True, slots=True)
class Loop:
    """Timing of the control loop."""

    rate: float = parameter(20.0, "readings, estimates and commands per second", "Hz", 1.0, 1000.0)
    sample_rate: float = parameter(1000.0, "raw samples per second and channel, averaged in blocks", "Hz", 1.0, 1e6)
    samples_per_block: int = parameter(50, "raw samples averaged into one reading", "1", 1, 100000)
    overruns_to_fault: int = parameter(
        10, "consecutive missed deadlines that count as a fault", "1", 1, 10000, live=True
    )
