"""A pair stepped by hand: for tools and tests, in the time of a bench."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Self

from sma_actuator.config import Config
from sma_actuator.control.pair import PairParameters
from sma_actuator.driver import Driver
from sma_actuator.instruments import Clock, Daq, PowerSupply

from .driver import JointOutput, PairDriver


class SteppedPair(PairDriver):
    """A pair with the drivers of both wires, stepped by hand: for tools and tests, in the time of a bench.

    ``instruments`` are supply and DAQ of each wire.
    """

    def __init__(
        self,
        parameters: PairParameters,
        configs: Sequence[Config],
        instruments: Sequence[tuple[PowerSupply, Daq]],
        clock: Clock,
    ):
        self.outputs: list[JointOutput] = []  #: of every step
        self.wires = [
            SteppedWire(
                Driver(
                    config,
                    supply,
                    daq,
                    clock,
                    on_output=lambda output, number=number: self.take_output(number, output),  # type: ignore[misc]
                    name=name,
                )
            )
            for number, (name, config, (supply, daq)) in enumerate(
                zip(parameters.wires, configs, instruments, strict=True)
            )
        ]
        super().__init__(parameters, configs, self.wires, self.outputs.append)
        self._clock = clock
        self._period_s = 1.0 / max(config.loop.rate for config in configs)

    def run_for(self, seconds: float) -> JointOutput:
        """Step both loops for a time; what the last step has said."""
        until_s = self._clock.now_s() + seconds
        while (now_s := self._clock.now_s()) < until_s - 1e-9:
            self._clock.sleep_until_s(min(now_s + self._period_s, until_s))
            for wire in self.wires:
                wire.driver.tick()
        return self.outputs[-1]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        for wire in self.wires:
            wire.driver.stop()


@dataclass(frozen=True, slots=True)
class SteppedWire:
    """One wire of such a pair."""

    driver: Driver

    def switch_on(self, wanted: Callable[[], bool]) -> tuple[bool, str]:
        """As :meth:`PairedWire.switch_on`."""
        return self.driver.enable(True, wanted=wanted)

    def switch_off(self) -> tuple[bool, str]:
        """As :meth:`PairedWire.switch_off`."""
        return self.driver.enable(False)
