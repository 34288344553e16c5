"""The heat balance against its closed form, and the current it leaves."""

import math
from dataclasses import replace

import numpy as np
import pytest
from calibrated import CALIBRATION

from sma_actuator.base.jit import floats
from sma_actuator.config import Config
from sma_actuator.safety.ambient import Ambient, AMBIENT_FALL_K_s
from sma_actuator.safety.cold import COLD_TIMES, SHOWN_COLD, COLD_Ohm, RESTED_times, begin_cold, keep_cold
from sma_actuator.safety.thermal import (
    _COLD,
    LATENT_K,
    NOT_CONTRACTED_MARGIN,
    SHOWN_LOSS,
    THERMOMETER,
    HeatBalance,
    LONG_AGO_s,
    WireHeat,
    _cools,
    _transforms_Ohm,
    begin_thermometer,
    derated_limit_A,
    hottest_C,
    shown_loss_W_K,
)
from sma_actuator.safety.transformed import CAPACITY_WITHIN, FALLS, LEAST_SLOPE_1_K, Transforms


@pytest.fixture
def parameters(config):
    return replace(config.thermal, heat_capacity=0.01, heat_loss=0.005, derate_temperature=160.0, max_temperature=200.0)


def test_one_step_follows_the_exponential_to_the_settled_temperature():
    heat = HeatBalance(20.0)
    tau_s, settled_C = 0.01 / 0.005, 20.0 + 0.5 / 0.005
    assert heat.step(0.5, 3.0, 20.0, 0.01, 0.005) == pytest.approx(
        settled_C - 100.0 * math.exp(-3.0 / tau_s), abs=1e-12
    )


def test_a_thousand_small_steps_are_one_large_one():
    one, many = HeatBalance(20.0), HeatBalance(20.0)
    one.step(0.5, 3.0, 20.0, 0.01, 0.005)
    for _ in range(1000):
        many.step(0.5, 0.003, 20.0, 0.01, 0.005)
    assert many.temperature_C == pytest.approx(one.temperature_C, abs=1e-9)


def test_it_obeys_the_heat_balance():
    heat = HeatBalance(80.0)
    dt_s = 1e-6
    rate_K_s = (heat.step(0.5, dt_s, 20.0, 0.01, 0.005) - 80.0) / dt_s
    assert 0.01 * rate_K_s == pytest.approx(0.5 - 0.005 * (80.0 - 20.0), rel=1e-5)


@pytest.mark.parametrize(
    "arguments",
    [(math.nan, 1.0, 20.0), (math.inf, 1.0, 20.0), (0.1, math.nan, 20.0), (0.1, -1.0, 20.0), (0.1, 1.0, math.nan)],
)
def test_what_is_not_known_does_not_cool_the_wire(arguments):
    heat = HeatBalance(150.0)
    assert heat.step(*arguments, 0.01, 0.005) == 150.0


@pytest.mark.parametrize(
    ("temperature_C", "limit_A"),
    [
        (-300.0, 0.4),
        (20.0, 0.4),
        (160.0, 0.4),
        (180.0, 0.225),
        (200.0, 0.05),
        (1e300, 0.05),
        (math.inf, 0.05),
        (math.nan, 0.05),
    ],
)
def test_the_current_limit_falls_from_the_maximum_to_the_bias(parameters, temperature_C, limit_A):
    assert derated_limit_A(temperature_C, 0.4, 0.05, parameters) == pytest.approx(limit_A)


def test_a_wire_of_which_nothing_is_known_counts_as_hot_as_it_may_be(parameters):
    heat = WireHeat(parameters)
    assert heat.temperature_C == heat.at_most_C == parameters.max_temperature
    heat.step(0.0, 3.0, math.nan, parameters)
    rise_K = parameters.max_temperature - parameters.ambient_temperature
    assert heat.temperature_C == pytest.approx(parameters.ambient_temperature + rise_K * math.exp(-1.5))
    assert heat.at_most_C == pytest.approx(parameters.ambient_temperature + rise_K * math.exp(-0.5))


@pytest.mark.parametrize("at_most_C", [24.0, 120.0, 190.0])
@pytest.mark.parametrize("horizon_s", [0.1, 1.05, 60.0, math.inf])
def test_the_power_limit_takes_the_wire_to_its_limit_at_the_horizon_and_no_further(parameters, at_most_C, horizon_s):
    heat = WireHeat(parameters)
    heat.at_most_C, heat.cools = at_most_C, False
    power_W = heat.power_limit_W(horizon_s, parameters)
    heat.step(power_W, min(horizon_s, 1e6), math.nan, parameters)
    assert heat.at_most_C == pytest.approx(195.0)


def test_surroundings_are_the_parameter_where_nothing_is_measured(parameters):
    ambient = Ambient(parameters)
    assert ambient.doubt == ""
    assert ambient.step(math.nan, 0.05, parameters) == 24.0
    assert ambient.doubt == ""


