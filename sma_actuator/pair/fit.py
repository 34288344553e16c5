"""Whether two wires can turn a joint together."""

from __future__ import annotations

from collections.abc import Sequence

from sma_actuator.config import Config
from sma_actuator.control.pair import Pair, PairParameters


def mismatches(parameters: PairParameters, configs: Sequence[Config]) -> list[str]:
    """Why these wires cannot turn that joint together, one sentence each."""
    found = []
    ranges_m = []
    for name, config in zip(parameters.wires, configs, strict=True):
        wire, model = config.wire, config.model.build(config.wire)
        ranges_m.append(model.displacement_range_m)
        most_N = config.safety.stress_limit_fraction * wire.max_stress * wire.area_m2
        if parameters.tension_limit > most_N:
            found.append(
                f"tension_limit: {parameters.tension_limit:g} N is above {most_N:.3g} N, where "
                f"safety.stress_limit_fraction of the wire {name} holds it"
            )
        least_N = model.stress_range_Pa[0] * wire.area_m2
        if parameters.least_cocontraction < least_N:
            found.append(
                f"least_cocontraction: {parameters.least_cocontraction:g} N is below {least_N:.3g} N, the least that "
                f"the model of the wire {name} was identified on"
            )
    low_rad, high_rad = Pair(parameters, ranges_m).range_rad(parameters.cocontraction)
    if not low_rad < high_rad:
        found.append(
            f"displacement_at_zero: with {', '.join(f'{x:g}' for x in parameters.displacement_at_zero)} m there is no "
            "angle at which both wires are in the working ranges of their models"
        )
    return found
