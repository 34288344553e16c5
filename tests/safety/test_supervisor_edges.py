"""The supervisor at its edges, on its own: what it lets through, to the last bit where a bit decides."""

import math

import pytest

import sma_actuator.safety.supervisor
from sma_actuator.base.signals import OFF, Branch, Command, Estimate, Quality, Reading, Signals, SupplyState
from sma_actuator.config import Config
from sma_actuator.safety.faults import FAULTS
from sma_actuator.safety.limits import STRESS_NEAR_LIMIT, TEMPERATURE_DERATING
from sma_actuator.safety.records import Action, Step
from sma_actuator.safety.supervisor import Supervisor
from sma_actuator.safety.timing import SETTLING_READINGS, SETTLING_TIME_s

NAN, INF = math.nan, math.inf
BIAS_A, MAX_A = 0.05, 0.4
AMBIENT_C = 22.0
COLD_s = 1e6  #: for so long without power every wire is as cold as the room
READING = Reading(10.0, 1.3, 0.2, 0.08)
SUPPLY = SupplyState(10.0, 0.2, True, 1.3, 0.2)
#: So little heat capacity that the heat leaves less than the highest current.
SMALL = {"thermal.heat_capacity": 2e-3, "supply.watchdog_timeout": 0.5, "safety.reading_timeout": 1.0}
STRESS_FROM_50_MPa = {"wire.max_stress": 100e6, "safety.stress_limit_fraction": 0.5}
WHILE_OFF = {
    "driven": False,
    "told": OFF,
    "supply": SupplyState(10.0, 0.0, False, 0.0, 0.0),
    "signals": Signals(10.0, NAN, 0.0, 0.0, 0.98, 54e6),
}


@pytest.fixture
def make(make_config):
    """A supervisor of a wire that has cooled, with 5 Ω measured."""

    def make(resistance_Ohm=5.0, **changes):
        supervisor = Supervisor(Config.from_mapping(make_config(**{"supply.bias_current": BIAS_A, **changes})))
        supervisor.keep_heat(0.0, 0.0, COLD_s, AMBIENT_C)
        if resistance_Ohm:
            supervisor.keep_heat(resistance_Ohm * 0.2**2, 0.2, 0.0, AMBIENT_C)
        return supervisor

    return make


@pytest.fixture
def step(config):
    """A step of a driven wire with a reading, but for what a test changes."""

    def make(supervisor, **changes):
        return Step(
            **{
                "config": supervisor.config,
                "memory": supervisor.memory,
                "now_s": 10.0,
                "dt_s": 0.05,
                "driven": True,
                "settled": False,
                "raw": READING,
                "reading": READING,
                "signals": Signals(10.0, 5.25, 0.2, 0.21, 0.98, 54e6),
                "estimate": Estimate(10.0, 0.002, 0.02, 0.0, Branch.HEATING, Quality.DETERMINATE),
                "supply": SUPPLY,
                "told": Command(0.2, True),
                "heat": supervisor.heat,
                **changes,
            }
        )

    return make


class TestSettled:
    def readings(self, supervisor, step, number, **changes):
        for _ in range(number):
            supervisor.inspect(step(supervisor, **changes))

    def test_takes_a_time_and_readings_since_the_output_went_on(self, make, step):
        supervisor = make()
        supervisor.enabled(8.0)  # where the time of settling is a sum without rounding
        self.readings(supervisor, step, SETTLING_READINGS - 1)
        assert not supervisor.settled(8.0 + SETTLING_TIME_s)
        self.readings(supervisor, step, 1)
        assert supervisor.settled(8.0 + SETTLING_TIME_s)
        assert not supervisor.settled(8.0 + SETTLING_TIME_s - 1e-9)

    def test_is_not_what_was_never_enabled(self, make, step):
        supervisor = make()
        self.readings(supervisor, step, SETTLING_READINGS)
        assert not supervisor.settled(1e9)

    def test_begins_anew_with_every_enabling(self, make, step):
        supervisor = make()
        supervisor.enabled(0.0)
        self.readings(supervisor, step, SETTLING_READINGS)
        supervisor.enabled(1.0)
        self.readings(supervisor, step, SETTLING_READINGS - 1)
        assert not supervisor.settled(1e9)

    @pytest.mark.parametrize("changes", [{"reading": None}, {"driven": False}])
    def test_counts_no_step_without_a_reading_or_without_current(self, make, step, changes):
        supervisor = make()
        supervisor.enabled(0.0)
        self.readings(supervisor, step, SETTLING_READINGS, **changes)
        assert not supervisor.settled(1e9)


