"""Two driven wires on one joint: the law of the pair between their loops.  No ROS.

Each wire keeps its own driver, with all its guards.  After every step of the first wire's loop the law makes a setpoint
for each of them, which its loop takes with its next step; after every step of either it is looked whether that wire is
still driven.  Where a fault has switched one off, the other gets the fault ``partner_off``, in its own loop and no
later than with its next step; where one was switched off by hand, the other is switched off too.  Once the fault has
passed, or was cleared, so is that of the other: both are off then, and ready.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import isfinite, nan, tau
from typing import Protocol

from sma_actuator.actuator import AFTER_A_FAULT, AFTER_A_LOSS, without_advice
from sma_actuator.base.parameters import ConfigError
from sma_actuator.base.signals import JointEstimate, Mode, Output, Quality, Status
from sma_actuator.config import Config
from sma_actuator.control.pair import LIMITS, Pair, PairParameters, WireState
from sma_actuator.control.setpoints import Trajectory, in_words
from sma_actuator.driver import OFF_MEANWHILE, Driver
from sma_actuator.safety.faults import FAULTS
from sma_actuator.safety.guards.program import partner_off
from sma_actuator.safety.guards.setpoints import setpoint_stale

from .fit import mismatches

_UNKNOWN = WireState(nan, nan, nan)


class PairedWire(Protocol):
    """One wire of a pair, whoever drives it."""

    @property
    def driver(self) -> Driver | None:
        """Its loop; None while it has none."""

    def switch_on(self, wanted: Callable[[], bool]) -> tuple[bool, str]:
        """Output on, if it is ``wanted`` still when its turn has come; whether that was done, and a sentence."""

    def switch_off(self) -> tuple[bool, str]:
        """Output off; whether it is, and a sentence."""


@dataclass(frozen=True, slots=True)
class JointOutput:
    """What a step of the joint has to say."""

    time_s: float  #: of the first wire's reading
    estimate: JointEstimate
    status: Status
    reference_rad: float  #: the angle asked for, as far as it is followed yet
    setpoints_m: tuple[float, float]  #: of the two wires


class PairDriver:
    """Drives one joint by the loops of its two ``wires``, whose outputs must come to :meth:`take_output`.

    ``on_output(joint_output)`` is called in the control thread of the first wire after each of its steps, and must
    return at once.  Raises ConfigError where the parameters of joint and wires do not fit together.
    """

    def __init__(
        self,
        parameters: PairParameters,
        configs: Sequence[Config],
        wires: Sequence[PairedWire],
        on_output: Callable[[JointOutput], None] = lambda _: None,
    ):
        problems = mismatches(parameters, configs)
        if problems:
            raise ConfigError(problems)
        self._wires = tuple(wires)
        self._on_output = on_output
        self._pair = Pair(parameters, [config.model.build(config.wire).displacement_range_m for config in configs])
        self._lock = threading.Lock()  #: two control threads and the commander come here; held for arithmetic only
        self._outputs: list[Output | None] = [None, None]
        self._driven = False  #: both wires are meant to be on
        self._fault, self._why_off = "", ""  #: of the wire that went off first
        self._first = 0  #: which that is
        self._stepped_s = nan
        self._heard_s = nan  #: when the last command came; NaN: since the last step
        self._lost = ""  #: why the commander counts as lost

    def _forget_trajectories(self) -> None:
        """Also when it is switched on: before, there are none."""
        self._offered: tuple[float, Trajectory] | None = None  #: delay from the next step on
        self._awaited: tuple[float, Trajectory] | None = None  #: start, of one that is still to begin
        self._motion: tuple[float, Trajectory] | None = None  #: start, of what is followed, and after its end held

    # --- requests, from any thread -----------------------------------------------------------------

    def command(self, angle_rad: float, cocontraction_N: float = nan) -> str:
        """Take an angle [rad] and a co-contraction [N]; "" or the sentence why they were refused.  NaN: as before."""
        with self._lock:
            if not self._driven and (isfinite(angle_rad) or isfinite(cocontraction_N)):
                return "joint command refused: the joint is off; call ~/enable first"
            refusal = self._pair.command(angle_rad, cocontraction_N)
            if not refusal and isfinite(angle_rad):
                self._forget_trajectories()
            if not refusal and (isfinite(angle_rad) or isfinite(cocontraction_N)):
                self._heard_s, self._lost = nan, ""
            return refusal

    def go_to(self, angle_rad: float) -> str:
        """Take an angle [rad] that stands until another, whatever the silence; "" or the sentence why it was
        refused."""
        return self.follow([0.0], [angle_rad])

    def follow(
        self,
        times_s: Sequence[float],
        angles_rad: Sequence[float],
        velocities_rad_s: Sequence[float] | None = None,
        delay_s: float = 0.0,
    ) -> str:
        """Take angles [rad] at times [s] from ``delay_s`` after the next step; "" or the sentence why they were
        refused.

        Until a later start the joint goes on with what it does; of a trajectory that has begun already the rest is
        followed, its last angle stands, and no silence ends it.  Without points the motion ends where its reference has
        come.
        """
        with self._lock:
            if not self._driven:
                return "trajectory refused: the joint is off; call ~/enable first"
            if not len(times_s):
                self._forget_trajectories()
                self._pair.cancel()
                return ""
            if not all(abs(angle_rad) <= tau for angle_rad in angles_rad):
                return "trajectory refused: an angle of it is more than a whole turn, or none; radians are wanted"
            try:
                trajectory = Trajectory(times_s, angles_rad, velocities_m_s=velocities_rad_s)
            except ValueError as error:
                return str(error)
            if refusal := trajectory.refusal(delay_s):
                return refusal
            self._offered = delay_s, trajectory
            return ""

    def hold(self) -> None:
        """End the motion where the joint is measured to be."""
        with self._lock:
            self._forget_trajectories()
            self._pair.hold()

    @property
    def is_driven(self) -> bool:
        """Whether both wires are meant to be on; from any thread."""
        return self._driven

    def update(self, parameters: PairParameters) -> None:
        """Take over live parameters."""
        with self._lock:
            self._pair.parameters = parameters

    def switch_on(self, wanted: Callable[[], bool] = lambda: True) -> tuple[bool, str]:
        """Both wires on, while they are ``wanted``; whether that was done, and a sentence.

        The slack is taken up with the co-contraction of the parameters, and the joint is held where it is then.
        """
        with self._lock:
            if self._driven:
                return True, "the joint is on already"
        for name, wire in zip(self._pair.parameters.wires, self._wires, strict=True):
            done, words = wire.switch_on(wanted)
            if not done:
                for each in self._wires:
                    each.switch_off()
                return False, f"{name}: {words}"
        with self._lock:
            if not wanted():  # and both were told so
                return False, OFF_MEANWHILE
            self._pair.reset()
            self._driven, self._fault, self._why_off, self._lost, self._stepped_s = True, "", "", "", nan
            self._forget_trajectories()
        return True, "both wires are on; the slack is taken up, and the joint is held where it is then"

    def switch_off(self) -> tuple[bool, str]:
        """Both wires off; whether they are, and what became of each."""
        with self._lock:
            self._driven = False  # first: no setpoint more, and neither goes off because the other did
        return self._ask(lambda wire: wire.switch_off())

    def clear_fault(self, timeout_s: float = 5.0) -> tuple[bool, str]:
        """Clear the latched faults of both wires, which stay off; whether that was done, and what became of each."""

        def clear(wire: PairedWire) -> tuple[bool, str]:
            driver = wire.driver
            return (False, "it has no loop") if driver is None else driver.clear_fault(timeout_s)

        cleared, words = self._ask(clear)
        if cleared:
            with self._lock:
                self._fault, self._why_off = "", ""
        return cleared, words

    def _ask(self, request: Callable[[PairedWire], tuple[bool, str]]) -> tuple[bool, str]:
        answers = [(name, *request(wire)) for name, wire in zip(self._pair.parameters.wires, self._wires, strict=True)]
        return all(done for _, done, _ in answers), "; ".join(f"{name}: {words}" for name, _, words in answers)

    # --- after each step of a wire, in its control thread ------------------------------------------

    def take_output(self, number: int, output: Output) -> None:
        """Take what a wire's step has said: where it is off, the other goes off; else their setpoints follow."""
        with self._lock:
            self._outputs[number] = output
            if self._driven and not output.command.output_on:
                self._driven = False
                self._let_go(number, output.status)
            elif self._fault and number == self._first and not output.status.fault:
                self._come_back()
            if number != 0:
                return
            said = self._step(output.signals.time_s)
        self._on_output(said)

    def _let_go(self, number: int, status: Status) -> None:
        """A wire has gone off: have the other off with its next step."""
        why = f"{self._pair.parameters.wires[number]}: {without_advice(status.message)}"
        self._fault, self._why_off, self._first = status.fault, why, number
        driver = self._wires[1 - number].driver
        if driver is None:
            return
        if status.fault:
            driver.submit(lambda actuator, now_s: actuator.raise_fault(now_s, partner_off.name, why))
        else:
            driver.submit(lambda actuator, now_s: actuator.enable(now_s, False))

    def _come_back(self) -> None:
        """The fault of the wire that went off first has passed: the other has none by it any more."""
        driver = self._wires[1 - self._first].driver
        if driver is None or not driver.output_is_off:
            return
        driver.submit(lambda actuator, now_s: actuator.end_fault(partner_off.name))
        self._fault, self._why_off = "", ""

    def _step(self, time_s: float) -> JointOutput:
        """One step of the law, where both wires are driven."""
        pair, wires = self._pair, [_state_of(output) for output in self._outputs]
        setpoints_m = (nan, nan)
        if self._driven:
            dt_s = time_s - self._stepped_s if self._stepped_s == self._stepped_s else 0.0
            self._stepped_s = time_s
            self._move(time_s)
            if self._motion is None:
                self._lose_commander(time_s)
            setpoints_m = pair.step(wires, max(dt_s, 0.0))
            for wire, setpoint_m in zip(self._wires, setpoints_m, strict=True):
                driver = wire.driver
                if driver is not None and isfinite(setpoint_m):
                    driver.offer_setpoint(setpoint_m)
        else:
            pair.see(wires)
        estimate = pair.estimate
        if not self._driven:  # nobody knows, as of a wire whose output is off
            estimate = replace(estimate, angle_rad=nan, uncertainty_rad=nan)
        return JointOutput(time_s, estimate, self._status(estimate), pair.reference_rad, setpoints_m)

    def _move(self, time_s: float) -> None:
        """Ask for the angle of the trajectory that is followed now."""
        if self._offered is not None:
            delay_s, trajectory = self._offered
            self._offered, self._awaited = None, (time_s + delay_s, trajectory)
        if self._awaited is not None and time_s >= self._awaited[0]:
            (start_s, trajectory), self._awaited, self._lost = self._awaited, None, ""
            self._motion = start_s, trajectory.led_in(time_s - start_s, self._pair.reference_rad)
        if self._motion is not None:
            start_s, trajectory = self._motion
            self._pair.command(trajectory(time_s - start_s))

    def _lose_commander(self, time_s: float) -> None:
        """Hold the joint where it is, where commands were followed and none has come for too long."""
        if not isfinite(self._heard_s):
            self._heard_s = time_s
        silent_s, timeout_s = time_s - self._heard_s, self._pair.parameters.joint_command_timeout
        if self._pair.commanded and 0.0 < timeout_s < silent_s:
            self._pair.hold()
            self._lost = f"no joint command for {silent_s:.2g} s; joint_command_timeout is {timeout_s:g} s"

    def _status(self, estimate: JointEstimate) -> Status:
        pair, limits = self._pair, self._pair.limits
        if not self._driven:
            mode, words, limits = Mode.OFF, f"off: {self._why_off}" if self._why_off else "off", ()
            if self._fault:
                words += AFTER_A_LOSS if FAULTS[self._fault].until_back else AFTER_A_FAULT
        elif not isfinite(estimate.angle_rad):
            mode, words = Mode.HOLD, "taking up the slack"
        elif pair.commanded:
            mode, words = Mode.TRACKING, "tracking"
        else:
            mode, words = Mode.HOLD, "holding"
        fault = self._fault
        if self._driven:
            words += in_words(self._awaited[0] - self._stepped_s) if self._awaited is not None else ""
            fault = setpoint_stale.name if self._lost else ""
            words += f": {setpoint_stale.words} ({self._lost})" if self._lost else ""
        if limits:
            words += f": {', '.join(LIMITS[name] for name in limits)}"
        known = isfinite(estimate.torque_Nm)
        lowest_rad, highest_rad = pair.range_rad(pair.shared_N(estimate.torque_Nm)) if known else (nan, nan)
        values: dict[str, float | str] = {
            "angle_rad": estimate.angle_rad,
            "uncertainty_rad": estimate.uncertainty_rad,
            "cocontraction_N": estimate.cocontraction_N,
            "torque_Nm": estimate.torque_Nm,
            "asked_angle_rad": pair.asked_rad,
            "asked_cocontraction_N": pair.asked_N,
            "reference_rad": pair.reference_rad,
            "lowest_rad": lowest_rad,
            "highest_rad": highest_rad,
        }
        return Status(mode, fault, limits, words, values)


def _state_of(output: Output | None) -> WireState:
    """What the law wants to know of a wire."""
    if output is None:
        return _UNKNOWN
    estimate, load_N = output.estimate, output.signals.load_N
    if estimate.quality is Quality.INVALID:
        return WireState(nan, nan, load_N)
    return WireState(estimate.displacement_m, estimate.uncertainty_m, load_N, estimate.velocity_m_s)