@pytest.mark.parametrize("read_C", [-59.0, 8.9, 101.0, -1e4, math.inf, -math.inf])
def test_a_sensor_that_reads_what_cannot_be_is_not_believed(parameters, read_C):
    ambient = Ambient(parameters)
    for _ in range(10_000):
        ambient.step(read_C, 0.05, parameters)
    assert ambient.temperature_C == 24.0
    assert "it reads" in ambient.doubt


@pytest.mark.parametrize("read_C", [math.nan, math.inf, -59.0])
def test_a_warm_room_stays_warm_when_its_sensor_breaks(parameters, read_C):
    """Until it could have cooled as fast as any room: too warm only costs current, too cold costs the wire."""
    ambient = Ambient(parameters)
    ambient.step(45.0, 0.05, parameters)
    for _ in range(10):
        ambient.step(read_C, 1.0, parameters)
    assert ambient.temperature_C == pytest.approx(45.0 - 10.0 * AMBIENT_FALL_K_s)
    assert ambient.step(read_C, 1000.0, parameters) == 24.0


def test_where_nothing_is_measured_another_parameter_counts_at_once(parameters):
    ambient = Ambient(parameters)
    for said_C in (60.0, 24.0):
        assert ambient.step(math.nan, 0.05, replace(parameters, ambient_temperature=said_C)) == said_C


def test_a_sensor_is_followed_upwards_at_once_and_downwards_slowly(parameters):
    ambient = Ambient(parameters)
    assert ambient.step(60.0, 0.05, parameters) == 60.0
    assert ambient.step(24.0, 0.05, parameters) == 24.0
    assert ambient.step(14.0, 10.0, parameters) == pytest.approx(24.0 - 10.0 * AMBIENT_FALL_K_s)
    ambient.step(14.1, 200.0, parameters)
    assert ambient.temperature_C == 14.1
    assert ambient.doubt == ""


def test_a_sensor_that_stands_still_is_believed_only_where_it_is_warm(parameters):
    for read_C, believed_C in ((15.0, 24.0), (30.0, 30.0)):
        ambient = Ambient(parameters)
        for _ in range(1300):
            ambient.step(read_C, 0.5, parameters)
        assert ambient.temperature_C == pytest.approx(believed_C, abs=5.1)
        assert bool(ambient.doubt) == (read_C < 24.0)


@pytest.mark.parametrize("dt_s", [math.nan, -1.0, math.inf])
def test_time_that_is_none_does_not_cool_the_surroundings(parameters, dt_s):
    ambient = Ambient(parameters)
    assert ambient.step(15.0, dt_s, parameters) == 24.0


def test_a_time_without_end_is_no_step():
    balance = HeatBalance(50.0)
    assert balance.step(1.0, math.inf, 20.0, 0.01, 0.005) == 50.0


class TestBoundsOfAmbient:
    """Where a sensor begins not to be believed; 20 °C are usual, 5 K of tolerance."""

    @pytest.fixture
    def thermal(self, make_config):
        changes = {"ambient_temperature": 20.0, "ambient_tolerance": 5.0, "ambient_stuck_time": 8.0}
        return Config.from_mapping(make_config(thermal=changes)).thermal

    @pytest.mark.parametrize(
        ("read_C", "is_doubted"),
        [(100.0, False), (math.nextafter(100.0, 200.0), True), (15.0, False), (math.nextafter(15.0, 0.0), True)],
    )
    def test_of_what_it_reads(self, read_C, is_doubted, thermal):
        ambient = Ambient(thermal)
        ambient.step(read_C, 0.5, thermal)
        assert bool(ambient.doubt) is is_doubted

    @pytest.mark.parametrize(("read_C", "may_be_stuck"), [(19.0, True), (20.0, False), (21.0, False)])
    def test_of_how_long_it_reads_the_same(self, read_C, may_be_stuck, thermal):
        ambient = Ambient(thermal)
        for _ in range(17):  # the first reading has stood for no time, the last for eight seconds
            ambient.step(read_C, 0.5, thermal)
        assert ambient.doubt == ""
        ambient.step(read_C, 0.5, thermal)
        assert bool(ambient.doubt) is may_be_stuck


