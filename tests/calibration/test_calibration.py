"""What identify writes down with a model: its error place by place, and what a resting wire shows."""

import dataclasses
import math

import numpy as np
import pytest
from characterised import virtual_rig
from hypothesis import given
from hypothesis import strategies as st

from sma_actuator.base.calibration import through
from sma_actuator.calibration import calibration_of, hot_end
from sma_actuator.calibration.expectation import Expectation, always_so_m, correlation_time_s, learn
from sma_actuator.calibration.interval import expected_residual_m
from sma_actuator.calibration.rest import WINDOW_s, find_rests
from sma_actuator.calibration.stresses import clusters
from sma_actuator.characterise.programs import square_pulses
from sma_actuator.config import Config, bench_from_mapping
from sma_actuator.estimation.chain import Chain
from sma_actuator.logs.experiments import make_experiment
from sma_actuator.logs.kinds import FULL, make_experiments
from sma_actuator.plant.loads import Weight


@pytest.fixture
def identified(flexinol, identified_flexinol):
    """The logs of which a model was made, and the model."""
    return flexinol.only("pulses", "partial"), identified_flexinol


def test_the_model_file_says_how_good_the_model_was(identified):
    logs, result = identified
    config = Config.from_mapping(result.mapping)
    calibration = config.calibration
    assert calibration.known
    as_the_node = [
        Chain(config).run(t.signals).displacement_m - t.displacement_m for t in make_experiments(logs, config)
    ]
    errors = [np.nanmean(np.abs(e)) / config.wire.full_stroke_m * 100 for e in as_the_node]
    assert calibration.error == pytest.approx(np.mean(errors), rel=1e-6)
    assert calibration.error < np.mean([e.full_percent for e in result.errors])  # there without the known hot end
    assert calibration.largest_error >= calibration.error >= calibration.expectation.floor > 0.0
    assert calibration.expectation.independent_time > 0.0
    loads = (
        len({round(log.metadata["load"]["force_N"], 2) for log in logs if "force_N" in log.metadata.get("load", {})})
        or 4
    )
    assert len(calibration.interval.residual_stress) == loads
    assert len(calibration.interval.residual_heating) == len(calibration.interval.residual_stress) * len(
        calibration.interval.residual_position
    )


def test_a_log_of_a_slow_supply_shows_the_same_rests(identified):
    """Of a wire with one rest of three loads a node believed that the stroke ended where that of the lightest did."""
    logs, result = identified
    config = Config.from_mapping(result.mapping)
    time_constant_s = config.thermal.heat_capacity / config.thermal.heat_loss
    for log in logs:
        if "pulses" not in log.name:
            continue
        slow = dataclasses.replace(log, columns={name: column[::8] for name, column in log.columns.items()})
        quick, few = (
            [
                (rest.hot, float(np.mean(t.displacement_m[rest.start : rest.stop])))
                for t in make_experiments([each], config)
                for rest in find_rests(t, time_constant_s)
            ]
            for each in (log, slow)
        )
        assert {hot for hot, _ in few} == {hot for hot, _ in quick} == {False, True}, log.name
        for hot, at_m in few:
            assert min(abs(at_m - other_m) for other, other_m in quick if other == hot) < 4e-5  # 1 % of the stroke


def test_a_resting_wire_is_longer_and_more_resistive_cold_than_hot(identified):
    calibration = Config.from_mapping(identified[1].mapping).calibration
    assert len(calibration.rest.cold_stress) >= 3 and len(calibration.rest.hot_stress) >= 3
    assert min(calibration.rest.cold_displacement) > max(calibration.rest.hot_displacement)
    assert min(calibration.rest.cold_resistance) > max(calibration.rest.hot_resistance)
    assert np.all(np.diff(calibration.rest.cold_stress) > 0)
    assert calibration.ambient_temperature == pytest.approx(22.0, abs=0.1)
    assert calibration.rest.hot_power > 0.1


