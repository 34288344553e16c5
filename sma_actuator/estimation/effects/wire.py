"""What the wire may do that a strain model without a temperature, a history and a time does not know."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sma_actuator.base.calibration import COLD_SHARE, left_in_place
from sma_actuator.base.parameters import parameter

from .effect import EFFECTS, Effect
from .frame import Frame, Place, count_cycles, incompleteness
from .free import Free, Scales, shape, size, too_slow

FEWEST_CYCLES = 6  #: that show a drift with their number
#: Young's modulus of such a wire, between the 28 GPa of martensite and the 75 GPa of austenite (Dynalloy, technical
#: characteristics of Flexinol).
ELASTIC_MODULUS_Pa = 40e9


def _rise_K(
    frame: Frame,
    state: np.ndarray,
    time_constant_s: float,
    heat_loss_W_K: float,
    latent_heat_J: float = 0.0,
    share_of: Callable[[Frame], np.ndarray] | None = None,
) -> np.ndarray:
    """Temperature above ambient by the heat balance C dT/dt = P − h (T − T_amb) + Q dX/dt, C/h = the time constant.

    X: the share of the stroke, by ``share_of``; asked only where there is a latent heat Q, which takes four states
    instead of two.
    """
    rise_K = frame.lag(frame.power_W, state[:2], time_constant_s) / heat_loss_W_K
    if share_of is None or not latent_heat_J > 0.0:
        return rise_K
    share = np.clip(share_of(frame), 0.0, 1.0)
    ahead = share - frame.lag(share, state[2:], time_constant_s)
    return rise_K + latent_heat_J / (heat_loss_W_K * time_constant_s) * ahead


@EFFECTS.register("heat_loss")
@dataclass(frozen=True, slots=True)
class HeatLoss(Effect):
    """The wire loses its heat more easily, or less, than at the calibration: ``h (1 + s)``.

    To the heat balance of the calibration that is heat that goes beside it: ``s h (T − T_amb)``, with the temperature
    of the balance as it is now.  Resistance and displacement follow from that alone; in the middle of the
    transformation the wire has the temperature of the transformation, and what changes is the power to be there.
    """

    PART = "wire"
    WORDS = "the wire loses its heat more easily, or less, than at the calibration"
    REMEDY = (
        "Keep draughts away, give the wire the surroundings and the orientation that it was calibrated in, or "
        "calibrate it where it is; until then the extended model allows for it."
    )
    TELL_TALE = "power_lagged_10_s_W"
    STATES = 4
    change: float = parameter(0.0, "heat loss over the calibrated one, less one", "1", -0.9, 9.0)
    time_constant: float = parameter(2.0, "thermal lag at the calibration, C/h", "s", 0.01, 600.0)
    heat_loss: float = parameter(0.006, "heat lost per kelvin above ambient, at the calibration", "W/K", 1e-6, 1e2)
    latent_heat: float = parameter(0.0, "heat set free over the whole stroke on cooling", "J", 0.0, 1e4)

    def at_resistance(self, frame: Frame, state: np.ndarray, place: Place) -> None:
        """Take the heat off that goes beside the balance."""
        now = 1.0 + self.change
        balance = self.time_constant / now, self.heat_loss * now, self.latent_heat
        rise_K = _rise_K(frame, state, *balance, place.share_by_resistance)
        frame.power_W = frame.power_W - self.change * self.heat_loss * rise_K

    @classmethod
    def free(cls, scales: Scales) -> list[Free]:
        """What a fit may vary."""
        return [size("change", 1.5, 0.1, -0.7)]

    @classmethod
    def fixed(cls, scales: Scales) -> dict[str, float]:
        """What the heat balance decides."""
        return {
            "heat_loss": scales.heat_loss_W_K,
            "time_constant": scales.thermal_s,
            "latent_heat": scales.latent_heat_J,
        }

    @classmethod
    def untestable(cls, scales: Scales) -> str:
        """Why logs could not show it."""
        return "" if scales.power_known else "the calibration does not say what power it takes to transform the wire"


@EFFECTS.register("self_heating")
@dataclass(frozen=True, slots=True)
class SelfHeating(Effect):
    """R moves with temperature where the phase no longer changes: at the hot end ``R (1 + α (T − T_amb − T_on))`` above
    the onset, at the cold end ``R (1 + α_c (T − T_amb − T_c))`` below the cold onset.

    The temperature comes from a heat balance on the measured power and the ``latent_heat`` that transforming takes.
    The calibrated relation of R and δ holds the temperatures of the transformation itself; the onsets are where it
    ends.
    """

    PART = "wire"
    WORDS = "the wire's resistance moves with its temperature where its phase does not change"
    REMEDY = "Nothing to repair: let the extended model take it off, and do not heat further than the stroke needs."
    TELL_TALE = "power_lagged_1_s_W"
    STATES = 4
    temperature_coefficient: float = parameter(0.0, "relative change of resistance per kelvin, hot", "1/K", -0.1, 0.1)
    onset: float = parameter(0.0, "rise above ambient from which it acts", "K", 0.0, 500.0)
    cold_temperature_coefficient: float = parameter(
        0.0, "relative change of resistance per kelvin, cold", "1/K", -0.1, 0.1
    )
    cold_onset: float = parameter(0.0, "rise above ambient below which that acts", "K", 0.0, 500.0)
    time_constant: float = parameter(2.0, "thermal lag, C/h", "s", 0.01, 600.0)
    heat_loss: float = parameter(0.006, "heat lost per kelvin above ambient", "W/K", 1e-6, 1e2)
    latent_heat: float = parameter(0.0, "heat set free over the whole stroke on cooling", "J", 0.0, 1e4)

    def at_resistance(self, frame: Frame, state: np.ndarray, place: Place) -> None:
        """The resistance at the onset's temperature."""
        balance = self.time_constant, self.heat_loss, self.latent_heat
        rise_K = _rise_K(frame, state, *balance, place.share_by_resistance)
        change = self.temperature_coefficient * np.maximum(0.0, rise_K - self.onset)
        change = change + self.cold_temperature_coefficient * np.minimum(0.0, rise_K - self.cold_onset)
        frame.resistance_Ohm = frame.resistance_Ohm / (1.0 + change)

    @classmethod
    def free(cls, scales: Scales) -> list[Free]:
        """What a fit may vary."""
        rise_K, thermal_s = scales.rise_K, scales.thermal_s
        free = [
            size("temperature_coefficient", 5e-3, 2e-4),
            Free("onset", 0.0, 0.95 * rise_K, 0.1 * rise_K, (0.0, 0.1 * rise_K, 0.4 * rise_K, 0.7 * rise_K), False),
            shape("time_constant", 0.3 * thermal_s, 4.0 * thermal_s, thermal_s),
        ]
        if scales.calibration_counts:  # later, the calibration's rests say what the cold end does
            free += [
                size("cold_temperature_coefficient", 5e-3, 2e-4),
                shape("cold_onset", 0.02 * rise_K, 0.6 * rise_K, 0.2 * rise_K, 0.4 * rise_K),
            ]
        return free

    @classmethod
    def fixed(cls, scales: Scales) -> dict[str, float]:
        """What the heat balance, the calibration and the logs decide."""
        return {"heat_loss": scales.heat_loss_W_K, "latent_heat": scales.latent_heat_J}


