"""The machine's clock, for whoever drives real instruments."""

from __future__ import annotations

import time


class MonotonicClock:
    """Monotonic time: it never jumps, whatever happens to the time of day."""

    def now_s(self) -> float:
        """Monotonic time [s]."""
        return time.monotonic()

    def sleep_until_s(self, deadline_s: float) -> None:
        """Return at ``deadline_s`` or, when it has passed, at once."""
        left_s = deadline_s - time.monotonic()
        if left_s > 0.0:
            time.sleep(left_s)
