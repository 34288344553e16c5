"""A cold wire is where its earlier load left it until it is heated: nothing is learned from that."""

import dataclasses

import numpy as np
import pytest
from pulsed import pulsed_log

from sma_actuator.config import bench_from_mapping
from sma_actuator.identify.fitters.whole_range.data import Data
from sma_actuator.identify.fitters.whole_range.earlier_load import of_earlier_load
from sma_actuator.logs.kinds import make_experiments

HOT_m, COLD_m = 5e-4, 3e-3
LEAST_m = 3e-5
FIRST_s, PERIOD_s = 10.0, 20.0  #: when it is heated, for half of every period


def pulsed(begins_m=COLD_m, load_N=0.5, pulses=3, part_of="", from_s=0.0):
    """A log of pulses; what of the wire has not been austenite is as long as it was in the beginning."""
    time_s = np.arange(0.0, FIRST_s + PERIOD_s * pulses, 0.05)
    driven = (time_s >= FIRST_s) & ((time_s - FIRST_s) % PERIOD_s < 0.5 * PERIOD_s)
    since_s = np.where(time_s < FIRST_s, np.inf, (time_s - FIRST_s) % (0.5 * PERIOD_s))
    martensite = np.where(driven, np.exp(-since_s), 1.0 - np.exp(-since_s))
    old = np.minimum.accumulate(martensite)
    displacement_m = HOT_m + martensite * (COLD_m - HOT_m) + old * (begins_m - COLD_m)
    return pulsed_log(time_s + from_s, driven, displacement_m, load_N, part_of)


@pytest.mark.parametrize("begins_m", [COLD_m - 1e-3, COLD_m + 1e-3])
def test_until_a_wire_is_heated_it_is_where_a_lighter_or_a_heavier_load_left_it(begins_m):
    log = pulsed(begins_m)
    (earlier,) = of_earlier_load([log], 1.0, LEAST_m)
    off_m = np.abs(log.displacement_m - pulsed().displacement_m)
    assert earlier[: int(FIRST_s / 0.05)].all()
    assert not earlier[off_m < 0.5 * LEAST_m].any()
    assert earlier[off_m > 2.0 * LEAST_m].all()


def test_a_wire_that_begins_where_it_comes_back_to_is_learned_from_at_once():
    assert not any(e.any() for e in of_earlier_load([pulsed(), pulsed(COLD_m + 0.5 * LEAST_m)], 1.0, LEAST_m))


def test_a_wire_that_begins_contracted_is_learned_from_at_once():
    assert not of_earlier_load([pulsed().rows(np.arange(1400) >= 380)], 1.0, LEAST_m)[0].any()


def test_another_log_of_the_load_tells_where_it_comes_back_to_and_one_of_another_load_does_not():
    short = pulsed(COLD_m - 1e-3, pulses=1)
    short = short.rows(np.arange(len(short.displacement_m)) < int((FIRST_s + 0.5 * PERIOD_s) / 0.05))
    assert not of_earlier_load([short, pulsed(load_N=1.0)], 1.0, LEAST_m)[0].any()
    assert of_earlier_load([short, pulsed()], 1.0, LEAST_m)[0].any()


def test_a_stretch_that_goes_on_under_its_load_has_the_past_of_the_one_before_it():
    before = pulsed(part_of="one")
    goes_on = pulsed(COLD_m - 1e-3, part_of="one", from_s=100.0)
    assert not of_earlier_load([before, goes_on], 1.0, LEAST_m)[1].any()
    heavier = pulsed(COLD_m - 1e-3, load_N=1.0, part_of="one", from_s=100.0)
    assert of_earlier_load([before, heavier], 1.0, LEAST_m)[1].any()


def test_the_whole_range_takes_neither_rows_nor_a_cold_end_from_it(flexinol):
    """Its logs as if a heavier weight had hung on the wire before each load was hung on it."""
    config = bench_from_mapping(flexinol.mapping)
    experiments = make_experiments(flexinol.logs, config, remembered=True)

    usual, moved = Data(experiments, config), Data([longer(t, config) for t in experiments], config)
    cycle = np.concatenate([t.cycle[t.judged] for t in experiments])
    assert (cycle == 0).any()
    np.testing.assert_allclose(moved.ends, usual.ends, atol=0.2)
    np.testing.assert_array_less(moved.displacement[moved.rows], usual.displacement.max() + 0.5)


def test_a_log_that_ends_before_the_wire_is_heated_says_nothing_of_the_ends(flexinol):
    config = bench_from_mapping(flexinol.mapping)
    experiments = make_experiments(flexinol.logs, config, remembered=True)
    begins = next(t for t in experiments if t.kind == "pulses" and np.sum(t.cycle == 0) > 20)
    short = longer(begins, config).rows(begins.cycle == 0)
    usual, more = (Data(some, config) for some in (experiments, [*experiments, short]))
    np.testing.assert_array_equal(more.ends, usual.ends)


def test_where_only_one_load_has_full_cycles_the_others_cold_ends_are_of_their_partial_ones(flexinol):
    """Two logs of full cycles under one load, which never is quite the same, are no line over the loads."""
    config = bench_from_mapping(flexinol.mapping)
    experiments = make_experiments(flexinol.logs, config, remembered=True)
    full = next(t for t in experiments if t.kind == "pulses")
    heavier = dataclasses.replace(full, signals=dataclasses.replace(full.signals, stress_Pa=1.001 * full.stress_Pa))
    some = [full, heavier, *(t for t in experiments if t.kind == "partial")]
    usual, fewer = Data(experiments, config), Data(some, config)
    stress_Pa = np.linspace(*usual.stress_Pa, 5)[:, None] ** np.arange(3)
    np.testing.assert_allclose(stress_Pa @ fewer.ends.T, stress_Pa @ usual.ends.T, atol=5.0)


def test_a_wire_that_begins_where_it_rests_is_learned_as_it_was_measured_whatever_curve_the_ends_are(flexinol):
    """A load under which the cold wire is further from any quadratic in stress than another load leaves one."""
    config = bench_from_mapping(flexinol.mapping)
    experiments = make_experiments(flexinol.logs, config, remembered=True)
    loads_Pa = sorted({round(t.mean_stress_Pa, -5) for t in experiments})
    off = [shorter(t) if round(t.mean_stress_Pa, -5) == loads_Pa[1] else t for t in experiments]
    usual, data = Data(experiments, config), Data(off, config)
    begins = np.cumsum([0, *data.lengths[:-1]])
    moved = [
        (t.displacement_m[0] - u.displacement_m[0]) / data.percent_m for t, u in zip(off, experiments, strict=True)
    ]
    assert min(moved) < -5.0
    np.testing.assert_allclose((data.displacement - usual.displacement)[begins], moved, atol=0.1)


def shorter(t):
    """The same log, all displacements less by a tenth."""
    displacement_m = 0.9 * t.displacement_m
    return dataclasses.replace(t, signals=dataclasses.replace(t.signals, reference_displacement_m=displacement_m))


def longer(t, config):
    """The same log, the wire a fifth of its stroke longer until it is heated."""
    displacement_m = t.displacement_m.copy()
    displacement_m[t.cycle == 0] += 0.2 * config.wire.full_stroke_m
    return dataclasses.replace(t, signals=dataclasses.replace(t.signals, reference_displacement_m=displacement_m))