@EFFECTS.register("ambient_temperature")
@dataclass(frozen=True, slots=True)
class AmbientTemperature(Effect):
    """The surroundings are warmer or colder than at the calibration: ``R (1 + α (T_amb − T_cal) e^(−rise/κ))``.

    In the middle of the transformation the wire has the temperature of the transformation whatever the surroundings; so
    the change fades as the wire is heated, over ``fading`` kelvin.  Where nobody logs the surroundings, a
    ``difference`` counts, and where their sensor says what the air at the wire is not, ``sensor_off``: to the heat
    balance of the calibration that is heat that comes beside the current's.
    """

    PART = "wire"
    WORDS = "the surroundings are warmer or colder than at the calibration"
    REMEDY = "Log the ambient temperature, keep draughts away, or calibrate again at the temperature of use."
    TELL_TALE = "ambient_temperature_C"
    ALLOWS_FOR_AMBIENT = True
    STATES = 2
    temperature_coefficient: float = parameter(0.0, "relative change of resistance per kelvin", "1/K", -0.1, 0.1)
    fading: float = parameter(1e3, "rise above ambient over which the change fades", "K", 1.0, 1e6)
    calibration_temperature: float = parameter(22.0, "ambient temperature at the calibration", "°C", -60.0, 100.0)
    difference: float = parameter(
        0.0, "how much warmer than thermal.ambient_temperature it is, where none is measured", "K", -100.0, 100.0
    )
    sensor_off: float = parameter(
        0.0, "how much warmer the air at the wire is than is measured, where it is", "K", -100.0, 100.0
    )
    time_constant: float = parameter(2.0, "thermal lag, C/h", "s", 0.01, 600.0)
    heat_loss: float = parameter(0.006, "heat lost per kelvin above ambient", "W/K", 1e-6, 1e2)

    def at_resistance(self, frame: Frame, state: np.ndarray, place: Place) -> None:
        """The resistance at the calibration's ambient temperature."""
        unknown = np.isnan(frame.ambient_C)
        more_K = np.where(unknown, self.difference, self.sensor_off)
        ambient_C = np.where(unknown, place.ambient_C, frame.ambient_C) + more_K
        fade = np.exp(-np.maximum(0.0, _rise_K(frame, state, self.time_constant, self.heat_loss)) / self.fading)
        change = self.temperature_coefficient * (ambient_C - self.calibration_temperature) * fade
        frame.resistance_Ohm = frame.resistance_Ohm / (1.0 + change)
        frame.power_W = frame.power_W + self.heat_loss * more_K

    @classmethod
    def free(cls, scales: Scales) -> list[Free]:
        """What a fit may vary."""
        rise_K = scales.rise_K
        how_warm = [size("temperature_coefficient", 5e-3, 5e-4)]
        if scales.ambient_logged and scales.power_known:  # a sensor may say what the air at the wire is not
            how_warm.append(size("sensor_off", 40.0, 2.0))
        elif not scales.ambient_logged:
            # The power says how warm it is.  A metal's resistance rises with that, but not by any amount; of a wire
            # that the surroundings keep from transforming to its cold end it falls.  Held to rise, it takes the sign of
            # the power along.
            starts, ends = (6e-4, -3e-4), (-1e-3, 2.5e-3)
            coefficient = Free("temperature_coefficient", *ends, 5e-4, starts, logarithmic=False, other_at=("high",))
            how_warm = [size("difference", 40.0, 2.0), coefficient]
        return [
            *how_warm,
            shape("fading", 0.03 * rise_K, 30.0 * rise_K, 0.15 * rise_K, 0.8 * rise_K, 10.0 * rise_K),
        ]

    @classmethod
    def fixed(cls, scales: Scales) -> dict[str, float]:
        """What the heat balance, the calibration and the logs decide."""
        return {
            "heat_loss": scales.heat_loss_W_K,
            "calibration_temperature": scales.calibration_ambient_C,
            "time_constant": scales.thermal_s,
        }

    @classmethod
    def untestable(cls, scales: Scales) -> str:
        """Why logs could not show it."""
        if not scales.ambient_logged and not scales.power_known:
            return "no ambient temperature in the logs (column ambient_temperature_C)"
        if scales.power_known or scales.ambient_change_K >= 1.0:
            return ""
        if not scales.calibration_ambient_known:
            return "the ambient temperature stays within 1 K, and that of the calibration is not known"
        return f"the ambient temperature is within {scales.ambient_change_K:.1f} K of the calibration's"


