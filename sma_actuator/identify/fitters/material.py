"""Asymptotes from material properties: Brammajyosula's R-phase on top of Liang & Rogers (5.41–5.54)."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class RPhaseAlloy:
    """What the equations need.  The defaults are those of low-temperature Flexinol.

    Moduli, densities, resistivities and transformation temperatures: Dynalloy, *Technical
    characteristics of Flexinol actuator wires*, and the R-phase after Brammajyosula et al. (2011).
    """

    rho_m_Ohm_m: float = 0.90e-6
    rho_a_Ohm_m: float = 0.80e-6
    rho_r_Ohm_m: float = 0.95e-6
    alpha_m_1_K: float = 1.0e-3
    alpha_a_1_K: float = 0.5e-3
    alpha_r_1_K: float = 0.5e-3
    modulus_m_Pa: float = 28e9
    modulus_a_Pa: float = 75e9
    modulus_r_Pa: float = 40e9
    austenite_start_C: float = 50.0
    austenite_finish_C: float = 62.0
    martensite_start_C: float = 38.0
    martensite_finish_C: float = 28.0
    r_start_C: float = 48.0
    r_finish_C: float = 37.0
    stress_slope_a_Pa_K: float = 8.0e6  #: C_A
    stress_slope_m_Pa_K: float = 8.0e6  #: C_M
    stress_slope_r_Pa_K: float = 18.0e6  #: C_R
    strain_m: float = 0.04  #: ε_LM
    strain_r: float = 0.004  #: ε_LR
    geometric_factor: float = 2.0  #: 2 at constant volume (2.13), 1 + 2ν otherwise (2.14)
    reference_temperature_C: float = 20.0


@dataclass(frozen=True, slots=True)
class Corner:
    """A corner of the loop in the (R, δ) plane."""

    resistance_Ohm: float
    displacement_m: float


def corners(alloy: RPhaseAlloy, length_m: float, unit_Ohm: float, stress_Pa: float) -> dict[str, Corner]:
    """Start and finish of heating (``Hs``, ``Hf``) and of cooling (``Cs``, ``Cf``); ``unit_Ohm``: resistance over
    resistivity [1/m]."""
    p, sigma, g, t0 = alloy, stress_Pa, alloy.geometric_factor, alloy.reference_temperature_C
    shift_a_K, shift_m_K, shift_r_K = (
        sigma / p.stress_slope_a_Pa_K,
        sigma / p.stress_slope_m_Pa_K,
        sigma / p.stress_slope_r_Pa_K,
    )
    strain_hs, strain_hf = p.strain_m + sigma / p.modulus_m_Pa, sigma / p.modulus_a_Pa
    cold_C, start_C = p.martensite_finish_C + shift_m_K, p.martensite_start_C + shift_m_K
    argument = (start_C - p.r_finish_C - shift_r_K) / (p.r_start_C - p.r_finish_C)
    r_phase = 0.5 * (math.cos(math.pi * min(max(argument, 0.0), 1.0)) + 1.0)
    rho_cs = r_phase * p.rho_r_Ohm_m * (1 + p.alpha_r_1_K * (start_C - t0)) + (1 - r_phase) * p.rho_a_Ohm_m * (
        1 + p.alpha_a_1_K * (start_C - t0)
    )
    strain_cs = r_phase * (p.strain_r + sigma / p.modulus_r_Pa) + (1 - r_phase) * sigma / p.modulus_a_Pa

    def corner(rho_Ohm_m: float, strain: float) -> Corner:
        return Corner(rho_Ohm_m * unit_Ohm * (1 + g * strain), length_m * strain)

    return {
        "Hs": corner(p.rho_m_Ohm_m * (1 + p.alpha_m_1_K * (p.austenite_start_C + shift_a_K - t0)), strain_hs),
        "Hf": corner(p.rho_a_Ohm_m * (1 + p.alpha_a_1_K * (p.austenite_finish_C + shift_a_K - t0)), strain_hf),
        "Cs": corner(rho_cs, strain_cs),
        "Cf": corner(p.rho_m_Ohm_m * (1 + p.alpha_m_1_K * (cold_C - t0)), strain_hs),
    }


def asymptotes_from_material(
    alloy: RPhaseAlloy, length_m: float, unit_Ohm: float, stress_Pa: float
) -> tuple[tuple[float, float], tuple[float, float]]:
    """(a_H, b_H), (a_C, b_C) [m/Ω, m] at one stress: the lines through the corners."""
    corner = corners(alloy, length_m, unit_Ohm, stress_Pa)
    lines = []
    for start, finish in (("Hs", "Hf"), ("Cs", "Cf")):
        s, f = corner[start], corner[finish]
        slope = (s.displacement_m - f.displacement_m) / (s.resistance_Ohm - f.resistance_Ohm)
        lines.append((slope, f.displacement_m - slope * f.resistance_Ohm))
    return lines[0], lines[1]
