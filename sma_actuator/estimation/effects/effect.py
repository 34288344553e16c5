"""What an effect is."""

from __future__ import annotations

from typing import ClassVar

import numpy as np


class Effect:
    """Parameters and mathematics of one effect: a method for every stage at which it acts."""

    __slots__ = ()
    STAGE: ClassVar[str]
    STATES: ClassVar[int]

    def forget_the_loop(self, state: np.ndarray) -> None:
        """Forget what was derived from positions on the loop; what belongs to the session stays."""
