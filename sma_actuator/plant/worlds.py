"""Physics to choose from by name: the bench at home, and worlds to fail in.

Home has the kinetics of a measured wire.  A world is a kinetics, and what real wires have that the bench at home
has not.  Each serves both alloys.  What is developed against one of them is judged in the others.

Sources beside those of :mod:`.materials`
    [C]  V. T. Morgan, "The overall convective heat transfer from smooth circular cylinders", Adv. Heat Transf. 11 (1975)
         199: Nu = 0.675 Ra^0.058 below Ra = 0.01 and 1.02 Ra^0.148 above, where a horizontal wire of 0.15 to 0.2 mm
         stands between 20 and 100 K above the air (90 to 110 W/(m²·K) at 60 K).
    [O]  A. Pathak, D. Brei, J. Luntz, "Transformation strain based method for characterization of convective heat
         transfer from shape memory alloy wires", Smart Mater. Struct. 19 (2010) 035005: orientation matters, and a
         vertical wire loses less than a horizontal one.  The factor is chosen [F].
    [P]  The training record of the measured wire (:mod:`.measured`), cycles 1 to 30
         at 200 MPa.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from .kinetics import Kinetics
from .materials import NI_TI, NI_TI_CU, WIRES, Material, Untrained, Wire
from .measured import lagoudas_for, measured_for

HOME = "measured"


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


@dataclass(frozen=True, slots=True)
class World:
    """One physics for the bench; the defaults of all but the kinetics are those of home."""

    sentence: str
    kinetics: Callable[[Material], Kinetics]
    heat_transfer: float = 1.0  #: over that of the wire at home
    convection_exponent: float = 0.0
    clamped: bool = False
    untrained: Untrained | None = None
    material: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)  #: of each alloy, what is otherwise
    austenite_warms_1_K: float = 0.0  #: more temperature coefficient of the austenite's resistivity

    def wire(self, wire: Wire) -> Wire:
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
        )


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
}


def wire_in_world(name: str, world: str = HOME) -> Wire:
    """A wire of the bench in a world, both by name.  Raises ValueError for a name that does not exist."""
    if name not in WIRES:
        raise ValueError(f"'{name}' is no wire of the bench; one of {', '.join(WIRES)} is wanted")
    if world not in WORLDS:
        raise ValueError(f"'{world}' is no physics of the bench; one of {', '.join(WORLDS)} is wanted")
    return WORLDS[world].wire(WIRES[name])
