"""A channel that stands still is told from one that is alive by what it has shown; one that is alive is never
accused."""

import math

import numpy as np
import pytest

from sma_actuator.plant.loads import Spring, Weight
from sma_actuator.safety.alive import LATELY, SEEN, WINDOW, WINDOWS, Following, Leaps, Liveliness, LoadAlive, Repeats
from sma_actuator.safety.faults import FAULTS

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

    @pytest.mark.parametrize("changes_at", [190, 200, 300])
    @pytest.mark.parametrize("every", [(0, 1), (10, 1), (7, 2), (3, 1), (2, 2)])
    def test_by_its_definition(self, every, changes_at):
        """A repetition is no chance once the sum of what each reading says, against what was usual in 200 or more
        before it, is beyond a millionth of a millionth: of a channel that repeats every so many readings at first, and
        more often then."""
        before, after = every
        equal = [bool(before) and number % before == 0 for number in range(1, changes_at)]
        equal += [number % after == 0 for number in range(3000)]
        values = np.cumsum(~np.array([False, *equal]))
        repeats = Repeats()
        said = [repeats.step(float(value)) for value in values]
        same = np.array([False, *equal])
        usual = (np.cumsum(same) - same + 1.0) / (np.arange(len(same)) + 2.0)
        if_stands = usual + 0.3 * (1.0 - usual)
        says = np.where(same, np.log(if_stands / usual), np.log((1.0 - if_stands) / (1.0 - usual)))
        total, expected = 0.0, []
        for number, each in enumerate(says):
            total = max(total + each, 0.0) if number >= 200 else 0.0
            expected.append(total > 12.0 * math.log(10.0))
        assert said == expected
        assert any(said) == (before != after)

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

    def test_nor_is_a_load_that_creeps_and_then_stands(self):
        """Held on a spring; it is known how noisy it is nevertheless."""
        rng = np.random.default_rng(1)
        creeping = np.concatenate([2.0 * np.sin(0.05 * np.arange(1000)), np.zeros(1000)])
        shares = noise_shares(creeping + rng.normal(0.0, 1.0, 2000))
        assert len(shares) > 1500
        assert min(shares) > 0.5

    def test_by_its_definition(self):
        """The mean second difference of the last hundred, against the least of earlier hundreds in which nothing moved
        what the channel measures, and it no more than five times that."""
        rng = np.random.default_rng(2)
        quiet, loud = rng.normal(0.0, 1.0, (2, 700))
        first = np.repeat([0.3, 0.5], [100, 200]) * quiet[:300]
        at_the_bound = 0.1 * quiet + np.cumsum(np.linspace(0.02, 0.01, 700))  # 75 readings' way: 7.5 to 4 times
        loud, quiet_again, quieter = 3.0 * loud, 0.2 * quiet, 0.05 * quiet
        stands, leaps = np.full(250, first[-1]), [50.0]
        moved = np.concatenate(
            [first, stands, leaps, quiet, np.linspace(0.0, 900.0, 300), loud, quiet_again, at_the_bound, quieter]
        )
        rests = np.arange(len(moved)) % 470 != 230
        levels, counted, since, rested = [], [], 0, 0
        for end in range(1, len(moved) + 1):
            since += 1
            rested = rested + 1 if rests[end - 1] else 0
            if end < 100:
                continue
            last = moved[end - 100 : end]
            level = np.abs(np.diff(last, 2)).mean()
            earlier = counted[:-1]
            levels.append(level / min(earlier) if len(earlier) >= 2 else math.nan)
            quarters = last.reshape(4, 25).mean(axis=1)
            if min(since, rested) >= 100 and level > 0.0 and np.ptp(quarters) <= 5.0 * level:
                counted.append(level)
                since = 0
        live = Liveliness()
        said = [live.step(float(value), rest) for value, rest in zip(moved, rests, strict=True)][99:]
        assert len(counted) > 8
        assert said == pytest.approx(levels, nan_ok=True, abs=1e-9)

    @pytest.mark.parametrize("noise_V", [0.0, 5e-5])
    def test_what_is_left_of_a_dead_channel_is_less(self, noise_V):
        rng, live = np.random.default_rng(1), Liveliness()
        for _ in range((WINDOWS + 1) * WINDOW):
            live.step(block_V(rng, 0.08, 2e-4))
        dead = [0.08 + rng.uniform(-0.5, 0.5, SAMPLES).mean() * LSB_V if noise_V else 0.08 for _ in range(2 * WINDOW)]
        assert min(live.step(value) for value in dead) < 0.5


