"""Tracing: what is hidden in a session is found, nothing is found where nothing is, and what has no name stays
without."""

import dataclasses
import math
from types import SimpleNamespace

import numpy as np
import pytest
from sessions import session

from sma_actuator.base.calibration import TrainingSection
from sma_actuator.base.parameters import parameter
from sma_actuator.base.signals import Signals
from sma_actuator.bench import TWINS, Spring, Weight
from sma_actuator.config import Config
from sma_actuator.diagnosis.selection import Entry
from sma_actuator.diagnosis.trace import Evidence, race, trace
from sma_actuator.diagnosis.trace.analysis import quantities
from sma_actuator.diagnosis.trace.candidates import candidate, scales_of, untestable
from sma_actuator.diagnosis.trace.evidence import limited
from sma_actuator.diagnosis.trace.experiments import best_experiment
from sma_actuator.diagnosis.trace.fitting import fit
from sma_actuator.diagnosis.trace.following import Where, smooth
from sma_actuator.diagnosis.trace.report import sentence, summary
from sma_actuator.diagnosis.trace.why import whys
from sma_actuator.estimation.chain import Chain
from sma_actuator.estimation.effects import EFFECTS, QUANTITIES, STAGES, Effect
from sma_actuator.estimation.effects.frame import Frame
from sma_actuator.estimation.effects.free import size
from sma_actuator.logs.bench_log import BenchLog
from sma_actuator.logs.errors import BenchLogError


@pytest.fixture(scope="module")
def config(wire):
    return Config.from_mapping(wire[1])


@pytest.fixture(scope="module")
def clean(wire, config):
    return Evidence(session(wire[0]), config)


def limited_by(monkeypatch, **limits):
    """Decide by other limits, until the end of a test."""
    monkeypatch.setattr(race, "LIMITS", dataclasses.replace(race.LIMITS, **limits))


def traced(wire, config, hidden, **options):
    return trace(Evidence(session(wire[0], hidden, **options), config), jobs=1)


def test_an_expectation_that_does_not_hold_where_it_was_not_fitted_is_none(config):
    """Three loads do not say what the model leaves at a fourth; what is then expected would raise the floor by two
    thirds."""
    assert not any(config.calibration.expectation.expected_weights)
    assert config.calibration.expectation.floor < 1.1 * config.calibration.error


def test_where_nothing_is_hidden_nothing_is_found(clean):
    found = trace(clean, jobs=1)
    assert found.verdict == "none" and found.fit is None


@pytest.mark.parametrize(
    ("hidden", "parameter", "value"),
    [
        ({"voltage_offset": 0.004}, "offset", 0.004),
        pytest.param({"slip": 2e-4}, "length", 2e-4, marks=pytest.mark.long),
        pytest.param({"backlash": 2.5e-4}, "width", 2.5e-4, marks=pytest.mark.long),
        pytest.param({"elastic_compliance": 1e-4}, "compliance", 1e-4, marks=pytest.mark.long),
        pytest.param({"load_cell_gain": 0.3}, "gain", 0.3, marks=pytest.mark.long),
    ],
    ids=lambda x: next(iter(x)) if isinstance(x, dict) else "",
)
def test_what_is_hidden_is_named_first_and_its_size_found(wire, config, hidden, parameter, value):
    (name,) = hidden
    found = traced(wire, config, hidden)
    assert found.verdict == "traced"
    assert found.fit.names[0] == name
    assert found.fit.values[name][parameter] == pytest.approx(value, rel=0.25)
    assert found.errors_percent["after"].mean() < 0.6 * found.errors_percent["before"].mean()


