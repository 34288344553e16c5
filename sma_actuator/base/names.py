"""Names that several rooms share, and that nothing need be imported for."""

NODE_NAME = "sma_actuator"  #: of a node that is given no other
