"""A process that is stopped again and again for a moment: what it acts on is too old, though some of its steps are in
time.

In the bench's own time: a clock that lets nothing happen but in the pieces of time in which the process runs.
"""

import pytest

from sma_actuator.bench import VirtualBench
from sma_actuator.bench.in_process import InProcessDaq, InProcessSupply, VirtualClock
from sma_actuator.config import Config
from sma_actuator.driver import Driver

PHASES = 4  #: of the stutter against the loop's deadlines


class StutteringClock(VirtualClock):
    """Of every ``every_s`` the process is stopped for ``stopped_s``."""

    stopped_s, every_s, begins_s = 0.0, 1.0, 0.0

    def sleep_until_s(self, deadline_s):
        into_s = (deadline_s - self.begins_s) % self.every_s
        super().sleep_until_s(deadline_s + max(0.0, self.stopped_s - into_s))


@pytest.fixture
def seen_after_s(make_config):
    """``seen_after_s(stopped_s, every_s, rate_Hz, for_s)``: for each phase how long it took to be a fault, None: it was
    none."""

    def look(stopped_s, every_s, rate_Hz, for_s=8.0):
        config = Config.from_mapping(make_config(**{"loop.rate": rate_Hz, "loop.samples_per_block": 10}))
        times_s = []
        for phase in range(PHASES):
            bench = VirtualBench.from_name("flexinol", seed=1)
            clock, outputs = StutteringClock(bench), []
            driver = Driver(
                config,
                InProcessSupply(bench, config),
                InProcessDaq(bench, config),
                clock,
                on_output=outputs.append,
            )
            driver.run_for(0.5)
            assert driver.enable(True)[0]
            driver.run_for(1.0)
            clock.stopped_s, clock.every_s = stopped_s, every_s
            clock.begins_s = began_s = bench.time_s + phase * every_s / PHASES
            while bench.time_s < began_s + for_s and not outputs[-1].status.fault:
                driver.run_for(0.05)
            fault = outputs[-1].status.fault
            assert fault in ("", "loop_overrun")
            times_s.append(bench.time_s - began_s if fault else None)
            driver.stop()
        return times_s

    return look


@pytest.mark.parametrize(
    ("stopped_s", "every_s", "rate_Hz", "within_s"),
    [
        *((0.12, 0.18, 20.0, 2.0), (0.3, 0.35, 20.0, 1.5), (0.12, 0.18, 100.0, 2.0)),
        *((0.45, 0.57, 100.0, 2.0), (0.2, 0.32, 100.0, 2.5), (0.45, 0.9, 100.0, 4.0)),  # more steps met than missed
    ],
)
def test_a_stutter_is_seen(seen_after_s, stopped_s, every_s, rate_Hz, within_s):
    assert max(time_s if time_s is not None else 1e9 for time_s in seen_after_s(stopped_s, every_s, rate_Hz)) < within_s


@pytest.mark.parametrize(("stopped_s", "every_s", "rate_Hz"), [(0.02, 0.1, 20.0), (0.4, 2.0, 20.0), (0.02, 0.1, 100.0)])
def test_a_machine_that_is_busy_for_a_moment_now_and_then_is_none(seen_after_s, stopped_s, every_s, rate_Hz):
    assert seen_after_s(stopped_s, every_s, rate_Hz) == PHASES * [None]
