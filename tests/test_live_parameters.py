"""Every parameter that is declared live arrives: a running actuator goes on as one that had the new value from its
start; and one that is declared to guard guards more where its declaration says so."""

import functools
import itertools
from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from math import nan
from pathlib import Path
from typing import Any

import hypothesis.strategies as st
import pytest
from hypothesis import given
from rig import Rig

from sma_actuator.base.parameters import Declaration, declaration_of, parameter, walk
from sma_actuator.base.signals import Estimate, Output
from sma_actuator.config import Config, read_parameter_file
from sma_actuator.control import CONTROL_LAWS
from sma_actuator.control.pair import PairParameters
from sma_actuator.plant.loads import Weight

SHIPPED = [Path(__file__).parents[1] / "config" / f"{model}.yaml" for model in ("flexinol", "furukawa")]
LIVE = {name: declared for path in SHIPPED for name, _, declared, _ in walk(Config.load(path)) if declared.live}
JOINT = PairParameters.from_mapping(read_parameter_file(Path(__file__).parents[1] / "config" / "pair.yaml", "joint"))
GUARDING = {
    name: declared
    for name, declared in {**LIVE, **{f"joint {n}": d for n, _, d, _ in walk(JOINT)}}.items()
    if declared.stricter
}
#: A pause without current, after which a wire is certainly cold, whatever was believed before.
PAUSE_s = 3600.0


def lie(rig: Rig, **change: Callable[[Any], float]) -> None:
    """From now on every reading is changed so."""
    rig.reading_of = lambda reading: replace(reading, **{name: new(reading) for name, new in change.items()})


def tracks(rig: Rig, position_m: float = 0.0025, seconds: float = 2.0) -> None:
    assert rig.actuator.offer_setpoint(rig.now_s, position_m) == ""
    rig.run(seconds)


def contracts(rig: Rig) -> None:
    """So far that the power goes through every threshold."""
    tracks(rig, 0.0015)


def contracts_and_comes_back(rig: Rig) -> None:
    """Where the power falls again, but not to where it was."""
    contracts(rig)
    tracks(rig, 0.0017)


def is_loaded(rig: Rig, load_N: float, seconds: float = 0.5) -> None:
    rig.bench.load = Weight(load_N)
    rig.run(seconds)


def has_a_drifting_load_cell(rig: Rig) -> None:
    rig.actuator.enable(rig.now_s, False)
    is_loaded(rig, 0.2, seconds=2.0)
    rig.actuator.tare_load()
    rig.run(0.2)


def is_late_once(rig: Rig) -> None:
    rig.skew_s += 1.0
    rig.run(0.2)


def comes_late(rig: Rig) -> None:
    for _ in range(4):
        rig.skew_s += 2.0 * rig.period_s
        rig.step()


def has_a_stuck_load_cell(rig: Rig) -> None:
    lie(rig, load_cell_voltage_V=lambda reading: 0.0432)
    rig.run(1.0)


def has_a_stuck_ambient_sensor(rig: Rig) -> None:
    lie(rig, ambient_temperature_C=lambda reading: 20.0)
    rig.run(2.0)


def has_no_ambient_sensor(rig: Rig) -> None:
    lie(rig, ambient_temperature_C=lambda reading: nan)
    rig.run(1.0)


def is_hot(rig: Rig, ambient_C: float) -> None:
    """Driven for as long as makes it hot, with a resistance that in a warm room is that of a contracted wire."""
    wire_Ohm, current_A = 4.427, 0.3
    sense_Ohm = rig.config.circuit.reference_resistance
    lie(
        rig,
        supply_voltage_V=lambda reading: current_A * (sense_Ohm + rig.config.circuit.lead_resistance + wire_Ohm),
        reference_voltage_V=lambda reading: current_A * sense_Ohm,
        ambient_temperature_C=lambda reading: ambient_C,
    )
    rig.run(4.0)


def is_hot_without_ambient_sensor(rig: Rig) -> None:
    is_hot(rig, nan)


def is_hot_in_a_hot_room(rig: Rig) -> None:
    is_hot(rig, 60.0)


