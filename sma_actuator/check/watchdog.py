"""The last part of the self-test: not a word to the supply, and its watchdog must cut the current."""

from __future__ import annotations

from .found import Level
from .probe import Probe

WATCHDOG_TIMES = 1.5  #: of its delay, that the watchdog may take to cut
CUT_SHARE = 0.2  #: of the bias current, below which the output counts as cut


def watchdog(probe: Probe) -> None:
    """Not a word to the supply, and the current must go."""
    config = probe.config
    delay_s = config.supply.watchdog_timeout
    if delay_s == 0.0:
        probe.say(
            "watchdog",
            "none: whatever ends this computer leaves the current on",
            Level.WARNING,
        )
        return
    probe.flows()
    probe.feeding = False
    silent_s = probe.clock.now_s()
    bias_V = config.supply.bias_current * config.circuit.reference_resistance
    while (reading := probe.daq.read_block()).reference_voltage_V > CUT_SHARE * bias_V:
        if probe.clock.now_s() - silent_s > WATCHDOG_TIMES * delay_s + 0.5:
            probe.end(
                "watchdog",
                f"the watchdog did not cut within {WATCHDOG_TIMES * delay_s + 0.5:.3g} s of silence; it was armed "
                f"with {delay_s:g} s. Nothing would switch this wire off after a kill -9",
            )
        probe.wait(1.0 / config.loop.rate)
    took_s = reading.time_s - silent_s
    state = probe.supply.read_back()
    named = "watchdog_trip" in probe.supply.reads_back
    if named and (state.output_on or "WDOG" not in state.tripped):
        probe.end(
            "watchdog",
            f"the current went after {took_s:.2g} s of silence, but the supply reads back "
            f"'{state.tripped or 'no trip'}', output {'on' if state.output_on else 'off'}; its watchdog's trip was "
            f"wanted",
        )
    probe.supply.clear_trip()
    cleared = probe.supply.read_back()
    if cleared.tripped or cleared.output_on:
        probe.end(
            "watchdog",
            f"after clearing the trip the supply reads back '{cleared.tripped or 'no trip'}', output "
            f"{'on' if cleared.output_on else 'off'}",
        )
    why = "read back as WDOG" if named else "which this supply does not say"
    probe.say("watchdog", f"cut after {took_s:.2g} s of silence, {why}, cleared with the output off")