def follow(following, places_m, loads_N):
    return [words for pair in zip(places_m, loads_N, strict=True) if (words := following.step(*pair, 1e-3, 0.03))]


class TestNoiseOfALoadThatMovesWithTheCurrent:
    """Held restlessly on a spring; what the channel has by itself is seen while the command stands."""

    def driven(self, *parts):
        """Shares in parts of so many readings, with so much noise of its own and five times that while it is held."""
        alive, rng = LoadAlive(), np.random.default_rng(1)
        return [
            [
                alive.quiet(
                    noise * rng.normal() + (5.0 * rng.normal() if held else 0.0), 0.2 + 0.01 * held * rng.random()
                )
                for _ in range(number)
            ]
            for number, noise, held in parts
        ]

    @pytest.mark.parametrize("before", [0, 600], ids=["enabled at once", "after a while"])
    def test_a_wire_that_comes_to_rest_is_no_dead_load_cell(self, before):
        parts = self.driven((before, 1.0, False), (1000, 1.0, True), (1000, 1.0, False), (1000, 1.0, True))
        assert not any(share < 0.5 for part in parts for share in part)

    @pytest.mark.parametrize("held", [True, False], ids=["held", "at rest"])
    def test_one_that_dies_is(self, held):
        alive, rng = LoadAlive(), np.random.default_rng(1)
        rest = [alive.quiet(rng.normal(), 0.05) for _ in range(600)]
        dead = [alive.quiet(0.3 * rng.normal(), 0.2 + 0.01 * held * rng.random()) for _ in range(WINDOW + 10)]
        assert not any(share < 0.5 for share in rest) and any(share < 0.5 for share in dead)

    def test_a_weight_is_moved_by_no_current(self):
        alive, rng = LoadAlive(), np.random.default_rng(1)
        for place_m in np.linspace(4e-3, 2.5e-3, 40):  # it contracts, once
            alive.following.step(place_m, 1.0 + 1e-3 * rng.normal(), 1.2e-3, 0.03)
            alive.quiet(rng.normal(), rng.random())
            assert alive.following.carries == (place_m <= 2.8e-3)
        well = [alive.quiet(rng.normal(), rng.random()) for _ in range(600)]
        dead = [alive.quiet(0.3 * rng.normal(), rng.random()) for _ in range(WINDOW + 10)]
        assert not any(share < 0.5 for share in well) and any(share < 0.5 for share in dead)


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


class Swung:
    """A wire that is moved to and fro by 1.2 mm, where 1 mm counts as a motion and 0.03 N as noise."""

    def __init__(self, way_m=1.2e-3):
        self.following, self.at_m, self.load_N, self.way_m = Following(), 0.0, 2.0, way_m

    def to(self, place_m, stiffness_N_m, pieces=12):
        """Go there under such a spring; what is said on the way."""
        said, from_m, from_N = "", self.at_m, self.load_N
        for piece in range(1, pieces + 1):
            self.at_m = from_m + (place_m - from_m) * piece / pieces
            self.load_N = from_N + stiffness_N_m * (self.at_m - from_m)
            said = self.step() or said
        return said

    def step(self):
        return self.following.step(self.at_m, self.load_N, 1e-3, 0.03)

    def swing(self, *stiffness_N_m):
        """Once to or fro for each of these, and back by as much as shows that it has turned; what is said last."""
        said = ""
        for each in stiffness_N_m:
            self.step()
            said = self.to(self.at_m + self.way_m, each)
            self.way_m = -self.way_m
            said = self.to(self.at_m + 0.3e-3 * math.copysign(1.0, self.way_m), each) or said
            self.at_m -= 0.3e-3 * math.copysign(1.0, self.way_m)
            self.load_N -= each * 0.3e-3 * math.copysign(1.0, self.way_m)
        return said


