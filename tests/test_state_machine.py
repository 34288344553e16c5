"""No sequence of setpoints, faults, services and readings commands more than the limit or not a number."""

import dataclasses
import logging
import math
import random

import hypothesis.strategies as st
import pytest
from hypothesis import HealthCheck, settings
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from sma_actuator.actuator import Actuator
from sma_actuator.base.parameters import ConfigError, declaration_of
from sma_actuator.base.signals import Command, Mode, Quality, Reading, SupplyState
from sma_actuator.config import Config
from sma_actuator.control import CONTROL_LAWS
from sma_actuator.control.feed_forward import FeedForwardPidParameters
from sma_actuator.safety.faults import FAULTS
from sma_actuator.safety.parameters import SafetyParameters

anything = st.one_of(
    st.floats(allow_nan=True, allow_infinity=True),
    st.sampled_from([math.nan, math.inf, -math.inf, 1e308, -1e308, 0.0, -0.0, 5e-324]),
)
numbers = st.floats(0.0, 1.0)
#: Latches where ``controller.on_setpoint_loss`` is off; what never latches is not shown as this one is.
MAY_LATCH = {"setpoint_stale"}
#: What a driver can see.
REPORTABLE = [f for f in FAULTS if FAULTS[f].latches or f == "setpoint_flood"]


@pytest.fixture(autouse=True)
def quiet():
    """The provoked exceptions are logged with their tracebacks, thousands of them."""
    logging.disable(logging.CRITICAL)
    yield
    logging.disable(logging.NOTSET)


def live_values(section):
    """Strategies for the live numbers of a section, over their whole declared range."""
    out = {}
    for field in dataclasses.fields(section):
        declaration = declaration_of(field)
        if declaration.live and str(field.type) == "float":
            out[field.name] = st.floats(max(declaration.lo, -1e6), min(declaration.hi, 1e6))
    return out


#: What feed-forward wants to know of a wire.
CALIBRATION = {
    "hot_end": {"contracted_stress": [20e6, 120e6], "contracted_displacement": [0.1e-3, 0.2e-3]},
    "rest": {"cold_stress": [20e6, 120e6], "cold_displacement": [3.6e-3, 4.8e-3]},
    "power": {
        "transformation_heating": [64.0, 54.0],
        "transformation_cooling": [39.0, 29.0],
        "transformation_shift": [1.2e-7, 1.2e-7],
        "latent_rise": 25.0,
    },
}


