"""A bench with effects that nobody declared: in the wire, in its circuit, in the mechanism or in a sensor.

They act where they act in the world: heat, strain and resistance follow from them by the bench's own
physics, and what the instruments show is computed from what is so.  One number says how strong an
effect is; time constants and phases are drawn from the bench's seed.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import exp, pi, sin, sqrt
from zlib import crc32

import numpy as np

from sma_actuator.base.jit import jit
from sma_actuator.base.registry import PartRefusedError, Registry
from sma_actuator.plant import physics
from sma_actuator.plant.worlds import HOME, IN_TRAINING

from .bench import RING, Setup, STEP_s, VirtualBench

CHUNK = 10  #: samples over which what an effect does to the physics holds
CURRENT, VOLTAGE, LOAD, POSITION, AMBIENT = range(5)  # columns of the ring


@jit
def _lag(values, start, share, out):
    """First-order lag over consecutive samples; returns its last value."""
    y = start
    for i in range(len(values)):
        y += share * (values[i] - y)
        out[i] = y
    return y


@jit
def _play(values, start, half, out):
    """What a pin in a slot of width 2 ``half`` follows."""
    y = start
    for i in range(len(values)):
        y = min(max(y, values[i] - half), values[i] + half)
        out[i] = y
    return y


@jit
def _stick(values, start, force, out):
    """What sticks until the pull exceeds ``force``, and then jumps to where it should be."""
    y = start
    for i in range(len(values)):
        if abs(values[i] - y) > force:
            y = values[i]
        out[i] = y
    return y


class Hidden:
    """One effect at work on one bench.  The hooks are called in the order in which they stand here."""

    unit = ""  #: of the strength
    where = ""  #: in which part of the stand it acts

    def __init__(self, bench: HiddenBench, strength: float, rng: np.random.Generator):
        self.bench, self.strength = bench, strength
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
        rows[:, LOAD] += self.strength * (self.first + (1.0 - self.first) * time_s / self.bench.session_s)


@TWINS.register("load_cell_gain")
class LoadCellGain(Hidden):
    """The load cell shows too much, or too little, in proportion."""

    unit, where = "1", "load cell"

    def read(self, rows, time_s):
        rows[:, LOAD] *= 1.0 + self.strength


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
            more = 1.0 + self.scatter * strain
            self.bench.constants = c._replace(rho_m=c.rho_m * more, rho_a=c.rho_a * more, rho_r=c.rho_r * more)
        # As on the measured wire: what is left in place while it is martensite is less (see IN_TRAINING).
        parts = physics.strain_parts(c, martensite, state[physics.R_SHARE], c.reference_C)
        return self.worn_m * (1.0 - (1.0 - IN_TRAINING.cold_share) * parts.transformation / c.strain_m)


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
        self.at_s = self.bench.session_s * rng.uniform(1.0 / 3.0, 2.0 / 3.0)

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
        self.at_m = _play(rows[:, POSITION].copy(), start, abs(self.strength) / 2.0, rows[:, POSITION])


# --- reference -----------------------------------------------------------------------------------


@TWINS.register("reference_lag")
class ReferenceLag(Hidden):
    """The displacement sensor's electronics filter: it follows with a first-order lag."""

    unit, where = "s", "reference"

    def draw(self, rng):
        self.at_m = float("nan")

    def read(self, rows, time_s):
        start = rows[0, POSITION] if self.at_m != self.at_m else self.at_m
        self.at_m = _lag(rows[:, POSITION].copy(), start, 1.0 - exp(-STEP_s / self.strength), rows[:, POSITION])


@TWINS.register("reference_gain")
class ReferenceGain(Hidden):
    """The displacement sensor shows too much, or too little, in proportion."""

    unit, where = "1", "reference"

    def read(self, rows, time_s):
        rows[:, POSITION] *= 1.0 + self.strength


@TWINS.register("reference_drift")
class ReferenceDrift(Hidden):
    """The displacement sensor's zero moves: the strength is reached when the session ends."""

    unit, where = "m", "reference"

    def draw(self, rng):
        self.power = rng.uniform(0.8, 1.3)

    def read(self, rows, time_s):
        rows[:, POSITION] += self.strength * (time_s / self.bench.session_s) ** self.power


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


# --- what no model has a name for ------------------------------------------------------------------


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
        self.at_m = _stick(rows[:, POSITION].copy(), start, abs(self.strength), rows[:, POSITION])


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


@FOREIGN.register("load_cell_nonlinearity")
class LoadCellNonlinearity(Hidden):
    """The load cell bends: it shows F + s F²."""

    unit, where = "1/N", "load cell"

    def read(self, rows, time_s):
        rows[:, LOAD] += self.strength * rows[:, LOAD] ** 2


@FOREIGN.register("cross_talk")
class CrossTalk(Hidden):
    """A second wire, driven to its own rhythm, shares a return lead: its square wave adds to the voltage."""

    unit, where = "V", "circuit"

    def draw(self, rng):
        self.period_s, self.phase, self.duty = rng.uniform(5.0, 13.0), rng.uniform(), rng.uniform(0.3, 0.6)

    def read(self, rows, time_s):
        rows[:, VOLTAGE] += self.strength * ((time_s / self.period_s + self.phase) % 1.0 < self.duty)


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
        self.session_s = session_s
        known = hidden_effects()
        if unknown := set(hidden) - set(known):
            raise ValueError(f"'{min(unknown)}' is no hidden effect; one of {', '.join(known)} is wanted")
        self.hidden = [
            kind(self, hidden[name], np.random.default_rng((seed, crc32(name.encode()))))
            for name, kind in known.items()
            if hidden.get(name)
        ]
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

    def _set_inputs(self) -> None:
        super()._set_inputs()
        inputs, time_s = self._inputs, self.time_s
        inputs[physics.MORE_SERIES] = inputs[physics.SHUNT] = 0.0
        inputs[physics.SPRING_AT] -= self._stretch_m  # the spring holds the joint, not the wire
        for each in self.hidden:
            inputs[physics.AMBIENT] += each.ambient_K(time_s)
            each.drive(inputs, time_s)

    def _run(self, steps: int) -> None:
        if not self.hidden:
            super()._run(steps)
            return
        end = self.samples + steps
        while self.samples < end:
            n = min(CHUNK - self.samples % CHUNK, end - self.samples)
            before_m = self._stretch_m
            super()._run(n)
            self._stretch_m = sum(each.stretch_m(self._state, self.time_s, n * STEP_s) for each in self.hidden)
            at = np.arange(self._row - n, self._row) % RING
            rows = self._ring[at]
            rows[:, POSITION] += before_m + (self._stretch_m - before_m) * np.arange(1, n + 1) / n
            time_s = np.arange(self.samples - n + 1, self.samples + 1) * STEP_s
            for each in self.hidden:
                each.read(rows, time_s)
            self._ring[at] = rows
