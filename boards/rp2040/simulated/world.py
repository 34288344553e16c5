"""What stands around the processor: the parts on the board, and a wire of the virtual bench that its pulses heat.

The world has the processor's time.  Every call takes some of it; while the program waits it goes on to the next pulse
or byte.  With a ``clock`` it never runs ahead of that one: so it is where the board stands at the end of a real line.
"""

from __future__ import annotations

import math
import struct
import threading
from collections.abc import Callable

import numpy as np

from sma_actuator.bench import VirtualBench
from sma_actuator.bench.bench import STEP_s

GATE, POWERED, SERVICE, CELL_DATA, CELL_CLOCK, THERMOMETER = 15, 14, 22, 16, 17, 26
METER, CONVERTER = 0x40, 0x48
RAIL_V, RAIL_Ohm = 3.3, 0.15  #: supply of the wire, with fuse and MOSFET
SENSE_Ohm = 0.1
LEADS_Ohm = 0.02  #: taps at the crimps leave this of them
LEAST_Ohm = 0.01  #: of a shorted wire
CELL_N = 19.5  #: load at the full scale of the load cell's converter
CELL_ZERO = 0.003  #: what it shows without a load, of its full scale
SENSOR_slope_m_A, SENSOR_offset_m, SENSOR_Ohm = 0.315842, -1.2195e-3, 10.0  #: the bench's LVDT, read over its resistor
CELL_PERIOD_us, CONVERTER_us = 12_500, 1_250
CELL_OFF_us, CELL_SETTLES_us = 60, 50_000  #: a clock that stays high switches the HX711 off
METER_NOISE_V, RAIL_NOISE_V, CELL_NOISE = 1.5e-6, 1e-3, 1e-5  #: rms
#: What the processor needs for a call, and for hearing one byte [µs].
CALL_us, BYTE_us, I2C_BYTE_us = 8, 15, 23
LATE_us = 100_000  #: a busy computer lets the world lag by so much; what is more is lost: the world never jumps
_STEP_us = 5_000


class Reset(Exception):
    """The watchdog has started the processor anew: its program ends here."""


