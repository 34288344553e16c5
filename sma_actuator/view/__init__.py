"""A running node in the browser: what the wire does, and what a person may ask of it.

A process of its own that is a ROS client, so that the control loop does not notice it: ``wire`` speaks to the node,
``server`` to the pages, ``logs`` replays what is dropped on a page, ``page/`` is what the browser gets.
"""

from .command import add_arguments, run

__all__ = ["add_arguments", "run"]
