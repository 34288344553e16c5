"""Small emulators of families of supplies, each written from the commands in its manual, not from our dialect of it.

A line that the manual does not have is an error as the family reports errors: in its queue, by its answer, or not at
all.  Behind every output hangs a load, so voltage, current and trips follow from what was programmed.
"""

from __future__ import annotations

import re
from typing import ClassVar


class Output:
    """A supply's output and what hangs on it."""

    def __init__(self):
        self.set_V, self.set_A, self.on = 1.0, 0.01, True  # as somebody has left it
        self.ovp_V = self.ocp_A = float("inf")
        self.ovp_on = True
        self.trips_in_cc = False  #: an over-current protection that trips in constant current
        self.load_Ohm = 6.25
        self.surge_V = 0.0  #: from outside
        self.surge_A = 0.0
        self.tripped: set[str] = set()

    def measure(self) -> tuple[float, float]:
        """Volts and amperes, after protections have had their say."""
        current_A = min(self.set_A, self.set_V / self.load_Ohm) if self.on else 0.0
        voltage_V = current_A * self.load_Ohm
        if self.on:
            if self.ovp_on and voltage_V + self.surge_V > self.ovp_V:
                self.tripped.add("OVP")
            if current_A + self.surge_A > self.ocp_A or (self.trips_in_cc and self.set_A < self.set_V / self.load_Ohm):
                self.tripped.add("OCP")
        if self.tripped:
            self.on = False
            return 0.0, 0.0
        return voltage_V, current_A

    def clear(self) -> None:
        """Forget the trips."""
        self.tripped.clear()
        self.surge_V = self.surge_A = 0.0


class Family:
    """Commands by their texts, as regular expressions; ``answers`` is what a subclass fills."""

    identity = ""
    hears, says = "\n", "\n"
    serial = False
    rate_Hz = 20.0  #: of a loop that it is quick enough for
    #: What the manual says of it, for the tests.
    has_ovp = has_ocp = False
    says_what_tripped = True  #: where anything does
    parameters: ClassVar[dict] = {}  #: that its owner must choose otherwise

    def __init__(self):
        self.out = Output()
        self.errors: list[str] = ["-350,left by somebody"]
        self.refused: list[str] = []  #: every line that it does not know
        self.table = [(re.compile(pattern), handler) for pattern, handler in self.commands()]

    def commands(self):
        """(pattern, handler of its groups) pairs."""
        raise NotImplementedError

    def unknown(self, line):
        self.refused.append(line)
        self.errors.append(f'-113,"Undefined header;{line}"')
        return

    def __call__(self, line):
        self.out.measure()
        for pattern, handler in self.table:
            if found := pattern.fullmatch(line):
                return handler(*found.groups())
        return self.unknown(line)

    # --- what many have -------------------------------------------------------------------------------

    def set(self, name, convert=float):
        """A handler that sets one attribute of the output."""
        return lambda text: setattr(self.out, name, convert(text))

    def get(self, name, form="{:+.6E}"):
        return lambda: form.format(getattr(self.out, name))

    def volts(self, form="{:+.6E}"):
        return lambda: form.format(self.out.measure()[0])

    def amperes(self, form="{:+.6E}"):
        return lambda: form.format(self.out.measure()[1])

    def trip(self, name, yes="1", no="0"):
        return lambda: yes if (self.out.measure(), name in self.out.tripped)[1] else no

    def next_error(self, none='+0,"No error"'):
        return lambda: self.errors.pop(0) if self.errors else none

    def clear_errors(self):
        self.errors.clear()

    def scpi(self):
        """IEEE 488.2 and the error queue."""
        return [
            (r"\*IDN\?", lambda: self.identity),
            (r"\*CLS", self.clear_errors),
            (r"SYST:ERR\?", self.next_error()),
        ]


ON_OFF = {"ON": True, "OFF": False, "1": True, "0": False}
NUMBER = r"([-+0-9.E]+)"


