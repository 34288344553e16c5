"""What counts as an end of the way, and that it is tried again."""

import math
from dataclasses import replace

import pytest

from sma_actuator.base.balance import Balance
from sma_actuator.base.calibration import Calibration, HotEndSection, PowerSection, RestSection
from sma_actuator.safety.guards.setpoints import no_motion
from sma_actuator.safety.limits import SETPOINT_REACH
from sma_actuator.safety.reach import BACK_OFF, BEYOND_K, Needed, Places, Reach

STROKE_m, TAU_s, STEP_s = 4e-3, 2.0, 0.05
FULL_W = 0.8
#: Half contracted, at 0.45 W; 0.05 W more are too much.
HALF_WAY = Needed(0.5, 0.45, 0.05, 0.3)
#: The same of one that takes all the current there is.
ALL_OF_IT = Needed(0.5, 0.8, 0.05, 0.3)


class Wire:
    """A wire that stands where it is put, and a `Reach` that looks at it."""

    def __init__(self, position_m=2e-3, tau_s=TAU_s):
        self.reach = Reach(STROKE_m, Balance(tau_s))
        self.now_s, self.position_m, self.load_N = 0.0, position_m, 1.0

    def run(self, seconds, wanted_m=1e-3, power_W=FULL_W, at_max=True, at_limit=True, heat=HALF_WAY):
        for _ in range(round(seconds / STEP_s)):
            self.now_s += STEP_s
            self.reach.step(self.now_s, self.position_m, wanted_m, at_max, at_limit, power_W, self.load_N, heat)
        return self.reach.floor_m

    def never_ends(self, seconds, **more):
        """There is no end at any instant of so many seconds, and none that was tried again since."""
        return all(self.run(STEP_s, **more) == -math.inf for _ in range(round(seconds / STEP_s)))

    def ended(self, **more):
        """Run until there is an end; the time that took."""
        start_s = self.now_s
        while self.run(STEP_s, **more) == -math.inf:
            assert self.now_s - start_s < 60.0
        return self.now_s - start_s


def test_full_current_in_a_wire_that_is_warm_from_it_and_stands_is_an_end():
    wire = Wire()
    wire.run(10.0, wanted_m=3e-3)
    assert wire.ended() == pytest.approx(0.8, abs=0.11)
    assert wire.reach.floor_m == pytest.approx(wire.position_m + BACK_OFF * STROKE_m)


@pytest.mark.parametrize("heat", [ALL_OF_IT, None])
def test_a_setpoint_that_is_as_near_as_it_is_wanted_is_not_out_of_reach(heat):
    """A wire that takes all the current to be held 0.9 % of the stroke from it, and one that stands 1.1 % from it."""
    near = Wire()
    assert near.never_ends(60.0, wanted_m=near.position_m - 0.009 * STROKE_m, heat=heat)
    assert near.ended(wanted_m=near.position_m - 0.011 * STROKE_m, heat=heat) < 2.0


@pytest.mark.parametrize(("away", "from_s"), [(0.06, 0.0), (-0.06, 0.0), (0.03, 2.0 * TAU_s), (0.009, math.inf)])
def test_a_wire_is_astray_that_is_far_from_its_setpoint_or_not_there_for_a_while(away, from_s):
    """As shares of the stroke: 5 % are far, and within one it is there."""
    wire = Wire()
    wire.run(1.0, wanted_m=wire.position_m, at_limit=False)
    assert not wire.reach.astray
    before_s = wire.now_s
    while wire.now_s - before_s < 20.0 and not wire.reach.astray:
        wire.run(STEP_s, wanted_m=wire.position_m - away * STROKE_m, at_max=False, at_limit=False)
    astray_s = wire.now_s - before_s if wire.reach.astray else math.inf
    assert astray_s == pytest.approx(from_s, abs=2.0 * STEP_s)


def test_but_it_is_where_the_wire_is_much_hotter_than_it_need_be_there():
    near = Wire()
    near.run(10.0, wanted_m=near.position_m)
    assert near.ended(wanted_m=near.position_m - 0.009 * STROKE_m) == pytest.approx(0.8, abs=0.11)