class TestThermometer:
    """The wire's resistance as a bound of its temperature; 150 °C is what no wire transforms above."""

    @pytest.fixture
    def shown_C(self):
        state = floats(THERMOMETER)
        begin_thermometer(state, 0)

        def run(resistance_Ohm, at_most_C=170.0, seconds=2.0, load_N=1.0, contracted_Ohm=math.inf, own_C=150.0):
            for _ in range(round(seconds / 0.05)):
                found_C = hottest_C(
                    state, 0, resistance_Ohm, load_N, 0.05, at_most_C, own_C, contracted_Ohm, LEAST_SLOPE_1_K
                )
            return found_C

        return run

    def test_of_a_wire_that_was_never_cool_it_says_nothing(self, shown_C):
        assert shown_C(4.5) == math.inf

    def test_one_that_shows_less_the_hotter_it_is_transforms(self, shown_C):
        shown_C(5.0, at_most_C=100.0)
        assert shown_C(4.6) == pytest.approx(150.0)
        assert shown_C(4.5) == pytest.approx(150.0)

    def test_what_it_shows_more_than_the_least_counts_as_heat(self, shown_C):
        shown_C(5.0, at_most_C=100.0)
        shown_C(4.5)
        assert shown_C(4.5 * (1.0 + 20.0 * LEAST_SLOPE_1_K)) == pytest.approx(170.0, abs=0.1)

    def test_what_it_transforms_below_now_says_nothing_of_when_it_showed_the_least(self, shown_C):
        """By the heat balance it was 130 °C then, and cools: in a wire at 162 °C that balance called 120."""
        shown_C(5.0, at_most_C=100.0)
        shown_C(4.5, own_C=130.0)
        hotter_Ohm = 4.5 * (1.0 + 32.0 * LEAST_SLOPE_1_K)
        assert shown_C(hotter_Ohm, own_C=120.0) == pytest.approx(162.0, abs=0.1)
        assert shown_C(hotter_Ohm, own_C=140.0) == pytest.approx(172.0, abs=0.1), "and more than that counts too"
        assert shown_C(4.49, own_C=120.0) == pytest.approx(120.0, abs=0.1), "until it shows less"

    def test_a_wire_that_is_certainly_cool_begins_anew(self, shown_C):
        shown_C(5.0, at_most_C=100.0)
        shown_C(4.5)
        shown_C(4.9, at_most_C=149.0)
        assert shown_C(4.9) == pytest.approx(150.0, abs=0.1)

    def test_more_than_a_contracted_wire_can_show_is_not_heat(self, shown_C):
        """Martensite that warms shows more and more before it transforms."""
        shown_C(5.0, at_most_C=100.0)
        assert shown_C(5.2) > 300.0
        assert shown_C(5.2, contracted_Ohm=4.9) == pytest.approx(150.0)
        assert shown_C(4.8, contracted_Ohm=4.9) == pytest.approx(150.0)
        assert shown_C(4.85, contracted_Ohm=4.9) > 195.0

    def test_another_load_makes_no_heat(self, shown_C):
        shown_C(5.0, at_most_C=100.0)
        shown_C(4.5)
        assert shown_C(4.55, load_N=2.0) == pytest.approx(150.0)
        assert shown_C(4.55, load_N=2.0) == pytest.approx(150.0)

    @pytest.mark.parametrize("resistance_Ohm", [math.nan, math.inf])
    def test_what_is_no_resistance_says_nothing_and_after_a_while_nothing_is_known(self, shown_C, resistance_Ohm):
        shown_C(5.0, at_most_C=100.0)
        shown_C(4.5)
        assert shown_C(resistance_Ohm, seconds=0.5) == math.inf
        assert shown_C(4.5) == pytest.approx(150.0)
        assert shown_C(resistance_Ohm, seconds=1.5) == math.inf
        assert shown_C(4.5) == math.inf

    def test_a_gap_in_the_readings_leaves_nothing_known(self, parameters):
        heat = WireHeat(parameters)
        heat.step(0.0, 60.0, math.nan, parameters)
        for _ in range(100):
            heat.step(0.5, 0.05, math.nan, parameters, 4.5, 1.0)
        assert heat.at_most_C == pytest.approx(150.0, abs=0.5)
        heat.step(0.5, LONG_AGO_s, math.nan, parameters, 4.5, 1.0)
        assert heat.at_most_C > 160.0


@pytest.fixture
def begin_to_lose(parameters):
    """Makes a wire of which no heat is known to be lost: tell it of power, time and rise."""

    def begun():
        state = floats(SHOWN_LOSS)
        return lambda power_W, dt_s, rise_K: shown_loss_W_K(
            state, 0, power_W, dt_s, rise_K, parameters.heat_capacity, parameters.heat_loss
        )

    return begun


