"""Grains that cross their barriers by heat: closed forms of one, and how all of them lag and creep."""

import numpy as np
import pytest

from sma_actuator.plant.kinetics import (
    ACTIVATED,
    COOLING,
    FIRST_GRAIN,
    GRAINS,
    HEATING,
    MEASURED,
    Activated,
    Shift,
    crossed,
    new_memory,
    outer,
)
from sma_actuator.plant.measured import measured_between


class TestGrainsThatCrossTheirBarriersByHeat:
    """:class:`Activated`: a temperature that moves is followed late, one that stands is followed on and on."""

    WIDE = measured_between(50.0, 80.0, 60.0, 20.0, 8e6)

    def ramp(self, rate_K_s, per_K=0.6, crossing_s=1e-6, step_s=1e-3):
        """Temperatures of a heated wire, and what is martensite there."""
        bands = Activated(self.WIDE, per_K=per_K, attempts_1_s=1.0, crossing_s=crossing_s).bands()
        grains = new_memory(1.0, ACTIVATED)
        temperature_C = np.arange(0.0, 140.0, rate_K_s * step_s)
        return temperature_C, np.array([crossed(bands, grains, t, 0.0, Shift(0.0, 0.0), step_s) for t in temperature_C])

    def half_C(self, *args, **kwargs):
        temperature_C, martensite = self.ramp(*args, **kwargs)
        return np.interp(0.5, martensite[::-1], temperature_C[::-1])

    def test_without_heat_it_is_the_distribution_of_its_barriers(self):
        temperature_C, martensite = self.ramp(20.0, per_K=0.01)
        slow = np.empty_like(temperature_C)
        outer(MEASURED, self.WIDE.bands(), HEATING, temperature_C, 0.0, slow)
        assert np.abs(martensite - slow).max() < 0.03  # half of the largest grain and more

    def test_ten_times_the_rate_is_later_by_the_logarithm(self):
        assert self.half_C(50.0) - self.half_C(5.0) == pytest.approx(0.6 * np.log(10.0), rel=0.05)

    def test_and_by_most_of_the_way_that_is_heated_while_a_grain_is_crossed(self):
        """Not by all of it: so slow a front begins below the temperature at which one without it would go."""
        assert 2.5 < self.half_C(50.0, crossing_s=0.1) - self.half_C(50.0) < 5.0

    def test_one_grain_goes_as_its_closed_form(self):
        bands = Activated(self.WIDE, per_K=2.0, attempts_1_s=3.0, crossing_s=0.05).bands()
        heated_C, cooled_C = self.WIDE.quantiles_C(0.5)
        grains = new_memory(1.0, ACTIVATED)
        i = int(np.argmin(np.abs(bands[HEATING, FIRST_GRAIN : FIRST_GRAIN + GRAINS] - heated_C)))
        barriers = bands[:, FIRST_GRAIN + i]
        at_C = barriers[HEATING] + 1.0
        back, there = (1.0 / (np.exp(beyond_K / 2.0) / 3.0 + 0.05) for beyond_K in (at_C - barriers[COOLING], -1.0))
        rest = back / (back + there)
        for k in range(1, 6):
            crossed(bands, grains, at_C, 0.0, Shift(0.0, 0.0), 0.1)
            assert grains[i] == pytest.approx(rest + (1.0 - rest) * np.exp(-0.1 * k * (back + there)), rel=1e-12)
        assert abs(heated_C - barriers[HEATING]) < 1.0 and abs(cooled_C - barriers[COOLING]) < 1.0

    def test_where_it_is_held_it_creeps_on_with_the_logarithm_of_time(self):
        """After a time t what has a barrier up to per · (ln t + 0.577) above the wire has crossed it in the mean."""
        bands = Activated(self.WIDE, per_K=0.6, attempts_1_s=1.0, crossing_s=0.15).bands()
        grains = new_memory(1.0, ACTIVATED)
        left = [crossed(bands, grains, 60.0, 0.0, Shift(0.0, 0.0), 0.05) for _ in range(20_000)]
        after_s = np.array([10.0, 100.0, 1000.0])
        reached_C = 60.0 + 0.6 * (np.log(after_s) + np.euler_gamma)
        wanted = np.empty(3)
        outer(MEASURED, self.WIDE.bands(), HEATING, reached_C, 0.0, wanted)
        assert np.array(left)[[199, 1999, 19_999]] == pytest.approx(wanted, abs=0.016)  # half of the largest grain
        assert (-np.diff(wanted) > 0.05).all()