class AnyUse(RuleBasedStateMachine):
    """An actuator in the hands of people, instruments and a clock that may all do anything."""

    base = None  #: a complete configuration, from the fixture

    @initialize(
        bias_A=st.floats(1e-3, 0.1),
        span_A=st.floats(1e-3, 5.0),
        rate_Hz=st.sampled_from([10.0, 20.0, 100.0]),
        loss=st.sampled_from(["hold", "bias", "off"]),
        timeout_s=st.sampled_from([0.0, 0.2, 3.0]),
        law=st.sampled_from(["pid", "feed_forward_pid"]),
        controller=st.fixed_dictionaries(live_values(FeedForwardPidParameters)),
        max_stress_Pa=st.floats(1e6, 1e9) | st.just(175e6),
        derate_C=st.floats(40.0, 150.0) | st.just(160.0),
    )
    def start(self, bias_A, span_A, rate_Hz, loss, timeout_s, law, controller, max_stress_Pa, derate_C):
        self.law = law
        self.config = Config.from_mapping(self.base).replace(
            {
                "loop.rate": rate_Hz,
                "loop.samples_per_block": 1,
                "supply.bias_current": bias_A,
                "supply.max_current": bias_A + span_A,
                "supply.over_current_trip": 20.0,
                "controller.type": law,
                **self.known_to_the_law(controller),
                "controller.on_setpoint_loss": loss,
                "controller.setpoint_timeout": timeout_s,
                "supply.max_voltage": 60.0,
                "safety.channel_max_voltage": 100.0,
                "wire.max_stress": max_stress_Pa,
                "thermal.derate_temperature": derate_C,
            }
        )
        self.actuator = Actuator(self.config)
        self.now_s = 0.0
        self.enabled = False  #: what the person believes: enabled, and no latched fault since
        self.latched = ""
        self.output = None

    def known_to_the_law(self, controller):
        known = live_values(CONTROL_LAWS[self.law])
        return {f"controller.{name}": value for name, value in controller.items() if name in known}

    # --- what the world does ----------------------------------------------------------------------

    def step(self, dt_s, reading, supply):
        self.now_s += dt_s
        before = self.latched
        self.output = self.actuator.step(self.now_s, reading, supply)
        status, command = self.output.status, self.output.command
        if not math.isfinite(self.now_s):
            self.now_s = 0.0
        if status.fault and (FAULTS[status.fault].latches or (status.mode is Mode.OFF and status.fault in MAY_LATCH)):
            assert command == Command(0.0, False), f"{status.fault} latches, and current flows"
            self.latched = self.latched or status.fault
        if before:
            assert command == Command(0.0, False), f"current flows although {before} latched"
            assert status.mode is Mode.OFF
        if not self.enabled:
            assert command == Command(0.0, False), "current flows although nobody enabled it"
        if status.mode is Mode.OFF:
            self.enabled = False

    def plausible(self, resistance_Ohm, load_N, noise):
        told = self.output.command if self.output is not None else Command(0.0, False)
        current_A = told.current_A + 1e-7 * noise
        circuit, cell = self.config.circuit, self.config.load_cell
        total_Ohm = circuit.reference_resistance + circuit.lead_resistance + resistance_Ohm
        reading = Reading(
            self.now_s,
            current_A * total_Ohm + 1e-7 * noise,
            current_A * circuit.reference_resistance,
            (load_N - cell.offset) / cell.slope + 1e-7 * noise,
        )
        return reading, SupplyState(self.now_s, told.current_A, told.output_on, current_A * total_Ohm, current_A)

    @rule(steps=st.integers(1, 20), resistance_Ohm=st.floats(4.0, 6.0), load_N=st.floats(0.1, 1.0), noise=st.randoms())
    def a_good_while(self, steps, resistance_Ohm, load_N, noise):
        self.go_well(steps, resistance_Ohm, load_N, noise)

    def go_well(self, steps, resistance_Ohm, load_N, noise):
        for _ in range(steps):
            dt_s = 1.0 / self.config.loop.rate
            self.now_s += dt_s
            reading, supply = self.plausible(resistance_Ohm, load_N, noise.random())
            self.now_s -= dt_s
            self.step(dt_s, dataclasses.replace(reading, time_s=self.now_s + dt_s), supply)

    @rule(dt_s=st.sampled_from([0.0, 0.001, 0.05, 0.2, 5.0, -1.0, 1e9, -1e9]) | anything)
    def the_clock_does_anything(self, dt_s):
        self.step(dt_s, *self.plausible(5.0, 0.5, 0.5))

    @rule(
        time=st.sampled_from(["now", "any"]),
        any_s=anything,
        supply_V=anything | numbers,
        reference_V=anything | numbers,
        load_V=anything | numbers,
        lvdt_A=anything,
        ambient_C=anything,
        missing=st.booleans(),
    )
    def the_daq_says_anything(self, time, any_s, supply_V, reference_V, load_V, lvdt_A, ambient_C, missing):
        _, state = self.plausible(5.0, 0.5, 0.5)
        time_s = self.now_s + 0.05 if time == "now" else any_s
        self.step(0.05, None if missing else Reading(time_s, supply_V, reference_V, load_V, lvdt_A, ambient_C), state)

    @rule(
        setting_A=anything | numbers,
        on=st.booleans(),
        voltage_V=anything,
        current_A=anything,
        tripped=st.sampled_from(["", "", "OVP", "OCP,WDOG", "\0"]),
        missing=st.booleans(),
    )
    def the_supply_says_anything(self, setting_A, on, voltage_V, current_A, tripped, missing):
        reading, _ = self.plausible(5.0, 0.5, 0.5)
        self.step(
            0.05, reading, None if missing else SupplyState(self.now_s, setting_A, on, voltage_V, current_A, tripped)
        )

    @rule()
    def the_estimator_breaks_once(self):
        genuine = self.actuator._chain.step

        def step(signals):
            self.actuator._chain.step = genuine
            raise FloatingPointError("provoked")

        self.actuator._chain.step = step

    # --- what people do ---------------------------------------------------------------------------

    @rule(position_m=anything | st.floats(0.0, 0.005), late_s=anything | st.just(0.0))
    def anybody_sends_a_setpoint(self, position_m, late_s):
        refusal = self.actuator.offer_setpoint(self.now_s - late_s, position_m)
        assert isinstance(refusal, str)
        if not math.isfinite(position_m):
            assert refusal

    @rule(
        position_m=anything | st.floats(0.0, 0.005),
        late_s=anything | st.just(0.0),
        near_m=st.none() | st.floats(-3e-4, 3e-4),
    )
    def anybody_streams_joint_commands(self, position_m, late_s, near_m):
        estimate = self.output.estimate if self.output is not None else None
        if near_m is not None and estimate is not None:
            position_m = estimate.displacement_m + near_m
        commanding = self.actuator._commanding
        before, armed = (commanding.state, commanding.position_m(self.now_s)), commanding.armed
        refusal = self.actuator.offer_joint_command(self.now_s - late_s, position_m)
        assert isinstance(refusal, str)
        after = (commanding.state, commanding.position_m(self.now_s))
        if math.isnan(position_m):
            assert repr(after) == repr(before), "NaN was followed"
            assert not refusal or "faster than" in refusal, "NaN was called a fault"
        elif math.isinf(position_m):
            assert refusal
            assert repr(after) == repr(before)
        elif repr(after) != repr(before) and not armed:
            near = abs(position_m - estimate.displacement_m) <= self.config.controller.arming_distance * 0.004 + 1e-12
            assert near and estimate.quality is not Quality.INVALID, "the wire was to jump"

    @rule(points=st.lists(st.tuples(anything | numbers, anything | numbers), max_size=4))
    def anybody_sends_a_trajectory(self, points):
        self.actuator.offer_trajectory(self.now_s, [t for t, _ in points], [p for _, p in points])

    @rule(
        position_m=st.floats(0.0, 0.004),
        resistance_Ohm=st.floats(4.0, 6.0),
        load_N=st.floats(0.1, 1.0),
        noise=st.randoms(),
    )
    def somebody_drives_it_as_one_should(self, position_m, resistance_Ohm, load_N, noise):
        self.begin_as_one_should(resistance_Ohm, load_N, noise)
        self.actuator.offer_setpoint(self.now_s, position_m)
        self.go_well(5, resistance_Ohm, load_N, noise)
        self.actuator.offer_joint_command(self.now_s, self.output.estimate.displacement_m)
        self.go_well(2, resistance_Ohm, load_N, noise)
        self.actuator.offer_joint_command(self.now_s, position_m)
        self.go_well(5, resistance_Ohm, load_N, noise)

    def begin_as_one_should(self, resistance_Ohm, load_N, noise):
        self.anybody_clears()
        self.step(0.0, *self.plausible(5.0, 0.5, 0.5))  # the first says nothing of the time before
        self.step(3600.0, *self.plausible(5.0, 0.5, 0.5))  # by then the wire is cool
        self.go_well(2, resistance_Ohm, load_N, noise)
        self.anybody_switches(True)
        self.go_well(math.ceil(0.5 * self.config.loop.rate), resistance_Ohm, load_N, noise)

    @rule(on=st.booleans())
    def anybody_switches(self, on):
        ok, sentence = self.actuator.enable(self.now_s, on)
        assert sentence
        assert not (ok and on and self.latched), "enabled with a latched fault"
        self.enabled = ok and on if on else False

    @rule()
    def anybody_clears(self):
        assert self.actuator.clear_fault(self.now_s)[0]
        self.latched = ""

    @rule(fault=st.sampled_from(REPORTABLE), detail=st.text(max_size=5))
    def the_driver_reports(self, fault, detail):
        self.actuator.raise_fault(self.now_s, fault, detail)
        if FAULTS[fault].latches and (self.enabled or FAULTS[fault].while_off):
            self.latched = self.latched or fault

    @rule()
    def anybody_tunes(self):
        ok, sentence = self.actuator.tune(self.now_s)
        assert sentence
        assert not (ok and not self.enabled), "tuned with the output off"

    @rule(
        steps=st.integers(5, 60),
        resistances_Ohm=st.lists(st.floats(4.0, 6.0), min_size=1, max_size=4),
        load_N=st.floats(0.1, 1.0),
        noise=st.randoms(),
    )
    def somebody_tunes_as_one_should(self, steps, resistances_Ohm, load_N, noise):
        self.begin_as_one_should(resistances_Ohm[0], load_N, noise)
        self.anybody_tunes()
        bound_A = self.config.controller.tuning_current * self.config.supply.max_current
        for number in range(steps):
            self.go_well(1, resistances_Ohm[number // 5 % len(resistances_Ohm)], load_N, noise)
            if self.output.status.mode is Mode.TUNING:
                assert self.output.command.current_A <= bound_A, "more current than the bound of the tuning"

    @rule()
    def anybody_calls_the_services(self):
        self.actuator.tare_load()
        self.actuator.measure_lead_resistance()
        self.actuator.reset_estimator()

    @rule(
        controller=st.fixed_dictionaries(live_values(FeedForwardPidParameters)),
        safety=st.fixed_dictionaries(live_values(SafetyParameters)),
    )
    def anybody_changes_live_parameters(self, controller, safety):
        changes = self.known_to_the_law(controller) | {f"safety.{k}": v for k, v in safety.items()}
        try:
            self.config = self.config.replace(changes)
        except ConfigError:
            return
        self.actuator.update(self.config)

    # --- what must hold ---------------------------------------------------------------------------

    @precondition(lambda self: self.output is not None)
    @invariant()
    def the_current_is_a_current_within_the_limit(self):
        command = self.output.command
        assert 0.0 <= command.current_A <= self.config.supply.max_current
        assert command.output_on or command.current_A == 0.0

    @precondition(lambda self: self.output is not None)
    @invariant()
    def the_mode_is_what_is_done(self):
        status = self.output.status
        assert (status.mode is Mode.OFF) == (not self.output.command.output_on)
        assert status.message
        assert status.fault == "" or status.fault in FAULTS


@pytest.mark.parametrize("examples", [50, pytest.param(250, marks=pytest.mark.long)])
def test_no_use_whatsoever_commands_what_it_must_not(make_config, examples):
    class Use(AnyUse):
        base = make_config(calibration=CALIBRATION)

    Use.TestCase.settings = settings(
        max_examples=examples,
        stateful_step_count=40,
        deadline=None,
        suppress_health_check=list(HealthCheck),
        derandomize=True,
    )
    Use.TestCase("runTest").runTest()


def test_who_drives_it_as_one_should_has_more_than_the_bias_flow(make_config):
    """Else the uses above would prove nothing.  What they draw depends on which modules are loaded: so it is asked of
    this one."""
    use = AnyUse()
    use.base = make_config(calibration=CALIBRATION)
    use.start(
        bias_A=0.05,
        span_A=0.35,
        rate_Hz=20.0,
        loss="hold",
        timeout_s=0.0,
        law="pid",
        controller={},
        max_stress_Pa=175e6,
        derate_C=150.0,
    )
    use.somebody_drives_it_as_one_should(1e-3, 5.0, 0.5, random.Random(0))
    assert use.output.status.mode is Mode.TRACKING and use.output.command.current_A > 0.05


@pytest.fixture
def looked_at(make_config):
    """A machine that keeps its modes: what of a rule chance comes to depends on the modules that hypothesis sees."""

    class Looking(AnyUse):
        base = make_config(calibration=CALIBRATION)
        modes = ()

        def step(self, *arguments, **options):
            super().step(*arguments, **options)
            self.modes = (*self.modes, self.output.status.mode)

    machine = Looking()
    machine.start(0.05, 0.2, 20.0, "hold", 0.0, "pid", {}, 175e6, 160.0)
    return machine


def test_the_rule_that_tunes_as_one_should_does_tune(looked_at):
    looked_at.somebody_tunes_as_one_should(30, [5.0, 5.2], 0.5, random.Random(1))
    assert looked_at.modes.count(Mode.TUNING) > 10


def test_the_rule_that_drives_as_one_should_does_drive(looked_at):
    looked_at.somebody_drives_it_as_one_should(0.002, 5.0, 0.5, random.Random(1))
    assert looked_at.modes.count(Mode.TRACKING) > 5
    assert looked_at.output.command.current_A > looked_at.config.supply.bias_current