def test_a_wire_that_creeps_on_is_not_at_rest():
    """Hung vertically it loses its heat more slowly than its bench says, and a light weight pulls it out last."""
    _, rig, _ = virtual_rig("flexinol", seed=3, load=Weight(0.49), physics="vertical")
    with rig.opened():
        logs = [rig.record(square_pulses(2, 0.34, 0.05, 5.0, cool_s)) for cool_s in (10.0, 60.0)]
    thermal = rig.config.thermal
    creeping, settled = (
        [
            r
            for r in find_rests(make_experiment(log, rig.config), thermal.heat_capacity / thermal.heat_loss)
            if not r.hot
        ]
        for log in logs
    )
    assert settled and all(rest.settled for rest in settled)
    assert not any(rest.settled for rest in creeping if rest.cycle)


def test_a_contracted_wire_that_still_grows_warmer_counts_as_it_would_be_in_the_end():
    """Where it goes is nearer to where it comes to rest than where it is, by more than half of the way still to go."""
    _, rig, _ = virtual_rig("flexinol", seed=3, load=Weight(0.98), physics="vertical")  # which loses its heat slowly
    with rig.opened():
        # 0.32 A is let stand for 17 s; 0.34 A is cut after 8 s lest the wire overheats, and so never comes to rest.
        logs = [rig.record(square_pulses(2, 0.32, 0.05, heat_s, 20.0)) for heat_s in (5.0, 17.0)]
    time_constant_s = rig.config.thermal.heat_capacity / rig.config.thermal.heat_loss
    is_Ohm, further_Ohm = [], []
    for log in logs:
        experiment = make_experiment(log, rig.config)
        rest = next(r for r in find_rests(experiment, time_constant_s) if r.hot)
        is_Ohm.append(np.mean(experiment.resistance_Ohm[rest.start : rest.stop]))
        further_Ohm.append(rest.further(experiment.resistance_Ohm, experiment.signals.time_s, time_constant_s))
    settled_Ohm = is_Ohm[1]
    assert abs(further_Ohm[1]) < 0.005 < 0.02 < settled_Ohm - is_Ohm[0]  # what a lead would look like
    off_Ohm = abs(is_Ohm[0] + further_Ohm[0] - settled_Ohm)
    assert off_Ohm < settled_Ohm - is_Ohm[0] and off_Ohm < 0.5 * further_Ohm[0]


def test_a_wire_that_cools_in_few_readings_is_seen_contracted_while_it_is_ramped(identified):
    """As one of 25 µm is, a hundred times a second.  Its resistance is that of the same wire where it cools."""
    config = Config.from_mapping(identified[1].mapping)
    _, rig, _ = virtual_rig("flexinol", seed=3, load=Weight(0.98))
    with rig.opened():
        log = rig.record(square_pulses(2, 0.38, 0.05, 5.0, 12.0, ramp_s=60.0))
    slow = dataclasses.replace(log, columns={name: column[::6] for name, column in log.columns.items()})
    cooling, ramped = (hot_end.learn(make_experiments([each], config), config) for each in (log, slow))
    (cooling_Ohm,), (ramped_Ohm,) = cooling.contracted_resistance, ramped.contracted_resistance
    warmer_K = ramped.contracted_temperature - cooling.contracted_temperature
    assert abs(warmer_K) > 5.0
    assert ramped_Ohm - cooling_Ohm == pytest.approx(ramped.contracted_slope * warmer_K, abs=0.01)