class World:
    """Parts, wire and time.  Calls come from the firmware's thread, ``truth`` and ``hear`` from any."""

    def __init__(
        self, bench: VirtualBench, seed: int = 0, clock: Callable[[], float] | None = None, send=lambda data: None
    ):
        self.bench, self.send = bench, send
        bench.supply.set_voltage(20.0)
        bench.supply.ocp_on = bench.supply.ovp_on = False
        self.dead: set[str] = set()  #: parts that do not answer: meter, cell, converter
        self.gate_stuck: bool | None = None  #: a MOSFET that conducts always, or never
        self.was_reset = False
        self.off_since_s = 0.0  #: when the last pulse was ended, by the processor's time
        self._random = np.random.default_rng(seed)
        self._clock = clock
        self._began_s = clock() if clock else 0.0
        self._us = 0
        self._lock = threading.RLock()
        self._turn = threading.Condition(self._lock)
        self._answers = {name[4:]: getattr(self, name) for name in dir(self) if name.startswith("_do_")}
        self._quiet_until_us = 0  #: before that nothing happens by itself
        self._heard = bytearray()
        self._gate = (0, 0, 0)  #: µs at which a period began, its length, how much of it is on
        self._pulse_us: float = math.inf  #: start of the next pulse that the program has not been told of
        self._registers = {METER: {0xFE: b"TI"}, CONVERTER: {}}
        self._converted_us = 0
        self._cell_bits, self._cell_left, self._clocked_us, self._cell_us = 0, 0, 0, CELL_PERIOD_us
        self._watchdog_us, self._fed_us = 0, 0

    # --- for whoever looks on

    @property
    def time_s(self) -> float:
        """The processor's."""
        return 1e-6 * self._us

    @property
    def truth(self):
        """The wire now."""
        with self._turn:
            return self.bench.truth

    @property
    def heats(self) -> bool:
        """Whether pulses go to the wire."""
        with self._turn:
            return self._share > 0.0

    def hear(self, data: bytes) -> None:
        """Bytes come over the line."""
        with self._turn:
            self._heard += data
            self._turn.notify_all()

    def boot(self) -> None:
        """The processor begins anew."""
        with self._turn:
            self.was_reset, self._watchdog_us = False, 0
            self._heard.clear()

    # --- the calls of the firmware

    def call(self, line: str) -> str:
        """Answer the last of what ``machine.py``, ``time.py`` and ``usb.py`` say, joined by ``;``.  Raises Reset."""
        answer = ""
        with self._lock:
            for each in line.split(";"):
                name, *words = each.split(" ")
                self._pass(CALL_us)
                answer = self._answers[name](*words)
        return answer

    def _do_pin(self, number: str, value: str | None = None) -> str:
        pin = int(number)
        if value is not None:
            if pin == CELL_CLOCK:
                self._clock_cell(value == "1")
            elif pin == GATE:
                self._set_gate(0, 0)
            return ""
        if pin == POWERED:
            return str(int(self._is_powered))
        if pin == CELL_DATA:
            return str(self._cell_data())
        return str(int(pin == SERVICE))

    def _do_pwm(self, number: str, frequency_Hz: str, on_ns: str) -> str:
        assert int(number) == GATE
        self._set_gate(round(1e6 / int(frequency_Hz)), round(1e-3 * int(on_ns)))
        return ""

    def _do_to(self, address: str, register: str, data: str) -> str:
        self._pass(I2C_BYTE_us * (2 + len(data) // 2))
        if self._is_dead(int(address)):
            return "none"
        if int(address) == METER and register == "0":
            self._measure()
        elif register == "1":
            self._converted_us = self._us + CONVERTER_us
        return ""

    def _do_from(self, address: str, register: str, count: str) -> str:
        self._pass(I2C_BYTE_us * (3 + int(count)))
        if self._is_dead(int(address)):
            return "none"
        if int(address) == CONVERTER:
            if register == "1":
                return "8583" if self._us >= self._converted_us else "0583"
            current_A = (self.bench.truth.displacement_m - SENSOR_offset_m) / SENSOR_slope_m_A
            return _word(current_A * SENSOR_Ohm / 62.5e-6)
        return self._registers[METER][int(register)].hex()

    def _do_adc(self, number: str) -> str:
        assert int(number) == THERMOMETER
        temperature_C = self.bench.ambient_C + 0.05 * self._random.standard_normal()
        return str(16 * round((0.5 + 0.01 * temperature_C) / 3.3 * 4095))

    def _do_watchdog(self, timeout_ms: str) -> str:
        self._watchdog_us, self._fed_us, self._quiet_until_us = 1000 * int(timeout_ms), self._us, 0
        return ""

    def _do_feed(self) -> str:
        self._fed_us = self._us
        return ""

    def _do_ticks(self) -> str:
        return str(self._us)

    def _do_sleep(self, us: str) -> str:
        self._pass(int(us))
        return ""

    def _do_wait(self, most_ms: str) -> str:
        until_us = self._us + 1000 * int(most_ms)
        while True:
            if self._heard:
                return ""
            if self.gate_stuck is not None:
                self._pulse_us = math.inf  # nothing rises
            if self._pulse_us <= self._us:
                self._pulse_us = self._next_pulse_us
                return "pulse"
            if self._us >= until_us:
                return ""
            self._sleep(min(until_us, self._pulse_us))

    def _do_read(self) -> str:
        data, self._heard = bytes(self._heard), bytearray()
        self._pass(BYTE_us * len(data))
        return data.hex()

    def _do_write(self, data: str) -> str:
        self.send(bytes.fromhex(data))
        return ""

    # --- time

    def _sleep(self, until_us: float) -> None:
        """On to then, or to the next byte; with a clock, when it is so late by that one."""
        if self._clock is None:
            self._pass(int(until_us) - self._us)
            return
        now_us = self._now_us()
        if now_us < until_us:
            self._turn.wait(1e-6 * (until_us - now_us))
            now_us = self._now_us()
        if (lost_us := now_us - LATE_us - until_us) > 0:  # this computer's fault, and not the program's
            self._began_s += 1e-6 * lost_us
            now_us -= int(lost_us)
        self._pass(int(min(max(now_us, self._us), until_us)) - self._us)

    def _now_us(self) -> int:
        assert self._clock is not None
        return int(1e6 * (self._clock() - self._began_s))

    def pass_by(self, seconds: float) -> None:
        """Time passes without the program."""
        with self._turn:
            self._pass(round(1e6 * seconds), raises=False)

    def keep_up(self) -> None:
        """The program has been stopped, and the clock goes on."""
        with self._turn:
            self._pass(self._now_us() - self._us, raises=False)

    def _pass(self, us: int, raises: bool = True) -> None:
        """Time passes: the wire is heated by the direct current that the pulses stand for."""
        end_us = self._us + us
        if end_us < self._quiet_until_us:
            self._us = end_us
            return
        while self._us < end_us:
            step_us = min(end_us, self._us + _STEP_us) - self._us
            if self._watchdog_us and not self.was_reset:
                left_us = self._fed_us + self._watchdog_us - self._us
                if left_us <= 0:
                    self.was_reset = True
                    self._set_gate(0, 0)  # its pins are open, and a resistor pulls the gate off
                else:
                    step_us = min(step_us, left_us)
            self._us += step_us
            if self.time_s - self.bench.time_s >= STEP_s:
                supply = self.bench.supply
                supply.current_A = math.sqrt(self._share) * self._full_A
                supply.output_on = supply.current_A > 0.0
                self.bench.advance(self.time_s)
        moves_us = int(1e6 * (self.bench.time_s + STEP_s)) - 1
        cuts_us = self._fed_us + self._watchdog_us if self._watchdog_us else moves_us
        self._quiet_until_us = 0 if self.was_reset else min(moves_us, cuts_us)
        if self.was_reset and raises:
            raise Reset

    # --- pulses

    @property
    def _share(self) -> float:
        if self.gate_stuck is not None:
            return float(self.gate_stuck)
        _, period_us, on_us = self._gate
        return on_us / period_us if period_us else 0.0

    @property
    def _is_powered(self) -> bool:
        if self.gate_stuck is not None:
            return self.gate_stuck
        began_us, period_us, on_us = self._gate
        return period_us > 0 and (self._us - began_us) % period_us < on_us

    def _set_gate(self, period_us: int, on_us: int) -> None:
        began_us, before_us, _ = self._gate
        if period_us == 0 and before_us:
            self.off_since_s = self.time_s
        if period_us == 0 or self.was_reset:
            self._gate, self._pulse_us = (0, 0, 0), math.inf
            return
        began_us = self._us - (self._us - began_us) % before_us if before_us else self._us
        self._gate = (began_us, period_us, on_us)
        self._pulse_us = self._us if not before_us else self._next_pulse_us

    @property
    def _next_pulse_us(self) -> int:
        began_us, period_us, _ = self._gate
        return self._us + period_us - (self._us - began_us) % period_us

    @property
    def _circuit_Ohm(self) -> float:
        """Wire, leads and sense resistor."""
        faults = self.bench.faults
        if "open_wire" in faults:
            return math.inf
        wire_Ohm = faults["short_wire"] or LEAST_Ohm if "short_wire" in faults else self.bench.truth.resistance_Ohm
        return wire_Ohm + LEADS_Ohm + SENSE_Ohm

    @property
    def _full_A(self) -> float:
        """What flows while the MOSFET conducts."""
        return RAIL_V / (self._circuit_Ohm + RAIL_Ohm)

    # --- parts

    def _is_dead(self, address: int) -> bool:
        return {METER: "meter", CONVERTER: "converter"}[address] in self.dead

    def _measure(self) -> None:
        flows = self._is_powered
        current_A = self._full_A if flows else 0.0
        circuit_V = RAIL_V - current_A * RAIL_Ohm + RAIL_NOISE_V * self._random.standard_normal() if flows else 0.0
        if flows and math.isfinite(self._circuit_Ohm):  # noise of the supply is in both
            current_A = circuit_V / self._circuit_Ohm
        sense_V = current_A * SENSE_Ohm + METER_NOISE_V * self._random.standard_normal()
        circuit_V += 1e-4 * self._random.standard_normal()
        self._registers[METER][1] = bytes.fromhex(_word(sense_V / 2.5e-6))
        self._registers[METER][2] = bytes.fromhex(_word(max(circuit_V, 0.0) / 1.25e-3))

    def _cell_data(self) -> int:
        if "cell" in self.dead:
            return 1
        if self._cell_left:
            return self._cell_bits >> self._cell_left - 1 & 1
        return int(self._us < self._cell_us)

    def _clock_cell(self, high: bool) -> None:
        if not high:
            if self._us - self._clocked_us > CELL_OFF_us:
                self._cell_left, self._cell_us = 0, self._us + CELL_SETTLES_us
            return
        self._clocked_us = self._us
        if self._cell_left == 0:
            shown = self.bench.truth.load_N / CELL_N + CELL_ZERO + CELL_NOISE * self._random.standard_normal()
            code = min(max(round(shown * (1 << 23)), -(1 << 23)), (1 << 23) - 1)
            self._cell_bits, self._cell_left = code & 0xFFFFFF, 25
        self._cell_left -= 1
        if self._cell_left == 0:
            self._cell_us = self._us + CELL_PERIOD_us


def _word(value: float) -> str:
    """Sixteen bits, saturated."""
    return struct.pack(">h", min(max(round(value), -(1 << 15)), (1 << 15) - 1)).hex()
