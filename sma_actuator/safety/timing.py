"""The times that several guards share."""

from __future__ import annotations

from .formula import parameter_value

#: Time after enabling in which only the bias current flows, to find out where the wire is.
SETTLING_TIME_s = 0.25
#: Readings with current that settling takes at least.
SETTLING_READINGS = 3
#: An output that was told to be on may read back as off for so long, as behind a relay or a soft start.
COMES_ON_s = 1.0

RATE = parameter_value("loop.rate")
ONE_STEP = 1 / RATE
TWO_STEPS = 2 / RATE
THREE_STEPS = 3 / RATE
READING_TIMEOUT = parameter_value("safety.reading_timeout")
