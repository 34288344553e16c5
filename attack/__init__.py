"""The attack on the driver: everything that can go wrong, at random, judged by what is promised and what is true.

``python -m attack`` runs it (``make attack``); ``tests/attack`` runs a short one.  Nothing here asks the code under
test whether it did well: the judge knows the printed table of faults (docs/faults.md), the parameter file, and what the
virtual bench says is so.  Every attack is seeded; a violation names the seed that shows it again.
"""
