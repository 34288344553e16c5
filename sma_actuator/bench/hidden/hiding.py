"""A bench with effects that nobody declared."""

from __future__ import annotations

from collections.abc import Mapping
from zlib import crc32

import numpy as np

from sma_actuator.bench.bench import RING, Setup, STEP_s, VirtualBench
from sma_actuator.plant import physics
from sma_actuator.plant.worlds import HOME

from .effect import FOREIGN, POSITION, TWINS, Hidden

CHUNK = 10  #: samples over which what an effect does to the physics holds


def hidden_effects() -> dict[str, type[Hidden]]:
    """Everything that a bench can hide, in the order in which it acts."""
    return {**TWINS, **FOREIGN}


class HiddenBench(VirtualBench):
    """A virtual bench with undeclared effects.  Without any, or with strengths of zero, it is the virtual bench.

    :attr:`truth` tells of the wire itself: what stretches the joint or fools a sensor is not in it.
    """

    def __init__(self, setup: Setup, seed: int = 0, hidden: Mapping[str, float] = {}, session_s: float = 500.0):
        """``hidden`` is name and strength; ``session_s`` is how long the bench will be used.

        Raises ValueError for an unknown name.
        """
        super().__init__(setup, seed)
        known = hidden_effects()
        if unknown := set(hidden) - set(known):
            raise ValueError(f"'{min(unknown)}' is no hidden effect; one of {', '.join(known)} is wanted")
        self.hidden = [
            kind(self, session_s, hidden[name], np.random.default_rng((seed, crc32(name.encode()))))
            for name, kind in known.items()
            if hidden.get(name)
        ]
        self._warming, self._driving, self._stretching, self._reading = (
            [each for each in self.hidden if getattr(type(each), hook) is not getattr(Hidden, hook)]
            for hook in ("ambient_K", "drive", "stretch_m", "read")
        )
        self._stretch_m = 0.0
        if self.hidden:
            for each in self.hidden:
                self.constants = each.wire(self.constants)
            self._rest(self.ambient_C + sum(each.ambient_K(0.0) for each in self.hidden))
            self._stretch_m = sum(each.stretch_m(self._state, 0.0, 0.0) for each in self.hidden)

    @classmethod
    def from_name(
        cls,
        name,
        seed=0,
        load=None,
        like=None,
        physics=HOME,
        cycles=0.0,
        hidden: Mapping[str, float] = {},
        session_s=500.0,
        **setup,
    ):
        """As :meth:`VirtualBench.from_name`, with effects."""
        plain = VirtualBench.from_name(name, seed, load, like, physics, cycles, **setup)
        return cls(plain.setup, seed, hidden, session_s)

    def _disturb(self, usual: np.ndarray) -> None:
        """Inputs for the next samples, where ``usual`` ones would hold without an effect."""
        inputs, time_s = self._inputs, self.time_s
        inputs[:] = usual
        inputs[physics.OUTPUT_ON] = self._is_on  # a protection may have tripped
        inputs[physics.SPRING_AT] -= self._stretch_m  # the spring holds the joint, not the wire
        for each in self._warming:
            inputs[physics.AMBIENT] += each.ambient_K(time_s)
        for each in self._driving:
            each.drive(inputs, time_s)

    def _run(self, steps: int) -> None:
        if not self.hidden:
            super()._run(steps)
            return
        self._set_inputs()
        usual = self._inputs.copy()
        usual[physics.MORE_SERIES] = usual[physics.SHUNT] = 0.0
        end = self.samples + steps
        while self.samples < end:
            n = min(CHUNK - self.samples % CHUNK, end - self.samples)
            before_m = self._stretch_m
            self._disturb(usual)
            self._simulate(n)
            if not (self._stretching or self._reading):
                continue
            first = (self._row - n) % RING
            at = slice(first, first + n) if first + n <= RING else np.arange(first, first + n) % RING
            rows = self._ring[at]
            if self._stretching:
                self._stretch_m = sum(each.stretch_m(self._state, self.time_s, n * STEP_s) for each in self._stretching)
                rows[:, POSITION] += before_m + (self._stretch_m - before_m) * np.arange(1, n + 1) / n
            time_s = np.arange(self.samples - n + 1, self.samples + 1) * STEP_s
            for each in self._reading:
                each.read(rows, time_s)
            self._ring[at] = rows
