"""The asymptotes of the node's model, drawn at the stress that there is now."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from sma_actuator.base.parameters import ConfigError
from sma_actuator.config import Config

#: Parameters of every ROS 2 node, which are no part of a configuration.
OF_ROS = ("use_sim_time", "start_type_description_service", "qos_overrides")
GRID = 400  #: resistances tried
POINTS = 60  #: of a curve as it is drawn
MARGIN = 0.15  #: how far beyond the working range a curve is drawn, as a share of it


def config_of(parameters: Mapping[str, Any]) -> Config:
    """The configuration that a node has, from its parameters by dotted name.  Raises ConfigError."""
    nested: dict[str, Any] = {}
    for name, value in parameters.items():
        if value is None or name.startswith(OF_ROS):
            continue
        *sections, last = name.split(".")
        place = nested
        for section in sections:
            place = place.setdefault(section, {})
        place[last] = value if isinstance(value, bool | int | float | str) else list(value)
    return Config.from_mapping(nested)


class Asymptotes:
    """What the loop of resistance and displacement is drawn on.  Raises ConfigError where there is no such model."""

    def __init__(self, config: Config):
        self.config = config
        self._model = config.model.build(config.wire)
        self.range_m = tuple(map(float, self._model.displacement_range_m))
        self.full_stroke_m = config.wire.full_stroke_m
        low_Pa, high_Pa = self._model.stress_range_Pa
        self._step_Pa = 0.005 * (high_Pa - low_Pa)
        self._drawn_Pa = np.nan
        safety = config.safety
        self._grid_Ohm = np.linspace(safety.resistance_min, safety.resistance_max, GRID)

    def at(self, stress_Pa: float) -> dict[str, Any] | None:
        """The curves at a stress; None where they are as they were."""
        limits_m = getattr(self._model, "limits_m", None)
        if limits_m is None or not abs(stress_Pa) < np.inf or abs(stress_Pa - self._drawn_Pa) < self._step_Pa:
            return None
        self._drawn_Pa = stress_Pa
        low_m, high_m = self.range_m
        margin_m = MARGIN * (high_m - low_m)
        seen = np.zeros(GRID, dtype=bool)
        for curve in limits_m(self._grid_Ohm, stress_Pa):
            seen |= (curve > low_m - margin_m) & (curve < high_m + margin_m)
        if not seen.any():
            return None
        resistance_Ohm = np.linspace(self._grid_Ohm[seen][0], self._grid_Ohm[seen][-1], POINTS)
        heating_m, cooling_m = limits_m(resistance_Ohm, stress_Pa)
        return {
            "stress_Pa": stress_Pa,
            "resistance_Ohm": resistance_Ohm.round(6).tolist(),
            "heating_m": np.asarray(heating_m).round(9).tolist(),
            "cooling_m": np.asarray(cooling_m).round(9).tolist(),
        }


def asymptotes_of(parameters: Mapping[str, Any]) -> tuple[Asymptotes | None, str]:
    """The asymptotes of a node with these parameters, or why there are none."""
    if "wires" in parameters:
        return None, "a joint has no loop of resistance: look at its wires"
    try:
        found = Asymptotes(config_of(parameters))
    except ConfigError as error:
        return None, f"the node's model cannot be drawn here: {error.problems[0]}"
    if not hasattr(found._model, "limits_m"):
        return found, f"a model of the type {found.config.model_type} has no asymptotes"
    return found, ""
