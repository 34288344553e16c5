"""What the forward model knows of a wire, its bias spring and its drive: one YAML file.

The sections are declared once, with unit, range and source; the fit moves the values inside the
``lo``/``hi`` of its own list (:mod:`.fitting`), never outside what is declared here.
"""

from __future__ import annotations

import dataclasses
import difflib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import yaml

from sma_actuator.base.errors import UserError
from sma_actuator.base.parameters import from_mapping, parameter, section, to_mapping
from sma_actuator.base.yaml_text import read_yaml
from sma_actuator.plant import materials
from sma_actuator.plant.kinetics import Kinetics
from sma_actuator.plant.measured import lagoudas_between, measured_between
from sma_actuator.plant.physics import Constants, constants

_HUGE_Pa = 1.0e15  #: stress at which oriented martensite would saturate: the maker gives one strain, so at once


@dataclass(frozen=True)
class WireData:
    """The wire as the maker sells it; temperatures at zero stress."""

    name: str = parameter("wire", "name of the wire")
    kinetics: str = parameter(
        "liang_rogers",
        "how it transforms: cosines between the four temperatures; the shape of a measured wire, whose tenth and "
        "ninetieth percent lie there; or smooth hardening between them",
        choices=("liang_rogers", "measured", "lagoudas"),
    )
    length_m: float = parameter(description="length between the crimps", unit="m", lo=0.005, hi=20.0)
    diameter_m: float = parameter(description="diameter", unit="m", lo=1e-5, hi=5e-3)
    density_kg_m3: float = parameter(6450.0, "density", "kg/m³", 5000.0, 8000.0)
    specific_heat_J_kgK: float = parameter(837.0, "specific heat", "J/(kg·K)", 300.0, 1200.0)
    latent_heat_J_kg: float = parameter(24.2e3, "latent heat of martensite to austenite", "J/kg", 0.0, 60e3)
    austenite_start_C: float = parameter(description="A_s", unit="°C", lo=-50.0, hi=200.0)
    austenite_finish_C: float = parameter(description="A_f", unit="°C", lo=-50.0, hi=250.0)
    martensite_start_C: float = parameter(description="M_s", unit="°C", lo=-100.0, hi=200.0)
    martensite_finish_C: float = parameter(description="M_f", unit="°C", lo=-150.0, hi=200.0)
    stress_slope_Pa_K: float = parameter(8.0e6, "Clausius-Clapeyron slope, C_M = C_A", "Pa/K", 2e6, 30e6)
    transformation_strain: float = parameter(0.02, "transformation strain of martensite under the bias", "", 0.0, 0.08)
    martensite_modulus_Pa: float = parameter(34e9, "modulus of martensite", "Pa", 10e9, 80e9)
    austenite_modulus_Pa: float = parameter(79e9, "modulus of austenite", "Pa", 20e9, 120e9)
    martensite_expansion_1_K: float = parameter(6.6e-6, "thermal expansion of martensite", "1/K", 0.0, 3e-5)
    austenite_expansion_1_K: float = parameter(11.0e-6, "thermal expansion of austenite", "1/K", 0.0, 3e-5)
    martensite_resistivity_Ohm_m: float = parameter(0.76e-6, "resistivity of martensite", "Ω·m", 1e-7, 5e-6)
    austenite_resistivity_Ohm_m: float = parameter(0.82e-6, "resistivity of austenite", "Ω·m", 1e-7, 5e-6)


@dataclass(frozen=True)
class Surroundings:
    """Where the heat goes."""

    ambient_C: float = parameter(24.0, "temperature of the air", "°C", -40.0, 100.0)
    heat_transfer_W_m2K: float = parameter(100.0, "heat transfer to still air and crimps", "W/(m²·K)", 1.0, 2000.0)


@dataclass(frozen=True)
class Bias:
    """The spring the wire pulls on: F = preload + stiffness · contraction."""

    stiffness_N_m: float = parameter(description="stiffness of the bias spring", unit="N/m", lo=0.0, hi=1e5)
    preload_N: float = parameter(description="tension of the cold wire", unit="N", lo=0.0, hi=1e3)


@dataclass(frozen=True)
class Drive:
    """The H-bridge: a supply voltage cut by a duty cycle."""

    supply_V: float = parameter(description="supply of the bridge", unit="V", lo=0.1, hi=400.0)
    heats: str = parameter(
        "rms",
        "voltage that heats: rms, √duty·supply, as of a switched resistor; mean, duty·supply, as after a filter",
        choices=("rms", "mean"),
    )