@pytest.mark.parametrize("heat", [HALF_WAY, None])
def test_a_limit_that_was_lowered_is_not_all_the_current_there_is(heat):
    """Right after enabling little current is left, and the wire stands: for as long as it likes."""
    assert Wire().run(600.0, power_W=0.4, at_max=False, heat=heat) == -math.inf


def test_unless_the_wire_is_hotter_than_a_heating_one_is_there():
    wire = Wire()
    wire.run(10.0, wanted_m=3e-3, power_W=0.55, at_max=False, at_limit=False)
    assert wire.ended(power_W=0.55, at_max=False) == pytest.approx(0.8, abs=0.11)


def test_that_heat_counts_again_once_the_wire_has_long_stood_where_it_is():
    wire = Wire()
    wire.run(20.0, wanted_m=3e-3, power_W=0.1, at_limit=False, heat=HALF_WAY._replace(share=1.0))
    wire.run(20.0, wanted_m=3e-3, power_W=0.55, at_limit=False)
    assert wire.ended(power_W=0.55, at_max=False) == pytest.approx(0.8, abs=0.11)


def test_a_wire_that_only_warms_up_is_not_at_its_end():
    """Nine tenths of what its power makes it: after ln 10 of its time constants, and so long it may stand then."""
    assert Wire().ended(heat=None) == pytest.approx(TAU_s * math.log(10.0) + 0.8, abs=0.11)


def test_a_slow_wire_may_stand_for_three_tenths_of_its_time_constant():
    wire = Wire(tau_s=10.0)
    wire.run(60.0, wanted_m=3e-3)
    assert wire.ended() == pytest.approx(3.0, abs=0.11)


def test_one_that_backed_off_in_vain_need_not_become_warm_once_more():
    """It cooled meanwhile; full current and no motion are known to be an end."""
    wire = at_its_end()
    assert wire.reach.tries == 1
    wire.run(8.5, power_W=0.1, at_max=False, at_limit=False)  # it does not come to where it was backed off to
    assert wire.reach.floor_m == -math.inf and wire.reach.tries == 1
    assert wire.ended(heat=None) == pytest.approx(0.8, abs=0.11)
    assert wire.reach.tries == 2


def test_what_was_in_vain_is_forgotten_once_the_wire_has_been_for_a_while_where_it_was_backed_off_to():
    wire = at_its_end()
    wire.position_m = wire.reach.floor_m
    wire.run(0.7, **BACKED_OFF)
    assert wire.reach.tries == 1, "it may only be passing"
    wire.run(0.2, **BACKED_OFF)
    assert wire.reach.tries == 0


def test_one_that_leaves_that_place_meanwhile_has_only_passed_it():
    wire = at_its_end()
    for _ in range(3):
        wire.position_m = wire.reach.floor_m
        wire.run(0.7, **BACKED_OFF)
        wire.position_m = wire.reach.floor_m + 0.02 * STROKE_m
        wire.run(0.2, **BACKED_OFF)
    assert wire.reach.tries == 1


def test_to_be_where_the_limits_let_it_be_is_not_to_be_where_it_was_wanted():
    wire = at_its_end()
    wire.position_m = wire.reach.floor_m
    wire.run(2.0, power_W=0.4, at_max=False, at_limit=True)
    assert wire.reach.tries == 1


def test_five_times_in_vain_are_a_fault_and_ten_kelvin_too_many_as_the_page_says():
    assert no_motion.look(4) == "" and no_motion.look(5)
    assert "10 K hotter" in SETPOINT_REACH.detector


def test_the_heat_that_the_transformation_takes_does_not_count():
    """Fast through half of the stroke, and then held where it came to by a limit: the balance calls it too hot for a
    while."""
    wire = Wire()
    wire.run(20.0, wanted_m=3e-3, power_W=0.1, at_limit=False, heat=HALF_WAY._replace(share=1.0))
    wire.run(2.0, wanted_m=3e-3, at_limit=False)
    assert wire.never_ends(30.0, power_W=0.45, at_max=False)
    wire = Wire()
    wire.run(20.0, wanted_m=3e-3, power_W=0.1, at_limit=False)
    wire.run(2.0, wanted_m=3e-3, at_limit=False)
    assert wire.run(2.0, power_W=0.5, at_max=False) > -math.inf, "of a wire that stood there all the time it would"


def test_a_wire_that_comes_nearer_is_not_at_its_end():
    wire = Wire(3.9e-3)
    for _ in range(50):
        wire.position_m -= 0.012 * STROKE_m
        assert wire.run(0.7) == -math.inf


