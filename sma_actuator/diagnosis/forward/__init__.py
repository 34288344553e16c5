"""From power to displacement: fit the physics of a wire against a spring to a real bench, and find what it lacks."""

from .command import add_arguments, run

__all__ = ["add_arguments", "run"]
