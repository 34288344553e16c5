"""Drive a shape memory alloy wire as an actuator that is its own position sensor."""

__version__ = "0.2.0"
