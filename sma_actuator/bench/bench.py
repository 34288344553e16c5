"""One wire in its test stand, with its supply and its DAQ, in one object and one time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from math import inf, isnan, nan
from typing import Any, Protocol

import numpy as np

from sma_actuator.base.parameters import ConfigError
from sma_actuator.base.sections import Wire
from sma_actuator.config import BenchConfig
from sma_actuator.plant import coil, physics
from sma_actuator.plant.loads import Load, Schedule, Weight
from sma_actuator.plant.materials import WIRES, Specimen
from sma_actuator.plant.physics import constants
from sma_actuator.plant.worlds import HOME

from .chain import CHANNELS, LSB_V, SATURATED, Chain, Noise
from .faults import check_fault
from .real import wire_of
from .supply import OCP_TIMES, STRONGEST_A, SimulatedSupply

STEP_s = 1e-3
RING = 8192
#: On a coil, a bundle or another diameter on which nothing else is hung, as 0.98 N make on the wire of 0.1524 mm.
USUAL_Pa = 54e6


@dataclass(frozen=True, slots=True)
class Setup:
    """What stands on the bench."""

    wire: Specimen
    chain: Chain = field(default_factory=Chain)
    load: Load = field(default_factory=lambda: Weight(0.98))
    ambient_C: float = 22.0
    strongest_A: float = STRONGEST_A  #: that the supply gives


def setup_of(name: str, config: BenchConfig, option: str) -> dict[str, Any]:
    """What :meth:`VirtualBench.from_name` is to be given besides ``name`` for a bench like that of a parameter file:
    its wire, its sense resistor, and a supply that gives what it asks for.

    Raises ConfigError, which names ``option``, where the wire of that name is of another alloy.
    """
    alloy = WIRES[name].material.name if name in WIRES else config.wire.alloy
    if alloy != config.wire.alloy:
        raise ConfigError(
            f"{option} {name}: is a wire of {alloy}, and wire.alloy of the parameter file is {config.wire.alloy}; "
            f"{option} {wire_of_alloy(config.wire.alloy)} is one of that, of the size and form that the file says"
        )
    strongest_A = max(config.supply.max_current, config.supply.over_current_trip / OCP_TIMES, STRONGEST_A)
    sense_Ohm = config.circuit.reference_resistance
    chain = Chain() if isnan(sense_Ohm) else Chain(reference_resistance_Ohm=sense_Ohm)
    return {"like": config.wire, "chain": chain, "strongest_A": strongest_A}


def transfer(diameter_m: float) -> float:
    """Heat that a wire loses per surface, over that of one of 0.1524 mm: powers that are within a twentieth what V. T.
    Morgan, "The overall convective heat transfer from smooth circular cylinders" (1975), and radiation give between 25
    and 500 µm."""
    times = 0.1524e-3 / diameter_m
    return times ** (0.79 if times > 1.0 else 0.52)


def wire_of_alloy(alloy: str) -> str:
    """The first wire of the bench that is of it."""
    return next(name for name, wire in WIRES.items() if wire.material.name == alloy)


@dataclass(frozen=True, slots=True)
class Truth:
    """What is so, at one bench time."""

    time_s: float
    displacement_m: float
    strain: float
    temperature_C: float
    martensite: float
    r_phase: float
    resistance_Ohm: float
    load_N: float
    stress_Pa: float
    current_A: float
    power_W: float


class SharedJoint(Protocol):
    """What benches whose wires turn one joint have in common: its angle, and their time."""

    benches: tuple[VirtualBench, ...]
    angle_rad: float
    torque_Nm: float  #: from outside

    def advance(self, until_s: float) -> None:
        """Let the physics of all run to bench time ``until_s`` [s]."""


class VirtualBench:
    """The virtual bench.  Time stands still but for :meth:`advance`; the same calls give the same numbers."""

    def __init__(self, setup: Setup, seed: int = 0):
        self.setup = setup
        self.load: Load = setup.load
        self.ambient_C = setup.ambient_C
        self.faults: dict[str, float] = {}
        self.supply = SimulatedSupply(setup.strongest_A)
        self.daq = SimulatedDaq(self)
        self.constants = constants(setup.wire, setup.chain.series_Ohm)
        self._noise = Noise(seed)
        self._rest(self.ambient_C)
        self._inputs = np.zeros(physics.INPUTS)
        self._ring = np.zeros((RING, len(physics.COLUMNS)))
        self._row = 0
        self.samples = 0  #: taken since the beginning, one per millisecond
        self._pending: list[tuple[float, str, float]] = []
        self._stuck = np.zeros(len(CHANNELS))  #: sample that a stuck channel repeats, or one that sinks has begun with
        self._repeated = np.zeros((0, len(CHANNELS)))  #: block that a DAQ repeats
        self._drifts_since_s: dict[str, float] = {}  #: what drifts
        self.joint: SharedJoint | None = None  #: that this wire turns with another

    def _rest(self, ambient_C: float) -> None:
        """The wire has cooled to ``ambient_C`` under its load, and nothing has happened yet."""
        cold_state = coil.cold_state if self.setup.wire.coil_diameter_m else physics.cold_state
        self._wire = cold_state(self.setup.wire, self.constants, ambient_C, *self.load.at(0.0))
        self._state = self._wire.whole

    @classmethod
    def from_name(
        cls,
        name: str,
        seed: int = 0,
        load: Load | None = None,
        like: Wire | None = None,
        physics: str = HOME,
        cycles: float = 0.0,
        **setup,
    ) -> VirtualBench:
        """A bench with a wire of :data:`sma_actuator.plant.materials.WIRES`, or one of that alloy and another size and
        form.

        ``like`` has size and form; ``physics`` is a name that :func:`sma_actuator.bench.real.wire_of` knows;
        ``cycles`` is how many the wire has done before; ``setup`` may hold other fields of :class:`Setup`.
        """
        wire = home = wire_of(name, physics).after(cycles)
        if like is not None:
            wire = replace(
                wire,
                length_m=like.length,
                diameter_m=like.diameter,
                heat_transfer_W_m2K=wire.heat_transfer_W_m2K * transfer(like.diameter) / transfer(wire.diameter_m),
                coil_diameter_m=like.coil_diameter if like.form == "coil" else 0.0,
                wires=like.wires,
                in_series=like.connection == "series",
            )
        if load is None and (wire.coil_diameter_m or wire.wires > 1 or wire.diameter_m != home.diameter_m):
            load = Weight(USUAL_Pa * constants(wire, 0.0).area_m2)
        if load is not None:
            setup["load"] = load
        return cls(Setup(wire, **setup), seed)

    @property
    def time_s(self) -> float:
        """Bench time [s], a whole number of milliseconds."""
        return self.samples * STEP_s

    @property
    def truth(self) -> Truth:
        """The true state now."""
        s = [float(x) for x in self._state]
        return Truth(
            self.time_s,
            s[physics.DISPLACEMENT],
            s[physics.STRAIN],
            s[physics.TEMPERATURE],
            s[physics.MARTENSITE],
            s[physics.R_SHARE] * (1.0 - s[physics.MARTENSITE]),
            s[physics.RESISTANCE],
            s[physics.LOAD],
            s[physics.LOAD] / self.constants.area_m2,
            s[physics.CURRENT],
            s[physics.POWER],
        )

    @property
    def cycles(self) -> float:
        """How many the wire has done on this bench."""
        return float(self._state[physics.CYCLES])

    @property
    def hottest_C(self) -> float:
        """Temperature of the wire's hottest place [°C]; where its clamps are cold, its mean is less."""
        return float(np.max(self._wire.cells[:, physics.CELL_TEMPERATURE]))

    @property
    def current_A(self) -> float:
        """Current through the wire [A]."""
        return float(self._state[physics.CURRENT])

    @property
    def voltage_V(self) -> float:
        """Voltage at the supply's terminals [V]."""
        return float(self._state[physics.VOLTAGE])

    @property
    def heat_J(self) -> tuple[float, float, float]:
        """Electrical heat put in, heat lost to the surroundings, heat content, each since the beginning [J]."""
        put_in, lost, held = (float(self._state[i]) for i in (physics.HEAT_IN, physics.HEAT_OUT, physics.ENTHALPY))
        return put_in, lost, held

    def advance(self, until_s: float) -> None:
        """Let the physics run to bench time ``until_s`` [s] (rounded to a millisecond); the past is left alone.

        Benches that share a joint share their time.
        """
        if self.joint is not None:
            self.joint.advance(until_s)
        else:
            run_events((self,), self._run, round(until_s / STEP_s))

    def inject(self, name: str, value: float = nan, at_s: float | None = None) -> None:
        """Make the bench misbehave (see ``faults.FAULTS``), now or at bench time ``at_s``.

        Raises ValueError for an unknown name.
        """
        value = check_fault(name, value)
        if at_s is not None and at_s > self.time_s:
            self._pending = sorted([*self._pending, (at_s, name, value)])
            return
        if name == "second_commander":
            self.supply.set_current(value)
            return
        if name == "block_repeats":
            self._repeated = self._repeated[:0]
        if name in ("sense_drift", "voltage_drift", "channel_sinks"):
            self._drifts_since_s[name] = self.time_s
        if name in ("channel_stuck", "channel_dithers", "channel_sinks"):
            self._stuck = self.daq.block(1)[0][0] if self.samples else np.zeros(len(CHANNELS))
        self.faults[name] = value

    def clear(self, name: str | None = None) -> None:
        """End one misbehaviour, or all of them."""
        if name is not None:
            check_fault(name)
        for each in [name] if name is not None else list(self.faults):
            self.faults.pop(each, None)

    def _drifted(self, name: str, time_s: float | np.ndarray) -> float | np.ndarray:
        """How many times its nominal value that has which drifts."""
        return self.faults.get(name, 1.0) ** (0.1 * (time_s - self._drifts_since_s.get(name, 0.0)))

    def _fire_pending(self) -> None:
        while self._pending and self._pending[0][0] <= self.time_s + 1e-9:
            _, name, value = self._pending.pop(0)
            self.inject(name, value)

    def _next_events(self) -> list[float]:
        events = [at_s for at_s, _, _ in self._pending[:1]]
        if "watchdog_dead" not in self.faults:
            events.append(self.supply.watchdog_expires_s)
        if isinstance(self.load, Schedule):
            events += [start_s for start_s, _ in self.load.steps if start_s > self.time_s + 1e-9][:1]
        return [e for e in events if e < inf]

    @property
    def _is_on(self) -> bool:
        return self.supply.output_on or "output_welded" in self.faults

    def _set_inputs(self) -> None:
        """What holds now, for the physics."""
        inputs, supply, faults = self._inputs, self.supply, self.faults
        force_N, stiffness_N_m, spring_at_m = self.load.at(self.time_s)
        inputs[physics.CURRENT_SET] = supply.current_A
        inputs[physics.VOLTAGE_LIMIT] = supply.voltage_V
        inputs[physics.OUTPUT_ON] = self._is_on
        inputs[physics.OCP] = supply.effective_ocp_A
        inputs[physics.OVP] = supply.effective_ovp_V
        inputs[physics.FORCE] = force_N + faults.get("load_spike", 0.0)
        inputs[physics.STIFFNESS] = stiffness_N_m
        inputs[physics.SPRING_AT] = spring_at_m
        inputs[physics.AMBIENT] = faults.get("hot_ambient", self.ambient_C)
        inputs[physics.LOSS_FACTOR] = faults.get("draught", 1.0)
        inputs[physics.CURRENT_FACTOR] = faults.get("current_disagrees", 1.0)
        inputs[physics.MORE_SERIES] = (
            self._drifted("sense_drift", self.time_s) - 1.0
        ) * self.setup.chain.reference_resistance_Ohm
        inputs[physics.BRIDGE] = faults.get("short_wire", 0.0)
        inputs[physics.WIRE_CONDITION] = (
            physics.OPEN if "open_wire" in faults else physics.SHORT if "short_wire" in faults else physics.NORMAL
        )

    def _run(self, steps: int) -> None:
        self._set_inputs()
        self._simulate(steps)

    def _simulate(self, steps: int) -> None:
        """Steps with the inputs that are set."""
        simulate = coil.simulate if self.setup.wire.coil_diameter_m else physics.simulate
        self._row = simulate(
            steps,
            STEP_s,
            self.constants,
            self._wire,
            self._inputs,
            self._ring,
            self._row,
        )
        self._count(steps)

    def _count(self, steps: int) -> None:
        """Steps were simulated: their samples exist, and what tripped in them is noted."""
        self.samples += steps
        trip = self._state[physics.TRIP]
        if trip:
            self.supply.trip("OVP" if trip == physics.TRIP_OVP else "OCP")
            self._state[physics.TRIP] = 0.0


