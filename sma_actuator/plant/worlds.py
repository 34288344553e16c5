"""Physics to choose from by name: the bench at home, and worlds to fail in.

Home has the kinetics of a measured wire.  A world is a kinetics, and what real wires have that the bench at home
has not.  Each serves both alloys.  What is developed against one of them is judged in the others.

Sources beside those of :mod:`.materials`
    [C]  V. T. Morgan, "The overall convective heat transfer from smooth circular cylinders", Adv. Heat Transf. 11
         (1975) 199: Nu = 0.675 Ra^0.058 below Ra = 0.01 and 1.02 Ra^0.148 above, where a horizontal wire of 0.15 to 0.2
         mm stands between 20 and 100 K above the air (90 to 110 W/(m²·K) at 60 K).
    [O]  A. Pathak, D. Brei, J. Luntz, "Transformation strain based method for characterization of convective heat
         transfer from shape memory alloy wires", Smart Mater. Struct. 19 (2010) 035005: orientation matters, and a
         vertical wire loses less than a horizontal one.  The factor is chosen [F].
    [H]  D. C. Lagoudas, D. Hartl, Y. Chemisky, L. Machado, P. Popov, Int. J. Plast. 32–33 (2012) 155: the strain of
         martensite is that of the stress it formed under.  How far a larger one turns it is chosen [F].
    [P]  The training record of the measured wire (:mod:`.measured`), cycles 1 to 30
         at 200 MPa.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from .kinetics import Activated, Kinetics, Measured
from .materials import NI_TI, NI_TI_CU, WIRES, Material, Phase, Sleeve, Specimen, Untrained
from .measured import hot_for, lagoudas_for, measured_between, measured_for

HOME = "measured"
DRAWN = "drawn-"  #: and a number: physics that nobody chose


def _liang_rogers_for(material: Material) -> Kinetics:
    return material.liang_rogers


#: [P] The hot end moves by 0.52 % strain and the cold one by 0.21 % from cycle 2 to 30, the half transformation on
#: cooling rises by 4.9 K and that on heating stands; 1 − exp(−N/25) goes through all of it.
IN_TRAINING = Untrained(hot_strain=0.0083, cold_share=0.4, heating_K=0.0, cooling_K=-7.9, cycles=25.0)

#: [F] An R-phase that is stronger, comes earlier and lags more than at home.  In Ni-Ti-Cu its place is taken by the
#: orthorhombic phase, through which a wire with a tenth of copper goes first (Nam and others, [W] of the materials).
_OTHER_R_PHASE: Mapping[str, Mapping[str, Any]] = {
    "ni-ti": {
        "r_phase": replace(NI_TI.r_phase, resistivity_Ohm_m=0.95e-6, modulus_Pa=34e9),
        "r_start_C": 58.0,
        "r_finish_C": 41.0,
        "r_hysteresis_K": 4.0,
        "stress_slope_r_Pa_K": 14.0e6,
        "saturation_strain_r": 0.008,
        "latent_heat_r_J_kg": 7.5e3,
    },
    "ni-ti-cu": {
        "has_r_phase": True,
        "r_phase": replace(NI_TI_CU.r_phase, resistivity_Ohm_m=0.90e-6, modulus_Pa=40e9),
        "r_start_C": 58.0,
        "r_finish_C": 46.0,
        "r_hysteresis_K": 3.0,
        "stress_slope_r_Pa_K": 14.0e6,
        "saturation_strain_r": 0.007,
        "latent_heat_r_J_kg": 4.0e3,
    },
}


def _activated(barriers: Measured) -> Kinetics:
    """[F] Half a kelvin and an attempt a second: a wire heated by 30 K/s lags 2 K behind one heated by 1 K/s, and
    what is left to transform after a second at rest creeps on over as much in a minute; a front that crosses a grain in
    0.15 s lags as long again behind any rate."""
    return Activated(barriers, per_K=0.6, attempts_1_s=1.0, crossing_s=0.15)


def _activated_for(material: Material) -> Kinetics:
    return _activated(measured_for(material))


def _hot_activated_for(material: Material) -> Kinetics:
    return _activated(hot_for(material))


@dataclass(frozen=True, slots=True)
class World:
    """One physics for the bench; the defaults of all but the kinetics are those of home."""

    sentence: str
    kinetics: Callable[[Material], Kinetics]
    heat_transfer: float = 1.0  #: over that of the wire at home
    convection_exponent: float = 0.0
    clamped: bool = False
    untrained: Untrained | None = None
    sleeve: Sleeve | None = None
    turned: float | None = None
    material: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)  #: of each alloy, what is otherwise
    austenite_warms_1_K: float = 0.0  #: more temperature coefficient of the austenite's resistivity

    def wire(self, wire: Specimen) -> Specimen:
        """A wire of the bench as it is in this world."""
        material = replace(wire.material, **self.material.get(wire.material.name, {}))
        austenite = replace(
            material.austenite,
            resistivity_temperature_coefficient_1_K=material.austenite.resistivity_temperature_coefficient_1_K
            + self.austenite_warms_1_K,
        )
        material = replace(material, austenite=austenite)
        return replace(
            wire,
            material=material,
            other_kinetics=self.kinetics(material),
            heat_transfer_W_m2K=wire.heat_transfer_W_m2K * self.heat_transfer,
            convection_exponent=self.convection_exponent,
            clamped=self.clamped,
            untrained=self.untrained,
            sleeve=self.sleeve,
            turned=self.turned,
        )


#: [F] A PTFE tube of 0.3 by 0.55 mm about a wire of 0.15 mm: 2.2 MJ/(m³·K) over the wire's 5.4 and the sections' areas
#: give the heat capacity; across the gap the air alone conducts five times what the bare wire loses, and a wider
#: surface loses more.  What a coating of silicone or a harness does is between this and none.
IN_A_TUBE = Sleeve(heat_capacity=4.0, inner_conductance=3.0, outer_conductance=1.7)

WORLDS: dict[str, World] = {
    HOME: World(
        "the distribution of transformation temperatures of a measured wire, a constant heat transfer", measured_for
    ),
    "liang_rogers": World("Liang & Rogers' cosines, one temperature, a constant heat transfer", _liang_rogers_for),
    "lagoudas": World("Lagoudas' smooth hardening, minor loops that stand until a surface is reached", lagoudas_for),
    "clamped": World(
        "measured, with cold clamps and a natural convection that grows with temperature [C]",
        measured_for,
        convection_exponent=0.15,
        clamped=True,
    ),
    "vertical": World(
        "smooth hardening, hung vertically [O]: less heat transfer; the hot wire's resistance rises more",
        lagoudas_for,
        heat_transfer=0.8,
        convection_exponent=0.06,
        austenite_warms_1_K=4e-4,
    ),
    "other_r_phase": World(
        "measured, with another intermediate phase: stronger, earlier and with more hysteresis",
        measured_for,
        material=_OTHER_R_PHASE,
    ),
    "in_training": World(
        "measured, but untrained: the hot end moves and the hysteresis narrows cycle by cycle [P]",
        measured_for,
        convection_exponent=0.15,
        untrained=IN_TRAINING,
    ),
    "foreign": World(
        "measured, clamped, in natural convection, with another intermediate phase and a warmer resistance",
        measured_for,
        convection_exponent=0.15,
        clamped=True,
        material=_OTHER_R_PHASE,
        austenite_warms_1_K=4e-4,
    ),
    "sleeved": World(
        "measured, in a thin tube that warms up with the wire and keeps it warm afterwards",
        measured_for,
        convection_exponent=0.15,
        sleeve=IN_A_TUBE,
    ),
    "oriented": World(
        "smooth hardening; martensite stays as long as the load made it under which it formed [H]",
        lagoudas_for,
        convection_exponent=0.1,
        turned=0.7,
    ),
    "hot": World(
        "measured, as hot as another wire that was measured: half contracted at 107 °C, by 95 % at 125 °C", hot_for
    ),
    "activated": World(
        "grains that cross their barriers by thermal activation: lags while it moves, creeps while it is held",
        _activated_for,
        convection_exponent=0.15,
    ),
    "hot_activated": World(
        "the same, as hot as `hot`, with the other intermediate phase: half way its resistance has hardly fallen",
        _hot_activated_for,
        convection_exponent=0.15,
        material={alloy: {**phase, "r_start_C": 62.0, "r_finish_C": 45.0} for alloy, phase in _OTHER_R_PHASE.items()},
    ),
}


def world_of(name: str) -> World:
    """A world by its name, one of :data:`WORLDS` or :data:`DRAWN` and a number.  Raises ValueError for any other."""
    number = name.removeprefix(DRAWN)
    if name.startswith(DRAWN) and number.isascii() and number.isdigit():
        return _drawn(int(number))
    if name not in WORLDS:
        raise ValueError(
            f"'{name}' is no physics of the bench; one of {', '.join(WORLDS)} is wanted, or {DRAWN} and a number"
        )
    return WORLDS[name]


def wire_in_world(name: str, world: str = HOME) -> Specimen:
    """A wire of the bench in a world, both by name.  Raises ValueError for a name that does not exist."""
    if name not in WIRES:
        raise ValueError(f"'{name}' is no wire of the bench; one of {', '.join(WIRES)} is wanted")
    return world_of(world).wire(WIRES[name])


def _drawn(number: int) -> World:
    """A world that nobody chose: all that a wire may have, drawn by a generator that this number seeds.

    Every draw is independent of the others and lies where wires of the makers and of the literature lie, or as far to
    either side of the bench's own as these scatter [F]; the alloys differ.
    """
    rng = np.random.default_rng((number, 1))
    between, chance = rng.uniform, rng.random
    kinetics = (_liang_rogers_for, lagoudas_for, _measured_in)[rng.integers(3)]
    return World(
        f"drawn by the number {number}",
        kinetics,
        heat_transfer=between(0.8, 1.15),
        convection_exponent=between(0.0, 0.2),
        clamped=chance() < 0.4,
        untrained=replace(IN_TRAINING, hot_strain=between(0.3, 1.0) * IN_TRAINING.hot_strain)
        if chance() < 0.25
        else None,
        material={material.name: _drawn_material(rng, material) for material in (NI_TI, NI_TI_CU)},
        austenite_warms_1_K=between(0.0, 4e-4),
    )


def _measured_in(material: Material) -> Kinetics:
    """The measured distribution, wherever the bands of a material lie."""
    return measured_between(
        material.austenite_start_C,
        material.austenite_finish_C,
        material.martensite_start_C,
        material.martensite_finish_C,
        material.stress_slope_Pa_K,
    )


def _drawn_material(rng: np.random.Generator, material: Material) -> dict[str, Any]:
    """What one alloy of a drawn world has otherwise."""
    between = rng.uniform
    higher_K, wider_K, width = between(-4.0, 5.0), between(-3.0, 4.0), between(0.7, 1.5)

    def band(first_C: float, last_C: float, moved_K: float) -> tuple[float, float]:
        middle_C, half_K = 0.5 * (first_C + last_C) + moved_K, 0.5 * width * (last_C - first_C)
        return middle_C - half_K, middle_C + half_K

    def phase(like: Phase) -> Phase:
        return replace(
            like,
            resistivity_Ohm_m=like.resistivity_Ohm_m * between(0.95, 1.05),
            resistivity_temperature_coefficient_1_K=like.resistivity_temperature_coefficient_1_K * between(0.5, 1.5),
            modulus_Pa=like.modulus_Pa * between(0.8, 1.25),
        )

    austenite_start_C, austenite_finish_C = band(
        material.austenite_start_C, material.austenite_finish_C, higher_K + 0.5 * wider_K
    )
    martensite_start_C, martensite_finish_C = band(
        material.martensite_start_C, material.martensite_finish_C, higher_K - 0.5 * wider_K
    )
    drawn: dict[str, Any] = {
        "austenite_start_C": austenite_start_C,
        "austenite_finish_C": austenite_finish_C,
        "martensite_start_C": martensite_start_C,
        "martensite_finish_C": martensite_finish_C,
        "martensite": phase(material.martensite),
        "austenite": phase(material.austenite),
        "specific_heat_J_kgK": material.specific_heat_J_kgK * between(0.85, 1.2),
        "latent_heat_J_kg": material.latent_heat_J_kg * between(0.75, 1.25),
        "stress_slope_Pa_K": between(6.5e6, 11e6),
        "training_stress_Pa": material.training_stress_Pa * between(0.7, 1.4),
        "strain_stress_scale_Pa": material.strain_stress_scale_Pa * between(0.8, 1.25),
        "strain_shape": between(0.0, 0.4),
        "martensite_resistivity_stress_1_Pa": between(0.0, 6e-10),
        "geometric_factor": between(1.8, 2.2),
    }
    if rng.random() < (0.8 if material.has_r_phase else 0.4):
        drawn |= {
            "has_r_phase": True,
            "r_phase": replace(phase(NI_TI.r_phase), resistivity_Ohm_m=between(0.85e-6, 0.96e-6)),
            "r_start_C": austenite_start_C + between(-4.0, 8.0),
            "r_finish_C": austenite_start_C + between(-16.0, -6.0),
            "r_hysteresis_K": between(1.5, 4.5),
            "stress_slope_r_Pa_K": between(13e6, 19e6),
            "saturation_strain_r": between(0.002, 0.008),
            "latent_heat_r_J_kg": between(3e3, 7e3),
        }
    else:
        drawn["has_r_phase"] = False
    return drawn