class TestShownLoss:
    """Against a wire that warms, transforms and loses heat, and can be 150 °C hot at the most for all that is known."""

    COLD_C, MOST_C, DT_s = 9.0, 150.0, 0.05

    def shown_W_K(self, parameters, begin_to_lose, loss_W_K, power_W, seconds, unmeasured=0.0):
        """What is shown at every step, and the wire's temperature; the loss may be a function of time."""
        shown, out, warm_C, transformed = begin_to_lose(), [], self.COLD_C, 0.0
        for step in range(round(seconds / self.DT_s)):
            time_s = step * self.DT_s
            loss = loss_W_K(time_s) if callable(loss_W_K) else loss_W_K
            joule = (power_W - loss * (warm_C - self.COLD_C)) * self.DT_s
            if warm_C > 60.0 and joule > 0.0 and transformed < LATENT_K:  # it transforms, and gets no warmer
                transformed += joule / parameters.heat_capacity
            else:
                warm_C += joule / parameters.heat_capacity
            assert warm_C <= self.MOST_C, "what is promised to it"
            seen_W = math.nan if step % 10 < 10 * unmeasured else power_W
            out.append(shown(seen_W, self.DT_s, self.MOST_C - self.COLD_C))
        return out

    @pytest.mark.parametrize("share", [0.3, 1.0, 3.0])
    def test_it_is_never_more_than_the_wire_loses_and_nears_it(self, parameters, begin_to_lose, share):
        loss_W_K = share * parameters.heat_loss
        found = self.shown_W_K(
            parameters, begin_to_lose, loss_W_K, 0.99 * loss_W_K * (self.MOST_C - self.COLD_C), 300.0
        )
        assert found[0] == 0.0
        assert max(found) <= loss_W_K
        assert found[-1] > 0.99 * loss_W_K - 0.2 * parameters.heat_loss

    def test_what_was_not_measured_was_not_lost(self, parameters, begin_to_lose):
        power_W = parameters.heat_loss * 140.0
        assert (
            self.shown_W_K(parameters, begin_to_lose, parameters.heat_loss, power_W, 100.0, unmeasured=0.5)[-1]
            < 0.5 * parameters.heat_loss
        )

    def test_a_wire_that_may_be_hotter_has_shown_less(self, parameters, begin_to_lose):
        shown = begin_to_lose()
        steady = [shown(0.5, 0.05, 100.0) for _ in range(4000)][-1]
        assert [shown(0.5, 0.05, 190.0) for _ in range(400)][-1] < 0.7 * steady

    @pytest.mark.parametrize("share", [0.15, 0.5, 1.0, 2.0])
    @pytest.mark.parametrize("period_s", [1.0, 7.0, 40.0])
    def test_it_is_never_more_than_the_wire_loses_whatever_the_power_does(
        self, parameters, begin_to_lose, share, period_s
    ):
        """In pulses of power; latent heat is taken from 60 to 80 °C, and given back."""
        shown, loss_W_K, capacity_J_K = begin_to_lose(), share * parameters.heat_loss, parameters.heat_capacity
        warm_K = [self.COLD_C, 60.0, 80.0, 300.0]
        held_K = [self.COLD_C, 60.0, 80.0 + LATENT_K, 300.0 + LATENT_K]
        enthalpy_K = self.COLD_C
        for step in range(6000):
            warm_C = np.interp(enthalpy_K, held_K, warm_K)
            on = step * self.DT_s % period_s < 0.5 * period_s and warm_C < 145.0
            power_W = 1.5 * loss_W_K * 141.0 * on
            enthalpy_K += (power_W - loss_W_K * (warm_C - self.COLD_C)) * self.DT_s / capacity_J_K
            most_K = max(warm_C, np.interp(enthalpy_K, held_K, warm_K), 60.0) - self.COLD_C
            assert shown(power_W, self.DT_s, most_K) <= loss_W_K * (1.0 + 1e-9), step

    def test_cold_for_an_hour_before_it_shows_what_it_loses_as_soon(self, parameters, begin_to_lose):
        rested, begun = begin_to_lose(), begin_to_lose()
        for _ in range(7200):
            rested(0.0, 0.5, 20.0)
        for _ in range(40):
            found = [each(parameters.heat_loss * 150.0, 1.0, 100.0) for each in (rested, begun)]
        assert found[0] == pytest.approx(found[1])
        assert found[0] > parameters.heat_loss

    def test_it_is_forgotten(self, parameters, begin_to_lose):
        shown, power_W = begin_to_lose(), parameters.heat_loss * 150.0
        for _ in range(100):
            shown(power_W, 1.0, 100.0)
        after = [shown(0.0, 1.0, 100.0) for _ in range(60)]
        assert after[0] > parameters.heat_loss
        assert after[-1] == 0.0

    @pytest.mark.parametrize("dt_s", [0.0, -1.0, math.nan, math.inf])
    def test_time_that_is_none_shows_nothing(self, parameters, begin_to_lose, dt_s):
        shown = begin_to_lose()
        before = [shown(parameters.heat_loss * 150.0, 1.0, 100.0) for _ in range(20)][-1]
        assert 0.9 * before < shown(1e6, dt_s, 100.0) <= before


