"""Time as a wait counts it, on a machine that may stop any process for a while."""

import os
import threading
import time

#: For a program that only waits for its end: without kernels it starts in 0.3 s of processor, with them in 0.9 s.
STARTS_SOON = {**os.environ, "SMA_ACTUATOR_NO_JIT": "1"}
#: Of the time between two looks no more counts: the rest is a process that did not run.
MOST_OF_A_LOOK_s = 0.1
STALL_LOOK_s = 0.005
SOON_s = 150.0  #: bound of waits that normally take under a second; a busy machine starts a process in half a minute


PATIENT_TIMEOUT_s = 1.4  #: of either instrument: both and a period are within the reading's
#: Parameters of a node on a machine that may stop a process for some tenths of a second, which it rightly takes for a
#: lost instrument or an overrun; what it does then is tested in tests/driver, in the bench's own time.
PATIENT_NODE = {
    "safety.reading_timeout": 3.0,
    "supply.watchdog_timeout": 3.0,
    "loop.overruns_to_fault": 100,
    **{f"instruments.{name}.timeout": PATIENT_TIMEOUT_s for name in ("supply", "daq")},
}
#: The same at the end of its command line.
AS_ARGUMENTS = "".join(f" -p {name}:={value}" for name, value in PATIENT_NODE.items())


class Elapsed:
    """How long this process has waited and looked; of each look at most so much counts."""

    def __init__(self, most_of_a_look_s=MOST_OF_A_LOOK_s):
        self._most_s = most_of_a_look_s
        self._seconds, self._looked_s = 0.0, time.monotonic()

    def look(self):
        """Seconds so far."""
        now_s = time.monotonic()
        self._seconds += min(now_s - self._looked_s, self._most_s)
        self._looked_s = now_s
        return self._seconds


class Stalls:
    """How long this machine let this process stand still: what is promised is promised of a machine that runs."""

    def __init__(self):
        self._lost_s, self._ended = 0.0, threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self._thread.start()

    def _watch(self):
        before_s = time.monotonic()
        while not self._ended.wait(STALL_LOOK_s):
            now_s = time.monotonic()
            self._lost_s += max(now_s - before_s - 2.0 * STALL_LOOK_s, 0.0)
            before_s = now_s

    @property
    def lost_s(self):
        """So much by now: what lies between two times that were noted may be shorter by it, or longer."""
        return self._lost_s

    def since(self, begun_s):
        """Time since then, less what was stood still."""
        return time.monotonic() - begun_s - self._lost_s

    def close(self):
        self._ended.set()
        self._thread.join()


def wait_until(condition, timeout_s=SOON_s, what="it", every_s=0.005):
    """Poll ``condition`` until it is true; its value."""
    elapsed = Elapsed()
    while not (value := condition()):
        assert elapsed.look() < timeout_s, f"{what} did not come within {timeout_s} s"
        time.sleep(every_s)
    return value
