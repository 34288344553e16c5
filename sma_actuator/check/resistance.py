"""The part of the self-test that asks whether a resistance is that of the wire, and of its leads."""

from __future__ import annotations

import dataclasses
import math

from sma_actuator.base.signals import Reading
from sma_actuator.derived import LEADS_Ohm
from sma_actuator.estimation.circuit import signals_from_reading

from .found import Level
from .probe import Probe

#: The wire may differ from its calibration by this share.
CALIBRATION_SHARE = 0.03


def resistance(probe: Probe, supply_V: float, reference_V: float) -> float:
    """Is what these voltages say a wire as the parameters have it, with its leads?  Returns ohms."""
    config = probe.config
    reading = Reading(0.0, supply_V, reference_V, 0.0)
    resistance_Ohm = signals_from_reading(reading, config).resistance_Ohm
    low_Ohm, high_Ohm = probe.expected_Ohm()
    wire = config.wire
    form = f", {wire.form_text}," if wire.form_text else ""
    of_wire = (
        f"{wire.length * 1e3:g} mm of {wire.diameter * 1e6:g} µm {wire.alloy}{form} have {low_Ohm:.3g} to "
        f"{high_Ohm:.3g} Ω (ρL/A, contracted to extended)"
    )
    if otherwise := wired_otherwise(probe, resistance_Ohm):
        probe.end("resistance", f"{resistance_Ohm:.3g} Ω, and {of_wire}: {otherwise}")
    if resistance_Ohm < config.safety.resistance_min or resistance_Ohm < 0.5 * low_Ohm:
        probe.end("resistance", f"{resistance_Ohm:.3g} Ω: something bridges the wire; {of_wire}")
    more_Ohm, are_measured = resistance_Ohm - high_Ohm, config.circuit.lead_resistance > 0.0
    if not are_measured and not math.isfinite(probe.cold_Ohm) and 0.0 < more_Ohm <= LEADS_Ohm:
        probe.say(
            "leads",
            f"{resistance_Ohm:.4g} Ω with leads whose resistance is not measured yet, of which {more_Ohm:.3g} Ω or "
            f"more are theirs: {of_wire}; `sma-actuator characterise` measures them",
            Level.WARNING,
        )
    elif not low_Ohm <= resistance_Ohm <= high_Ohm:
        probe.wrong(
            "resistance",
            f"{resistance_Ohm:.4g} Ω, and {of_wire}: {_broken(probe, resistance_Ohm)}is wire.length that between "
            "the crimps, wire.diameter that of the wire, circuit.lead_resistance that of the leads?",
        )
    else:
        probe.say("resistance", f"{resistance_Ohm:.4g} Ω; {of_wire}")
        _leads(probe, resistance_Ohm)
    return resistance_Ohm


def wired_otherwise(probe: Probe, resistance_Ohm: float) -> str:
    """Of a bundle that has what it would have if the current went the other way through its wires, a sentence; else
    ""."""
    wire = probe.config.wire
    if wire.form != "bundle" or wire.wires == 1:
        return ""
    other = dataclasses.replace(wire, connection="parallel" if wire.connection == "series" else "series")
    low_Ohm, high_Ohm = probe.expected_Ohm(other)
    if not low_Ohm <= resistance_Ohm <= high_Ohm + LEADS_Ohm:
        return ""
    return (
        f"in {other.connection} they have {low_Ohm:.3g} to {high_Ohm:.3g} Ω, as here; is wire.connection, "
        f"{wire.connection}, as they are wired?"
    )


def _broken(probe: Probe, resistance_Ohm: float) -> str:
    """Of wires in parallel that have what fewer of them have, a sentence; else ""."""
    wire, cold_Ohm = probe.config.wire, probe.cold_Ohm
    if wire.connection != "parallel" or not math.isfinite(cold_Ohm):
        return ""
    carry = round(wire.wires * cold_Ohm / resistance_Ohm)
    if not 1 <= carry < wire.wires:
        return ""
    if abs(carry * resistance_Ohm / wire.wires - cold_Ohm) > CALIBRATION_SHARE * cold_Ohm:
        return ""
    return f"that is what {carry} of its {wire.wires} wires have: look for one that is broken or out of its crimp; or "


def _leads(probe: Probe, resistance_Ohm: float) -> None:
    config, cold_Ohm = probe.config, probe.cold_Ohm
    if not math.isfinite(cold_Ohm):
        probe.say("leads", "not told: no calibration says what the cold wire has", Level.WARNING)
        return
    more_Ohm = resistance_Ohm - cold_Ohm
    if abs(more_Ohm) <= CALIBRATION_SHARE * cold_Ohm:
        probe.say("leads", f"{more_Ohm:+.3f} Ω beside the calibration at cold rest ({cold_Ohm:.4g} Ω)")
        return
    side = "more" if more_Ohm > 0 else "less"
    probe.wrong(
        "leads",
        f"{abs(more_Ohm):.3g} Ω {side} than the calibration has at cold rest ({cold_Ohm:.4g} Ω): "
        f"{_broken(probe, resistance_Ohm)}the leads have other than circuit.lead_resistance, "
        f"{config.circuit.lead_resistance:g} Ω (~/measure_lead_resistance), the wire is not cold yet, or it is another",
    )
