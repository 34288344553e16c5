"""Kinetics of a wire that was measured, and of a constitutive model beside it, placed on an alloy of the bench.

The distribution is fitted to strain against temperature of a trained 0.381 mm Flexinol wire (90 °C type) at 50, 150 and
200 MPa, by ``sma-actuator loop --kinetics`` (docs/physics.md has the errors, on stresses left out too).  The data are
those of github.com/Mecanon/morphing_wing, commit 28d027de4bca, folder experimental/sma_database:

    Copyright (c) 2016 Mecanon.  MIT licence: permission is hereby granted, free of charge, to any person obtaining a
    copy of this software and associated documentation files, to deal in it without restriction, provided that this
    notice is included.  It is provided "as is", without warranty of any kind.

Only the fitted numbers are here.
"""

from __future__ import annotations

from functools import cache

from .kinetics import Logistic, Measured, SmoothHardening
from .materials import Material

FLEXINOL_381UM = Measured(
    heating=(
        Logistic(weight=0.4849, centre_C=77.416, width_K=1.166, slope_Pa_K=7.748e6),
        Logistic(weight=0.1070, centre_C=77.004, width_K=2.870, slope_Pa_K=13.04e6),
        Logistic(weight=0.4081, centre_C=79.193, width_K=14.67, slope_Pa_K=9.558e6),
    ),
    cooling=(
        Logistic(weight=0.4956, centre_C=56.401, width_K=1.378, slope_Pa_K=7.399e6),
        Logistic(weight=0.4559, centre_C=51.653, width_K=9.943, slope_Pa_K=7.205e6),
        Logistic(weight=0.0485, centre_C=112.006, width_K=10.314, slope_Pa_K=8.229e6),
    ),
)
#: The maker's two types: of the 70 °C wire all temperatures lie lower by this.
LOW_TEMPERATURE_TYPE_K = -20.0
#: No loop of a Ni-Ti-Cu wire was at hand: its distribution is taken to be as much narrower as its hysteresis is.
NI_TI_CU_WIDTH = 0.55


@cache
def _quantiles_C(share: float) -> tuple[float, float]:
    return FLEXINOL_381UM.quantiles_C(share)


def measured_for(material: Material) -> Measured:
    """The measured distribution, moved to where an alloy of the bench transforms."""
    if material.name != "ni-ti-cu":
        return FLEXINOL_381UM.mapped((LOW_TEMPERATURE_TYPE_K, 1.0), (LOW_TEMPERATURE_TYPE_K, 1.0))
    half_C = _quantiles_C(0.5)
    heating_C = 0.5 * (material.austenite_start_C + material.austenite_finish_C)
    cooling_C = 0.5 * (material.martensite_start_C + material.martensite_finish_C)
    return FLEXINOL_381UM.mapped(
        (heating_C - NI_TI_CU_WIDTH * half_C[0], NI_TI_CU_WIDTH),
        (cooling_C - NI_TI_CU_WIDTH * half_C[1], NI_TI_CU_WIDTH),
        material.stress_slope_Pa_K,
    )


def measured_between(
    austenite_start_C: float,
    austenite_finish_C: float,
    martensite_start_C: float,
    martensite_finish_C: float,
    stress_slope_Pa_K: float,
) -> Measured:
    """The measured shape with the tenth and the ninetieth percent of both transformations at these temperatures."""
    most_C, least_C = _quantiles_C(0.9), _quantiles_C(0.1)
    heating = (austenite_finish_C - austenite_start_C) / (least_C[0] - most_C[0])
    cooling = (martensite_start_C - martensite_finish_C) / (least_C[1] - most_C[1])
    return FLEXINOL_381UM.mapped(
        (austenite_start_C - heating * most_C[0], heating),
        (martensite_finish_C - cooling * most_C[1], cooling),
        stress_slope_Pa_K,
    )


#: A wire that others measured (facts of github.com/MK-Zuk/SMA-dataset, of which nothing else is here): at a load of
#: some 45 MPa half contracted at 107 °C and by 95 % at 125 °C, half back at 64 °C.  The shape is the one above,
#: narrower on heating.
HOT_HEATING, HOT_COOLING = (55.2, 0.6), (2.0, 1.0)


def hot_for(_material: Material) -> Measured:
    """The measured distribution where that wire transforms, whatever the alloy."""
    return FLEXINOL_381UM.mapped(HOT_HEATING, HOT_COOLING)


def lagoudas_for(material: Material) -> SmoothHardening:
    """Smooth hardening about the middles of an alloy's bands, four times as wide as its cosines at the foot."""
    heating_C = 0.5 * (material.austenite_start_C + material.austenite_finish_C)
    cooling_C = 0.5 * (material.martensite_start_C + material.martensite_finish_C)
    heating_K = 2.0 * (material.austenite_finish_C - material.austenite_start_C)
    cooling_K = 2.0 * (material.martensite_start_C - material.martensite_finish_C)
    return lagoudas_between(
        austenite_start_C=heating_C - heating_K,
        austenite_finish_C=heating_C + heating_K,
        martensite_start_C=cooling_C + cooling_K,
        martensite_finish_C=cooling_C - cooling_K,
        stress_slope_Pa_K=material.stress_slope_Pa_K,
    )


def lagoudas_between(
    austenite_start_C: float,
    austenite_finish_C: float,
    martensite_start_C: float,
    martensite_finish_C: float,
    stress_slope_Pa_K: float,
) -> SmoothHardening:
    """Smooth hardening between these temperatures; the exponents differ at the four ends, within 0.1 to 0.4."""
    return SmoothHardening(
        austenite_start_C=austenite_start_C,
        austenite_finish_C=austenite_finish_C,
        martensite_start_C=martensite_start_C,
        martensite_finish_C=martensite_finish_C,
        heating_slope_Pa_K=stress_slope_Pa_K,
        cooling_slope_Pa_K=0.9 * stress_slope_Pa_K,
        heating_exponents=(0.25, 0.35),
        cooling_exponents=(0.3, 0.2),
    )
