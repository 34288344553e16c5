"""From a residual to the effect the model lacks, and from there to an extended model."""

from .command import add_arguments, run
from .evidence import Evidence
from .tracing import Tracing, trace

__all__ = ["Evidence", "Tracing", "add_arguments", "run", "trace"]
