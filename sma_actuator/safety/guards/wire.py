"""The wire: its circuit, its load, its heat."""

from __future__ import annotations

from sma_actuator.safety.formula import longest
from sma_actuator.safety.records import Action, Step, guard
from sma_actuator.safety.timing import RATE, SETTLING_READINGS, SETTLING_TIME_S, THREE_STEPS, TWO_STEPS

#: Share of supply.max_voltage that counts as being at the compliance voltage.
COMPLIANCE = 0.95


@guard(
    words="the wire is open",
    detector="voltage at the compliance voltage, supply.max_voltage, with less than safety.open_wire_current_fraction of "
    "the commanded current",
    within=THREE_STEPS,
    action=Action.OFF,
    latches=True,
)
def open_wire(step: Step) -> str:
    """All the voltage there is, and little current."""
    reading = step.reading
    least_A = step.config.safety.open_wire_current_fraction * step.told.current_A
    is_open = (
        step.told.output_on
        and reading is not None
        and reading.supply_voltage_V >= COMPLIANCE * step.config.supply.max_voltage
        and not step.signals.current_A >= least_A
    )
    if reading is None or step.memory.running("open_wire", is_open) < 2:
        return ""
    return f"{step.signals.current_A:.3g} A flow of {step.told.current_A:.3g} A at {reading.supply_voltage_V:.3g} V"


@guard(
    words="the wire is shorted",
    detector="resistance below safety.resistance_min (after enabling: once settled at the bias current)",
    within=longest(SETTLING_TIME_S, SETTLING_READINGS / RATE) + TWO_STEPS,
    action=Action.OFF,
    latches=True,
)
def short(step: Step) -> str:
    """Too little resistance."""
    if not (
        step.settled and step.reading is not None and step.signals.resistance_Ohm < step.config.safety.resistance_min
    ):
        return ""
    return f"{step.signals.resistance_Ohm:.3g} Ω; safety.resistance_min is {step.config.safety.resistance_min:g} Ω"


@guard(
    words="stress above its limit",
    detector="stress above wire.max_stress",
    within=TWO_STEPS,
    action=Action.OFF,
    latches=True,
)
def stress_above_limit(step: Step) -> str:
    """More stress than the wire survives."""
    if step.reading is None or step.signals.stress_Pa <= step.config.wire.max_stress:
        return ""
    return f"{step.signals.stress_Pa / 1e6:.4g} MPa; wire.max_stress is {step.config.wire.max_stress / 1e6:g} MPa"


@guard(
    words="the load jumped",
    detector="load changes by more than safety.load_spike from one reading to the next",
    within=TWO_STEPS,
    action=Action.OFF,
    latches=True,
)
def load_spike(step: Step) -> str:
    """A blow, or a load cell that lost its mind."""
    if step.reading is None:
        return ""
    change_N = step.signals.load_N - step.memory.load_N
    step.memory.load_N = step.signals.load_N
    if not abs(change_N) > step.config.safety.load_spike:
        return ""
    return f"{change_N:+.3g} N from one reading to the next; safety.load_spike is {step.config.safety.load_spike:g} N"


@guard(
    words="the wire is too hot",
    detector="heat balance on measured power above thermal.max_temperature",
    within=TWO_STEPS,
    action=Action.OFF,
    latches=True,
    while_off=True,
)
def too_hot(step: Step) -> str:
    """The heat balance on measured power."""
    if step.temperature_C <= step.config.thermal.max_temperature:
        return ""
    return (
        f"estimated {step.temperature_C:.0f} °C; thermal.max_temperature is {step.config.thermal.max_temperature:g} °C"
    )
