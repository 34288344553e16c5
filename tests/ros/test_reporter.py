"""What a wire's node has to say is news as soon as it is there, not with the next status."""

from types import SimpleNamespace

import pytest

pytest.importorskip("rclpy")
from sma_actuator.base.signals import Health, Mode, Status
from sma_actuator.ros.reporter import WireReporter


def test_what_becomes_of_the_bench_log_is_news():
    """It waited for the next status, and was said up to 1.4 s after it happened; a second is promised."""
    wire = SimpleNamespace(driver=None, recorder=SimpleNamespace(words=""), get_name=str, callback_failed=print)
    reporter = WireReporter(wire)
    output = SimpleNamespace(status=Status(Mode.HOLD), health=SimpleNamespace(state=Health.HOLDS))
    before = reporter.in_short(output)
    assert reporter.in_short(output) == before
    wire.recorder.words = "the file was removed or moved"
    assert reporter.in_short(output) != before
    wire.recorder = None
    assert reporter.in_short(output) == before