def is_half_open(rig: Rig) -> None:
    told_V = 0.7 * rig.written.current_A * rig.config.circuit.reference_resistance
    bound_V = rig.config.supply.max_voltage
    lie(rig, supply_voltage_V=lambda reading: bound_V, reference_voltage_V=lambda reading: told_V)
    rig.run(0.2)


def is_pushed(rig: Rig) -> None:
    cell = rig.config.load_cell
    lie(rig, load_cell_voltage_V=lambda reading: (-0.8 - cell.offset) / cell.slope)
    rig.run(0.2)


def has_more_current_than_was_told(rig: Rig) -> None:
    lie(rig, reference_voltage_V=lambda reading: reading.reference_voltage_V + 0.03)
    rig.run(1.0)


def has_another_sense_resistor(rig: Rig) -> None:
    rig.run(4.0)
    lie(rig, reference_voltage_V=lambda reading: 0.95 * reading.reference_voltage_V)
    rig.run(2.0)


def has_other_voltages(rig: Rig) -> None:
    rig.run(12.0)  # until the command that holds it stands
    lie(
        rig,
        supply_voltage_V=lambda reading: 1.05 * reading.supply_voltage_V,
        reference_voltage_V=lambda reading: 1.05 * reading.reference_voltage_V,
    )
    rig.run(3.0)


def has_a_load_cell_that_dies(rig: Rig) -> None:
    """A weight's, as the wire has shown by moving."""
    contracts(rig)
    rig.run(16.0)
    last, dither = rig.output.reading.load_cell_voltage_V, itertools.cycle((1e-7, 3e-7, -4e-7))
    lie(rig, load_cell_voltage_V=lambda reading: last + next(dither))
    rig.run(7.0)


def has_a_supply_that_measures_another_voltage(rig: Rig) -> None:
    rig.state_of = lambda state: replace(state, voltage_V=state.voltage_V + 1.0)
    rig.run(1.0)


def misses_readings(rig: Rig) -> None:
    rig.reading_of = lambda reading: None
    rig.run(1.0)


def is_flooded(rig: Rig) -> None:
    for _ in range(50):
        rig.actuator.offer_setpoint(rig.now_s, 0.0030)
    rig.run(0.1)


def is_commanded_for_a_while(rig: Rig) -> None:
    for _ in range(10):
        rig.actuator.offer_joint_command(rig.now_s, rig.output.estimate.displacement_m)
        rig.step()
    rig.run(1.0)


def is_tuned(rig: Rig) -> None:
    done, sentence = rig.actuator.tune(rig.now_s)
    assert done, sentence
    rig.run(1.0)


def is_commanded_from_afar(rig: Rig) -> None:
    position_m = rig.output.estimate.displacement_m - 0.5e-3
    for _ in range(10):
        rig.actuator.offer_joint_command(rig.now_s, position_m)
        rig.step()


def everything(output: Output) -> Output:
    """All that one step says but the event that tells of the change."""
    return replace(output, events=())


def estimate_of(output: Output) -> Estimate:
    """Where the wire is; for what changes other things too, which are not asked for here."""
    return output.estimate


@dataclass(frozen=True)
class Situation:
    """Where a parameter matters: its new value, what the driven wire lives through, and what else must be set for
    it."""

    name: str
    new: Any
    lives_through: Callable[[Rig], None] = tracks
    given: dict[str, Any] = field(default_factory=dict)
    seen: Callable[[Output], Any] = everything