@EFFECTS.register("thermal_expansion")
@dataclass(frozen=True, slots=True)
class ThermalExpansion(Effect):
    """δ moves with temperature: ``L α (T − T_amb)``, of the wire or of what is heated by it.

    The temperature is that of the heat balance ``C dT/dt = P − h (T − T_amb) + Q dX/dt`` with the share X of the stroke
    (0 contracted, 1 cold): a wire that contracts takes heat up for that.
    """

    PART = "wire"
    WORDS = "the wire, or what it heats, expands with its temperature"
    REMEDY = (
        "Nothing to repair in the wire: let the extended model take it off, or keep heat away from what holds the wire."
    )
    TELL_TALE = "power_lagged_10_s_W"
    STATES = 4
    coefficient: float = parameter(
        0.0, "expansion of the wire's length per kelvin beyond the calibrated", "1/K", -1e-2, 1e-2
    )
    time_constant: float = parameter(2.0, "thermal lag, C/h", "s", 0.01, 1e4)
    heat_loss: float = parameter(0.006, "heat lost per kelvin above ambient", "W/K", 1e-6, 1e2)
    latent_heat: float = parameter(0.0, "heat set free over the whole stroke on cooling", "J", 0.0, 1e4)

    def at_displacement(self, frame: Frame, state: np.ndarray, place: Place) -> None:
        """Add the expansion."""
        balance = self.time_constant, self.heat_loss, self.latent_heat
        rise_K = _rise_K(frame, state, *balance, place.share_of_stroke)
        frame.displacement_m = frame.displacement_m + place.length_m * self.coefficient * rise_K

    @classmethod
    def free(cls, scales: Scales) -> list[Free]:
        """What a fit may vary."""
        return [
            size("coefficient", 2e-4, 1e-5),
            shape("time_constant", 0.3, max(0.5 * scales.duration_s, 2.0), 1.5, 15.0, 100.0, other_at=("high",)),
        ]

    @classmethod
    def fixed(cls, scales: Scales) -> dict[str, float]:
        """What the heat balance, the calibration and the logs decide."""
        return {"heat_loss": scales.heat_loss_W_K, "latent_heat": scales.latent_heat_J}


