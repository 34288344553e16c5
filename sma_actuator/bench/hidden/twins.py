"""The hidden twins of the effects that a model might name."""

from __future__ import annotations

from math import exp, pi, sin, sqrt

import numpy as np

from sma_actuator.bench.bench import STEP_s
from sma_actuator.plant import physics
from sma_actuator.plant.worlds import IN_TRAINING

from .effect import CURRENT, LOAD, POSITION, TWINS, VOLTAGE, Hidden
from .shapes import lag, play

# --- circuit -------------------------------------------------------------------------------------


@TWINS.register("lead_resistance")
class LeadResistance(Hidden):
    """The leads have more resistance than was measured when the wire was shorted."""

    unit, where = "Ω", "circuit"

    def drive(self, inputs, time_s):
        inputs[physics.MORE_SERIES] += self.strength


@TWINS.register("contact_drift")
class ContactDrift(Hidden):
    """A contact oxidises: its resistance creeps up to the strength within some hundred seconds."""

    unit, where = "Ω", "circuit"

    def draw(self, rng):
        self.tau_s = rng.uniform(100.0, 250.0)

    def drive(self, inputs, time_s):
        inputs[physics.MORE_SERIES] += self.strength * (1.0 - exp(-time_s / self.tau_s))


@TWINS.register("voltage_offset")
class VoltageOffset(Hidden):
    """The channel of the supply voltage has a zero error."""

    unit, where = "V", "circuit"

    def read(self, rows, time_s):
        rows[:, VOLTAGE] += self.strength


@TWINS.register("sense_resistance")
class SenseResistance(Hidden):
    """The sense resistor was changed, or has aged: its resistance is another by the strength, relatively."""

    unit, where = "1", "circuit"

    def drive(self, inputs, time_s):
        inputs[physics.MORE_SERIES] += self.strength * self.bench.setup.chain.reference_resistance_Ohm

    def read(self, rows, time_s):
        rows[:, CURRENT] *= 1.0 + self.strength


@TWINS.register("reference_self_heating")
class ReferenceSelfHeating(Hidden):
    """The sense resistor warms with what it dissipates, so its resistance and its voltage rise."""

    unit, where = "1/W", "circuit"

    def draw(self, rng):
        self.tau_s, self.power_W = rng.uniform(15.0, 40.0), 0.0

    def drive(self, inputs, time_s):
        nominal = self.bench.setup.chain.reference_resistance_Ohm
        inputs[physics.MORE_SERIES] += nominal * self.strength * self.power_W

    def read(self, rows, time_s):
        rise = 1.0 + self.strength * self.power_W
        power_W = float(np.mean(rows[:, CURRENT] ** 2)) * self.bench.setup.chain.reference_resistance_Ohm * rise
        self.power_W += (1.0 - exp(-len(rows) * STEP_s / self.tau_s)) * (power_W - self.power_W)
        rows[:, CURRENT] *= rise


@TWINS.register("shunt")
class Shunt(Hidden):
    """Something conducts beside the wire: it takes current that then does not heat the wire."""

    unit, where = "S", "circuit"

    def drive(self, inputs, time_s):
        inputs[physics.SHUNT] += self.strength


# --- load cell -----------------------------------------------------------------------------------


@TWINS.register("load_cell_drift")
class LoadCellDrift(Hidden):
    """The zero of the load cell has moved and goes on moving: the strength is reached when the session ends."""

    unit, where = "N", "load cell"

    def draw(self, rng):
        self.first = rng.uniform(0.3, 0.7)

    def read(self, rows, time_s):
        rows[:, LOAD] += self.strength * (self.first + (1.0 - self.first) * time_s / self.session_s)


@TWINS.register("load_cell_gain")
class LoadCellGain(Hidden):
    """The load cell shows too much, or too little, in proportion."""

    unit, where = "1", "load cell"

    def read(self, rows, time_s):
        rows[:, LOAD] *= 1.0 + self.strength


