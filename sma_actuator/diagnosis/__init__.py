"""From a residual to the physical effect that a model lacks."""
