"""A channel that stands still is told from one that is alive by what it has shown; one that is alive is never accused."""

import math

import numpy as np
import pytest

from sma_actuator.plant.loads import Spring, Weight
from sma_actuator.safety.alive import SEEN, WINDOW, WINDOWS, Following, Liveliness, Repeats

LSB_V, SAMPLES = 20.0 / 2**16, 50


def block_V(rng, volts, noise_V):
    """One reading of a converter: the mean of a block of quantised samples."""
    return float(np.mean(np.round((volts + rng.normal(0.0, noise_V, SAMPLES)) / LSB_V) * LSB_V))


class TestRepeats:
    @pytest.mark.parametrize("share", [0.0, 0.05, 0.3, 0.9])
    def test_a_channel_that_repeats_as_often_as_ever_is_alive(self, share):
        rng, repeats, value = np.random.default_rng(1), Repeats(), 0.0
        for _ in range(20_000):
            value = value if rng.random() < share else rng.normal()
            assert not repeats.step(value)

    @pytest.mark.parametrize(("share", "within"), [(0.0, 10), (0.05, 20), (0.3, 100)])
    def test_one_that_stands_is_found_the_sooner_the_more_seldom_it_has_repeated(self, share, within):
        rng, repeats, value = np.random.default_rng(1), Repeats(), 0.0
        for _ in range(2 * SEEN):
            value = value if rng.random() < share else rng.normal()
            repeats.step(value)
        assert any(repeats.step(value) for _ in range(within))

    def test_a_few_values_in_turn_are_found_too(self):
        rng, repeats = np.random.default_rng(1), Repeats()
        for _ in range(2 * SEEN):
            repeats.step(block_V(rng, 0.08, 2e-4))
        assert any(repeats.step(0.08 + LSB_V * rng.integers(-1, 2)) for _ in range(200))

    def test_nothing_is_said_before_enough_was_seen(self):
        repeats = Repeats()
        assert not any(repeats.step(1.0) for _ in range(SEEN))


def noise_shares(values):
    live = Liveliness()
    return [share for value in values if not math.isnan(share := live.step(value))]


class TestLiveliness:
    @pytest.mark.parametrize("seed", range(5))
    def test_noise_that_goes_on_is_noise(self, seed):
        rng = np.random.default_rng(seed)
        assert min(noise_shares(rng.normal(0.0, 1.0, 20_000))) > 0.5

    def test_neither_is_motion_that_ends_less_noise(self):
        """On a spring: moved from the first reading on, then held."""
        rng = np.random.default_rng(1)
        moved = np.sin(0.1 * np.arange(3000)) * 100.0
        held = np.full(3000, moved[-1])
        assert min(noise_shares(np.concatenate([moved, held]) + rng.normal(0.0, 1.0, 6000))) > 0.5

    def test_nor_is_noise_that_was_louder_most_of_the_time(self):
        """A joint: of four windows in which the load seemed to stand three had the other wire's motion in them."""
        rng, live = np.random.default_rng(1), Liveliness()
        louder = np.repeat([1.0, 2.5, 3.0, 2.5, 1.0], WINDOW)
        assert (
            min(
                share
                for value in louder * rng.normal(0.0, 1.0, len(louder))
                if not math.isnan(share := live.step(value))
            )
            > 0.5
        )

    @pytest.mark.parametrize("noise_V", [0.0, 5e-5])
    def test_what_is_left_of_a_dead_channel_is_less(self, noise_V):
        rng, live = np.random.default_rng(1), Liveliness()
        for _ in range((WINDOWS + 1) * WINDOW):
            live.step(block_V(rng, 0.08, 2e-4))
        dead = [0.08 + rng.uniform(-0.5, 0.5, SAMPLES).mean() * LSB_V if noise_V else 0.08 for _ in range(2 * WINDOW)]
        assert min(live.step(value) for value in dead) < 0.5


def follow(following, places_m, loads_N):
    return [words for pair in zip(places_m, loads_N, strict=True) if (words := following.step(*pair, 1e-3, 0.03))]


class TestFollowing:
    PLACES_m = 2e-3 + 1.5e-3 * np.sin(np.arange(0.0, 50.0, 0.05))

    def test_a_spring_s_load_that_stands_is_found_within_a_cycle(self):
        following = Following()
        assert follow(following, self.PLACES_m, 2.0 - 400.0 * self.PLACES_m) == []
        cycle = self.PLACES_m[: round(1.75 * math.tau / 0.05)]
        assert follow(following, cycle, np.full(len(cycle), 1.2))

    @pytest.mark.parametrize("stiffness_N_m", [0.0, 10.0, 150.0, 1000.0])
    def test_a_load_that_goes_on_as_it_has_is_alive(self, stiffness_N_m):
        rng = np.random.default_rng(1)
        loads_N = 2.0 - stiffness_N_m * (self.PLACES_m - 2e-3) + rng.normal(0.0, 5e-3, len(self.PLACES_m))
        assert follow(Following(), self.PLACES_m, loads_N) == []

    def test_a_spring_that_becomes_slack_is_no_dead_load_cell(self):
        following = Following()
        follow(following, self.PLACES_m, 2.0 - 400.0 * self.PLACES_m)
        assert follow(following, self.PLACES_m, np.zeros(len(self.PLACES_m))) == []

    def test_a_load_that_changes_the_other_way_is_alive(self):
        """A joint: the other wire pulls."""
        following = Following()
        follow(following, self.PLACES_m, 2.0 - 400.0 * self.PLACES_m)
        assert follow(following, self.PLACES_m, 0.4 + 300.0 * self.PLACES_m) == []

    def test_a_place_that_is_not_known_begins_a_motion_anew(self):
        following = Following()
        places_m = np.where(np.arange(len(self.PLACES_m)) % 20, self.PLACES_m, np.nan)
        assert follow(following, places_m, 2.0 - 400.0 * self.PLACES_m) == []


@pytest.mark.parametrize("load", [Weight(0.98), Spring(400.0, 0.6)], ids=str)
def test_a_load_cell_that_stands_with_its_converter_s_dither_is_not_believed(make_rig, load):
    """What is shown stands; the load itself grows beyond wire.max_stress meanwhile."""
    rig = make_rig(**{"safety.load_spike": 10.0})
    rig.bench.load = load
    rig.enable()
    _move(rig, 40.0)
    assert rig.status.fault == "", rig.status
    rng, last = np.random.default_rng(1), rig.daq.read_block().load_cell_voltage_V
    rig.reading_of = lambda r: type(r)(
        r.time_s,
        r.supply_voltage_V,
        r.reference_voltage_V,
        last + rng.uniform(-0.5, 0.5, SAMPLES).mean() * LSB_V,
        r.lvdt_current_A,
        r.ambient_temperature_C,
    )
    _move(rig, 20.0)
    assert rig.status.fault == "load_dead", rig.status


def _move(rig, seconds):
    end_s = rig.bench.time_s + seconds
    while rig.bench.time_s < end_s and not rig.status.fault:
        rig.actuator.offer_setpoint(rig.now_s, 2.2e-3 + 1.2e-3 * math.sin(0.7 * rig.bench.time_s))
        rig.run(0.2)
