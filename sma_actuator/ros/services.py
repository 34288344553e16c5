"""What a wire's node is asked for, between two callbacks of its ROS thread; ``~/enable`` and ``~/stop``:
``switch.py``, ``~/self_test``: ``self_testing.py``."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from std_srvs.srv import Trigger

from sma_actuator.driver import Driver

from .log import INFO
from .one_wire import OneWire
from .topics import Service

CALL_TIMEOUT_s = 0.6  #: a service waits no longer for the control thread

#: Services that are methods of the driver, and whether success is said in the log: of a fault it tells by itself.
_OF_DRIVER = {"clear_fault": False, "reset_estimator": True, "tare_load": True, "measure_lead_resistance": True}


def services_of(wire: OneWire) -> tuple[Service, ...]:
    """The services of a wire."""
    return (
        *(Service(f"~/{name}", Trigger, _asking(wire, name)) for name in _OF_DRIVER),
        Service("~/tune", Trigger, _tuning(wire)),
    )


def _asking(wire: OneWire, name: str) -> Callable[[Any, Any], Any]:
    def answer(_: Trigger.Request, response: Trigger.Response) -> Any:
        if _answer(wire, response, lambda driver: getattr(driver, name)(timeout_s=CALL_TIMEOUT_s)) and _OF_DRIVER[name]:
            wire.log.say(INFO, response.message)
        return response

    return answer


def _tuning(wire: OneWire) -> Callable[[Any, Any], Any]:
    def answer(_: Trigger.Request, response: Trigger.Response) -> Any:
        """Begin to tune the gains; the answer is that it has begun, the status says how far it is."""
        if _answer(wire, response, lambda driver: driver.tune(timeout_s=CALL_TIMEOUT_s)):
            wire.commands.preempt("the gains are tuned")
            wire.log.say(INFO, response.message)
        return response

    return answer


def _answer(wire: OneWire, response: Any, request: Callable[[Driver], tuple[Any, ...]]) -> bool:
    """Fill a response with what the actuator says."""
    response.success, response.message = wire.asked(request)
    if not response.success:
        wire.report(response.message)
    return bool(response.success)