@pytest.mark.long
def test_what_might_as_well_be_nothing_is_named_only_where_the_name_explains_all_of_it(
    wire, config, clean, monkeypatch
):
    """Below the gate an error is real where a name takes all the news away, and has its signature; else nothing is
    missing."""
    limited_by(monkeypatch, gate=1000.0)
    found = traced(wire, config, {"backlash": 2.5e-4})
    assert found.verdict == "traced" and found.fit.names == ("backlash",)
    assert "it could be nothing" in sentence(found, {}, [])
    assert traced(wire, config, {"hum": 1.5e-4}).verdict == "none"
    limited_by(monkeypatch, hint=0.0)
    assert trace(clean, jobs=1).verdict == "none"


@pytest.mark.long
def test_however_small_the_error_a_rest_that_does_not_repeat_says_that_something_happened(
    wire, config, clean, monkeypatch
):
    """A zero error of the voltage moves the resistance at the bias current by far more than it ever scatters."""
    limited_by(monkeypatch, hint=1000.0)
    limited_by(monkeypatch, gate=1000.0)
    found = traced(wire, config, {"voltage_offset": 1.5e-3})
    assert found.witnesses["before"]["resistance at cold rest"] > race.LIMITS.certain_deviation
    assert found.verdict == "traced" and found.fit.names == ("voltage_offset",)
    assert "it could be nothing; resistance at cold rest could not" in sentence(found, {}, [])
    limited_by(monkeypatch, certain_deviation=100.0)
    assert traced(wire, config, {"voltage_offset": 1.5e-3}).verdict == "none"
    assert max(trace(clean, jobs=1).witnesses["before"].values()) < 0.7 * 3.0


@pytest.mark.long
def test_two_effects_are_both_found(wire, config):
    found = traced(wire, config, {"slip": 2e-4, "voltage_offset": 0.004})
    assert found.verdict == "traced"
    assert set(found.fit.names) == {"slip", "voltage_offset"}


@pytest.mark.parametrize(
    "hidden",
    [{"hum": 1.5e-4}, pytest.param({"contact_bounce": 0.06}, marks=pytest.mark.long)],
    ids=lambda h: next(iter(h)),
)
def test_what_has_no_name_stays_without(wire, config, hidden):
    assert traced(wire, config, hidden).verdict == "unexplained"


def test_a_name_needs_its_signature_however_well_it_fits(wire, config, monkeypatch):
    """A lead moves R at rest, cold and hot, and not δ; a slip does the opposite, so it is not the name, whatever it
    mends."""
    evidence = Evidence(session(wire[0], {"lead_resistance": 0.03}), config)
    limited_by(monkeypatch, most_loss=100.0)  # any residual will do
    right, wrong = (trace(evidence, only=[name], jobs=1) for name in ("lead_resistance", "slip"))
    assert right.verdict == "traced" and not right.unusual
    assert (
        right.witnesses["before"]["resistance at cold rest"]
        > 4.0
        > 2.0
        > right.witnesses["after"]["resistance at cold rest"]
    )
    assert wrong.verdict == "unexplained"
    assert {"resistance at cold rest", "displacement at cold rest"} <= set(wrong.unusual)


def test_a_hot_rest_counts_though_the_wire_is_not_quite_as_hot_as_at_the_calibration(wire, config):
    """Its resistance is lower then, by what the calibration knows of a contracted wire; that is no news, and a lead
    is."""
    off = {}
    for hidden in ({}, {"lead_resistance": 0.03}):
        evidence = Evidence(session(wire[0], hidden, heat=0.85), config)
        every = np.ones(evidence.units, dtype=bool)
        off[len(hidden)] = evidence.witnesses(evidence.residual({}), every)["resistance at hot rest"]
    assert 0.0 < off[0] < 1.0 and off[1] > off[0] + 1.0


def test_a_spring_tells_a_drifting_sensor_from_a_creeping_wire(wire, config):
    """Its load follows the wire; so a line that bends is the sensor's, and one that is straight is not."""
    hidden = {"reference_drift": 2.5e-4}
    evidence = Evidence(session(wire[0], hidden, load=Spring(300.0, 0.5)), config)
    right, wrong = (trace(evidence, only=[name], jobs=1) for name in ("reference_drift", "creep"))
    line = "load against displacement"
    assert right.witnesses["before"][line] > 3.0 > 0.5 > right.witnesses["after"][line]
    assert line in wrong.unusual and line not in right.unusual


