"""Every effect a model can lack: its closed form, nothing at zero, and the same numbers live as in replay."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sma_actuator.base.calibration import Calibration, HotEndSection, PowerSection, RestSection
from sma_actuator.base.parameters import ConfigError, to_mapping
from sma_actuator.base.signals import Signals
from sma_actuator.config import Config
from sma_actuator.estimation.chain import Chain
from sma_actuator.estimation.effects import EFFECTS, NOT_THE_MODEL, PARTS
from sma_actuator.estimation.effects.frame import TURNED, Frame, Place

#: Parameters that make each effect show.
STRONG = {
    "lead_resistance": {"resistance": 0.2},
    "contact_drift": {"resistance": 0.3, "time_constant": 5.0},
    "voltage_offset": {"offset": 0.02},
    "reference_self_heating": {"coefficient": 0.3, "time_constant": 2.0},
    "sense_resistance": {"change": 0.05},
    "shunt": {"conductance": 0.01},
    "load_cell_drift": {"offset": 0.1, "rate": 0.02},
    "load_cell_gain": {"gain": 0.2},
    "load_cell_nonlinearity": {"bend": 0.1},
    "heat_loss": {"change": 0.3},
    "self_heating": {"temperature_coefficient": 5e-4, "onset": 10.0},
    "ambient_temperature": {"temperature_coefficient": 1e-3, "fading": 50.0},
    "thermal_expansion": {"coefficient": 2e-5},
    "elastic_compliance": {"compliance": 2e-4},
    "fatigue": {"displacement": 2e-4, "cold_share": 0.5, "resistance": 0.004, "exponent": 0.5},
    "creep": {"compliance": 3e-4, "time_constant": 5.0},
    "minor_loop_memory": {"after_heating": 5e-4, "after_cooling": 4e-4, "fading": 0.2, "relaxation_time": 0.3},
    "rate": {"relaxation_time": 0.2},
    "slip": {"length": 3e-4, "time": 7.0},
    "backlash": {"width": 5e-4},
    "reference_lag": {"time_constant": 0.5},
    "reference_gain": {"gain": 0.1},
    "reference_nonlinearity": {"bend": 40.0, "low": 0.2e-3, "high": 4.2e-3},
    "reference_drift": {"offset": 1e-4, "rate": 1e-5},
    "first_pulse_set": {"length": 1e-4},
    "current_feedthrough": {"coupling": 1e-3},
    "channel_delay": {"delay": 0.4},
    "prior_wear": {"displacement": 2e-4, "cold_share": 0.5, "resistance": 0.004},
}
PLACE = Place(
    reference_resistance_Ohm=1.0,
    lead_resistance_Ohm=0.25,
    area_m2=1.82e-8,
    length_m=0.1,
    heat_loss_W_K=5e-3,
    ambient_C=24.0,
    working_range_m=(0.2e-3, 4.2e-3),
)


def signals(n=400, seed=0):
    """A wire that goes through its loop, whole and in part, under a load that wavers; arrays of shape (n,)."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(n) * 0.05
    depth = np.where(time_s % 12.0 < 6.0, 1.0, 0.5)
    resistance = 5.0 * (1.0 + 0.06 * depth * np.cos(time_s * math.pi / 3.0)) + 1e-3 * rng.standard_normal(n)
    power = np.where(np.sin(time_s * math.pi / 3.0) > 0.0, 0.6, 0.013)
    load = 1.0 + 0.2 * np.sin(0.3 * time_s)
    ambient = 24.0 + 0.2 * time_s
    return Signals(
        time_s, resistance, np.sqrt(power / resistance), power, load, load / 1.82e-8, np.full(n, 2e-3), ambient
    )


def sample(arrays, i):
    return Signals(
        *(float(np.broadcast_to(getattr(arrays, f.name), len(arrays.time_s))[i]) for f in dataclasses.fields(Signals))
    )


def build(name, **changes):
    return EFFECTS[name](**{**STRONG[name], **changes})


