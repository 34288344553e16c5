"""The supply's output: what is known of it, and every word that changes it.  One owner.

What is known is one of six states, and only these events lead from one to another:

================  =======================================  ==========================================================
state             event                                    then
================  =======================================  ==========================================================
UNKNOWN           opened, which says off                   FOUND_OFF
any               the loop says off                        NOT_CONFIRMED; read back as off: OFF
any but on        the loop says on                         NOT_CONFIRMED; told: TOLD_ON; overruled: NOT_CONFIRMED
TOLD_ON, READ_ON  read back as on, or not                  READ_ON, or TOLD_ON
TOLD_ON, READ_ON  lost, cut, or off said beside the loop   NOT_CONFIRMED
OFF               the same                                 FOUND_OFF
any but UNKNOWN   off read back beside the loop            FOUND_OFF
================  =======================================  ==========================================================

A step that wants the output off says so in every state but OFF, until that is read back.  A step that wants it on is
*overruled* where off was said beside the loop (by :meth:`SupplyOutput.off_beside`, by the watchman, by the end of the
driver) and the loop has not taken that over yet: it says off, also where it had begun to say on.
"""

from __future__ import annotations

import dataclasses
import enum
import math
import threading
from concurrent.futures import Future

from sma_actuator.base.signals import Command, Output, SupplyState
from sma_actuator.instruments import InstrumentError, PowerSupply
from sma_actuator.safety.parameters import SafetyParameters
from sma_actuator.safety.records import Fault

#: Changes of the commanded current smaller than this are not sent: the finest step of the supplies
#: in use is 0.02 mA (thesis, ch. 3), and each message costs time on the bus.
CURRENT_RESOLUTION_A = 5e-6


class Known(enum.Enum):
    """What is known of the supply's output."""

    UNKNOWN = enum.auto()  #: nothing was asked, and nothing was told
    FOUND_OFF = enum.auto()  #: it was read back as off, which the loop has not said itself yet
    OFF = enum.auto()  #: the loop has said off, and that was read back
    NOT_CONFIRMED = enum.auto()  #: it may be on: what it was told last is not known, or not obeyed
    TOLD_ON = enum.auto()  #: it was told to be on
    READ_ON = enum.auto()  #: and says so itself

    def __init__(self, number: int):
        #: Whether it was read back as off, and told nothing else since.
        self.is_off = self.name in ("FOUND_OFF", "OFF")
        #: Whether it was told to be on, and nothing else since.
        self.is_on = self.name in ("TOLD_ON", "READ_ON")
        #: Whether it was told to be on, and since then not read back as off.
        self.may_flow = self.is_on or self.name == "NOT_CONFIRMED"


