"""What counts as an end of the way, and that it is tried again."""

import math

import pytest

from sma_actuator.safety.reach import BACK_OFF, FIRST_AGAIN_TIMES, LAST_AGAIN_TIMES, Needed, Reach

STROKE_m, TAU_s, STEP_s = 4e-3, 2.0, 0.05
FULL_W = 0.8
#: Half contracted, at 0.45 W; 0.05 W more are too much.
HALF_WAY = Needed(0.5, 0.45, 0.05, 0.3)


class Wire:
    """A wire that stands where it is put, and a `Reach` that looks at it."""

    def __init__(self, position_m=2e-3):
        self.reach = Reach(STROKE_m, TAU_s)
        self.now_s, self.position_m, self.load_N = 0.0, position_m, 1.0

    def run(self, seconds, wanted_m=1e-3, power_W=FULL_W, at_max=True, at_limit=True, heat=HALF_WAY):
        for _ in range(round(seconds / STEP_s)):
            self.now_s += STEP_s
            self.reach.step(self.now_s, self.position_m, wanted_m, at_max, at_limit, power_W, self.load_N, heat)
        return self.reach.floor_m

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


@pytest.mark.parametrize("heat", [HALF_WAY, None])
def test_a_limit_that_was_lowered_is_not_all_the_current_there_is(heat):
    """Right after enabling little current is left, and the wire stands: for as long as it likes."""
    assert Wire().run(600.0, power_W=0.4, at_max=False, heat=heat) == -math.inf


def test_unless_the_wire_is_hotter_than_a_heating_one_is_there():
    wire = Wire()
    wire.run(10.0, wanted_m=3e-3, power_W=0.55, at_max=False, at_limit=False)
    assert wire.ended(power_W=0.55, at_max=False) == pytest.approx(0.8, abs=0.11)


def test_a_wire_that_only_warms_up_is_not_at_its_end():
    assert Wire().run(2.0, heat=None) == -math.inf


def test_the_heat_that_the_transformation_takes_does_not_count():
    """Fast through half of the stroke, and then held where it came to by a limit: the balance calls it too hot for a while."""
    wire = Wire()
    wire.run(20.0, wanted_m=3e-3, power_W=0.1, at_limit=False, heat=HALF_WAY._replace(share=1.0))
    wire.run(2.0, wanted_m=3e-3, at_limit=False)
    assert wire.run(30.0, power_W=0.45, at_max=False) == -math.inf
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
    doubled = [min(FIRST_AGAIN_TIMES * 2.0**k, LAST_AGAIN_TIMES) * TAU_s for k in range(6)]
    assert waits_s == pytest.approx(doubled, abs=0.11)
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


def test_another_load_or_a_longer_setpoint_is_another_matter():
    for load_N, wanted_m in ((1.2, 1e-3), (0.8, 1e-3), (1.0, 3e-3)):
        wire = at_its_end()
        wire.load_N = load_N
        assert wire.run(STEP_s, wanted_m=wanted_m, **BACKED_OFF) == -math.inf
