"""Tracing: what is hidden in a session is found, nothing is found where nothing is, and what has no name stays
without."""

import copy
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
from sma_actuator.diagnosis.trace import Evidence, trace
from sma_actuator.diagnosis.trace import pairs as of_pairs
from sma_actuator.diagnosis.trace.candidates import candidate, untestable
from sma_actuator.diagnosis.trace.errors import errors_of, losses
from sma_actuator.diagnosis.trace.evidence import Comparison
from sma_actuator.diagnosis.trace.experiments import best_experiment
from sma_actuator.diagnosis.trace.fitting import fit, fit_of
from sma_actuator.diagnosis.trace.floor import where_it_was
from sma_actuator.diagnosis.trace.likeliest import TRIED, likeliest
from sma_actuator.diagnosis.trace.limits import LIMITS
from sma_actuator.diagnosis.trace.pairs import PROMISING, pairs, promising
from sma_actuator.diagnosis.trace.prediction import Where, smooth
from sma_actuator.diagnosis.trace.probability import Probabilities
from sma_actuator.diagnosis.trace.problem import Problem
from sma_actuator.diagnosis.trace.quantities import quantities
from sma_actuator.diagnosis.trace.report import _words, sentence, summary
from sma_actuator.diagnosis.trace.rows import GOES_WITH_NOTHING, NOTHING, SOMETHING_ELSE, UNNAMED, Hypothesis, Rows
from sma_actuator.diagnosis.trace.scales import scales_of
from sma_actuator.diagnosis.trace.shared import as_one
from sma_actuator.diagnosis.trace.why import whys
from sma_actuator.diagnosis.trace.witnesses import limited
from sma_actuator.estimation.chain import Chain
from sma_actuator.estimation.effects import EFFECTS, QUANTITIES, STAGES, Effect
from sma_actuator.estimation.effects.frame import Frame
from sma_actuator.estimation.effects.free import size
from sma_actuator.logs.bench_log import BenchLog
from sma_actuator.logs.errors import BenchLogError
from sma_actuator.logs.experiments import make_experiment


@pytest.fixture(scope="module")
def config(wire):
    return Config.from_mapping(wire[1])


@pytest.fixture(scope="module")
def clean(wire, config):
    return Evidence(session(wire[0]), config)


def traced(wire, config, hidden, **options):
    return trace(Evidence(session(wire[0], hidden, **options), config), jobs=1)


def all_but(*names):
    """For ``without``: the competition of these alone."""
    return [name for name in EFFECTS if name not in names]


def beside(evidence, right, wrong):
    """(tracing of a name alone, why another was not given beside it)."""
    found = trace(evidence, only=[right], jobs=1, explain=[wrong])
    assert found.verdict == "traced"
    return found, next(why for why in whys(found) if why.names == (wrong,))


#: A session of two logs takes twice the time, of driving it and of every fit, and most of it one shows as well.
ONE_LOG_AND_TWO = pytest.mark.parametrize("logs", [1, pytest.param(2, marks=pytest.mark.long)])
#: For ``without``: a competition of a few candidates of every part takes a third of the time of one of all.
BUT_SOME = all_but("voltage_offset", "lead_resistance", "slip", "creep", "reference_gain", "load_cell_drift")


@pytest.mark.parametrize(
    ("without", "logs"), [(BUT_SOME, 1), pytest.param([], 2, marks=pytest.mark.long)], ids=("some", "all")
)
def test_where_nothing_is_hidden_nothing_is_most_probable(wire, config, without, logs):
    found = trace(Evidence(session(wire[0], logs=logs), config), without=without, jobs=1)
    assert found.verdict == "none" and found.fit is None and found.names == []
    assert found.probabilities.best == (NOTHING,)
    assert sum(found.probabilities.of.values()) == pytest.approx(1.0)
    assert (SOMETHING_ELSE,) in found.probabilities.of
    sure = dataclasses.replace(found, probabilities=Probabilities({(NOTHING,): 0.95, ("slip",): 0.05}))
    assert "Nothing is missing, with a probability of 95%" in sentence(sure, {}, [])
    assert sentence(sure, {}, []).endswith("lets expect, and that is usual.")
    # What is usual since the model itself is unsure of these logs is less of an answer, and says so.
    more = float(sure.before.unexpected_percent.mean()) - 0.01
    calibration = dataclasses.replace(sure.evidence.config.calibration, largest_error=more)
    evidence = copy.copy(sure.evidence)
    evidence.config = dataclasses.replace(evidence.config, calibration=calibration)
    said = sentence(dataclasses.replace(sure, evidence=evidence), {}, [])
    assert said.endswith(f"in no log of its calibration was it off by more than {more:.2g} %.")
    # Of a session that is too short to say so, that is said, and what else may be.
    unsure = dataclasses.replace(found, probabilities=Probabilities({(NOTHING,): 0.6, ("slip",): 0.3, ("creep",): 0.1}))
    said = sentence(unsure, {}, [])
    assert said.startswith("Nothing need be missing (60%), but these logs do not rule it out: of the error ")
    assert "it may be slip (30%) and creep (10%). They say as much as " in said
    # Of one that is too short to say what has happened, though something has: that.
    unsure = Probabilities({(NOTHING,): 0.28, ("slip",): 0.26, ("creep",): 0.24, ("rate",): 0.22})
    said = sentence(dataclasses.replace(found, probabilities=unsure, verdict=unsure.verdict[0]), {}, [])
    assert said.startswith("Something is missing (72%), but these logs do not tell what: of the error ")
    assert "it may be slip (26%), creep (24%) and rate (22%). They say as much as " in said


@pytest.mark.parametrize(
    ("hidden", "parameter", "value"),
    [
        # test_trace_command.py looks at that of a command, whenever tests are run
        pytest.param({"voltage_offset": 0.004}, "offset", 0.004, marks=pytest.mark.long),
        pytest.param({"slip": 2e-4}, "length", 2e-4, marks=pytest.mark.long),
        pytest.param({"backlash": 2.5e-4}, "width", 2.5e-4, marks=pytest.mark.long),
        pytest.param({"elastic_compliance": 1e-4}, "compliance", 1e-4, marks=pytest.mark.long),
        pytest.param({"load_cell_gain": 0.3}, "gain", 0.3, marks=pytest.mark.long),
        pytest.param({"sense_resistance": 0.03}, "change", 0.03, marks=pytest.mark.long),
    ],
    ids=lambda x: next(iter(x)) if isinstance(x, dict) else "",
)
def test_what_is_hidden_is_most_probable_and_its_size_within_its_interval(wire, config, hidden, parameter, value):
    (name,) = hidden
    found = traced(wire, config, hidden)
    assert found.verdict == "traced"
    assert found.fit.names == (name,) and found.names[0] == name
    assert found.fit.values[name][parameter] == pytest.approx(value, rel=0.25)
    low, high = found.fit.intervals[name][parameter]
    assert low <= value <= high or found.fit.values[name][parameter] == pytest.approx(value, rel=0.05)
    assert sum(found.probabilities.of.values()) == pytest.approx(1.0)
    assert found.after.percent.mean() < 0.6 * found.before.percent.mean()


@pytest.mark.long
def test_however_small_the_error_a_rest_that_does_not_repeat_says_that_something_happened(wire, config, clean):
    """A zero error of the voltage moves the resistance at the bias current by far more than it ever scatters."""
    found = traced(wire, config, {"voltage_offset": 1.5e-3})
    cold = "resistance at cold rest"
    assert found.before.witnesses[cold] > 3.0 * trace(clean, jobs=1).before.witnesses[cold]
    assert found.verdict == "traced" and found.fit.names == ("voltage_offset",)


@pytest.mark.long
def test_two_effects_are_both_found(wire, config):
    found = traced(wire, config, {"slip": 2e-4, "voltage_offset": 0.004})
    assert found.verdict == "traced"
    assert set(found.fit.names) == set(found.probabilities.best) == {"slip", "voltage_offset"}
    assert all(found.probabilities.by_name[name] > LIMITS.enough for name in found.fit.names)