class AimTtiPl(Family):
    """PL303-P: headers and units, a register of trips that reading clears."""

    identity = "THURLBY THANDAR, PL303-P, 279730, 1.02-1.16"
    says = "\r\n"
    has_ovp = has_ocp = True

    def __init__(self):
        super().__init__()
        self.told = set()

    def commands(self):
        return [
            (r"\*IDN\?", lambda: self.identity),
            (r"\*CLS", self.clear_errors),
            (r"EER\?", lambda: str(100) if self.errors and self.errors.pop() else "0"),
            (rf"V1 {NUMBER}", self.set("set_V")),
            (rf"I1 {NUMBER}", self.set("set_A")),
            (rf"OVP1 {NUMBER}", self.set("ovp_V")),
            (rf"OCP1 {NUMBER}", self.set("ocp_A")),
            (r"OP1 ([01])", self.switch),
            (r"TRIPRST", self.reset),
            (r"V1\?", self.get("set_V", "V1 {:.3f}")),
            (r"I1\?", self.get("set_A", "I1 {:.4f}")),
            (r"OVP1\?", self.get("ovp_V", "VP1 {:.1f}")),
            (r"OCP1\?", self.get("ocp_A", "CP1 {:.2f}")),
            (r"OP1\?", lambda: str(int(self.out.on))),
            (r"V1O\?", self.volts("{:.3f}V")),
            (r"I1O\?", self.amperes("{:.4f}A")),
            (r"LSR1\?", self.limits),
        ]

    def switch(self, text):
        self.out.on = text == "1" and not self.out.tripped

    def reset(self):
        self.out.clear()
        self.told.clear()

    def limits(self):
        self.out.measure()
        new = self.out.tripped - self.told
        self.told |= new
        return str(4 * ("OVP" in new) + 8 * ("OCP" in new) + 2)


class AimTtiEl(Family):
    """EL302P: a serial line, no 0 A, an error register that answers with its name."""

    identity = "THURLBY-THANDAR,EL302P,0,v1.00"
    says = "\r\n"
    serial = True

    def commands(self):
        return [
            (r"\*IDN\?", lambda: self.identity),
            (r"\*RST", lambda: None),
            (r"ERR\?", lambda: f"ERR {2 if self.errors and self.errors.pop() else 0}"),
            (rf"V {NUMBER}", self.set("set_V")),
            (rf"I {NUMBER}", self.set_current),
            (r"ON", lambda: setattr(self.out, "on", True)),
            (r"OFF", lambda: setattr(self.out, "on", False)),
            (r"V\?", self.get("set_V", "V {:.2f}")),
            (r"I\?", self.get("set_A", "I {:.2f}")),
            (r"VO\?", self.volts("V {:.2f}")),
            (r"IO\?", self.amperes("I {:.2f}")),
            (r"OUT\?", lambda: f"OUT {'ON' if self.out.on else 'OFF'}"),
            (r"M\?", lambda: "M CC"),
        ]

    def set_current(self, text):
        if not 0.01 <= float(text) <= 2.01:
            self.errors.append(f"I {text}")
        else:
            self.out.set_A = float(text)


class Genesys(Family):
    """A GEN40-38 at address 6: silent until addressed, every command acknowledged."""

    identity = "LAMBDA,GEN40-38"
    hears = says = "\r"
    serial = True

    def __init__(self):
        super().__init__()
        self.addressed, self.foldback, self.ovp_V = False, True, 44.0
        self.errors.clear()  # it says them at once, and keeps none

    def __call__(self, line):
        if found := re.fullmatch(r"ADR (\d+)", line):
            self.addressed = int(found[1]) == 6
            return "OK" if self.addressed else None
        if not self.addressed:
            return None
        self.out.trips_in_cc = self.foldback
        return super().__call__(line)

    def unknown(self, line):
        self.refused.append(line)
        return "C01"

    def commands(self):
        return [
            (r"IDN\?", lambda: self.identity),
            (r"CLS", lambda: "OK"),
            (r"RMT (?:REM|LOC|LLO|[012])", lambda: "OK"),
            (r"FLD (0|1|ON|OFF)", lambda text: self.told("foldback", ON_OFF[text])),
            (r"AST (?:0|1|ON|OFF)", lambda: "OK"),
            (rf"UVL {NUMBER}", lambda text: "OK" if float(text) <= self.out.set_V else "E06"),
            (r"OVM", lambda: self.told("ovp_V", 44.0)),
            (
                rf"OVP {NUMBER}",
                lambda text: "E04" if float(text) < self.out.set_V + 2.0 else self.told("ovp_V", float(text)),
            ),
            (
                rf"PV {NUMBER}",
                lambda text: "E01" if float(text) > 0.95 * self.ovp_V else self.output("set_V", float(text)),
            ),
            (rf"PC {NUMBER}", lambda text: "C05" if float(text) > 38 * 1.05 else self.output("set_A", float(text))),
            (r"OUT (0|1|ON|OFF)", self.switch),
            (r"OUT\?", lambda: "ON" if self.out.on else "OFF"),
            (r"STT\?", self.status),
        ]

    def told(self, name, value):
        setattr(self, name, value)
        return "OK"

    def output(self, name, value):
        setattr(self.out, name, value)
        return "OK"

    def switch(self, text):
        if ON_OFF[text] and self.out.tripped and self.out.surge_V:
            return "E07"
        if not ON_OFF[text]:
            self.out.clear()
        self.out.on = ON_OFF[text]
        return "OK"

    def status(self):
        voltage_V, current_A = self.out.measure()
        self.out.ovp_V = self.ovp_V
        fault = 0x10 * ("OVP" in self.out.tripped) + 0x08 * ("OCP" in self.out.tripped)
        out = self.out
        return f"MV({voltage_V:06.3f}),PV({out.set_V:g}),MC({current_A:07.4f}),PC({out.set_A:g}),SR(04),FR({fault:02X})"


