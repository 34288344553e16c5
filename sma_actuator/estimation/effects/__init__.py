"""Effects a strain model can lack, each at its own stage of the chain.

An effect is a section of parameters with its mathematics: a method for every stage at which it
acts, which changes a :class:`Frame` of n samples in place.

* ``measured``: circuit and load cell, before anything is made of the signals;
* ``at_resistance``: the wire, on the resistance that the strain model sees;
* ``at_displacement``: the wire and the mechanism, on the displacement that it gives;
* ``shown``: the reference sensor, only where a log is judged.

The node calls them with one sample at a time, replay with a whole log: the same code, so the same
numbers.  With all parameters of size at zero an effect changes nothing.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from sma_actuator.base.parameters import check, declaration_of, from_mapping, parameter

from .circuit import ContactDrift, LeadResistance, ReferenceSelfHeating, Shunt, VoltageOffset
from .effect import Effect
from .load_cell import LoadCellDrift, LoadCellGain
from .mechanism import Backlash, Slip
from .reference import ReferenceDrift, ReferenceGain, ReferenceLag
from .wire import (
    AmbientTemperature,
    Creep,
    ElasticCompliance,
    Fatigue,
    MinorLoopMemory,
    Rate,
    SelfHeating,
    ThermalExpansion,
)

#: Every effect by its name, in the order of the chain.
EFFECTS: dict[str, type[Effect]] = {
    "lead_resistance": LeadResistance,
    "contact_drift": ContactDrift,
    "voltage_offset": VoltageOffset,
    "reference_self_heating": ReferenceSelfHeating,
    "shunt": Shunt,
    "load_cell_drift": LoadCellDrift,
    "load_cell_gain": LoadCellGain,
    "self_heating": SelfHeating,
    "ambient_temperature": AmbientTemperature,
    "thermal_expansion": ThermalExpansion,
    "elastic_compliance": ElasticCompliance,
    "fatigue": Fatigue,
    "creep": Creep,
    "minor_loop_memory": MinorLoopMemory,
    "rate": Rate,
    "slip": Slip,
    "backlash": Backlash,
    "reference_lag": ReferenceLag,
    "reference_gain": ReferenceGain,
    "reference_drift": ReferenceDrift,
}
#: Effects whose fault is not the model's: they are named, and the model is left alone.
NOT_THE_MODEL = ("mechanism", "reference")


def _optional(cls: type) -> Any:
    return dataclasses.field(default=None, kw_only=True, metadata={"effect": cls})


@dataclass(frozen=True, slots=True)
class Effects:
    """The section ``effects`` of a parameter file: what tracing has added to the model."""

    order: tuple[str, ...] = parameter((), "names of the effects, in the order in which they were found", optional=True)
    history: tuple[str, ...] = parameter((), "when each came in, from which log, and what it bought", optional=True)
    lead_resistance: LeadResistance | None = _optional(LeadResistance)
    contact_drift: ContactDrift | None = _optional(ContactDrift)
    voltage_offset: VoltageOffset | None = _optional(VoltageOffset)
    reference_self_heating: ReferenceSelfHeating | None = _optional(ReferenceSelfHeating)
    shunt: Shunt | None = _optional(Shunt)
    load_cell_drift: LoadCellDrift | None = _optional(LoadCellDrift)
    load_cell_gain: LoadCellGain | None = _optional(LoadCellGain)
    self_heating: SelfHeating | None = _optional(SelfHeating)
    ambient_temperature: AmbientTemperature | None = _optional(AmbientTemperature)
    thermal_expansion: ThermalExpansion | None = _optional(ThermalExpansion)
    elastic_compliance: ElasticCompliance | None = _optional(ElasticCompliance)
    fatigue: Fatigue | None = _optional(Fatigue)
    creep: Creep | None = _optional(Creep)
    minor_loop_memory: MinorLoopMemory | None = _optional(MinorLoopMemory)
    rate: Rate | None = _optional(Rate)
    slip: Slip | None = _optional(Slip)
    backlash: Backlash | None = _optional(Backlash)

    @property
    def active(self) -> dict[str, Effect]:
        """Name and parameters of every effect that is there, in the order of the chain."""
        found = {f.name: getattr(self, f.name) for f in dataclasses.fields(self) if "effect" in f.metadata}
        return {name: effect for name, effect in found.items() if effect is not None}


def effects_from_mapping(mapping: Any) -> tuple[Effects, list[str]]:
    """The section ``effects`` of a parameter file, and a sentence for every problem in it.

    Effects of the reference sensor are refused: they are no part of a model.
    """
    if mapping in (None, [], ()):
        return Effects(), []
    if not isinstance(mapping, Mapping):
        return Effects(), ["effects: a section with 'order' and one section per effect is wanted"]
    values: dict[str, Any] = {}
    problems: list[str] = []
    fields = {f.name: f for f in dataclasses.fields(Effects)}
    for name, value in mapping.items():
        if name not in fields:
            why = "is a fault of the reference sensor and no part of a model" if name in EFFECTS else "no such effect"
            known = ", ".join(n for n, f in fields.items() if "effect" in f.metadata)
            problems.append(f"effects.{name}: {why}; known here: {known} (a newer version may know more)")
        elif "effect" in fields[name].metadata:
            values[name], found = from_mapping(fields[name].metadata["effect"], value, f"effects.{name}.")
            problems += found
        else:
            values[name], problem = check(
                f"effects.{name}", value, declaration_of(fields[name]), str(fields[name].type)
            )
            problems += [problem] if problem else []
    if not problems:
        present = {name for name in values if name in EFFECTS}
        if set(values.get("order", present)) != present:
            problems.append(
                f"effects.order: {', '.join(values['order']) or 'empty'}, but the sections are those of "
                f"{', '.join(sorted(present)) or 'no effect'}; each effect wants one entry and one section"
            )
        values.setdefault("order", tuple(sorted(present, key=list(EFFECTS).index)))
    return (Effects(), problems) if problems else (Effects(**values), [])


def in_order(effects: Mapping[str, Effect]) -> list[Effect]:
    """The effects in the order of the chain."""
    return [effects[name] for name in EFFECTS if name in effects]