class Stages:
    """One effect at its stages, with its memory; the strain model between them is given."""

    def __init__(self, effect):
        self.effect, self.state = effect, np.full(effect.STATES, math.nan)

    def act(self, stage, frame):
        if hasattr(self.effect, stage):
            getattr(self.effect, stage)(frame, self.state, PLACE)
        return frame

    def through(self, arrays, displacement_m, start_s=0.0):
        """(measured, after every stage): frames."""
        measured = self.act("measured", Frame.of(arrays, start_s))
        frame = self.act("at_resistance", dataclasses.replace(measured))
        frame.heating, frame.displacement_m = arrays.power_W > 0.1, displacement_m
        return measured, self.act("shown", self.act("at_displacement", frame))


def through(name, arrays, displacement_m=None):
    """(measured, resistance, displacement) after every stage of one effect."""
    displacement_m = np.full(len(arrays.time_s), 2e-3) if displacement_m is None else displacement_m
    measured, frame = Stages(build(name)).through(arrays, displacement_m)
    return measured, frame.resistance_Ohm, frame.displacement_m


def test_the_list_is_complete_and_every_effect_has_a_stage():
    assert set(STRONG) == set(EFFECTS)
    assert list(dict.fromkeys(cls.PART for cls in EFFECTS.values())) == list(PARTS)
    assert NOT_THE_MODEL == ("mechanism", "reference")


@pytest.mark.parametrize("name", EFFECTS)
def test_at_zero_an_effect_changes_nothing(name):
    """The defaults of what is fitted as a size are zero; a lag of a millisecond is none at 20 Hz."""
    arrays = signals()
    displacement = 2e-3 + 1e-3 * np.cos(arrays.time_s)
    measured, frame = Stages(EFFECTS[name]()).through(arrays, displacement.copy())
    np.testing.assert_allclose(frame.resistance_Ohm, arrays.resistance_Ohm, rtol=1e-12)
    np.testing.assert_allclose(measured.load_N, arrays.load_N, rtol=1e-12)
    np.testing.assert_allclose(frame.displacement_m, displacement, rtol=1e-12)
    np.testing.assert_allclose(frame.power_W, measured.power_W, rtol=1e-12)


@pytest.mark.parametrize("name", EFFECTS)
def test_a_strong_effect_shows(name):
    arrays = signals()
    moving = 2e-3 + 1e-3 * np.cos(arrays.time_s)
    measured, frame = Stages(build(name)).through(arrays, moving.copy())
    changed = max(
        np.max(np.abs(frame.resistance_Ohm - arrays.resistance_Ohm)) / 5.0,
        np.max(np.abs(measured.load_N - arrays.load_N)),
        np.max(np.abs(frame.displacement_m - moving)) / 4e-3,
        np.max(np.abs(frame.power_W - measured.power_W)) / 0.6,
    )
    assert changed > 1e-3


@pytest.mark.parametrize("name", [n for n in EFFECTS if EFFECTS[n].PART != "reference"])
def test_live_and_replay_give_the_same_numbers(make_config, name):
    """One sample at a time, as the node does it, and a whole log at once."""
    config = Config.from_mapping(make_config(effects={name: STRONG[name]}))
    arrays = signals()
    chain, whole = Chain(config), Chain(config).run(arrays)
    for i in range(len(arrays.time_s)):
        measured, live = chain.step(sample(arrays, i))
        for field in ("displacement_m", "velocity_m_s", "branch", "quality"):
            assert getattr(live, field) == getattr(whole, field)[i], f"{field} of sample {i}"
        for field in ("resistance_Ohm", "current_A", "power_W", "load_N", "stress_Pa"):
            assert getattr(measured, field) == getattr(whole.signals, field)[i], f"{field} of sample {i}"


@given(st.sampled_from(sorted(EFFECTS)), st.integers(1, 399), st.integers(0, 5))
@settings(max_examples=60, deadline=None)
def test_a_log_cut_in_two_gives_the_same_numbers(name, cut, seed):
    """An effect's memory is all it needs: state carries over from one block to the next."""
    arrays = signals(seed=seed)
    parts = [
        Signals(
            **{
                f.name: np.broadcast_to(getattr(arrays, f.name), len(arrays.time_s))[here]
                for f in dataclasses.fields(Signals)
            }
        )
        for here in (slice(0, cut), slice(cut, None))
    ]
    stages, found = Stages(build(name)), []
    for part in parts:
        _, frame = stages.through(part, 2e-3 + 1e-3 * np.cos(part.time_s))
        found.append((frame.resistance_Ohm, frame.displacement_m))
    _, resistance, displacement = through(name, arrays, 2e-3 + 1e-3 * np.cos(arrays.time_s))
    np.testing.assert_array_equal(np.concatenate([r for r, _ in found]), resistance)
    np.testing.assert_array_equal(np.concatenate([d for _, d in found]), displacement)


