"""A wire that exists: phases and kinetics fitted to a record of a real one's resistance beside its displacement, when
they are asked for.

The record (M. Zuk, MK-Zuk/SMA-dataset, "static characteristics": current, voltage, contraction and surface temperature
of steady points, up in current and down again) has no licence, so neither it nor numbers from it are shipped: it is
read where it is.  Size and load are not stated: 0.42 m × 0.381 mm follow from resistance and stroke, 5 N is assumed
[F]. A single load says nothing of slopes with stress: they are those of :mod:`sma_actuator.plant.measured` and of the
material.
"""

from __future__ import annotations

import argparse
import csv
import dataclasses
from functools import cache
from math import exp, pi
from pathlib import Path
from typing import Any

import numpy as np

from sma_actuator.base.errors import UserError
from sma_actuator.plant.kinetics import Logistic, Measured
from sma_actuator.plant.materials import NI_TI, Material, Specimen
from sma_actuator.plant.measured import FLEXINOL_381UM, measured_for
from sma_actuator.plant.physics import LOGISTIC_OF_BAND
from sma_actuator.plant.worlds import DRAWN, WORLDS, World, wire_in_world, world_of

REAL = "real"  #: this physics, by name
PHYSICS = ", ".join((*WORLDS, REAL, f"{DRAWN}N"))  #: what `--physics` takes, in words
RECORD = Path(__file__).resolve().parents[3] / "shared" / "data" / "static_loop" / "static_loop.csv"
LENGTH_m, DIAMETER_m, LOAD_N = 0.42, 0.381e-3, 5.0
_LEAST_A = 0.1  #: below it the voltmeter's last digit is more than R moves by
_CAMERA_C = (50.0, 150.0)  #: where the camera tells the wire from the room and is not saturated
#: What is fitted, where the fit begins, and its bounds: shares, temperatures [°C] and widths [K] of two logistics for
#: each direction, middle, width and lag of the R-phase's band, strains of martensite and R-phase under this load,
#: resistivities [µΩ·m] and how they grow [1e-3/K], zero [mm].
_FITTED = {
    "heating_share": (0.7, 0.2, 1.0),
    "heating_C": (109.0, 90.0, 130.0),
    "heating_width_K": (2.5, 0.3, 10.0),
    "heating_tail_C": (105.0, 60.0, 140.0),
    "heating_tail_width_K": (15.0, 2.0, 60.0),
    "cooling_share": (0.7, 0.2, 1.0),
    "cooling_C": (64.0, 50.0, 80.0),
    "cooling_width_K": (3.0, 0.3, 10.0),
    "cooling_tail_C": (70.0, 40.0, 120.0),
    "cooling_tail_width_K": (10.0, 2.0, 60.0),
    "r_C": (88.0, 40.0, 130.0),
    "r_width_K": (10.0, 2.0, 30.0),
    "r_lag_K": (4.0, 0.0, 20.0),
    "strain_m": (0.04, 0.02, 0.07),
    "strain_r": (0.004, 0.0, 0.02),
    "rho_m": (0.85, 0.6, 1.2),
    "rho_a": (0.76, 0.5, 1.2),
    "rho_r": (0.92, 0.6, 1.4),
    "growth_m": (0.6, 0.0, 2.0),
    "growth_a": (0.4, 0.0, 1.5),
    "growth_r": (0.3, 0.0, 1.5),
    "zero_mm": (-17.0, -30.0, 5.0),
}
_UNSURE_GROWTH = 1.3  #: of a growth about where the fit begins, in 1e-3/K for each percent of error


@dataclasses.dataclass(frozen=True, slots=True)
class Points:
    """The record: arrays of shape (n,)."""

    heating: np.ndarray  #: bool
    temperature_C: np.ndarray
    displacement_m: np.ndarray  #: extension positive
    resistance_Ohm: np.ndarray  #: NaN where too little current flows