class TestWhatALoadDoes:
    def test_three_motions_show_it_and_no_fewer(self):
        wire = Swung()
        wire.swing(-300.0, -300.0)
        assert math.isnan(wire.following.stiffness_N_m)
        wire.swing(-300.0)
        assert wire.following.stiffness_N_m == pytest.approx(-300.0)

    @pytest.mark.parametrize(
        ("shown", "known"),
        [
            ((-26.0, -26.0, -26.0), -26.0),  # however soft
            ((-24.0, 24.0, 0.5), 0.0),  # what is within the noise is none: a weight's
            ((26.0, 26.0, 26.0), math.nan),  # one that grows with the length is no spring
            ((-300.0, -300.0, -500.0), -300.0),  # alike within a factor of two
            ((-300.0, -300.0, -650.0), math.nan),
            ((-200.0, -300.0, -300.0, -300.0), -300.0),  # the last three count
        ],
    )
    def test_it_is_the_least_of_three_that_are_alike(self, shown, known):
        wire = Swung()
        wire.swing(*shown)
        assert wire.following.stiffness_N_m == pytest.approx(known, nan_ok=True)

    def test_a_quarter_of_a_motion_back_is_no_turn(self):
        wire = Swung()
        wire.step()
        for to_m in (1.2e-3, 0.0) * 2:
            on = math.copysign(1.0, to_m - wire.at_m)
            for share_m in (0.5e-3, 0.3e-3, 0.9e-3, 0.7e-3):
                wire.to((0.0 if on > 0.0 else 1.2e-3) + on * share_m, -300.0, 1)
            wire.to(to_m, -300.0, 1)
        assert wire.following.stiffness_N_m == pytest.approx(-300.0)

    def test_the_load_is_the_one_to_which_it_has_come_at_the_turn(self):
        """A load cell is slower than the wire: it stands there, and its load comes."""
        wire = Swung()
        for _ in range(4):
            wire.to(wire.way_m if wire.at_m == 0.0 else 0.0, -200.0)
            wire.load_N -= 100.0 * math.copysign(1.2e-3, wire.at_m - 0.5e-3)
            wire.step()
        assert wire.following.stiffness_N_m == pytest.approx(-300.0)

    def test_the_second_motion_that_it_does_not_follow_is_told(self):
        wire = Swung()
        wire.swing(-300.0, -300.0, -300.0)
        assert wire.swing(0.0) == ""
        sentence = (
            "-0 N where +0.36 N belong to a motion of -1.2 mm and -0 N where -0.36 N belong to a motion of +1.2 mm"
        )
        assert wire.swing(0.0).replace("+0 N where", "-0 N where") in (
            sentence,
            " and ".join(reversed(sentence.split(" and "))),
        )

    @pytest.mark.parametrize(("stiffness_N_m", "told"), [(-65.0, True), (-40.0, False)])
    def test_a_change_of_less_than_twice_the_noise_cannot_be_missed(self, stiffness_N_m, told):
        wire = Swung()
        wire.swing(*[stiffness_N_m] * 3)
        assert bool(wire.swing(0.0, 0.0)) == told
        assert (wire.following.stiffness_N_m == pytest.approx(stiffness_N_m)) == told, "else it is what is usual now"

    def test_one_that_follows_less_than_half_is_neither_dead_nor_what_is_usual(self):
        wire = Swung()
        wire.swing(-300.0, -300.0, -300.0)
        assert wire.swing(0.0, -100.0, 0.0) == "", "it was alive in between"
        assert wire.swing(-100.0, -100.0) == ""
        assert wire.following.stiffness_N_m == pytest.approx(-300.0)

    def test_one_that_follows_more_than_half_is_what_is_usual(self):
        wire = Swung()
        wire.swing(-300.0, -300.0, -300.0, -200.0)
        assert wire.following.stiffness_N_m == pytest.approx(-200.0)
        assert wire.swing(0.0, -200.0, 0.0) == "", "it was alive in between"

    @pytest.mark.parametrize("pieces", [1, 15])
    def test_a_load_that_changes_by_itself_is_another(self, pieces):
        wire = Swung()
        wire.swing(-300.0, -300.0, -300.0)
        wire.to(wire.at_m + 0.5 * wire.way_m, -300.0)
        for _ in range(pieces):
            wire.load_N += 0.5 / pieces
            wire.step()
        assert math.isnan(wire.following.stiffness_N_m)
        assert wire.swing(0.0, 0.0, 0.0, 0.0) == ""

    def test_what_another_does_is_seen_at_once_however_quickly_it_is_moved(self):
        wire = Swung()
        wire.swing(-300.0, -300.0, -300.0)
        wire.load_N += 2.0
        wire.step()
        for number in range(1, 5):
            wire.to(number % 2 * wire.way_m, -200.0, 3)
        assert wire.following.stiffness_N_m == pytest.approx(-200.0)

    def test_a_motion_in_which_it_became_another_shows_nothing_of_it(self):
        wire = Swung()
        wire.swing(-300.0, -300.0, -300.0)
        wire.step()
        wire.to(wire.at_m + 0.5 * wire.way_m, -300.0)
        wire.load_N -= math.copysign(1.0, wire.way_m)
        wire.to(wire.at_m + 0.5 * wire.way_m, -1000.0)
        wire.way_m = -wire.way_m
        wire.swing(-1000.0, -1000.0)
        assert math.isnan(wire.following.stiffness_N_m)
        wire.swing(-1000.0)
        assert wire.following.stiffness_N_m == pytest.approx(-1000.0)

    def test_it_is_another_too_before_its_law_is_known(self):
        """A weight that takes a spring's place where the wire turns would be one more motion of the spring's."""
        wire = Swung()
        wire.swing(-300.0, -300.0)
        wire.to(wire.at_m + wire.way_m, -300.0)
        for _ in range(LATELY):
            wire.step()
        wire.load_N -= math.copysign(0.15, wire.way_m)
        assert wire.swing(0.0, 0.0, 0.0, 0.0) == ""

    def test_it_is_another_too_where_the_wire_had_no_place_meanwhile(self):
        wire = Swung()
        wire.swing(-300.0, -300.0, -300.0)
        wire.step()
        wire.load_N += 0.5
        wire.following.step(math.nan, wire.load_N, 1e-3, 0.03)
        assert wire.swing(0.0, 0.0, 0.0, 0.0) == ""

    @pytest.mark.parametrize("share", [0.1, 0.5, 0.99])
    def test_one_that_dies_on_the_way_is_found(self, share):
        wire = Swung()
        wire.swing(-300.0, -300.0, -300.0)
        wire.to(wire.at_m + share * wire.way_m, -300.0)
        assert any(wire.swing(0.0) for _ in range(4))

    def test_what_happened_while_the_wire_had_no_place_is_no_motion(self):
        wire = Swung()
        wire.swing(-300.0, -300.0)
        for _ in range(2):
            wire.following.step(math.nan, 2.0, 1e-3, 0.03)
            wire.at_m, wire.load_N = wire.at_m + 1.2e-3, wire.load_N - 0.36
            wire.to(wire.at_m - 0.3e-3, -300.0)
        assert math.isnan(wire.following.stiffness_N_m)