@pytest.mark.long  # of a load cell that is not straight, below
@pytest.mark.parametrize(
    ("hidden", "by_its_form"),
    [
        # Louder than usual, and with nothing: no curve takes it off, and no effect.
        ({"hum": 6e-5}, GOES_WITH_NOTHING),
        # In the mean a loose contact is a lead; the jumps to and fro are none, and go with whatever is asked.
        ({"contact_bounce": 0.06}, "goes with"),
        # A thermo-voltage is a zero error where the wire is hot, and none where it is cold.
        ({"thermo_voltage": 1.4e-4}, "goes with"),
    ],
    ids=("hum", "contact_bounce", "thermo_voltage"),
)
def test_what_has_no_name_stays_without(wire, config, hidden, by_its_form):
    found = trace(Evidence(session(wire[0], hidden), config), jobs=1)
    assert found.verdict == "unexplained" and found.names == []
    said = sentence(found, {}, [])
    assert "There is an error that no candidate explains" in said
    # What was fitted is worth a word only where the model is better with it than without.
    assert np.mean(found.after.unexpected_percent) <= np.mean(found.before.unexpected_percent)
    assert (found.fit is not None) == ("would take off part of it" in said)
    something = found.hypotheses[SOMETHING_ELSE,]
    goes_with = something.goes_with
    assert by_its_form in (max(goes_with, key=goes_with.__getitem__), "goes with")
    assert f"By its form it goes with {_words(max(goes_with, key=goes_with.__getitem__))} (" in said


def test_a_name_that_leaves_one_witness_far_off_is_not_given(wire, config):
    """A load cell that is not straight is a gain to all but a spring, whose line it bends; where it is a candidate, it
    is named."""
    evidence = Evidence(session(wire[0], {"load_cell_nonlinearity": -0.2}, load=Spring(300.0, 0.5), logs=1), config)
    found = trace(evidence, without=all_but("load_cell_gain", "load_cell_drift", "reference_gain", "slip"), jobs=1)
    assert found.verdict == "unexplained" and found.names == []
    assert "There is an error that no candidate explains" in sentence(found, {}, [])
    goes_with = found.hypotheses[SOMETHING_ELSE,].goes_with
    assert max(goes_with, key=goes_with.__getitem__) == "load against displacement"
    found = trace(evidence, without=all_but("load_cell_gain", "load_cell_nonlinearity"), jobs=1)
    assert found.verdict == "traced" and found.fit.names == ("load_cell_nonlinearity",)


def test_a_load_cell_may_bend_until_it_shows_no_more_than_the_largest_load(clean):
    """With the middle load and all their spread for the largest one a cell that was bent twice as far as in the trial's
    other cases was none: "the end of what is possible"."""
    bend, most_N = candidate("load_cell_nonlinearity", scales_of(clean)).free[0], 1.96
    assert 0.94 < -4.0 * bend.low * most_N < 1.0


def test_a_reference_sensor_that_is_not_straight_may_have_twice_the_range_of_the_wire(wire, config):
    """Of 2.4 mm of stroke the trial's sensor of 4 mm was a gain, with 100 %."""
    logs = session(wire[0], {"reference_nonlinearity": 1.8e-4}, load=Spring(300.0, 0.5), seed=7, logs=1)
    alike = all_but("reference_gain", "reference_nonlinearity", "load_cell_gain", "load_cell_nonlinearity")
    found = trace(Evidence(logs, config), without=alike, jobs=1)
    assert found.verdict == "traced" and found.names == ["reference_nonlinearity"]


@pytest.mark.long
@pytest.mark.parametrize("middle_m", [2.5e-4, -2.5e-4])
def test_a_reference_sensor_that_is_not_straight_is_named_and_one_whose_slope_waves_is_not(wire, config, middle_m):
    found = traced(wire, config, {"reference_nonlinearity": middle_m})
    assert found.verdict == "traced" and found.names == ["reference_nonlinearity"]
    assert math.copysign(1.0, found.fit.values["reference_nonlinearity"]["bend"]) == -math.copysign(1.0, middle_m)
    found = traced(wire, config, {"lvdt_nonlinearity": abs(middle_m)})
    assert found.verdict == "unexplained"


@pytest.mark.long
def test_an_effect_with_which_the_model_is_worse_than_without_is_none(wire, config):
    """Errors that are usual together are cheap, so a lead may seem likely that makes all errors larger."""
    found = traced(wire, config, {"lvdt_nonlinearity": 4e-4})
    before = found.before.losses.sum()
    fitted = [one for one in found.hypotheses.values() if one.found]
    worse = [one for one in fitted if 0.5 * np.sum(one.fitted.rows**2) > 1.001 * before]
    assert ("lead_resistance",) in {one.names for one in worse}
    assert all(one.why_none and found.probabilities.of[one.names] == 0.0 for one in worse)
    assert any(one not in worse and not one.why_none for one in fitted)


def test_what_raises_the_error_of_the_displacement_beyond_the_usual_is_worse_whatever_else_it_mends(clean):
    rows, one, others = Rows(clean), clean.sample_weight, len(clean.unit_of_row) - clean.rows_of_samples

    def off(samples, beside):
        return np.append(samples * one, np.full(others, beside))

    for before, better, worse in ((1.5, 1.4, 1.6), (0.5, 0.9, 1.1)):
        rows.plain = off(before, 9.0)
        assert not rows.worse(off(better, 0.0)) and rows.worse(off(worse, 0.0))
    assert rows.worse(off(0.4, 10.0))


@ONE_LOG_AND_TWO
def test_a_name_needs_its_signature_however_well_it_fits(wire, config, logs):
    """A lead moves R at rest, cold and hot, and not δ; a slip does the opposite, so it is not the name, whatever it
    mends."""
    evidence = Evidence(session(wire[0], {"lead_resistance": 0.06}, logs=logs), config)
    right, wrong = beside(evidence, "lead_resistance", "slip")
    cold = "resistance at cold rest"
    assert right.before.witnesses[cold] > 4.0 > 2.0 > right.after.witnesses[cold]
    assert wrong.nats < -3.0 and wrong.by_witness[cold] < 0.0
    assert trace(evidence, only=["slip"], jobs=1).verdict == "unexplained"


@ONE_LOG_AND_TWO
def test_a_hot_rest_counts_though_the_wire_is_not_quite_as_hot_as_at_the_calibration(wire, config, logs):
    """Its resistance is lower then, by what the calibration knows of a contracted wire; that is expected, and a lead
    is."""
    off = {}
    for hidden in ({}, {"lead_resistance": 0.03}):
        evidence = Evidence(session(wire[0], hidden, logs=logs, heat=0.9), config)
        off[len(hidden)] = errors_of(evidence.compare({})).witnesses["resistance at hot rest"]
    assert 0.0 < off[0] < 1.0 and off[1] > off[0] + 1.0


def test_with_the_gain_of_a_load_cell_known_a_session_is_as_if_it_had_none(wire, config, clean):
    """What a model is expected to leave between the loads of its calibration, too: of those that hung there."""
    slope, offset, gain = config.load_cell.slope, config.load_cell.offset, 0.3
    logs = [changed(log, load_cell_voltage_V=_more(log, slope, offset, gain)) for log in session(wire[0])]
    evidence = Evidence(logs, config)
    known = {"load_cell_gain": candidate("load_cell_gain", scales_of(evidence)).build({"gain": gain})}
    held = evidence.held_where(known)
    assert held.compare(known).unexpected_percent == pytest.approx(clean.compare({}).unexpected_percent, rel=1e-6)
    floors = (np.concatenate(one.of_displacement.floor_m) for one in (held, clean))
    assert next(floors) == pytest.approx(next(floors), rel=1e-6)


def _more(log, slope, offset, gain):
    """What a load cell of that slope and offset gives for so much more load."""
    return ((1.0 + gain) * (slope * log["load_cell_voltage_V"] + offset) - offset) / slope


@ONE_LOG_AND_TWO
def test_a_spring_tells_a_drifting_sensor_from_a_creeping_wire(wire, config, logs):
    """Its load follows the wire; so a line that bends is the sensor's, and one that is straight is not."""
    hidden = {"reference_drift": 2.5e-4}
    evidence = Evidence(session(wire[0], hidden, load=Spring(300.0, 0.5), logs=logs), config)
    right, wrong = beside(evidence, "reference_drift", "creep")
    line = "load against displacement"
    assert right.before.witnesses[line] > 3.0 > 0.5 > right.after.witnesses[line]
    assert wrong.nats < -1.0 and wrong.by_witness[line] < 0.0