class TripsInConstantCurrent(Family):
    """An over-voltage trip, and an over-current protection that trips in constant current and is on as it comes."""

    has_ovp = True

    def __init__(self):
        super().__init__()
        self.out.trips_in_cc = True


class KeysightE36300(TripsInConstantCurrent):
    """E36312A, channel 1."""

    identity = "Keysight Technologies,E36312A,MY12345678,1.1.0-1.0.0-1.00"

    def commands(self):
        return [
            *self.scpi(),
            (rf"VOLT {NUMBER},\(@1\)", self.set("set_V")),
            (rf"CURR {NUMBER},\(@1\)", self.set("set_A")),
            (rf"VOLT:PROT {NUMBER},\(@1\)", self.set("ovp_V")),
            (r"CURR:PROT:STAT (ON|OFF|0|1),\(@1\)", self.set("trips_in_cc", ON_OFF.__getitem__)),
            (r"OUTP (ON|OFF|0|1),\(@1\)", self.set("on", ON_OFF.__getitem__)),
            (r"(?:VOLT|CURR):PROT:CLE \(@1\)", self.out.clear),
            (r"VOLT\? \(@1\)", self.get("set_V")),
            (r"CURR\? \(@1\)", self.get("set_A")),
            (r"VOLT:PROT\? \(@1\)", self.get("ovp_V")),
            (r"OUTP\? \(@1\)", lambda: str(int(self.out.on))),
            (r"MEAS:VOLT\? \(@1\)", self.volts()),
            (r"MEAS:CURR\? \(@1\)", self.amperes()),
            (r"VOLT:PROT:TRIP\? \(@1\)", self.trip("OVP")),
            (r"CURR:PROT:TRIP\? \(@1\)", self.trip("OCP")),
        ]


class Siglent(Family):
    """SPD3303X, channel 1: a status word in hexadecimal, no *CLS, errors with their words behind two blanks."""

    rate_Hz = 5.0
    identity = "Siglent Technologies,SPD3303X,SPD3XGB4150080,1.01.01.01.02R5,V3.0"

    def commands(self):
        return [
            (r"\*IDN\?", lambda: self.identity),
            (
                r"SYST:ERR\?",
                lambda: "0  No Error" if not self.errors else (self.errors.pop(0), "102  Invalid command")[1],
            ),
            (rf"CH1:VOLT {NUMBER}", self.set("set_V")),
            (rf"CH1:CURR {NUMBER}", self.set("set_A")),
            (r"OUTP CH1,(ON|OFF)", self.set("on", ON_OFF.__getitem__)),
            (r"CH1:VOLT\?", self.get("set_V", "{:.3f}")),
            (r"CH1:CURR\?", self.get("set_A", "{:.3f}")),
            (r"MEAS:VOLT\? CH1", self.volts("{:.3f}")),
            (r"MEAS:CURR\? CH1", self.amperes("{:.3f}")),
            (r"SYST:STAT\?", lambda: f"0x{0x04 + 0x20 + 0x10 * self.out.on + 0x01:x}"),  # channel 2 is on as well
        ]

    def __init__(self):
        super().__init__()


