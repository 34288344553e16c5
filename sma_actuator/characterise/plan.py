"""What is to be measured: a list of parts, each of which is finished or is not."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sma_actuator.base.balance import held_rise_K, holding_A
from sma_actuator.base.parameters import ConfigError
from sma_actuator.config import require_sense_resistor
from sma_actuator.logs.cycles import HOT_PART
from sma_actuator.logs.kinds import FOLLOWED, FULL, LEVELS, MANY, PARTIAL
from sma_actuator.logs.units import GRAVITY_m_s2
from sma_actuator.safety.transformed import CAPACITY_WITHIN

from .programs import FROM_COLD, every_ordered_pair
from .rig import attended

#: Weights: so many, at equal ratios.  The heaviest is just below that with which a wire is held where it is, and no
#: further than a twentieth of their range: with one that is heavier than that a driven wire is switched off.
#: The lightest is the thesis's, or a tenth of the heaviest.
LOADS, HEAVIEST, LIGHTEST_Pa, LIGHTEST = 7, 0.96, 15e6, 0.1
#: Masses that a load cell is calibrated with: the thesis's eight (appendix A), and smaller ones for finer wires; the
#: largest over the smallest of them is what it was there; a line wants three points to show that it is one.
MASSES_kg = (0.0002, 0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3)
MASSES_OVER, LEAST_MASSES = 30.0, 3
#: Wires are heated so far that this is well above their usual transformations, however much further their limits let
#: them be heated; and further where they still contract.
HOT_ENOUGH_C = 160.0

#: A pulse takes a wire through the middle half of its stroke in some 0.4 of its time constant, heat_capacity /
#: heat_loss.  Where that is fewer than four readings each pulse begins with a ramp of so many: 0.7 K a reading where
#: 135 K are ramped, and a middle half takes 4 K; identify wants five readings of each pulse, since a guard that lets
#: the wire cool for a moment parts it from the others.  A ramp out of the heat as well bought nothing at 3.4 Hz: on
#: cycles left out 0.26 to 0.42 % became 0.26 to 0.39, partial cycles 0.43 to 0.61 became 0.42 to 0.75, and one of four
#: sets of logs no longer told how the heat loss grows.
QUICK_READINGS, RAMP_READINGS = 10.0, 240.0
UNGUARDED = 0.9  #: of the rise that the heat limit aims at, for its headroom and a resistance that is not the usual

#: Of training, for the progress bar: a wire that is trained needs eleven, a new one a hundred.
TYPICAL_CYCLES = 40

#: The second round: in the middle between which of the first's weights and the next its own lie, beside the heaviest
#: of them: what a loop does there follows from no lighter one; a spring as stiff as makes much of the stroke a rise of
#: stress; and between which shares of the stroke, from contracted to cold, positions lie.
FOLLOWED_AFTER, SPRING_Pa_m = [0, 2, 4, 5], 11e9
OUTERMOST = (0.05, 0.95)
#: How long a position is held and a period lasts, in heat_capacity / heat_loss: a position no shorter than so many
#: readings, in which the loop comes to rest as well, a period no shorter than that.
DWELL, PERIOD = 6.0, 20.0
DWELL_READINGS, PERIOD_s = 120.0, 40.0
#: So many positions at least, and as many as are held in that time: how a wire came to where it stands is what there is
#: to learn, and one that stands longer than it takes to come to rest shows it no better.
POSITIONS, HELD_s = 12, 144.0


@dataclass(frozen=True, slots=True)
class Part:
    """One stretch of work between two things the person does."""

    name: str  #: unique; the name of its log
    kind: str  #: a key of :data:`sma_actuator.characterise.parts.RUN`
    parameters: Mapping[str, Any] = field(default_factory=dict)
    duration_s: float = 0.0  #: roughly, for the progress bar


@dataclass(frozen=True, slots=True)
class PlanOptions:
    """What a person may choose.  Zero or empty: chosen from the bench's parameters."""

    loads_N: tuple[float, ...] = ()
    springs_N_m: tuple[tuple[float, float], ...] = ()  #: (stiffness [N/m], preload [N])
    masses_kg: tuple[float, ...] = ()
    heat_current_A: float = 0.0
    heat_s: float = 0.0
    cool_s: float = 0.0
    pulses: int = 3
    set_points: int = 5
    levels: int = 0  #: currents that are held one after the other; without them no log shows a wire that is held
    training_cycles: int = 200  #: at most; the measured wire of the bench stands after some 120
    fatigue_cycles: int = 100
    probe_places: int = 8
    average_s: float = 10.0  #: as in appendices A and B
    skip: tuple[str, ...] = ()  #: kinds of parts to leave out
    follow: str = ""  #: a parameter file: a second round, in which its model drives the wire