class TestWhatAWireShowsCold:
    @pytest.fixture
    def look(self):
        """What is kept: what it shows cold, and the most since it had not contracted."""
        state = floats(SHOWN_COLD)
        begin_cold(state, 0)

        def once(shown_Ohm, times=0.01, rests=True, at_most_C=40.0, is_cold=False):
            keep_cold(state, 0, shown_Ohm, times, rests, is_cold, at_most_C, 150.0)
            return tuple(state[:2])

        return once

    def test_is_seen_when_it_has_rested_long_enough(self, look):
        assert look(5.0, COLD_TIMES - 0.1) == (math.inf, math.inf)
        assert look(5.2, 0.2) == (5.2, 5.2)
        assert look(5.3) == (5.3, 5.3), "martensite comes back for a while"

    def test_is_seen_at_once_where_it_shows_what_it_was_known_to_show_cold(self, look):
        assert look(5.0, is_cold=True) == (5.0, 5.0)
        look(4.5, rests=False)
        assert look(5.1, is_cold=True)[0] == 5.1

    def test_but_not_once_it_was_heated_before_that_was_known(self, look):
        """Another wire, 2 % thinner, shows as much contracted as the calibrated one cold; half the heat loss would have
        brought it to 239 °C."""
        look(5.2, rests=False)
        assert look(5.0, is_cold=True) == (math.inf, math.inf)

    def test_current_begins_it_anew(self, look):
        look(5.0, COLD_TIMES - 0.1)
        look(5.0, rests=False)
        assert look(5.0, COLD_TIMES - 0.1)[0] == math.inf

    def test_it_rests_with_the_output_off_too_and_is_seen_when_it_is_on(self, look):
        assert look(math.nan, COLD_TIMES)[0] == math.inf
        assert look(5.0)[0] == 5.0
        assert look(math.nan)[0] == 5.0

    @pytest.mark.parametrize("times", [math.nan, math.inf, -1.0])
    def test_a_time_that_is_none_is_no_rest(self, look, times):
        for _ in range(9):
            assert look(5.0, times)[0] == math.inf

    def test_the_most_counts_until_it_shows_less(self, look):
        look(5.0, COLD_TIMES)
        assert [look(each_Ohm, rests=False)[1] for each_Ohm in (5.1, 5.06, 5.2)] == [5.1, 5.1, 5.2]
        assert look(5.2 * (1.0 - FALLS) - 0.01, rests=False, at_most_C=160.0) == (5.0, math.inf)

    def test_then_as_much_as_cold_counts_again_no_hotter_than_it_transforms_at(self, look):
        look(5.0, COLD_TIMES)
        look(4.5, rests=False)
        assert look(5.0, rests=False, at_most_C=150.0)[1] == math.inf, "it may be hot austenite"
        assert look(4.9, rests=False, at_most_C=149.0)[1] == math.inf
        assert look(4.96, rests=False, at_most_C=149.0)[1] == 4.96


class TestAnotherWireInThePlaceOfTheCalibratedOne:
    """4.9 Ω is the most that the calibrated one shows contracted; this one contracts from 5.5 to 5.0 Ω."""

    @pytest.fixture
    def run(self, parameters):
        heat = WireHeat(parameters)

        def for_a_while(resistance_Ohm, power_W, seconds):
            for _ in range(round(seconds / 0.05)):
                heat.step(power_W, 0.05, math.nan, parameters, resistance_Ohm, 1.0, 4.9)
            return heat

        return for_a_while

    def test_counts_as_hot_where_it_has_not_been_seen_cold(self, run):
        """Hot and contracted, as another driver left it, it was taken to transform and heated on."""
        for warm_K in 176.0 * np.exp(-np.arange(0.0, 1.0, 0.05) / 5.5):  # what it is above its surroundings
            heat = run(5.0 * (1.0 + LEAST_SLOPE_1_K * warm_K), 0.0, 0.05)
        assert heat.at_most_C > 170.0
        heat = run(5.3, 1.0, 9.0)
        assert heat.at_most_C > 172.0
        assert heat.cools
        assert not run(5.2, 0.0, 6.0).cools

    def test_is_let_warm_at_the_beginning_before_it_is_seen_cold(self, run):
        assert not run(5.5, 0.0, 3.0).cools

    def test_that_the_limit_holds_back_is_let_cool_until_it_has_been_seen_cold_once(self, run):
        run(5.5, 0.0, 3.0)
        heat = run(5.8, 1.0, 2.0)
        heat.let_cool()
        assert run(5.5, 0.0, 6.0).cools
        assert heat.at_most_C < 100.0
        assert not run(5.5, 0.0, 20.0).cools
        assert run(5.8, 1.0, 20.0).at_most_C == pytest.approx(150.0, abs=0.5), "as much as cold: it transforms"
        heat.let_cool()
        assert not run(5.5, 0.0, 6.0).cools

    @pytest.mark.parametrize("astray", [False, True])
    def test_at_its_limit_is_let_cool_where_it_is_not_where_it_should_be(self, astray):
        """One that goes where it should, as on its way back, needs no more than the limit leaves."""
        state = floats(64)
        assert _cools(state, False, True, astray, 194.0, 90.0, 150.0, False, False, False, True, False) == astray
        assert _cools(state, True, True, astray, 194.0, 90.0, 150.0, False, False, False, True, False), (
            "it has begun to"
        )

    @pytest.mark.parametrize("shown", [False, True])
    def test_that_shows_what_it_is_known_to_show_cold_is_let_cool_to_where_it_returns(self, shown):
        """And any other to where it transforms: 110 °C lie between the two here."""
        state = floats(64)
        state[_COLD + COLD_Ohm] = math.inf
        assert _cools(state, True, False, True, 110.0, 90.0, 150.0, False, False, shown, True, False) == shown
        assert not _cools(state, True, False, True, 89.0, 90.0, 150.0, False, False, shown, True, False)

    @pytest.mark.parametrize("was_seen", [False, True])
    def test_nothing_is_told_of_one_before_it_is_seen_unless_it_is_cold_by_then(self, was_seen):
        """With its output off for a while it has cooled; what it shows cold has to be looked at all the same."""
        state = floats(64)
        state[_COLD + COLD_Ohm] = math.inf
        state[_COLD + RESTED_times] = COLD_TIMES - 0.1
        assert _cools(state, True, False, True, 89.0, 90.0, 150.0, False, False, False, was_seen, False) != was_seen
        state[_COLD + RESTED_times] = COLD_TIMES
        assert not _cools(state, True, False, True, 89.0, 90.0, 150.0, False, False, False, was_seen, False)

    def test_whose_resistance_stands_is_no_hotter_than_it_transforms_at_as_long_as_that_stands(self, run):
        """Austenite's would fall as it cools, and rise as it warms."""
        assert not run(5.5, 0.0, 1.0).cools
        assert run(5.5, 1.0, 20.0).at_most_C == pytest.approx(150.0, abs=0.5)

    def test_is_hot_where_it_shows_much_less_than_cold(self, run):
        run(5.5, 0.0, 30.0)
        run(5.0, 1.0, 5.0)
        assert run(5.1, 1.0, 5.0).at_most_C > 195.0

    def test_transforms_where_it_does_not(self, run):
        run(5.5, 0.0, 30.0)
        assert run(5.5, 1.0, 20.0).at_most_C == pytest.approx(150.0, abs=0.5)
        assert run(5.6, 1.0, 20.0).at_most_C == pytest.approx(150.0, abs=0.5)