@TWINS.register("load_cell_nonlinearity")
class LoadCellNonlinearity(Hidden):
    """The load cell bends: it shows F + s F²."""

    unit, where = "1/N", "load cell"

    def read(self, rows, time_s):
        rows[:, LOAD] += self.strength * rows[:, LOAD] ** 2


# --- wire ----------------------------------------------------------------------------------------


@TWINS.register("self_heating")
class SelfHeating(Hidden):
    """The resistivity of every phase rises more with temperature than that of the calibrated wire."""

    unit, where = "1/K", "wire"

    def wire(self, c):
        return c._replace(
            alpha_m=c.alpha_m + self.strength, alpha_a=c.alpha_a + self.strength, alpha_r=c.alpha_r + self.strength
        )


@TWINS.register("ambient_temperature")
class AmbientTemperature(Hidden):
    """The laboratory is warmer than at the calibration, and on some days its temperature wanders."""

    unit, where = "K", "wire"

    def draw(self, rng):
        self.wander = 0.3 * float(rng.integers(0, 2))
        self.period_s, self.phase = rng.uniform(400.0, 900.0), rng.uniform(0.0, 2.0 * pi)

    def ambient_K(self, time_s):
        return self.strength * (1.0 + self.wander * sin(2.0 * pi * time_s / self.period_s + self.phase))


@TWINS.register("thermal_expansion")
class ThermalExpansion(Hidden):
    """The mount that the wire heats grows longer with the wire's temperature, per length of the wire."""

    unit, where = "1/K", "wire"

    def stretch_m(self, state, time_s, step_s):
        return self.strength * self.bench.constants.length_m * self._rise_K(state)


@TWINS.register("elastic_compliance")
class ElasticCompliance(Hidden):
    """The mount yields with the load, as a spring in series with the wire."""

    unit, where = "m/N", "wire"

    def drive(self, inputs, time_s):
        softer = 1.0 + inputs[physics.STIFFNESS] * self.strength
        inputs[physics.FORCE] += inputs[physics.STIFFNESS] * inputs[physics.SPRING_AT]
        inputs[physics.FORCE] /= softer
        inputs[physics.STIFFNESS] /= softer
        inputs[physics.FORCE] -= inputs[physics.STIFFNESS] * inputs[physics.SPRING_AT]

    def read(self, rows, time_s):
        rows[:, POSITION] += self.strength * rows[:, LOAD]


@TWINS.register("fatigue")
class Fatigue(Hidden):
    """Every cycle leaves some strain and some defects: with the square root of the cycles the hot end of the stroke
    moves by the strength, the cold one by less, and resistivity grows."""

    unit, where = "m", "wire"

    def draw(self, rng):
        self.scatter = rng.uniform(1.5, 3.0)  #: relative rise of resistivity per permanent strain
        self.cycles, self.hot, self.worn_m = 1, False, 0.0

    def stretch_m(self, state, time_s, step_s):
        martensite = state[physics.MARTENSITE]
        c = self.bench.constants
        if martensite < physics.HOT_BELOW:
            self.hot = True
        elif martensite > physics.COLD_ABOVE and self.hot:
            self.hot = False
            self.cycles += 1
            now_m = self.strength * (sqrt(self.cycles) - 1.0)
            strain = (now_m - self.worn_m) / c.length_m
            self.worn_m = now_m
            self.bench.constants = _more_resistive(c, self.scatter * strain)
        return self.worn_m * _left_in_place(c, state, IN_TRAINING.cold_share)


@TWINS.register("prior_wear")
class PriorWear(Hidden):
    """The wire has done some hundred cycles under too much load since it was calibrated: its hot end lies further by
    the strength, its cold one by less, and resistivity has grown."""

    unit, where = "m", "wire"

    def draw(self, rng):
        self.scatter, self.cold_share = rng.uniform(1.5, 3.0), rng.uniform(0.25, 0.6)

    def wire(self, c):
        return _more_resistive(c, self.scatter * self.strength / c.length_m)

    def stretch_m(self, state, time_s, step_s):
        return self.strength * _left_in_place(self.bench.constants, state, self.cold_share)