@EFFECTS.register("elastic_compliance")
@dataclass(frozen=True, slots=True)
class ElasticCompliance(Effect):
    """δ moves with load at constant phase, beyond what the calibrated stress dependence holds."""

    PART = "wire"
    WORDS = "something yields with the load"
    REMEDY = "Stiffen what holds the wire and the sensor, or let the extended model take it off."
    TELL_TALE = "stress_Pa"
    compliance: float = parameter(0.0, "stretch per newton", "m/N", -1.0, 1.0)

    def at_displacement(self, frame: Frame, state: np.ndarray, place: Place) -> None:
        """Add the stretch."""
        frame.displacement_m = frame.displacement_m + self.compliance * frame.load_N

    @classmethod
    def free(cls, scales: Scales) -> list[Free]:
        """What a fit may vary."""
        soft = scales.stroke_m / scales.load_N
        # Nothing pushes back; beside what the calibration holds it may seem so.
        return [size("compliance", 0.6 * soft, 0.02 * soft, None if scales.calibration_counts else 0.0)]

    @classmethod
    def untestable(cls, scales: Scales) -> str:
        """Why logs could not show it."""
        return (
            "" if scales.loads_differ else "one load only: a stretch in proportion to load shows where the load changes"
        )


@EFFECTS.register("fatigue")
@dataclass(frozen=True, slots=True)
class Fatigue(Effect):
    """The wire wears with its cycles: the hot end of the stroke moves with ``g(N)``, the cold one by a share of that.

    ``g = (N^p − 1) / p``, which is the logarithm (thesis, eq. 4.1) at ``p = 0`` and a square root at one half.  What
    is left in place is less while it is martensite, so the stroke shrinks; defects raise the resistivity.
    """

    PART = "wire"
    WORDS = "the wire wears with the number of its cycles"
    REMEDY = "The wire ages: use less stress or less stroke, calibrate again, and plan to replace it."
    TELL_TALE = "cycle"
    LASTS = False  # a wire wears as its cycles go
    STATES = 2
    displacement: float = parameter(0.0, "how far the hot end has moved when g is one", "m", -1.0, 1.0)
    cold_share: float = parameter(COLD_SHARE, "the same of the cold end, over that of the hot one", "1", -10.0, 10.0)
    resistance: float = parameter(0.0, "relative rise of the resistance when g is one", "1", -1.0, 1.0)
    exponent: float = parameter(0.5, "p: 0 is the logarithm of the cycle number", "1", 0.0, 2.0)
    cycle_power: float = parameter(0.2, "power above which a heating cycle begins", "W", 1e-6, 1e3)
    first_cycle: float = parameter(1.0, "number of the first cycle of the session", "1", 1.0, 1e9)

    def at_resistance(self, frame: Frame, state: np.ndarray, place: Place) -> None:
        """Take the rise of the resistance off."""
        frame.cycles = np.empty(len(frame.power_W))
        count_cycles(np.ascontiguousarray(frame.power_W), state, self.cycle_power, frame.cycles)
        frame.resistance_Ohm = frame.resistance_Ohm / (1.0 + self.resistance * self._worn(frame))

    def at_displacement(self, frame: Frame, state: np.ndarray, place: Place) -> None:
        """Add what is left in place."""
        share = left_in_place(place.share_of_stroke(frame), self.cold_share)
        frame.displacement_m = frame.displacement_m + self.displacement * share * self._worn(frame)

    def _worn(self, frame: Frame) -> np.ndarray:
        ratio = 1.0 + (frame.cycles - 1.0) / self.first_cycle
        return (ratio**self.exponent - 1.0) / self.exponent if self.exponent > 0.0 else np.log(ratio)

    @classmethod
    def free(cls, scales: Scales) -> list[Free]:
        """What a fit may vary."""
        # A wire that wears grows longer, and its resistivity with it; beside what the calibration holds it may seem
        # otherwise.
        least = None if scales.calibration_counts else 0.0
        return [
            # What raises the resistance alone is no wear, but a contact that drifts.
            size("displacement", 0.1 * scales.stroke_m, 0.005 * scales.stroke_m, least, other_at=("low",)),
            size("resistance", 0.1, 0.001, least),
            # How far from a logarithm, and how much the stroke shrinks: between what was seen of wires.  Where it does
            # not shrink at all, the whole wire has grown longer: it creeps, or slips.
            Free("exponent", 0.05, 1.0, 1.0, (0.5, 0.1), False),
            Free("cold_share", 0.0, 1.0, 1.0, (0.4, 0.8), False, other_at=("high",)),
        ]

    @classmethod
    def fixed(cls, scales: Scales) -> dict[str, float]:
        """What the heat balance, the calibration and the logs decide."""
        return {"cycle_power": scales.cycle_power_W}

    @classmethod
    def untestable(cls, scales: Scales) -> str:
        """Why logs could not show it."""
        if scales.cycles < FEWEST_CYCLES:
            return f"{scales.cycles} cycles are too few for a drift with their number"
        return ""