class TestUsable:
    def test_no_reading_is_none(self, make):
        assert make().usable(None, 9.0, 10.0) is None

    @pytest.mark.parametrize(("last_s", "usable"), [(NAN, False), (9.9, True), (10.0, False), (10.1, False)])
    def test_it_is_newer_than_the_last(self, make, last_s, usable):
        assert (make().usable(READING, last_s, 10.0) is READING) == usable

    @pytest.mark.parametrize(
        ("now_s", "usable"), [(10.5, True), (10.5001, False), (9.5, True), (9.4999, False), (NAN, False)]
    )
    def test_it_is_of_about_now(self, make, now_s, usable):
        supervisor = make(**{"safety.reading_timeout": 0.5})
        assert (supervisor.usable(READING, 9.0, now_s) is READING) == usable

    @pytest.mark.parametrize(
        ("volts", "usable"), [(11.99, True), (-11.99, True), (12.0, False), (-12.0, False), (NAN, False), (INF, False)]
    )
    @pytest.mark.parametrize("channel", [0, 1, 2])
    def test_it_is_inside_the_converters_range(self, make, channel, volts, usable):
        values = [1.3, 0.2, 0.08]
        values[channel] = volts
        supervisor = make(**{"safety.channel_max_voltage": 12.0})
        assert (supervisor.usable(Reading(10.0, *values), 9.0, 10.0) is not None) == usable


class TestFaults:
    def test_there_is_none_in_the_beginning(self, make):
        supervisor = make()
        assert (supervisor.latched, supervisor.detail, supervisor.present) == (None, "", {})

    def test_the_first_that_latches_stays(self, make):
        supervisor = make()
        supervisor.latch(FAULTS["short"], "the cause")
        supervisor.latch(FAULTS["open_wire"], "what follows")
        assert (supervisor.latched, supervisor.detail) == (FAULTS["short"], "the cause")

    def test_of_several_in_one_step_the_gravest_latches(self, make, step):
        supervisor = make()
        signals = Signals(10.0, 5.25, 0.2, 0.21, 0.98, 1e9)  # too much stress, and it came at once
        found = supervisor.inspect(step(supervisor, signals=signals, dt_s=-1.0))
        names = [fault.name for fault in found]
        assert {"clock_jump", "stress_above_limit"} <= set(names)
        assert names == [name for name in FAULTS if name in names]
        assert supervisor.latched.name == names[0]

    def test_those_of_these_names_are_not_looked_for(self, make, step):
        supervisor = make()
        assert supervisor.inspect(step(supervisor, dt_s=-1.0), but=("clock_jump",)) == {}
        assert supervisor.present == {}
        assert supervisor.latched is None

    def test_while_the_output_is_off_most_only_prevent_enabling(self, make, step):
        supervisor = make()
        signals = Signals(10.0, NAN, 0.0, 0.0, 0.98, 1e9)
        found = supervisor.inspect(step(supervisor, **{**WHILE_OFF, "signals": signals}))
        (present,) = [fault for fault in supervisor.present if fault.name == "stress_above_limit"]
        assert present.latches and not present.while_off
        assert present not in found
        assert supervisor.latched is None

    def test_what_latches_while_off_does(self, make, step):
        supervisor = make()
        state = SupplyState(10.0, 0.0, False, 0.0, 0.0, "OVP")
        found = supervisor.inspect(step(supervisor, **{**WHILE_OFF, "supply": state}))
        assert supervisor.latched is FAULTS["supply_tripped"] in found

    @pytest.mark.parametrize("driven", [True, False])
    def test_one_that_does_not_latch_is_found_also_while_off_and_passes(self, make, step, driven):
        supervisor = make()
        state = {} if driven else WHILE_OFF
        assert supervisor.inspect(step(supervisor, **state)) == supervisor.present == {}
        broken = Reading(10.0, NAN, 0.2, 0.08)
        found = supervisor.inspect(step(supervisor, **state, raw=broken, reading=None))
        assert list(found) == list(supervisor.present) == [FAULTS["reading_not_finite"]]
        assert supervisor.latched is None
        assert supervisor.inspect(step(supervisor, **state)) == supervisor.present == {}


