"""What an effect is, and the registry of them.

An effect says everything of itself: where the fault lies, its parameters, what it does at the stages of
the chain, what a fit may vary of it, what logs must hold to show it, the quantity that gives it away
and the words in which a person reads of it.  One that leaves something out is refused when it is
registered.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from sma_actuator.base.errors import UserError
from sma_actuator.base.registry import Registry

from .free import Free, Scales

#: Where a fault may lie, from the current to the witness.
PARTS = ("circuit", "load cell", "wire", "mechanism", "reference")
#: Those whose faults are not the model's: they are named, and the model is left alone.
NOT_THE_MODEL = ("mechanism", "reference")
#: Methods of an effect, each called with a frame, the effect's memory and the place, in this order.
STAGES = ("measured", "at_resistance", "at_displacement", "shown")
#: Quantities against which a residual is looked at, with the words for a picture; an effect names the one that gives it
#: away.
QUANTITIES = {
    "time_s": "time [s]",
    "resistance_Ohm": "resistance [Ω]",
    "displacement_m": "displacement [m]",
    "stress_Pa": "stress [Pa]",
    "branch": "branch (0 cooling, 1 heating)",
    "distance_from_reversal_m": "distance from the last reversal [m]",
    "power_W": "power [W]",
    "power_lagged_1_s_W": "power, mean over about 1 s [W]",
    "power_lagged_10_s_W": "power, mean over about 10 s [W]",
    "power_lagged_100_s_W": "power, mean over about 100 s [W]",
    "cycle": "number of the cycle",
    "inverse_current_1_A": "one over the current [1/A]",
    "resistance_rate_Ohm_s": "rate of the resistance [Ω/s]",
    "ambient_temperature_C": "ambient temperature [°C]",
}


class EffectError(UserError):
    """An effect that cannot do what it is for.  The sentence names it."""


class Effect:
    """Base of every effect: a frozen dataclass of its parameters, with a method for each stage at which it acts."""

    __slots__ = ()
    PART: ClassVar[str]  #: where the fault lies, one of PARTS
    WORDS: ClassVar[str]  #: what is the matter, in words that go on after "…: "
    REMEDY: ClassVar[str]  #: what a person can do about it, in sentences
    TELL_TALE: ClassVar[str]  #: the quantity that gives it away, one of QUANTITIES: the page draws the residual over it
    STATES: ClassVar[int] = 0  #: numbers it remembers; NaN before the first sample
    #: Whether it acts at the displacement between what the load pulls at and the reference sensor, so that a spring's
    #: load knows nothing of it.
    BEHIND_THE_LOAD: ClassVar[bool] = False
    SCANNED: ClassVar[str] = ""  #: name of a parameter in which the loss is not smooth: a time that is searched for
    #: Whether what is found of it in the logs that a model is fitted on holds for other logs of that wire.
    LASTS: ClassVar[bool] = True
    #: Whether it is what other surroundings do: in a model without one, what they do is nothing to be expected.
    ALLOWS_FOR_AMBIENT: ClassVar[bool] = False

    @classmethod
    def free(cls, scales: Scales) -> list[Free]:
        """What a fit may vary."""
        raise NotImplementedError

    @classmethod
    def fixed(cls, scales: Scales) -> dict[str, float]:
        """Parameters that the configuration and the logs decide."""
        return {}

    @classmethod
    def untestable(cls, scales: Scales) -> str:
        """Why these logs could not show it; empty where they could."""
        return ""

    def forget_the_loop(self, state: np.ndarray) -> None:
        """Forget what was derived from positions on the loop; what belongs to the session stays."""


def _refusal(_name: str, cls: type[Effect]) -> str:
    """What is missing or wrong in what an effect says of itself."""
    if not (isinstance(cls, type) and issubclass(cls, Effect) and dataclasses.is_dataclass(cls)):
        return "it is no dataclass that derives from Effect"
    acts = [stage for stage in STAGES if hasattr(cls, stage)]
    part, tell_tale = getattr(cls, "PART", ""), getattr(cls, "TELL_TALE", "")
    names = [f.name for f in dataclasses.fields(cls)]
    complaints = {
        f"PART is '{part}'; one of {', '.join(PARTS)} is wanted": part not in PARTS,
        f"TELL_TALE is '{tell_tale}'; one of {', '.join(QUANTITIES)} is wanted": tell_tale not in QUANTITIES,
        "WORDS are missing: what is the matter, in words": not getattr(cls, "WORDS", ""),
        "a REMEDY is missing: what a person can do about it, in sentences": not getattr(cls, "REMEDY", ""),
        "free is missing: what a fit may vary": cls.free.__func__ is Effect.free.__func__,
        f"it acts nowhere; a method {', '.join(STAGES)} is wanted": not acts,
        "a fault of the reference acts at 'shown', and nothing else does": ("shown" in acts) != (part == "reference"),
        "it is BEHIND_THE_LOAD, which is at the displacement, and does not act there": cls.BEHIND_THE_LOAD
        and "at_displacement" not in acts,
        f"SCANNED '{cls.SCANNED}' is none of its parameters": bool(cls.SCANNED) and cls.SCANNED not in names,
    }
    return "; ".join(text for text, is_so in complaints.items() if is_so)


#: Every effect by its name, which is that of its section in a parameter file, in the order of the chain.
EFFECTS: Registry[type[Effect]] = Registry(
    "effect", "sma_actuator.effects", _refusal, rank=lambda effect: PARTS.index(effect.PART)
)


def in_order(effects: Mapping[str, Effect]) -> dict[str, Effect]:
    """The effects in the order of the chain."""
    return {name: effects[name] for name in EFFECTS.registered if name in effects}
