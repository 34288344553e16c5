"""What logs say of the cold wire as a strain gauge."""

import dataclasses

import numpy as np
import pytest
from pulsed import pulsed_log

from sma_actuator.config import bench_from_mapping
from sma_actuator.estimation.models.orientation import STAYS, TURNED, OHM_PER_m, SCATTER_Ohm
from sma_actuator.identify.fitters.whole_range.cold_wire import PER_STRAIN, MODULUS_Pa, cold_wire
from sma_actuator.identify.fitters.whole_range.data import Data

HOT_m = 5e-4
ENDS_m = np.array([[HOT_m, 0.0, 0.0], [1e-3, 4e-11, 0.0]])  #: 4 mm more for 100 MPa
FIRST_s, PERIOD_s = 10.0, 20.0


@pytest.fixture
def config(flexinol):
    return bench_from_mapping(flexinol.mapping)


def cold_m(load_N):
    return ENDS_m[1, 0] + ENDS_m[1, 1] * load_N * 5e7


def pulses(load_N, begins_m=None, more_Ohm=0.0, noise_Ohm=0.0):
    """Three pulses under a load of 50 MPa a newton; it begins somewhere, with so much more resistance than where it
    comes back to."""
    time_s = np.arange(0.0, FIRST_s + 3 * PERIOD_s, 0.05)
    driven = (time_s >= FIRST_s) & ((time_s - FIRST_s) % PERIOD_s < 0.5 * PERIOD_s)
    since_s = np.where(time_s < FIRST_s, np.inf, (time_s - FIRST_s) % (0.5 * PERIOD_s))
    martensite = np.where(driven, np.exp(-2.0 * since_s), 1.0 - np.exp(-2.0 * since_s))
    displacement_m = HOT_m + martensite * (cold_m(load_N) - HOT_m)
    log = pulsed_log(time_s, driven, displacement_m, load_N)
    resistance_Ohm = log.signals.resistance_Ohm + np.random.default_rng(1).normal(0.0, 1.0, len(time_s)) * noise_Ohm
    if begins_m is not None:
        displacement_m = np.where(time_s < FIRST_s, begins_m, displacement_m)
        resistance_Ohm = resistance_Ohm + np.where(time_s < FIRST_s, more_Ohm, 0.0)
    signals = dataclasses.replace(log.signals, resistance_Ohm=resistance_Ohm, reference_displacement_m=displacement_m)
    return dataclasses.replace(log, signals=signals)


def test_a_wire_that_follows_its_load_at_once_shows_nothing_of_other_loads(config):
    """It may as well have hung on that very load before."""
    assert cold_wire([pulses(each) for each in (0.5, 1.0, 2.0)], config, ENDS_m).other_loads == ()


@pytest.mark.parametrize("turned", [0.6, 0.9])
def test_one_that_a_heavier_load_turns_not_wholly_is_shorter_there_until_it_is_heated(turned, config):
    short_m = HOT_m + turned * (cold_m(1.0) - HOT_m)
    known = cold_wire([pulses(0.5, left_m(1.0, config)), pulses(1.0, short_m), pulses(2.0)], config, ENDS_m).known
    assert known[TURNED] == pytest.approx(turned, abs=0.01)


def left_m(stays, config):
    """Where it begins under 0.5 N if so much stays of what 2 N have made it longer."""
    elastic_m = 75e6 / MODULUS_Pa * config.wire.strain_length_m
    return cold_m(0.5) + stays * (cold_m(2.0) - cold_m(0.5) - elastic_m)


@pytest.mark.parametrize("stays", [0.6, 1.0])
def test_what_stays_is_what_the_load_before_has_made_of_it_but_for_elasticity(stays, config):
    long_m = left_m(stays, config)
    first = cold_wire([pulses(0.5, long_m), pulses(2.0)], config, ENDS_m).known
    after = cold_wire([pulses(2.0), pulses(0.5, long_m)], config, ENDS_m).known
    assert first[STAYS] == pytest.approx(after[STAYS], abs=0.01) == pytest.approx(stays, abs=0.01)