class SiglentSpd1000x(Siglent):
    """SPD1168X: the same with one channel, and two trips that are always on and do not say that they have tripped."""

    identity = "Siglent Technologies,SPD1168X,SPD13DCC4R0348,2.1.1.9,V1.0"
    has_ovp = has_ocp = True
    says_what_tripped = False

    def commands(self):
        return [
            *super().commands(),
            (rf"OVP {NUMBER}", self.set("ovp_V")),
            (rf"OCP {NUMBER}", self.set("ocp_A")),
            (r"OVP\?", self.get("ovp_V", "{:.3f}")),
            (r"OCP\?", self.get("ocp_A", "{:.3f}")),
            (r"OUTP:RESE:PROT", self.out.clear),
        ]


class Kepco(Family):
    """A BOP with a BIT 4886: on its serial line it obeys in remote alone, and comes in voltage mode."""

    identity = "KEPCO,BIT 4886 50-20 BOP,H123456,2.0"
    serial = True

    def __init__(self):
        super().__init__()
        self.remote, self.mode = False, "VOLT"

    def __call__(self, line):
        if line in ("SYST:REM ON", "SYST:REM OFF"):
            self.remote = line == "SYST:REM ON"
            return None
        if not self.remote and "?" not in line:
            return None
        return super().__call__(line)

    def commands(self):
        return [
            *self.scpi(),
            (r"FUNC:MODE (VOLT|CURR)", lambda text: setattr(self, "mode", text)),
            (rf"VOLT {NUMBER}", self.set("set_V")),
            (rf"CURR {NUMBER}", self.set("set_A")),
            (r"OUTP (ON|OFF|0|1)", self.set("on", ON_OFF.__getitem__)),
            (r"VOLT\?", self.get("set_V")),
            (r"CURR\?", self.get("set_A")),
            (r"OUTP\?", lambda: str(int(self.out.on))),
            (r"MEAS:VOLT\?", self.volts()),
            (r"MEAS:CURR\?", self.amperes()),
        ]


class Agilent66xx(TripsInConstantCurrent):
    """6632B: trips as bits of a register."""

    identity = "HEWLETT-PACKARD,6632B,0,A.02.07"

    def commands(self):
        return [
            *self.scpi(),
            (rf"VOLT {NUMBER}", self.set("set_V")),
            (rf"CURR {NUMBER}", self.set("set_A")),
            (rf"VOLT:PROT {NUMBER}", self.set("ovp_V")),
            (r"CURR:PROT:STAT (ON|OFF|0|1)", self.set("trips_in_cc", ON_OFF.__getitem__)),
            (r"OUTP (ON|OFF|0|1)", self.set("on", ON_OFF.__getitem__)),
            (r"OUTP:PROT:CLE", self.out.clear),
            (r"VOLT\?", self.get("set_V")),
            (r"CURR\?", self.get("set_A")),
            (r"VOLT:PROT\?", self.get("ovp_V")),
            (r"OUTP\?", lambda: str(int(self.out.on))),
            (r"MEAS:VOLT\?", self.volts()),
            (r"MEAS:CURR\?", self.amperes()),
            (r"STAT:QUES:COND\?", lambda: f"+{('OVP' in self.out.tripped) + 2 * ('OCP' in self.out.tripped)}"),
        ]


class Hp663xA(TripsInConstantCurrent):
    """6632A: no SCPI, no setting that can be asked for, a status word that says whether it regulates."""

    identity = "HP6632A"
    says = "\r\n"

    def commands(self):
        return [
            (r"ID\?", lambda: self.identity),
            (r"ERR\?", lambda: " 11" if self.errors and self.errors.pop(0) else "  0"),
            (rf"VSET {NUMBER}", self.set("set_V")),
            (rf"ISET {NUMBER}", self.set("set_A")),
            (rf"OVSET {NUMBER}", self.set("ovp_V")),
            (r"OCP ([01])", self.set("trips_in_cc", ON_OFF.__getitem__)),
            (r"OUT ([01])", self.set("on", ON_OFF.__getitem__)),
            (r"RST", self.out.clear),
            (r"VOUT\?", self.volts(" {:.3f}")),
            (r"IOUT\?", self.amperes(" {:.4f}")),
            (r"STS\?", self.status),
        ]

    def status(self):
        self.out.measure()
        tripped = 8 * ("OVP" in self.out.tripped) + 64 * ("OCP" in self.out.tripped)
        return f"{2048 + tripped + 2 * self.out.on:4d}"


