"""Landing: a wire that is heated to a setpoint that has jumped gets the heat that it takes there, and no more."""

import dataclasses
import math

import pytest
from rig import Rig

from sma_actuator.base.share import shared_file
from sma_actuator.base.signals import Branch, Estimate, Quality, Signals
from sma_actuator.config import Config, read_parameter_file
from sma_actuator.control.heat import GIVEN_PERIODS, LANDED_K, Landing, SEEN_s
from sma_actuator.control.pid import LandingPid, PidController
from sma_actuator.plant.loads import Weight

#: The Ni-Ti wire of the bench, as `identify` finds it.
TRANSFORMATION = {
    "transformation_heating": [63.9, 62.6, 61.4, 60.5, 59.6, 58.7, 57.8, 56.9, 55.9, 54.8, 53.6],
    "transformation_cooling": [39.1, 35.5, 34.1, 33.6, 33.2, 32.7, 32.1, 31.6, 31.0, 30.1, 29.1],
    "transformation_shift": [1.14e-7, 1.2e-7],
    "latent_rise": 25.9,
}
DT_s, LONG_m, SHORT_m = 0.05, 0.003, 0.0015


def mapping(law="pid"):
    found = read_parameter_file(shared_file("config/flexinol.yaml"))
    of_law = {**found["controller"], "type": law}
    return {**found, "controller": of_law, "calibration": {**found["calibration"], "power": TRANSFORMATION}}


@pytest.fixture(scope="module")
def config():
    return Config.from_mapping(mapping())


@pytest.fixture
def landing(config):
    """Of a wire that rests at the longer place, cool."""
    found = Landing(config)
    sensed(found, 0.0, 0.02)
    found.begin(LONG_m)
    found.limit_A(LONG_m, LONG_m, DT_s)
    return found


def sensed(landing, time_s, power_W, position_m=LONG_m):
    landing.heat.sense(
        Signals(time_s, 4.8, 0.2, power_W, 0.98, 53.7e6, math.nan, 24.0),
        Estimate(time_s, position_m, 0.02, 0.0, Branch.HEATING, Quality.DETERMINATE),
    )


def lacks_K(landing):
    """The heat that the shorter place takes, as a rise of temperature."""
    heat = landing.heat
    share = heat.share_at(SHORT_m)
    return landing.wanted.temperature_C(share, heat.stress_Pa) - heat.latent_K * share - heat.content_C


def test_a_wire_that_is_heated_far_gets_what_it_lacks_over_its_next_period_and_a_half(config, landing):
    limit_A = landing.limit_A(LONG_m, SHORT_m, DT_s)
    heat, thermal = landing.heat, config.thermal
    power_W = thermal.heat_capacity * lacks_K(landing) / (GIVEN_PERIODS * DT_s)
    power_W += thermal.heat_loss * (heat.temperature_C - 24.0)
    assert limit_A == pytest.approx(math.sqrt(power_W / 4.8))
    assert limit_A > 2.0 * config.supply.max_current


def test_what_holds_a_wire_in_a_tube_becomes_less_as_the_tube_warms_up(config):
    """At first it loses its heat to a cool tube, and 2.5 times as much of it; in the end as in the open."""
    thermal = dataclasses.replace(config.thermal, near_share=0.6, near_time=4.0)
    landing = Landing(dataclasses.replace(config, thermal=thermal))
    sensed(landing, 0.0, 0.0)
    heat, needed_W = landing.heat, thermal.heat_loss * (60.0 - 24.0)
    assert heat.resistance_Ohm * heat.holds_A(60.0) ** 2 == pytest.approx(needed_W / (1.0 - 0.6))
    for i in range(1, 1200):
        sensed(landing, i * DT_s, heat.resistance_Ohm * heat.holds_A(60.0) ** 2)
    assert heat.temperature_C == pytest.approx(60.0, abs=0.1)
    assert heat.resistance_Ohm * heat.holds_A(60.0) ** 2 == pytest.approx(needed_W, rel=0.01)


@pytest.mark.parametrize("power_W", [1.0, 3.0])
def test_it_lands_by_its_heat_wherever_it_seems_to_be_and_then_is_free(config, landing, power_W):
    limit_A, time_s = landing.limit_A(LONG_m, SHORT_m, DT_s), 0.0
    while not landing.landed:
        time_s += DT_s
        assert time_s < 10.0
        sensed(landing, time_s, min(power_W, 4.8 * limit_A**2))
        limit_A = landing.limit_A(LONG_m, SHORT_m, DT_s)
    assert lacks_K(landing) == pytest.approx(0.0, abs=LANDED_K)
    there_C = landing.wanted.temperature_C(landing.heat.share_at(SHORT_m), 53.7e6)
    holds_A = math.sqrt(config.thermal.heat_loss * (there_C - 24.0) / 4.8)
    assert limit_A == pytest.approx(holds_A, rel=0.2)
    assert landing.holds_A == pytest.approx(holds_A)
    landed_s = 0.0
    while math.isfinite(landing.limit_A(LONG_m, SHORT_m, DT_s)):
        landed_s += DT_s
    assert landed_s == pytest.approx(SEEN_s - DT_s, abs=DT_s)
    assert not landing.landed
    assert landing.limit_A(LONG_m, SHORT_m, DT_s) == math.inf