def leap(leaps, load_N=1.0, place_m=1e-3, usual_m=1e-5, before_m=0.0):
    """A wire that goes on by ``before_m`` a reading, but for what is usual, and leaps there under that load; whether
    both have leapt."""
    for number in range(2 * LATELY):
        leaps.step(0.5, number * before_m + 0.5 * usual_m * (number % 2), 0.03)
    leaps.step(load_N, (2 * LATELY - 1) * before_m + 0.5 * usual_m + place_m, 0.03)
    return leaps.together


class TestLeaps:
    @pytest.mark.parametrize("side", [1.0, -1.0])
    def test_another_load_takes_the_wire_along(self, side):
        assert leap(Leaps(), 0.5 + 0.1 * side, 1e-4 * side)
        assert not leap(Leaps(), 0.5 + 0.1 * side, -1e-4 * side), "it stretches a wire, and lets it go"

    @pytest.mark.parametrize(("change_N", "leapt"), [(0.02, False), (0.04, True)])
    def test_a_change_within_the_noise_is_none(self, change_N, leapt):
        assert leap(Leaps(), 0.5 + change_N, 1e-3) == leapt

    @pytest.mark.parametrize("before_m", [0.0, 4e-5, -4e-5])
    @pytest.mark.parametrize(("beyond_m", "leapt"), [(0.9e-5, False), (1.1e-5, True)])
    def test_it_is_more_than_its_motion_has_lately_changed(self, before_m, beyond_m, leapt):
        """To and fro by 5 µm: from one reading to the next it changes by 10 µm."""
        assert leap(Leaps(), 1.0, before_m + 0.5e-5 + beyond_m, before_m=before_m) == leapt

    def test_what_was_longer_ago_says_nothing(self):
        leaps = Leaps()
        leaps.step(0.5, 0.0, 0.03)
        leaps.step(0.5, 1.0, 0.03)
        leaps.step(0.5, 1.0, 0.03)
        assert leap(leaps)

    def test_of_one_reading_nothing_is_known(self):
        leaps = Leaps()
        for place_m in (0.0, 0.0, 1e-3):
            leaps.step(0.5 + 100.0 * place_m, place_m, 0.03)
            assert not leaps.together
        assert not Leaps().together

    def test_a_sensor_that_is_away_for_a_moment_is_known_as_it_was(self):
        leaps = Leaps()
        leap(leaps, 0.5, 0.0)
        leaps.step(0.5, math.nan, 0.03)
        for load_N, place_m in ((0.5, 0.0), (0.5, 0.0), (1.0, 1e-3)):
            assert not leaps.together
            leaps.step(load_N, place_m, 0.03)
        assert leaps.together

    def test_without_one_nothing_leaps(self):
        assert not leap(Leaps(), 1.0, math.nan)


