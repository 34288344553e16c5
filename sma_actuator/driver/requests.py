"""What others want of a loop, handed over to its thread: calls between two steps, and what is offered before a step."""

from __future__ import annotations

import collections
import contextlib
import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

from sma_actuator.actuator import Actuator
from sma_actuator.instruments import Clock

CALL_s = 5.0  #: how long a call waits for its turn between two steps, unless told otherwise
_OFFERS = 1024  #: that may wait for the next step
_REFUSALS = 16  #: that are kept until somebody asks for them

Request = Callable[[Actuator, float], Any]


class DriverStopped(RuntimeError):
    """The loop does not run any more, so the call was not made."""


def fulfil(future: Future, request: Request, actuator: Actuator, now_s: float) -> None:
    """Execute a request, unless it was cancelled; its result or its exception is the caller's."""
    if not future.set_running_or_notify_cancel():
        return
    try:
        future.set_result(request(actuator, now_s))
    except Exception as error:  # noqa: BLE001 - it is the caller's
        future.set_exception(error)


class Requests:
    """The requests to one loop.  From any thread, where nothing else is said."""

    def __init__(self, name: str, actuator: Actuator, clock: Clock):
        self.name = name
        self._actuator = actuator
        self._clock = clock
        self._thread: threading.Thread | None = None  #: the control thread; None: who asks steps the loop by hand
        self._ended = False
        self._gate = threading.Lock()  #: guards _ended and the mailbox against each other
        self._mailbox: collections.deque[tuple[Request, Future]] = collections.deque()
        self._offers: collections.deque[tuple[float, Callable[[Actuator, float], str]]] = collections.deque()
        self._flooded = 0
        self._refusals: collections.deque[str] = collections.deque(maxlen=_REFUSALS)

    # --- calls ------------------------------------------------------------------------------------

    def submit(self, request: Request) -> Future:
        """Have ``request(actuator, now_s)`` executed between two steps; its result comes as a Future.

        Without a control thread it is executed at once.
        """
        future: Future = Future()
        with self._gate:
            if self._ended:
                future.set_exception(DriverStopped(f"{self.name}: the loop has ended"))
            elif self._thread is not None and threading.current_thread() is not self._thread:
                self._mailbox.append((request, future))
            else:
                fulfil(future, request, self._actuator, self._clock.now_s())
        return future

    def call(self, request: Request, timeout_s: float = CALL_s) -> Any:
        """Result of ``request(actuator, now_s)``, executed between two steps.

        Raises DriverStopped, TimeoutError (then it will not be executed later either), and
        whatever the request raises.
        """
        future = self.submit(request)
        try:
            return future.result(timeout_s)
        except TimeoutError:
            if not future.cancel():  # it began in the last moment
                return future.result(timeout_s)
            raise self._held_up(timeout_s) from None

    def reset_estimator(self, timeout_s: float = CALL_s) -> tuple[bool, str]:
        """Forget the past of the estimate."""
        return self.call(lambda actuator, _: actuator.reset_estimator(), timeout_s)

    def tune(self, timeout_s: float = CALL_s) -> tuple[bool, str]:
        """Begin to tune the gains; the wire must be driven."""
        return self.call(lambda actuator, now_s: actuator.tune(now_s), timeout_s)

    def tare_load(self, timeout_s: float = CALL_s) -> tuple[bool, str]:
        """Take the present load for zero."""
        return self.call(lambda actuator, _: actuator.tare_load(), timeout_s)

    def measure_lead_resistance(self, timeout_s: float = CALL_s) -> tuple[bool, str, float]:
        """Lead resistance [Ω], with a short in place of the wire."""
        return self.call(lambda actuator, _: actuator.measure_lead_resistance(), timeout_s)

    # --- what is offered --------------------------------------------------------------------------

    def offer_setpoint(self, position_m: float) -> None:
        """Hand over a setpoint [m]; never waits.  Refusals come back by :meth:`refusals`."""
        self._offer(lambda actuator, now_s: actuator.offer_setpoint(now_s, position_m))

    def offer_joint_command(self, position_m: float) -> None:
        """Hand over a joint command [m], which may be NaN; never waits."""
        self._offer(lambda actuator, now_s: actuator.offer_joint_command(now_s, position_m))

    def offer_trajectory(
        self,
        times_s: list[float],
        positions_m: list[float],
        velocities_m_s: list[float] | None = None,
        delay_s: float = 0.0,
    ) -> None:
        """Hand over a trajectory: positions [m] at times [s] from ``delay_s`` after now; never waits."""
        self._offer(
            lambda actuator, now_s: actuator.offer_trajectory(now_s, times_s, positions_m, velocities_m_s, delay_s)
        )

    def hold(self) -> None:
        """Have the motion end where the wire is measured to be; never waits."""
        self._offer(lambda actuator, now_s: actuator.hold(now_s))

    @property
    def has_refusals(self) -> bool:
        """Whether :meth:`refusals` has any."""
        return bool(self._refusals)

    def refusals(self) -> list[str]:
        """Sentences of the setpoints refused since the last call."""
        out = []
        with contextlib.suppress(IndexError):
            while True:
                out.append(self._refusals.popleft())
        return out

    def _offer(self, offer: Callable[[Actuator, float], str]) -> None:
        if len(self._offers) >= _OFFERS:
            self._flooded += 1
        else:
            self._offers.append((self._clock.now_s(), offer))

    # --- in the control thread --------------------------------------------------------------------

    def run_calls(self) -> None:
        """Execute the calls that wait."""
        while self._mailbox:
            request, future = self._mailbox.popleft()
            fulfil(future, request, self._actuator, self._clock.now_s())

    def take_offers(self, now_s: float) -> None:
        """Have the actuator look at what was offered; each counts from when it came."""
        flooded, self._flooded = self._flooded, 0
        if flooded:
            self._actuator.raise_fault(
                now_s, "setpoint_flood", f"{flooded} setpoints came faster than the loop could look at them"
            )
        for _ in range(len(self._offers)):
            arrived_s, offer = self._offers.popleft()
            refusal = offer(self._actuator, arrived_s)
            if refusal:
                self._refusals.append(refusal)

    def _end(self) -> list[Future] | None:
        """From now on every call is refused; those that wait, None where it had ended before."""
        with self._gate:
            if self._ended:
                return None
            self._ended = True
            waiting, self._mailbox = self._mailbox, collections.deque()
        return [future for _, future in waiting]

    def _refuse(self, waiting: list[Future]) -> None:
        for future in waiting:
            if future.set_running_or_notify_cancel():
                future.set_exception(DriverStopped(f"{self.name}: the loop has ended"))

    def _held_up(self, timeout_s: float) -> TimeoutError:
        return TimeoutError(f"{self.name}: the loop did not answer within {timeout_s:g} s: an instrument holds it up")
