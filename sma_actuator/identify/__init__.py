"""From bench logs to a calibrated parameter file."""

from .command import add_arguments, run
from .experiments import IdentificationError
from .identification import Identification, identify

__all__ = ["Identification", "IdentificationError", "add_arguments", "identify", "run"]
