"""From setpoint and displacement to a current."""
