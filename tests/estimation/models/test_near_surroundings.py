"""Near surroundings that warm up, a tube or a coating: two bodies in the heat balance of the whole range."""

import dataclasses

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from sma_actuator.estimation.models.heat_content import NEAR_SHARE, REMEMBERED, THERMAL, NEAR_TIME_s, features_all
from sma_actuator.estimation.models.whole_range import WholeRangeCoefficients

TIME_CONSTANT_s, HEAT_LOSS_W_K, AMBIENT_C = 2.0, 4e-3, 22.0


def temperatures(time_s, power_W, share, near_s):
    """What the heat balance says of a wire that keeps no latent heat, °C."""
    thermal = np.zeros(THERMAL + 2)
    thermal[:3] = TIME_CONSTANT_s, 0.0, HEAT_LOSS_W_K
    thermal[NEAR_SHARE], thermal[NEAR_TIME_s] = share, near_s
    n, one_play = len(time_s), np.array([1.0])
    out = np.empty((n, 4))
    features_all(
        time=time_s,
        power=power_W,
        ambient=np.full(n, AMBIENT_C),
        resistance=np.full(n, 5.0),
        stress=np.zeros(n),
        share=np.ones(n),
        first=np.arange(n) == 0,
        thermal=thermal,
        widths_K=one_play,
        widths_Ohm=np.zeros(0),
        state=np.zeros(REMEMBERED + 1),
        out=out,
    )
    return out[:, 2]


@pytest.mark.parametrize("share", [0.0, 0.3, 0.7])
@pytest.mark.parametrize("near_s", [1.0, 8.0])
def test_it_warms_and_cools_as_two_bodies_do(share, near_s):
    """C dT/dt = P − k (T − S), C_s dS/dt = k (T − S) − k' (S − T_air), with 1/h = 1/k + 1/k' and a = k/(k + k')."""
    inner = HEAT_LOSS_W_K / (1.0 - share)
    heat_J_K = TIME_CONSTANT_s * HEAT_LOSS_W_K

    def power(t):
        return 0.3 if 2.0 <= t < 12.0 else 0.02

    def two_bodies(t, y):
        wire_K, near_K = y
        return (power(t) - inner * (wire_K - near_K)) / heat_J_K, (share * wire_K - near_K) / near_s

    time_s = np.arange(0.0, 40.0, 0.02)
    in_balance_K = power(0.0) / HEAT_LOSS_W_K
    found = solve_ivp(
        two_bodies, (0.0, 40.0), (in_balance_K, share * in_balance_K), t_eval=time_s, rtol=1e-9, max_step=0.02
    )
    # The power of a sample is that since the one before it.
    said_C = temperatures(time_s, np.array([power(t - 1e-9) for t in time_s]), share, near_s)
    assert np.abs(said_C - AMBIENT_C - found.y[0]).max() < 0.01 * found.y[0].max()
    assert said_C[0] == pytest.approx(AMBIENT_C + in_balance_K, abs=1e-6)


def test_without_a_share_the_air_begins_at_the_wire():
    time_s = np.arange(0.0, 20.0, 0.05)
    power_W = np.where(time_s % 7.0 < 3.0, 0.3, 0.01)
    quick, slow = (temperatures(time_s, power_W, 0.0, near_s) for near_s in (0.5, 50.0))
    assert (quick == slow).all()


def test_a_file_that_says_nothing_of_them_has_none():
    default = {f.name: f for f in dataclasses.fields(WholeRangeCoefficients)}["near_surroundings"].default
    assert default == (0.0, 1.0)