def test_the_power_to_transform_tells_a_changed_heat_loss_from_a_wire_whose_resistance_rises_more(wire, config):
    """The wire that warms more takes the same power."""
    power = "power in the transformation"
    evidence = Evidence(session(wire[0], {"heat_loss": -0.3}), config)
    right, wrong = (trace(evidence, only=[name], jobs=1) for name in ("heat_loss", "self_heating"))
    assert right.fit.values["heat_loss"]["change"] == pytest.approx(-0.3, abs=0.08)
    assert right.witnesses["before"][power] > 2.5 and power not in right.unusual and power in wrong.unusual


@pytest.mark.parametrize(("seed", "warmer_K"), [(5, 10.0), (6, 10.0), (7, -10.0), (8, 10.0)])
def test_the_power_to_transform_tells_it_from_surroundings_of_another_temperature_that_nobody_logged(
    wire, config, seed, warmer_K
):
    power = "power in the transformation"
    logs = session(wire[0], {"ambient_temperature": warmer_K}, seed=seed)
    unlogged = [
        dataclasses.replace(log, columns={k: v for k, v in log.columns.items() if k != "ambient_temperature_C"})
        for log in logs
    ]
    evidence = Evidence(unlogged, config)
    found, wrong = (trace(evidence, only=[name], jobs=1) for name in ("ambient_temperature", "heat_loss"))
    assert found.fit.values["ambient_temperature"]["difference"] == pytest.approx(warmer_K, abs=3.0)
    assert not found.unusual and wrong.unusual
    # colder ones take more power too: then only what is left over it speaks against another heat loss
    if warmer_K > 0.0:
        assert {power, "resistance at cold rest"} <= set(wrong.unusual)


def test_a_slip_is_no_drift_however_much_a_drift_mends(wire, config):
    evidence = Evidence(session(wire[0], {"slip": 4e-4}), config)
    right, wrong = (trace(evidence, only=[name], jobs=1) for name in ("slip", "reference_drift"))
    assert "the trend over time [s]" in wrong.unusual and "the trend over time [s]" not in right.unusual


def test_a_relative_of_the_true_effect_leaves_what_the_two_differ_by(clean, monkeypatch):
    """Where the calibration lets expect what the model always leaves, a name leaves no trend over any quantity."""
    trial = race.Work(clean, np.ones(clean.units, dtype=bool))(
        Entry((candidate("thermal_expansion", scales_of(clean)),), None)
    )
    places = quantities(clean, clean.predict({}))
    judge = race.Judge(
        clean, 3.0 * trial.fit.held_out_rows, trial.losses, 1.0, 2.0, np.ones(clean.units, dtype=bool), {}, places
    )
    judge = dataclasses.replace(judge, witnesses=clean.witnesses(trial.fit.held_out_rows, judge.train))
    long = places["displacement_m"] > np.median(places["displacement_m"])
    rows = 0.1 * trial.fit.held_out_rows
    rows[: clean.rows_of_samples] += np.where(long, 1.2, -1.2) * clean.sample_weight
    differing = dataclasses.replace(trial, fit=dataclasses.replace(trial.fit, held_out_rows=rows))
    trend = f"the trend over {QUANTITIES['displacement_m']}"
    for expected in (False, True):
        monkeypatch.setattr(Evidence, "expects_what_repeats", expected)
        assert (trend in judge.unusual(differing)) is expected