# --- closed forms --------------------------------------------------------------------------------


def test_circuit_effects_undo_what_the_circuit_does():
    """What would be measured of a wire of 5 Ω with 0.3 A in it, put right."""
    true_Ohm, current_A = np.full(3, 5.0), np.full(3, 0.3)
    now_s = np.array([0.0, 5.0, 50.0])

    def corrected(name, shown_Ohm, shown_A=current_A):
        s = Signals(
            now_s, shown_Ohm, shown_A, shown_A**2 * shown_Ohm, np.ones(3), np.ones(3), np.ones(3), np.full(3, 24.0)
        )
        return Stages(build(name)).act("measured", Frame.of(s, 0.0))

    np.testing.assert_allclose(corrected("lead_resistance", true_Ohm + 0.2).resistance_Ohm, true_Ohm)
    np.testing.assert_allclose(
        corrected("contact_drift", true_Ohm + 0.3 * (1.0 - np.exp(-now_s / 5.0))).resistance_Ohm, true_Ohm
    )
    np.testing.assert_allclose(corrected("voltage_offset", true_Ohm + 0.02 / current_A).resistance_Ohm, true_Ohm)
    # 0.3 A through 5 Ω beside 0.01 S: the leak takes 5 × 0.01 of what the wire takes.
    total_A = current_A * (1.0 + 5.0 * 0.01)
    found = corrected("shunt", 1.0 / (1.0 / true_Ohm + 0.01), total_A)
    np.testing.assert_allclose(found.resistance_Ohm, true_Ohm)
    np.testing.assert_allclose(found.current_A, current_A)
    # A sense resistor of 1.05 Ω that is taken for 1 Ω: too much current, and too little beside it, the leads too.
    found = corrected("sense_resistance", (true_Ohm + 0.25) / 1.05 - 0.25, 1.05 * current_A)
    np.testing.assert_allclose(found.resistance_Ohm, true_Ohm)
    np.testing.assert_allclose(found.current_A, current_A)
    np.testing.assert_allclose(found.power_W, current_A**2 * true_Ohm)


def test_the_sense_resistor_warms_with_a_lag():
    """V_net/V_ref shows (R + R_lead)/(R_ref(1 + kP)): at a current that stands, the correction is the whole of it at
    once."""
    n = 100
    arrays = Signals(
        np.arange(n) * 0.1,
        np.full(n, 5.0),
        np.full(n, 0.5),
        np.full(n, 1.25),
        np.ones(n),
        np.ones(n),
        np.ones(n),
        np.ones(n),
    )
    found = Stages(build("reference_self_heating")).act("measured", Frame.of(arrays, 0.0))
    np.testing.assert_allclose(found.resistance_Ohm, 5.25 * (1.0 + 0.3 * 0.25) - 0.25)
    np.testing.assert_allclose(found.current_A, 0.5 / (1.0 + 0.3 * 0.25))


def test_load_cell_effects_undo_zero_slope_and_bend():
    arrays = signals()
    drift, _, _ = through("load_cell_drift", arrays)
    np.testing.assert_allclose(drift.load_N, arrays.load_N - 0.1 - 0.02 * arrays.time_s)
    gain, _, _ = through("load_cell_gain", arrays)
    np.testing.assert_allclose(gain.load_N * 1.2, arrays.load_N)
    bend, _, _ = through("load_cell_nonlinearity", arrays)
    np.testing.assert_allclose(bend.load_N + 0.1 * bend.load_N**2, arrays.load_N)


def test_a_load_cell_that_bends_back_shows_no_more_than_its_largest():
    """F − 0.25 F² is 1 N at the most, of 2 N: a load of 3 N cannot be shown, and is no reason to fail."""
    arrays = dataclasses.replace(signals(), load_N=np.full(400, 3.0))
    frame = Stages(build("load_cell_nonlinearity", bend=-0.25)).act("measured", Frame.of(arrays, 0.0))
    assert np.isfinite(frame.load_N).all()


