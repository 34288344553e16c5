"""How far a wire has transformed, and how hot a heating one is there, by its calibration."""

from __future__ import annotations

from math import nan

from sma_actuator.base.jit import Floats, jit
from sma_actuator.base.lookup import looked_up


@jit
def share_and_heating_C(row: Floats, shown: float, stress_Pa: float, shift_K_Pa: float) -> tuple[float, float]:
    """Where what a wire shows lies between what the contracted (0) and the cold one (1) show under this load, and the
    temperature [°C] of a heating wire there; NaN where the one shows no less than the other.

    ``shown``: a position or a resistance; ``row``: of :func:`~sma_actuator.base.lookup.row_of`, what the contracted
    and what the cold wire show by stress, and the temperature of a heating one by share; ``shift_K_Pa``: how much
    hotter that is under a load.
    """
    hot, cold = looked_up(row, 0, stress_Pa), looked_up(row, 1, stress_Pa)
    if not hot < cold:
        return nan, nan
    share = (shown - hot) / (cold - hot)
    return share, looked_up(row, 2, share) + shift_K_Pa * stress_Pa  # beyond the ends as at them