def at_its_end(asked_m=1e-3):
    wire = Wire()
    wire.run(10.0, wanted_m=3e-3)
    wire.ended(wanted_m=asked_m)
    return wire


BACKED_OFF = {"power_W": 0.4, "at_max": False, "at_limit": False}


def test_a_new_setpoint_is_tried_at_once():
    wire = at_its_end()
    wire.position_m = wire.reach.floor_m
    wire.run(1.0, **BACKED_OFF)
    assert wire.run(STEP_s, wanted_m=1.1e-3, **BACKED_OFF) == -math.inf


def test_the_same_is_tried_again_after_a_while_that_doubles_in_vain():
    wire = at_its_end()
    waits_s = []
    for _ in range(6):
        end_s = wire.now_s
        while wire.reach.floor_m > -math.inf:
            wire.position_m = wire.reach.floor_m
            wire.run(STEP_s, **BACKED_OFF)
        waits_s.append(wire.now_s - end_s)
        wire.position_m = 2e-3
        wire.run(10.0, power_W=FULL_W, at_max=False, at_limit=False)
        wire.ended()
    assert waits_s == pytest.approx([times * TAU_s for times in (4, 8, 16, 32, 32, 32)], abs=0.11)
    assert wire.reach.tries == 1, "it came to where it was backed off to each time"


def test_a_stream_of_setpoints_does_not_keep_a_wire_that_seems_to_grow_at_full_current():
    """Each is new, and each is tried; but in between it is backed off for as long as a try lasts."""
    wire, backed_off = at_its_end(), 0
    for k in range(400):
        off = wire.reach.floor_m > -math.inf
        backed_off += off
        wire.position_m += 1e-6
        wire.run(STEP_s, wanted_m=1e-3 + 1e-4 * (k % 2), at_max=not off, at_limit=not off)
    assert 0.4 < backed_off / 400 < 0.6


def test_a_tenth_more_or_less_is_the_same_load():
    for load_N, same in ((2.15, True), (1.85, True), (2.25, False), (1.75, False)):
        wire = Wire()
        wire.load_N = 2.0
        wire.run(10.0, wanted_m=3e-3)
        wire.ended()
        wire.load_N = load_N
        assert (wire.run(STEP_s, **BACKED_OFF) > -math.inf) == same


def test_another_load_or_a_longer_setpoint_is_another_matter():
    for load_N, wanted_m in ((1.2, 1e-3), (0.8, 1e-3), (1.0, 3e-3)):
        wire = at_its_end()
        wire.load_N = load_N
        assert wire.run(STEP_s, wanted_m=wanted_m, **BACKED_OFF) == -math.inf


def test_what_heats_the_leads_is_no_heat_of_the_wire(make_rig, monkeypatch):
    """The calibration says what heat the wire takes, by the power in the wire alone."""
    seen = []
    monkeypatch.setattr(Reach, "step", lambda self, *args, power_W, **more: seen.append(power_W))
    rig = make_rig()
    rig.enable()
    for _ in range(40):
        rig.actuator.offer_setpoint(rig.now_s, 2e-3)
        rig.step()
    signals, lead_Ohm = rig.output.signals, rig.config.circuit.lead_resistance
    assert seen[-1] == pytest.approx(signals.power_W, rel=1e-6)
    assert seen[-1] < 0.96 * signals.current_A**2 * (signals.resistance_Ohm + lead_Ohm)


def test_a_wire_in_a_tube_that_is_still_warming_up_is_at_no_end():
    """After eight seconds of power a bare wire is as warm as it gets; in a tube of 64 % it is not for eighteen."""
    bare, sleeved = Wire(), Wire()
    sleeved.reach = Reach(STROKE_m, Balance(TAU_s, near_share=0.64, near_s=2.0 * TAU_s))
    assert bare.run(8.0, heat=None) > -math.inf
    assert sleeved.run(8.0, heat=None) == -math.inf
    assert sleeved.run(30.0, heat=None) > -math.inf


def test_a_clock_that_goes_back_makes_no_wire_warmer_or_colder():
    wire = Wire()
    wire.run(1.0)
    held_W = wire.reach._held_W
    wire.now_s -= 0.5
    wire.run(STEP_s)
    assert wire.reach._held_W == held_W


