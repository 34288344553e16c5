"""The virtual bench: the physics of a wire in a test stand, and the instruments around it.

Nothing here knows of the estimator, its models or the measuring circuit's equations: the bench
stands for the world, and shares no mathematics with what is judged against it.
"""
