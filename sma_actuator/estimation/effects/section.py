"""The section ``effects`` of a parameter file."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from sma_actuator.base.parameters import from_mapping, parameter, sections_by_name

from .effect import EFFECTS, Effect, in_order


@dataclass(frozen=True, slots=True)
class Effects:
    """What tracing has added to the model."""

    order: tuple[str, ...] = parameter((), "names of the effects, in the order in which they were found", optional=True)
    history: tuple[str, ...] = parameter((), "when each came in, from which log, and what it bought", optional=True)
    active: Mapping[str, Effect] = sections_by_name(EFFECTS)  #: by name, in the order of the chain


def effects_from_mapping(mapping: Any) -> tuple[Effects, list[str]]:
    """The section, and a sentence for every problem in it.

    Effects of the reference sensor are refused: they are no part of a model.
    """
    if mapping in (None, [], ()):
        return Effects(), []
    if not isinstance(mapping, Mapping):
        return Effects(), ["effects: a section with 'order' and one section per effect is wanted"]
    section, problems = from_mapping(Effects, mapping, "effects.")
    if section is None:
        return Effects(), problems
    problems = [
        f"effects.{name}: is a fault of the reference sensor and no part of a model"
        for name, effect in section.active.items()
        if effect.PART == "reference"
    ]
    active = in_order(section.active)
    order = section.order or tuple(active)
    if set(order) != set(active):
        problems.append(
            f"effects.order: {', '.join(order) or 'empty'}, but the sections are those of "
            f"{', '.join(sorted(active)) or 'no effect'}; each effect wants one entry and one section"
        )
    return (Effects(), problems) if problems else (dataclasses.replace(section, order=order, active=active), [])