def test_a_name_is_not_given_where_another_takes_much_off_beside_it(wire, config, monkeypatch):
    """What a relative of the true effect leaves is small, but has a shape, and some candidate has that.

    Here it is what the model always leaves: nothing of that is expected of this wire, so it is taken for no such sign.
    """
    evidence = Evidence(session(wire[0], {"elastic_compliance": 1e-4}), config)
    limited_by(monkeypatch, trend_elsewhere=math.inf)
    monkeypatch.setattr(Evidence, "expects_what_repeats", True)
    limited_by(monkeypatch, most_beside=0.0)
    found = trace(evidence, jobs=1)
    assert found.verdict == "unexplained" and found.fit.names == ("elastic_compliance",) and not found.unusual
    further, share = found.beside
    said = sentence(found, {}, [])
    assert (
        f"elastic_compliance would leave nothing unusual, but {further} beside that would take off {share:.0%} more"
        in said
    )
    limited_by(monkeypatch, most_beside=1.5 * share)
    assert trace(evidence, jobs=1).verdict == "traced"
    limited_by(monkeypatch, most_beside=0.5 * share)
    monkeypatch.setattr(Evidence, "expects_what_repeats", False)
    assert trace(evidence, jobs=1).verdict == "traced"


def test_an_effect_at_the_end_where_it_is_another_has_no_name(wire, config):
    """A drift at once is a lead, a creep at once a compliance, and a wear that takes no stroke a creep."""
    for hidden, imitator, ends in (
        ({"lead_resistance": 0.03}, "contact_drift", ("time_constant",)),
        ({"elastic_compliance": 1e-4}, "creep", ("time_constant",)),
        ({"creep": 8e-5}, "fatigue", ("cold_share", "resistance")),
    ):
        evidence = Evidence(session(wire[0], hidden), config)
        train = np.ones(evidence.units, dtype=bool)
        found = fit(evidence, [candidate(imitator, scales_of(evidence))], train)
        assert found.at_bound == tuple(f"{imitator}.{end}" for end in ends)


def test_a_fault_of_the_reference_is_not_put_into_the_model(wire, config):
    """A gain of the sensor: the set that fits alike holds it, and it lies outside the model."""
    found = traced(wire, config, {"reference_drift": 2.5e-4})
    assert found.verdict == "traced"
    assert "reference_drift" in (*found.fit.names, *found.alternatives)


def test_without_a_sense_resistor_it_does_not_compete(clean):
    """As where a log from elsewhere has its current measured: how far it may warm would not be a number."""
    scales = dataclasses.replace(scales_of(clean), sense_Ohm=math.nan)
    reasons = untestable(list(EFFECTS), scales)
    assert "sense resistor" in reasons["reference_self_heating"]
    for name in set(EFFECTS) - set(reasons):
        assert not any(math.isnan(v) for f in candidate(name, scales).free for v in (f.low, f.high, f.typical)), name


def test_what_the_log_could_not_show_is_untestable_never_absent(wire, config):
    found = traced(wire, config, {"voltage_offset": 0.004}, load=Weight(0.98))
    assert "one load" in found.untestable["elastic_compliance"]
    assert "ambient" in found.untestable["ambient_temperature"]


def test_an_effect_that_no_bench_can_hide_competes_like_any_other(wire, config, monkeypatch):
    """Whoever brings one may trace real logs with it; its twin is what a trial wants."""

    @dataclasses.dataclass(frozen=True)
    class Scale(Effect):
        """The display is wrong in proportion."""

        PART, WORDS, REMEDY, TELL_TALE = "reference", "the scale is wrong", "Turn it.", "displacement_m"
        gain: float = parameter(0.0, "too much", "1", -1.0, 1.0)

        def shown(self, frame, state, place):
            frame.displacement_m = frame.displacement_m * (1.0 + self.gain)

        @classmethod
        def free(cls, scales):
            return [size("gain", 0.5, 0.03)]

    monkeypatch.setattr(EFFECTS, "_parts", dict(EFFECTS.registered))
    EFFECTS.register("scale")(Scale)
    assert "scale" not in TWINS
    found = trace(Evidence(session(wire[0], {"reference_gain": 0.1}), config), only=["scale"], jobs=1)
    assert found.fit.values["scale"]["gain"] == pytest.approx(0.1, rel=0.2)