@EFFECTS.register("prior_wear")
@dataclass(frozen=True, slots=True)
class PriorWear(Effect):
    """The wire has worn since its calibration: the ends of its stroke lie elsewhere from the first reading on.

    It moves them as :class:`Fatigue` does, the hot end more than the cold one, and raises the resistivity; only that
    was before, so no number of cycles tells how much.
    """

    PART = "wire"
    WORDS = "the wire has worn since its calibration: it contracts less far, and hangs longer"
    REMEDY = "Use less stress or less stroke, and calibrate again; until then the extended model allows for it."
    TELL_TALE = "displacement_m"
    displacement: float = parameter(0.0, "how far the hot end has moved", "m", -1.0, 1.0)
    cold_share: float = parameter(COLD_SHARE, "the same of the cold end, over that of the hot one", "1", -10.0, 10.0)
    resistance: float = parameter(0.0, "relative rise of the resistance", "1", -0.9, 9.0)

    def at_resistance(self, frame: Frame, state: np.ndarray, place: Place) -> None:
        """Take the rise of the resistance off."""
        frame.resistance_Ohm = frame.resistance_Ohm / (1.0 + self.resistance)

    def at_displacement(self, frame: Frame, state: np.ndarray, place: Place) -> None:
        """Add what is left in place."""
        share = left_in_place(place.share_of_stroke(frame), self.cold_share)
        frame.displacement_m = frame.displacement_m + self.displacement * share

    @classmethod
    def free(cls, scales: Scales) -> list[Free]:
        """What a fit may vary."""
        least = None if scales.calibration_counts else 0.0
        return [
            # What raises the resistance alone lies in the circuit.
            size("displacement", 0.5 * scales.stroke_m, 0.02 * scales.stroke_m, least, other_at=("low",)),
            size("resistance", 0.1, 0.002, least),
            # Where the cold end has not moved it is a sensor's gain, where it has moved as far a slip.
            Free("cold_share", 0.0, 1.0, 1.0, (0.4, 0.8), False, other_at=("low", "high")),
        ]