class TestHeat:
    def heat_A(self, supervisor, horizon_s, resistance_Ohm):
        power_W = supervisor.heat.power_limit_W(horizon_s, supervisor.config.thermal)
        return math.sqrt(power_W / resistance_Ohm)

    @pytest.mark.parametrize(
        ("watchdog_s", "reading_timeout_s", "unwatched_s"), [(0.5, 1.0, 1.0), (1.0, 0.6, 1.0), (0.0, 0.6, INF)]
    )
    def test_leaves_what_may_flow_until_somebody_looks_or_the_watchdog_cuts(
        self, make, watchdog_s, reading_timeout_s, unwatched_s
    ):
        changes = {"supply.watchdog_timeout": watchdog_s, "safety.reading_timeout": reading_timeout_s}
        supervisor = make(**{**SMALL, **changes, "supply.allow_no_watchdog": True, "loop.rate": 10.0})
        wanted_A = self.heat_A(supervisor, unwatched_s + 0.1, 5.0)
        assert BIAS_A < wanted_A < MAX_A
        assert supervisor.limit_A() == pytest.approx(wanted_A, rel=1e-12)

    def test_so_it_does_once_readings_may_be_older(self, make):
        supervisor = make(**{**SMALL, "supply.watchdog_timeout": 1.0, "loop.rate": 10.0})
        supervisor.update(supervisor.config.replace({"safety.reading_timeout": 2.0}))
        assert BIAS_A < supervisor.limit_A() == pytest.approx(self.heat_A(supervisor, 2.1, 5.0), rel=1e-12)

    @pytest.mark.parametrize("resistance_Ohm", [0.5, 0.9, 5.0])
    def test_uses_the_resistance_that_was_measured(self, make, resistance_Ohm):
        supervisor = make(resistance_Ohm, **SMALL, **{"supply.max_current": 0.8, "supply.over_current_trip": 0.9})
        wanted_A = min(self.heat_A(supervisor, 1.0 + 1.0 / supervisor.config.loop.rate, resistance_Ohm), 0.8)
        assert supervisor.limit_A() == pytest.approx(wanted_A, rel=1e-12) != BIAS_A

    def test_leaves_the_bias_until_a_resistance_was_measured(self, make):
        assert make(resistance_Ohm=None).limit_A() == BIAS_A

    @pytest.mark.parametrize(
        ("power_W", "current_A"), [(0.0, 0.2), (0.1, 0.0), (-0.5, 0.2), (0.1, -0.2), (NAN, 0.2), (0.1, NAN)]
    )
    def test_learns_no_resistance_from_what_is_no_power(self, make, power_W, current_A):
        supervisor = make(**SMALL)
        before_A = supervisor.limit_A()
        supervisor.keep_heat(power_W, current_A, 0.0, AMBIENT_C)
        assert supervisor.limit_A() == before_A > BIAS_A

    def test_leaves_the_bias_to_a_wire_that_is_too_hot_already(self, make):
        supervisor = make(**SMALL)
        supervisor.keep_heat(1.0, 0.4, COLD_s, AMBIENT_C)
        assert supervisor.limit_A() == BIAS_A

    def test_is_reckoned_with_the_surroundings_that_are_said_live(self, make):
        one = make()
        one.update(one.config.replace({"thermal.ambient_temperature": 31.0}))
        assert one.heat.transforms.then_C == 31.0

    def test_leaves_the_bias_where_no_power_may_flow(self, make, monkeypatch):
        """Below zero: what is stored already is too much."""
        one = make()
        monkeypatch.setattr(sma_actuator.safety.supervisor, "may_flow_W", lambda *_: (1.0, -0.5))
        one.update(one.config)
        assert one.limit_A() == BIAS_A

    def test_leaves_the_bias_where_the_temperature_is_not_a_number(self, make):
        supervisor = make()
        assert supervisor.limit_A() == MAX_A
        supervisor.heat.temperature_C = supervisor.heat.at_most_C = NAN
        supervisor.update(supervisor.config)
        assert supervisor.limit_A() == BIAS_A
        assert supervisor.gate(MAX_A, True, {})[0] == Command(BIAS_A, True)

    def test_is_kept_of_what_the_wire_alone_takes_and_by_its_stress(self, make, monkeypatch):
        supervisor, taken = make(), []
        monkeypatch.setattr(type(supervisor.heat), "step", lambda _, *given: taken.append(given))
        supervisor.keep_heat(0.3, 0.2, 0.05, AMBIENT_C, 5.0, 0.98)
        assert taken[0][-2:] == pytest.approx((0.2**2 * 5.0, 0.98 / supervisor.config.wire.area_m2))

    @pytest.mark.parametrize(("changes", "times"), [({}, 0), (SMALL, 1)], ids=["leaves all", "leaves less"])
    def test_only_a_wire_that_it_holds_back_is_let_cool(self, make, monkeypatch, changes, times):
        supervisor, taken = make(**changes), []
        monkeypatch.setattr(type(supervisor.heat), "let_cool", lambda _: taken.append(True))
        supervisor.let_cool()
        assert len(taken) == times