class Hmp(Family):
    """HMP4040: a chosen channel, its own switch and a general one, a fuse that trips in constant current."""

    identity = "ROHDE&SCHWARZ,HMP4040,103781,HW50020002/SW2.51"
    has_ovp = True

    def __init__(self):
        super().__init__()
        self.channel, self.selected, self.general = 4, True, True
        self.out.trips_in_cc = True

    def __call__(self, line):
        if found := re.fullmatch(r"INST:NSEL ([1-4])", line):
            self.channel = int(found[1])
            return None
        if self.channel != 1 and not line.startswith(("*", "SYST")):
            raise AssertionError(f"channel {self.channel} was told '{line}'")
        return super().__call__(line)

    def commands(self):
        return [
            *self.scpi(),
            (r"SYST:(?:MIX|LOC|REM)", lambda: None),
            (r"FUSE (ON|OFF)", self.set("trips_in_cc", ON_OFF.__getitem__)),
            (rf"VOLT {NUMBER}", self.set("set_V")),
            (rf"CURR {NUMBER}", self.set("set_A")),
            (rf"VOLT:PROT {NUMBER}", self.set("ovp_V")),
            (r"VOLT:PROT:CLE", self.out.clear),
            (r"OUTP:SEL (ON|OFF)", lambda text: self.switch("selected", text)),
            (r"OUTP:GEN (ON|OFF)", lambda text: self.switch("general", text)),
            (r"OUTP:SEL\?", lambda: str(int(self.selected))),
            (r"VOLT\?", self.get("set_V", "{:.3f}")),
            (r"CURR\?", self.get("set_A", "{:.4f}")),
            (r"VOLT:PROT\?", self.get("ovp_V", "{:.3f}")),
            (r"MEAS:VOLT\?", self.volts("{:.3f}")),
            (r"MEAS:CURR\?", self.amperes("{:.4f}")),
            (r"VOLT:PROT:TRIP\?", self.trip("OVP")),
        ]

    def switch(self, name, text):
        setattr(self, name, ON_OFF[text])
        self.out.on = self.selected and self.general


class Nge(Hmp):
    """NGE103B: as an HMP, but VOLT:PROT is the switch of the over-voltage trip and VOLT:PROT:LEV its value."""

    identity = "Rohde&Schwarz,NGE103B,5601.3800k03/101863,1.54"
    switches, least_A = ("SEL", "GEN"), 0.0

    def __init__(self):
        super().__init__()
        self.out.ovp_on = False

    def commands(self):
        own, general = self.switches
        theirs = [
            command for command in super().commands() if not command[0].startswith(("VOLT:PROT", "OUTP", "CURR "))
        ]
        return [
            *theirs,
            (rf"CURR {NUMBER}", self.set_current),
            (r"VOLT:PROT (ON|OFF|1|0)", self.set("ovp_on", ON_OFF.__getitem__)),
            (r"VOLT:PROT\?", lambda: str(int(self.out.ovp_on))),
            (rf"VOLT:PROT:LEV {NUMBER}", self.set("ovp_V")),
            (r"VOLT:PROT:LEV\?", self.get("ovp_V", "{:.3E}")),
            (r"VOLT:PROT:CLE", self.out.clear),
            (r"VOLT:PROT:TRIP\?", self.trip("OVP")),
            (rf"OUTP:{own} (ON|OFF)", lambda text: self.switch("selected", text)),
            (rf"OUTP:{general} (ON|OFF)", lambda text: self.switch("general", text)),
            (rf"OUTP:{own}\?", lambda: str(int(self.selected))),
        ]

    def set_current(self, text):
        if float(text) < self.least_A:
            self.errors.append('-222,"Data out of range"')
        else:
            self.out.set_A = float(text)


