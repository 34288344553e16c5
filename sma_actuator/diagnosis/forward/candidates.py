"""What a real bench may have and Liang & Rogers do not: each with its parameters, units, bounds and sentence.

Bounds are those of the physics, not of the data: an effect whose value ends at one has not been
measured, and is not named.
"""

from __future__ import annotations

from dataclasses import dataclass

from .fitting import ForwardFree


@dataclass(frozen=True)
class ForwardCandidate:
    """One effect that may be switched on."""

    name: str
    sentence: str  #: what would be said of the bench if it earned its place
    free: tuple[ForwardFree, ...]
    part: str  #: where it lies: mechanism, sensor, heat, alloy or circuit
    signature: str  #: what in the record tells it from the others
    remedy: str  #: what a person can do about it

    @property
    def parameters(self) -> int:
        """How many values it has to earn."""
        return len(self.free)

    @property
    def value_names(self) -> tuple[str, ...]:
        """Names of its values in the ``effects`` section."""
        return tuple(f.name for f in self.free)


def _f(name: str, unit: str, lo: float, hi: float, start: float) -> ForwardFree:
    return ForwardFree(f"effects.{name}", unit, lo, hi, start)


CANDIDATES = (
    ForwardCandidate(
        "friction",
        "the slider rubs: it stands until the tension has changed by twice the friction",
        (_f("friction_N", "N", 0.0, 6.0, 0.5),),
        "mechanism",
        "a standstill at every reversal, longest where the wire is stiff and slow; the wire's expansion before it "
        "transforms is not seen",
        "Clean and oil the guide, or let the slider hang free of it.",
    ),
    ForwardCandidate(
        "stiction",
        "the slider rubs, and sticks more when it stands than when it moves",
        (_f("friction_N", "N", 0.0, 6.0, 0.5), _f("breakaway_N", "N", 0.0, 4.0, 0.2)),
        "mechanism",
        "as friction, with a jump where it lets go",
        "Clean and oil the guide, or replace it by one that rolls.",
    ),
    ForwardCandidate(
        "backlash",
        "there is play between the slider and the position sensor",
        (_f("backlash_m", "m", 0.0, 2e-3, 2e-4),),
        "sensor",
        "a standstill of the same width at every reversal, hot or cold",
        "Take the play out between slider and sensor, or preload it.",
    ),
    ForwardCandidate(
        "sensor lag",
        "the position sensor or its filter lags",
        # More than a tenth of a second would be a filter that also takes the noise from sample to sample away.
        (_f("sensor_lag_s", "s", 0.0, 0.1, 0.03),),
        "sensor",
        "an error in proportion to the speed, corners rounded",
        "Switch off the position sensor's filter, or log it faster.",
    ),
    ForwardCandidate(
        "dead time",
        "the power reaches the wire later than the duty was logged (drive or logger)",
        (_f("dead_time_s", "s", 0.0, 2.0, 0.3),),
        "circuit",
        "an abrupt begin of every movement, late by the same time whatever the speed",
        "Log the duty where it acts, or take the delay off the log's clock.",
    ),
    ForwardCandidate(
        "slack",
        "the first contraction takes up slack before the slider leaves its stop",
        (_f("slack_m", "m", 0.0, 3e-3, 3e-4),),
        "mechanism",
        "the slider leaves its cold place abruptly, and comes back to it abruptly",
        "Pull the wire taut before the first contraction.",
    ),
    ForwardCandidate(
        "R-phase",
        "on cooling, part of the austenite passes through the R-phase first",
        (
            _f("r_strain", "", 0.0, 0.008, 0.001),
            _f("r_start_C", "°C", 20.0, 130.0, 85.0),
            _f("r_width_K", "K", 1.0, 60.0, 20.0),
        ),
        "alloy",
        "a small early lengthening on cooling that heating does not have",
        "Nothing to repair: it is in the alloy; the fitted model has it.",
    ),
    ForwardCandidate(
        "cooling loss",
        "without power the wire loses heat at another rate than with it (an airflow, an idle bridge)",
        (_f("cooling_loss_factor", "", 0.3, 3.0, 1.1),),
        "heat",
        "heating and cooling ask for different heat transfers",
        "Keep draughts away and let the bridge idle the same way hot and cold; the fitted model has it.",
    ),
    ForwardCandidate(
        "natural convection",
        "heat transfer rises with the wire's excess temperature",
        (_f("convection_exponent", "", 0.0, 0.5, 0.15),),
        "heat",
        "cooling that is fast at first and slow at last",
        "Nothing to repair: it is how air takes heat; the fitted model has it.",
    ),
    ForwardCandidate(
        "radiation",
        "the surface radiates",
        (_f("emissivity", "", 0.0, 1.0, 0.3),),
        "heat",
        "as convection, weaker",
        "Nothing to repair: the fitted model has it.",
    ),
    ForwardCandidate(
        "warm surroundings",
        "what touches the wire (air in the duct, crimps, a sleeve) warms up with it and stays warm",
        (_f("surround_J_K", "J/K", 0.05, 60.0, 3.0), _f("surround_share", "", 0.02, 0.9, 0.2)),
        "heat",
        "a slow tail after a fast cooling, a slow drift while hot",
        "Give the wire free air, or let everything warm up before it is measured.",
    ),
    ForwardCandidate(
        "spread",
        "the wire does not transform everywhere at one temperature (local stress, composition, training)",
        (_f("spread_K", "K", 0.0, 25.0, 5.0),),
        "alloy",
        "long rounded ends of both transformations where the cosine ends sharply",
        "Nothing to repair: it is in the alloy and its training; the fitted model has it.",
    ),
    ForwardCandidate(
        "two populations",
        "part of the wire transforms at lower temperatures than the rest",
        (_f("early_share", "", 0.0, 0.5, 0.08), _f("early_by_K", "K", 2.0, 40.0, 20.0)),
        "alloy",
        "a shoulder before the main transformation on heating, and after it on cooling",
        "Look whether part of the wire is bent, clamped or trained otherwise; else the fitted model has it.",
    ),
    ForwardCandidate(
        "cold ends",
        "the wire is colder near its crimps",
        (_f("cold_share", "", 0.0, 0.5, 0.1), _f("cold_loss_factor", "", 1.0, 20.0, 3.0)),
        "heat",
        "a late end of heating and an early begin of cooling",
        "Nothing to repair: a longer wire feels it less; the fitted model has it.",
    ),
    ForwardCandidate(
        "lead resistance",
        "leads and bridge take part of the voltage",
        (_f("lead_Ohm", "Ω", 0.0, 4.0, 0.3),),
        "circuit",
        "less power, and less of it as the wire's resistance falls",
        "Measure leads and bridge, or the voltage at the wire itself.",
    ),
    ForwardCandidate(
        "resistance with temperature",
        "the resistivity rises with temperature",
        (_f("resistivity_coefficient_1_K", "1/K", -2e-4, 1.2e-3, 3e-4),),
        "circuit",
        "less power when hot",
        "Nothing to repair: the fitted model has it; driven by current the wire does not feel it.",
    ),
    ForwardCandidate(
        "other expansion",
        "the hot wire expands less, or more, than the maker's coefficient says",
        (ForwardFree("wire.austenite_expansion_1_K", "1/K", 6e-6, 15e-6, 9e-6),),
        "alloy",
        "the size of the movement between power off and the first martensite",
        "Nothing to repair: the fitted model has it.",
    ),
    ForwardCandidate(
        "lasting strain",
        "the first cold state holds strain that cooling under this bias does not restore",
        (_f("start_strain", "", -0.003, 0.005, 3e-4),),
        "alloy",
        "the slider does not come back to where it began",
        "Cycle the wire until it comes back to where it began, then measure.",
    ),
)


def named(name: str) -> ForwardCandidate:
    """The candidate of a name."""
    return next(c for c in CANDIDATES if c.name == name)