class TestStress:
    def test_at_the_bound_all_is_free(self, make):
        supervisor = make(**STRESS_FROM_50_MPa)
        assert (supervisor.limit_A(), supervisor.stress_floor_m) == (MAX_A, -INF)
        supervisor.watch_stress(50e6, 0.002, 0.2)
        assert (supervisor.limit_A(), supervisor.stress_floor_m) == (MAX_A, -INF)

    def test_beyond_it_neither_current_nor_contraction_grows(self, make):
        supervisor = make(**STRESS_FROM_50_MPa)
        supervisor.watch_stress(50.1e6, 0.002, 0.2)
        assert (supervisor.limit_A(), supervisor.stress_floor_m) == (0.2, 0.002)
        supervisor.watch_stress(60e6, 0.001, 0.3)  # neither of these
        assert (supervisor.limit_A(), supervisor.stress_floor_m) == (0.2, 0.002)
        supervisor.watch_stress(60e6, 0.003, 0.15)  # less current stays
        assert (supervisor.limit_A(), supervisor.stress_floor_m) == (0.15, 0.002)

    def test_enough_is_left_to_measure_with(self, make):
        supervisor = make(**STRESS_FROM_50_MPa)
        supervisor.watch_stress(60e6, 0.002, 0.0)
        assert supervisor.limit_A() == BIAS_A

    @pytest.mark.parametrize("release", [lambda one: one.watch_stress(50e6, 0.0, 0.2), lambda one: one.enabled(20.0)])
    def test_it_passes(self, make, release):
        supervisor = make(**STRESS_FROM_50_MPa)
        supervisor.watch_stress(60e6, 0.002, 0.2)
        release(supervisor)
        assert (supervisor.limit_A(), supervisor.stress_floor_m) == (MAX_A, -INF)


class TestGate:
    @pytest.mark.parametrize("wanted_A", [0.0, 1e-9, 0.2, MAX_A])
    def test_a_current_that_is_allowed_passes_as_it_is(self, make, wanted_A):
        assert make().gate(wanted_A, True, {}) == (Command(wanted_A, True), set())

    def test_more_than_the_highest_is_the_highest(self, make):
        assert make().gate(0.7, True, {}) == (Command(MAX_A, True), set())

    def test_nothing_passes_where_the_wire_is_not_driven(self, make):
        assert make().gate(0.2, False, {}) == (OFF, set())

    def test_nothing_passes_with_a_fault_that_latched(self, make):
        supervisor = make()
        supervisor.latch(FAULTS["short"], "a test")
        assert supervisor.gate(0.2, True, {}) == (OFF, set())

    @pytest.mark.parametrize("wanted_A", [-1e-9, NAN, INF, -INF])
    def test_what_is_no_current_latches(self, make, wanted_A):
        supervisor = make()
        assert supervisor.gate(wanted_A, True, {}) == (OFF, set())
        assert supervisor.latched is FAULTS["command_invalid"]
        assert supervisor.gate(0.2, True, {})[0] == OFF

    def test_a_fault_that_falls_back_to_the_bias_leaves_that(self, make):
        supervisor = make()
        faults = {fault: "a test" for fault in FAULTS.values() if fault.action is Action.BIAS}
        others = {fault: "a test" for fault in FAULTS.values() if fault.action is Action.NOTE}
        assert faults
        assert supervisor.gate(0.3, True, faults | others)[0] == Command(BIAS_A, True)
        assert supervisor.gate(0.01, True, faults)[0] == Command(0.01, True)
        assert supervisor.gate(0.3, True, others)[0] == Command(0.3, True)

    def test_stress_is_named_while_it_limits(self, make):
        supervisor = make(**STRESS_FROM_50_MPa)
        supervisor.watch_stress(60e6, 0.002, 0.2)
        assert supervisor.gate(0.3, True, {}) == (Command(0.2, True), {STRESS_NEAR_LIMIT})
        assert supervisor.gate(0.1, True, {}) == (Command(0.1, True), {STRESS_NEAR_LIMIT})

    def test_heat_is_named_where_it_bends_the_command(self, make):
        supervisor = make(**SMALL)
        limit_A = supervisor.limit_A()
        assert supervisor.gate(limit_A, True, {}) == (Command(limit_A, True), {TEMPERATURE_DERATING})
        assert supervisor.gate(MAX_A, True, {}) == (Command(limit_A, True), {TEMPERATURE_DERATING})
        assert supervisor.gate(0.99 * limit_A, True, {}) == (Command(0.99 * limit_A, True), set())


