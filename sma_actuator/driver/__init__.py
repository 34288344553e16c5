"""The loop that drives one wire in a thread.

``driver``: its life, and what others may ask; ``requests``: how that is handed over; ``loop``: one step, from reading
to command; ``output``: what is known of the supply's output, and every word that changes it; ``watchman``: who looks
whether the loop still lives; ``link``: an instrument that may not answer; ``statistics``: how well the loop keeps its
period."""

from .driver import OFF_MEANWHILE, Driver
from .link import NOT_ASKED
from .loop import CHECK_PERIOD_s
from .output import CURRENT_RESOLUTION_A
from .requests import DriverStopped
from .statistics import LoopStatistics

__all__ = [
    "CURRENT_RESOLUTION_A",
    "NOT_ASKED",
    "OFF_MEANWHILE",
    "CHECK_PERIOD_s",
    "Driver",
    "DriverStopped",
    "LoopStatistics",
]