@pytest.mark.parametrize("name", ["load_cell_drift", "reference_drift"])
def test_a_zero_that_moves_may_come_to_rest_as_what_warms_up_does(name):
    """By default it does not."""
    arrays = signals()
    settling, goes_on = (EFFECTS[name](rate=1e-3, **more) for more in ({"time_constant": 3.0}, {}))
    drifts = []
    for effect in (settling, goes_on):
        frame = Frame.of(arrays, 0.0)
        frame.displacement_m = np.zeros(len(arrays.time_s))
        getattr(effect, "shown" if name == "reference_drift" else "measured")(frame, np.empty(0), PLACE)
        drifts.append(frame.displacement_m if name == "reference_drift" else arrays.load_N - frame.load_N)
    np.testing.assert_allclose(drifts[0], 3e-3 * (1.0 - np.exp(-arrays.time_s / 3.0)), atol=1e-15)
    np.testing.assert_allclose(drifts[1], 1e-3 * arrays.time_s, atol=1e-12)


def test_temperature_follows_the_heat_balance():
    """C dT/dt = P − h (T − T_amb) after a step of power: an exponential with the time constant C/h."""
    n, tau, step_W = 200, 2.0, 0.5
    time_s = np.arange(n) * 0.05
    power = np.where(time_s > 0.0, step_W, 0.0)
    arrays = Signals(
        time_s, np.full(n, 5.0), np.full(n, 0.3), power, np.ones(n), np.ones(n), np.ones(n), np.full(n, 24.0)
    )
    _, _, displacement = through("thermal_expansion", arrays)
    rise_K = step_W / 0.006 * (1.0 - np.exp(-time_s / tau))
    np.testing.assert_allclose(displacement - 2e-3, 0.1 * 2e-5 * rise_K, rtol=1e-9, atol=1e-12)
    _, resistance, _ = through("self_heating", arrays)
    np.testing.assert_allclose(resistance, 5.0 / (1.0 + 5e-4 * np.maximum(0.0, rise_K - 10.0)), rtol=1e-9)


def test_a_wire_that_contracts_takes_heat_up_for_that():
    """C dT/dt = P − h (T − T_amb) + Q dX/dt, against steps of a fiftieth of a millisecond."""
    loss_W_K, tau_s, latent_J, fine = 0.006, 2.0, 0.3, 1000
    time_s = np.arange(400) * 0.02
    hot_m, cold_m = PLACE.working_range_m

    def share(t):
        return 0.5 + 0.4 * np.cos(1.3 * t)

    ones = np.ones(len(time_s))
    power_W = 0.2 * ones
    arrays = Signals(time_s, 5.0 * ones, 0.3 * ones, power_W, ones, ones, ones, 24.0 * ones)
    displacement_m = hot_m + (cold_m - hot_m) * share(time_s)
    effect = build("thermal_expansion", heat_loss=loss_W_K, time_constant=tau_s, latent_heat=latent_J)
    _, frame = Stages(effect).through(arrays, displacement_m)
    t = np.arange((len(time_s) - 1) * fine + 1) * (0.02 / fine)
    taken_W = latent_J * np.gradient(share(t), t)
    rise_K = np.empty(len(t))
    rise_K[0] = 0.2 / loss_W_K
    for i in range(1, len(t)):
        rise_K[i] = rise_K[i - 1] + (0.2 + taken_W[i] - loss_W_K * rise_K[i - 1]) / (loss_W_K * tau_s) * (t[1] - t[0])
    assert np.ptp(rise_K) > 10.0
    found_K = (frame.displacement_m - displacement_m) / (PLACE.length_m * 2e-5)
    np.testing.assert_allclose(found_K, rise_K[::fine], atol=0.2)  # a lag over steps of 20 ms

    # Its resistance moves with the same temperature; how far the wire is, it says itself.
    ends = Calibration(
        hot_end=HotEndSection(contracted_stress=(1e6,), contracted_resistance=(4.0,)),
        rest=RestSection(cold_stress=(1e6,), cold_resistance=(5.0,)),
    )
    place = dataclasses.replace(PLACE, stroke=ends)
    frame = Frame.of(dataclasses.replace(arrays, resistance_Ohm=4.0 + share(time_s)), 0.0)
    rises = {"onset": 0.0, "heat_loss": loss_W_K, "time_constant": tau_s, "latent_heat": latent_J}
    warms = build("self_heating", **rises)
    warms.at_resistance(frame, np.full(warms.STATES, math.nan), place)
    found_K = ((4.0 + share(time_s)) / frame.resistance_Ohm - 1.0) / 5e-4
    np.testing.assert_allclose(found_K, np.maximum(rise_K[::fine], 0.0), atol=0.2)