@dataclass(frozen=True)
class ForwardEffects:
    """What Liang & Rogers lack; every value here is "none" until a run of a bench asks for it."""

    friction_N: float = parameter(0.0, "Coulomb friction of the slider", "N", 0.0, 20.0)
    breakaway_N: float = parameter(0.0, "friction at rest above the sliding one", "N", 0.0, 20.0)
    backlash_m: float = parameter(0.0, "play between slider and position sensor", "m", 0.0, 0.01)
    sensor_lag_s: float = parameter(0.0, "time constant of the position sensor", "s", 0.0, 10.0)
    dead_time_s: float = parameter(
        0.0, "pure delay between the duty as logged and the power in the wire", "s", 0.0, 10.0
    )
    slack_m: float = parameter(0.0, "contraction that takes up slack before the slider leaves its stop", "m", 0.0, 0.05)
    r_strain: float = parameter(0.0, "transformation strain of the R-phase", "", 0.0, 0.01)
    r_start_C: float = parameter(80.0, "austenite begins to turn to R-phase, at zero stress", "°C", -50.0, 200.0)
    r_width_K: float = parameter(15.0, "width of that transformation", "K", 1.0, 80.0)
    cooling_loss_factor: float = parameter(1.0, "heat transfer without power over that with power", "", 0.1, 10.0)
    convection_exponent: float = parameter(0.0, "n of h ∝ (T − T_air)^n; 0.1–0.25 in natural convection", "", 0.0, 1.0)
    emissivity: float = parameter(0.0, "radiation of the surface", "", 0.0, 1.0)
    surround_J_K: float = parameter(0.0, "heat capacity of what surrounds the wire and stays warm", "J/K", 0.0, 1e4)
    surround_share: float = parameter(0.5, "share of the thermal resistance that lies beyond it", "", 0.01, 0.99)
    spread_K: float = parameter(
        0.0, "standard deviation along the wire of its transformation temperatures", "K", 0.0, 40.0
    )
    early_share: float = parameter(0.0, "share of the wire that transforms at other temperatures", "", 0.0, 0.6)
    early_by_K: float = parameter(20.0, "how much lower these are", "K", -60.0, 60.0)
    cold_share: float = parameter(0.0, "share of the wire near the crimps that loses more heat", "", 0.0, 0.6)
    cold_loss_factor: float = parameter(2.0, "its heat transfer over that of the rest", "", 1.0, 30.0)
    lead_Ohm: float = parameter(0.0, "resistance of leads and bridge", "Ω", 0.0, 20.0)
    resistivity_coefficient_1_K: float = parameter(
        0.0, "temperature coefficient of the resistivity", "1/K", -2e-3, 5e-3
    )
    start_strain: float = parameter(
        0.0, "strain of the first cold state that cooling under the bias does not restore", "", -0.01, 0.02
    )


@dataclass(frozen=True)
class ForwardWire:
    """All of a ``--wire`` file."""

    wire: WireData = section(WireData, "the wire")
    surroundings: Surroundings = section(Surroundings, "where the heat goes")
    bias: Bias = section(Bias, "the bias spring")
    drive: Drive = section(Drive, "the drive")
    effects: ForwardEffects = section(ForwardEffects, "what Liang & Rogers lack")

    def with_values(self, values: Mapping[str, float | str]) -> ForwardWire:
        """Copy with dotted names, ``effects.friction_N``, set."""
        parts: dict[str, dict] = {}
        for name, value in values.items():
            where, _, key = name.partition(".")
            parts.setdefault(where, {})[key] = value if isinstance(value, str) else float(value)
        return dataclasses.replace(self, **{w: dataclasses.replace(getattr(self, w), **v) for w, v in parts.items()})

    def value(self, name: str) -> float:
        """Value under a dotted name."""
        where, _, key = name.partition(".")
        return getattr(getattr(self, where), key)

    # Kept with the wire: a fit asks them of the same one for every run.

    @cached_property
    def kinetics(self) -> Kinetics:
        """The kinetics chosen, between the four temperatures."""
        w = self.wire
        if w.kinetics == "liang_rogers":
            return self._material().liang_rogers
        make = measured_between if w.kinetics == "measured" else lagoudas_between
        return make(
            austenite_start_C=w.austenite_start_C,
            austenite_finish_C=w.austenite_finish_C,
            martensite_start_C=w.martensite_start_C,
            martensite_finish_C=w.martensite_finish_C,
            stress_slope_Pa_K=w.stress_slope_Pa_K,
        )

    @cached_property
    def bands(self) -> np.ndarray:
        """The kinetics, for the same kernels."""
        return self.kinetics.bands()

    @cached_property
    def constants(self) -> Constants:
        """The numbers for the kernels of :mod:`sma_actuator.plant.physics`."""
        wire = materials.Specimen(
            name=self.wire.name,
            material=self._material(),
            length_m=self.wire.length_m,
            diameter_m=self.wire.diameter_m,
            heat_transfer_W_m2K=self.surroundings.heat_transfer_W_m2K,
            other_kinetics=self.kinetics,
        )
        return constants(wire, self.effects.lead_Ohm)

    def _material(self) -> materials.Material:
        w, e = self.wire, self.effects
        alpha = e.resistivity_coefficient_1_K
        martensite = materials.Phase(
            resistivity_Ohm_m=w.martensite_resistivity_Ohm_m,
            resistivity_temperature_coefficient_1_K=alpha,
            modulus_Pa=w.martensite_modulus_Pa,
            expansion_1_K=w.martensite_expansion_1_K,
        )
        austenite = materials.Phase(
            resistivity_Ohm_m=w.austenite_resistivity_Ohm_m,
            resistivity_temperature_coefficient_1_K=alpha,
            modulus_Pa=w.austenite_modulus_Pa,
            expansion_1_K=w.austenite_expansion_1_K,
        )
        mixed = dataclasses.replace(
            austenite,
            modulus_Pa=0.5 * (w.martensite_modulus_Pa + w.austenite_modulus_Pa),
            expansion_1_K=0.5 * (w.martensite_expansion_1_K + w.austenite_expansion_1_K),
        )
        return materials.Material(
            name=w.name,
            density_kg_m3=w.density_kg_m3,
            specific_heat_J_kgK=w.specific_heat_J_kgK,
            latent_heat_J_kg=w.latent_heat_J_kg,
            latent_heat_r_J_kg=0.0,
            martensite=martensite,
            austenite=austenite,
            r_phase=mixed,
            austenite_start_C=w.austenite_start_C,
            austenite_finish_C=w.austenite_finish_C,
            martensite_start_C=w.martensite_start_C,
            martensite_finish_C=w.martensite_finish_C,
            r_start_C=e.r_start_C,
            r_finish_C=e.r_start_C - e.r_width_K,
            r_hysteresis_K=2.0,
            has_r_phase=e.r_strain > 0.0,
            stress_slope_Pa_K=w.stress_slope_Pa_K,
            stress_slope_r_Pa_K=w.stress_slope_Pa_K,
            saturation_strain=w.transformation_strain,
            saturation_strain_r=e.r_strain,
            training_stress_Pa=_HUGE_Pa,
            strain_stress_scale_Pa=1.0,
            strain_shape=0.0,
            martensite_resistivity_stress_1_Pa=0.0,
            geometric_factor=0.0,
            reference_temperature_C=self.surroundings.ambient_C,
        )


