"""What no model has a name for."""

from __future__ import annotations

from math import exp, pi

import numpy as np

from sma_actuator.bench.bench import STEP_s
from sma_actuator.plant import physics

from .effect import FOREIGN, POSITION, VOLTAGE, Hidden
from .shapes import stick


@FOREIGN.register("draught")
class Draught(Hidden):
    """Somebody opens doors: the heat loss wanders by the strength (rms, relative) within seconds to a minute."""

    unit, where = "1", "surroundings"

    def draw(self, rng):
        self.rates = 2.0 * pi / rng.uniform(4.0, 45.0, 6)
        self.phases = rng.uniform(0.0, 2.0 * pi, 6)

    def drive(self, inputs, time_s):
        z = float(np.sum(np.sin(self.rates * time_s + self.phases))) / 3.0**0.5
        inputs[physics.LOSS_FACTOR] *= max(1.0 + self.strength * z, 0.3)


@FOREIGN.register("hum")
class Hum(Hidden):
    """A slow beat on the displacement sensor: a sinusoid with a period of seconds."""

    unit, where = "m", "reference"

    def draw(self, rng):
        self.period_s, self.phase = rng.uniform(3.0, 9.0), rng.uniform(0.0, 2.0 * pi)

    def read(self, rows, time_s):
        rows[:, POSITION] += self.strength * np.sin(2.0 * pi * time_s / self.period_s + self.phase)


@FOREIGN.register("lvdt_nonlinearity")
class LvdtNonlinearity(Hidden):
    """The displacement sensor's slope waves along its coil."""

    unit, where = "m", "reference"

    def draw(self, rng):
        self.period_m, self.phase = rng.uniform(1.4e-3, 2.6e-3), rng.uniform(0.0, 2.0 * pi)

    def read(self, rows, time_s):
        rows[:, POSITION] += self.strength * np.sin(2.0 * pi * rows[:, POSITION] / self.period_m + self.phase)


@FOREIGN.register("contact_bounce")
class ContactBounce(Hidden):
    """A loose contact: the resistance of the leads jumps up and back at random, every few seconds."""

    unit, where = "Ω", "circuit"

    def draw(self, rng):
        self.flips_s = np.cumsum(rng.exponential(4.0, 2000))

    def drive(self, inputs, time_s):
        inputs[physics.MORE_SERIES] += self.strength * (int(np.searchsorted(self.flips_s, time_s)) % 2)


@FOREIGN.register("stick_slip")
class StickSlip(Hidden):
    """The sensor's core sticks in its guide until it is pulled by the strength, and jumps."""

    unit, where = "m", "mechanism"

    def draw(self, rng):
        self.at_m = float("nan")

    def read(self, rows, time_s):
        start = rows[0, POSITION] if self.at_m != self.at_m else self.at_m
        self.at_m = stick(rows[:, POSITION].copy(), start, abs(self.strength), rows[:, POSITION])


@FOREIGN.register("thermo_voltage")
class ThermoVoltage(Hidden):
    """Two metals meet at a crimp: a voltage in proportion to the crimp's temperature, which lags the wire's."""

    unit, where = "V/K", "circuit"

    def draw(self, rng):
        self.tau_s, self.rise_K = rng.uniform(4.0, 10.0), 0.0

    def read(self, rows, time_s):
        rise_K = self._rise_K(self.bench._state)
        self.rise_K += (1.0 - exp(-len(rows) * STEP_s / self.tau_s)) * (rise_K - self.rise_K)
        rows[:, VOLTAGE] += self.strength * self.rise_K


@FOREIGN.register("clock_skew")
class ClockSkew(Hidden):
    """The displacement channel's clock breathes: it is late by nothing to the strength and back, again and again."""

    unit, where = "s", "reference"

    def draw(self, rng):
        self.period_s, self.phase = rng.uniform(20.0, 50.0), rng.uniform(0.0, 2.0 * pi)
        self.past = np.empty(0)

    def read(self, rows, time_s):
        keep = round(abs(self.strength) / STEP_s) + 2
        if not len(self.past):
            self.past = np.full(keep, rows[0, POSITION])
        known = np.concatenate((self.past, rows[:, POSITION]))
        late_s = abs(self.strength) * 0.5 * (1.0 - np.cos(2.0 * pi * time_s / self.period_s + self.phase))
        at = np.arange(len(self.past), len(known)) - late_s / STEP_s
        rows[:, POSITION] = np.interp(at, np.arange(len(known)), known)
        self.past = known[-keep:]


@FOREIGN.register("cross_talk")
class CrossTalk(Hidden):
    """A second wire, driven to its own rhythm, shares a return lead: its square wave adds to the voltage."""

    unit, where = "V", "circuit"

    def draw(self, rng):
        self.period_s, self.phase, self.duty = rng.uniform(5.0, 13.0), rng.uniform(), rng.uniform(0.3, 0.6)

    def read(self, rows, time_s):
        rows[:, VOLTAGE] += self.strength * ((time_s / self.period_s + self.phase) % 1.0 < self.duty)
