"""From bench logs to a calibrated parameter file."""

from .command import add_arguments, run
from .identification import Identification, identify
from .traces import IdentificationError

__all__ = ["Identification", "IdentificationError", "add_arguments", "identify", "run"]
