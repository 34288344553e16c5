"""Instruments that do what a test tells them, for what the virtual bench cannot be told to do."""

import threading
import time

from sma_actuator.base.signals import Reading, SupplyState
from sma_actuator.instruments import InstrumentLost


class RealClock:
    """The machine's monotonic clock."""

    def now_s(self):
        return time.monotonic()

    def sleep_until_s(self, deadline_s):
        left_s = deadline_s - time.monotonic()
        if left_s > 0.0:
            time.sleep(left_s)


class StandInSupply:
    """A supply into a 5.25 Ω wire with its leads and sense resistor, that notes what it is told."""

    identity = "stand-in supply"
    now_s = staticmethod(time.monotonic)  #: of the loop's clock, by which it says how old an answer is

    def __init__(self):
        self.current_A = 0.0
        self.output_on = False
        self.opened = 0
        self.shut_downs = 0
        self.settings = []  #: every command after opening
        self.lost = False
        self.threads = set()

    def open(self):
        if self.lost:
            raise InstrumentLost("stand-in supply: no answer")
        self.opened += 1
        self.current_A, self.output_on = 0.0, False

    def _asked(self):
        self.threads.add(threading.current_thread().name)
        if self.lost:
            raise InstrumentLost("stand-in supply: no answer")

    def set_current(self, current_A):
        self._asked()
        self.settings.append(("current", current_A))
        self.current_A = current_A

    def set_output(self, on):
        self._asked()
        self.settings.append(("output", on))
        self.output_on = on

    def switch_off(self):
        self.set_output(False)
        self.set_current(0.0)

    def read_back(self):
        self._asked()
        flowing_A = self.current_A if self.output_on else 0.0
        return SupplyState(self.now_s(), self.current_A, self.output_on, 6.5 * flowing_A, flowing_A)

    def check_settings(self):
        self._asked()

    def check_next_setting(self):
        self._asked()

    def clear_trip(self):
        self._asked()

    def shut_down(self):
        self.shut_downs += 1
        self.current_A, self.output_on = 0.0, False
        return True

    def close(self):
        pass


class StandInDaq:
    """A DAQ on that circuit; ``hang`` lets its next answer wait until ``release`` is set."""

    identity = "stand-in DAQ"

    def __init__(self, supply, delay_s=0.0):
        self.supply = supply
        self.delay_s = delay_s
        self.lost = False
        self.hang = False
        self.hanging = threading.Event()
        self.release = threading.Event()
        self._count = 0

    def open(self):
        if self.lost:
            raise InstrumentLost("stand-in DAQ: no answer")

    def read_block(self):
        if self.hang:
            self.hanging.set()
            self.release.wait(30.0)
        if self.lost:
            raise InstrumentLost("stand-in DAQ: no answer")
        if self.delay_s:
            time.sleep(self.delay_s)
        self._count += 1
        flowing_A = self.supply.current_A if self.supply.output_on else 0.0
        wobble = 1.0 + 1e-5 * (self._count % 7)  # no channel of a real DAQ stands still
        return Reading(time.monotonic(), 6.5 * flowing_A * wobble, flowing_A, 0.08 * wobble)

    def close(self):
        pass