def test_a_wire_that_lags_stretches_at_once_where_it_is_elastic_and_a_sensor_that_lags_does_not():
    time_s = np.arange(200) * 0.01
    load_N = np.where(time_s < 1.0, 1.0, 2.0)
    ones = np.ones(len(time_s))
    arrays = Signals(time_s, 5.0 * ones, 0.3 * ones, 0.1 * ones, load_N, load_N, ones, 24.0 * ones)
    elastic_m = PLACE.length_m / (PLACE.area_m2 * 40e9) * (load_N - 1.0)
    stretched_m = 2e-3 + elastic_m
    just_after = np.searchsorted(time_s, 1.0)
    for name, share in (("rate", 1.0), ("reference_lag", 1.0 - math.exp(-0.01 / 0.2))):
        parameter = {"rate": {"relaxation_time": 0.2}, "reference_lag": {"time_constant": 0.2}}[name]
        _, frame = Stages(build(name, **parameter)).through(arrays, stretched_m)
        np.testing.assert_allclose(frame.displacement_m[just_after] - 2e-3, share * elastic_m[-1], rtol=1e-6)


def test_to_the_calibrations_heat_balance_a_wire_that_loses_more_heat_is_as_warm_as_it_is():
    time_s = np.arange(4000) * 0.002
    power_W = np.where(time_s % 4.0 < 2.0, 0.6, 0.01)
    ones = np.ones(len(time_s))
    arrays = Signals(time_s, 5.0 * ones, 0.3 * ones, power_W, ones, ones, ones, 24.0 * ones)
    tau_s, loss_W_K = 2.0, 0.006
    _, frame = Stages(build("heat_loss")).through(arrays, 2e-3 * ones)
    seen_K = frame.lag(frame.power_W, np.full(2, math.nan), tau_s) / loss_W_K
    is_K = frame.lag(power_W, np.full(2, math.nan), tau_s / 1.3) / (1.3 * loss_W_K)
    np.testing.assert_allclose(seen_K, is_K, atol=0.1)
    assert np.ptp(is_K) > 40.0
    np.testing.assert_array_equal(frame.resistance_Ohm, arrays.resistance_Ohm)


def test_surroundings_that_nobody_logs_warm_the_wire_like_a_current():
    ones = np.ones(10)
    for logged_C, heat_W in ((math.nan, 0.5 + 0.006 * 8.0), (24.0, 0.5)):
        arrays = Signals(np.arange(10.0), 5.0 * ones, 0.3 * ones, 0.5 * ones, ones, ones, ones, logged_C * ones)
        _, frame = Stages(build("ambient_temperature", difference=8.0)).through(arrays, 2e-3 * ones)
        np.testing.assert_allclose(frame.power_W, heat_W)


def test_where_a_sensor_reads_other_air_it_is_as_if_it_read_that_of_the_wire():
    ones = np.ones(10)
    seen = []
    for logged_C, values in ((30.0, {}), (22.0, {"sensor_off": 8.0})):
        arrays = Signals(np.arange(10.0), 5.0 * ones, 0.3 * ones, 0.5 * ones, ones, ones, ones, logged_C * ones)
        _, frame = Stages(build("ambient_temperature", **values)).through(arrays, 2e-3 * ones)
        seen.append((frame.resistance_Ohm, frame.power_W - 0.006 * values.get("sensor_off", 0.0)))
    np.testing.assert_allclose(*seen)