def run_events(benches: Sequence[VirtualBench], run: Callable[[int], None], end: int) -> None:
    """Run benches of one time to ``end`` samples, ``run(steps)`` at a time from one event of any of them to the
    next."""
    while benches[0].samples < end:
        for bench in benches:
            bench._fire_pending()
        steps = end - benches[0].samples
        for event_s in (event_s for bench in benches for event_s in bench._next_events()):
            ahead = int(np.ceil((event_s - benches[0].time_s) / STEP_s - 1e-6))
            steps = min(steps, max(ahead, 1))
        run(steps)
        for bench in benches:
            if bench.supply.watchdog_expires_s <= bench.time_s + 1e-9 and "watchdog_dead" not in bench.faults:
                bench.supply.trip("WDOG")
    for bench in benches:
        bench._fire_pending()


class SimulatedDaq:
    """The scanning DAQ: the newest samples of the bench, as its converter gives them."""

    def __init__(self, bench: VirtualBench):
        self._bench = bench

    def block(self, n: int) -> tuple[np.ndarray, np.ndarray]:
        """The newest ``n`` samples of all channels, shape (n, 5), and their times [s], shape (n,).

        Raises ValueError where fewer exist, or more were asked for than the memory holds.
        """
        bench = self._bench
        if not 1 <= n <= min(bench.samples, RING):
            raise ValueError(f"{n} samples were asked for and {min(bench.samples, RING)} exist")
        first = bench.samples - n
        read = bench.setup.chain.read(bench._ring, bench._row, bench._noise.of(first, n))
        times_s = np.arange(first + 1, first + n + 1) * STEP_s
        for name, channel in (("sense_drift", 102), ("voltage_drift", 101)):
            if name in bench.faults:
                read[:, CHANNELS.index(channel)] *= bench._drifted(name, times_s)
        if "channel_swapped" in bench.faults:
            column = CHANNELS.index(int(bench.faults["channel_swapped"]))
            read[:, [column, column + 1]] = read[:, [column + 1, column]]
        if "channel_sinks" in bench.faults:
            column = CHANNELS.index(int(bench.faults["channel_sinks"]))
            read[:, column] -= bench._stuck[column] * (1.0 - 0.9 ** (times_s - bench._drifts_since_s["channel_sinks"]))
        if "channel_dithers" in bench.faults:
            column = CHANNELS.index(int(bench.faults["channel_dithers"]))
            dither = np.mod(bench._noise.of(first, n)[:, column], 1.0) - 0.5
            read[:, column] = bench._stuck[column] + LSB_V * dither
        if "channel_reversed" in bench.faults:
            read[:, CHANNELS.index(int(bench.faults["channel_reversed"]))] *= -1.0
        for name, reading in (("channel_saturated", SATURATED), ("channel_nan", nan)):
            if name in bench.faults:
                read[:, CHANNELS.index(int(bench.faults[name]))] = reading
        if "channel_stuck" in bench.faults:
            column = CHANNELS.index(int(bench.faults["channel_stuck"]))
            read[:, column] = bench._stuck[column]
        if "block_repeats" in bench.faults:
            if len(bench._repeated) != n:
                bench._repeated = read
            read = bench._repeated.copy()
        return read, times_s