class SupplyOutput:
    """The output of one supply.  To be asked from any thread; who may say what stands at each method.

    ``safety`` may be replaced while it is in use; ``ending`` is set when nothing may go on any more.
    """

    def __init__(self, supply: PowerSupply, safety: SafetyParameters, ending: threading.Event):
        self.safety = safety
        self._supply = supply
        self._ending = ending
        self._known = Known.UNKNOWN
        self._told_A = math.nan  #: the current it was told last; NaN: not known
        self._cut: tuple[Fault, str] | None = None  #: as which fault and why it was cut; the loop has not noted it
        self._asked_off: Future | None = None  #: what the loop was told when off was last said beside it
        self._flows_since_s = math.inf  #: from when on current was measured behind an output that reads back as off
        self._lock = threading.Lock()  #: from one state to another; never held while a word is said
        self._speaking = threading.Lock()  #: held while a step says its command, or somebody says off beside a step

    # --- what is known ----------------------------------------------------------------------------

    @property
    def known(self) -> Known:
        """Its state."""
        return self._known

    @property
    def words(self) -> str:
        """What is known, in words."""
        known = self._known
        if not known.may_flow:
            return "the output is off"
        return "the output is on" if known.is_on else "the output is told to be off, not confirmed"

    @property
    def was_cut(self) -> bool:
        """Whether it was cut beside the loop, which has not noted that yet."""
        return self._cut is not None

    @property
    def off_is_asked(self) -> bool:
        """Whether off was said beside the loop, which has not taken that over yet."""
        return self._asked_off is not None and not self._asked_off.done()

    # --- the control thread -----------------------------------------------------------------------

    def opened(self) -> None:
        """The supply was connected to for the first time, and said off before it was asked anything."""
        self._become(Known.FOUND_OFF, math.nan)

    def lost(self) -> None:
        """The supply does not answer: what it was told is not known any more."""
        with self._lock:
            if self._known.is_on:
                self._known = Known.NOT_CONFIRMED
            elif self._known is Known.OFF:
                self._known = Known.FOUND_OFF
            self._told_A = math.nan

    def seen(self, state: SupplyState | None) -> None:
        """Take note of what the supply says of itself; None: nothing."""
        with self._lock:
            if self._known.is_on:
                self._known = Known.READ_ON if state is not None and state.output_on else Known.TOLD_ON

    def write(self, command: Command, state: SupplyState | None) -> None:
        """Tell the supply what it does not know yet, off where it says that it is on.  Raises InstrumentError."""
        with self._speaking:
            if command.output_on and not self._overruled:
                self._say_on(command.current_A)
            elif self._known is not Known.OFF or (state is not None and state.output_on):
                self.switch_off()

    def switch_off(self) -> None:
        """Have the output off, and know it.  Raises InstrumentError."""
        self._become(Known.NOT_CONFIRMED, math.nan)
        self._supply.switch_off()
        self._become(Known.OFF, 0.0)

    def take_cut(self) -> tuple[Fault, str] | None:
        """As which fault and why it was cut beside the loop since this was last asked; None where it was not."""
        cut = self._cut
        if cut is not None:
            self.lost()
            self._cut = None
        return cut

    def _say_on(self, current_A: float) -> None:
        was_on, told_A = self._known.is_on, self._told_A
        if not was_on:
            self._become(Known.NOT_CONFIRMED, math.nan)
        if not abs(current_A - told_A) <= CURRENT_RESOLUTION_A:
            self._supply.set_current(current_A)
            told_A = current_A
        if not was_on:
            if self._overruled:  # while the current was told
                self.switch_off()
                return
            self._supply.set_output(True)
        with self._lock:
            if was_on:
                self._told_A = told_A if self._known.is_on else math.nan
            elif self._overruled:  # what was said beside this may have come before it, or after
                self._known = Known.NOT_CONFIRMED
            else:
                self._known, self._told_A = Known.TOLD_ON, told_A

    @property
    def _overruled(self) -> bool:
        return self._cut is not None or self.off_is_asked or self._ending.is_set()

    def _become(self, known: Known, told_A: float) -> None:
        with self._lock:
            self._known, self._told_A = known, told_A

    # --- beside the control thread ----------------------------------------------------------------

    def off_beside(self, taken_over: Future, timeout_s: float) -> None:
        """Say off beside a step that lasts, but not between its words; nothing where they do not end in time.

        ``taken_over``: done when the loop has heard it; until then no step says on.
        """
        if not self._speaking.acquire(timeout=timeout_s):
            return
        try:
            self._asked_off = taken_over
            self.lost()
            self._supply.switch_off()
            self._found_off()
        except InstrumentError:
            pass  # of which the loop will hear
        finally:
            self._speaking.release()

    def cut(self, fault: Fault, why: str) -> None:
        """Shut the supply down beside a loop that hangs, which will note that as this fault; it waits for nobody."""
        self._cut = fault, why
        self.shut_down()

    def shut_down(self) -> None:
        """Have the supply off for good, or until the loop has noted it; it waits for nobody.  Never raises."""
        self.lost()
        if self._supply.shut_down():
            self._found_off()

    def _found_off(self) -> None:
        with self._lock:
            if self._known is not Known.UNKNOWN:
                self._known, self._told_A = Known.FOUND_OFF, math.nan

    # --- what is said of it -----------------------------------------------------------------------

    def with_truth(self, output: Output) -> Output:
        """The output of a step with what is known of the supply's output beside what was commanded."""
        words, flows = self.words, self._flows_on(output)
        if flows:
            words = f"the output is read back as off, and {output.signals.current_A:.3g} A flow: pull the supply's plug"
        output.status.values["output"] = words.removeprefix("the output is ")
        if output.command.output_on or not (self._known.may_flow or flows):
            return output
        message = words + output.status.message.removeprefix("off")
        return dataclasses.replace(output, status=dataclasses.replace(output.status, message=message))

    def _flows_on(self, output: Output) -> bool:
        """Whether current has flown longer than readings may be wrong, though the supply says that its output is
        off."""
        safety, signals = self.safety, output.signals
        if output.reading is None or not self._known.is_off or not signals.current_A > safety.current_disagreement:
            self._flows_since_s = math.inf
            return False
        # By the time of the signals: where a reading is unusable they are of before, when the output was on.
        self._flows_since_s = min(self._flows_since_s, signals.time_s)
        return signals.time_s - self._flows_since_s >= safety.disagreement_time
