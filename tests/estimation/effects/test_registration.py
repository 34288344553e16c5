"""An effect that does not say everything of itself is refused where it is written, not when logs are traced."""

from dataclasses import dataclass
from typing import ClassVar

import pytest

from sma_actuator.base.registry import PartRefusedError
from sma_actuator.bench.hidden import TWINS, require_twins
from sma_actuator.estimation.effects import EFFECTS, STAGES, Effect
from sma_actuator.estimation.effects.free import size


def written(**changes):
    """A whole effect, but for ``changes``: class attributes, None for one that is left out."""

    def measured(self, frame, state, place):
        frame.load_N = frame.load_N - self.offset

    body = {
        "__annotations__": {
            "offset": float,
            "PART": ClassVar[str],
            "WORDS": ClassVar[str],
            "REMEDY": ClassVar[str],
            "TELL_TALE": ClassVar[str],
        },
        "offset": 0.0,
        "PART": "load cell",
        "WORDS": "it is off",
        "REMEDY": "Switch it on.",
        "TELL_TALE": "stress_Pa",
        "measured": measured,
        "free": classmethod(lambda cls, scales: [size("offset", scales.load_N, 0.1)]),
        **changes,
    }
    return dataclass(frozen=True)(type("Written", (Effect,), {k: v for k, v in body.items() if v is not None}))


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"TELL_TALE": None}, "TELL_TALE is ''; one of time_s"),
        ({"TELL_TALE": "weather"}, "TELL_TALE is 'weather'"),
        ({"PART": "table"}, "PART is 'table'; one of circuit"),
        ({"WORDS": None}, "WORDS are missing"),
        ({"REMEDY": None}, "a REMEDY is missing"),
        ({"free": None}, "free is missing"),
        ({"measured": None}, "it acts nowhere"),
        ({"shown": lambda self, frame, state, place: None}, "acts at 'shown'"),
        ({"BEHIND_THE_LOAD": True}, "does not act there"),
        ({"SCANNED": "time"}, "SCANNED 'time' is none of its parameters"),
    ],
    ids=lambda x: next(iter(x)) if isinstance(x, dict) else "",
)
def test_what_an_effect_leaves_out_is_named_at_its_registration(changes, said):
    with pytest.raises(PartRefusedError, match=f"effect 'written': .*{said}"):
        EFFECTS.register("written")(written(**changes))
    assert "written" not in EFFECTS


def test_a_whole_one_would_be_taken(monkeypatch):
    monkeypatch.setattr(EFFECTS, "_parts", dict(EFFECTS.registered))
    EFFECTS.register("written")(written())
    names = list(EFFECTS)
    assert names.index("load_cell_gain") < names.index("written") < names.index("self_heating")


def test_what_is_no_effect_is_refused():
    with pytest.raises(PartRefusedError, match="no dataclass that derives from Effect"):
        EFFECTS.register("written")(int)


def parts():
    return {name: effect.PART for name, effect in EFFECTS.items()}


def test_an_effect_that_nobody_can_hide_is_refused_by_a_trial(monkeypatch):
    """Whatever can be named can be hidden: else nobody knows whether it would be found."""
    require_twins(parts())
    monkeypatch.setattr(EFFECTS, "_parts", dict(EFFECTS.registered))
    EFFECTS.register("written")(written())
    with pytest.raises(PartRefusedError, match="effect 'written': it has no hidden twin; .*@TWINS.register"):
        require_twins(parts())


def test_a_twin_lies_where_its_effect_does(monkeypatch):
    monkeypatch.setattr(TWINS["slip"], "where", "wire")
    with pytest.raises(PartRefusedError, match="effect 'slip': it lies in the mechanism, its hidden twin in the wire"):
        require_twins(parts())


def test_the_words_go_on_after_a_name():
    for name, effect in EFFECTS.items():
        assert effect.WORDS[0].islower() and not effect.WORDS.endswith("."), name
        assert effect.REMEDY[0].isupper() and effect.REMEDY.endswith("."), name
        assert any(hasattr(effect, stage) for stage in STAGES)