#: Nothing that is wrong in :func:`is_hot` besides what matters.
HOT = {"safety.stuck_time": 60.0, "safety.current_disagreement": 5.0, "safety.voltage_disagreement": 60.0}
SITUATIONS = [
    Situation("wire.max_stress", 60e6, lambda rig: is_loaded(rig, 1.5)),
    Situation("loop.overruns_to_fault", 2, comes_late),
    Situation("estimator.heating_power", 0.5, contracts, given={"estimator.branch_decision": "power"}),
    Situation("estimator.heating_power_hysteresis", 0.5, contracts_and_comes_back),
    Situation("estimator.thermal_time_constant", 1.0),
    Situation("estimator.resistance_deadband", 0.1, given={"estimator.branch_decision": "resistance_rate"}),
    Situation("estimator.velocity_time_constant", 1.0),
    Situation("controller.setpoint_rate_limit", 0.001),
    Situation("controller.setpoint_timeout", 0.3),
    Situation("controller.joint_command_timeout", 0.2, is_commanded_for_a_while),
    Situation("controller.arming_distance", 0.3, is_commanded_from_afar),
    Situation("controller.on_setpoint_loss", "bias", given={"controller.setpoint_timeout": 0.3}),
    Situation("controller.kp", 300.0),
    Situation("controller.ki", 100.0),
    Situation("controller.kd", 10.0),
    Situation("controller.derivative_time_constant", 0.5, given={"controller.kd": 10.0}),
    Situation("controller.tuning_current", 0.5, is_tuned),
    Situation("thermal.heat_loss_margin", 1.5),
    Situation(
        "thermal.unwatched_margin", 1.2, given={"supply.watchdog_timeout": 0.0, "supply.allow_no_watchdog": True}
    ),
    Situation("thermal.ambient_temperature", 40.0, has_no_ambient_sensor),
    Situation("thermal.ambient_tolerance", 0.5),
    Situation("thermal.ambient_stuck_time", 1.0, has_a_stuck_ambient_sensor),
    Situation("thermal.transformed_temperature", 60.0),
    Situation("thermal.derate_temperature", 45.0, contracts),
    Situation("thermal.max_temperature", 80.0, given={"thermal.derate_temperature": 60.0}),
    Situation("safety.open_wire_current_fraction", 0.9, is_half_open, given={"safety.resistance_max": 500.0}),
    Situation("safety.load_min", -5.0, is_pushed),
    Situation("safety.load_spike", 0.3, lambda rig: is_loaded(rig, 1.0)),
    Situation("safety.stuck_time", 0.3, has_a_stuck_load_cell),
    Situation("safety.current_disagreement", 0.2, has_more_current_than_was_told),
    Situation("safety.current_drift", 0.2, has_another_sense_resistor),
    Situation("safety.voltage_drift", 0.2, has_other_voltages, given={"safety.current_drift": 1.0}),
    Situation("safety.least_noise", 0.0, has_a_load_cell_that_dies),
    Situation("safety.voltage_disagreement", 5.0, has_a_supply_that_measures_another_voltage),
    Situation("safety.disagreement_time", 3.0, has_a_supply_that_measures_another_voltage),
    Situation("safety.reading_timeout", 2.0, misses_readings),
    Situation("safety.setpoint_flood_rate", 10.0, is_flooded),
    Situation("safety.stress_limit_fraction", 0.2, lambda rig: is_loaded(rig, 1.0)),
    Situation("safety.outside_calibration_time", 0.5, lambda rig: is_loaded(rig, 0.1, seconds=2.0)),
    Situation("wire.max_stress", 60e6, has_a_drifting_load_cell),
    Situation("safety.reading_timeout", 2.0, is_late_once),
    Situation("thermal.ambient_temperature", 50.0, is_hot_without_ambient_sensor, given=HOT, seen=estimate_of),
    Situation("thermal.ambient_tolerance", 40.0, is_hot_in_a_hot_room, given=HOT, seen=estimate_of),
]


def outputs_of(
    config: Config, situation: Situation, told: Config | None = None, while_driven: bool = False
) -> list[Output]:
    """What one actuator gives from when it is driven; ``told`` is what it is told meanwhile."""
    rig = Rig(config.to_mapping())
    if told is not None and not while_driven:
        rig.actuator.update(told)
    rig.skew_s += PAUSE_s
    rig.run(0.2)
    rig.outputs.clear()
    ok, sentence = rig.actuator.enable(rig.now_s, True)
    assert ok, sentence
    rig.run(0.5)
    assert rig.output.command.output_on, rig.status.message
    if told is not None and while_driven:
        rig.actuator.update(told)
    situation.lives_through(rig)
    return rig.outputs


@functools.cache
def lived(number: int, new: bool) -> list[Output]:
    """What an actuator gives in a situation that was born with the old or the new value: most are looked at twice."""
    situation = SITUATIONS[number]
    config = Config.load(SHIPPED[0]).replace(situation.given)
    return outputs_of(config.replace({situation.name: situation.new}) if new else config, situation)


