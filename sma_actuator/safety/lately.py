"""What a number was lately: another instrument, which is late, shows it as it was then."""

from __future__ import annotations

from collections import deque
from math import inf

from .drift import LAG_s

#: So many readings it may be behind, however slowly they come; else LAG_s.
LAG_READINGS = 2
#: That count, and the longest ago, with what rounding makes of the time.
_FEWEST, _LONGEST_s = LAG_READINGS + 1, LAG_s + 1e-9
_ROOM = 256  #: for all that come in that time, at the highest loop.rate


class Lately:
    """The values of the last :data:`~sma_actuator.safety.drift.LAG_s`, and of as many readings as one may be behind; of
    one number, or of several that are noted together."""

    __slots__ = ("_seen",)

    def __init__(self) -> None:
        self._seen: deque[tuple[float, tuple[float, ...]]] = deque(maxlen=_ROOM)

    def note(self, now_s: float, *values: float) -> None:
        """What each is now.  A clock that goes back begins anew."""
        seen = self._seen
        if seen and now_s < seen[-1][0]:
            seen.clear()
        seen.append((now_s, values))

    def off_by(self, shown: float, number: int = 0) -> float:
        """How far ``shown`` is from all that the one of this number was and what lies between; NaN where it is none."""
        if shown != shown:
            return shown
        seen = self._seen
        while len(seen) > _FEWEST and seen[-1][0] - seen[0][0] > _LONGEST_s:
            seen.popleft()
        values = [each[number] for _, each in seen if each[number] == each[number]]
        return max(min(values) - shown, shown - max(values), 0.0) if values else inf
