"""What identify writes down with a model: its error place by place, and what a resting wire shows."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sma_actuator.config import Config, bench_from_mapping
from sma_actuator.identify import identify
from sma_actuator.identify.calibration import calibration_of, expected_residual_m
from sma_actuator.identify.experiments import make_experiment
from sma_actuator.identify.kinds import make_experiments
from sma_actuator.identify.rests import WINDOW_s, find_rests


@pytest.fixture(scope="module")
def identified(furukawa):
    logs = furukawa.only("pulses", "partial")
    return logs, identify(logs, furukawa.mapping, "furukawa")


def test_the_model_file_says_how_good_the_model_was(identified):
    logs, result = identified
    calibration = Config.from_mapping(result.mapping).calibration
    assert calibration.known
    assert calibration.error == pytest.approx(np.mean([e.full_percent for e in result.errors]), rel=0.1)
    assert calibration.largest_error >= calibration.error >= calibration.scatter > 0.0
    loads = (
        len({round(log.metadata["load"]["force_N"], 2) for log in logs if "force_N" in log.metadata.get("load", {})})
        or 4
    )
    assert len(calibration.residual_stress) == loads
    assert len(calibration.residual_heating) == len(calibration.residual_stress) * len(calibration.residual_position)


def test_a_resting_wire_is_longer_and_more_resistive_cold_than_hot(identified):
    calibration = Config.from_mapping(identified[1].mapping).calibration
    assert len(calibration.cold_stress) >= 3 and len(calibration.hot_stress) >= 3
    assert min(calibration.cold_displacement) > max(calibration.hot_displacement)
    assert min(calibration.cold_resistance) > max(calibration.hot_resistance)
    assert np.all(np.diff(calibration.cold_stress) > 0)
    assert calibration.ambient_temperature == pytest.approx(22.0, abs=0.1)
    assert calibration.hot_power > 0.1


def test_a_model_of_any_size_keeps_its_errors_alone(identified, furukawa):
    config = identified[1].config
    bare = calibration_of(make_experiments(identified[0], bench_from_mapping(furukawa.mapping)), config, at_rest=False)
    assert bare.known and not bare.cold_stress and not bare.residual_position


class TestRests:
    def experiment(self, furukawa):
        return make_experiment(furukawa.only("pulses")[0], bench_from_mapping(furukawa.mapping))

    def test_a_pulse_rests_cold_before_it_and_hot_at_its_end(self, furukawa):
        rests = find_rests(self.experiment(furukawa), 1.0)
        assert {r.hot for r in rests} == {False, True}
        experiment = self.experiment(furukawa)
        for rest in rests:
            here = slice(rest.start, rest.stop)
            assert experiment.signals.time_s[rest.stop - 1] - experiment.signals.time_s[rest.start] <= WINDOW_s + 0.1
            assert (experiment.driven[here] == rest.hot).all()
            assert np.ptp(experiment.displacement_m[here]) < 0.05 * np.ptp(experiment.displacement_m)

    def test_a_wire_just_switched_off_is_not_at_rest(self, furukawa):
        """It stands still while it only cools: that is no cold rest."""
        experiment = self.experiment(furukawa)
        off = int(np.flatnonzero(experiment.driven[:-1] & ~experiment.driven[1:])[0]) + 1
        soon = np.zeros(len(experiment.log), dtype=bool)
        soon[: off + 25] = True
        cut = experiment.rows(soon)
        assert all(r.hot or r.stop <= off for r in find_rests(cut, 1.0))

    def test_a_current_that_moves_is_no_rest(self, furukawa):
        experiment = self.experiment(furukawa)
        ramped = dataclasses.replace(
            experiment.signals,
            current_A=experiment.signals.current_A + 0.2 * np.sin(np.arange(len(experiment.log)) * 0.3) ** 2,
        )
        assert find_rests(dataclasses.replace(experiment, signals=ramped), 1.0) == []


class TestExpectedResidual:
    POSITION = np.linspace(0.0, 4e-3, 5)
    STRESS = np.array([10e6, 20e6, 40e6])

    @given(st.floats(-1e-3, 5e-3), st.floats(0.0, 60e6), st.booleans())
    def test_it_is_linear_between_the_places_and_stands_beyond_them(self, estimate_m, stress_Pa, heating):
        """A table of a bilinear function is met exactly."""

        def truth(position_m, stress):
            return 1e-2 * position_m + 1e-13 * stress + 5.0 * position_m * stress * 1e-9

        table = truth(self.POSITION[None, :], self.STRESS[:, None])
        found = expected_residual_m(
            self.POSITION,
            self.STRESS,
            table.ravel(),
            -table.ravel(),
            np.array([estimate_m]),
            np.array([stress_Pa]),
            np.array([heating]),
        )
        want = truth(np.clip(estimate_m, 0.0, 4e-3), np.clip(stress_Pa, 10e6, 40e6))
        assert found[0] == pytest.approx(want if heating else -want, rel=1e-9, abs=1e-12)
