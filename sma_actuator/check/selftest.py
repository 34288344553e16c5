"""One pass over everything between the parameters and the wire, with no more than twice the bias current.

Each part says one sentence of what it found.  What a part finds wrong ends the parts that need it.  On every way out
the current is zero and the output off, and what the supply read back of that is the last sentence.
"""

from __future__ import annotations

from collections.abc import Callable

from sma_actuator.config import BenchConfig
from sma_actuator.instruments import Clock, Daq, InstrumentError, PowerSupply

from .bias_current import at_bias
from .found import Found, passed
from .more_current import at_more, between, heat
from .output_off import at_rest, displacement, gains, identity, limits, opening, speed
from .probe import Ends, Probe
from .watchdog import watchdog


class SelfTest:
    """The parts, on instruments that are not connected yet, of a wire with a model or without.

    ``other_daq`` makes the DAQ anew, for other blocks.  :meth:`abort` ends it from another thread.
    """

    def __init__(
        self,
        config: BenchConfig,
        supply: PowerSupply,
        daq: Daq,
        clock: Clock,
        other_daq: Callable[[BenchConfig], Daq] | None = None,
    ):
        self._probe = Probe(config, supply, daq, clock)
        self._probe.other_daq = other_daq
        #: Both as the parameters have them, where those of the test wait longer for an answer than any loop may.
        self.as_written: Callable[[], tuple[PowerSupply, Daq]] | None = None
        self.off_confirmed = False

    @property
    def found(self) -> list[Found]:
        """What the parts have found so far."""
        return self._probe.found

    @property
    def identity(self) -> str:
        """Who the supply says that it is; empty before it was asked."""
        return self._probe.identity

    def abort(self) -> None:
        """End it at the next reading, with the output off."""
        self._probe.aborted.set()

    def run(self, interrupted: Callable[[], bool] = lambda: False) -> list[Found]:
        """Do all parts; ``interrupted`` is asked before every reading."""
        probe = self._probe
        probe.interrupted = interrupted
        try:
            probe.say("identity", identity(probe))
            for part in (
                displacement,
                limits,
                speed,
                gains,
                at_rest,
                at_bias,
                at_more,
                between,
                heat,
                watchdog,
            ):
                part(probe)
        except Ends:
            pass
        except InstrumentError as error:
            probe.wrong("instruments", str(error))
        finally:
            self.off_confirmed = probe.supply.shut_down()
            for instrument in (probe.supply, probe.daq):
                instrument.close()
        if self.as_written is not None and self.off_confirmed and passed(probe.found):
            self.off_confirmed = opening(probe, *self.as_written())
        if self.off_confirmed:
            probe.say("output", "the output is off, and the supply has read that back")
        elif probe.opened:
            probe.wrong("output", "the output is not confirmed to be off: look at the supply, switch it off by hand")
        else:
            probe.wrong(
                "output",
                "the output is not confirmed to be off, since the supply was not opened: unless "
                "another program drives it, look at it",
            )
        return probe.found
