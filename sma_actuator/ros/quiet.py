"""An executor that costs little while nothing happens.

rclpy's looks through everything that a node has, and makes a wait set of it, whenever it waits: 0.3 ms of every thread
of the process, a third of a step of the loop.  Most of a wire's waits end without anything being ready.  So it is
waited here on a wait set that is kept as long as the node has the same entities, and rclpy is asked only where one of
them is ready.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

from rclpy.context import Context
from rclpy.exceptions import InvalidHandle
from rclpy.executors import ExternalShutdownException, ShutdownException, SingleThreadedExecutor, TimeoutException
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.utilities import timeout_sec_to_nsec
from rclpy.waitable import NumberOfEntities

_KINDS = ("subscription", "timer", "client", "service")  #: that a wait set names beside guards


class QuietExecutor(SingleThreadedExecutor):
    """rclpy's, for callbacks of one thread; what is ready at once runs in one ``spin_once``."""

    def __init__(self, *, context: Context | None = None):
        super().__init__(context=context)
        self._entities: tuple[list[Any], ...] = ()  #: that the wait set has room for
        self._wait_set: Any = None
        self._adding: list[tuple[Callable[[Any], object], Any]] = []  #: what puts each of them into it
        self._held = ExitStack()  #: their handles, which are not destroyed meanwhile

    def spin_once(self, timeout_sec: float | None = None) -> None:
        """Wait until something is ready, and run it."""
        try:
            if self._is_woken(timeout_sec_to_nsec(timeout_sec)):
                for handler, _, _ in self._wait_for_ready_callbacks(0.0):
                    handler()
                    handler.result()  # raises what it has raised
        except (TimeoutException, ShutdownException):
            pass
        except BaseException:
            self._let_go()
            raise

    def _is_woken(self, timeout_ns: int) -> bool:
        """Wait; whether rclpy has anything to do then."""
        if not all(task.done() for task, *_ in self._tasks):
            return True
        try:
            wait_set = self._filled()
        except InvalidHandle:  # one of them was destroyed just now
            self._let_go()
            return True
        wait_set.wait(timeout_ns)
        if self._is_shutdown:
            raise ShutdownException
        if not self._context.ok():
            raise ExternalShutdownException
        # The executor's own guard, which is in no node, only says that it should look again.
        *_, guards, waitables = self._entities
        triggered = wait_set.get_ready_entities("guard_condition")
        is_ready = False
        for guard in guards:
            if guard.handle.pointer in triggered:
                guard._executor_triggered = is_ready = True  # waiting has taken it; rclpy triggers it again
        is_ready = is_ready or any(wait_set.get_ready_entities(kind) for kind in _KINDS)
        return is_ready or any(waitable.is_ready(wait_set) for waitable in waitables)

    def _filled(self) -> Any:
        """The wait set with all that there is to wait for.  Raises InvalidHandle."""
        nodes = self.get_nodes()
        kinds = ("subscriptions", "timers", "clients", "services", "guards", "waitables")
        entities = tuple([each for node in nodes for each in getattr(node, kind)] for kind in kinds)
        subscriptions, timers, clients, services, guards, waitables = entities
        own = (self._guard, self._sigint_gc)
        if self._wait_set is None or entities != self._entities:
            self._let_go()
            counts = NumberOfEntities(
                len(subscriptions), len(guards) + len(own), len(timers), len(clients), len(services)
            )
            for each in (*subscriptions, *timers, *clients, *services, *guards, *own):
                self._held.enter_context(each.handle)
            for waitable in waitables:
                self._held.enter_context(waitable)
                counts += waitable.get_num_entities()
            self._held.enter_context(self._context.handle)
            self._wait_set = _rclpy.WaitSet(
                counts.num_subscriptions,
                counts.num_guard_conditions,
                counts.num_timers,
                counts.num_clients,
                counts.num_services,
                counts.num_events,
                self._context.handle,
            )
            wait_set, self._entities = self._wait_set, entities
            added = (
                (wait_set.add_subscription, subscriptions),
                (wait_set.add_client, clients),
                (wait_set.add_service, services),
                (wait_set.add_timer, timers),
                (wait_set.add_guard_condition, (*guards, *own)),
            )
            self._adding = [(add, each.handle) for add, some in added for each in some]
            self._adding += [(waitable.add_to_wait_set, wait_set) for waitable in waitables]
        self._wait_set.clear_entities()  # waiting has taken out what was not ready
        for add, what in self._adding:
            add(what)
        return self._wait_set

    def _let_go(self) -> None:
        self._wait_set, self._entities, self._adding = None, (), []
        self._held.close()
