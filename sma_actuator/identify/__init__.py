"""From bench logs to a calibrated parameter file."""

from sma_actuator.logs.experiments import IdentificationError

from .identification import Identification, identify

__all__ = ["Identification", "IdentificationError", "identify"]
