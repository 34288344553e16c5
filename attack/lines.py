"""Attacks on the lines between the driver and its instruments: a proxy in each, spoilt one after the other."""

from __future__ import annotations

import contextlib
import math
import random
import time
from collections.abc import Callable, Iterable
from typing import Any

from sma_actuator.base.signals import Mode
from sma_actuator.config import Config, read_parameter_file
from sma_actuator.driver import Driver, DriverStopped
from sma_actuator.instruments import InstrumentError, open_instruments
from sma_actuator.instruments.clock import MonotonicClock
from sma_actuator.safety.guards.supply import SETTING_TOLERANCE_A

from .hours import CONFIG, OFF_AT_MOST_s
from .promises import Promises
from .proxy import HONEST, Mischief, Proxy
from .result import Result, Violation
from .stand import NO_CURRENT_A, LOOK_s, SOON_s, Stand, wait_until

#: What the bench's tick, its answers and the judge's look add to a time.
MEASURING_s = 0.06
RECOVERY_s = 15.0
#: A reading older than this is not of now.
FRESH_s = 0.5
FRESH_A = 5e-3
#: Mischief after which no conversation is left, so that the current has to go off.
_ENDS_THE_TALK = (
    Mischief("drop"),
    Mischief("drop", "questions"),
    Mischief("drop", "both"),
    Mischief("cut", "none"),
    Mischief("refuse", "none"),
    Mischief("late", delay_s=0.7),
    Mischief("late", delay_s=2.5),
    Mischief("late", "questions", delay_s=0.7),
    Mischief("empty"),
    Mischief("garble"),
    Mischief("garble", "questions"),
    Mischief("garble", "both"),
    Mischief("nan"),
    Mischief("half"),
    Mischief("unended"),
    Mischief("trickle"),
    Mischief("flood"),
)
#: The same; at the end of all, so that the numbers of what is kept stay.
_ENDS_IT_TOO = (Mischief("glued"), Mischief("kept", "none"))
#: The supply forgets what it was told, with its connection as it was: the row of the table that promises the current
#: off.
_FORGETS = {
    Mischief("slip in", "questions", words="*RST"): "second_commander",
    Mischief("slip in", "questions", words="CURR:PROT 1"): "limits_not_held",
    Mischief("slip in", "questions", words="VOLT 19"): "limits_not_held",
    Mischief("slip in", "questions", words="OUTP:PROT:WDOG OFF"): "watchdog_not_held",
    Mischief("slip in", "questions", words="CURR 0.3"): "second_commander",
    Mischief("forget", "questions"): "second_commander",
}
#: Answers whose form is right and whose meaning is wrong, by instrument: the row of the table that promises the current
#: off.
_MEANS_OTHERWISE = {
    "daq": {
        Mischief("times thousand"): "reading_saturated",
        Mischief("by thousand"): "supply_disagrees",
        Mischief("negated"): "reading_implausible",
        Mischief("constant"): "sensor_stuck",
        Mischief("another channel"): "supply_disagrees",
        Mischief("decimal comma"): "daq_lost",
        Mischief("nul"): "daq_lost",
    },
    "supply": {
        Mischief("times thousand"): "second_commander",
        Mischief("by thousand"): "supply_lost",
        Mischief("negated"): "second_commander",
        # Noticed when one of its settings is asked for.
        Mischief("constant"): "limits_not_held",
        Mischief("the one before"): "limits_not_held",
        Mischief("another channel"): "supply_lost",
        Mischief("decimal comma"): "supply_lost",
        Mischief("nul"): "supply_lost",
    },
}
#: It starts anew with the current on and without what it was told, and is not to be reached meanwhile.
_REBOOT = Mischief("reboot", "none")
REBOOTS_WITHIN_s = 1.0
#: It takes so long for each line, so that off comes after what was said before: a question and the bias current.
_SLOW = Mischief("slow", "questions", delay_s=0.7)
_WORDS_BEFORE_OFF = 2
QUIET_WATCHDOGS = 1.25  #: so long the driver promises to be silent, in delays of the watchdog
LOAD, DISPLACEMENT = 2, 3  #: fields of the DAQ's answer
#: Answers each of which by itself may be true, of a wire that is moved: the fault that says so, and after how many
#: motions the lie shows at the latest.
_LIES = {
    Mischief("swapped", fields=(LOAD, DISPLACEMENT)): ("load_dead", 2),
    Mischief("sinking", fields=(LOAD,)): ("load_dead", 4),
    Mischief("frozen", fields=(DISPLACEMENT,)): ("position_contradicted", 2),
}
MOTION_s, MOTIONS = 3.0, 6  #: how long one takes, and how many show what is usual
ENDS_m = (0.0008, 0.0026)  #: between which it is moved
#: Mischief that a driver may see through or get over.
_CONFUSES = (
    Mischief("late", delay_s=0.03),
    Mischief("late", "both", delay_s=0.1),
    Mischief("duplicate"),
    Mischief("duplicate", "questions"),
    Mischief("duplicate", "both"),
    Mischief("extra"),
    Mischief("swap digits"),
)
ALL = (
    *((role, mischief) for role in ("supply", "daq") for mischief in (*_ENDS_THE_TALK, *_CONFUSES)),
    *(("supply", mischief) for mischief in _FORGETS),
    *((role, mischief) for role, rows in _MEANS_OTHERWISE.items() for mischief in rows),
    ("daq", Mischief("the one before")),
    *((role, Mischief("padded")) for role in _MEANS_OTHERWISE),
    ("supply", _REBOOT),
    *(("daq", mischief) for mischief in _LIES),
    ("supply", _SLOW),
    *((role, mischief) for mischief in _ENDS_IT_TOO for role in ("supply", "daq")),
)


