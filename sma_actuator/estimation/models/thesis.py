"""What the thesis's two models have in common: the coefficients of one wire (exclusive) or of any of an alloy
(normalised)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from sma_actuator.base.parameters import parameter
from sma_actuator.base.sections import Wire

from .checks import wrong_ranges, wrong_size
from .model import COEFFICIENTS


def wrong_form(model_type: str, wire: Wire) -> list[str]:
    """A sentence where a model that holds for any size is used for a coil: its resistance does not follow its
    stretch."""
    if wire.form != "coil":
        return []
    return [f"model.type: {model_type} is a model of straight wires, but wire.form is coil; identify it as whole_range"]


def wrong_alloy(model_type: str, wire: Wire) -> list[str]:
    """A sentence when a model, by its name, is of another alloy than the wire."""
    alloy = getattr(COEFFICIENTS[model_type], "ALLOY", wire.alloy)
    if alloy == wire.alloy:
        return []
    return [f"model.type: {model_type} is a model of {alloy}, but wire.alloy is {wire.alloy}"]


@dataclass(frozen=True, slots=True)
class _Coefficients:
    ALLOY: ClassVar[str]  #: ``wire.alloy`` of the wires it is for

    stress_range: tuple[float, ...] = parameter(
        description="lowest and highest stress of the calibration", unit="Pa", lo=-1e9, hi=1e9
    )

    def mismatches(self, wire: Wire) -> list[str]:
        """Why these coefficients do not suit ``wire``."""
        return [*wrong_alloy(COEFFICIENTS.name_of(type(self)), wire), *wrong_ranges(stress_range=self.stress_range)]


@dataclass(frozen=True, slots=True)
class ExclusiveCoefficients(_Coefficients):
    """Those of a model of one particular wire."""

    calibrated_length: float = parameter(
        description="length of the wire the coefficients were fitted on", unit="m", lo=0.005, hi=20.0
    )
    calibrated_diameter: float = parameter(description="its diameter", unit="m", lo=10e-6, hi=2e-3)
    calibrated_form: str = parameter("", "its form, where it is no straight wire (docs/coils.md)", optional=True)
    displacement_range: tuple[float, ...] = parameter(
        description="determinate part of the stroke", unit="m", lo=-10.0, hi=10.0
    )

    def mismatches(self, wire: Wire) -> list[str]:
        """Why these coefficients do not suit ``wire``."""
        return [
            *_Coefficients.mismatches(self, wire),
            *wrong_size(self.calibrated_length, self.calibrated_diameter, self.calibrated_form, wire),
            *wrong_ranges(displacement_range=self.displacement_range),
        ]


@dataclass(frozen=True, slots=True)
class NormalisedCoefficients(_Coefficients):
    """Those of a model of any wire of an alloy."""

    strain_range: tuple[float, ...] = parameter(description="determinate part of the stroke", unit="1", lo=-1.0, hi=1.0)

    def mismatches(self, wire: Wire) -> list[str]:
        """Why these coefficients do not suit ``wire``."""
        return [
            *_Coefficients.mismatches(self, wire),
            *wrong_form(COEFFICIENTS.name_of(type(self)), wire),
            *wrong_ranges(strain_range=self.strain_range),
        ]