def test_ambient_temperature_acts_in_the_cold():
    n = 10
    cold = Signals(
        np.arange(n) * 1.0,
        np.full(n, 5.0),
        np.full(n, 0.05),
        np.zeros(n),
        np.ones(n),
        np.ones(n),
        np.ones(n),
        np.full(n, 32.0),
    )
    _, resistance, _ = through("ambient_temperature", cold)
    np.testing.assert_allclose(resistance, 5.0 / (1.0 + 1e-3 * 10.0))
    unlogged = dataclasses.replace(cold, ambient_temperature_C=np.full(n, np.nan))
    _, resistance, _ = through("ambient_temperature", unlogged)
    np.testing.assert_allclose(resistance, 5.0 / (1.0 + 1e-3 * (PLACE.ambient_C - 22.0)))


def test_creep_is_a_spring_and_a_damper_in_series_with_the_wire():
    n = 100
    time_s = np.arange(n) * 0.2
    arrays = Signals(
        time_s, np.full(n, 5.0), np.full(n, 0.05), np.zeros(n), np.full(n, 2.0), np.ones(n), np.ones(n), np.ones(n)
    )
    _, _, displacement = through("creep", arrays)
    np.testing.assert_allclose(displacement - 2e-3, 3e-4 * 2.0 * (1.0 - np.exp(-time_s / 5.0)), atol=1e-15)


def test_fatigue_wears_the_hot_end_more_than_the_cold_one():
    """Cycles are counted where the power comes on; the first one is number one."""
    power = np.tile(np.repeat([0.01, 0.6], 5), 4)
    n = len(power)
    arrays = Signals(
        np.arange(n) * 1.0, np.full(n, 5.0), np.full(n, 0.3), power, np.ones(n), np.ones(n), np.ones(n), np.ones(n)
    )
    cycle = np.array([1] * 5 + [2] * 10 + [3] * 10 + [4] * 10 + [5] * 5)
    worn = 2.0 * (np.sqrt(cycle) - 1.0)
    hot_m, cold_m = PLACE.working_range_m
    for place_m, share in ((hot_m, 1.0), (0.5 * (hot_m + cold_m), 0.75), (cold_m, 0.5), (cold_m + 1e-3, 0.5)):
        _, resistance, displacement = through("fatigue", arrays, np.full(n, place_m))
        np.testing.assert_allclose(displacement - place_m, 2e-4 * share * worn, atol=1e-15)
    np.testing.assert_allclose(5.0 / resistance, 1.0 + 0.004 * worn, rtol=1e-12)
    logarithm = Stages(build("fatigue", exponent=0.0, cold_share=1.0)).through(arrays, np.full(n, 2e-3))[1]
    np.testing.assert_allclose(logarithm.displacement_m - 2e-3, 2e-4 * np.log(cycle), atol=1e-15)


def test_wear_of_before_moves_the_hot_end_more_than_the_cold_one_from_the_first_reading():
    n = 6
    arrays = Signals(
        np.arange(n) * 1.0, np.full(n, 5.0), *(np.full(n, x) for x in (0.3, 0.6)), *(np.ones(n) for _ in range(4))
    )
    hot_m, cold_m = PLACE.working_range_m
    for place_m, share in ((hot_m, 1.0), (0.5 * (hot_m + cold_m), 0.75), (cold_m, 0.5)):
        _, resistance, displacement = through("prior_wear", arrays, np.full(n, place_m))
        np.testing.assert_allclose(displacement - place_m, 2e-4 * share, atol=1e-15)
        np.testing.assert_allclose(5.0 / resistance, 1.004, rtol=1e-12)


def turned_half_way(**changes):
    """Shift of a heating that stops half-way, and of the cooling that follows it, 100 samples each, a second apart."""
    half = np.concatenate((np.linspace(4.2e-3, 2.2e-3, 100), np.linspace(2.2e-3, 4.2e-3, 100)))
    n = len(half)
    frame = Frame.of(Signals(np.arange(n) * 1.0, *(np.ones(n) for _ in range(7))), 0.0)
    frame.heating, frame.displacement_m = np.arange(n) < 100, half.copy()
    effect = build("minor_loop_memory", **{"fading": 0.0, "relaxation_time": 0.0, **changes})
    return half, Stages(effect).act("at_displacement", frame).displacement_m - half


