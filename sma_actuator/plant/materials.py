"""What the wires of the bench are made of, with where each figure comes from.

Sources
    [D]  Dynalloy Inc., *Technical characteristics of Flexinol actuator wires*, F1140: density 6.45 g/cm³,
         specific heat 0.20 cal/(g·°C), latent heat 5.78 cal/g, expansion 6.6e-6 and 11.0e-6 /°C, moduli
         28–41 and 83 GPa, resistivity 80–100 µΩ·cm, 0.006 in wire: 55 Ω/m, 410 mA contracts in 1 s; thermal
         conductivity of Ni-Ti 8.6 W/(m·K) as martensite, 18 as austenite.
    [B]  R. Brammajyosula, V. Buravalla, A. Khandelwal, "Model for resistance evolution in shape memory alloys
         including R-phase", Smart Materials and Structures 20 (2011) 035015: three phases, each with its
         resistivity and temperature coefficient; R-phase the most resistive, its band the steepest in stress.
    [L]  C. Liang, C. A. Rogers, "One-dimensional thermomechanical constitutive relations for shape memory
         materials", J. Intell. Mater. Syst. Struct. 1 (1990) 207: cosine kinetics, constitutive equation,
         slopes of 7–14 MPa/K.
    [W]  That copper narrows the hysteresis to about 10 K and suppresses the R-phase: K. R. Melton, O. Mercier,
         "Deformation behavior of NiTi-based alloys", Metall. Trans. A 9 (1978) 1487;
         Nam, Saburi and Shimizu, "Cu-content dependence of shape memory characteristics in Ti-Ni-Cu alloys", Mater.
         Trans. JIM 31 (1990) 959.
    [T]  The thesis's figures 40–48 (Flexinol) and 49–56, 101 (NT-H): shape of the loops, strokes,
         ends of R.
    [F]  No measurement of these very wires: chosen inside the ranges of the sources, so that the ends of R
         and the stroke come out as in [T], and Ω/m as in [D].
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import exp

from .kinetics import Kinetics, LiangRogers


@dataclass(frozen=True, slots=True)
class Phase:
    """One crystal structure.  Resistivity is ρ(T) = ρ_ref [1 + α (T − T_ref)]."""

    resistivity_Ohm_m: float
    resistivity_temperature_coefficient_1_K: float
    modulus_Pa: float
    expansion_1_K: float


@dataclass(frozen=True, slots=True)
class Material:
    """An alloy as drawn, trained and annealed.  Temperatures are those at zero stress."""

    name: str
    density_kg_m3: float
    specific_heat_J_kgK: float
    latent_heat_J_kg: float  #: austenite → martensite, in all
    latent_heat_r_J_kg: float  #: the part of it that austenite → R-phase releases
    martensite: Phase
    austenite: Phase
    r_phase: Phase
    austenite_start_C: float
    austenite_finish_C: float
    martensite_start_C: float
    martensite_finish_C: float
    r_start_C: float
    r_finish_C: float
    r_hysteresis_K: float  #: R → austenite on heating lags austenite → R on cooling by this
    has_r_phase: bool
    stress_slope_Pa_K: float  #: C_M = C_A (Clausius–Clapeyron)
    stress_slope_r_Pa_K: float  #: C_R
    saturation_strain: float  #: transformation strain of martensite at high stress
    saturation_strain_r: float
    training_stress_Pa: float  #: ε_L(σ) = ε_sat (1 − exp(−(σ + σ_training)/σ_scale))
    strain_stress_scale_Pa: float
    strain_shape: float  #: κ: transformation strain ∝ ξ (1 + κ (1 − ξ))
    martensite_resistivity_stress_1_Pa: float  #: relative rise of ρ_M per stress (orientation)
    geometric_factor: float  #: R ∝ 1 + g ε; 2 at constant volume
    reference_temperature_C: float
    conductivity_W_mK: float = 13.0  #: heat conduction along the wire, mean of both phases

    @property
    def liang_rogers(self) -> LiangRogers:
        """Kinetics between the four temperatures above."""
        return LiangRogers(
            austenite_start_C=self.austenite_start_C,
            austenite_finish_C=self.austenite_finish_C,
            martensite_start_C=self.martensite_start_C,
            martensite_finish_C=self.martensite_finish_C,
            stress_slope_Pa_K=self.stress_slope_Pa_K,
        )


@dataclass(frozen=True, slots=True)
class Untrained:
    """What a wire lacks before its first cycle; of each, exp(−N/cycles) is left after N."""

    hot_strain: float  #: by how much shorter the hot wire is than it will be
    cold_share: float  #: the same of the cold wire, over that of the hot one
    heating_K: float  #: by how much higher it transforms on heating
    cooling_K: float  #: and on cooling (below zero: lower, so that the hysteresis is wider)
    cycles: float

    def after(self, cycles: float) -> Untrained:
        """What it still lacks after so many."""
        left = exp(-cycles / self.cycles)
        return replace(
            self,
            hot_strain=left * self.hot_strain,
            heating_K=left * self.heating_K,
            cooling_K=left * self.cooling_K,
        )


@dataclass(frozen=True, slots=True)
class Sleeve:
    """A second body between the wire and the air, a tube or a coating; each over that of the bare wire."""

    heat_capacity: float
    inner_conductance: float  #: from the wire into it, over the bare wire's to the air
    outer_conductance: float  #: from it to the air, likewise


@dataclass(frozen=True, slots=True)
class Specimen:
    """One wire between two crimps, as it is; the defaults are those of the simplest physics."""

    name: str
    material: Material
    length_m: float
    diameter_m: float
    heat_transfer_W_m2K: float  #: still air and, unless clamped, conduction into the crimps together
    convection_exponent: float = 0.0  #: n of h ∝ (T − T_air)^n, which has the value above at 60 K
    clamped: bool = False  #: cold clamps at the ends: temperature varies along the wire; a coil has none
    coil_diameter_m: float = 0.0  #: mean diameter, where it is wound to a coil (:mod:`.coil`)
    wires: int = 1  #: so many like it pull side by side
    in_series: bool = False  #: the current goes through one after the other, not through all of them at once
    untrained: Untrained | None = None
    sleeve: Sleeve | None = None
    #: Martensite keeps the orientation of the stress it formed under; a larger one turns it to this share of its own at
    #: the least.  None: it follows at once.  Of straight wires.
    turned: float | None = None
    other_kinetics: Kinetics | None = None

    @property
    def kinetics(self) -> Kinetics:
        """How it transforms: Liang & Rogers with the material's temperatures, unless it has another."""
        return self.other_kinetics or self.material.liang_rogers

    @property
    def text(self) -> str:
        """Its alloy, size and form, for a person."""
        coil = f", a coil of {1e3 * self.coil_diameter_m:g} mm" if self.coil_diameter_m else ""
        several = f"{self.wires} × " if self.wires > 1 else ""
        return f"{self.material.name}, {several}{1e3 * self.length_m:g} mm of {1e3 * self.diameter_m:g} mm{coil}"

    def after(self, cycles: float) -> Specimen:
        """The same wire when it has done so many cycles, whatever it did meanwhile."""
        return self if self.untrained is None else replace(self, untrained=self.untrained.after(cycles))


