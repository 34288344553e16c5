"""How far this wire has transformed, how hot it is there, and what its resistance is, by its calibration."""

from __future__ import annotations

from math import inf, isfinite, nan

from sma_actuator.base.calibration import Calibration, HotEndSection
from sma_actuator.base.jit import Floats, floats, jit
from sma_actuator.base.lookup import looked_up, row_of
from sma_actuator.base.sections import ThermalParameters

#: The least and the most by which the resistance of austenite rises with its temperature, as a share; makers and bench:
#: 2e-4 to 1e-3.
LEAST_SLOPE_1_K, MOST_SLOPE_1_K = 2e-4, 1e-3
#: Contracting takes a tenth or more off a wire's resistance: one that shows more than this share less than it has shown
#: before may have contracted, whatever its calibration says.  Readings at the bias scatter by a tenth of it.
FALLS = 0.01
#: Temperatures by the heat balance rest on a heat capacity that nobody measured: above the surroundings they may be so
#: many times higher.  Wires of one alloy have 0.85 to 1.2 of the usual; by geometry, a wire that hangs vertically loses
#: a fifth less than one that lies.
CAPACITY_WITHIN = 1.25

#: A load that is a tenth beyond those that were seen is like one of them: the cold end bends by a stress in proportion.
LIKE_ONE = 0.9

#: The tables of a row: what the contracted and the cold wire show by stress, and the temperatures of the heating one,
#: at no stress, by share of the stroke, contracted first.
CONTRACTED, COLD, HEATING = range(3)


@jit
def share_and_heating_C(row: Floats, shown: float, stress_Pa: float, shift_K_Pa: float) -> tuple[float, float]:
    """Where what a wire shows lies between what the contracted (0) and the cold one (1) show under this load, and the
    temperature [°C] of a heating wire there; NaN where the one shows no less than the other.

    ``shown``: a position or a resistance; ``row``: of :func:`~sma_actuator.base.lookup.row_of`, what the contracted
    and what the cold wire show by stress, and the temperature of a heating one by share; ``shift_K_Pa``: how much
    hotter that is under a load.
    """
    hot, cold = looked_up(row, CONTRACTED, stress_Pa), looked_up(row, COLD, stress_Pa)
    if not hot < cold:
        return nan, nan
    share = (shown - hot) / (cold - hot)
    return share, looked_up(row, HEATING, share) + shift_K_Pa * stress_Pa  # beyond the ends as at them


def most_contracted_Ohm(hot_end: HotEndSection, temperature_C: float) -> float:
    """The most resistance that a contracted wire shows up to a temperature, whatever its load; ∞ where nobody knows."""
    if not hot_end.contracted_resistance or not isfinite(hot_end.contracted_temperature):
        return inf
    hotter_K = max(temperature_C - hot_end.contracted_temperature, 0.0)
    return max(hot_end.contracted_resistance) * (1.0 + MOST_SLOPE_1_K * hotter_K)


def least_slope_1_K(hot_end: HotEndSection) -> float:
    """The least by which the resistance of this wire's austenite rises with its temperature, as a share [1/K].

    What was seen of it, less what is not known of the scale of temperature, and as much for another wire of its kind.
    """
    if not (hot_end.contracted_resistance and isfinite(hot_end.contracted_slope)):
        return LEAST_SLOPE_1_K
    slope_1_K = hot_end.contracted_slope / max(hot_end.contracted_resistance)
    return min(max(slope_1_K / CAPACITY_WITHIN**2, LEAST_SLOPE_1_K), MOST_SLOPE_1_K)


def returns_at_C(calibration: Calibration, parameters: ThermalParameters, stress_Pa: float) -> float:
    """The temperature at which this wire, cooling, was back at ``cooling_position``; NaN where nobody knows."""
    then_C = calibration.usual_ambient_C(parameters.ambient_temperature)
    return then_C + calibration.hot_end.cooling_rise_K(stress_Pa)