def test_rerunning_gives_the_same_answer(wire, config):
    logs = session(wire[0], {"voltage_offset": 0.004}, logs=1)
    a, b = (trace(Evidence(logs, config), jobs=jobs) for jobs in (1, 2))
    assert a.fit.values == b.fit.values and a.fit.names == b.fit.names
    np.testing.assert_array_equal(a.fit.held_out, b.fit.held_out)


# --- the evidence --------------------------------------------------------------------------------


@pytest.mark.parametrize("name", EFFECTS)
def test_a_candidate_goes_through_the_whole_recursion_as_in_the_node(clean, config, name):
    """What the race judges is what an extended model would estimate: the same numbers, sample by sample."""
    c = candidate(name, scales_of(clean))
    values = {f.name: f.starts[0] if f.starts else 0.3 * f.typical for f in c.free}
    effect = c.build({**values, **({"time": 40.0} if name == "slip" else {})})
    predictions = clean.predict({name: effect})
    chain = Chain(config, {name: effect})
    for trace_, p in zip(clean.logs.experiments, predictions, strict=True):
        live = []
        for i in range(len(trace_.log)):
            values = {f.name: getattr(trace_.signals, f.name) for f in dataclasses.fields(Signals)}
            sample = {name: float(v[i]) if np.ndim(v) else v for name, v in values.items()}
            live.append(chain.step(Signals(**sample))[1].displacement_m)
        if EFFECTS[name].PART == "reference":
            np.testing.assert_array_equal(p.model_m, live)
        else:
            np.testing.assert_array_equal(p.shown_m, live)
        chain.reset()  # the next log of the session


def test_every_quantity_that_may_give_an_effect_away_is_looked_at(clean):
    """A tell-tale is refused at registration where it is none of these; here none of these is missing."""
    found = quantities(clean, clean.predict({}))
    assert set(QUANTITIES) - {"ambient_temperature_C"} <= set(found) <= set(QUANTITIES)  # not logged here


def test_large_residuals_count_linearly():
    z = np.array([0.0, 1.0, race.LIMITS.linear_from, 2.0 * race.LIMITS.linear_from, np.nan, -np.inf])
    loss = 0.5 * limited(z) ** 2
    assert loss[:3] == pytest.approx(0.5 * z[:3] ** 2)
    assert loss[3] == pytest.approx(
        race.LIMITS.linear_from * (2.0 * race.LIMITS.linear_from - 0.5 * race.LIMITS.linear_from)
    )
    assert np.isfinite(loss).all() and loss[4] == loss[5] > loss[3]


@pytest.mark.parametrize("change", [-0.35, -0.5])
def test_a_large_effect_is_fitted_though_a_small_one_is_worse_than_none(wire, config, change):
    """A hot rest counts where the wire takes about the power that it took: a heat loss a tenth less brings these
    there."""
    evidence = Evidence(session(wire[0], {"heat_loss": change}), config)
    found = fit(evidence, [candidate("heat_loss", scales_of(evidence))], np.ones(evidence.units, dtype=bool))
    assert found.values["heat_loss"]["change"] == pytest.approx(change, abs=0.03)


def test_no_other_time_of_a_slip_explains_more(wire, config):
    evidence = Evidence(session(wire[0], {"slip": 4e-5}, seed=2), config)
    slip = candidate("slip", scales_of(evidence))
    found = fit(evidence, [slip], np.ones(evidence.units, dtype=bool))
    length, time_s = found.values["slip"]["length"], found.values["slip"]["time"]
    others = [{"length": length, "time": time_s + later_s} for later_s in np.arange(-12.0, 12.0, 0.8)]
    left = [float(evidence.losses(evidence.residual({"slip": slip.build(values)})).mean()) for values in others]
    assert float(found.losses.mean()) < 1.02 * min(left)