def test_a_spring_tells_a_load_cell_that_is_not_straight_from_one_of_another_slope(wire, config):
    """Its line goes through the middle of its way where it should, and so does one that is as steep again."""
    evidence = Evidence(session(wire[0], {"load_cell_nonlinearity": 0.1}, load=Spring(300.0, 0.5), logs=1), config)
    right, wrong = beside(evidence, "load_cell_nonlinearity", "load_cell_gain")
    bend = "bend of load against displacement"
    assert right.before.witnesses[bend] > 1.5 > 0.5 > right.after.witnesses[bend]
    assert wrong.nats < -1.0 and wrong.by_witness[bend] < -0.5


def test_a_load_that_is_read_a_reading_later_than_the_displacement_is_nothing(wire, config):
    """Converters take one channel after the other, and filter each; a displacement that is far later is a delay."""
    logs, found = session(wire[0], load=Spring(300.0, 0.5), logs=1), {}
    for channel, late in (("load_cell_voltage_V", 1), ("lvdt_current_A", 12)):
        delayed = [changed(log, **{channel: _later(log[channel], late)}) for log in logs]
        rows = Rows(evidence := Evidence(delayed, config))
        delay = rows.effects([candidate("channel_delay", scales_of(evidence))])
        found[channel] = delay.log_evidence - rows.nothing().log_evidence
    assert found["load_cell_voltage_V"] < -2.0 and found["lvdt_current_A"] > 10.0


def test_no_calibration_under_weights_shows_how_long_a_cold_wire_is_on_a_spring(wire, config):
    """Its martensite formed under more load than it rests under, and may keep the variants of that: then it is longer,
    and has more resistance, at every cold rest alike."""
    further = {}
    for load in (Spring(300.0, 0.5), Weight(0.98)):
        evidence = Evidence(session(wire[0], load=load, logs=1), config)
        rests = evidence.of_rests
        hot = np.repeat([rest.hot for rest in evidence.logs.rests[0]], 2)
        further[type(load)] = rests.unknown(evidence.predict({}))
        assert not further[type(load)][hot].any()
        further[type(load)] = further[type(load)][~hot]
    assert len(further[Spring]) > 4 and (further[Spring] > 1.0).all()
    assert (np.abs(further[Weight]) < 0.3).all()


def _later(values, readings):
    return np.concatenate((np.full(readings, values[0]), values[:-readings]))


@pytest.mark.long  # of a wire that creeps and a sensor that drifts, above
@pytest.mark.parametrize("hidden", ["rate", "reference_lag"])
def test_a_wire_that_lags_is_as_likely_as_a_sensor_that_does_until_it_pulls_a_spring(wire, config, hidden):
    """A spring's load follows the wire and not the sensor; under a weight nothing tells the two apart."""
    apart = {}
    for load in (Weight(0.98), Spring(300.0, 0.5)):
        evidence = Evidence(session(wire[0], {hidden: 0.4}, load=load), config)
        (other,) = {"rate", "reference_lag"} - {hidden}
        rows, scales = Rows(evidence), scales_of(evidence)
        true, false = (rows.effects([candidate(name, scales)]).log_evidence for name in (hidden, other))
        apart[type(load)] = true - false
    assert abs(apart[Weight]) < 0.1
    assert apart[Spring] > 10.0


@ONE_LOG_AND_TWO
def test_the_power_to_transform_tells_a_changed_heat_loss_from_a_wire_whose_resistance_rises_more(wire, config, logs):
    """The wire that warms more takes the same power."""
    power = "power in the transformation"
    evidence = Evidence(session(wire[0], {"heat_loss": -0.4}, logs=logs), config)
    right, wrong = beside(evidence, "heat_loss", "self_heating")
    assert right.fit.values["heat_loss"]["change"] == pytest.approx(-0.4, abs=0.08)
    assert right.before.witnesses[power] > 2.5 > 2.0 > right.after.witnesses[power]
    assert wrong.nats < -1.0 and wrong.by_witness[power] < 0.0


@pytest.mark.long  # that this power tells a heat loss, above
@pytest.mark.parametrize(
    ("seed", "warmer_K"),  # 10 K more that nobody logs move no estimate of this wire by more than its model errs
    [
        (5, 15.0),
        (6, 15.0),
        (7, -10.0),
    ],
)
def test_the_power_to_transform_tells_it_from_surroundings_of_another_temperature_that_nobody_logged(
    wire, config, seed, warmer_K
):
    logs = session(wire[0], {"ambient_temperature": warmer_K}, seed=seed)
    unlogged = [
        dataclasses.replace(log, columns={k: v for k, v in log.columns.items() if k != "ambient_temperature_C"})
        for log in logs
    ]
    found, wrong = beside(Evidence(unlogged, config), "ambient_temperature", "heat_loss")
    low_K, high_K = found.fit.intervals["ambient_temperature"]["difference"]
    assert low_K * high_K > 0.0, "it is not nothing"
    # Half of it at least: what the heat balance leaves takes up to 4 K, which its interval does not know of.
    assert 0.5 < found.fit.values["ambient_temperature"]["difference"] / warmer_K < 1.5
    assert wrong.nats < 0.0 and wrong.by_witness["power in the transformation"] < -1.0


@pytest.mark.parametrize("warmer_K", [15.0, -10.0])
def test_a_sensor_that_reads_the_air_of_elsewhere_is_told_from_a_draught(wire, config, warmer_K):
    """The wire is in another air, and its sensor says what it always said."""
    logs = session(wire[0], {"ambient_temperature": warmer_K}, seed=6)
    usual_C = config.calibration.ambient_temperature
    elsewhere = [
        dataclasses.replace(
            log, columns=log.columns | {"ambient_temperature_C": np.full_like(log.columns["time_s"], usual_C)}
        )
        for log in logs
    ]
    found, wrong = beside(Evidence(elsewhere, config), "ambient_temperature", "heat_loss")
    assert 0.5 < found.fit.values["ambient_temperature"]["sensor_off"] / warmer_K < 1.5
    assert wrong.nats < 0.0


@pytest.mark.long  # of a slip that is no lead, above
def test_a_slip_is_no_drift_however_much_a_drift_mends(wire, config):
    _, wrong = beside(Evidence(session(wire[0], {"slip": 4e-4}), config), "slip", "reference_drift")
    assert wrong.nats < -3.0


#: Stick and slip: a backlash, and what it is taken for beside one.
BUT_WHAT_IT_IS_LIKE = all_but(
    "backlash", "reference_self_heating", "slip", "reference_gain", "load_cell_gain", "voltage_offset"
)


@pytest.mark.parametrize(
    "without", [BUT_WHAT_IT_IS_LIKE, pytest.param([], marks=pytest.mark.long)], ids=("some", "all")
)
def test_names_that_leave_more_than_a_session_does_in_which_nothing_happened_are_not_given(wire, config, without):
    """What sticks and slips is much like a backlash, and is more than that."""
    logs = session(wire[0], {"stick_slip": 1.2e-4}, load=Spring(300.0, 0.5), logs=1)
    found = trace(Evidence(logs, config), without=without, jobs=1)
    verdict, names = found.probabilities.verdict
    assert verdict == "traced" and "backlash" in names
    assert found.after.left > 1.3 * found.lets_be_left
    assert found.verdict == "unexplained" and found.names == []
    said = sentence(found, {}, [])
    off, usual = math.sqrt(found.after.left), math.sqrt(found.lets_be_left)
    assert f"The most probable names leave {off:.1f} times what the calibration did" in said
    assert f"{usual:.1f} times is the most" in said and "not all of it, or others are; of the names" in said


