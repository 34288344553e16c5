"""Time as a wait counts it, on a machine that may stop any process for a while."""

import time

#: Of the time between two looks no more counts: the rest is a process that did not run.
MOST_OF_A_LOOK_s = 0.1


class Elapsed:
    """How long this process has waited and looked."""

    def __init__(self):
        self._seconds, self._looked_s = 0.0, time.monotonic()

    def look(self):
        """Seconds so far."""
        now_s = time.monotonic()
        self._seconds += min(now_s - self._looked_s, MOST_OF_A_LOOK_s)
        self._looked_s = now_s
        return self._seconds
