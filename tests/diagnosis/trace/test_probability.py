"""Probabilities of hypotheses: each kind of world is known for what it is, and what is said follows from them."""

import dataclasses

import numpy as np
import pytest

from sma_actuator.diagnosis.trace import probability
from sma_actuator.diagnosis.trace.limits import LIMITS
from sma_actuator.diagnosis.trace.probability import NOTHING, SOMETHING_ELSE, Probabilities, smooth_errors, weighed
from sma_actuator.diagnosis.trace.sensitivity import Step

N = 4000
TIME = np.linspace(0.0, 1.0, N)
LATE = np.concatenate((TIME > 0.5, np.zeros(2), np.ones(3))).astype(float)
SLOW = np.concatenate((np.sin(40.0 * TIME), np.ones(2), np.zeros(3)))


def step(base, slope, name):
    value = -float(slope @ base) / float(slope @ slope)
    return Step(name, slope[:, None], np.array([value]), base + slope * value)


def said(added):
    base = np.random.default_rng(1).standard_normal(N + 5) + added
    smooth = smooth_errors({"displacement_m": (TIME * 7.0) % 1.0}, np.ones(N), np.array([0, 0, 1, 1, 1]))
    return weighed(base, [step(base, LATE, "slip"), step(base, SLOW, "creep")], smooth)


@pytest.mark.parametrize(
    ("world", "added"),
    [
        ("slip", 3.0 * LATE),
        ("creep", 3.0 * SLOW),
        (NOTHING, 0.0 * LATE),
        (SOMETHING_ELSE, np.concatenate((5.0 * ((TIME * 7.0) % 1.0 - 0.5), np.zeros(5)))),
    ],
)
def test_each_world_is_most_probably_what_it_is(world, added):
    found = said(added)
    assert next(iter(found.of)) == (world,) and found.by_name[world] > 0.7
    assert sum(found.of.values()) == pytest.approx(1.0)
    expected = {NOTHING: ("none", []), SOMETHING_ELSE: ("unexplained", [])}.get(world, ("traced", [world]))
    assert found.verdict == expected


def test_two_effects_are_a_pair_and_each_is_probable():
    found = said(3.0 * LATE + 3.0 * SLOW)
    assert set(next(iter(found.of))) == {"slip", "creep"}
    assert found.by_name["slip"] > 0.9 and found.by_name["creep"] > 0.9
    assert found.verdict[0] == "traced" and set(found.verdict[1]) == {"slip", "creep"}


def test_what_is_tempered_less_is_surer(monkeypatch):
    shares = []
    for tempering in (1e-9, LIMITS.tempering, 10.0 * LIMITS.tempering):
        monkeypatch.setattr(probability, "LIMITS", dataclasses.replace(LIMITS, tempering=tempering))
        shares.append(said(1.5 * LATE).by_name["slip"])
    assert shares[0] < shares[1] < shares[2]


def test_the_smallest_set_that_is_probable_enough_is_given_and_none_where_no_three_are():
    two = Probabilities({("creep",): 0.6, ("slip",): 0.35, (NOTHING,): 0.05})
    assert two.verdict == ("traced", ["creep", "slip"])
    four = Probabilities({(name,): 0.25 for name in ("creep", "slip", "rate", "fatigue")})
    assert four.verdict == ("unexplained", [])
    beside_others = {("creep", name): 0.05 for name in ("slip", "rate", "fatigue", "shunt")}
    assert Probabilities({("creep",): 0.8, **beside_others}).verdict == ("traced", ["creep"])