def test_a_little_that_is_left_is_no_memory_of_a_load(config):
    logs = [pulses(0.5, left_m(0.3, config)), pulses(1.0, HOT_m + 0.9 * (cold_m(1.0) - HOT_m)), pulses(2.0)]
    assert cold_wire(logs, config, ENDS_m).other_loads == ()


def test_its_gauge_is_that_of_a_drawn_conductor_until_logs_say_otherwise(config):
    geometric = PER_STRAIN * (5.0 + 100.0 * (cold_m(0.5) + cold_m(2.0))) / config.wire.strain_length_m
    none = cold_wire([pulses(0.5, noise_Ohm=0.01), pulses(2.0)], config, ENDS_m).known[OHM_PER_m]
    assert none == pytest.approx(geometric, rel=0.01)
    longer_m = 1e-3
    shown = [pulses(0.5, cold_m(0.5) + longer_m, more_Ohm=1.3 * geometric * longer_m, noise_Ohm=1e-3), pulses(2.0)]
    assert cold_wire(shown, config, ENDS_m).known[OHM_PER_m] == pytest.approx(1.3 * geometric, rel=0.05)


def test_one_whose_resistance_is_another_after_a_long_rest_though_it_is_as_long_is_no_gauge(config):
    """As one is that was warmer yet where its cycles came to rest, or that shows another phase."""
    logs = [
        pulses(load_N, cold_m(load_N), more_Ohm, 1e-3) for load_N, more_Ohm in ((0.5, 0.0), (1.0, -0.05), (2.0, 0.1))
    ]
    known = cold_wire(logs, config, ENDS_m).known
    assert known[SCATTER_Ohm] == pytest.approx(np.sqrt((0.05**2 + 0.1**2) / 3.0), rel=0.05)


def test_logs_in_which_it_never_came_to_rest_cold_say_nothing(config):
    log = pulses(1.0)
    assert cold_wire([log.rows(np.arange(len(log.displacement_m)) < 300)], config, ENDS_m) is None


def test_logs_of_one_load_say_nothing_of_others(config):
    assert cold_wire([pulses(1.0), pulses(1.0)], config, ENDS_m).other_loads == ()


def test_logs_whose_only_cold_rests_are_from_before_they_were_heated_say_nothing(config):
    logs = [pulses(load_N) for load_N in (0.5, 1.0)]
    assert cold_wire([log.rows(np.arange(len(log.displacement_m)) < 300) for log in logs], config, ENDS_m) is None


def test_a_single_cold_rest_does_not_say_what_is_usual(config):
    log = pulses(1.0)
    elapsed_s = np.arange(len(log.displacement_m)) * 0.05
    heated_first = log.rows((elapsed_s >= FIRST_s) & (elapsed_s < FIRST_s + PERIOD_s))
    assert cold_wire([heated_first], config, ENDS_m) is None


@pytest.mark.parametrize("since_s", [0.05, 0.4, 0.8])
def test_a_log_that_begins_as_the_wire_was_switched_off_begins_warm(since_s, config):
    """Taken for cold and 7 mm shorter, it was off by a third of the stroke all the log through."""
    loads_N = (0.5, 1.0, 2.0)
    logs = [pulses(each) for each in loads_N]
    cut = logs[-1].rows(logs[-1].signals.time_s > FIRST_s + 0.5 * PERIOD_s + since_s)
    assert cut.displacement_m[0] < cold_m(2.0) - 0.1 * (cold_m(2.0) - HOT_m)
    warm = [*logs, dataclasses.replace(cut, cycle=cut.cycle - cut.cycle[0])]
    assert Data(warm, config).displacement.max() == pytest.approx(Data(logs, config).displacement.max(), rel=0.02)
    np.testing.assert_allclose(
        cold_wire(warm, config, ENDS_m).resistance, cold_wire(logs, config, ENDS_m).resistance, rtol=0.05, atol=1e-6
    )