class Hmc(Nge):
    """HMC8043: other words for the two switches, and no 0 A."""

    identity = "Rohde&Schwarz,HMC8043,023456789,HW42000000/SW01.400"
    switches, least_A = ("CHAN", "MAST"), 0.0005


class Itech(Family):
    """IT6833A on a serial line: deaf until remote."""

    identity = "ITECH Ltd., IT6833A, 602071010707210002, 1.06-1.04"
    serial = True
    has_ovp = True

    def __init__(self):
        super().__init__()
        self.remote = False

    def __call__(self, line):
        if line in ("SYST:REM", "SYST:LOC"):
            self.remote = line == "SYST:REM"
            return None
        if not self.remote and "?" not in line:
            self.errors.append("170,not in remote")
            return None
        return super().__call__(line)

    def commands(self):
        return [
            *self.scpi(),
            (rf"VOLT {NUMBER}", self.set("set_V")),
            (rf"CURR {NUMBER}", self.set("set_A")),
            (rf"VOLT:PROT {NUMBER}", self.set("ovp_V")),
            (r"VOLT:PROT:STAT ([01])", self.set("ovp_on", ON_OFF.__getitem__)),
            (r"VOLT:PROT:STAT\?", lambda: str(int(self.out.ovp_on))),
            (r"VOLT:PROT:CLE", self.out.clear),
            (r"OUTP ([01])", self.set("on", ON_OFF.__getitem__)),
            (r"VOLT\?", self.get("set_V", "{:.3f}")),
            (r"CURR\?", self.get("set_A", "{:.4f}")),
            (r"VOLT:PROT\?", self.get("ovp_V", "{:.3f}")),
            (r"OUTP\?", lambda: str(int(self.out.on))),
            (r"MEAS:VOLT\?", self.volts("{:.4f}")),
            (r"MEAS:CURR\?", self.amperes("{:.5f}")),
            (r"VOLT:PROT:TRIP\?", self.trip("OVP")),
        ]


class BK9115(Itech):
    """B&K Precision 9115: as the one above, but for the words of its trip."""

    identity = "B&K PRECISION, 9115, 00000000000004, V1.01-V1.00"

    def commands(self):
        theirs = {r"VOLT:PROT:CLE": r"PROT:CLE", r"VOLT:PROT:TRIP\?": r"VOLT:PROT:TRIG\?"}
        return [(theirs.get(pattern, pattern), answer) for pattern, answer in super().commands()]


class Keithley2400(Family):
    """A SourceMeter: READ? with its output off is an error and no answer; it must have been made a current source."""

    identity = "KEITHLEY INSTRUMENTS INC.,MODEL 2400,1308247,C32 Oct  4 2010 14:20:11/A02  /E/H"

    def __init__(self):
        super().__init__()
        self.source, self.senses, self.elements = "VOLT", "CURR", "VOLT,CURR,RES,TIME,STAT"

    def commands(self):
        return [
            *self.scpi(),
            (r"OUTP:SMOD (?:HIMP|NORM|ZERO|GUAR)", lambda: None),
            (r"SOUR:CLE:AUTO (?:ON|OFF)", lambda: None),
            (r"SOUR:FUNC (CURR|VOLT)", lambda text: setattr(self, "source", text)),
            (r"SOUR:CURR:MODE FIX", lambda: None),
            (rf"SOUR:CURR:RANG {NUMBER}", lambda text: None),
            (r"SENS:FUNC:CONC (?:ON|OFF)", lambda: None),
            (r"SENS:FUNC (.*)", lambda text: setattr(self, "senses", text)),
            (rf"SENS:VOLT:RANG {NUMBER}", lambda text: None),
            (rf"SENS:VOLT:NPLC {NUMBER}", lambda text: None),
            (r"FORM:ELEM (.*)", lambda text: setattr(self, "elements", text)),
            (r"(?:ARM|TRIG):COUN 1", lambda: None),
            (rf"SOUR:CURR {NUMBER}", self.set("set_A")),
            (rf"SENS:VOLT:PROT {NUMBER}", self.set("set_V")),
            (r"OUTP (ON|OFF)", self.set("on", ON_OFF.__getitem__)),
            (r"SOUR:CURR\?", self.get("set_A")),
            (r"SENS:VOLT:PROT\?", self.get("set_V")),
            (r"OUTP\?", lambda: str(int(self.out.on))),
            (r"READ\?", self.read),
        ]

    def read(self):
        if not self.out.on:
            self.errors.append('+803,"Not permitted with OUTPUT off"')
            return None
        assert (self.source, self.senses, self.elements) == ("CURR", '"VOLT","CURR"', "VOLT,CURR")
        voltage_V, current_A = self.out.measure()
        return f"{voltage_V:+.6E},{current_A:+.6E}"