class Transforms:
    """At which temperatures this wire transforms, and what it shows at the ends of its stroke.

    ``row``: what it shows contracted and cold by stress, and its temperatures heating, at no stress, by share of its
    stroke, contracted first; empty where nobody knows.
    """

    def __init__(self, calibration: Calibration, parameters: ThermalParameters):
        hot_end, rest, power = calibration.hot_end, calibration.rest, calibration.power
        self.then_C = calibration.usual_ambient_C(parameters.ambient_temperature)
        self.row, self.shifts_K_Pa = floats(0), (nan, nan)  #: by which a stress shifts them, cooling and heating
        self.return_C = nan  #: at no stress, where the contracted wire begins to return
        self.slope_1_K = least_slope_1_K(hot_end)
        if calibration.transformation_known and hot_end.contracted_resistance and rest.cold_resistance:
            self.shifts_K_Pa = power.transformation_shift[0], power.transformation_shift[1]
            self.return_C = power.transformation_cooling[0]
            self.row = row_of(
                (hot_end.contracted_stress, hot_end.contracted_resistance),
                (rest.cold_stress, rest.cold_resistance),
                power.heating,
            )


@jit
def transforms_at_C(row: Floats, resistance_Ohm: float, stress_Pa: float, shift_K_Pa: float, then_C: float) -> float:
    """The highest temperature [°C] at which a wire, heated, has transformed as far as its resistance says, with what
    :class:`Transforms` has for it; ∞ where nobody knows."""
    if not len(row):
        return inf
    _, by_balance_C = share_and_heating_C(row, resistance_Ohm, stress_Pa, shift_K_Pa)
    return _at_most_C(by_balance_C, then_C)


@jit
def returns_at_most_C(return_C: float, stress_Pa: float, shift_K_Pa: float, then_C: float) -> float:
    """The highest temperature [°C] at which a contracted wire, cooling, begins to return; ∞ where nobody knows."""
    return _at_most_C(return_C + shift_K_Pa * stress_Pa, then_C)


@jit
def _at_most_C(by_balance_C: float, then_C: float) -> float:
    highest_C = then_C + CAPACITY_WITHIN * (by_balance_C - then_C)
    return highest_C if isfinite(highest_C) else inf


@jit
def cold_Ohm(row: Floats, stress_Pa: float) -> float:
    """What the wire was known to show cold under this load; NaN where nobody knows."""
    return looked_up(row, COLD, stress_Pa) if len(row) else nan


@jit
def more_than_contracted(row: Floats, stress_Pa: float, least_Ohm: float) -> float:
    """The least that a wire has shown over what it was known to show contracted under this load, 1 at the least."""
    return max(least_Ohm / looked_up(row, CONTRACTED, stress_Pa), 1.0)


@jit
def shows_cold(row: Floats, shown_Ohm: float, stress_Pa: float, known_Ohm: float) -> bool:
    """Whether a wire shows as much as it was known to show cold under this load (:func:`cold_Ohm`); not where no such
    load was seen, as in a slack one."""
    if not abs(shown_Ohm - known_Ohm) < FALLS * known_Ohm:
        return False
    first, count = int(row[2 * COLD]), int(row[2 * COLD + 1])
    return LIKE_ONE * row[first] <= stress_Pa <= row[first + count - 1] / LIKE_ONE


@jit
def contracted_Ohm(by_then_Ohm: float, at_most_Ohm: float, shown_cold_Ohm: float, known_Ohm: float) -> float:
    """The most that a wire shows contracted that is no hotter than it can be now: what the calibrated one shows
    (``by_then_Ohm``), and as much more as this one has shown cold (``shown_cold_Ohm``) than that was known to
    (:func:`cold_Ohm`); ``at_most_Ohm``, which it shows however hot it is, where nobody knows."""
    if not (known_Ohm > 0.0 and isfinite(by_then_Ohm)):
        return at_most_Ohm
    return by_then_Ohm * max(shown_cold_Ohm / known_Ohm, 1.0)


@jit
def shows_cold_no_more(known_Ohm: float, just_contracted_Ohm: float) -> bool:
    """Whether the wire is known to show no more cold (:func:`cold_Ohm`) than contracted (``just_contracted_Ohm``)."""
    return known_Ohm < just_contracted_Ohm < inf