def life(outputs: list[Output], situation: Situation) -> list[str]:
    """The same as text, which shows every digit and in which one NaN is as good as another."""
    return [repr(situation.seen(output)) for output in outputs]


def harm(outputs: list[Output]) -> tuple[float, float, float]:
    """How much was let happen: heat, as the square of the current; where that is the same, faults not told; then heat
    not feared."""
    return (
        sum(output.command.current_A**2 for output in outputs if output.command.output_on),
        -sum(bool(output.status.fault) for output in outputs),
        -sum(float(output.status.values["temperature_at_most_C"]) for output in outputs),
    )


@pytest.mark.parametrize(
    "number",
    range(len(SITUATIONS)),
    ids=[f"{s.name}-{s.lives_through.__name__}".strip("<>") for s in SITUATIONS],
)
def test_a_live_parameter_arrives(number):
    situation = SITUATIONS[number]
    old = Config.load(SHIPPED[0]).replace(situation.given)
    new = old.replace({situation.name: situation.new})
    stale, born = (life(lived(number, is_new), situation) for is_new in (False, True))
    assert born != stale, f"{situation.name} does not matter here"
    assert life(outputs_of(old, situation, told=new), situation) == born
    assert life(outputs_of(old, situation, told=new, while_driven=True), situation) != stale


def test_every_live_parameter_has_a_situation_in_which_it_matters():
    assert {situation.name for situation in SITUATIONS} == set(LIVE)


@pytest.mark.parametrize("name", sorted(set(GUARDING) & set(LIVE)))
def test_what_is_declared_stricter_lets_less_happen(name):
    """In no situation more current, fewer warnings or less caution; and in one of them less."""
    less = []
    for number, situation in ((k, each) for k, each in enumerate(SITUATIONS) if each.name == name):
        old = Config.load(SHIPPED[0]).replace(situation.given)
        value = next(value for n, value, _, _ in walk(old) if n == name)
        new_is_stricter = not LIVE[name].loosens(value, situation.new)
        done, could = (harm(lived(number, is_new)) for is_new in (new_is_stricter, not new_is_stricter))
        assert done <= could
        less.append(done < could)
    assert any(less)


#: Gains, filters, goals, and what tells heating from cooling: neither way bounds what a wrong command or reading does.
EITHER = {
    "controller.derivative_time_constant",
    "controller.feed_forward",
    "controller.heating_time",
    "controller.kd",
    "controller.ki",
    "controller.kp",
    "estimator.heating_power",
    "estimator.heating_power_hysteresis",
    "estimator.resistance_deadband",
    "estimator.thermal_time_constant",
    "estimator.velocity_time_constant",
    "joint cocontraction",
    "joint tension_gain",
    "joint tension_integral_time",
}


def test_whatever_is_live_guards_one_way_or_is_known_not_to_guard():
    joint = {f"joint {name}" for name, _, declared, _ in walk(JOINT) if declared.live}
    laws = {f"controller.{f.name}" for law in CONTROL_LAWS.values() for f in fields(law) if declaration_of(f).live}
    assert (joint | laws | set(LIVE)) - set(GUARDING) == EITHER


@given(data=st.data())
@pytest.mark.parametrize("name", sorted(GUARDING))
def test_of_any_two_values_one_is_stricter(name, data):
    """So whatever is set, it is known whether that loosens: nothing is as strict as another value, nor stricter than
    itself, and 0 is the loosest where it stands for never."""
    declared: Declaration = GUARDING[name]
    values = st.sampled_from(declared.choices) if declared.choices else st.floats(declared.lo, declared.hi)
    one, other = data.draw(values), data.draw(values)
    assert not declared.loosens(one, one) and not declared.optional
    assert declared.loosens(one, other) != declared.loosens(other, one) or one == other
    if declared.zero_is_never and one:
        assert declared.loosens(one, 0.0) and not declared.loosens(0.0, one)


def test_a_live_parameter_that_does_not_say_which_way_guards_is_refused_where_it_is_declared():
    with pytest.raises(ValueError, match="live=True; one of '', 'lower', 'higher', 'later', 'either' is wanted"):
        parameter(1.0, "gain", live=True)