class Korad(Family):
    """KA3005P: a pause ends a line, nothing an answer; a raw byte for a status; nothing is said of what it does not
    know; OCP trips in constant current."""

    identity = "Korad KA series (KA3003P, KA3005P, KA6003P) (not asked)"
    hears = says = ""
    serial = True
    rate_Hz = 2.0

    def __init__(self):
        super().__init__()
        self.errors = []  # it has no queue of them
        self.out.trips_in_cc = True

    def unknown(self, line):
        self.refused.append(line)

    def switch(self, text):
        """Of a trip nothing is left."""
        self.out.clear()
        self.out.on = text == "1"

    def commands(self):
        return [
            (r"ISET1:(\d\.\d{3})", self.set("set_A")),
            (r"VSET1:(\d\d\.\d\d)", self.set("set_V")),
            (r"OUT([01])", self.switch),
            (r"OCP([01])", self.set("trips_in_cc", lambda text: text == "1")),
            (r"OVP0", lambda: None),
            (r"VSET1\?", self.get("set_V", "{:05.2f}")),
            (r"VOUT1\?", self.volts("{:05.2f}")),
            (r"IOUT1\?", self.amperes("{:.3f}")),
            (r"STATUS\?", lambda: chr(0x90 + 0x40 * self.out.on)),  # with a bit that no text has
        ]


class OwonSpe(Family):
    """SPE3103 on its USB: trips that a voltage must stay 1 V below, or it is not taken and nothing said; ERR to what it
    does not know."""

    identity = "OWON,SPE3103,24110477,FV:V5.2.0"
    says = "\r\n"
    serial = True
    has_ovp = has_ocp = True
    rate_Hz = 5.0
    parameters: ClassVar[dict] = {"supply.over_voltage_trip": 7.5}

    def __init__(self):
        super().__init__()
        self.errors = []  # it has no queue of them
        self.out.ovp_V, self.out.ocp_A = 2.5, 10.5  # as somebody has left them

    def unknown(self, line):
        self.refused.append(line)
        return "ERR"

    def commands(self):
        return [
            (r"\*IDN\?", lambda: self.identity),
            (rf"VOLT {NUMBER}", lambda text: self.keep_apart(float(text), self.out.ovp_V)),
            (rf"VOLT:LIM {NUMBER}", lambda text: self.keep_apart(self.out.set_V, float(text))),
            (rf"CURR {NUMBER}", self.set("set_A")),
            (rf"CURR:LIM {NUMBER}", self.set("ocp_A")),
            (r"OUTP (ON|OFF)", self.switch),
            (r"VOLT\?", self.get("set_V", "{:.3f}")),
            (r"CURR\?", self.get("set_A", "{:.3f}")),
            (r"VOLT:LIM\?", self.get("ovp_V", "{:.3f}")),
            (r"CURR:LIM\?", self.get("ocp_A", "{:.3f}")),
            (r"OUTP\?", lambda: "ON" if self.out.on else "OFF"),
            (r"MEAS:ALL:INFO\?", self.everything),
        ]

    def keep_apart(self, set_V, ovp_V):
        if set_V <= ovp_V - 1.0:
            self.out.set_V, self.out.ovp_V = set_V, ovp_V

    def switch(self, text):
        """A trip goes with it."""
        self.out.clear()
        self.out.on = text == "ON"

    def everything(self):
        voltage_V, current_A = self.out.measure()
        trips = ",".join("ON" if name in self.out.tripped else "OFF" for name in ("OVP", "OCP", "OTP"))
        return f"{voltage_V:.3f},{current_A:.3f},{voltage_V * current_A:.3f},{trips},{2 if self.out.on else 0}"


