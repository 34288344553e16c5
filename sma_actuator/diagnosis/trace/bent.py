"""What looks like an effect and is not it: at its stage of the chain it does here more of what that does, there less.

What moves the rows so goes through the whole chain, and all witnesses move as one: a sense resistor of another value is
a lead that grows with the resistance, whatever the model makes of that.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, cast

import numpy as np

from sma_actuator.estimation.effects import STAGES, Effect
from sma_actuator.estimation.effects.frame import Frame, Place

from .evidence import Evidence
from .limits import LIMITS
from .prediction import Prediction

#: What an effect may change of a frame.
CHANGED = ("resistance_Ohm", "current_A", "power_W", "load_N", "ambient_C", "displacement_m")
#: Over what of a frame it may do more and less, and what that is of a prediction, by the wire's cross-section [m²].
OVER: Mapping[str, Callable[[Prediction, float], np.ndarray]] = {
    "elapsed_s": lambda p, area_m2: p.elapsed_s,
    "resistance_Ohm": lambda p, area_m2: p.resistance_Ohm,
    "power_W": lambda p, area_m2: p.power_W,
    "load_N": lambda p, area_m2: p.stress_Pa * area_m2,
    "displacement_m": lambda p, area_m2: p.model_m,
}
KNOTS = 3  #: of a bend: its two ends and the middle of all readings
SOME = 1e-9  #: of what the rows are off, below which nothing was moved


@dataclass(frozen=True, slots=True)
class Bent:
    """An effect that does more of what it does at some places than at others; else it is that effect."""

    effect: Effect
    over: str  #: field of a frame …
    knots: np.ndarray  #: … values of it …
    more: np.ndarray  #: … and how much more it does there, as a share

    def __getattr__(self, name: str) -> Any:
        found = getattr(self.effect, name)
        return partial(self._act, found) if name in STAGES else found

    def _act(
        self, act: Callable[[Frame, np.ndarray, Place], None], frame: Frame, state: np.ndarray, place: Place
    ) -> None:
        """What the effect does at a stage, and more of it; no more where the frame does not have yet what that goes
        with."""
        over, was = getattr(frame, self.over), {name: getattr(frame, name) for name in CHANGED}
        was = {name: values.copy() for name, values in was.items() if values is not None}
        more = 0.0 if over is None else np.nan_to_num(np.interp(over, self.knots, self.more))
        act(frame, state, place)
        for name, before in was.items():
            now = getattr(frame, name)
            setattr(frame, name, now + more * (now - before))


def moved_by_bends(evidence: Evidence, effects: Mapping[str, Effect]) -> dict[str, np.ndarray]:
    """By how much the rows move where some effects do twice as much about each knot, by what they may be bent over,
    (rows, KNOTS); nothing where that moves nothing."""
    predictions, here = evidence.predict({}), evidence.compare(effects).off
    out = {}
    for over, of in OVER.items():
        values = np.concatenate([of(p, evidence.place.area_m2) for p in predictions])
        knots = np.unique(np.quantile(values[np.isfinite(values)], np.linspace(0.0, 1.0, KNOTS)))
        columns = []
        for hat in np.eye(len(knots)):
            bent = {name: cast(Effect, Bent(e, over, knots, LIMITS.form * hat)) for name, e in effects.items()}
            columns.append((evidence.compare(bent).off - here) / LIMITS.form)
        moved = np.column_stack(columns)
        if len(knots) > 1 and np.abs(moved).max() > SOME * np.abs(here).max():
            out[over] = moved
    return out