@pytest.mark.parametrize("heat_s", [60.0, 7.0], ids=["long", "shorter than its balance forgets latent heat in"])
def test_one_that_is_held_there_shows_where_it_ends_and_not_how_its_resistance_rises(identified, heat_s):
    """A wire of 76 µm in still air: four readings of its cooling, and at the end of a pulse it stands within 2 K."""
    config = Config.from_mapping(identified[1].mapping)
    assert (heat_s < hot_end.FORGETS * config.thermal.balance.time_constant_s) == (heat_s == 7.0)
    _, rig, _ = virtual_rig("flexinol", seed=3, load=Weight(0.98))
    with rig.opened():
        log = rig.record(square_pulses(2, 0.38, 0.05, heat_s, 12.0))
    slow = dataclasses.replace(log, columns={name: column[::6] for name, column in log.columns.items()})
    seen = ([dataclasses.replace(t, kind=FULL) for t in make_experiments([each], config)] for each in (log, slow))
    cooling, held = (hot_end.learn(each, config) for each in seen)
    assert math.isfinite(cooling.contracted_slope) and math.isnan(held.contracted_slope)
    warmer_K = held.contracted_temperature - cooling.contracted_temperature
    expected_Ohm = cooling.contracted_resistance[0] + cooling.contracted_slope * warmer_K
    assert held.contracted_resistance[0] == pytest.approx(expected_Ohm, abs=0.01)
    assert held.contracted_displacement == pytest.approx(cooling.contracted_displacement, abs=1e-4)


def test_two_light_weights_are_two_stresses():
    """The cold end bends most where the load is light: 0.24 N and 0.35 N are no more one load than 1.3 N and 1.9 N
    are."""
    stress_Pa = np.array([15.0, 15.1, 22.0, 22.1, 32.0, 45.0, 62.0, 85.0, 118.0, 120.0]) * 1e6
    np.testing.assert_allclose(clusters(stress_Pa), np.array([15.05, 22.05, 32.0, 45.0, 62.0, 85.0, 119.0]) * 1e6)
    # what a load cell's zero is off
    np.testing.assert_allclose(clusters([-0.2e6, 0.1e6, 0.3e6, 30e6]), [0.2e6 / 3, 30e6])


def test_the_hot_end_is_known_under_every_load(identified):
    """Also where a contracted wire still creeps when its pulses end, as Ni-Ti does: so far it had yet to go."""
    config = identified[1].config
    known = config.calibration
    assert len(known.rest.hot_stress) == len(known.hot_end.contracted_stress) > 1
    assert 0.0 < known.rest.hot_to_go < 0.03 * config.wire.full_stroke_m


def test_a_model_of_any_size_keeps_its_errors_alone(identified, flexinol):
    config = identified[1].config
    bare = calibration_of(make_experiments(identified[0], bench_from_mapping(flexinol.mapping)), config, at_rest=False)
    assert bare.known and not bare.ends_known and not bare.interval.residual_position


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

    def test_a_wire_ten_times_as_quick_rests_as_often(self, furukawa):
        """Its pauses last a second or less, and it is read as much more often."""
        experiment = self.experiment(furukawa)
        quick = dataclasses.replace(experiment.signals, time_s=0.1 * experiment.signals.time_s)
        rests = find_rests(experiment, 1.0)
        found = find_rests(dataclasses.replace(experiment, signals=quick), 0.1)
        assert [(r.hot, r.start, r.stop) for r in found] == [(r.hot, r.start, r.stop) for r in rests] != []

    def test_a_wire_just_switched_off_is_not_at_rest(self, furukawa):
        """It stands still while it only cools: that is no cold rest."""
        experiment = self.experiment(furukawa)
        off = int(np.flatnonzero(experiment.driven[:-1] & ~experiment.driven[1:])[0]) + 1
        soon = np.zeros(len(experiment.log), dtype=bool)
        soon[: off + 25] = True
        cut = experiment.rows(soon)
        assert all(r.hot or r.stop <= off for r in find_rests(cut, 1.0))

    def test_where_a_controller_holds_a_wire_is_no_end(self, furukawa):
        """Its current stands, below the middle of its range or above, and so does the wire."""
        experiment = self.experiment(furukawa)
        on = int(np.flatnonzero(experiment.driven)[0])
        later = np.arange(len(experiment.driven)) >= on + len(experiment.driven[on:]) // 2
        current_A = experiment.signals.current_A
        least_A, most_A = current_A.min(), current_A.max()
        held_A = least_A + np.where(experiment.driven, 0.75, 0.3) * (most_A - least_A)
        held = dataclasses.replace(experiment.signals, current_A=np.where(later, held_A, current_A))
        found = find_rests(dataclasses.replace(experiment, signals=held), 1.0)
        assert any(later[r.start] for r in find_rests(experiment, 1.0))
        assert found and not any(later[r.start] for r in found)

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


