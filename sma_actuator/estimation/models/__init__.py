"""Strain models: resistance and stress in, displacement out.

A model is a file of its own: the dataclass of its coefficients, registered with ``@COEFFICIENTS.register("its
model.type")``, which builds the model of a wire and says why it does not suit one (:class:`Coefficients`), and the
model itself (:class:`StrainModel`, or :class:`ThermalStrainModel` where it needs the power too).  What fits it to logs
is registered in ``sma_actuator.identify``.
"""

from . import flexinol, furukawa, whole_range
from .model import COEFFICIENTS, Coefficients, ModelError, StrainModel, ThermalStrainModel

__all__ = [
    "COEFFICIENTS",
    "Coefficients",
    "ModelError",
    "StrainModel",
    "ThermalStrainModel",
    "flexinol",
    "furukawa",
    "whole_range",
]
