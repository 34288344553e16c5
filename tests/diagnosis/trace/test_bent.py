"""What looks like an effect and is not it: the same at its stage of the chain, but more of it here and less there."""

import numpy as np
import pytest
from sessions import session

from sma_actuator.config import Config
from sma_actuator.diagnosis.trace import Evidence, trace
from sma_actuator.diagnosis.trace.bent import OVER, Bent, moved_by_bends
from sma_actuator.diagnosis.trace.rows import SOMETHING_ELSE
from sma_actuator.estimation.effects import EFFECTS

EVERYWHERE = np.array([-1e3, 1e3])


@pytest.fixture(scope="module")
def config(wire):
    return Config.from_mapping(wire[1])


@pytest.fixture(scope="module")
def evidence(wire, config):
    return Evidence(session(wire[0], logs=1), config)


@pytest.mark.parametrize(
    ("name", "parameter"),
    [("lead_resistance", "resistance"), ("load_cell_drift", "offset"), ("reference_drift", "offset")],
)
def test_an_effect_that_does_a_half_more_everywhere_is_half_as_large_again(evidence, name, parameter):
    effect, larger = (EFFECTS[name](**{parameter: size}) for size in (0.02, 0.03))
    bent = Bent(effect, "elapsed_s", EVERYWHERE, np.array([0.5, 0.5]))
    assert np.allclose(evidence.compare({name: bent}).off, evidence.compare({name: larger}).off)


def test_a_sense_resistor_of_another_value_is_a_lead_that_grows_with_the_resistance(evidence):
    """With k of its value more, R + r(R) is (1 + k) R and as much of the leads."""
    k, leads_Ohm = 0.01, evidence.place.lead_resistance_Ohm
    sense, lead = EFFECTS["sense_resistance"](change=k), EFFECTS["lead_resistance"](resistance=-k)
    bent = Bent(lead, "resistance_Ohm", EVERYWHERE, EVERYWHERE + leads_Ohm - 1.0)
    (by_sense,), (by_lead,) = (
        evidence.predict({name: e}) for name, e in (("sense_resistance", sense), ("lead_resistance", bent))
    )
    assert np.allclose(by_lead.resistance_Ohm, by_sense.resistance_Ohm)


def test_bends_move_the_rests_with_the_residual(evidence):
    moved = moved_by_bends(evidence, {"lead_resistance": EFFECTS["lead_resistance"](resistance=0.05)})
    # where the strain model has not been asked yet there is no displacement to go with
    assert set(moved) == set(OVER) - {"displacement_m"}
    rests = evidence.rows_by_witness()["resistance at cold rest"]
    for over, columns in moved.items():
        assert np.abs(columns[rests]).max() > 0.0 < np.abs(columns[: evidence.rows_of_samples]).max(), over


@pytest.mark.parametrize(
    ("hidden", "verdict"), [({"sense_resistance": -0.03}, "unexplained"), ({"lead_resistance": 0.03}, "traced")]
)
def test_a_sense_resistor_that_is_no_candidate_only_looks_like_a_lead(wire, config, hidden, verdict):
    """With forms that are off in the rows alone it was a lead, with 98 %."""
    without = [name for name in EFFECTS if name not in ("lead_resistance", "shunt", "slip")]
    found = trace(Evidence(session(wire[0], hidden, logs=1), config), without=without, jobs=1)
    assert found.verdict == verdict
    looks_like = found.hypotheses[SOMETHING_ELSE,].looks_like
    assert max(looks_like, key=looks_like.__getitem__) == "lead_resistance"