class TestPlaces:
    @pytest.fixture
    def calibration(self):
        return Calibration(
            rest=RestSection(cold_stress=(1e8, 2e8), cold_displacement=(4e-3, 5e-3)),
            hot_end=HotEndSection(contracted_stress=(1e8, 2e8), contracted_displacement=(0.0, 2e-3)),
            power=PowerSection(
                transformation_heating=(80.0, 70.0, 60.0),
                transformation_cooling=(50.0, 45.0, 40.0),
                transformation_shift=(3e-7, 1e-7),
                latent_rise=20.0,
            ),
        )

    @pytest.mark.parametrize(
        ("position_m", "stress_Pa", "share", "heating_C"),
        # A twentieth of the full stroke is 0.2 mm: of 4, 3.5, 3 and 4 mm at that load, and 20 K are the whole.
        [
            (1e-3, 1e8, 0.25, 85.0 + 20.0 * 0.2 / 4.0),
            (2.75e-3, 1.5e8, 0.5, 85.0 + 20.0 * 0.2 / 3.5),
            (5e-3, 2e8, 1.0, 80.0 + 20.0 * 0.2 / 3.0),
            (5e-3, 1e8, 1.25, 70.0),
        ],
    )
    def test_say_what_heat_a_heating_wire_takes_to_be_clearly_further(
        self, calibration, position_m, stress_Pa, share, heating_C
    ):
        needed = Places(calibration, STROKE_m).needed(position_m, math.nan, stress_Pa, 25.0, 0.01)
        assert needed == pytest.approx((share, 0.01 * (heating_C - 25.0), 0.01 * BEYOND_K, 0.2))

    def test_a_place_that_is_not_known_well_wants_more(self, calibration):
        sure, unsure = (Places(calibration, STROKE_m).needed(3e-3, each_m, 1e8, 25.0, 0.01) for each_m in (1e-5, 2e-3))
        assert sure.there_W == pytest.approx(0.01 * (76.0 - 25.0))
        assert unsure.there_W == pytest.approx(0.01 * (85.0 - 25.0))

    def test_a_wire_that_an_intermediate_phase_has_moved_by_a_little_need_not_be_further(self, calibration):
        power = replace(calibration.power, transformation_heating=(110.0, *(105.0,) * 19, 60.0))
        needed = Places(replace(calibration, power=power), STROKE_m).needed(4e-3, 1e-5, 1e8, 25.0, 0.01)
        assert needed.there_W == pytest.approx(0.01 * (115.0 - 25.0))

    def test_say_nothing_without_temperatures_or_ends(self, calibration):
        for other in (Calibration(), replace(calibration, power=PowerSection())):
            assert Places(other, STROKE_m).needed(1e-3, 1e-5, 1e8, 25.0, 0.01) is None


LITTLE = {"power_W": 0.4, "at_max": False}


class TestHeldBack:
    """A wire that stands far from its setpoint with all that the heat limit leaves, and has not what it needs."""

    def test_is_said_after_two_of_its_time_constants(self):
        wire = Wire()
        wire.run(2.0 * TAU_s - 0.1, **LITTLE)
        assert not wire.reach.held_back
        wire.run(0.2, **LITTLE)
        assert wire.reach.held_back
        assert wire.reach.floor_m == -math.inf, "this is no end"
        wire.reach.forget()
        assert not wire.reach.held_back, "with another load or start it is seen anew"

    @pytest.mark.parametrize(
        "otherwise",
        [
            {"at_limit": False},
            {"wanted_m": 2e-3 - 0.04 * STROKE_m},
            {"heat": HALF_WAY._replace(there_W=0.2)},
            {"heat": None},
        ],
        ids=["more may flow", "it is as near as that", "it has what it needs", "nobody knows what it needs"],
    )
    def test_is_not_said_of_one(self, otherwise):
        wire = Wire()
        for _ in range(200):
            wire.run(STEP_s, **{**LITTLE, **otherwise})
            assert not wire.reach.held_back

    def test_nor_of_one_that_moves(self):
        wire = Wire(position_m=3e-3)
        for _ in range(200):
            wire.position_m -= 1e-5
            wire.run(STEP_s, **LITTLE)
            assert not wire.reach.held_back