@EFFECTS.register("creep")
@dataclass(frozen=True, slots=True)
class Creep(Effect):
    """Slow stretch under load: a Kelvin–Voigt element in series, at rest when the session began."""

    PART = "wire"
    WORDS = "something gives way slowly under the load"
    REMEDY = "Tighten clamps and crimps, train the wire under its load, and calibrate again when it has settled."
    TELL_TALE = "time_s"
    LASTS = False  # a wire creeps on a day, as time goes
    STATES = 2
    compliance: float = parameter(0.0, "stretch per newton in the end", "m/N", -1.0, 1.0)
    time_constant: float = parameter(300.0, "how slowly it comes", "s", 1.0, 1e7)

    def at_displacement(self, frame: Frame, state: np.ndarray, place: Place) -> None:
        """Add the stretch so far."""
        slow_N = frame.lag(frame.load_N, state, self.time_constant, from_zero=True)
        frame.displacement_m = frame.displacement_m + self.compliance * slow_N

    @classmethod
    def free(cls, scales: Scales) -> list[Free]:
        """What a fit may vary."""
        soft, slow_s = scales.stroke_m / scales.load_N, scales.duration_s
        return [
            size("compliance", 0.6 * soft, 0.02 * soft, None if scales.calibration_counts else 0.0),
            # At once it is a compliance, and in no time at all a drift.
            shape("time_constant", 3.0, 3.0 * slow_s, 10.0, 0.15 * slow_s, 0.8 * slow_s, other_at=("low", "high")),
        ]


@EFFECTS.register("minor_loop_memory")
@dataclass(frozen=True, slots=True)
class MinorLoopMemory(Effect):
    """After a transformation that turned back early the next branch is shifted in proportion, until it nears its own
    end.

    A branch that is completed wipes out what was before it: the wiping-out property of hysteresis (I. D. Mayergoyz,
    Mathematical Models of Hysteresis, 1991).  Where ``fading`` is 0 the shift stays to the end.
    """

    PART = "wire"
    WORDS = "a branch that turned back early shifts the next"
    REMEDY = (
        "Nothing to repair: it is how the alloy behaves in partial cycles; let the extended model take it off, "
        "or calibrate with more partial cycles."
    )
    TELL_TALE = "distance_from_reversal_m"
    STATES = 7
    after_heating: float = parameter(
        0.0, "shift of the cooling branch, per incompleteness of the heating", "m", -1.0, 1.0
    )
    after_cooling: float = parameter(
        0.0, "shift of the heating branch, per incompleteness of the cooling", "m", -1.0, 1.0
    )
    fading: float = parameter(0.0, "share of the stroke before a branch's end on which the shift goes", "1", 0.0, 2.0)
    relaxation_time: float = parameter(0.0, "time constant with which the shift comes and goes", "s", 0.0, 100.0)

    def at_displacement(self, frame: Frame, state: np.ndarray, place: Place) -> None:
        """Add the shift."""
        missing, begun = np.empty(len(frame.displacement_m)), np.empty(len(frame.displacement_m))
        share = place.share_of_stroke(frame)
        range_Ohm = place.resistance_range_Ohm
        turning = frame.resistance_Ohm / range_Ohm if np.isfinite(range_Ohm) else share
        incompleteness(frame.heating, share, np.ascontiguousarray(turning), state[:5], missing, begun)
        shift_m = np.where(missing > 0.0, self.after_heating * missing, -self.after_cooling * missing) * begun
        if self.fading > 0.0:
            to_go = np.where(missing > 0.0, 1.0 - share, share)  # after heating the wire cools, and grows longer
            shift_m = shift_m * np.clip(to_go / self.fading, 0.0, 1.0)
        if self.relaxation_time > 0.0:
            shift_m = frame.lag(shift_m, state[5:], self.relaxation_time, from_zero=True)
        frame.displacement_m = frame.displacement_m + shift_m

    def forget_the_loop(self, state: np.ndarray) -> None:
        """Where the last branch turned is not known any more."""
        state[:] = np.nan

    @classmethod
    def free(cls, scales: Scales) -> list[Free]:
        """What a fit may vary."""
        return [
            size("after_heating", 0.6 * scales.stroke_m, 0.05 * scales.stroke_m),
            size("after_cooling", 0.6 * scales.stroke_m, 0.05 * scales.stroke_m),
            Free("fading", 0.02, 1.5, 1.0, (0.2, 0.8), False),
            shape("relaxation_time", 1e-2, 5.0, 0.1, 0.5),
        ]

    @classmethod
    def untestable(cls, scales: Scales) -> str:
        """Why logs could not show it."""
        return "" if scales.partial_cycles else "no partial cycles: every transformation goes to its end"


