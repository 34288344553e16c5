"""What a wire and its model looked like on the logs they were identified from, and how later logs are held against
that.

A file for each thing that is known, with a section of its name in ``calibration``
(:class:`sma_actuator.base.calibration.Calibration`): how it is learned, and how it is looked up.

* :mod:`.rest`: R and δ where the wire stands still;
* :mod:`.power`: the temperatures, by the heat balance, at which it transforms;
* :mod:`.hot_end`: the contracted wire, and the way back;
* :mod:`.training`: whether it changed meanwhile;
* :mod:`.interval`: what the model leaves at a place of its loop, for the live interval;
* :mod:`.expectation`: what it leaves at a place with a history, for a trace.
"""

from .learning import calibration_of

__all__ = ["calibration_of"]