class TestLetGo:
    """The latch of an instrument that was away ends by itself once both are back, off, and nothing else is wrong."""

    OFF_AGAIN = WHILE_OFF["supply"]

    @pytest.fixture
    def latched(self, make):
        """``latched(name)``: a supervisor that has latched this fault."""

        def latched(name="daq_lost"):
            supervisor = make(**{"safety.reading_timeout": 0.5})
            supervisor.latch(FAULTS[name], "for a reason")
            return supervisor

        return latched

    def test_after_both_have_answered_for_the_reading_timeout(self, latched):
        supervisor = latched()
        names = [supervisor.let_go(now_s, READING, self.OFF_AGAIN) for now_s in (10.0, 10.25, 10.5, 10.75)]
        assert names == ["", "", "daq_lost", ""]
        assert (supervisor.latched, supervisor.detail) == (None, "")

    @pytest.mark.parametrize(
        ("reading", "supply"), [(None, OFF_AGAIN), (READING, None), (None, None), (READING, SUPPLY), (None, SUPPLY)]
    )
    def test_not_while_one_is_silent_or_the_output_is_on(self, latched, reading, supply):
        supervisor = latched()
        assert [supervisor.let_go(now_s, reading, supply) for now_s in (10.0, 11.0)] == ["", ""]
        assert supervisor.latched is FAULTS["daq_lost"]
        assert supervisor.let_go(11.0, READING, self.OFF_AGAIN) == ""  # only from now on

    @pytest.mark.parametrize(("present", "name"), [("reading_saturated", ""), ("reference_doubted", "daq_lost")])
    def test_what_keeps_the_output_off_keeps_the_latch(self, latched, present, name):
        supervisor = latched()
        supervisor.present = {FAULTS[present]: "now"}
        assert [supervisor.let_go(now_s, READING, self.OFF_AGAIN) for now_s in (10.0, 11.0)] == ["", name]

    def test_any_other_fault_waits_for_somebody_to_clear_it(self, latched):
        supervisor = latched("short")
        assert [supervisor.let_go(now_s, READING, self.OFF_AGAIN) for now_s in (10.0, 11.0)] == ["", ""]
        assert (supervisor.latched, supervisor.detail) == (FAULTS["short"], "for a reason")


class TestMostRise:
    """How far above its surroundings the wire can be held."""

    def test_is_what_the_highest_current_holds_where_a_watchdog_cuts_it(self, make):
        supervisor = make(resistance_Ohm=50.0, **{"supply.watchdog_timeout": 0.5})
        held_K = MAX_A**2 * 50.0 / supervisor.config.thermal.heat_loss
        assert supervisor.most_rise_K() == pytest.approx(held_K)

    def test_is_what_may_flow_for_ever_where_none_does(self, make):
        supervisor = make(resistance_Ohm=50.0, **{"supply.watchdog_timeout": 0.0, "supply.allow_no_watchdog": True})
        thermal = supervisor.config.thermal
        assert supervisor.most_rise_K() == supervisor.heat.power_limit_W(INF, thermal) / thermal.heat_loss
