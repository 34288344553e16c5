"""What a hidden effect is; the twins of what a model might name, and what no model has a name for."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sma_actuator.base.registry import PartRefusedError, Registry
from sma_actuator.bench.bench import VirtualBench
from sma_actuator.plant import physics

CURRENT, VOLTAGE, LOAD, POSITION, AMBIENT = range(5)  # columns of the ring


class Hidden:
    """One effect at work on one bench, for a session of ``session_s``.  The hooks are called in the order in which they
    stand here."""

    unit = ""  #: of the strength
    where = ""  #: in which part of the stand it acts

    def __init__(self, bench: VirtualBench, session_s: float, strength: float, rng: np.random.Generator):
        self.bench, self.session_s, self.strength = bench, session_s, strength
        self.draw(rng)

    def draw(self, rng: np.random.Generator) -> None:
        """Choose what the strength does not say."""

    def wire(self, c: physics.Constants) -> physics.Constants:
        """The wire as it really is."""
        return c

    def ambient_K(self, time_s: float) -> float:
        """How much warmer the surroundings are."""
        return 0.0

    def drive(self, inputs: np.ndarray, time_s: float) -> None:
        """Change what holds for the next samples."""

    def stretch_m(self, state: np.ndarray, time_s: float, step_s: float) -> float:
        """How much longer the joint hangs than the wire alone would have it, after ``step_s`` more."""
        return 0.0

    def read(self, rows: np.ndarray, time_s: np.ndarray) -> None:
        """Change what the sensors are given, (n, 5), at times (n,)."""

    def _rise_K(self, state: np.ndarray) -> float:
        return state[physics.TEMPERATURE] - self.bench.setup.ambient_C


def _refusal(_name: str, cls: type[Hidden]) -> str:
    """What is missing or wrong in what a hidden effect says of itself."""
    if not (isinstance(cls, type) and issubclass(cls, Hidden)):
        return "it is no class that derives from Hidden"
    return "" if cls.unit and cls.where else "unit or where is missing: of its strength, and the part of the stand"


#: The hidden twins of what a model might name, by the effect's name; another package brings its own.  The order is that
#: in which they act.
TWINS: Registry[type[Hidden]] = Registry("hidden twin", "sma_actuator.hidden_twins", _refusal)
#: What no effect describes.
FOREIGN: Registry[type[Hidden]] = Registry("foreign effect", "sma_actuator.foreign_effects", _refusal)


def require_twins(parts: Mapping[str, str]) -> None:
    """Raise PartRefusedError where one of some effects, with the part of the stand that each lies in, cannot be hidden
    as it is.

    Nobody could know whether such a one would be found, nor what is found in its place: a trial asks it before it
    begins.
    """
    for name, part in parts.items():
        twin = TWINS.get(name)
        if twin is None:
            raise PartRefusedError(
                f"effect '{name}': it has no hidden twin; a class derived from sma_actuator.bench.Hidden is wanted, "
                f"registered "
                f'with @TWINS.register("{name}") (in another package: named by an entry point of {TWINS.group})'
            )
        if twin.where != part:
            raise PartRefusedError(f"effect '{name}': it lies in the {part}, its hidden twin in the {twin.where}")