def test_a_slip_before_the_logs_is_hardly_told_from_a_zero_that_has_moved(wire, config):
    """Every reading of the sensor is off by the same."""
    log = session(wire[0], logs=1)[0]
    log = changed(log, lvdt_current_A=log["lvdt_current_A"] + 3e-4 / config.reference_sensor.slope)
    evidence = Evidence([log], config)
    rows, scales = Rows(evidence), scales_of(evidence)
    slip, moved = (rows.effects([candidate(name, scales)]) for name in ("slip", "reference_drift"))
    assert slip.fitted.values["slip"]["length"] == pytest.approx(3e-4, rel=0.1)
    assert abs(slip.log_evidence - moved.log_evidence) < 2.0 * LIMITS.told


def test_a_slip_pays_for_the_time_that_was_looked_for(wire, config):
    """It may have happened at any: the sharper its time is, the less likely it was to be just that."""

    def fitted(hidden):
        evidence = Evidence(session(wire[0], hidden, logs=1), config)
        rows = Rows(evidence)
        return likeliest(evidence, [candidate("slip", scales_of(evidence))], rows.usual), rows.usual

    (there, usual), (none, _) = fitted({"slip": 4e-4}), fitted({})
    assert -math.log(TRIED + 2) <= there.when < -3.0 < -2.0 < none.when <= 0.0
    unpaid = dataclasses.replace(there, when=0.0).log_evidence(usual)
    assert there.log_evidence(usual) == pytest.approx(unpaid + there.when)


@pytest.mark.parametrize(
    ("hidden", "imitator", "end"),
    [
        ({"lead_resistance": 0.03}, "contact_drift", "time_constant"),
        pytest.param({"elastic_compliance": 1e-4}, "creep", "time_constant", marks=pytest.mark.long),
        pytest.param({"creep": 8e-5}, "fatigue", "cold_share", marks=pytest.mark.long),
    ],
    ids=lambda x: next(iter(x)) if isinstance(x, dict) else "",
)
def test_an_effect_at_the_end_where_it_is_another_has_no_name(wire, config, hidden, imitator, end):
    """A drift at once is a lead, a creep at once a compliance, and a wear that takes no stroke a creep: if not one that
    was tried, then something else."""
    evidence = Evidence(session(wire[0], hidden, logs=1), config)
    rows = Rows(evidence)
    (name,) = hidden
    found, true = (rows.effects([candidate(n, scales_of(evidence))]) for n in (imitator, name))
    assert f"{imitator}'s {end}" in found.objection
    without = rows.something_else([found])
    assert without.log_evidence >= found.log_evidence - math.log(UNNAMED)
    assert next(iter(without.looks_like)) == imitator
    assert true.log_evidence > rows.something_else([found, true]).log_evidence + 2.0
    assert not rows.something_else([dataclasses.replace(found, worse=True)]).looks_like


@pytest.mark.long
def test_a_fault_of_the_reference_is_not_put_into_the_model(wire, config):
    """A gain of the sensor: the set that fits alike holds it, and it lies outside the model."""
    found = traced(wire, config, {"reference_drift": 2.5e-4})
    assert found.verdict == "traced"
    assert "reference_drift" in found.names


def test_without_a_sense_resistor_it_does_not_compete(clean):
    """As where a log from elsewhere has its current measured: how far it may warm would not be a number."""
    scales = dataclasses.replace(scales_of(clean), sense_Ohm=math.nan)
    reasons = untestable(list(EFFECTS), scales)
    assert "sense resistor" in reasons["reference_self_heating"]
    for name in set(EFFECTS) - set(reasons):
        assert not any(math.isnan(v) for f in candidate(name, scales).free for v in (f.low, f.high, f.typical)), name


@ONE_LOG_AND_TWO
def test_what_the_log_could_not_show_is_untestable_never_absent(wire, config, logs):
    evidence = Evidence(session(wire[0], {"voltage_offset": 0.004}, load=Weight(0.98), logs=logs), config)
    few = all_but("voltage_offset", "elastic_compliance", "load_cell_nonlinearity")
    found = trace(evidence, without=few, jobs=1)
    assert found.fit.names == ("voltage_offset",)
    assert "one load" in found.untestable["elastic_compliance"]
    assert "one load" in found.untestable["load_cell_nonlinearity"]


@ONE_LOG_AND_TWO
def test_an_effect_that_no_bench_can_hide_competes_like_any_other(wire, config, monkeypatch, logs):
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
    found = trace(Evidence(session(wire[0], {"reference_gain": 0.1}, logs=logs), config), only=["scale"], jobs=1)
    assert found.fit.values["scale"]["gain"] == pytest.approx(0.1, rel=0.2)


@pytest.mark.long
def test_rerunning_gives_the_same_answer(wire, config):
    logs = session(wire[0], {"voltage_offset": 0.004}, logs=1)
    few = all_but("voltage_offset", "slip", "creep")
    a, b = (trace(Evidence(logs, config), without=few, jobs=jobs) for jobs in (1, 2))
    assert a.fit.values == b.fit.values and a.fit.names == b.fit.names
    np.testing.assert_array_equal(a.fit.held_out.losses, b.fit.held_out.losses)


# --- the evidence --------------------------------------------------------------------------------


@pytest.mark.parametrize("name", EFFECTS)
def test_a_candidate_goes_through_the_whole_recursion_as_in_the_node(clean, config, name):
    """What tracing judges is what an extended model would estimate: the same numbers, sample by sample."""
    c = candidate(name, scales_of(clean))
    values = {f.name: f.starts[0] if f.starts else 0.3 * f.typical for f in c.free}
    effect = c.build({**values, **({"time": 40.0} if name == "slip" else {})})
    predictions = clean.predict({name: effect})
    chain = Chain(config, {name: effect})
    for trace_, p in zip(clean.logs.experiments, predictions, strict=True):
        columns = (getattr(trace_.signals, f.name) for f in dataclasses.fields(Signals))
        samples = zip(*(np.broadcast_to(column, len(trace_.log)).tolist() for column in columns), strict=True)
        live = [chain.step(Signals(*sample))[1].displacement_m for sample in samples]
        if EFFECTS[name].PART == "reference":
            np.testing.assert_array_equal(p.model_m, live)
        else:
            np.testing.assert_array_equal(p.shown_m, live)
        chain.reset()  # the next log of the session


def test_what_readings_say_is_remembered_and_comes_out_the_same(clean):
    """An effect behind the strain model leaves its readings as they were; one of the circuit does not."""
    asked = [
        {},
        {"slip": EFFECTS["slip"](length=1e-4, time=60.0)},
        {"lead_resistance": EFFECTS["lead_resistance"](resistance=0.1)},
    ]
    for effects in (*asked, *asked):
        chain = Chain(clean.config, effects)
        for found, of_it in zip(clean.predict(effects), clean.through(chain), strict=True):
            np.testing.assert_array_equal(found.shown_m, of_it.shown_m)
    chain = clean.chain({})
    chain.judge(clean.logs.seen[0][0])
    with pytest.raises(ValueError, match="from its beginning"):
        chain.judge(clean.logs.seen[0][0])


def test_every_quantity_that_may_give_an_effect_away_is_looked_at(clean):
    """A tell-tale is refused at registration where it is none of these; here none of these is missing."""
    found = quantities(clean.compare({}))
    assert set(QUANTITIES) - {"ambient_temperature_C"} <= set(found) <= set(QUANTITIES)  # not logged here


def test_what_goes_with_the_current_goes_with_what_flows_and_not_with_its_readings_noise(clean):
    """A level that is held has the converter's noise, which the model answers through the resistance."""
    inverse_1_A = quantities(clean.compare({}))["inverse_current_1_A"]
    read = [
        1.0 / t.signals.current_A[rows] for t, rows in zip(clean.logs.experiments, clean.logs.compared, strict=True)
    ]
    cold = inverse_1_A > 0.9 * inverse_1_A.max()
    # A mean over six readings, and what is left of a switch.
    assert np.std(inverse_1_A[cold]) < 0.6 * np.std(np.concatenate(read)[cold])
    assert np.mean(inverse_1_A[cold]) == pytest.approx(np.mean(np.concatenate(read)[cold]), rel=1e-3)