class TestTheCalibratedWireItself:
    """It has shown 5.0 Ω cold, as it was known to; contracted it was known to show 4.0, or 4.4 where it is
    as hot as any transforms at."""

    @pytest.fixture
    def run(self, parameters):
        heat = WireHeat(parameters)
        heat.transforms = Transforms(CALIBRATION, parameters)

        def for_a_while(resistance_Ohm, power_W, seconds):
            for _ in range(round(seconds / 0.05)):
                heat.step(power_W, 0.05, math.nan, parameters, resistance_Ohm, 1.0, 4.6, 4.4, stress_Pa=1e8)
            return heat

        for_a_while(5.0, 0.0, 4.0)
        return for_a_while

    @pytest.mark.parametrize(("least_Ohm", "transforms"), [(4.03, True), (4.2, True), (4.7, False)])
    def test_transforms_where_it_shows_more_than_the_least_that_it_has_shown_can_become_by_heat(
        self, run, least_Ohm, transforms
    ):
        """4.9 Ω; after 4.7 it may be another wire that has contracted, and is hotter now."""
        run(least_Ohm, 1.0, 4.0)
        assert (run(4.9, 1.0, 20.0).at_most_C < 151.0) == transforms

    def test_that_the_limit_holds_back_is_let_cool_until_its_resistance_tells(self, run):
        run(4.7, 1.0, 20.0).let_cool()
        assert run(4.8, 0.0, 6.0).cools, "it may yet be hot austenite"
        assert not run(5.0, 0.0, 6.0).cools

    def test_one_that_was_not_seen_for_a_while_may_be_another(self, run):
        run(4.03, 1.0, 4.0)
        run(math.nan, 0.0, 1.5)
        run(4.03, 1.0, 4.0)
        assert run(4.9, 1.0, 20.0).at_most_C > 151.0
        run(math.nan, 0.0, 30.0)
        run(5.0, 1.0, 0.05)
        run(4.03, 1.0, 4.0)
        assert run(4.9, 1.0, 20.0).at_most_C < 151.0, "cold for certain, and as resistant as it was known to be"

    def test_nor_is_it_told_by_its_first_reading(self, run):
        run(4.03, 1.0, 4.0)
        assert run(4.3, 1.0, 6.0).at_most_C > 190.0
        run(math.nan, 0.0, 1.1)
        assert run(4.9, 0.0, 0.05).at_most_C > 151.0

    def test_and_no_longer_than_that(self, run):
        run(4.0, 0.0, 4.0)
        run(4.2, 1.0, 20.0).let_cool()
        assert not run(4.8, 0.0, 1.0).cools


@pytest.mark.parametrize("max_C", [150.0, 140.0])
def test_a_wire_may_be_kept_colder_than_any_transforms_at(parameters, max_C):
    """Where numba is not installed nothing may be divided by zero."""
    state = WireHeat(parameters)._state
    as_plain_python = getattr(_transforms_Ohm, "py_func", _transforms_Ohm)
    assert (
        as_plain_python(state, 150.0, 150.0, max_C, 4.4, 4.4, 5.0, floats(0), 1e8) == math.inf
    )  # nor was it seen cold