#: Quantiles and weights of a normal distribution in five parts (Gauss–Hermite, probabilists').
_NODES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(5)
_WEIGHTS = _WEIGHTS / _WEIGHTS.sum()


def segments(effects: ForwardEffects) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Parts of the wire: share of the length, shift of the transformation temperatures [K], factor of the heat loss."""
    share, shift, loss = np.ones(1), np.zeros(1), np.ones(1)
    if effects.spread_K > 0.0:
        share, shift, loss = _WEIGHTS.copy(), _NODES * effects.spread_K, np.ones(len(_NODES))
    if effects.early_share > 0.0:
        f = effects.early_share
        share = np.concatenate([share * (1.0 - f), [f]])
        shift, loss = np.concatenate([shift, [-effects.early_by_K]]), np.concatenate([loss, [1.0]])
    if effects.cold_share > 0.0:
        # From the rest of the wire towards the crimps the loss rises linearly, in two steps.
        f, k = effects.cold_share, effects.cold_loss_factor - 1.0
        share = np.concatenate([share * (1.0 - f), *(share * f / 2.0 for _ in range(2))])
        shift = np.tile(shift, 3)
        loss = np.concatenate([loss, *(loss * (1.0 + k * x) for x in (0.25, 0.75))])
    return share, shift, loss


def read_wire(path: str | Path) -> ForwardWire:
    """Read a ``--wire`` file; a UserError names file and parameter."""
    path = Path(path)
    mapping = read_yaml(path, "a YAML file of a wire")
    wire, problems = from_mapping(ForwardWire, mapping if mapping is not None else {})
    if wire is not None:
        problems = _inconsistent(wire)
    if problems:
        raise UserError("\n".join(f"{path}: {_line_of(path, problem)}{problem}" for problem in problems))
    return wire


def _inconsistent(wire: ForwardWire) -> list[str]:
    w = wire.wire
    problems = []
    if w.austenite_finish_C <= w.austenite_start_C:
        problems.append(
            f"wire.austenite_finish_C: {w.austenite_finish_C:g} °C is not above wire.austenite_start_C, "
            f"{w.austenite_start_C:g} °C"
        )
    if w.martensite_start_C <= w.martensite_finish_C:
        problems.append(
            f"wire.martensite_start_C: {w.martensite_start_C:g} °C is not above wire.martensite_finish_C, "
            f"{w.martensite_finish_C:g} °C"
        )
    return problems


def _line_of(path: Path, problem: str) -> str:
    """``line N: `` where the key of a problem's dotted name stands in the file."""
    key = problem.partition(":")[0].rpartition(".")[2]
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        if line.strip().startswith(f"{key}:"):
            return f"line {number}: "
    return ""


def wire_yaml(wire: ForwardWire, comment: str) -> str:
    """The file from which :func:`read_wire` would read ``wire`` again."""
    mapping = to_mapping(wire)
    return "".join(f"# {line}\n" for line in comment.splitlines()) + yaml.safe_dump(
        mapping, sort_keys=False, allow_unicode=True
    )


def nearest(name: str, names: list[str]) -> str:
    """`` (did you mean …?)`` or nothing."""
    near = difflib.get_close_matches(name, names, n=1)
    return f"; '{near[0]}' is near it" if near else ""
