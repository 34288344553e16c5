"""What comes in over ROS fails alone: a message that makes a callback raise is refused, and the node goes on.

rclpy lets such an exception end the executor, and with it the node: a lifecycle transition that the state does not
have, or a parameter of a type that does not exist, would do.  A request that is too much is refused unread
(``bounded.py``).
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from functools import partial
from typing import Any

from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node

from .bounded import Refused, bound
from .publishing import tell

#: Between two failures of the executor, so that one that does not pass leaves the processor to the control loop.
PAUSE_s = 0.01


def refuse_what_raises(node: Node, say: Callable[[str], None]) -> None:
    """Let every service and subscription that ``node`` has refuse, with a sentence, what its callback raises on."""
    for service in node.services:
        bound(service)
        service.callback = _refusing_service(service.callback, service.srv_name, say)
    for subscription in node.subscriptions:
        subscription.callback = _refusing_message(subscription.callback, subscription.topic_name, say)


def _refusing_service(callback: Callable[..., Any], name: str, say: Callable[[str], None]) -> Callable[..., Any]:
    def answer(request: Any, response: Any) -> Any:
        try:
            if isinstance(request, Refused):
                raise request
            return callback(request, response)
        except Exception as error:  # noqa: BLE001 - whatever it is, the next request is as good as any
            why = str(error) if isinstance(error, Refused) else f"{type(error).__name__}: {error}"
            sentence = f"{name}: the request was refused: {why}"
            say(sentence)
            return _refusal(type(response)(), request, sentence)

    return answer


def _refusing_message(callback: Callable[..., Any], name: str, say: Callable[[str], None]) -> Callable[[Any], None]:
    def receive(message: Any) -> None:
        try:
            callback(message)
        except Exception as error:  # noqa: BLE001 - whatever it is, the next message is as good as any
            say(f"{name}: a message was refused: {type(error).__name__}: {error}")

    return receive


def _refusal(response: Any, request: Any, sentence: str) -> Any:
    """``response``, saying no wherever it can."""
    from rcl_interfaces.msg import SetParametersResult

    refused = SetParametersResult(successful=False, reason=sentence)
    if hasattr(response, "message"):
        response.message = sentence
    if hasattr(response, "result") and isinstance(response.result, SetParametersResult):
        response.result = refused
    if hasattr(response, "results"):
        response.results = [refused for _ in getattr(request, "parameters", "1")]
    return response


class _Executor(SingleThreadedExecutor):
    """That of rclpy, but for what cannot be taken (a request, a message, a timer that is due): where that raises, rclpy
    never gives the callback group free again, and so hears nothing more of what the node has but its news."""

    def _make_handler(self, entity: Any, node: Node, take_from_wait_list: Callable[[Any], Any]) -> Any:
        def take(entity: Any) -> Any:
            try:
                return take_from_wait_list(entity)
            except Exception as error:  # noqa: BLE001 - raised again where rclpy has an end for it
                return partial(_raise, error)

        return super()._make_handler(entity, node, take)


async def _raise(error: Exception) -> None:
    raise error


def spinning(
    node: Node,
    name: str,
    on_error: Callable[[Exception], None],
    turn: Callable[[], None] = lambda: None,
    longest_wait_s: float | None = None,
) -> threading.Thread:
    """A thread of that ``name`` that runs the callbacks of one node until its context is shut down; it is started.

    ``on_error`` gets what raises in between.  ``turn`` is called after each callback, and after ``longest_wait_s``
    without any.
    """
    executor = _Executor(context=node.context)  # not in the thread: before its first turn the context may be gone
    executor.add_node(node)
    how = (executor, node.context, on_error, turn, longest_wait_s)
    thread = threading.Thread(target=_spin, args=how, daemon=True, name=name)
    thread.start()
    return thread


def _spin(
    executor: _Executor,
    context: Context,
    on_error: Callable[[Exception], None],
    turn: Callable[[], None],
    longest_wait_s: float | None,
) -> None:
    while context.ok():
        try:
            executor.spin_once(longest_wait_s)
            turn()
        except ExternalShutdownException:
            return
        except Exception as error:  # noqa: BLE001 - reported; the other callbacks are as good as ever
            if not context.ok():
                return
            tell(on_error, error)
            time.sleep(PAUSE_s)