def test_held_out_cycles_are_not_in_the_fit(clean):
    """An effect that is not there gains nothing on cycles it has not seen, however many parameters it has."""
    train = np.arange(clean.units) < clean.units - 3
    base = clean.losses(clean.residual({}))
    for name in ("fatigue", "minor_loop_memory", "self_heating"):
        found = fit(clean, [candidate(name, scales_of(clean))], train)
        gain = (base - found.held_out)[train]
        assert gain.mean() < 2.5 * gain.std(ddof=1) / np.sqrt(len(gain)) + 0.1 * base.mean()


@pytest.mark.parametrize(
    ("name", "parameters"), [("backlash", {"width": 5e-4}), ("reference_lag", {"time_constant": 0.5})]
)
def test_what_follows_the_wire_follows_it_and_not_the_model(clean, monkeypatch, name, parameters):
    """Play and lag of the true displacement are no news where the model's known error goes through them, too."""
    effect = EFFECTS[name](**parameters)

    class KnownError:
        """A wire that is a tenth shorter than its model says."""

        @staticmethod
        def residual_m(found, rows, ambient_counts):
            return -0.1 * found.model_m[rows]

    monkeypatch.setattr(clean.of_displacement, "expectation", KnownError)
    followed_m = []
    for found, kept in clean._judgements(clean.chain({})):
        frame = Frame.of(found.signals, float(found.signals.time_s[0]))
        true_m = 0.9 * found.model_m
        # Between wire and load there is no noise of the resistance, which tells the model where the wire is.
        noise_m = true_m - smooth(true_m, _period_s(found)) if effect.BEHIND_THE_LOAD else 0.0
        frame.displacement_m = true_m - noise_m
        stage = next(s for s in STAGES if hasattr(effect, s))
        getattr(effect, stage)(frame, np.full(effect.STATES, np.nan), clean.place)
        followed_m.append((frame.displacement_m + noise_m)[kept])
    monkeypatch.setattr(clean.logs, "measured_m", followed_m)
    after, without = clean.predict({name: effect}), clean.predict({})
    of_the_model = [dataclasses.replace(a, expected_m=b.expected_m) for a, b in zip(after, without, strict=True)]
    whole, alone, nothing = (clean.news_percent(p).mean() for p in (after, of_the_model, without))
    # What is expected is known at the readings compared, with straight lines between them.
    assert whole < 0.5 * alone < 0.2 * nothing


def test_a_wire_at_rest_leaves_the_play_as_it_is(clean):
    """Where the wire is, the resistance tells; its noise does not take the play up."""
    chain = clean.chain({"backlash": EFFECTS["backlash"](width=1e-4)})
    for found, _ in clean._judgements(chain):
        quiet = dataclasses.replace(found, model_m=smooth(found.model_m, _period_s(found)))
        of_wire_m, of_model_m = (
            Where(chain, clean.place, f, np.zeros(len(f.model_m))).beyond_the_load_m() for f in (quiet, found)
        )
        assert np.abs(of_model_m - of_wire_m).mean() < 0.025 * 1e-4


def _period_s(found):
    return float(np.median(np.diff(found.time_s)))


def test_a_wire_that_changed_while_it_was_calibrated_is_said_to_have(wire, config, clean):
    calibration = dataclasses.replace(
        config.calibration, training=TrainingSection(changed=0.02 * config.wire.full_stroke_m)
    )
    evidence = Evidence(session(wire[0]), dataclasses.replace(config, calibration=calibration))
    # A quarter of that, less at the cold end, is what its training alone has brought since the mean of the calibration
    # …
    longer = [(a.expected_m - b.expected_m) for a, b in zip(evidence.predict({}), clean.predict({}), strict=True)]
    longer_percent = np.concatenate(longer) / config.wire.full_stroke_m * 100
    assert 0.15 < longer_percent.min() < 0.25 and 0.45 < longer_percent.max() <= 0.5
    # … and half of that may be wrong.
    assert np.hypot(clean.floor_percent, 0.1) < evidence.floor_percent < np.hypot(clean.floor_percent, 0.25)
    found = trace(evidence, jobs=1)
    assert "hot end moved by 2.0 %" in summary(evidence, found)["sentence"]
    assert "Train it first" in summary(evidence, found)["sentence"]
    assert "Train it first" not in summary(clean, found)["sentence"]