def test_nothing_else_is_bounded(config, landing):
    for position_m, setpoint_m in (
        (LONG_m, LONG_m - 1e-4),  # no jump
        (LONG_m - 1e-4, SHORT_m + 1.3e-3),  # nearly there
        (SHORT_m, LONG_m + 5e-4),  # it cools
        (SHORT_m, LONG_m),
    ):
        assert landing.limit_A(position_m, setpoint_m, DT_s) == math.inf
    unknown = Landing(config)
    unknown.begin(LONG_m)
    assert unknown.limit_A(LONG_m, SHORT_m, DT_s) == math.inf
    assert not unknown.landed


@pytest.mark.parametrize("law", ["pid", "feed_forward_pid"])
def test_surroundings_are_believed_by_the_parameters_of_now(law):
    config = Config.from_mapping(mapping(law))
    built = config.controller.build(config)
    heat = built.heat if law == "feed_forward_pid" else built._landing.heat
    for tolerance_K, ambient_C in ((5.0, 24.0), (20.0, 34.0)):
        built.update(config.replace({"thermal.ambient_temperature": 24.0, "thermal.ambient_tolerance": tolerance_K}))
        built.sense(
            Signals(0.0, 4.8, 0.2, 0.2, 0.98, 53.7e6, math.nan, 34.0),
            Estimate(0.0, LONG_m, 0.02, 0.0, Branch.HEATING, Quality.DETERMINATE),
        )
        assert heat.ambient_C == ambient_C


def test_another_jump_is_another_way(landing):
    assert landing.limit_A(LONG_m, SHORT_m, DT_s) < math.inf
    assert landing.limit_A(LONG_m, LONG_m + 2e-4, DT_s) == math.inf
    assert landing.limit_A(LONG_m, SHORT_m, DT_s) < math.inf


def test_only_a_wire_whose_transformation_is_known_lands(config):
    assert isinstance(config.controller.build(config), LandingPid)
    bare = read_parameter_file(shared_file("config/flexinol.yaml"))
    bare["calibration"].pop("power", None)
    config = Config.from_mapping(bare)
    assert type(config.controller.build(config)) is PidController


@pytest.mark.parametrize("arguments", [(math.nan, SHORT_m, DT_s), (LONG_m, math.nan, DT_s), (LONG_m, SHORT_m, 0.0)])
def test_what_is_no_number_changes_nothing(config, arguments):
    law = config.controller.build(config)
    law.reset(LONG_m, 0.2)
    law.step(*arguments, 0.4)
    assert law.reference_m == LONG_m
    assert law.step(LONG_m, LONG_m, DT_s, 0.4) == pytest.approx(0.2)


#: From where to where.  The first way begins where the wire has cooled to, or where it was held hot.
COOLED, HOT = ((0.0030, 0.0016), (0.0028, 0.0016)), ((0.0030, 0.0020), (0.0028, 0.0016))


@pytest.mark.parametrize(
    ("law", "ways", "most", "of_the_other"),
    [
        ("pid", COOLED, 0.015, 1.0),
        ("feed_forward_pid", COOLED, 0.06, 0.65),
        ("pid", HOT, 0.08, 1.0),
        ("feed_forward_pid", HOT, 0.08, 1.0),
    ],
)
def test_it_goes_less_far_beyond_a_step_than_one_that_waits_until_it_sees_itself_arrive(
    law, ways, most, of_the_other, monkeypatch
):
    """By the bench's truth, share of the way; from the extended wire to where half of its stroke is left, and on.

    A PID that sees the wire without delay arrives as well by itself.
    """
    beyond = []
    for free in (False, True):
        if free:
            monkeypatch.setattr(Landing, "limit_A", lambda *_: math.inf)
        rig = Rig(mapping(law), load=Weight(0.98))
        rig.run(6.0)
        rig.enable()
        found = 0.0
        if ways is COOLED:
            rig.actuator.offer_setpoint(rig.now_s, 0.0020)
            rig.run(15.0)
        for from_m, to_m in ways:
            rig.actuator.offer_setpoint(rig.now_s, from_m)
            rig.run(20.0)
            rig.actuator.offer_setpoint(rig.now_s, to_m)
            for _ in range(60):
                rig.step()
                found = max(found, (to_m - rig.bench.truth.displacement_m) / (from_m - to_m))
        beyond.append(found)
    assert beyond[0] < most and beyond[0] <= of_the_other * beyond[1], beyond
