"""What a limit and a fault are, and what the guards see and remember.

A *limit* bends the command and passes by itself; a *fault* means that something is wrong.  Each is
one object that holds all there is to know of it.  A fault is declared by decorating the function
that looks for it: that function's name is the fault's.
"""

from __future__ import annotations

import enum
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import inf, isnan, nan
from typing import Generic, ParamSpec

from sma_actuator.base.record import record
from sma_actuator.base.signals import Command, Estimate, Reading, Signals, SupplyState

from .alive import LoadAlive, Repeats
from .drift import CurrentsApart, VoltagesApart
from .formula import Formula
from .lately import Lately
from .parameters import SafetySections
from .thermal import WireHeat

P = ParamSpec("P")


class Action(enum.Enum):
    """What is done with the current, mildest first."""

    HOLD = "hold"  #: the wire is held: at its position, or at the last good setpoint
    NOTE = "note"  #: what is wrong is not used, and the current goes on
    BIAS = "bias"  #: the current falls to supply.bias_current, enough to measure with
    OFF = "off"  #: current zero and output off


@dataclass(frozen=True, slots=True, eq=False)
class Limit:
    """The command is bent, nothing is wrong."""

    name: str
    words: str
    remedy: str  #: what a person can do about it
    detector: str
    within: Formula  #: longest time [s] from the cause to the action

    @property
    def advice(self) -> str:
        """What to do, as a sentence."""
        return f"{self.remedy}."


@dataclass(frozen=True, slots=True, eq=False)
class Fault:
    """One thing that can go wrong and what is done about it.  One that is no :class:`Guard` only the driver can see."""

    name: str
    words: str
    remedy: str  #: what a person can do about it
    detector: str
    within: Formula  #: longest time [s] from the cause to the action
    action: Action
    latches: bool = False
    while_off: bool = False  #: also latched when it appears while the output is off anyway
    action_by: str = ""  #: the parameter that says the action instead; latched where that is off
    until_back: bool = False  #: latched only until the instruments answer again, with the output read back as off

    @property
    def advice(self) -> str:
        """What to do, in sentences."""
        if self.until_back:
            return f"{self.remedy}. Once it answers again: ~/enable."
        return f"{self.remedy}. Then ~/clear_fault and ~/enable." if self.latches else f"{self.remedy}."

    @property
    def prevents_enabling(self) -> bool:
        """Whether the output stays off while this fault is there."""
        return self.action in (Action.OFF, Action.BIAS)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Guard(Fault, Generic[P]):
    """A fault with the function that looks for it."""

    look: Callable[P, str]  #: why the fault is there, or ""
    each_step: bool  #: whether the supervisor asks it in every step; else whoever is concerned does


def guard(
    *,
    words: str,
    remedy: str,
    detector: str,
    within: Formula,
    action: Action,
    latches: bool = False,
    while_off: bool = False,
    action_by: str = "",
    until_back: bool = False,
    each_step: bool = True,
) -> Callable[[Callable[P, str]], Guard[P]]:
    """Make a fault of the function that looks for it."""

    def declare(look: Callable[P, str]) -> Guard[P]:
        return Guard(
            name=look.__name__,
            words=words,
            remedy=remedy,
            detector=detector,
            within=within,
            action=action,
            latches=latches,
            while_off=while_off,
            action_by=action_by,
            until_back=until_back,
            look=look,
            each_step=each_step,
        )

    return declare


#: Channels none of which has stood still; and that without a reading.
MOVING = (0.0, 0.0, 0.0)
NEVER_READ = ((nan, nan, nan), MOVING, nan)