@pytest.mark.parametrize(
    ("names", "end"),
    (
        (("lead_resistance",), "Look at leads, contacts and channels. The extended model allows for it."),
        (("voltage_offset", "rate"), "Look at leads, contacts and channels. The extended model allows for them."),
        (("slip",), "Look at the crimps and the joint. The model is left alone."),
        (("fatigue", "slip"), "The extended model allows for fatigue, and leaves slip alone."),
    ),
)
def test_the_sentence_says_what_to_do_and_what_the_model_does_once(names, end):
    found = SimpleNamespace(
        verdict="traced",
        gate_percent=1.0,
        fit=SimpleNamespace(names=names),
        news_percent={"before": np.array([3.0]), "after": np.array([0.6])},
        witnesses={"before": {}, "after": {}},
        rounds=[],
    )
    other = {
        "name": "creep",
        "instead_of": names[-1],
        "confidence": 0.3,
        "experiment": {"what": "rest cold for an hour"},
    }
    said = sentence(found, {}, [other])
    assert said.endswith(end)
    assert said.count("model") == 1
    instead = "It could as well be creep." if len(names) == 1 else f"Instead of {names[-1]} it could as well be creep."
    assert f"{instead} To tell: rest cold for an hour." in said
    said = sentence(found, {}, [{**other, "confidence": 0.0}])
    assert "Less well, but leaving nothing unusual either, creep explains it" in said and "as well be" not in said


def test_the_proposed_experiment_tells_two_explanations_apart(clean):
    """Creep and slip after the same session: a long rest in the cold shows which."""
    first = {"creep": EFFECTS["creep"](compliance=2e-4, time_constant=200.0)}
    second = {"slip": EFFECTS["slip"](length=1e-4, time=1.0)}
    found = best_experiment(clean, first, second)
    assert found.difference_m > 0.01 * clean.full_stroke_m
    assert found.duration_s > 0.0


def test_logs_with_clocks_of_their_own_are_sessions_of_their_own(wire, config):
    logs = session(wire[0])
    restarted = [
        dataclasses.replace(log, columns={**log.columns, "time_s": log["time_s"] - log["time_s"][0]}) for log in logs
    ]
    assert Evidence(logs, config).logs.one_session
    assert not Evidence(restarted, config).logs.one_session


# --- bad input -----------------------------------------------------------------------------------


def changed(log, **columns):
    return BenchLog({k: v for k, v in {**log.columns, **columns}.items() if v is not None}, log.metadata, log.source)


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda log: changed(log, lvdt_current_A=None), "displacement"),
        (lambda log: log.slice(0, 120), "shorter than a cycle|never moves"),
        (lambda log: changed(log, lvdt_current_A=np.full(len(log), 0.012)), "displacement never moves"),
        (lambda log: changed(log, supply_voltage_V=6.0 * log["supply_voltage_V"]), "resistance"),
        (lambda log: BenchLog(log.columns, {"wire": {"length_m": 0.3}}, log.source), "another wire"),
    ],
    ids=["no reference", "shorter than a cycle", "a channel that stands", "another circuit", "another wire"],
)
def test_bad_logs_are_refused_in_a_sentence(wire, config, spoil, said):
    log = session(wire[0], logs=1)[0]
    with pytest.raises(BenchLogError, match=said) as raised:
        Evidence([spoil(log)], config)
    assert "session_1.csv" in str(raised.value)


# --- why -----------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def a_lead(wire, config):
    """(evidence, tracing) of a session with a lead of 0.03 Ω more."""
    evidence = Evidence(session(wire[0], {"lead_resistance": 0.03}), config)
    return evidence, trace(evidence, jobs=1)


