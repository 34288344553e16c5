"""I² R = h ΔT: what a current holds a wire at, and what current does."""

import pytest

from sma_actuator.base.balance import held_rise_K, holding_A


def test_a_watt_of_heat_in_a_wire_that_loses_ten_milliwatts_a_kelvin_holds_it_a_hundred_above_its_surroundings():
    assert held_rise_K(0.5, 4.0, 0.01) == pytest.approx(100.0)
    assert holding_A(100.0, 4.0, 0.01) == pytest.approx(0.5)