@dataclass(slots=True)
class Memory:
    """What the guards remember from one step to the next."""

    reading_s: float = nan  #: loop time of the last usable reading
    daq_s: float = nan  #: of the last answer of the DAQ
    supply_s: float = nan  #: of the last usable read-back
    load_N: float = nan
    #: Of each channel the value and for how long it has stood [s], and when that was.
    channels: tuple[Sequence[float], Sequence[float], float] = NEVER_READ
    repeats: Repeats = field(default_factory=Repeats)  #: of whole readings
    load_alive: LoadAlive = field(default_factory=LoadAlive)
    currents: CurrentsApart = field(default_factory=CurrentsApart)
    voltages: VoltagesApart = field(default_factory=VoltagesApart)
    told_A: Lately = field(default_factory=Lately)  #: what the supply was told
    supply_A_V: Lately = field(default_factory=Lately)  #: current and voltage that it measures
    since_s: dict[str, float] = field(default_factory=dict)  #: since when a condition holds
    #: How long a condition has held, breaks left out, when it was looked at, and whether it held then.
    in_all: dict[str, tuple[float, float, bool]] = field(default_factory=dict)
    count: dict[str, int] = field(default_factory=dict)  #: how many times running
    owed: dict[str, float] = field(default_factory=dict)  #: leaky counts

    def lasts_s(self, name: str, holds: bool, now_s: float) -> float:
        """How long a condition has held without a break; −inf where it does not."""
        if not holds:
            self.since_s.pop(name, None)
            return -inf
        return now_s - self.since_s.setdefault(name, now_s)

    def over(self, *names: str) -> None:
        """Conditions hold no more, or still do not."""
        if self.since_s:
            for name in names:
                self.since_s.pop(name, None)
                self.in_all.pop(name, None)

    def in_all_s(self, name: str, holds: bool, now_s: float) -> float:
        """How long a condition that holds has done so in all, breaks left out, since it was :meth:`over`; −inf where it
        does not hold."""
        held_s, last_s, held = self.in_all.get(name, (0.0, now_s, False))
        if holds and held:
            held_s += now_s - last_s
        self.in_all[name] = held_s, now_s, holds
        return held_s if holds else -inf

    def running(self, name: str, holds: bool) -> int:
        """How many steps running a condition has held."""
        self.count[name] = self.count.get(name, 0) + 1 if holds else 0
        return self.count[name]

    def leaks(self, name: str, change: float) -> float:
        """A count after this change; it never falls below zero."""
        self.owed[name] = max(0.0, self.owed.get(name, 0.0) + change)
        return self.owed[name]


def made_ready() -> None:
    """Have the kernels of the guards compiled, or loaded: before current flows, which would go on through the seconds
    that it takes in the first step."""
    memory = Memory()
    for apart in (memory.currents, memory.voltages):
        apart.step(0.0, 0.0, 0.0, 0.0, 0.0)
    memory.load_alive.noise.step(0.0)


@record(frozen=True, slots=True)
class Waited:
    """How long the loop has waited for its instruments [s]: for each question no longer than its answer may take."""

    daq_s: float = 0.0
    supply_s: float = 0.0

    def since(self, before: Waited) -> Waited:
        """How long since then."""
        return Waited(self.daq_s - before.daq_s, self.supply_s - before.supply_s)

    def most(self, elapsed_s: float, period_s: float) -> tuple[str, str]:
        """Which instrument took most of the time between two steps, and a part of a sentence; "" where this computer
        did.

        What the loop meant to rest, a period, is nobody's.
        """
        own_s = elapsed_s - period_s - self.daq_s - self.supply_s
        most_s, name = max((own_s, ""), (self.supply_s, "supply"), (self.daq_s, "daq"))
        return name, f", {most_s:.3g} s of them waiting for the {name}" if name else ""


NOT_WAITED = Waited()


@dataclass(slots=True)
class Step:
    """What the guards see of one step.  ``reading`` is None where there is no usable new one."""

    config: SafetySections
    memory: Memory
    now_s: float
    dt_s: float
    driven: bool  #: the output is meant to be on
    settled: bool  #: enabled long enough for current and reading to belong together
    raw: Reading | None
    reading: Reading | None
    signals: Signals
    estimate: Estimate
    supply: SupplyState | None
    told: Command  #: what the supply was told in the step before
    heat: WireHeat
    waited: Waited = NOT_WAITED  #: since the step before
    told_s: float = -inf  #: since when the supply has been told that
    longer_m: float = 0.0  #: of the estimate: what is no transformation, but a load that hung on the wire before
    contradicted_m: float | None = None  #: what two guards ask for, once one of them has
    is_timely: bool = field(init=False)  #: it comes no later than readings may be old, by a clock that runs forward

    def __post_init__(self) -> None:
        self.is_timely = 0.0 <= self.dt_s <= self.config.safety.reading_timeout

    def gives_no_number(self, value: float, channel: str) -> str:
        """That a sensor which the parameters name gives none in this reading, in words, or ""."""
        if self.reading is None or not isnan(value) or not getattr(self.config.instruments.daq, channel):
            return ""
        return f"it reads no number, and instruments.daq.{channel} says that there is one"

    def held_up_by(self, name: str) -> str:
        """That a step with current comes too late because of this instrument, in words, or ""."""
        if not self.driven or self.is_timely or not 0.0 <= self.dt_s < inf:
            return ""
        most, words = self.waited.most(self.dt_s, 1.0 / self.config.loop.rate)
        if most != name:
            return ""
        bound_s = self.config.safety.reading_timeout
        return f"{self.dt_s:.3g} s since the step before{words}; safety.reading_timeout is {bound_s:g} s"
