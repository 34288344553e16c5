"""``~/self_test``: the driver gives the instruments up, they are tested with a little current, and the driver has them
again."""

from __future__ import annotations

import threading
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from diagnostic_msgs.srv import SelfTest as SelfTestService

from sma_actuator.check.found import Level, passed
from sma_actuator.check.selftest import SelfTest
from sma_actuator.driver import DriverStopped
from sma_actuator.instruments import open_instruments
from sma_actuator.instruments.clock import MonotonicClock

from .log import ERROR, INFO, WARNING
from .one_wire import OneWire
from .topics import Service

END_s = 2.0  #: one that is to end has done so by then, instruments that answer given
_LEVELS = {
    Level.OK: (INFO, DiagnosticStatus.OK),
    Level.WARNING: (WARNING, DiagnosticStatus.WARN),
    Level.WRONG: (ERROR, DiagnosticStatus.ERROR),
}


class SelfTesting:
    """Self-tests of one wire, one at a time."""

    def __init__(self, wire: OneWire):
        self._wire = wire
        self._running: SelfTest | None = None
        self._ended = threading.Event()

    @property
    def runs(self) -> bool:
        """Whether one does, and so who ends it is :meth:`end`."""
        return self._running is not None

    @property
    def service(self) -> Service:
        """What asks for one."""
        return Service("~/self_test", SelfTestService, self._answer)

    def _answer(self, _: SelfTestService.Request, response: SelfTestService.Response) -> Any:
        """Test, in the ROS thread."""
        wire = self._wire
        if wire.driver is not None:
            wire.driver.cancel_enable()
        with wire.arming:  # so that nothing goes on that was asked for before
            refusal = self._refusal()
            if not refusal:
                clock = MonotonicClock()
                self._ended.clear()
                self._running = SelfTest(wire.config, *open_instruments(wire.config, clock), clock)
        if refusal:
            wire.report(refusal)
            response.passed = b"\0"
            response.status = [DiagnosticStatus(level=DiagnosticStatus.ERROR, name="self-test", message=refusal)]
            return response
        assert self._running is not None
        wire.log.say(INFO, "a self-test runs: the bias current flows for some seconds")
        try:
            wire.give_up_driver()
            found = self._running.run()
            response.id = self._running.identity
        finally:
            wire.left_off = self._running.off_confirmed
            self._running = None
            self._ended.set()
            wire.go_on()
        for each in found:
            wire.log.say(_LEVELS[each.level][0], f"self-test: {each.part}: {each.sentence}")
        response.passed = b"\1" if passed(found) else b"\0"
        response.status = [
            DiagnosticStatus(
                level=_LEVELS[each.level][1], name=each.part, hardware_id=response.id, message=each.sentence
            )
            for each in found
        ]
        return response

    def _refusal(self) -> str:
        """Why none can begin now, or ""."""
        wire, driver = self._wire, self._wire.driver
        if driver is None:
            return f"no self-test: {wire.refusal or wire.not_active()}"
        try:
            driven = wire.is_driven()
        except (DriverStopped, TimeoutError) as error:
            return f"no self-test: {error}"
        if driven or not driver.output_is_off:
            words = "the output is on" if driven else driver.output_words
            return f"no self-test: {words}; switch it off first: ~/enable false"
        return ""

    def end(self) -> tuple[bool, str] | None:
        """Off while one runs: it ends, with the output off; None where none does.  From any thread."""
        running = self._running
        if running is None:
            return None
        running.abort()
        if not self._ended.wait(END_s):
            return False, "not confirmed: the self-test has not ended yet; it switches the output off"
        words = "the output is off" if running.off_confirmed else "the output is told to be off, not confirmed"
        return running.off_confirmed, f"{words}; the self-test was ended"