def physics_name(text: str) -> str:
    """The name of a physics, as an option takes it."""
    try:
        if text != REAL:
            world_of(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is no physics of the bench; one of {PHYSICS} is wanted") from None
    return text


def wire_of(name: str, physics: str) -> Specimen:
    """A wire of the bench in a physics, by their names.  Raises ValueError for a name that does not exist, UserError
    where the record is not here."""
    return real_world(RECORD).wire(wire_in_world(name)) if physics == REAL else wire_in_world(name, physics)


@cache
def real_world(record: Path) -> World:
    """The record's wire as a physics of the bench.  Raises UserError where it is not here."""
    found, material = fitted(read_points(record))
    stress_Pa = LOAD_N / (0.25 * pi * DIAMETER_m**2)
    oriented = 1.0 - exp(-(stress_Pa + material.training_stress_Pa) / material.strain_stress_scale_Pa)
    kinetics = Measured(
        *(
            tuple(
                Logistic(weight, centre_C - stress_Pa / slope_Pa_K, width_K, slope_Pa_K)
                for weight, centre_C, width_K in (
                    (found[f"{way}_share"], found[f"{way}_C"], found[f"{way}_width_K"]),
                    (1.0 - found[f"{way}_share"], found[f"{way}_tail_C"], found[f"{way}_tail_width_K"]),
                )
            )
            for way, slope_Pa_K in (
                ("heating", FLEXINOL_381UM.heating[0].slope_Pa_K),
                ("cooling", FLEXINOL_381UM.cooling[0].slope_Pa_K),
            )
        )
    )
    r_C, half_K = (
        found["r_C"] - stress_Pa / material.stress_slope_r_Pa_K,
        0.5 * found["r_width_K"] / LOGISTIC_OF_BAND,
    )
    changed: dict[str, Any] = {
        "saturation_strain": found["strain_m"] / oriented,
        "saturation_strain_r": found["strain_r"] / oriented,
        "r_start_C": r_C + half_K,
        "r_finish_C": r_C - half_K,
        "r_hysteresis_K": found["r_lag_K"],
        **{
            phase: dataclasses.replace(
                getattr(material, phase),
                resistivity_Ohm_m=1e-6 * found[f"rho_{letter}"],
                resistivity_temperature_coefficient_1_K=1e-3 * found[f"growth_{letter}"],
            )
            for phase, letter in (("martensite", "m"), ("austenite", "a"), ("r_phase", "r"))
        },
    }
    return World(
        "phases and kinetics of a real wire, fitted to its resistance and displacement",
        lambda of: kinetics if of.name == NI_TI.name else measured_for(of),
        material={NI_TI.name: changed},
    )


def read_points(record: Path) -> Points:
    """The record's points.  Raises UserError where it is not here."""
    if not record.exists():
        raise UserError(
            f"physics '{REAL}': {record} is not here; the record has no licence and is not shipped (docs/physics.md "
            f"says whose it is)"
        )
    with record.open(newline="", encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    current_A, voltage_V, contraction_mm, camera_C = (
        np.array([float(row[name]) for row in rows])
        for name in ("current_A", "voltage_V", "contraction_mm", "temperature_C")
    )
    power_W = current_A * voltage_V
    seen = (camera_C > _CAMERA_C[0]) & (camera_C < _CAMERA_C[1])
    return Points(
        heating=np.array([row["branch"] == "heating" for row in rows]),
        temperature_C=np.polyval(np.polyfit(power_W[seen], camera_C[seen], 1), power_W),
        displacement_m=-1e-3 * contraction_mm,
        resistance_Ohm=np.where(current_A >= _LEAST_A, voltage_V / np.maximum(current_A, _LEAST_A), np.nan),
    )


def fitted(points: Points, material: Material = NI_TI) -> tuple[dict[str, float], Material]:
    """What of :data:`_FITTED` the points tell, by least squares in % of both ranges; with the material that has the
    rest."""
    from scipy.optimize import least_squares

    first, low, high = (np.array(column) for column in zip(*_FITTED.values(), strict=True))
    stroke_m, range_Ohm = np.ptp(points.displacement_m), np.ptp(points.resistance_Ohm[~np.isnan(points.resistance_Ohm)])
    growths = [i for i, name in enumerate(_FITTED) if name.startswith("growth")]

    def errors(values: np.ndarray) -> np.ndarray:
        displacement_m, resistance_Ohm = at_points(
            dict(zip(_FITTED, values, strict=True)), points.heating, points.temperature_C, material
        )
        off = 100.0 * (resistance_Ohm - points.resistance_Ohm) / range_Ohm
        return np.concatenate(
            (
                100.0 * (displacement_m - points.displacement_m) / stroke_m,
                off[np.isfinite(off)],
                (values - first)[growths] / _UNSURE_GROWTH,
            )
        )

    found = least_squares(errors, first, bounds=(low, high), x_scale=np.maximum(np.abs(first), 1e-3))
    return {name: float(value) for name, value in zip(_FITTED, found.x, strict=True)}, material


def at_points(
    found: dict[str, float], heating: np.ndarray, temperature_C: np.ndarray, material: Material
) -> tuple[np.ndarray, np.ndarray]:
    """Displacement and resistance on the outer loop, as :mod:`sma_actuator.plant.physics` has them there."""
    stress_Pa = LOAD_N / (0.25 * pi * DIAMETER_m**2)

    def band(middle_C: float, width_K: float, at_C: np.ndarray) -> np.ndarray:
        return np.asarray(1.0 / (1.0 + np.exp(np.clip((at_C - middle_C) / width_K, -60.0, 60.0))))

    def left(way: str) -> np.ndarray:
        share = found[f"{way}_share"]
        core = band(found[f"{way}_C"], found[f"{way}_width_K"], temperature_C)
        return share * core + (1.0 - share) * band(found[f"{way}_tail_C"], found[f"{way}_tail_width_K"], temperature_C)

    martensite = np.where(heating, left("heating"), left("cooling"))
    coldest_C = np.maximum(temperature_C, found["cooling_C"] + 2.197 * found["cooling_width_K"])
    formed = band(found["r_C"], found["r_width_K"], coldest_C)
    kept = formed.max() * band(found["r_C"], found["r_width_K"], temperature_C - found["r_lag_K"])
    r = np.where(heating, kept, formed) * (1.0 - martensite)
    shares = (martensite, 1.0 - martensite - r, r)
    above_K = temperature_C - material.reference_temperature_C
    phases = (material.martensite, material.austenite, material.r_phase)
    modulus_Pa = sum(s * p.modulus_Pa for s, p in zip(shares, phases, strict=True))
    expansion = sum(s * p.expansion_1_K for s, p in zip(shares, phases, strict=True)) * above_K
    strain = found["strain_m"] * martensite + found["strain_r"] * r + stress_Pa / modulus_Pa + expansion
    rho = sum(
        1e-6 * found[f"rho_{letter}"] * s * (1.0 + 1e-3 * found[f"growth_{letter}"] * above_K)
        for s, letter in zip(shares, "mar", strict=True)
    )
    area_m2 = 0.25 * pi * DIAMETER_m**2
    resistance_Ohm = rho * LENGTH_m / area_m2 * (1.0 + material.geometric_factor * strain)
    return LENGTH_m * strain + 1e-3 * found["zero_mm"], np.asarray(resistance_Ohm)