def _more_resistive(c, share):
    """The wire with so much more resistivity in every phase."""
    more = 1.0 + share
    return c._replace(rho_m=c.rho_m * more, rho_a=c.rho_a * more, rho_r=c.rho_r * more)


def _left_in_place(c, state, cold_share):
    """The share of what wear has left at the hot end: as on the measured wire, while it is martensite that is less (see
    IN_TRAINING)."""
    parts = physics.strain_parts(c, state[physics.MARTENSITE], state[physics.R_SHARE], c.reference_C)
    return 1.0 - (1.0 - cold_share) * parts.transformation / c.strain_m


@TWINS.register("creep")
class Creep(Hidden):
    """The wire, or its crimps, gives way slowly under load: a spring and a damper side by side, in series with it."""

    unit, where = "m/N", "wire"

    def draw(self, rng):
        self.tau_s, self.crept_m = rng.uniform(120.0, 350.0), 0.0

    def stretch_m(self, state, time_s, step_s):
        self.crept_m += (1.0 - exp(-step_s / self.tau_s)) * (self.strength * state[physics.LOAD] - self.crept_m)
        return self.crept_m


@TWINS.register("minor_loop_memory")
class MinorLoopMemory(Hidden):
    """What turned back early leaves its variants: the next branch is longer (or shorter) in proportion, until
    complete."""

    unit, where = "m", "wire"

    def draw(self, rng):
        self.tau_s = rng.uniform(0.2, 0.5)
        self.extreme, self.heating, self.kept, self.shift_m = 1.0, False, 0.0, 0.0

    def stretch_m(self, state, time_s, step_s):
        martensite = state[physics.MARTENSITE]
        left = martensite if self.heating else 1.0 - martensite  # what the branch has still to transform
        gone = martensite - self.extreme if self.heating else self.extreme - martensite
        if gone > 0.02:  # it has turned
            missed = self.extreme if self.heating else 1.0 - self.extreme
            self.kept = missed if self.heating else -missed
            self.heating, self.extreme = not self.heating, martensite
        elif gone < 0.0:
            self.extreme = martensite
        wanted_m = self.strength * self.kept * min(left / 0.15, 1.0)
        self.shift_m += (1.0 - exp(-step_s / self.tau_s)) * (wanted_m - self.shift_m)
        return self.shift_m


@TWINS.register("rate")
class Rate(Hidden):
    """The transformation strain follows the phases with a delay, as where the ends of the wire lag its middle."""

    unit, where = "s", "wire"

    def draw(self, rng):
        self.lagged_m = float("nan")

    def stretch_m(self, state, time_s, step_s):
        c = self.bench.constants
        stress_Pa = state[physics.LOAD] / c.area_m2
        # The same phases without expansion, less what is elastic: what the transformation strained.
        parts = physics.strain_parts(c, state[physics.MARTENSITE], state[physics.R_SHARE], c.reference_C)
        now_m = c.length_m * (physics.strain_under(c, parts, stress_Pa) - stress_Pa * parts.compliance_1_Pa)
        if self.lagged_m != self.lagged_m:
            self.lagged_m = now_m
        self.lagged_m += (1.0 - exp(-step_s / self.strength)) * (now_m - self.lagged_m)
        return self.lagged_m - now_m


# --- mechanism -----------------------------------------------------------------------------------


@TWINS.register("slip")
class Slip(Hidden):
    """The wire slips in its crimp once, in the middle third of the session: from then on it hangs lower."""

    unit, where = "m", "mechanism"

    def draw(self, rng):
        self.at_s = self.session_s * rng.uniform(1.0 / 3.0, 2.0 / 3.0)

    def stretch_m(self, state, time_s, step_s):
        return self.strength if time_s >= self.at_s else 0.0


@TWINS.register("backlash")
class Backlash(Hidden):
    """Play between the wire and the core of the displacement sensor."""

    unit, where = "m", "mechanism"

    def draw(self, rng):
        self.at_m = float("nan")

    def read(self, rows, time_s):
        start = rows[0, POSITION] if self.at_m != self.at_m else self.at_m
        self.at_m = play(rows[:, POSITION].copy(), start, abs(self.strength) / 2.0, rows[:, POSITION])