def test_large_residuals_count_linearly():
    z = np.array([0.0, 1.0, LIMITS.linear_from, 2.0 * LIMITS.linear_from, np.nan, -np.inf])
    loss = 0.5 * limited(z) ** 2
    assert loss[:3] == pytest.approx(0.5 * z[:3] ** 2)
    assert loss[3] == pytest.approx(LIMITS.linear_from * (2.0 * LIMITS.linear_from - 0.5 * LIMITS.linear_from))
    assert np.isfinite(loss).all() and loss[4] == loss[5] > loss[3]


@pytest.mark.parametrize("change", [pytest.param(-0.35, marks=pytest.mark.long), -0.5])
def test_a_large_effect_is_fitted_though_a_small_one_is_worse_than_none(wire, config, change):
    """A hot rest counts where the wire takes about the power that it took: a heat loss a tenth less brings these
    there."""
    evidence = Evidence(session(wire[0], {"heat_loss": change}, logs=1), config)
    found = fit(evidence, [candidate("heat_loss", scales_of(evidence))], Rows(evidence).usual)
    assert found.values["heat_loss"]["change"] == pytest.approx(change, abs=0.03)


def test_no_other_time_of_a_slip_explains_more(wire, config):
    evidence = Evidence(session(wire[0], {"slip": 4e-5}, seed=2, logs=1), config)
    slip, usual = candidate("slip", scales_of(evidence)), Rows(evidence).usual
    found = likeliest(evidence, [slip], usual)
    length, time_s = found.values["slip"]["length"], found.values["slip"]["time"]
    others = [{"length": length, "time": time_s + later_s} for later_s in np.arange(-12.0, 12.0, 0.8)]
    left = [usual.whiten(evidence.compare({"slip": slip.build(values)}).rows) for values in others]
    assert np.sum(usual.whiten(found.rows) ** 2) < 1.02 * min(np.sum(rows**2) for rows in left)


def test_held_out_cycles_are_not_in_the_fit(clean):
    """An effect that is not there gains nothing on cycles it has not seen, however many parameters it has."""
    train = np.arange(clean.units) < clean.units - 3
    base = losses(clean, clean.compare({}).rows)
    for name in ("fatigue", "minor_loop_memory", "self_heating"):
        found = fit(clean, [candidate(name, scales_of(clean))], Rows(clean).usual, seen=train)
        gain = (base - found.held_out.losses)[train]
        assert gain.mean() < 2.5 * gain.std(ddof=1) / np.sqrt(len(gain)) + 0.1 * base.mean()


@pytest.mark.parametrize(
    ("name", "parameters"), [("backlash", {"width": 5e-4}), ("reference_lag", {"time_constant": 0.5})]
)
def test_what_follows_the_wire_follows_it_and_not_the_model(clean, monkeypatch, name, parameters):
    """Play and lag of the true displacement are expected where the model's known error goes through them, too."""
    effect = EFFECTS[name](**parameters)

    class KnownError:
        """A wire that is a tenth shorter than its model says."""

        @staticmethod
        def residual_m(found, rows, ambient_counts):
            return -0.1 * found.model_m[rows]

    monkeypatch.setattr(clean.of_displacement, "expectation", KnownError)
    followed_m = []
    for found, (_, kept) in zip(clean.logs.followed_by(clean.chain({})), clean.logs.seen, strict=True):
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
    whole, alone, nothing = (Comparison(clean, p).unexpected_percent.mean() for p in (after, of_the_model, without))
    # What is expected is known at the readings compared, with straight lines between them.
    assert whole < 0.5 * alone < 0.2 * nothing


def test_a_wire_at_rest_leaves_the_play_as_it_is(clean):
    """Where the wire is, the resistance tells; its noise does not take the play up."""
    chain = clean.chain({"backlash": EFFECTS["backlash"](width=1e-4)})
    for found in clean.logs.followed_by(chain):
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
    assert 0.15 < longer_percent.min() < 0.25 and 0.45 < longer_percent.max() <= 0.5 + 1e-9
    # … and half of that may be wrong.
    assert np.hypot(clean.floor_percent, 0.1) < evidence.floor_percent < np.hypot(clean.floor_percent, 0.25)
    found = trace(evidence, without=all_but("voltage_offset"), jobs=1)
    assert "hot end moved by 2.0 %" in summary(found)["sentence"]
    assert "Train it first" in summary(found)["sentence"]
    assert "Train it first" not in summary(dataclasses.replace(found, evidence=clean))["sentence"]


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
    other = next(n for n in ("creep", "backlash") if n not in names)
    shares = Probabilities({names: 0.7, (other,): 0.25, (NOTHING,): 0.05})
    found = SimpleNamespace(
        verdict="traced",
        names=[*names, other],
        probabilities=shares,
        fit=SimpleNamespace(names=names),
        beside=[],
        before=SimpleNamespace(unexpected_percent=np.array([3.0]), witnesses={}),
        after=SimpleNamespace(unexpected_percent=np.array([0.6]), witnesses={}),
    )
    said = sentence(found, {}, [{"name": other, "experiment": {"what": "rest cold for an hour"}}])
    assert "that explains 80% of what is unusual" in said and " has a probability of 70%" in said
    assert f"that it is among {', '.join(names)} and {other}, 95%. To tell: rest cold for an hour." in said
    assert said.endswith(end) and said.count("model") == 1
    untold = sentence(found, {}, [{"name": other, "experiment": None}])
    assert "95%. " in untold and "To tell" not in untold
    found.names = list(names)
    assert "has a probability of 70%. Look at" in sentence(found, {}, [])


def test_the_proposed_experiment_tells_two_explanations_apart(clean):
    """Creep and slip after the same session: a long rest in the cold shows which."""
    first = {"creep": EFFECTS["creep"](compliance=2e-4, time_constant=200.0)}
    second = {"slip": EFFECTS["slip"](length=1e-4, time=1.0)}
    found = best_experiment(clean, first, second)
    assert found.difference_m > 0.01 * clean.full_stroke_m
    assert found.duration_s > 0.0


def test_where_no_experiment_would_tell_two_explanations_apart_none_is_proposed(clean):
    """A slip and a set by the first pulse are both over: whatever is done next, both expect the same."""
    first = {"first_pulse_set": EFFECTS["first_pulse_set"](length=1e-4)}
    second = {"slip": EFFECTS["slip"](length=1e-4, time=20.0)}
    assert best_experiment(clean, first, second) is None


def test_the_floor_is_that_of_the_place_where_the_wire_was(wire, config, clean):
    """And not of the one where a lead error makes the model believe it was: there it may be much surer of itself."""
    evidence = Evidence(session(wire[0], {"lead_resistance": 0.05}), config)
    true = evidence.held_where({"lead_resistance": EFFECTS["lead_resistance"](resistance=0.05)})
    mistaken_m, true_m, usual_m = (np.concatenate(e.of_displacement.floor_m) for e in (evidence, true, clean))
    assert np.abs(true_m / usual_m - 1.0).mean() < 0.2 * np.abs(mistaken_m / usual_m - 1.0).mean()
    found = trace(evidence, only=["lead_resistance"], jobs=1)
    held_m = np.concatenate(found.evidence.of_displacement.floor_m)
    assert np.abs(held_m / true_m - 1.0).mean() < 0.02  # a branch that turns a sample earlier moves few


def test_logs_with_clocks_of_their_own_are_sessions_of_their_own(wire, config):
    logs = session(wire[0])
    restarted = [
        dataclasses.replace(log, columns={**log.columns, "time_s": log["time_s"] - log["time_s"][0]}) for log in logs
    ]
    assert Evidence(logs[::-1], config).logs.sessions == [[0, 1]]  # in the order of their clock
    assert Evidence(restarted, config).logs.sessions == [[0], [1]]


def test_several_sessions_of_several_logs_are_told_by_their_clocks(wire, config):
    """A drift begins anew with each session, and not with each log."""
    logs = session(wire[0])
    found = Evidence([*logs, *logs], config)
    assert found.logs.sessions == [[0, 1], [2, 3]]
    begin_s = [float(p.elapsed_s[0]) for p in found.predict({})]
    assert begin_s[0] == begin_s[2] == 0.0 < begin_s[1] == begin_s[3]
    assert found.logs.duration_s == Evidence(logs, config).logs.duration_s
    assert found.logs.before_s == [0.0, 0.0, found.logs.duration_s, found.logs.duration_s]