class TestWhatIsSuspect:
    """A load that changes by itself while the displacement sensor bears the position out, until three motions have
    shown what it does."""

    @pytest.fixture
    def wire(self):
        wire, self.alive = Swung(), LoadAlive()
        self.alive.following = wire.following
        wire.swing(-300.0, -300.0, -300.0)
        assert not self.alive.is_suspect(False)
        return wire

    def change(self, wire):
        wire.load_N += 2.0
        wire.step()

    def test_it_is_until_its_law_is_known(self, wire):
        self.change(wire)
        assert self.alive.is_suspect(False)
        wire.swing(-200.0, -200.0)
        assert self.alive.is_suspect(True)
        wire.swing(-200.0, -200.0)
        assert not self.alive.is_suspect(True)

    def test_not_one_that_another_wire_pulls_on(self):
        """No three motions of it were alike, so nobody knows what would be a change."""
        wire, alive = Swung(), LoadAlive()
        alive.following = wire.following
        wire.swing(-300.0, -100.0, -300.0, -100.0)
        self.change(wire)
        assert not alive.is_suspect(False)

    @pytest.mark.parametrize(("before", "now", "suspect"), [(False, True, True), (True, False, False)])
    def test_not_where_the_sensor_contradicted_before(self, wire, before, now, suspect):
        self.alive.is_suspect(before)
        self.change(wire)
        assert self.alive.is_suspect(now) == suspect

    @pytest.mark.parametrize(
        ("stiffness_N_m", "suspect"), [(300.0, True), (40.0, True), (20.0, False), (-100.0, False)]
    )
    def test_one_that_turns_round_has_changed(self, wire, stiffness_N_m, suspect):
        wire.step()
        wire.to(wire.at_m + wire.way_m, stiffness_N_m)
        wire.to(wire.at_m - 0.3 * wire.way_m, stiffness_N_m, 1)
        assert self.alive.is_suspect(False) == suspect

    @pytest.mark.parametrize("ago", [0, LATELY - 1, LATELY])
    def test_not_where_the_displacement_has_lately_leapt_with_it(self, wire, ago):
        leap(self.alive.leaps)
        for _ in range(ago):
            self.alive.leaps.step(1.0, 0.0, 0.03)
        self.change(wire)
        assert self.alive.is_suspect(False) == (ago == LATELY)

    def test_what_was_seen_of_it_once_is_not_seen_again(self, wire):
        self.change(wire)
        assert wire.following.changed
        wire.step()
        assert not wire.following.changed


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


@pytest.mark.parametrize("hang_s", [0.0, 0.6], ids=["at once", "by hand"])
def test_a_weight_that_takes_a_spring_s_place_is_another_load(make_rig, hang_s):
    rig = make_rig(**{"safety.load_spike": 10.0})
    rig.bench.load = Spring(150.0, 0.7)
    rig.enable()
    _move(rig, 40.0)
    for share in np.linspace(1.0, 0.0, 7):
        rig.bench.load = Spring(share * 150.0, 1.2 - share * 0.5) if share else Weight(1.2)
        rig.run(hang_s / 6.0)
    _move(rig, 25.0)
    assert rig.status.fault == "", rig.status


def test_a_motion_is_three_tenths_of_the_stroke_as_the_page_says():
    assert "by 30 % of the full stroke or more with less than 10 %" in FAULTS["load_dead"].detector


def _move(rig, seconds):
    end_s = rig.bench.time_s + seconds
    while rig.bench.time_s < end_s and not rig.status.fault:
        rig.actuator.offer_setpoint(rig.now_s, 2.2e-3 + 1.2e-3 * math.sin(0.7 * rig.bench.time_s))
        rig.run(0.2)
