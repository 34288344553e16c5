"""What a strain model is, and the registry of them."""

from __future__ import annotations

from math import nan
from typing import Protocol, runtime_checkable

import numpy as np

from sma_actuator.base.errors import UserError
from sma_actuator.base.registry import Registry
from sma_actuator.base.sections import Wire
from sma_actuator.base.signals import Value


class Coefficients(Protocol):
    """The coefficients of one type of strain model: the section ``model`` of a parameter file."""

    def build(self, wire: Wire) -> StrainModel | ThermalStrainModel:
        """The model of ``wire``."""

    def mismatches(self, wire: Wire) -> list[str]:
        """Why the coefficients do not suit ``wire``, one sentence each."""


class ModelError(UserError):
    """A strain model that cannot do what it is for.  The sentence names it."""


class StrainModel(Protocol):
    """One strain model of one wire, with its memory.  SI units; extension positive."""

    stress_range_Pa: tuple[float, float]  #: the stresses its coefficients were fitted on
    displacement_range_m: tuple[float, float]  #: its working range, the determinate part of the stroke

    def reset(self, resistance_Ohm: float, stress_Pa: float, heating: bool = False) -> float:
        """Forget the past and start on the cooling (or heating) curve; return δ [m]."""

    def step(self, resistance_Ohm: float, stress_Pa: float, heating: bool) -> float:
        """Advance by one sample; return δ [m]."""

    def run(self, resistance_Ohm: np.ndarray, stress_Pa: np.ndarray, heating: np.ndarray) -> np.ndarray:
        """Advance by n samples, arrays of shape (n,); return δ [m], shape (n,).

        The same kernel as :meth:`step`, so the numbers are the same.
        """

    def limits_m(self, resistance_Ohm: Value, stress_Pa: Value) -> tuple[Value, Value]:
        """Displacements of the heating and the cooling curve at R and σ, (δ_H, δ_C) [m]; of one sample or of n."""


@runtime_checkable
class ThermalStrainModel(Protocol):
    """A strain model that keeps a heat balance beside the resistance, and says how sure it is of every sample."""

    stress_range_Pa: tuple[float, float]  #: the stresses its coefficients were fitted on
    displacement_range_m: tuple[float, float]  #: where the wire can be driven to, whatever hangs on it
    stroke_m: tuple[float, float]  #: the stroke it was fitted on, both ends included
    follows_loads: bool  #: whether it knows how long martensite is that formed under another load
    longer_m: float  #: how much longer it is in the last sample that was observed

    def reset(self, power_W: float = nan) -> None:
        """Forget the past: the next sample is that of a wire at rest, in balance with this power; NaN: with its own."""

    def observe(
        self, time_s: float, resistance_Ohm: float, stress_Pa: float, heating: bool, power_W: float, ambient_C: float
    ) -> tuple[float, float, bool]:
        """Advance by one sample: δ [m], half of its 95 % interval [m], and whether the calibration has seen the like.

        ``ambient_C`` is NaN where it is not measured.
        """

    def observe_all(
        self,
        time_s: np.ndarray,
        resistance_Ohm: np.ndarray,
        stress_Pa: np.ndarray,
        heating: np.ndarray,
        power_W: np.ndarray,
        ambient_C: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The same of n samples, arrays of shape (n,), by the same kernel, so the numbers are the same."""

    def doubt(self, displacement_m: np.ndarray) -> np.ndarray:
        """How unsure it is at places, shape (n,), one over the other; in no unit."""


def _refusal(_name: str, cls: type) -> str:
    missing = [method for method in ("build", "mismatches") if not callable(getattr(cls, method, None))]
    return f"{cls.__name__} has no {' and no '.join(missing)}" if missing else ""


#: The section ``model`` for each ``model.type``.
COEFFICIENTS: Registry[type] = Registry("strain model", "sma_actuator.models", _refusal)