class Line:
    """A driver on a bench process, with a proxy before each instrument."""

    def __init__(self, seed: int):
        self.seed = seed
        self.result = Result()
        self._chance = random.Random(seed)
        self.stand = Stand("--load", "weight:0.98", "--seed", str(seed))
        self.proxies = {
            "supply": Proxy(self.stand.supply_port, seed),
            "daq": Proxy(self.stand.daq_port, seed + 1),
        }
        parameters = read_parameter_file(CONFIG / "flexinol.yaml")
        for role, proxy in self.proxies.items():
            parameters["instruments"][role]["resource"] = f"TCPIP::127.0.0.1::{proxy.port}::SOCKET"
        parameters["instruments"]["reconnect_backoff_max"] = 0.5
        self.config = Config.from_mapping(parameters)
        self.promises = Promises(self.config.to_mapping())
        self.outputs: list[Any] = []
        self.cause = ""
        self._stale = 0
        self._driver: Driver | None = None

    def close(self) -> None:
        """End the driver, the proxies and the bench."""
        if self._driver is not None:
            self._driver.stop()
        for proxy in self.proxies.values():
            proxy.close()
        self.stand.close()

    def broken(self, rule: str, detail: str) -> None:
        """Write down a broken promise."""
        number = ALL.index(self.present)
        replay = f"python -m attack lines --seed {self.seed} --only {number}"
        self.result.violations.append(Violation(rule, f"{self.cause}: {detail}", replay))

    def attack(self, role: str, mischief: Mischief) -> None:
        """Drive the wire, spoil one line, judge, and see the driver come back."""
        self.present, self.cause = (role, mischief), f"{role}, {mischief}"
        self.result.counts["lines spoilt"] += 1
        if not self._driven():
            self.broken("the driver does not come back", "before the mischief")
            return
        proxy = self.proxies[role]
        if mischief in _LIES:
            self._move(MOTIONS)
        self.stand.fresh()
        self._stale = 0
        self.outputs.clear()
        began_s = time.monotonic()
        proxy.spoil(mischief)
        if mischief in (*_ENDS_THE_TALK, *_ENDS_IT_TOO, _SLOW):
            self._must_go_off(mischief, began_s, self._talk_ends_within_s(role, mischief))
        elif mischief in _FORGETS:
            kept_A = float(self.stand.tell_supply("CURR?"))
            self._driver.offer_setpoint(self._chance.choice((0.001, 0.003)))  # so that it is told something
            if mischief.kind == "forget":
                self._must_fall_silent(began_s, kept_A)
            else:
                self._must_go_off(mischief, began_s, self.promises.within_s(_FORGETS[mischief]))
        elif mischief in _MEANS_OTHERWISE[role]:
            self._driver.offer_setpoint(self._chance.choice((0.001, 0.003)))
            self._must_go_off(mischief, began_s, self.promises.within_s(_MEANS_OTHERWISE[role][mischief]))
        elif mischief in _LIES:
            self._must_be_said(began_s, *_LIES[mischief])
        elif mischief == _REBOOT:
            self._must_go_off(mischief, self._reboot(), self._reconnects_within_s())
        else:
            self._may_go_on()
        self._switch_off()
        proxy.spoil(HONEST)
        if self.stand.hottest_C > self.config.thermal.max_temperature:
            self.broken("the wire is above its limit of temperature", f"{self.stand.hottest_C:.0f} °C")
        if self.stand.most_A > self.config.supply.max_current * 1.001:
            self.broken("more than supply.max_current flows", f"{self.stand.most_A:.4f} A")

    def _talk_ends_within_s(self, role: str, mischief: Mischief) -> float:
        within_s = within_lost_s = self.promises.within_s(f"{role}_lost")
        if role == "supply":
            within_s = max(within_s, self.config.supply.watchdog_timeout)
            if mischief.kind == "garble" and mischief.touches("questions"):
                # It hears no "off" either, only words, and its watchdog counts from the last: the off that gives the
                # line up, once an answer that may still come has been waited for.
                return within_lost_s + self.config.supply.watchdog_timeout
        return min(within_s, OFF_AT_MOST_s)

    def _must_fall_silent(self, began_s: float, kept_A: float) -> None:
        """It answers and does not hear "off": the driver notices once it has told another current than the one that is
        kept, asks in vain, and leaves it to its watchdog, which counts from the last word.  What this machine stood
        still counts in the one part as in the other."""
        took_s = self.stand.off_within_s(began_s, 4.0)
        if math.isnan(took_s):
            self.broken("the current is not off in time", "not within 4 s")
            return
        off_s = self.stand.off_since_s
        last_s = max(at_s for at_s in self.proxies["supply"].heard_s if at_s < off_s)
        self.result.see("supply forgets, current off [s]", took_s)
        timeout_s = self.config.instruments.supply.timeout
        # a read-back, and what asks whether it is off
        noticed_s = self.promises.within_s("second_commander") + 2.0 * timeout_s
        for what, from_s, to_s, within_s in (
            ("the driver does not fall silent in time", self._told_otherwise_s(began_s, kept_A), last_s, noticed_s),
            ("the watchdog does not cut in time", last_s, off_s, self.config.supply.watchdog_timeout),
        ):
            lasted_s = to_s - from_s - self.stand.stalled_s(from_s, to_s)
            self.result.see(
                f"supply forgets, {'last word' if to_s == last_s else 'from there until off'} [s]", lasted_s
            )
            if lasted_s > within_s + MEASURING_s:
                self.broken(what, f"after {lasted_s:.2f} s; {within_s + MEASURING_s:.2f} s are promised")

    def _told_otherwise_s(self, since_s: float, kept_A: float) -> float:
        """When the driver first told another current than ``kept_A``: a wire that needs all of it for half a second
        tells the same for as long, and nobody can know that it was not heard."""
        told = (output for output in list(self.outputs) if output.signals.time_s >= since_s)
        otherwise = (each for each in told if abs(each.command.current_A - kept_A) > SETTING_TOLERANCE_A)
        return next((each.signals.time_s for each in otherwise), since_s)

    def _reboot(self) -> float:
        """A supply that comes back with its output on and no watchdog; when it can be reached again."""
        wait_until(lambda: self.stand.tell_supply("SYST:LOCK:OWN?") == "NONE", SOON_s, "the end of the lock")
        time.sleep(self._chance.uniform(0.1, REBOOTS_WITHIN_s))
        self.stand.tell_supply("OUTP:PROT:WDOG OFF;:OUTP:PROT:CLE;:VOLT 4;:CURR 0.2;:OUTP ON;*OPC?")
        wait_until(lambda: self.stand.now.current_A > NO_CURRENT_A, SOON_s, "current after the reboot")
        self.proxies["supply"].spoil(HONEST)
        return time.monotonic()

    def _reconnects_within_s(self) -> float:
        """The longest pause between two attempts, then off is the first word: an attempt that may have been heard, as a
        connection that is closed at once, is followed by silence until the watchdog would have cut (docs/guards.md)."""
        silence_s = QUIET_WATCHDOGS * self.config.supply.watchdog_timeout
        return max(self.config.instruments.reconnect_backoff_max, silence_s) + self.config.instruments.supply.timeout

    def _must_go_off(self, mischief: Mischief, began_s: float, within_s: float) -> None:
        role, within_s = self.present[0], within_s + MEASURING_s
        if mischief.touches("questions"):
            # "off" itself is on its way for so long
            within_s += mischief.delay_s * (1 + (_WORDS_BEFORE_OFF if mischief == _SLOW else 0))
        took_s = self.stand.off_within_s(began_s, 4.0)
        if not took_s <= within_s:
            took = "not within 4 s" if math.isnan(took_s) else f"after {took_s:.2f} s"
            self.broken("the current is not off in time", f"{took}; {within_s:.2f} s are promised")
        else:
            what = self._in_words(mischief)
            self.result.see(f"{role} {what}, current off [s]", took_s)
        try:
            wait_until(lambda: self._says_fault(began_s), 2.0)
        except TimeoutError:
            self.broken(
                "the driver does not say that something is wrong", "two seconds after the current should be off"
            )

    def _move(self, motions: int, ends: Callable[[], bool] = lambda: False) -> None:
        """Move the wire to and fro, until ``ends``."""
        for number in range(motions):
            end_s = time.monotonic() + MOTION_s
            with contextlib.suppress(DriverStopped):
                self._driver.offer_setpoint(ENDS_m[number % 2])
            while time.monotonic() < end_s:
                if ends():
                    return
                time.sleep(LOOK_s)

    def _must_be_said(self, began_s: float, fault: str, motions: int) -> None:
        """A lie that shows in motion: by this fault, and where that switches off, with the current off."""
        within_s = motions * MOTION_s + self.promises.within_s(fault) + MEASURING_s
        self._move(2 * motions, lambda: self._says(fault))
        took_s = time.monotonic() - began_s
        if not self._says(fault) or took_s > within_s:
            self.broken("a lie is believed", f"{fault} {f'after {took_s:.1f} s' if self._says(fault) else 'never'}")
            return
        self.result.see(f"daq lies, {fault} [s]", took_s)
        if self.promises.switches_off(fault):
            self._must_go_off(self.present[1], time.monotonic(), MEASURING_s)

    def _says(self, fault: str) -> bool:
        return any(output.status.fault == fault for output in list(self.outputs))

    def _in_words(self, mischief: Mischief) -> str:
        if mischief in _FORGETS:
            return "forgets"
        if mischief in _MEANS_OTHERWISE[self.present[0]] or mischief in _LIES:
            return "means something else"
        return "is there again" if mischief == _REBOOT else "spoilt"

    def _says_fault(self, since_s: float) -> bool:
        driver = self._driver
        return driver.failure is not None or bool(driver.lost_instruments) or any(o.status.fault for o in self.outputs)

    def _may_go_on(self) -> None:
        """Steps of the setpoint: the readings have to be of now as long as current is commanded."""
        end_s = time.monotonic() + 4.0
        while time.monotonic() < end_s:
            self._driver.offer_setpoint(self._chance.choice((0.0, 0.001, 0.002, 0.003)))
            time.sleep(0.25)
        if self._stale > 20:
            self.broken("readings are old and count as new", f"{self._stale} steps")

    def _switch_off(self) -> None:
        """The commander says off while the line is spoilt; "off" has to be true."""
        try:
            done, words = self._driver.enable(False, timeout_s=0.6)
        except (DriverStopped, TimeoutError):
            return
        said_s = time.monotonic()
        wait_until(lambda: self.stand.now.at_s > said_s + MEASURING_s, what="a look at the bench")
        if done and "not confirmed" not in words and not self.stand.off_since_s <= said_s + MEASURING_s:
            self.broken("the driver says off and current flows", f"'{words}', {self.stand.now.current_A:.3f} A")

    def _driven(self) -> bool:
        """A driver that holds the wire, with current."""
        try:
            return bool(wait_until(self._try_to_drive, RECOVERY_s))
        except TimeoutError:
            return False

    def _try_to_drive(self) -> bool:
        driver = self._driver
        try:
            if driver is None or driver.failure is not None:
                driver = self._driver = self._new_driver()
            if driver.lost_instruments:
                return False
            driver.clear_fault(timeout_s=1.0)
            done, _ = driver.enable(True, timeout_s=1.0)
            driver.offer_setpoint(0.002)
        except (InstrumentError, DriverStopped, TimeoutError):
            return False
        try:
            wait_until(lambda: not done or self.stand.now.current_A > 0.06, 1.5)
        except TimeoutError:
            return False
        return done and self.stand.now.current_A > 0.06

    def _new_driver(self) -> Driver:
        clock = MonotonicClock()
        driver = Driver(self.config, *open_instruments(self.config, clock), clock, on_output=self._on_output)
        driver.start()
        wait_until(lambda: driver.statistics().steps > 3, SOON_s, "the loop's first steps")
        return driver

    def _on_output(self, output: Any) -> None:
        self.outputs.append(output)
        current_A = output.command.current_A
        if not 0.0 <= current_A <= self.config.supply.max_current:
            self.broken("a command outside 0 to supply.max_current", f"{current_A} A")
        if output.status.mode is Mode.OFF or not math.isfinite(output.signals.current_A):
            return
        read_A, now_s = output.signals.current_A, time.monotonic()
        lately = [seen.current_A for seen in list(self.stand.seen)[-200:] if seen.at_s > now_s - FRESH_s]
        # The mean of a block lies between the currents of its time.
        if lately and not min(lately) - FRESH_A <= read_A <= max(lately) + FRESH_A:
            self._stale += 1


def attack(seed: int, cases: Iterable[tuple[str, Mischief]] = ALL) -> Result:
    """Spoil the lines as ``cases`` say, in a random order."""
    line = Line(seed)
    try:
        for role, mischief in random.Random(seed).sample(list(cases), len(list(cases))):
            line.attack(role, mischief)
        return line.result
    finally:
        line.close()