def make_plan(config, options: PlanOptions) -> list[Part]:
    """The parts, in the order of the thesis's chapter 4 and appendices.

    Raises ConfigError for loads the wire must not carry, a current that would overheat it, or a sensor that is missing.
    """
    _measurable(config, options)
    driven_N = _driven_N(config)
    loads_N = options.loads_N or _loads_N(_stresses_Pa(config), config)
    masses_kg = options.masses_kg or _masses_kg(driven_N)
    if "load_cell" not in options.skip and len(set(masses_kg)) < LEAST_MASSES:
        raise ConfigError(
            f"masses: {len(set(masses_kg))} are too few to calibrate a load cell; {LEAST_MASSES} different ones are "
            "wanted (--masses, in grams), or --skip load_cell where it is calibrated"
        )
    for load_N in (*loads_N, *(preload_N for _, preload_N in options.springs_N_m)):
        if not 0.0 < load_N < driven_N:
            raise ConfigError(
                f"loads: {load_N:g} N is outside what the wire is driven with, 0 to {driven_N:.3g} N "
                "(safety.stress_limit_fraction of wire.max_stress)"
            )
    if options.follow:
        return _second_round(config, options)
    if FULL in options.skip and PARTIAL not in options.skip:
        raise ConfigError(
            f"partial cycles: they go from end to end of what the {FULL} before them have shown, and --skip {FULL} "
            f"leaves those out; --skip {PARTIAL} too"
        )
    pulse = _pulse(config, options)
    parts = _of_the_bench(options, masses_kg)
    if options.training_cycles:
        trained = {"load_N": max(loads_N), "cycles": options.training_cycles, **pulse.drive, **pulse.most}
        parts.append(Part("training", "training", trained, TYPICAL_CYCLES * pulse.cycle_s))
    for label, load in _loads(loads_N, options.springs_N_m):
        parts += _under(label, load, options, pulse)
    middle = {"load_N": loads_N[len(loads_N) // 2], **pulse.drive}
    parts += _cycled(MANY, options.fatigue_cycles, 25, middle, pulse.cycle_s)
    return _with_displacement(config, [part for part in parts if part.kind not in options.skip])


@dataclass(frozen=True, slots=True)
class _Pulse:
    """How the wire is heated and cools."""

    heat_A: float
    most_A: float  #: where the wire still contracts further
    heat_s: float
    cool_s: float
    ramp_s: float  #: in which the current rises first; 0: at once

    @property
    def cycle_s(self) -> float:
        """How long one takes, without a ramp."""
        return self.heat_s + self.cool_s

    @property
    def at_rest_s(self) -> float:
        """How long it is heated after a ramp: a wire that contracts only at the end of one is seen at rest for that
        share of all the time that it was driven."""
        return max(self.heat_s, math.ceil(HOT_PART / (1.0 - HOT_PART) * self.ramp_s))

    @property
    def drive(self) -> dict[str, float]:
        """The parameters of a part that pulses at once."""
        return {"heat_current_A": round(self.heat_A, 4), "heat_s": self.heat_s, "cool_s": self.cool_s}

    @property
    def ramped(self) -> dict[str, float]:
        """What a part that may ramp has otherwise."""
        return {"ramp_s": round(self.ramp_s, 3), "heat_s": self.at_rest_s} if self.ramp_s else {}

    @property
    def most(self) -> dict[str, float]:
        """What a part has beside that in which the current may rise."""
        return {"most_current_A": round(self.most_A, 4)}


def _pulse(config, options: PlanOptions) -> _Pulse:
    """The pulse of a plan.  Raises ConfigError for a current that the supply does not give or the wire does not
    survive."""
    thermal = config.thermal
    time_constant_s = thermal.heat_capacity / thermal.heat_loss
    ramp_s = RAMP_READINGS / config.loop.rate if time_constant_s * config.loop.rate < QUICK_READINGS else 0.0
    heat_A = options.heat_current_A or default_heat_current_A(config)
    if ramp_s and not options.heat_current_A:
        heat_A = min(heat_A, unguarded_current_A(config))
    hottest_C = thermal.ambient_temperature + held_rise_K(
        heat_A, typical_resistance_Ohm(config.wire), CAPACITY_WITHIN * thermal.heat_loss
    )
    if not config.supply.bias_current < heat_A <= config.supply.max_current:
        raise ConfigError(
            f"heat current: {heat_A:g} A is not between supply.bias_current and supply.max_current, "
            f"{config.supply.max_current:g} A"
        )
    if not hottest_C <= thermal.max_temperature:
        raise ConfigError(
            f"heat current: {heat_A:g} A would bring the wire to {hottest_C:.0f} °C, above thermal.max_temperature, "
            f"even if it lost {CAPACITY_WITHIN:g} times thermal.heat_loss"
        )
    return _Pulse(
        heat_A=heat_A,
        most_A=options.heat_current_A or max(heat_A, largest_heat_current_A(config)),
        heat_s=options.heat_s or math.ceil(3.0 * time_constant_s),
        cool_s=options.cool_s or math.ceil(6.0 * time_constant_s),
        ramp_s=ramp_s,
    )


def _of_the_bench(options: PlanOptions, masses_kg: Sequence[float]) -> list[Part]:
    """What is measured of the bench, before the wire is."""
    average_s, places = options.average_s, options.probe_places
    forces_N = [round(m * GRAVITY_m_s2, 6) for m in masses_kg]
    return [
        Part("lead_resistance", "lead_resistance", {"average_s": average_s}, average_s),
        Part("load_cell", "load_cell", {"forces_N": forces_N, "average_s": average_s}, len(masses_kg) * average_s),
        Part("lvdt", "lvdt", {"places": places, "average_s": average_s}, places * average_s),
    ]


def _loads(loads_N: Sequence[float], springs_N_m: Sequence[tuple[float, float]]) -> list[tuple[str, dict[str, float]]]:
    """Weights and springs (stiffness, preload): their names, and the parameters of a part under them."""
    named = [(_name(load_N), {"load_N": load_N}) for load_N in loads_N]
    return named + [(f"spring_{k:g}N_m_{p:g}N", {"stiffness_N_m": k, "preload_N": p}) for k, p in springs_N_m]


def _under(label: str, load: Mapping[str, float], options: PlanOptions, pulse: _Pulse) -> list[Part]:
    """What is measured under a load."""
    full, moves = f"{FULL}_{label}", len(every_ordered_pair(options.set_points)) - 1
    parts = [
        Part(
            full,
            FULL,
            {**load, "cycles": options.pulses, **pulse.drive, **pulse.ramped, **pulse.most},
            options.pulses * (pulse.at_rest_s + pulse.cool_s + pulse.ramp_s),
        ),
        Part(
            f"{PARTIAL}_{label}",
            PARTIAL,
            {**load, "set_points": options.set_points, "after": full, **pulse.drive},
            moves * 2.0 + pulse.cool_s,
        ),
    ]
    if options.levels:
        parts.append(
            Part(
                f"{LEVELS}_{label}",
                LEVELS,
                {**load, "levels": options.levels, "after": full, **pulse.drive},
                0.75 * pulse.heat_s * len(every_ordered_pair(options.levels)) + pulse.cool_s,
            )
        )
    return parts


def _second_round(config, options: PlanOptions) -> list[Part]:
    """Setpoints followed by the model's own estimate and law, at each load."""
    area_m2 = config.wire.area_m2
    lag_s = config.thermal.heat_capacity / config.thermal.heat_loss
    dwell_s, period_s = max(DWELL_READINGS / config.loop.rate, DWELL * lag_s), max(PERIOD_s, PERIOD * lag_s)
    positions = max(POSITIONS, round(HELD_s / dwell_s))
    stiffness_N_m = SPRING_Pa_m * (config.wire.length / config.wire.strain_length_m) * area_m2
    stiffness_N_m = round(stiffness_N_m, max(1, _decimals(stiffness_N_m)))
    stresses_Pa = _stresses_Pa(config)
    between_Pa = np.sqrt(stresses_Pa[:-1] * stresses_Pa[1:])[FOLLOWED_AFTER]
    followed_N = _loads_N(np.append(between_Pa, stresses_Pa[-1]), config)
    loads_N, springs = options.loads_N or followed_N, options.springs_N_m or ((stiffness_N_m, followed_N[0]),)
    parts = [
        Part(
            f"{FOLLOWED}_{label}",
            FOLLOWED,
            {
                **load,
                "model": options.follow,
                "shares": followed_shares(number, positions),
                "dwell_s": dwell_s,
                "period_s": period_s,
            },
            dwell_s * (2 + positions + math.ceil(positions / FROM_COLD)) + 4.0 * period_s,
        )
        for number, (label, load) in enumerate(_loads(loads_N, springs))
    ]
    return _with_displacement(config, parts)


def _decimals(number: float) -> int:
    """How many leave three digits of it."""
    return 2 - math.floor(math.log10(number))


def _driven_N(config) -> float:
    """From this load on a wire is held where it is: a guard lets it contract no further."""
    return float(config.safety.stress_limit_fraction * config.wire.max_stress * config.wire.area_m2)


def _stresses_Pa(config) -> np.ndarray:
    """What the weights of a plan do to the wire, the lightest first."""
    most_Pa = HEAVIEST * _driven_N(config) / config.wire.area_m2
    return np.geomspace(min(LIGHTEST_Pa, LIGHTEST * most_Pa), most_Pa, LOADS)


def _loads_N(stresses_Pa: np.ndarray, config) -> tuple[float, ...]:
    """The loads that put a wire under these stresses: to a millinewton, or finer where the wire is fine."""
    loads_N = [float(load_N) for load_N in stresses_Pa * config.wire.area_m2]
    return tuple(round(load_N, max(3, _decimals(load_N))) for load_N in loads_N)


def _name(load_N: float) -> str:
    return f"{load_N:.{max(3, _decimals(load_N))}f}N"


def _masses_kg(most_N: float) -> tuple[float, ...]:
    """Calibration masses that pull less than that: the thesis's, and smaller ones beside the largest of them."""
    chosen = [m for m in MASSES_kg if m * GRAVITY_m_s2 < most_N]
    return tuple(m for m in chosen if m >= chosen[-1] / MASSES_OVER)


def followed_shares(number: int, positions: int) -> list[float]:
    """So many positions of the second round's log of this number, as shares of the stroke from contracted to cold, or
    of the model's doubt along it.

    Each log has others, in another order.  Where a position is always come to from the same one, a model learns that
    one history of it, and logs left out, which have it too, do not show what it makes of any other.
    """
    low, high = OUTERMOST
    rng = np.random.default_rng(number)
    shares = (rng.permutation(positions) + rng.random(positions)) / positions
    return [round(float(share), 3) for share in low + (high - low) * shares]


def _measurable(config, options: PlanOptions) -> None:
    """Raise ConfigError where a channel has no calibration that the plan does not measure either."""
    require_sense_resistor(config)
    if not config.load_cell.calibrated and "load_cell" in options.skip:
        raise ConfigError(
            "load_cell.slope, load_cell.offset: missing, and --skip load_cell leaves them out; without them the wire's "
            "stress is not known"
        )


def _with_displacement(config, parts: list[Part]) -> list[Part]:
    """The parts.  Raises ConfigError where one of them measures a displacement, and there is no sensor."""
    if not config.instruments.daq.lvdt_channel and any(p.kind not in ("lead_resistance", "load_cell") for p in parts):
        raise ConfigError(
            "instruments.daq.lvdt_channel: no displacement is measured; it is needed to characterise a wire"
        )
    return parts


def _cycled(kind: str, cycles: int, batch: int, parameters: dict, cycle_s: float) -> list[Part]:
    """Many cycles in batches, so that an interruption costs one batch."""
    return [
        Part(
            f"{kind}_{first:04d}",
            kind,
            {**parameters, "first_cycle": first, "cycles": (n := min(batch, cycles - first + 1))},
            n * cycle_s,
        )
        for first in range(1, cycles + 1, batch)
    ]


def typical_resistance_Ohm(wire) -> float:
    """Resistance of a wire of this geometry, from a resistivity between those of the phases (≈ 0.9 µΩ·m)."""
    return float(wire.resistance_Ohm(0.9e-6))


def default_heat_current_A(config) -> float:
    """The current whose steady temperature lies well above usual transformations and below derating."""
    thermal = config.thermal
    return _held_current_A(config, 0.7 * (min(HOT_ENOUGH_C, thermal.derate_temperature) - thermal.ambient_temperature))


def largest_heat_current_A(config) -> float:
    """The current whose steady temperature is that of derating, in a wire that loses as much more as is not known."""
    thermal = config.thermal
    return _held_current_A(config, CAPACITY_WITHIN * (thermal.derate_temperature - thermal.ambient_temperature))


def unguarded_current_A(config) -> float:
    """The current that may flow for ever by the heat limit of a rig, whatever the wire loses within its margin.

    Beyond it a wire whose resistance does not tell how hot it is, is let cool again and again
    (:class:`~sma_actuator.safety.thermal.WireHeat`), which parts a ramp's cycle.
    """
    thermal = attended(config).thermal
    return _held_current_A(
        config, UNGUARDED * (thermal.max_temperature - thermal.ambient_temperature) / thermal.heat_loss_margin
    )


def _held_current_A(config, rise_K: float) -> float:
    held_A = holding_A(rise_K, typical_resistance_Ohm(config.wire), config.thermal.heat_loss)
    return min(held_A, config.supply.max_current)