NI_TI = Material(
    name="ni-ti",
    density_kg_m3=6450.0,  # [D]
    specific_heat_J_kgK=837.0,  # [D]
    latent_heat_J_kg=24.2e3,  # [D]
    latent_heat_r_J_kg=5.5e3,  # [F] about a quarter of the whole
    martensite=Phase(0.90e-6, 0.6e-3, 28e9, 6.6e-6),  # [F], modulus and expansion [D]
    austenite=Phase(0.775e-6, 0.4e-3, 75e9, 11.0e-6),  # [F], modulus and expansion [D]
    r_phase=Phase(0.91e-6, 0.3e-3, 40e9, 9.0e-6),  # [B], [F]
    austenite_start_C=51.0,  # [D] near 70 at the stress it is used at
    austenite_finish_C=62.0,
    martensite_start_C=38.0,
    martensite_finish_C=28.0,
    r_start_C=49.0,
    r_finish_C=37.0,
    r_hysteresis_K=2.0,  # [F] a few kelvin
    has_r_phase=True,
    stress_slope_Pa_K=8.0e6,  # [L]
    stress_slope_r_Pa_K=18.0e6,  # [B], [F]
    saturation_strain=0.045,  # [T]
    saturation_strain_r=0.004,  # [F] some tenths of a percent
    training_stress_Pa=35e6,
    strain_stress_scale_Pa=36e6,
    strain_shape=0.0,
    martensite_resistivity_stress_1_Pa=0.0,
    geometric_factor=2.0,
    reference_temperature_C=20.0,
)

NI_TI_CU = Material(
    name="ni-ti-cu",
    density_kg_m3=6450.0,
    specific_heat_J_kgK=500.0,  # [F]
    latent_heat_J_kg=16.0e3,  # [F]
    latent_heat_r_J_kg=0.0,
    martensite=Phase(1.02e-6, 0.3e-3, 23e9, 6.6e-6),  # [F]
    austenite=Phase(0.80e-6, 0.3e-3, 60e9, 11.0e-6),  # [F]
    r_phase=Phase(0.80e-6, 0.3e-3, 60e9, 11.0e-6),  # never present
    austenite_start_C=48.0,  # [W] hysteresis about 10 K
    austenite_finish_C=58.0,
    martensite_start_C=47.0,
    martensite_finish_C=37.0,
    r_start_C=-100.0,
    r_finish_C=-110.0,
    r_hysteresis_K=2.0,
    has_r_phase=False,
    stress_slope_Pa_K=9.0e6,
    stress_slope_r_Pa_K=9.0e6,
    saturation_strain=0.042,  # [T]
    saturation_strain_r=0.0,
    training_stress_Pa=3.4e6,
    strain_stress_scale_Pa=24e6,
    strain_shape=0.35,  # [T] orthorhombic martensite, first to form, strains most
    martensite_resistivity_stress_1_Pa=5e-10,  # [T] R_max rises with load, R_min does not
    geometric_factor=2.0,
    reference_temperature_C=20.0,
)

WIRES = {
    "flexinol": Specimen("flexinol", NI_TI, 0.100, 0.1524e-3, 125.0),
    "furukawa": Specimen("furukawa", NI_TI_CU, 0.060, 0.20e-3, 110.0),
    # [F] 24 turns, spring index 6; less heat transfer than of a straight wire of 0.254 mm, since the turns shade one
    # another
    "coil": Specimen("coil", NI_TI, 0.115, 0.254e-3, 80.0, coil_diameter_m=1.524e-3),
    # [D] the 0.004 in wire; [F] heat transfer, which grows as the diameter shrinks
    "bundle": Specimen("bundle", NI_TI, 0.100, 0.1016e-3, 160.0, wires=4),
}
