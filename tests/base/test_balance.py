"""I² R = h ΔT: what a current holds a wire at, and what current does; and how a wire warms with what is around it."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from sma_actuator.base.balance import Balance, followed, gains, held_rise_K, holding_A


def test_a_watt_of_heat_in_a_wire_that_loses_ten_milliwatts_a_kelvin_holds_it_a_hundred_above_its_surroundings():
    assert held_rise_K(0.5, 4.0, 0.01) == pytest.approx(100.0)
    assert holding_A(100.0, 4.0, 0.01) == pytest.approx(0.5)


@pytest.mark.parametrize("near_share", [0.0, 0.6])
def test_a_wire_warms_by_its_power_and_by_the_latent_heat_it_gives_off(near_share):
    """C dx/dt = P − h (x − s)/(1 − a) + C dX/dt, τ_s ds/dt = a x − s; of a wire that transforms in 4 s on the way."""
    balance = Balance(time_constant_s=2.0, near_share=near_share, near_s=5.0)

    def held_K(t):
        return np.where(np.asarray(t) < 10.0, 60.0, 0.0)

    def released_K(t):
        return 25.0 * np.clip((np.asarray(t) - 12.0) / 4.0, 0.0, 1.0)

    def two_bodies(t, y):
        wire_K, near_K = y
        released_K_s = 25.0 / 4.0 if 12.0 < t < 16.0 else 0.0
        lost_K = (wire_K - near_K) / (1.0 - near_share)
        return (held_K(t) - lost_K) / balance.time_constant_s + released_K_s, (near_share * wire_K - near_K) / 5.0

    time_s = np.arange(0.0, 40.0, 0.01)
    begins = 60.0, near_share * 60.0
    truth = solve_ivp(two_bodies, (0.0, 40.0), begins, t_eval=time_s, rtol=1e-9, max_step=0.01)
    found_K = followed(time_s, held_K(time_s - 1e-9), released_K(time_s), balance)
    assert np.abs(found_K - truth.y[0]).max() < 0.3


def test_what_surrounds_a_wire_changes_how_soon_it_is_warm_and_not_how_warm_it_gets():
    in_a_tube, near = 0.0, 0.0
    for _ in range(20_000):
        wire, around = gains(in_a_tube, near, 50.0, 0.01, 2.0, 0.6, 8.0)
        in_a_tube, near = in_a_tube + wire, near + around
    assert in_a_tube == pytest.approx(50.0, abs=0.01)
    assert near == pytest.approx(0.6 * 50.0, abs=0.01)


def test_a_sample_that_is_none_leaves_the_balance_standing():
    time_s, balance = np.array([0.0, 1.0, 2.0]), Balance(2.0, 0.5, 3.0)
    broken = followed(time_s, np.array([10.0, np.nan, 40.0]), np.zeros(3), balance)
    assert np.isnan(broken[1])
    assert broken[2] == followed(time_s[::2], np.array([10.0, 40.0]), np.zeros(2), balance)[1]
