"""What is wrong with a log."""

from sma_actuator.base.errors import UserError


class BenchLogError(UserError, ValueError):
    """A log that cannot be used.  The message names file, line and column, and what would be right."""
