"""The loop that drives one wire in a thread: ``loop``; its instruments, and how they answer: ``link``; how well it keeps
its period: ``statistics``."""

from .link import NOT_ASKED
from .loop import CURRENT_RESOLUTION_A, OFF_MEANWHILE, CHECK_PERIOD_s, Driver, DriverStopped
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