@pytest.mark.parametrize("shift_K_Pa", [3e-7, 12e-7], ids=["", "heavy"])
@pytest.mark.parametrize("off_s", [0.0, 2.0, 10.0])
def test_a_wire_is_seen_cold_before_it_is_heated_however_long_it_was_off(parameters, off_s, shift_K_Pa):
    """After two seconds it is no hotter than any transforms at, after ten no hotter than this one returns at; under a
    load that has it return above 150 °C too."""
    heat = WireHeat(parameters)
    power = replace(CALIBRATION.power, transformation_cooling=(70.0, 60.0), transformation_shift=(shift_K_Pa, 1e-7))
    heat.transforms = Transforms(replace(CALIBRATION, power=power), parameters)
    cold_Ohm = CALIBRATION.rest.cold_resistance[0]

    def step(resistance_Ohm):
        heat.step(
            0.0, 0.05, math.nan, parameters, resistance_Ohm, 1.0, 5.0, 4.6, stress_Pa=CALIBRATION.rest.cold_stress[0]
        )

    for _ in range(round(off_s / 0.05)):
        step(math.nan)
    seconds = 0.0
    while heat.cools:
        step(cold_Ohm)
        seconds += 0.05
    assert heat._state[_COLD + COLD_Ohm] == pytest.approx(cold_Ohm)
    assert seconds < 3.0


class TestOwnThermometer:
    """What was identified of a wire says how hot it is while it transforms; its heat balance has to agree."""

    LOSES_W_K = 0.005

    def warm(self, parameters, power_W, transforms_C, seconds=20.0, resistance=lambda _: 4.5):
        heat = WireHeat(parameters)
        if math.isfinite(transforms_C):
            heated_C = 20.0 + (transforms_C - 20.0) / CAPACITY_WITHIN
            power = replace(
                CALIBRATION.power, transformation_heating=(heated_C, heated_C), transformation_shift=(0.0, 0.0)
            )
            heat.transforms = Transforms(replace(CALIBRATION, power=power), parameters)
        heat.step(0.0, 60.0, math.nan, parameters)
        for step in range(round(seconds / 0.05)):
            shown_Ohm = resistance(0.05 * step)
            heat.step(power_W, 0.05, math.nan, parameters, shown_Ohm, 1.0, stress_Pa=1e8)
        return heat

    def test_it_is_no_hotter_than_where_it_transforms(self, parameters):
        heat = self.warm(parameters, self.LOSES_W_K * 80.0, 110.0)
        assert heat.at_most_C == pytest.approx(110.0, abs=0.1)
        assert heat.power_limit_W(1.05, parameters) > 1.3 * self.warm(
            parameters, self.LOSES_W_K * 80.0, math.inf
        ).power_limit_W(1.05, parameters)

    def test_where_the_balance_calls_it_hotter_the_balance_counts(self, parameters):
        assert self.warm(parameters, self.LOSES_W_K * 100.0, 60.0).at_most_C == pytest.approx(124.0, abs=0.5)
        assert self.warm(parameters, self.LOSES_W_K * 160.0, 60.0).at_most_C == pytest.approx(150.0, abs=0.5)

    def test_it_is_never_taken_for_hotter_than_any_wire_transforms_at(self, parameters):
        assert self.warm(parameters, self.LOSES_W_K * 100.0, 170.0).at_most_C == pytest.approx(150.0, abs=0.1)

    def test_what_it_shows_more_than_the_least_counts_as_heat_beyond(self, parameters):
        rising = self.warm(
            parameters, self.LOSES_W_K * 80.0, 110.0, 40.0, lambda s: 4.5 * (1.0 + LEAST_SLOPE_1_K * max(s - 20.0, 0.0))
        )
        assert rising.at_most_C == pytest.approx(130.0, abs=0.5)


def test_a_wire_that_shows_what_it_loses_is_left_more_power_and_no_more_than_is_safe(parameters):
    heat, limits_W = WireHeat(parameters), []
    heat.step(0.0, 60.0, math.nan, parameters)
    for _ in range(2000):
        heat.step(0.6, 0.05, math.nan, parameters, 4.5, 1.0, wire_W=0.6)
        limits_W.append(heat.power_limit_W(1.05, parameters))
    assert heat.at_most_C == pytest.approx(150.0, abs=0.5)
    assert limits_W[-1] > 1.15 * limits_W[100]
    # With all that it has shown to lose but a tenth, from where it can be at most.
    wire = HeatBalance(150.0)
    assert wire.step(limits_W[-1], 1.05, 9.0, 0.01, 0.9 * 0.6 / 141.0) < parameters.max_temperature


@pytest.mark.parametrize("loses", [0.5, 1.0, 2.0])
def test_a_quick_wire_that_has_not_contracted_is_let_warmer_until_it_would_be_too_hot(parameters, loses):
    """Looked at once in many time constants, whatever it loses; by its margin it would stay at 52 to 138 °C."""
    heat, wire, loss_W_K = WireHeat(parameters), HeatBalance(24.0), loses * parameters.heat_loss
    heat.step(0.0, 60.0, math.nan, parameters)
    for _ in range(8000):
        power_W = heat.power_limit_W(60.0, parameters)
        warm_C = wire.step(power_W, 0.05, 24.0, parameters.heat_capacity, loss_W_K)
        # It transforms up to 120 °C, and above that its resistance rises as little as any.
        shown_Ohm = 4.5 * (1.0 + LEAST_SLOPE_1_K * max(warm_C - 120.0, 0.0))
        heat.step(power_W, 0.05, math.nan, parameters, shown_Ohm, 1.0, wire_W=power_W)
    assert 120.0 < warm_C < 150.0


