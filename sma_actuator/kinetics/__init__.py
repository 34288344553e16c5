"""Strain against temperature at constant stress: what an isobaric loop says of a wire's kinetics."""

from .command import add_arguments, run

__all__ = ["add_arguments", "run"]