def test_a_slip_between_two_sessions_is_one_slip(wire, config):
    """Each of them is straight by itself, and the clock of each begins at nothing."""
    before, after = session(wire[0])
    lvdt_A = after["lvdt_current_A"] + 2e-4 / config.reference_sensor.slope
    after = changed(after, time_s=after["time_s"] - after["time_s"][0], lvdt_current_A=lvdt_A)
    evidence = Evidence([before, after], config)
    slip, rows = candidate("slip", scales_of(evidence)), Rows(evidence)
    found = likeliest(evidence, [slip], rows.usual).values["slip"]
    assert found["time"] == pytest.approx(evidence.logs.before_s[1], abs=0.01 * evidence.logs.together_s)
    assert found["length"] == pytest.approx(2e-4, rel=0.2)
    moved_m = [p.shown_m - p.model_m for p in evidence.predict({"slip": slip.build(found)})]
    assert [float(m[len(m) // 2]) for m in moved_m] == pytest.approx([0.0, found["length"]], abs=1e-9)


# --- bad input -----------------------------------------------------------------------------------


def changed(log, **columns):
    return BenchLog({k: v for k, v in {**log.columns, **columns}.items() if v is not None}, log.metadata, log.source)


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda log: changed(log, lvdt_current_A=None), "displacement"),
        (lambda log: log.slice(0, 120), "shorter than a cycle|never moves"),
        (lambda log: log.slice(0, 1), "never moves"),
        (lambda log: changed(log, lvdt_current_A=np.full(len(log), 0.012)), "displacement never moves"),
        (lambda log: changed(log, supply_voltage_V=6.0 * log["supply_voltage_V"]), "resistance"),
        (lambda log: BenchLog(log.columns, {"wire": {"length_m": 0.3}}, log.source), "another wire"),
    ],
    ids=[
        "no reference",
        "shorter than a cycle",
        "one reading",
        "a channel that stands",
        "another circuit",
        "another wire",
    ],
)
def test_bad_logs_are_refused_in_a_sentence(wire, config, spoil, said):
    log = session(wire[0], logs=1)[0]
    with pytest.raises(BenchLogError, match=said) as raised:
        Evidence([spoil(log)], config)
    assert "session_1.csv" in str(raised.value)


# --- why -----------------------------------------------------------------------------------------


#: Beside a drift of a contact, which ends where it is a lead.
BUT_SOME_AND_A_CONTACT = [name for name in BUT_SOME if name != "contact_drift"]


@pytest.fixture(
    scope="module",
    params=[BUT_SOME_AND_A_CONTACT, pytest.param([], marks=pytest.mark.long)],
    ids=("some", "all"),
)
def a_lead(request, wire, config):
    """(evidence, tracing) of a session with a lead of 0.03 Ω more."""
    evidence = Evidence(session(wire[0], {"lead_resistance": 0.03}, logs=1), config)
    return evidence, trace(evidence, without=request.param, jobs=1)


def test_of_every_candidate_it_is_said_why_it_was_given_or_not(a_lead):
    _, found = a_lead
    said = {why.names: why for why in whys(found)}
    asked = {name for name in EFFECTS if (name,) in found.hypotheses} | found.untestable.keys()
    assert {n for names in said for n in names} == {*asked, NOTHING, SOMETHING_ELSE}  # none is left out
    given = [why.names for why in said.values() if why.answer == "given"]
    assert given == [found.fit.names] == [found.probabilities.best]
    for names, why in said.items():
        assert why.reason.endswith(".") and why.answer in ("given", "alternative", "refused", "untestable"), names
        assert (why.answer == "untestable") == (names[0] in found.untestable)
        if why.answer == "refused":  # with numbers beside what was given
            assert f"beside {' and '.join(found.fit.names)} it is " in why.reason, names
            assert why.probability == found.probabilities.of[names] < found.probabilities.of[given[0]]


def test_what_is_certain_is_said_though_what_is_beside_it_is_not(a_lead):
    evidence, found = a_lead
    rows, scales = Rows(evidence), scales_of(evidence)
    two = [rows.effects([candidate(n, scales) for n in ("lead_resistance", other)]) for other in ("slip", "creep")]
    said = Probabilities({two[0].names: 0.5, two[1].names: 0.25, ("lead_resistance", "rate"): 0.25})
    verdict, names = said.verdict
    assert (verdict, names) == ("traced", ["lead_resistance"])
    found = dataclasses.replace(
        found,
        names=names,
        probabilities=said,
        hypotheses={**found.hypotheses, **{one.names: one for one in two}},
        fit=fit_of(evidence, two[0].fitted, rows.usual),
    )
    assert found.beside == ["slip", "creep"] and list(found.alternatives) == ["creep"]
    report = summary(found)
    assert ", and something beside that: slip 50%, creep 25%. With slip it explains " in report["sentence"]
    assert "That it has happened has a probability of 100%." in report["sentence"]
    assert [e["name"] for e in report["effects"]] == ["lead_resistance", "slip"]
    assert [(a["name"], a["instead_of"]) for a in report["alternatives"]] == [("creep", "slip")]
    answers = {why.names: why.answer for why in whys(found) if why.names in found.probabilities.of}
    assert (answers[two[0].names], answers[two[1].names]) == ("refused", "alternative")


def test_of_a_name_that_was_refused_it_is_said_which_witness_speaks_against_it(a_lead):
    """A slip moves δ once and R never."""
    _, found = a_lead
    slip = next(why for why in whys(found) if why.names == ("slip",))
    at_rest = min(slip.by_witness, key=lambda name: slip.by_witness[name])
    assert slip.by_witness[at_rest] < -1.0
    if not slip.hypothesis.why_none:
        assert f"; {at_rest} speaks against it with {-slip.by_witness[at_rest]:.1f} nats" in slip.reason


def test_nats_by_witness_and_by_stretch_are_what_the_rows_say(a_lead):
    _, found = a_lead
    best = found.hypotheses[found.probabilities.best]
    for why in whys(found):
        if why.hypothesis is not None:
            says = why.hypothesis.log_likelihood - best.log_likelihood
            together = sum(why.by_witness.values())
            assert sum(why.by_stretch) == pytest.approx(together, abs=1e-6)
            fewer = float((best.by_row - why.hypothesis.by_row).sum())
            assert together == pytest.approx(says if says * fewer > 0.0 else 0.5 * fewer, abs=1e-6)
            assert why.nats <= 1e-9 or why.hypothesis.why_none


def test_what_was_not_asked_for_is_explained_too(wire, config):
    one_load = Evidence(session(wire[0], load=Weight(0.98), logs=1), config)
    nothing = trace(one_load, only=["lead_resistance"], jobs=1, explain=["slip", "elastic_compliance"])
    said = {why.names: why for why in whys(nothing)}
    assert said["slip",].answer == "refused" and "slip" not in nothing.probabilities.by_name
    assert said["elastic_compliance",].answer == "untestable"
    assert said[NOTHING,].answer == "given"


# --- hypotheses ----------------------------------------------------------------------------------


def test_an_effect_at_the_end_of_the_possible_has_no_probability(a_lead):
    _, found = a_lead
    refused = [one for one in found.hypotheses.values() if one.why_none]
    assert refused and all(found.probabilities.of[one.names] == 0.0 for one in refused)


@pytest.fixture
def sketched(monkeypatch):
    """What gives some pairs as promising, and the first of those beside each effect these sketches."""

    def as_(promising, sketches):
        monkeypatch.setattr(of_pairs, "promising", lambda rows, alone: promising)
        found = [*sketches, *[-math.inf] * len(EFFECTS)]
        monkeypatch.setattr(of_pairs, "sketches", lambda rows, first, others: found[: len(others)])

    return as_