def test_what_turned_back_early_shifts_the_next_branch():
    """A heating that stopped half-way shifts the cooling by half of ``after_heating``, once it has begun; a complete
    one by nothing."""
    half, shift = turned_half_way()
    assert np.all(shift[:101] == 0.0) and np.all(np.diff(shift[100:]) > -1e-15)
    begun = np.flatnonzero(half[100:] - half[100] > 2.0 * TURNED * 4e-3)[0]  # of a stroke of 4 mm
    np.testing.assert_allclose(shift[100 + begun :], 0.5 * 5e-4)


def test_a_wire_has_turned_where_its_resistance_goes_back_and_not_where_the_current_is_switched():
    """Between the two it crosses its hysteresis: the model's displacement may stand longer than that, the flag turns
    too soon."""
    place = dataclasses.replace(PLACE, resistance_range_Ohm=0.5)
    heating = np.arange(60) < 20
    resistance = np.interp(np.arange(60), (0, 20, 40, 59), (5.0, 4.75, 4.75, 4.9))
    frame = Frame.of(Signals(np.arange(60) * 1.0, resistance, *(np.ones(60) for _ in range(6))), 0.0)
    frame.heating, frame.displacement_m = heating, np.full(60, 2.2e-3)
    effect = build("minor_loop_memory", fading=0.0, relaxation_time=0.0)
    effect.at_displacement(frame, np.full(effect.STATES, math.nan), place)
    shift = frame.displacement_m - 2.2e-3
    assert np.all(shift[:41] == 0.0)
    back = resistance - 4.75 > 2.0 * TURNED * 0.5
    np.testing.assert_allclose(shift[41:][back[41:]], 0.5 * 5e-4)


def test_a_branch_that_is_completed_has_forgotten_how_the_last_one_turned():
    """On the last fifth of the stroke the shift goes in proportion to what there is still to go."""
    half, shift = turned_half_way(fading=0.2)
    to_go = (4.2e-3 - half[150:]) / 4e-3
    np.testing.assert_allclose(shift[150:], 0.5 * 5e-4 * np.clip(to_go / 0.2, 0.0, 1.0), atol=1e-12)
    assert shift[-1] == pytest.approx(0.0, abs=1e-12)


def test_the_shift_of_a_turn_comes_slowly():
    _, sudden = turned_half_way()
    _, slow = turned_half_way(relaxation_time=20.0)
    assert slow[130] < 0.8 * sudden[130] and slow[-1] == pytest.approx(
        sudden[-1] * (1.0 - math.exp(-96 / 20.0)), rel=0.02
    )


def test_how_far_a_branch_went_is_measured_on_the_stroke_of_its_own_load():
    """Where the calibration knows the ends of the stroke by stress, a light load's short stroke is a whole one."""
    known = Calibration(
        rest=RestSection(cold_stress=(2e7, 6e7), cold_displacement=(2.2e-3, 4.2e-3)),
        hot_end=HotEndSection(contracted_stress=(2e7, 6e7), contracted_displacement=(0.2e-3, 0.2e-3)),
        power=PowerSection(
            transformation_heating=(60.0, 70.0),
            transformation_cooling=(40.0, 50.0),
            transformation_shift=(1e-7, 1e-7),
            latent_rise=30.0,
        ),
    )
    assert known.transformation_known
    place = dataclasses.replace(PLACE, stroke=known)
    n = 5
    frame = Frame.of(Signals(np.arange(n) * 1.0, *(np.ones(n) for _ in range(7))), 0.0)
    frame.displacement_m = np.full(n, 2.2e-3)
    frame.load_N = np.array([2e7, 3e7, 4e7, 6e7, 6e7]) * PLACE.area_m2
    np.testing.assert_allclose(place.share_of_stroke(frame), [1.0, 0.8, 2.0 / 3.0, 0.5, 0.5])
    np.testing.assert_allclose(PLACE.share_of_stroke(frame), 0.5)


def test_backlash_is_the_play_operator():
    there_and_back = np.concatenate((np.linspace(0.0, 1e-3, 101), np.linspace(1e-3, 0.0, 101)))
    n = len(there_and_back)
    arrays = Signals(np.arange(n) * 0.1, *(np.ones(n) for _ in range(7)))
    _, _, joint = through("backlash", arrays, there_and_back.copy())
    assert joint[100] == pytest.approx(1e-3 - 0.25e-3)  # it trails by half the width …
    assert joint[100 + 40] == pytest.approx(joint[100])  # … waits while the play is taken up …
    assert joint[-1] == pytest.approx(0.25e-3)  # … and trails on the other side