class AgilentE3632A(Family):
    """E3634A on RS-232: two trips with switches of their own; clearing one would restore the output."""

    identity = "HEWLETT-PACKARD,E3634A,0,2.1-5.0-1.0"
    says = "\r\n"
    serial = True
    has_ovp = has_ocp = True
    rate_Hz = 10.0

    def __init__(self):
        super().__init__()
        self.ovp_on = self.ocp_on = False

    def commands(self):
        return [
            *self.scpi(),
            (r"SYST:(?:REM|LOC)", lambda: None),
            (rf"VOLT {NUMBER}", self.set("set_V")),
            (rf"CURR {NUMBER}", self.set("set_A")),
            (rf"VOLT:PROT {NUMBER}", self.set("ovp_V")),
            (rf"CURR:PROT {NUMBER}", self.set("ocp_A")),
            (r"VOLT:PROT:STAT (ON|OFF)", lambda text: setattr(self, "ovp_on", ON_OFF[text])),
            (r"CURR:PROT:STAT (ON|OFF)", lambda text: setattr(self, "ocp_on", ON_OFF[text])),
            (r"(?:VOLT|CURR):PROT:CLE", self.out.clear),
            (r"OUTP (ON|OFF)", self.set("on", ON_OFF.__getitem__)),
            (r"VOLT\?", self.get("set_V", "{:+.8E}")),
            (r"CURR\?", self.get("set_A", "{:+.8E}")),
            (r"VOLT:PROT\?", self.get("ovp_V", "{:+.8E}")),
            (r"CURR:PROT\?", self.get("ocp_A", "{:+.8E}")),
            (r"VOLT:PROT:STAT\?", lambda: str(int(self.ovp_on))),
            (r"CURR:PROT:STAT\?", lambda: str(int(self.ocp_on))),
            (r"OUTP\?", lambda: str(int(self.out.on))),
            (r"MEAS:VOLT\?", self.volts("{:+.8E}")),
            (r"MEAS:CURR\?", self.amperes("{:+.8E}")),
            (r"VOLT:PROT:TRIP\?", self.trip("OVP")),
            (r"CURR:PROT:TRIP\?", self.trip("OCP")),
        ]


class AgilentE3631A(Family):
    """E3631A on RS-232: a chosen output, one switch for all, no trips."""

    identity = "HEWLETT-PACKARD,E3631A,0,2.1-5.0-1.0"
    says = "\r\n"
    serial = True

    def __init__(self):
        super().__init__()
        self.channel = 2

    def __call__(self, line):
        if found := re.fullmatch(r"INST:NSEL ([1-3])", line):
            self.channel = int(found[1])
            return None
        assert self.channel == 1 or line.startswith(("*", "SYST", "OUTP")), f"channel {self.channel} was told '{line}'"
        return super().__call__(line)

    def commands(self):
        return [
            *self.scpi(),
            (r"SYST:(?:REM|LOC)", lambda: None),
            (rf"VOLT {NUMBER}", self.set("set_V")),
            (rf"CURR {NUMBER}", self.set("set_A")),
            (r"OUTP (ON|OFF)", self.set("on", ON_OFF.__getitem__)),
            (r"VOLT\?", self.get("set_V", "{:+.8E}")),
            (r"CURR\?", self.get("set_A", "{:+.8E}")),
            (r"OUTP\?", lambda: str(int(self.out.on))),
            (r"MEAS:VOLT\?", self.volts("{:+.8E}")),
            (r"MEAS:CURR\?", self.amperes("{:+.8E}")),
        ]


#: Dialect → its emulator.
FAMILIES = {
    "owon_spe": OwonSpe,
    "agilent_e3632a": AgilentE3632A,
    "agilent_e3631a": AgilentE3631A,
    "aimtti_pl": AimTtiPl,
    "aimtti_el": AimTtiEl,
    "tdk_genesys": Genesys,
    "keysight_e36300": KeysightE36300,
    "siglent_spd": Siglent,
    "siglent_spd1000x": SiglentSpd1000x,
    "kepco_bop": Kepco,
    "agilent_66xx": Agilent66xx,
    "hp_663xa": Hp663xA,
    "rs_hmp": Hmp,
    "rs_nge100": Nge,
    "rs_hmc804x": Hmc,
    "itech_it6800": Itech,
    "bk_9115": BK9115,
    "keithley_2400": Keithley2400,
    "korad_ka": Korad,
}
