"""An actuator on the virtual bench, stepped by hand: what the driver does, without the driver."""

from __future__ import annotations

from dataclasses import replace

from sma_actuator.actuator import Actuator
from sma_actuator.base.signals import Command
from sma_actuator.bench.bench import VirtualBench
from sma_actuator.bench.in_process import InProcessDaq, InProcessSupply
from sma_actuator.config import Config
from sma_actuator.plant.loads import Weight


class Rig:
    """Bench, instruments and actuator; ``step`` is one period of the loop.

    ``reading_of`` and ``state_of`` may be replaced, to lie about what the instruments said.
    """

    def __init__(self, mapping, wire="flexinol", load=Weight(0.49), **setup):  # noqa: B008 - a frozen record
        self.config = Config.from_mapping(mapping)
        self.bench = VirtualBench.from_name(wire, seed=1, load=load, **setup)
        self.supply = InProcessSupply(self.bench, self.config)
        self.daq = InProcessDaq(self.bench, self.config)
        self.supply.open()
        self.daq.open()
        self.actuator = Actuator(self.config)
        self.period_s = 1.0 / self.config.loop.rate
        self.skew_s = 0.0  #: what the loop's clock is wrong by
        self.reading_of = self.state_of = lambda x: x
        self.written = Command(0.0, False)
        self.output = None
        self.outputs = []
        self.run(0.5)

    @property
    def now_s(self):
        return self.bench.time_s + self.skew_s

    @property
    def status(self):
        return self.output.status

    def step(self):
        self.bench.advance(self.bench.time_s + self.period_s)
        reading = self.daq.read_block()
        state = self.supply.read_back()
        reading = self.reading_of(replace(reading, time_s=reading.time_s + self.skew_s))
        self.output = self.actuator.step(self.now_s, reading, self.state_of(state))
        self.outputs.append(self.output)
        command = self.output.command
        if command.current_A != self.written.current_A:
            self.supply.set_current(command.current_A)
        if command.output_on != self.written.output_on or (state.output_on and not command.output_on):
            self.supply.set_output(command.output_on)
        self.written = command
        return self.output

    def run(self, seconds):
        end_s = self.bench.time_s + seconds
        while self.bench.time_s < end_s - 1e-9:
            self.step()
        return self.output

    def enable(self):
        ok, sentence = self.actuator.enable(self.now_s, True)
        assert ok, sentence
        self.run(0.5)
        assert self.bench.supply.output_on
        assert self.status.fault == "", self.status.message

    def track(self, position_m=0.0030):
        assert self.actuator.offer_setpoint(self.now_s, position_m) == ""
        self.run(0.5)

    def seconds_until(self, fault, within_s):
        """Bench time until the status names ``fault`` (None: it does not within that time)."""
        start_s = self.bench.time_s
        while self.bench.time_s - start_s < within_s - 1e-9:
            if self.step().status.fault == fault:
                return self.bench.time_s - start_s
        return None
