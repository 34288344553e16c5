"""The machine's clock, for whoever drives real instruments."""

from __future__ import annotations

import time


class MonotonicClock:
    """Monotonic time: it never jumps, whatever happens to the time of day."""

    now_s = staticmethod(time.monotonic)  #: [s]; a dozen times in a step, so without a call around it

    def sleep_until_s(self, deadline_s: float) -> None:
        """Return at ``deadline_s`` or, when it has passed, at once."""
        left_s = deadline_s - time.monotonic()
        if left_s > 0.0:
            time.sleep(left_s)
