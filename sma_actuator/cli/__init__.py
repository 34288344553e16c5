"""The edge to a person: the command sma-actuator."""