# --- reference -----------------------------------------------------------------------------------


@TWINS.register("reference_lag")
class ReferenceLag(Hidden):
    """The displacement sensor's electronics filter: it follows with a first-order lag."""

    unit, where = "s", "reference"

    def draw(self, rng):
        self.at_m = float("nan")

    def read(self, rows, time_s):
        start = rows[0, POSITION] if self.at_m != self.at_m else self.at_m
        self.at_m = lag(rows[:, POSITION].copy(), start, 1.0 - exp(-STEP_s / self.strength), rows[:, POSITION])


@TWINS.register("reference_gain")
class ReferenceGain(Hidden):
    """The displacement sensor shows too much, or too little, in proportion."""

    unit, where = "1", "reference"

    def read(self, rows, time_s):
        rows[:, POSITION] *= 1.0 + self.strength


@TWINS.register("reference_nonlinearity")
class ReferenceNonlinearity(Hidden):
    """The displacement sensor bends by the strength in the middle between two places near the ends of a stroke of
    4 mm, where it was calibrated."""

    unit, where = "m", "reference"

    def draw(self, rng):
        self.between_m = rng.uniform(-0.3e-3, 0.6e-3), rng.uniform(3.4e-3, 4.6e-3)

    def read(self, rows, time_s):
        first_m, last_m = self.between_m
        share = (rows[:, POSITION] - first_m) / (last_m - first_m)
        rows[:, POSITION] += self.strength * (1.0 - (2.0 * share - 1.0) ** 2)


@TWINS.register("reference_drift")
class ReferenceDrift(Hidden):
    """The displacement sensor's zero moves: the strength is reached when the session ends."""

    unit, where = "m", "reference"

    def draw(self, rng):
        self.power = rng.uniform(0.8, 1.3)

    def read(self, rows, time_s):
        rows[:, POSITION] += self.strength * (time_s / self.session_s) ** self.power


# --- surroundings --------------------------------------------------------------------------------


@TWINS.register("heat_loss")
class HeatLoss(Hidden):
    """The wire loses its heat more easily, or less, than at the calibration: in a draught, in an enclosure, hung
    otherwise."""

    unit, where = "1", "wire"

    def drive(self, inputs, time_s):
        inputs[physics.LOSS_FACTOR] *= max(1.0 + self.strength, 0.1)


# --- what a bench with a real coil reported ------------------------------------------------------


@TWINS.register("first_pulse_set")
class FirstPulseSet(Hidden):
    """The wire was handled since its last cycle: as its martensite goes for the first time some of the strain stays."""

    unit, where = "m", "wire"

    def draw(self, rng):
        self.least, self.left_m = 1.0, 0.0

    def stretch_m(self, state, time_s, step_s):
        self.least = min(self.least, float(state[physics.MARTENSITE]))
        # Most of it goes with the last of the martensite: what turns back half-way leaves a quarter.
        self.left_m = self.strength * (1.0 - self.least) ** 2
        return self.left_m


@TWINS.register("current_feedthrough")
class CurrentFeedthrough(Hidden):
    """The displacement sensor's cable lies beside the current's: its signal moves with the current."""

    unit, where = "m/A", "reference"

    def read(self, rows, time_s):
        rows[:, POSITION] += self.strength * rows[:, CURRENT]


@TWINS.register("channel_delay")
class ChannelDelay(Hidden):
    """The displacement comes through another instrument, whose clock is late by the strength."""

    unit, where = "s", "reference"

    def draw(self, rng):
        self.past_m = np.empty(0)

    def read(self, rows, time_s):
        if not len(self.past_m):
            self.past_m = np.full(round(abs(self.strength) / STEP_s), rows[0, POSITION])
        known_m = np.concatenate((self.past_m, rows[:, POSITION]))
        rows[:, POSITION], self.past_m = known_m[: len(rows)], known_m[len(rows) :]
