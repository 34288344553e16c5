"""What a number was lately: another instrument, which is late, shows it as it was then."""

from __future__ import annotations

from collections import deque
from math import inf

from .drift import LAG_s

#: So many readings it may be behind, however slowly they come; else LAG_s.
LAG_READINGS = 2
_ROUNDING_s = 1e-9


class Lately:
    """The values of the last :data:`~sma_actuator.safety.drift.LAG_s`, and of as many readings as one may be behind."""

    __slots__ = ("_seen",)

    def __init__(self) -> None:
        self._seen: deque[tuple[float, float]] = deque()

    def note(self, now_s: float, value: float) -> None:
        """What it is now.  A clock that goes back begins anew."""
        seen = self._seen
        if seen and now_s < seen[-1][0]:
            seen.clear()
        seen.append((now_s, value))
        while len(seen) > LAG_READINGS + 1 and now_s - seen[0][0] > LAG_s + _ROUNDING_s:
            seen.popleft()

    def off_by(self, shown: float) -> float:
        """How far ``shown`` is from all that it was and what lies between; NaN where it is none."""
        if shown != shown:
            return shown
        values = [value for _, value in self._seen if value == value]
        return max(min(values) - shown, shown - max(values), 0.0) if values else inf