def test_of_a_load_that_turns_all_the_time_no_loss_is_shown(parameters):
    """What resistance does with the load is no heat; in noise heat would hide."""
    limits_W = []
    for noise in (0.01, 0.2):
        heat = WireHeat(parameters)
        heat.step(0.0, 60.0, math.nan, parameters)
        for step in range(4000):
            load_N = 1.0 + noise * (-1) ** step
            heat.step(0.6, 0.05, math.nan, parameters, 4.5, load_N, wire_W=0.6)
        limits_W.append(heat.power_limit_W(60.0, parameters))
    by_margin_W = (195.0 - 24.0) * parameters.heat_loss / parameters.heat_loss_margin
    assert limits_W[0] > 1.5 * by_margin_W
    assert limits_W[1] == pytest.approx(by_margin_W, rel=1e-3)


def test_a_weight_that_swings_for_a_moment_is_no_noise(parameters):
    heat = WireHeat(parameters)
    heat.step(0.0, 60.0, math.nan, parameters)
    for step in range(4000):
        load_N = 2.0 + (0.3 * math.cos(math.pi * (step - 3900) / 20.0) if 3900 <= step < 3920 else 0.0)
        heat.step(0.6, 0.05, math.nan, parameters, 4.5, load_N, wire_W=0.6)
    assert heat.power_limit_W(60.0, parameters) > 1.5 * (195.0 - 24.0) * 0.005 / 3.0


def test_a_wire_that_loses_more_than_the_parameters_say_is_not_derated_for_a_hot_one(parameters):
    """It transforms still, by its resistance, with power that the parameters' heat loss takes for 224 °C."""
    heat = WireHeat(parameters)
    heat.step(0.0, 60.0, math.nan, parameters)
    for _ in range(2000):
        heat.step(1.0, 0.05, math.nan, parameters, 4.5, 1.0, wire_W=1.0)
    assert heat.temperature_C == pytest.approx(150.0, abs=0.5)
    for _ in range(2000):  # without a word of its resistance it is as hot as the balance says
        heat.step(1.0, 0.05, math.nan, parameters)
    assert heat.temperature_C == pytest.approx(parameters.ambient_temperature + 200.0, abs=0.5)


def test_at_its_limit_and_without_a_word_of_its_resistance_a_wire_is_let_cool_until_it_transforms(parameters):
    heat = WireHeat(parameters)
    assert heat.cools
    assert heat.power_limit_W(1.0, parameters) == 0.0
    heat.step(0.0, 0.05, math.nan, parameters, 5.0)
    seconds = 0.0
    while heat.cools:
        heat.step(0.0, 0.05, math.nan, parameters)
        seconds += 0.05
    assert heat.at_most_C == pytest.approx(parameters.transformed_temperature, abs=2.0)
    assert seconds < 2.5
    while not heat.cools:  # no resistance is measured
        heat.step(heat.power_limit_W(1.05, parameters), 0.05, math.nan, parameters)
        assert heat.at_most_C < 195.0
    assert heat.at_most_C > 193.0


class TestTheMarginOfAWireThatHasNotContracted:
    """Parameters with 6, as `init` writes them of a wire in a draught; 4.55 Ω is what it would show contracted."""

    @pytest.fixture
    def held(self, parameters):
        parameters = replace(parameters, heat_loss_margin=6.0)

        def run(resistance_Ohm, power_W, just_Ohm=4.55):
            heat = WireHeat(parameters)
            heat.step(0.0, 60.0, math.nan, parameters)
            for _ in range(2000):
                heat.step(power_W, 0.05, math.nan, parameters, resistance_Ohm, 1.0, just_contracted_Ohm=just_Ohm)
            return heat, heat.power_limit_W(60.0, parameters)

        return run

    @pytest.mark.parametrize(("resistance_Ohm", "margin"), [(4.6, NOT_CONTRACTED_MARGIN), (4.5, 6.0)])
    def test_is_for_no_fan_that_may_stop(self, held, parameters, resistance_Ohm, margin):
        heat, limit_W = held(resistance_Ohm, 0.05)
        assert heat.at_most_C == pytest.approx(parameters.ambient_temperature + 0.05 * margin / 0.005, abs=0.1)
        assert limit_W == pytest.approx(0.005 / margin * (195.0 - parameters.ambient_temperature), rel=0.01)

    def test_is_what_is_left_of_half_the_loss_that_is_known_within_a_quarter(self):
        assert NOT_CONTRACTED_MARGIN == 2.0 * CAPACITY_WITHIN

    def test_is_no_more_than_the_parameters_say(self, parameters):
        parameters = replace(parameters, heat_loss_margin=1.5)
        heat = WireHeat(parameters)
        heat.step(0.0, 60.0, math.nan, parameters)
        for _ in range(2000):
            heat.step(0.05, 0.05, math.nan, parameters, 4.6, 1.0, just_contracted_Ohm=4.55)
        assert heat.at_most_C == pytest.approx(parameters.ambient_temperature + 0.05 * 1.5 / 0.005, abs=0.1)