class TestExpectation:
    def found(self, logs, config):
        traces = make_experiments(logs, config)
        return traces, [Chain(config).run(t.signals) for t in traces]

    def test_what_the_model_leaves_is_mostly_expected(self, identified):
        """Also where it was not fitted: the floor stands far below the error, and what is expected follows the
        residual."""
        logs, result = identified
        calibration = result.config.calibration
        assert calibration.expectation.floor < 0.7 * calibration.error
        expectation = Expectation(result.config)
        traces, found = self.found(logs, result.config)
        unexpected_m = [
            t.displacement_m - e.displacement_m - expectation.residual_m(e, slice(None))
            for t, e in zip(traces, found, strict=True)
        ]
        unexpected = np.nanmean(np.abs(np.concatenate(unexpected_m))) / result.config.wire.full_stroke_m * 100
        assert unexpected < 1.1 * calibration.expectation.floor
        floor_m = np.concatenate([expectation.floor_m(e, slice(None)) for e in found])
        mean = np.nanmean(floor_m) / result.config.wire.full_stroke_m * 100
        assert (
            unexpected < mean < 1.1 * calibration.expectation.floor
        )  # where it was fitted, the two opinions are nearer
        assert np.nanmin(floor_m) < 0.9 * np.nanmean(floor_m)  # some places and histories are surer than others

    def test_it_is_less_sure_where_a_model_has_lost_its_way(self, identified):
        """By 6 % of the stroke: a second opinion, which does not ask the model, contradicts it."""
        logs, result = identified
        expectation = Expectation(result.config)
        found = self.found(logs[:1], result.config)[1][0]
        lost = dataclasses.replace(found, model_m=found.model_m + 0.06 * result.config.wire.full_stroke_m)
        usual_m, floor_m = (np.nanmean(expectation.floor_m(e, slice(None))) for e in (found, lost))
        assert floor_m > 1.5 * usual_m

    def test_a_file_of_before_has_one_floor_everywhere(self, identified):
        """It holds no second opinion, and weights of a floor that nothing asks any more."""
        logs, result = identified
        known = dict(result.mapping["calibration"]["expectation"], expected_size=[1.0] * 254, expected_white=[1.0] * 91)
        for name in ("expected_place", "expected_apart", "expected_times"):
            del known[name]
        mapping = {**result.mapping, "calibration": {**result.mapping["calibration"], "expectation": known}}
        config = Config.from_mapping(mapping)
        found = self.found(logs[:1], config)[1][0]
        floor_m = Expectation(config).floor_m(found, slice(None))
        assert set(floor_m) == {known["floor"] / 100 * config.wire.full_stroke_m}

    def test_a_wire_with_two_logs_is_judged_too(self, identified):
        """No log can be left out where there are so few: then stretches of each are."""
        logs, result = identified
        traces, found = self.found(logs[:2], result.config)
        few = learn(traces, found, result.config)
        assert 0.0 < few.floor < result.config.calibration.error

    def test_a_colder_room_is_less_heat_if_it_is_held_against_it(self, identified):
        """Else what it does is unexpected: the wire is then asked for where it would be in the calibration's room."""
        logs, result = identified
        config = result.config
        expectation, usual_C = Expectation(config), config.calibration.ambient_temperature
        found = self.found(logs[:1], config)[1][0]
        colder = dataclasses.replace(
            found,
            signals=dataclasses.replace(found.signals, ambient_temperature_C=np.full(len(found.time_s), usual_C - 5.0)),
        )
        less = dataclasses.replace(found, heat_W=found.heat_W - 5.0 * config.thermal.heat_loss)
        counts_m = expectation.residual_m(colder, slice(None), ambient_counts=True)
        as_ever_m, less_m = (expectation.residual_m(e, slice(None)) for e in (found, less))
        assert np.nanmax(np.abs(counts_m - less_m)) < 0.1 * np.nanmax(np.abs(counts_m - as_ever_m))
        np.testing.assert_array_equal(expectation.residual_m(colder, slice(None)), as_ever_m)

    def test_a_fault_is_unexpected(self, identified):
        """Nothing of a displacement that is measured wrong is expected: the reference is not asked."""
        logs, result = identified
        expectation = Expectation(result.config)
        traces, found = self.found(logs[:1], result.config)
        before_m = expectation.residual_m(found[0], slice(None))
        moved = dataclasses.replace(
            traces[0].signals, reference_displacement_m=traces[0].signals.reference_displacement_m + 1e-3
        )
        after_m = expectation.residual_m(Chain(result.config).run(moved), slice(None))
        np.testing.assert_array_equal(before_m, after_m)

    @pytest.mark.parametrize("memory", [0.0, 0.9])
    def test_how_long_a_residual_remembers_itself(self, memory):
        """Of a first-order lag with noise: (1 + ρ) / (1 − ρ) steps."""
        rng = np.random.default_rng(0)
        values = np.zeros(20_000)
        for i in range(1, len(values)):
            values[i] = memory * values[i - 1] + rng.standard_normal()
        found_s = correlation_time_s(np.arange(20_000) * 0.1, values, np.zeros(20_000, dtype=int))
        assert found_s == pytest.approx(0.1 * (1.0 + memory) / (1.0 - memory), rel=0.25)