@EFFECTS.register("rate")
@dataclass(frozen=True, slots=True)
class Rate(Effect):
    """The loop opens with the rate: δ relaxes towards what R says.

    What the load stretches elastically comes at once; that tells a wire that lags from a sensor that does, and nothing
    else: it has no more freedom than such a sensor, so where the load stands the two are as likely.
    """

    PART = "wire"
    WORDS = "the displacement lags what the resistance says"
    REMEDY = "Nothing to repair: drive more slowly, or let the extended model take it off."
    TELL_TALE = "resistance_rate_Ohm_s"
    LASTS = False  # logs of a calibration are all driven alike: what it takes off them says nothing of others
    STATES = 2
    relaxation_time: float = parameter(1e-3, "time constant with which δ follows", "s", 1e-6, 1e3)

    def at_displacement(self, frame: Frame, state: np.ndarray, place: Place) -> None:
        """Relax."""
        elastic_m = place.length_m / (place.area_m2 * ELASTIC_MODULUS_Pa) * frame.load_N
        frame.displacement_m = frame.lag(frame.displacement_m - elastic_m, state, self.relaxation_time) + elastic_m

    def forget_the_loop(self, state: np.ndarray) -> None:
        """The displacement that relaxes starts anew."""
        state[:] = np.nan

    @classmethod
    def free(cls, scales: Scales) -> list[Free]:
        """What a fit may vary: as of a sensor that lags."""
        return [shape("relaxation_time", 1e-3, 5.0, 0.1, 0.5)]

    @classmethod
    def untestable(cls, scales: Scales) -> str:
        """Why logs could not show it."""
        return too_slow(scales, "a lag")


@EFFECTS.register("first_pulse_set")
@dataclass(frozen=True, slots=True)
class FirstPulseSet(Effect):
    """The first full pulse of a session leaves the wire longer, once; what turns back earlier leaves a part of it.

    It comes with what is transformed for the first time, so it is there from the first contraction on, at either end.
    """

    PART = "wire"
    WORDS = "the first full pulse of the session has left the wire longer"
    REMEDY = "Drive the wire through two full pulses before you measure, and set the position's zero after them."
    TELL_TALE = "time_s"
    STATES = 1
    length: float = parameter(0.0, "how much longer the wire is after its first full pulse", "m", -1.0, 1.0)

    def at_displacement(self, frame: Frame, state: np.ndarray, place: Place) -> None:
        """Add what has been left so far."""
        transformed = 1.0 - np.clip(np.nan_to_num(place.share_of_stroke(frame), nan=1.0), 0.0, 1.0)
        furthest = np.maximum.accumulate(np.maximum(transformed, np.nan_to_num(state[0])))
        state[0] = furthest[-1]
        frame.displacement_m = frame.displacement_m + self.length * furthest

    @classmethod
    def free(cls, scales: Scales) -> list[Free]:
        """What a fit may vary."""
        # Nothing grows shorter of a pulse; beside what the calibration holds it may seem so.
        least = None if scales.calibration_counts else 0.0
        return [size("length", 0.2 * scales.stroke_m, 0.01 * scales.stroke_m, least)]