def test_of_pairs_the_best_few_are_fitted_that_promise_more_than_the_best_alone(sketched):
    """None is a hypothesis by its sketch."""
    fitted = SimpleNamespace(candidates=(SimpleNamespace(scanned=""),), values={})
    alone = [Hypothesis((name,), 0.0, 0.0, np.zeros(1), fitted) for name in "abcdefgh"]

    def found(*promised):
        """How many pairs are fitted where the sketches beside the best promise so much."""
        asked = []

        def effects(*_):
            asked.append(1)
            return Hypothesis(("pair", str(len(asked))), 1.0, 1.0, np.zeros(1), fitted)

        sketched([(first, other) for first in (0, 1) for other in range(first + 1, 8)], [*promised, *[-1.0] * 7])
        rows = SimpleNamespace(effects=effects, nothing=lambda: Hypothesis(("nothing",), -9.0, 0.0, np.zeros(1)))
        assert len(pairs(rows, alone, 1, lambda what, share: None)) == len(asked)
        return len(asked)

    assert (found(), found(3.0), found(*[3.0] * 6)) == (0, 2, 5)  # beside each of two; at the most five


def test_each_is_sketched_beside_the_best_whatever_a_step_from_nothing_promises(sketched):
    """Beside a strong self-heating no mount that yields was looked for, and a sensor's gain named with 97 %: of all
    pairs those with a lead, which is straight from nothing on, promised the most."""
    fitted = SimpleNamespace(candidates=(SimpleNamespace(name="", scanned=""),), values={})
    alone = [Hypothesis((name,), -at, 0.0, np.zeros(1), fitted) for at, name in enumerate(("heat", "mount", "lead"))]
    sketched([], [20.0])
    rows = SimpleNamespace(
        effects=lambda *_: Hypothesis(("heat", "mount"), 90.0, 0.0, np.zeros(1), fitted),
        nothing=lambda: Hypothesis(("nothing",), -9.0, 0.0, np.zeros(1)),
    )
    ((_, found),) = pairs(rows, alone, 1, lambda what, share: None)
    assert found.names == ("heat", "mount")


def test_the_likeliest_is_so_with_the_floor_of_where_it_has_the_wire(clean):
    """As though all readings were normal about what each says, with the spread of the places where it has them."""
    rows = Rows(clean.seldom_and_anywhere(), forms=(0.0,))
    nothing = rows.nothing()
    there = rows.evidence.held_where({})
    floor, anywhere = (np.concatenate(e.of_displacement.floor_m) for e in (there, rows.evidence))
    assert np.ptp(floor) > 0.0 == np.ptp(anywhere)
    counts = rows.evidence.sample_weight**2
    squares = np.sum(rows.usual.whiten(there.compare({}).rows) ** 2)
    spread = 2.0 * rows.share * float(counts @ np.log(floor / anywhere))
    expected = rows.usual.log_likelihood(squares) - 0.5 * spread
    assert where_it_was(rows, nothing) == pytest.approx(expected, abs=1e-6)


def test_what_cannot_have_happened_alone_is_no_measure_for_pairs(sketched):
    """A rate and a load cell's gain at once looked, alone, most like surroundings that made the model worse."""
    fitted = SimpleNamespace(candidates=(SimpleNamespace(name="", scanned=""),), values={})
    worse = Hypothesis(("ambient",), 50.0, 0.0, np.zeros(1), fitted, worse=True)
    alone = [worse, *(Hypothesis((name,), 0.0, 0.0, np.zeros(1), fitted) for name in ("rate", "gain"))]
    asked = []
    sketched([(0, 1)], [20.0])
    rows = SimpleNamespace(
        effects=lambda *_: asked.append(1) or Hypothesis(("rate", "gain"), 90.0, 0.0, np.zeros(1), fitted),
        nothing=lambda: Hypothesis(("nothing",), -9.0, 0.0, np.zeros(1)),
    )
    ((_, found),) = pairs(rows, alone, 1, lambda what, share: None)
    assert found.names == ("rate", "gain") and len(asked) == 1


@pytest.mark.parametrize(
    "hidden",
    [
        {"creep": 2.2e-4, "voltage_offset": 2.7e-3},
        pytest.param({"fatigue": 9e-5, "backlash": 4.5e-4}, marks=pytest.mark.long),
    ],
    ids="+".join,
)
def test_what_two_move_alone_says_that_they_may_have_happened_together(wire, config, hidden):
    """Whatever looks likelier by itself: each alone leaves what the other does."""
    evidence = Evidence(session(wire[0], hidden, logs=1), config)
    names = [n for n in EFFECTS if n not in untestable(EFFECTS, scales_of(evidence)) and n != "slip"]
    problems = [Problem(evidence, [candidate(n, scales_of(evidence))]) for n in names]
    alone = [SimpleNamespace(fitted=SimpleNamespace(problem=problem)) for problem in problems]
    found = [{names[i], names[k]} for i, k in promising(Rows(evidence), alone)]
    assert len(found) == PROMISING < math.comb(len(names), 2) / 5
    assert {*hidden} in found[:5]


def test_one_that_happens_once_is_fitted_beside_the_best_whatever_its_sketch(sketched):
    """When it happened was looked for alone, where another effect may have hidden it."""

    def one(name, evidence):
        fitted = SimpleNamespace(candidates=(SimpleNamespace(name=name, scanned="time" * (name == "slip")),), values={})
        return Hypothesis((name,), evidence, 0.0, np.zeros(1), fitted)

    def effects(candidates, known):
        names = tuple(c.name for c in candidates)
        return Hypothesis(names, 20.0 * ("slip" in names), 0.0, np.zeros(1), SimpleNamespace())

    alone = [one("lead", 10.0), one("gain", 5.0), one("slip", 0.0)]
    sketched([(0, 1)], [-90.0])
    rows = SimpleNamespace(effects=effects, nothing=lambda: alone[-1])
    found = [one for _, one in pairs(rows, alone, 1, lambda what, share: None)]
    assert [one.names for one in found if one.found] == [("lead", "slip")]


def test_before_the_logs_every_two_are_as_likely_whether_they_are_looked_at_or_not(sketched):
    """Those that are looked at were chosen by the logs, so they have no part of what the others have."""
    fitted = SimpleNamespace(candidates=(SimpleNamespace(scanned=""),), values={})
    alone = [Hypothesis((name,), 0.0, 0.0, np.zeros(1), fitted) for name in "abcdef"]
    sketched([(0, 1), (0, 2), (1, 2)], [9.0, 9.0])
    rows = SimpleNamespace(effects=lambda *_: alone[0], nothing=lambda: alone[0])
    assert {before for before, _ in pairs(rows, alone, 1, lambda what, share: None)} == {LIMITS.rare / 2 / 15}


def test_what_a_model_lacks_from_its_beginning_may_be_everything_but_something_else(wire, config):
    """Where its own errors are what is looked for, none of them is expected."""
    rows = Rows(Evidence(session(wire[0], logs=1), config, beyond_floor=True))
    assert rows.smooth is None and math.isfinite(rows.nothing().log_evidence)
    with pytest.raises(ValueError, match="nothing that something else could be"):
        rows.something_else()


def test_smooth_errors_are_of_the_samples_or_of_the_other_witnesses_and_of_the_size_of_the_floor(clean):
    """At every sample the hats of the place come to one on the branch that it lies on, weighed as the sample is."""
    smooth_errors, n = Rows(clean).smooth, clean.rows_of_samples
    of_samples, of_others = (part != 0.0 for part in np.split(smooth_errors.repeating, [n]))
    assert not np.any(of_samples.any(axis=0) & of_others.any(axis=0))
    np.testing.assert_array_equal(of_others[:, :-1].sum(axis=1), 1)  # an offset of the witness that it is of
    # What cold wires keep of the loads that they formed under is one thing, of all of them.
    np.testing.assert_array_equal(smooth_errors.repeating[n:, -1:], clean.compare({}).unknown)
    place = smooth_errors.repeating[:n, :12].sum(axis=1)
    np.testing.assert_allclose(place, clean.sample_weight)
    moved = np.zeros(len(clean.unit_of_row))
    moved[:n] = clean.sample_weight
    by_form = smooth_errors.of_form(moved, "place")
    np.testing.assert_allclose(by_form[:n, :12], smooth_errors.repeating[:n, :12])
    assert not by_form[n:].any()