def test_of_a_load_that_changes_half_of_what_the_model_would_say_had_it_always_been_so_is_expected(identified):
    """A weight is lifted off half way through a cycle; before and after, the model is asked as though it had always
    hung so."""
    logs, result = identified
    config = Config.from_mapping(result.mapping)
    signals = make_experiment(next(log for log in logs if log.metadata["kind"] == "pulses"), config).signals
    n = len(signals.time_s)
    weights_N = 0.5, 1.5

    def hanging(load_N):
        load_N = np.broadcast_to(load_N, n).astype(float)
        return dataclasses.replace(signals, load_N=load_N, stress_Pa=load_N / config.wire.area_m2)

    first, then = (Chain(config).run(hanging(load_N)).model_m for load_N in weights_N)
    later = np.arange(n) >= n // 3
    changed = hanging(np.where(later, weights_N[1], weights_N[0]))
    always_m = np.where(later, then, first)
    chain = Chain(config)
    loads_Pa = np.array(weights_N) / config.wire.area_m2
    half_m = always_so_m(changed, chain, loads_Pa)
    as_it_is_m = chain.run(changed).model_m
    np.testing.assert_allclose(half_m, 0.5 * (always_m - as_it_is_m), atol=1e-9)
    assert np.abs(half_m[later]).max() > 1e-5 and np.abs(half_m[~later]).max() < 1e-9
    assert not always_so_m(hanging(weights_N[0]), Chain(config), loads_Pa).any()


def test_between_the_loads_of_its_calibration_a_model_is_half_believed_where_a_smooth_curve_says_otherwise(identified):
    logs, result = identified
    config = Config.from_mapping(result.mapping)
    signals = make_experiment(next(log for log in logs if log.metadata["kind"] == "pulses"), config).signals
    loads_N = np.array([0.5, 1.0, 2.0])

    def hanging(load_N):
        load_N = np.full(len(signals.time_s), load_N)
        return dataclasses.replace(signals, load_N=load_N, stress_Pa=load_N / config.wire.area_m2)

    said_m = np.array([Chain(config).run(hanging(load_N)).model_m for load_N in loads_N])
    some = slice(20, None, 50)
    for between_N in (0.7, 1.6, 2.3):
        half_m = always_so_m(hanging(between_N), Chain(config), loads_N / config.wire.area_m2)
        curve_m = [through(loads_N, values, between_N) for values in said_m.T[some]]
        model_m = Chain(config).run(hanging(between_N)).model_m
        np.testing.assert_allclose(half_m[some], 0.5 * (curve_m - model_m[some]), atol=1e-9)
        assert np.abs(half_m).max() > 1e-5
