"""What the section ``calibration`` says between the places at which it says something."""

import dataclasses

import numpy as np
import pytest

from sma_actuator.base.calibration import Calibration, HotEndSection, RestSection, through


def test_between_the_loads_of_a_calibration_the_cold_end_is_a_curve_and_beyond_them_it_goes_on():
    """On strains as transformation strain saturates with stress, ε (1 − exp(−(σ + σ₀)/σ₁)): a tenth of what straight
    lines are off."""
    nodes_Pa = np.array([18.5, 32.0, 45.0, 62.0, 85.0, 120.0]) * 1e6

    def strain(stress_Pa):
        return 0.042 * -np.expm1(-(stress_Pa + 3.4e6) / 24e6)

    at_Pa = np.linspace(16e6, 120e6, 200)
    off = np.abs(through(nodes_Pa, strain(nodes_Pa), at_Pa) - strain(at_Pa))
    straight = np.abs(np.interp(at_Pa, nodes_Pa, strain(nodes_Pa)) - strain(at_Pa))
    assert off.mean() < 0.2 * straight.mean() and off.max() < 0.25 * straight.max()
    np.testing.assert_allclose(through(nodes_Pa, strain(nodes_Pa), nodes_Pa), strain(nodes_Pa), rtol=1e-12)
    assert (np.diff(through(nodes_Pa, strain(nodes_Pa), np.linspace(0.0, 400e6, 999))) >= 0.0).all()
    np.testing.assert_array_equal(through(nodes_Pa[:2], [1.0, 2.0], nodes_Pa[:3]), [1.0, 2.0, 2.0])


def test_the_resistance_tells_roughly_how_far_along_its_stroke_the_wire_is():
    """Contracted 0, cold 1, at either load; between them a straight line."""
    known = Calibration(
        hot_end=HotEndSection(contracted_stress=(2e7, 6e7), contracted_resistance=(4.0, 4.2)),
        rest=RestSection(cold_stress=(2e7, 6e7), cold_resistance=(5.0, 5.6)),
    )
    at_Ohm, stress_Pa = np.array([4.0, 5.0, 4.2, 5.6, 4.7]), np.array([2e7, 2e7, 6e7, 6e7, 4e7])
    np.testing.assert_allclose(known.share_by_resistance(at_Ohm, stress_Pa), [0.0, 1.0, 0.0, 1.0, 0.5])
    assert known.share_by_resistance(4.5, 2e7) == pytest.approx(0.5)


def test_a_table_that_somebody_edited_is_refused_in_a_sentence():
    whole = RestSection(cold_stress=(2e7, 6e7), cold_resistance=(5.0, 5.6), cold_displacement=(1e-3, 2e-3))
    assert whole.mismatches() == []
    (falls,) = dataclasses.replace(whole, cold_stress=(6e7, 2e7)).mismatches()
    assert falls.startswith("calibration.rest.cold_stress: does not rise")
    (short,) = dataclasses.replace(whole, cold_resistance=(5.0,)).mismatches()
    assert short.startswith("calibration.rest.cold_resistance: has 1 values for the 2 of calibration.rest.cold_stress")
    assert dataclasses.replace(whole, cold_resistance=()).mismatches() == []  # nobody measured it