def test_readings_share_their_error_for_as_long_as_what_goes_with_nothing_does(clean):
    """Not what goes with the time, or the place, however much: that is an effect's."""
    rows, rng = Rows(clean), np.random.default_rng(3)
    smooth_errors, n = rows.smooth, clean.rows_of_samples
    white = np.append(rng.standard_normal(n) * clean.sample_weight, np.zeros(len(rows.plain) - n))
    assert as_one(clean, smooth_errors, white) == 1.0
    samples_of_one = n / clean.independent.sum()
    slow = np.convolve(rng.standard_normal(n), np.ones(round(5.0 * samples_of_one)), mode="same")
    shared = np.append(slow * clean.sample_weight, np.zeros(len(rows.plain) - n))
    assert 3.0 < as_one(clean, smooth_errors, shared) < 6.0
    drifting = white + 20.0 * smooth_errors.new["time_s"] @ rng.standard_normal(smooth_errors.new["time_s"].shape[1])
    assert as_one(clean, smooth_errors, drifting) < 1.2


def test_what_happened_at_once_does_not_make_readings_count_as_fewer(clean):
    """What has slipped is off ever after, by one error that is none of the model's."""
    rows, rng = Rows(clean), np.random.default_rng(3)
    n = clean.rows_of_samples
    white = rng.standard_normal(n)
    slipped = (white + 20.0 * (np.arange(n) > 0.43 * n)) * clean.sample_weight
    assert as_one(clean, rows.smooth, np.append(slipped, np.zeros(len(rows.plain) - n))) < 1.5


def test_of_a_log_that_paused_a_piece_without_a_cycle_does_not_count(wire, config):
    """A busy machine's recording pauses anywhere, also just before and just after the current is switched on."""
    log = session(wire[0])[0]
    driven = make_experiment(log, config).driven.astype(int)
    on = int(np.flatnonzero(np.diff(driven) > 0)[3])
    off = int(np.flatnonzero(np.diff(driven) < 0)[np.flatnonzero(np.diff(driven) < 0) > on][0])
    second = round(1.0 / log.period_s)
    kept = np.ones(len(log), dtype=bool)
    kept[on - 3 * second : on - second // 2] = kept[(on + off) // 2 : off + 2 * second] = False
    paused = BenchLog({name: values[kept] for name, values in log.columns.items()}, log.metadata)
    evidence = Evidence([paused], config)
    assert [t.log.source[-8:] for t in evidence.logs.experiments] == ["(1 of 3)", "(3 of 3)"]
    assert len(evidence.logs.sessions) == 1


def test_a_log_in_which_the_current_was_never_let_go_counts_by_the_branches(wire, config):
    """As a controller drives that follows a sine."""
    logs = session(wire[0], load=Weight(0.98), smooth=True)
    assert not np.any(np.diff(make_experiment(logs[0], config).driven[100:].astype(int)))
    evidence = Evidence(logs, config)
    assert [int(t.cycle[-1]) >= 3 for t in evidence.logs.experiments] == [True, True]


@pytest.mark.parametrize("what", ["time_s", "place", "stress_Pa", "power_W"])
def test_something_else_says_what_it_goes_with(clean, what):
    rows = Rows(clean)
    columns = rows.smooth.new[what]
    rows.plain = rows.plain + 10.0 * columns @ np.random.default_rng(5).standard_normal(columns.shape[1])
    goes_with = rows.something_else().goes_with
    assert max(goes_with, key=goes_with.__getitem__) == what and goes_with[what] > 0.5
    assert sum(goes_with.values()) == pytest.approx(1.0)


@pytest.mark.parametrize("witness", ["resistance at cold rest", "displacement at hot rest"])
def test_something_else_may_drift_in_one_witness_alone(clean, witness):
    rows = Rows(clean)
    columns = rows.smooth.new[witness]
    assert not columns[: clean.rows_of_samples].any() and columns.shape[1] == 2
    rows.plain = rows.plain + 10.0 * columns @ np.ones(2)
    goes_with = rows.something_else().goes_with
    assert max(goes_with, key=goes_with.__getitem__) == witness and goes_with[witness] > 0.5


@pytest.mark.parametrize(
    ("over", "by"),
    [*(pytest.param("place", by, marks=pytest.mark.long) for by in LIMITS.nearly[1:3]), ("time_s", LIMITS.nearly[1])],
)
def test_what_has_only_nearly_the_form_of_an_effect_is_something_else_that_looks_like_it(a_lead, over, by):
    """A lead keeps its name; what moves the rows like one, but now or here by much more or less, does not."""
    evidence, found = a_lead
    lead, else_ = found.hypotheses["lead_resistance",], found.hypotheses[SOMETHING_ELSE,]
    assert lead.log_evidence > else_.log_evidence + 2.0
    assert sum(else_.goes_with.values()) + sum(else_.looks_like.values()) == pytest.approx(1.0)
    rows, fitted = Rows(evidence), lead.fitted
    columns = rows.smooth.of_form(evidence.compare(fitted.effects).off - rows.off, over)
    more = by * columns @ np.random.default_rng(6).standard_normal(columns.shape[1])
    sides = tuple(side + more[:, None] for side in fitted.sides)
    bent = dataclasses.replace(fitted, rows=fitted.rows + more, sides=sides)
    (its_own, _), (nearly, _) = (rows.of(bent, shares) for shares in (LIMITS.forms, LIMITS.nearly))
    assert nearly > its_own + 2.0
    known = dataclasses.replace(lead, found=bent, log_evidence=its_own)
    rows.plain = rows.plain + more
    bent_is = rows.something_else([known])
    # Whether it goes with the place or looks like a lead that does is nearly the same.
    seen = 1.0 - bent_is.goes_with["nothing that was looked at"]
    assert bent_is.looks_like["lead_resistance"] + bent_is.goes_with["place"] > 0.5 * seen > 0.1


def test_probabilities_before_the_logs_are_of_all_that_may_happen(a_lead):
    """What has no name is likelier than two effects are, and no effect is likelier than another."""
    before = a_lead[1].prior
    single = {p for names, p in before.items() if len(names) == 1 and names[0] in EFFECTS}
    two = {p for names, p in before.items() if len(names) == 2}
    assert before[SOMETHING_ELSE,] == pytest.approx(2.5 * LIMITS.rare)
    number = sum(len(names) == 1 for names in before) - 2
    (each,), (pair,) = single, two
    assert before[NOTHING,] + before[SOMETHING_ELSE,] + number * each + math.comb(number, 2) * pair == pytest.approx(
        1.0
    )


def test_what_looks_like_an_effect_that_makes_the_model_worse_is_nothing(a_lead):
    rows, lead = Rows(a_lead[0]), a_lead[1].hypotheses["lead_resistance",]
    assert rows.something_else([lead]).looks_like
    assert not rows.something_else([dataclasses.replace(lead, worse=True)]).looks_like


# --- the fits ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("hidden", "truth"),
    [
        ({"channel_delay": 0.4}, {"delay": 0.4}),
        *(
            pytest.param(hidden, truth, marks=pytest.mark.long)
            for hidden, truth in (
                ({"reference_self_heating": 0.15}, {"coefficient": 0.15, "time_constant": 25.0}),
                ({"shunt": 5e-3}, {"conductance": 5e-3}),
                ({"creep": 1e-4}, {"compliance": 1e-4, "time_constant": 200.0}),
                ({"current_feedthrough": 3e-4}, {"coupling": 3e-4}),
                ({"first_pulse_set": 1.5e-4}, {"length": 1.5e-4}),
            )
        ),
    ],
    ids=lambda x: next(iter(x)),
)
def test_a_fit_that_begins_at_nothing_finds_what_one_from_the_truth_does(wire, config, hidden, truth):
    """`benchmarks/fits_from_nothing.py` asks it of every effect in every physics with each model."""
    (name,) = hidden
    evidence = Evidence(session(wire[0], hidden, logs=1 if name == "channel_delay" else 2), config)
    rows, effect = Rows(evidence), candidate(name, scales_of(evidence))
    plain = float(np.sum(rows.usual.whiten(rows.plain) ** 2))
    gains = []
    for known in (None, {name: truth}):
        found = likeliest(evidence, [effect], rows.usual, known)
        gains.append(0.5 * (plain - found.problem.cost(rows.usual, found.rows, found.u)))
    assert gains[1] > 3.0 and gains[0] >= 0.95 * gains[1]
