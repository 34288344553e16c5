"""Who hangs masses and shorts the wire: a person at the terminal, or the virtual bench itself."""

from __future__ import annotations

import re
import time
from typing import Any, Protocol

from sma_actuator.base.newtons import newtons
from sma_actuator.base.parameters import ConfigError
from sma_actuator.console.asking import Asking
from sma_actuator.logs.units import GRAVITY_m_s2

from .rig import Rig
from .watching import LoadWatch

_SETTLES_WITHIN_s = 20.0  #: after which it is gone on with whatever hangs there
_LOOK_s = 0.1


class Operator(Protocol):
    """Does by hand what no instrument can.  Every method returns when it is done."""

    def short_wire(self) -> None:
        """Replace the wire by a short between its crimps."""

    def fit_wire(self) -> None:
        """Put the wire back."""

    def hang_mass(self, force_N: float) -> None:
        """Hang a calibration mass (its weight, hook included) from the load cell."""

    def hang_load(self, force_N: float) -> None:
        """Hang a weight from the wire."""

    def fit_spring(self, stiffness_N_m: float, preload_N: float) -> None:
        """Load the wire by a spring."""

    def place_probe(self, number: int, count: int) -> float:
        """Move the displacement sensor to the next of ``count`` places; return its true displacement [m]."""


class TerminalOperator:
    """Asks a person, or a file of answers, and waits; shows what the load cell reads where something is hung."""

    def __init__(self, asking: Asking, rig: Rig):
        self._asking, self._rig = asking, rig

    def short_wire(self) -> None:
        self._asking.ask("short_wire", "Replace the wire by a short between its crimps, then press Enter.")

    def fit_wire(self) -> None:
        self._asking.ask("fit_wire", "Fit the wire again, then press Enter.")

    def hang_mass(self, force_N: float) -> None:
        self._hang(
            "hang_mass",
            f"Hang {_in_grams(force_N)}, hook included, from the load cell; when it hangs still, press Enter.",
            None,
        )

    def hang_load(self, force_N: float) -> None:
        self._hang(
            "hang_load",
            f"Hang {_in_grams(force_N)}, probe and hook included, from the wire; when it hangs still, press Enter.",
            (force_N, force_N),
        )

    def fit_spring(self, stiffness_N_m: float, preload_N: float) -> None:
        self._hang(
            "fit_spring",
            f"Fit the spring of {stiffness_N_m:g} N/m with {preload_N:g} N at full extension, then press Enter.",
            (preload_N, preload_N + stiffness_N_m * self._rig.config.wire.full_stroke_m),
        )

    def _hang(self, name: str, question: str, expected_N: tuple[float, float] | None) -> None:
        """Ask until it hangs there.  Raises ConfigError where a file says that it does, and it does not."""
        while True:
            watch, from_file = LoadWatch(self._rig, expected_N), self._asking.answered(name)
            self._asking.ask(name, question, watch.look)
            end_s = time.monotonic() + _SETTLES_WITHIN_s
            while (shown := watch.look()).state != "settled" and time.monotonic() < end_s:
                time.sleep(_LOOK_s)
            self._asking.say(f"  {shown.text}")
            if not (wrong := watch.wrong()):
                return
            if from_file:
                raise ConfigError(f"{name}: {wrong}")
            self._asking.say(wrong)

    def place_probe(self, number: int, count: int) -> float:
        question = f"Move the sensor to place {number + 1} of {count}; micrometer reading in mm:"
        while True:
            from_file = self._asking.answered("place_probe")
            text = self._asking.ask("place_probe", question)
            try:
                return float(text.replace(",", ".")) * 1e-3
            except ValueError:
                if from_file:
                    raise ConfigError(f"place_probe: '{text}' is not a number of millimetres") from None
                self._asking.say(f"'{text}' is not a number of millimetres")


class BenchOperator:
    """Acts on a virtual bench in this process; ``extended_m``: displacement where a spring has its preload."""

    def __init__(self, bench, largest_force_N: float, extended_m: float):
        self._bench, self._largest_force_N, self._extended_m = bench, largest_force_N, extended_m

    def _put(self, load) -> None:
        self._bench.load = load
        self._bench.advance(self._bench.time_s + 0.01)  # until then nothing has moved

    def short_wire(self) -> None:
        self._bench.inject("short_wire")

    def fit_wire(self) -> None:
        self._bench.clear("short_wire")

    def hang_mass(self, force_N: float) -> None:
        self.hang_load(force_N)

    def hang_load(self, force_N: float) -> None:
        from sma_actuator.bench import Weight

        self._put(Weight(force_N))

    def fit_spring(self, stiffness_N_m: float, preload_N: float) -> None:
        from sma_actuator.bench import Spring

        self._put(Spring(stiffness_N_m, preload_N, self._extended_m))

    def place_probe(self, number: int, count: int) -> float:
        self.hang_load(self._largest_force_N * (number + 0.5) / count)  # the cold wire moves the probe
        return self._bench.truth.displacement_m


class ScpiBenchOperator:
    """Acts on a virtual bench over its ``BENCh:`` commands, on a connection of its own; arguments as there."""

    def __init__(self, resource: str, largest_force_N: float, extended_m: float):
        import pyvisa

        self._largest_force_N, self._extended_m = largest_force_N, extended_m
        self._session: Any = pyvisa.ResourceManager("@py").open_resource(
            resource, read_termination="\n", write_termination="\n", timeout=2000
        )

    def _do(self, command: str) -> None:
        answer = self._session.query(f"{command};:SYST:ERR?")
        if not re.match(r"\+?0\b", answer):
            raise RuntimeError(f"the virtual bench refused '{command}': {answer.strip()}")

    def short_wire(self) -> None:
        self._do("BENC:FAUL short_wire")

    def fit_wire(self) -> None:
        self._do("BENC:FAUL:CLE short_wire")

    def hang_mass(self, force_N: float) -> None:
        self.hang_load(force_N)

    def hang_load(self, force_N: float) -> None:
        self._do(f"BENC:LOAD:WEIG {force_N:.9g}")
        while abs(self._truth(7) - force_N) > 1e-6:  # until the bench has taken its next step
            pass

    def fit_spring(self, stiffness_N_m: float, preload_N: float) -> None:
        self._do(f"BENC:LOAD:SPR {stiffness_N_m:.9g},{preload_N:.9g},{self._extended_m:.9g}")

    def place_probe(self, number: int, count: int) -> float:
        self.hang_load(self._largest_force_N * (number + 0.5) / count)
        return self._truth(1)

    def _truth(self, column: int) -> float:
        return float(self._session.query("BENC:TRUT?").split(",")[column])


def _in_grams(force_N: float) -> str:
    grams = force_N / GRAVITY_m_s2 * 1e3
    return f"{grams:.1f} g ({newtons(force_N)} N)" if grams >= 10.0 else f"{grams:.3g} g ({newtons(force_N)} N)"