def test_of_every_candidate_it_is_said_why_it_was_given_or_not(a_lead):
    evidence, found = a_lead
    said = {why.names: why for why in whys(evidence, found)}
    assert {n for names in said for n in names} == set(EFFECTS)  # none is left out
    given = [why.names for why in said.values() if why.answer == "given"]
    assert given == [found.fit.names]
    for names, why in said.items():
        assert why.reason.endswith(".") and why.answer in ("given", "alternative", "refused", "untestable"), names
        assert (why.answer == "untestable") == (names[0] in found.untestable)
        if why.answer == "refused":  # with numbers, its own and those of what was given
            takes = f"{' and '.join(found.fit.names)} {said[found.fit.names].trial.gain:.1f}"
            assert takes in why.reason and f"{why.trial.gain:.1f} nats" in why.reason, names


def test_the_rule_that_refused_a_name_is_said_with_what_it_found_and_what_may_be(a_lead):
    """A slip moves δ at rest and not R: it mends the residual, and a rest refuses it."""
    evidence, found = a_lead
    slip = next(why for why in whys(evidence, found) if why.names == ("slip",))
    refusing = {held.what: held for held in slip.held if held.refuses}
    assert {"resistance at cold rest", "displacement at cold rest"} <= set(refusing)
    at_rest = refusing["resistance at cold rest"]
    assert at_rest.most == race.usual(found.witnesses["before"]["resistance at cold rest"]) < at_rest.found
    assert slip.by_witness["displacement at cold rest"] < 0.0  # it speaks against the name


def test_nats_by_witness_and_by_stretch_are_those_of_the_gain(a_lead):
    evidence, found = a_lead
    for why in whys(evidence, found):
        if why.trial is not None:
            taken_off = why.trial.gain * found.train.sum()
            assert sum(why.by_witness.values()) == pytest.approx(taken_off, abs=1e-6)
            assert sum(why.by_stretch) == pytest.approx(taken_off, abs=1e-6)


def test_what_did_not_compete_is_explained_too(wire, config, clean, a_lead):
    nothing = trace(clean, jobs=1, explain=["slip", "ambient_temperature"])
    slip, ambient = whys(clean, nothing)
    assert (slip.names, slip.answer, ambient.answer) == (("slip",), "refused", "untestable")
    evidence, _ = a_lead
    found = trace(evidence, only=["slip"], jobs=1, explain=["lead_resistance"])
    _, lead = (why for why in whys(evidence, found) if why.trial is not None)
    assert lead.reason.startswith("It did not compete: it takes") and lead.reason.endswith("leave nothing unusual.")


# --- the fits ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("hidden", "truth"),
    [
        ({"reference_self_heating": 0.1}, {"coefficient": 0.1, "time_constant": 25.0}),
        ({"shunt": 5e-3}, {"conductance": 5e-3}),
        ({"creep": 1e-4}, {"compliance": 1e-4, "time_constant": 200.0}),
        ({"channel_delay": 0.4}, {"delay": 0.4}),
        ({"current_feedthrough": 3e-4}, {"coupling": 3e-4}),
        ({"first_pulse_set": 1.5e-4}, {"length": 1.5e-4}),
    ],
    ids=lambda x: next(iter(x)),
)
def test_a_fit_that_begins_at_nothing_finds_what_one_from_the_truth_does(wire, config, hidden, truth):
    """`benchmarks/fits_from_nothing.py` asks it of every effect in every physics with each model."""
    (name,) = hidden
    evidence = Evidence(session(wire[0], hidden), config)
    every, effect = np.ones(evidence.units, dtype=bool), candidate(name, scales_of(evidence))
    from_truth = fit(evidence, [effect], every, SimpleNamespace(values={name: truth}))
    without = float(evidence.losses(evidence.residual({})).sum())
    gains = [without - float(found.losses.sum()) for found in (fit(evidence, [effect], every), from_truth)]
    assert gains[1] > 100.0 and gains[0] >= 0.95 * gains[1]