def test_slip_and_reference_effects():
    arrays = signals()
    moving = 2e-3 + 1e-3 * np.cos(arrays.time_s)
    np.testing.assert_allclose(
        through("slip", arrays, moving.copy())[2] - moving, 3e-4 * (arrays.time_s >= 7.0), atol=1e-18
    )
    np.testing.assert_allclose(through("reference_gain", arrays, moving.copy())[2], 1.1 * moving)
    np.testing.assert_allclose(
        through("reference_drift", arrays, moving.copy())[2] - moving, 1e-4 + 1e-5 * arrays.time_s, atol=1e-18
    )
    step = np.where(arrays.time_s > 0.0, 1e-3, 0.0)
    np.testing.assert_allclose(
        through("reference_lag", arrays, step)[2], 1e-3 * (1.0 - np.exp(-arrays.time_s / 0.5)), atol=1e-15
    )


def test_a_late_channel_shows_what_was_and_an_early_one_what_will_be():
    arrays = signals()
    moving = np.cos(arrays.time_s)
    for delay_s, rows in ((0.4, slice(8, None)), (-0.4, slice(None, -8))):
        _, frame = Stages(build("channel_delay", delay=delay_s)).through(arrays, moving.copy())
        np.testing.assert_allclose(frame.displacement_m[rows], np.cos(arrays.time_s - delay_s)[rows], atol=1e-9)
    unknown = np.where(np.arange(400) == 200, np.nan, moving)  # what the chain drops hides nothing else
    _, frame = Stages(build("channel_delay")).through(arrays, unknown)
    assert np.flatnonzero(np.isnan(frame.displacement_m)).tolist() == [200]


def test_what_feeds_through_goes_with_the_current():
    arrays = signals()
    _, _, shown_m = through("current_feedthrough", arrays, np.zeros(400))
    np.testing.assert_allclose(shown_m, 1e-3 * arrays.current_A)


def test_a_set_comes_with_what_is_transformed_for_the_first_time():
    effect = Stages(build("first_pulse_set"))
    arrays = signals(n=5)
    hot_m, cold_m = PLACE.working_range_m
    shares = np.array([1.0, 0.5, 0.8, 0.0, 1.0])
    _, frame = effect.through(arrays, hot_m + (cold_m - hot_m) * shares)
    left = (frame.displacement_m - hot_m) / 1e-4 - (cold_m - hot_m) / 1e-4 * shares
    np.testing.assert_allclose(left, [0.0, 0.5, 0.5, 1.0, 1.0], atol=1e-9)
    _, frame = effect.through(arrays, np.full(5, cold_m))  # the next log of the session
    np.testing.assert_allclose(frame.displacement_m, cold_m + 1e-4)


# --- the section of a parameter file -------------------------------------------------------------


def test_effects_come_back_from_the_file_as_they_were(make_config):
    mapping = make_config(
        effects={"order": ["creep", "slip"], "history": ["x"], "creep": STRONG["creep"], "slip": STRONG["slip"]}
    )
    config = Config.from_mapping(mapping)
    assert list(config.effects.active) == ["creep", "slip"]
    assert to_mapping(config.effects) == mapping["effects"]
    assert Config.from_mapping(config.to_mapping()) == config


@pytest.mark.parametrize(
    ("effects", "said"),
    [
        ({"slipp": {}}, "effects.slipp: no such effect"),
        ({"reference_lag": {"time_constant": 0.1}}, "fault of the reference sensor and no part of a model"),
        ({"creep": {"compliance": "much"}}, "effects.creep.compliance"),
        ({"creep": {"complianze": 1e-4}}, "effects.creep.complianze"),
        ({"lead_resistance": {"resistance": 1e6}}, "effects.lead_resistance.resistance"),
        ({"order": ["slip"], "creep": STRONG["creep"]}, "effects.order"),
        (["creep"], "effects: a section"),
    ],
)
def test_a_wrong_section_is_refused_by_name(make_config, effects, said):
    mapping = make_config()
    mapping["effects"] = effects
    with pytest.raises(ConfigError, match=said):
        Config.from_mapping(mapping)
