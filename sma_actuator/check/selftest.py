"""One pass over everything between the parameters and the wire, with no more than twice the bias current.

Each part says one sentence of what it found.  What a part finds wrong ends the parts that need it.  On every way out
the current is zero and the output off, and what the supply read back of that is the last sentence.
"""

from __future__ import annotations

import enum
import math
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from sma_actuator.base.calibration import through
from sma_actuator.base.signals import Reading, SupplyState
from sma_actuator.config import BenchConfig, Config
from sma_actuator.derived import not_survived
from sma_actuator.estimation.circuit import signals_from_reading
from sma_actuator.instruments import Clock, Daq, InstrumentError, PowerSupply
from sma_actuator.safety.alive import RARE
from sma_actuator.safety.guards.supply import SETTING_TOLERANCE_A
from sma_actuator.safety.supervisor import may_flow_W, unwatched_s
from sma_actuator.safety.thermal import WireHeat

from .pace import LEAST_RATE_Hz, Pace

BLOCKS = 20  #: read for each mean
STEPS = 10  #: of the loop, of which the median says what the instruments take
SETTLING_s = 0.4  #: after a change of the current
MORE_CURRENT = 2.0  #: times the bias, for a moment, to tell a zero error from a resistance
#: The current may be off by this share of the bias, a voltage by this share of what the wire should show.
CURRENT_SHARE, VOLTAGE_SHARE = 0.1, 0.05
#: With the output off: volts that may stand at a channel, as a share of what the bias makes of it.
ZERO_SHARE = 0.03
NOISE_SHARE = 0.02  #: the same of a channel's noise; for the load, of the load at wire.max_stress
LEAST_LOAD_SHARE = 0.01  #: of the load at wire.max_stress, below which the sign of the load cell cannot be told
#: Resistivity that a wire of each alloy may have, cold or hot [Ω·m].
RESISTIVITY_Ohm_m = {"ni-ti": (0.65e-6, 1.15e-6), "ni-ti-cu": (0.45e-6, 1.15e-6)}
#: The wire may differ from its calibration by this share.
CALIBRATION_SHARE = 0.03
PERIOD_SHARE = 0.2  #: by which the DAQ may be slower than the loop
#: At which most wires have contracted: measured Flexinol by nine tenths at 97 (50 MPa) to 114 °C (200 MPa).
CONTRACTED_C = 115.0
WATCHDOG_TIMES = 1.5  #: of its delay, that the watchdog may take to cut
_ROUNDING_s = 1e-6  #: a clock that goes by steps may stand so much before what was waited for
#: Above the bias [A]: so close and so far that steps of 5 mA and more lie SETTING_TOLERANCE_A away from one at least.
BETWEEN_A = tuple(0.7e-3 * number for number in range(1, 9))
CUT_SHARE = 0.2  #: of the bias current, below which the output counts as cut


class Level(enum.IntEnum):
    """How bad it is."""

    OK = 0
    WARNING = 1  #: could not be told, or should be looked at
    WRONG = 2


@dataclass(frozen=True, slots=True)
class Found:
    """What one part found."""

    part: str
    level: Level
    sentence: str


def passed(found: list[Found]) -> bool:
    """Whether nothing was wrong."""
    return all(each.level is not Level.WRONG for each in found)


class _Ends(Exception):
    """Later parts make no sense."""


class SelfTest:
    """The parts, on instruments that are not connected yet, of a wire with a model or without.

    :meth:`abort` ends it from another thread.
    """

    def __init__(self, config: BenchConfig, supply: PowerSupply, daq: Daq, clock: Clock):
        self._config, self._supply, self._daq, self._clock = config, supply, daq, clock
        self._aborted = threading.Event()
        self._opened = False  #: the supply was, so that what flows is ours
        self._feeding = False  #: the watchdog of the supply
        self.found: list[Found] = []
        self.identity = ""
        self.off_confirmed = False

    def abort(self) -> None:
        """End it at the next reading, with the output off."""
        self._aborted.set()

    def run(self, interrupted: Callable[[], bool] = lambda: False) -> list[Found]:
        """Do all parts; ``interrupted`` is asked before every reading."""
        self._interrupted = interrupted
        try:
            self._say("identity", self._identity())
            for part in (
                self._displacement,
                self._limits,
                self._speed,
                self._at_rest,
                self._at_bias,
                self._at_more,
                self._between,
                self._heat,
                self._watchdog,
            ):
                part()
        except _Ends:
            pass
        except InstrumentError as error:
            self._wrong("instruments", str(error))
        finally:
            self.off_confirmed = self._supply.shut_down()
            for instrument in (self._supply, self._daq):
                instrument.close()
        if self.off_confirmed:
            self._say("output", "the output is off, and the supply has read that back")
        elif self._opened:
            self._wrong("output", "the output is not confirmed to be off: look at the supply, switch it off by hand")
        else:
            self._wrong(
                "output",
                "the output is not confirmed to be off, since the supply was not opened: unless "
                "another program drives it, look at it",
            )
        return self.found

    # --- what is said ---------------------------------------------------------------------------------

    def _say(self, part: str, sentence: str, level: Level = Level.OK) -> None:
        self.found.append(Found(part, level, sentence))

    def _wrong(self, part: str, sentence: str) -> None:
        self._say(part, sentence, Level.WRONG)

    def _end(self, part: str, sentence: str) -> None:
        self._wrong(part, sentence)
        raise _Ends

    # --- reading --------------------------------------------------------------------------------------

    def _wait(self, seconds: float) -> None:
        until_s = self._clock.now_s() + seconds
        while (now_s := self._clock.now_s()) < until_s - _ROUNDING_s:
            self._clock.sleep_until_s(min(until_s, now_s + 1.0 / self._config.loop.rate))
            self._look_up()

    def _look_up(self) -> None:
        if self._feeding:
            self._flows()
        if self._aborted.is_set() or self._interrupted():
            self._end("abort", "ended before its time: asked to")

    def _flows(self) -> SupplyState:
        """What the supply reads back while current flows, which feeds its watchdog."""
        state = self._supply.read_back()
        if "WDOG" in state.tripped:
            self._end(
                "watchdog",
                "the supply's watchdog cut meanwhile: this computer stood still for longer than "
                f"supply.watchdog_timeout, {self._config.supply.watchdog_timeout:g} s; look again "
                "when it has less to do",
            )
        if state.tripped:
            self._end("bias", f"the supply's protection tripped at the bias current ({state.tripped})")
        return state

    def _blocks(self) -> Iterator[Reading]:
        """Readings at the loop's rate."""
        period_s, deadline_s = 1.0 / self._config.loop.rate, self._clock.now_s()
        for _ in range(BLOCKS):
            self._look_up()
            deadline_s = max(deadline_s + period_s, self._clock.now_s())
            self._clock.sleep_until_s(deadline_s)
            yield self._daq.read_block()

    def _read(self) -> dict[str, np.ndarray]:
        """Every channel of BLOCKS readings, and their times."""
        rows = list(self._blocks())
        names = ("time_s", "supply_voltage_V", "reference_voltage_V", "load_cell_voltage_V")
        return {name: np.array([getattr(row, name) for row in rows]) for name in names}

    # --- the parts --------------------------------------------------------------------------------------

    def _identity(self) -> str:
        self._supply.open()
        self._opened = True
        self._daq.open()
        self.identity = self._supply.identity
        return f"the supply is {self._supply.identity}; the DAQ is {self._daq.identity}"

    def _limits(self) -> None:
        state = self._supply.read_back()
        if state.tripped:
            self._end("trips", f"a protection of the supply has tripped already ({state.tripped}): find out why")
        if state.output_on:
            self._end("trips", "the output is on although it was told to be off: somebody else commands the supply")
        self._supply.check_settings()
        limits = self._config.supply
        settings = {
            "voltage_setting": ("compliance voltage", f"{limits.max_voltage:g} V"),
            "over_current_trip": ("over-current trip", f"{limits.over_current_trip:g} A"),
        }
        told = self._supply.reads_back
        held = " and ".join(f"{what} {value}" for name, (what, value) in settings.items() if name in told)
        lacking = " and no ".join(what for name, (what, _) in settings.items() if name not in told)
        hot = not_survived(self._config.wire, limits, self._config.thermal)
        self._say(
            "trips",
            (f"{held} read back as programmed; " if held else "")
            + "nothing has tripped"
            + (f"; this supply has no {lacking} that can be read back" if lacking else "")
            + (f"; {hot}" if hot else ""),
            Level.WARNING if hot else Level.OK,
        )

    def _speed(self) -> None:
        """Output off: both quick enough for the loop and its time-outs?  Slower ones give no later part a chance."""
        self._block()
        pace = self._pace()
        if pace.too_slow:
            self._end("speed", pace.sentence)

    def _at_rest(self) -> None:
        """Output off: rate, zeros, noise and the load."""
        config = self._config
        values = self._read()
        self._rate(values["time_s"])
        for name, channel in values.items():
            if not np.isfinite(channel).all() or (
                name != "time_s" and (np.abs(channel) >= config.safety.channel_max_voltage).any()
            ):
                self._end(
                    "channels",
                    f"the channel of the {_WORDS[name]} reads {channel[-1]:g} V: is it connected, and its range right?",
                )
        bias_V = config.supply.bias_current * config.circuit.reference_resistance
        wire_V = config.supply.bias_current * self._expected_Ohm()[0]
        most_N = config.wire.max_stress * config.wire.area_m2
        bounds_V = {
            "reference_voltage_V": bias_V,
            "supply_voltage_V": wire_V,
            "load_cell_voltage_V": most_N / abs(config.load_cell.slope),
        }
        for name, full_V in bounds_V.items():
            noise_V = float(np.std(values[name]))
            if noise_V > NOISE_SHARE * full_V:
                self._wrong(
                    "noise",
                    f"the channel of the {_WORDS[name]} has {noise_V * 1e3:.3g} mV of noise; "
                    f"{NOISE_SHARE * full_V * 1e3:.3g} mV is the most that can be used: screen and ground it",
                )
        for name in ("reference_voltage_V", "supply_voltage_V"):
            zero_V = float(np.mean(values[name]))
            if abs(zero_V) > ZERO_SHARE * bounds_V[name] + 1e-3:
                self._wrong(
                    "zeros",
                    f"the channel of the {_WORDS[name]} reads {zero_V * 1e3:.3g} mV with the output off, not zero",
                )
        if passed(self.found):
            self._say("noise", "zeros and noise of the channels are what they may be")
        self._digits(values["load_cell_voltage_V"])
        self._load(values)

    def _digits(self, load_cell_V: np.ndarray) -> None:
        """Do they change where nothing moves, so that by chance alone the load cell is not taken for stuck?"""
        rate_Hz, stuck_s = self._config.loop.rate, self._config.safety.stuck_time
        alike = float(np.mean(np.diff(load_cell_V) == 0.0))
        if not 0.0 < alike < 1.0:  # of one that never changes ``_at_bias`` speaks
            return
        chance_s = math.log(RARE) / math.log(alike) / rate_Hz
        if chance_s <= stuck_s:
            return
        self._say(
            "digits",
            f"{100.0 * alike:.0f} % of the load cell's readings are like the one before to the last digit, so that it "
            f"would be taken for stuck after safety.stuck_time, {stuck_s:g} s: write safety.stuck_time: "
            f"{math.ceil(chance_s)}, or give it more gain, or more digits",
            Level.WARNING,
        )

    def _rate(self, time_s: np.ndarray) -> None:
        # A slow DAQ is slow with every block, a busy computer with some: the quickest tenth are the DAQ's.
        period_s, wanted_s = float(np.quantile(np.diff(time_s), 0.1)), 1.0 / self._config.loop.rate
        if not period_s <= (1.0 + PERIOD_SHARE) * wanted_s:
            self._wrong(
                "rate",
                f"the DAQ gives a new block every {period_s * 1e3:.3g} ms; loop.rate wants one every "
                f"{wanted_s * 1e3:.3g} ms",
            )
        else:
            self._say("rate", f"a new block every {period_s * 1e3:.3g} ms")

    def _block(self) -> None:
        """Is a block of several readings one that any loop could wait for?  What a shorter one takes is not known."""
        samples, began_s = self._config.loop.samples_per_block, self._clock.now_s()
        late: InstrumentError | None = None
        try:
            self._daq.read_block()
        except InstrumentError as error:
            late = error
        took_s = self._clock.now_s() - began_s
        if samples > 1 and took_s > 1.0 / LEAST_RATE_Hz:
            more = "more than " if late else ""
            self._end(
                "speed",
                f"a block of {samples} readings of each channel takes the DAQ {more}{took_s:.2g} s, as where it reads "
                f"one channel after the other, and a step may take {1.0 / LEAST_RATE_Hz:g} s at the most; write "
                "loop.samples_per_block: 1",
            )
        if late is not None:
            raise late

    def _pace(self) -> Pace:
        """What a step of the loop takes both instruments."""
        clock, times_s = self._clock, []
        for _ in range(STEPS):
            self._look_up()
            began_s = clock.now_s()
            self._daq.read_block()
            read_s = clock.now_s()
            self._supply.read_back()
            times_s.append((clock.now_s() - read_s, read_s - began_s))
        return Pace.of(times_s, self._config)

    def _step(self) -> None:
        """With current: the highest rate that both allow."""
        pace = self._pace()
        if pace.both_s == 0.0:
            return  # instruments in this process
        if pace.too_slow:
            self._wrong("speed", pace.sentence)
        else:
            look = pace.is_tight or pace.could_be_twice_as_quick
            self._say("speed", pace.sentence, Level.WARNING if look else Level.OK)

    def _load(self, values: dict[str, np.ndarray]) -> None:
        cell, wire = self._config.load_cell, self._config.wire
        self._load_N = self._cold_Ohm = math.nan
        if not cell.calibrated:
            self._say(
                "load cell", "not told: it has no calibration yet; `sma-actuator characterise` makes it", Level.WARNING
            )
            return
        most_N = wire.max_stress * wire.area_m2
        load_N = float(np.mean(values["load_cell_voltage_V"])) * cell.slope + cell.offset
        if load_N < -LEAST_LOAD_SHARE * most_N:
            self._wrong(
                "load cell",
                f"the load is {load_N:.3g} N: a wire cannot push; swap the load cell's leads, or the sign of "
                f"load_cell.slope",
            )
        elif load_N > most_N:
            self._end(
                "load cell",
                f"the load is {load_N:.3g} N, more than wire.max_stress allows, {most_N:.3g} N: take load off, or "
                "correct load_cell.slope and offset",
            )
        elif load_N < LEAST_LOAD_SHARE * most_N:
            self._say(
                "load cell",
                f"the load is {load_N:.3g} N: hang something on the wire, so that the sign can be told",
                Level.WARNING,
            )
        else:
            self._say("load cell", f"the load is {load_N:.3g} N and pulls")
        self._load_N = load_N
        # While nothing flows: a first curve is slow, and meanwhile nobody would feed the watchdog.
        rest = self._config.calibration.rest
        if rest.cold_resistance:
            self._cold_Ohm = float(through(rest.cold_stress, rest.cold_resistance, load_N / wire.area_m2))

    def _displacement(self) -> None:
        """Is it measured, where a model is still to be made?"""
        if not isinstance(self._config, Config) and not self._config.instruments.daq.lvdt_channel:
            self._say(
                "displacement",
                "not measured: instruments.daq.lvdt_channel is 0; `sma-actuator characterise` needs a sensor there",
                Level.WARNING,
            )

    def _at_bias(self) -> None:
        """Bias current: does what flows agree with what was told, and is it a wire?"""
        config = self._config
        self._supply.set_current(config.supply.bias_current)
        self._feeding = True
        self._supply.set_output(True)
        self._wait(SETTLING_s)
        values, state = self._read(), self._flows()
        self._step()
        for name in ("supply_voltage_V", "reference_voltage_V", "load_cell_voltage_V"):
            if np.ptp(values[name]) == 0.0:
                self._end(
                    "channels",
                    f"the channel of the {_WORDS[name]} reads {values[name][0]:g} V to the last digit: nothing is "
                    "connected to it, it is stuck, or its digits are coarser than any noise",
                )
        supply_V, reference_V = (float(np.mean(values[n])) for n in ("supply_voltage_V", "reference_voltage_V"))
        self._current(supply_V, reference_V, state)
        self._voltage(supply_V, state.voltage_V)
        self._resistance_Ohm = self._resistance(supply_V, reference_V)

    def _current(self, supply_V: float, reference_V: float, state: SupplyState) -> None:
        bias_A, sense_Ohm = self._config.supply.bias_current, self._config.circuit.reference_resistance
        by_supply_A, voltage_V = state.current_A, state.voltage_V
        by_daq_A = reference_V / sense_Ohm
        near_A = CURRENT_SHARE * bias_A
        if abs(by_supply_A - bias_A) > near_A:
            if voltage_V >= 0.95 * self._config.supply.max_voltage:
                self._end(
                    "bias",
                    f"the circuit is open: the supply is at its compliance voltage, {voltage_V:.3g} V, and "
                    f"{by_supply_A * 1e3:.3g} mA flow; look at the crimps and the leads",
                )
            rounded = "; that is what its dialect's digits leave of supply.bias_current: choose one that they can write"
            self._end(
                "bias",
                f"the supply was told {bias_A * 1e3:.3g} mA and says that it delivers {by_supply_A * 1e3:.3g} mA"
                f"{rounded if abs(by_supply_A + state.cut_off_A - bias_A) <= near_A else ''}",
            )
        if abs(by_daq_A - bias_A) <= near_A:
            self._say(
                "bias",
                f"{by_daq_A * 1e3:.4g} mA flow of {bias_A * 1e3:.4g} mA, by the supply and by the sense resistor",
            )
        elif abs(-by_daq_A - bias_A) <= near_A:
            self._end("sense resistor", "the current reads backwards: the taps of the sense resistor are swapped")
        elif abs(supply_V / sense_Ohm - bias_A) <= near_A:
            self._end(
                "sense resistor",
                "the channels of supply voltage and sense resistor are swapped: what should be the whole circuit "
                "shows the sense resistor alone",
            )
        elif abs(by_daq_A) <= near_A:
            self._end(
                "sense resistor", "no voltage at the sense resistor although the supply delivers: its taps are off"
            )
        else:
            self._end(
                "sense resistor",
                f"the sense resistor shows {reference_V * 1e3:.4g} mV at {by_supply_A * 1e3:.4g} mA, so it has "
                f"{reference_V / by_supply_A:.4g} Ω; circuit.reference_resistance is {sense_Ohm:g} Ω",
            )

    def _voltage(self, supply_V: float, by_supply_V: float) -> None:
        if abs(-supply_V - by_supply_V) <= VOLTAGE_SHARE * by_supply_V:
            self._end("supply voltage", "the supply voltage reads backwards: its taps are swapped")
        if abs(supply_V - by_supply_V) > VOLTAGE_SHARE * by_supply_V + 0.01:
            why = "are the taps across wire, leads and sense resistor?"
            if abs(by_supply_V / self._config.supply.max_voltage - 1.0) <= VOLTAGE_SHARE:
                why = "to that it was set; does its dialect ask for what it measures?"
            self._wrong(
                "supply voltage",
                f"the DAQ reads {supply_V:.4g} V where the supply delivers {by_supply_V:.4g} V: {why}",
            )

    def _expected_Ohm(self) -> tuple[float, float]:
        wire = self._config.wire
        low, high = RESISTIVITY_Ohm_m[wire.alloy]
        return wire.resistance_Ohm(low), wire.resistance_Ohm(high)

    def _resistance(self, supply_V: float, reference_V: float) -> float:
        config = self._config
        reading = Reading(0.0, supply_V, reference_V, 0.0)
        resistance_Ohm = signals_from_reading(reading, config).resistance_Ohm
        low_Ohm, high_Ohm = self._expected_Ohm()
        wire = config.wire
        of_wire = (
            f"{wire.length * 1e3:g} mm of {wire.diameter * 1e6:g} µm {wire.alloy} have {low_Ohm:.3g} to "
            f"{high_Ohm:.3g} Ω (ρL/A)"
        )
        if resistance_Ohm < config.safety.resistance_min or resistance_Ohm < 0.5 * low_Ohm:
            self._end("resistance", f"{resistance_Ohm:.3g} Ω: something bridges the wire; {of_wire}")
        if not low_Ohm <= resistance_Ohm <= high_Ohm:
            self._wrong(
                "resistance",
                f"{resistance_Ohm:.4g} Ω, and {of_wire}: is wire.length that between the crimps, wire.diameter that of "
                "the wire, circuit.lead_resistance that of the leads?",
            )
        else:
            self._say("resistance", f"{resistance_Ohm:.4g} Ω; {of_wire}")
            self._leads(resistance_Ohm)
        return resistance_Ohm

    def _leads(self, resistance_Ohm: float) -> None:
        config, cold_Ohm = self._config, self._cold_Ohm
        if not math.isfinite(cold_Ohm):
            self._say("leads", "not told: no calibration says what the cold wire has", Level.WARNING)
            return
        more_Ohm = resistance_Ohm - cold_Ohm
        if abs(more_Ohm) <= CALIBRATION_SHARE * cold_Ohm:
            self._say("leads", f"{more_Ohm:+.3f} Ω beside the calibration at cold rest ({cold_Ohm:.4g} Ω)")
            return
        side = "more" if more_Ohm > 0 else "less"
        self._wrong(
            "leads",
            f"{abs(more_Ohm):.3g} Ω {side} than the calibration has at cold rest ({cold_Ohm:.4g} Ω): the leads have "
            f"other than circuit.lead_resistance, {config.circuit.lead_resistance:g} Ω (~/measure_lead_resistance), "
            "the wire is not cold yet, or it is another",
        )

    def _at_more(self) -> None:
        """A moment of more current: a resistance stays what it is, a zero error of a channel does not look like one."""
        config = self._config
        more_A = min(MORE_CURRENT * config.supply.bias_current, config.supply.max_current)
        try:
            self._supply.set_current(more_A)
            self._wait(2.0 / config.loop.rate + config.loop.samples_per_block / config.loop.sample_rate)
            reading = self._daq.read_block()
            self._flows()
        finally:
            self._supply.set_current(config.supply.bias_current)
        signals = signals_from_reading(reading, config)
        away_Ohm = self._resistance_Ohm - signals.resistance_Ohm
        offset_V = away_Ohm / (1.0 / config.supply.bias_current - 1.0 / more_A)
        if not abs(away_Ohm) <= CALIBRATION_SHARE * self._resistance_Ohm:
            self._wrong(
                "linearity",
                f"{self._resistance_Ohm:.4g} Ω at {config.supply.bias_current * 1e3:.3g} mA and "
                f"{signals.resistance_Ohm:.4g} Ω at {more_A * 1e3:.3g} mA: a voltage channel has a zero error of about "
                f"{offset_V * 1e3:.3g} mV, or a contact is bad",
            )
        else:
            self._say("linearity", f"the same resistance at {more_A * 1e3:.3g} mA, within {abs(away_Ohm):.2g} Ω")

    def _between(self) -> None:
        """Currents that a controller asks for: steps that are too coarse look like a second commander to the driver."""
        supply = self._config.supply
        most_A = min(MORE_CURRENT * supply.bias_current, supply.max_current)
        try:
            for more_A in BETWEEN_A:
                wanted_A = min(supply.bias_current + more_A, most_A)
                self._supply.set_current(wanted_A)
                state = self._flows()
                found_A = state.current_setting_A
                if abs(found_A + state.cut_off_A - wanted_A) > SETTING_TOLERANCE_A:
                    self._wrong(
                        "steps",
                        f"the supply was told {wanted_A * 1e3:.4g} mA and reads back {found_A * 1e3:.4g} mA: it takes "
                        "currents in coarser steps than its dialect writes, as {value:.2f} for 10 mA",
                    )
                    return
        finally:
            self._supply.set_current(supply.bias_current)

    def _heat(self) -> None:
        """How hot the limit of current lets the wire become, before it has shown what heat it loses."""
        config, thermal = self._config, self._config.thermal
        heat = WireHeat(thermal)
        heat.cools, heat.at_most_C = False, thermal.transformed_temperature
        most_W, name = min(
            zip(may_flow_W(heat, config, unwatched_s(config)), ("heat_loss_margin", "unwatched_margin"), strict=True)
        )
        held_C = thermal.ambient_temperature + most_W / thermal.heat_loss
        said = (
            f"no more than {math.sqrt(most_W / self._resistance_Ohm) * 1e3:.3g} mA flow, of which the wire comes to "
            f"{held_C:.0f} °C by thermal.heat_loss, until it has shown what heat it loses"
        )
        if held_C >= CONTRACTED_C:
            self._say("heat", said)
            return
        self._say(
            "heat",
            f"{said}: one that contracts only hotter wants a thermal.{name} below {getattr(thermal, name):g}, or to be "
            f"looked at more often than every {unwatched_s(config):.2g} s (supply.watchdog_timeout, "
            "safety.reading_timeout; docs/guards.md)",
            Level.WARNING,
        )

    def _watchdog(self) -> None:
        """Not a word to the supply, and the current must go."""
        config = self._config
        delay_s = config.supply.watchdog_timeout
        if delay_s == 0.0:
            self._say(
                "watchdog",
                "none: whatever ends this computer leaves the current on",
                Level.WARNING,
            )
            return
        self._flows()
        self._feeding = False
        silent_s = self._clock.now_s()
        bias_V = config.supply.bias_current * config.circuit.reference_resistance
        while (reading := self._daq.read_block()).reference_voltage_V > CUT_SHARE * bias_V:
            if self._clock.now_s() - silent_s > WATCHDOG_TIMES * delay_s + 0.5:
                self._end(
                    "watchdog",
                    f"the watchdog did not cut within {WATCHDOG_TIMES * delay_s + 0.5:.3g} s of silence; it was armed "
                    f"with {delay_s:g} s. Nothing would switch this wire off after a kill -9",
                )
            self._wait(1.0 / config.loop.rate)
        took_s = reading.time_s - silent_s
        state = self._supply.read_back()
        named = "watchdog_trip" in self._supply.reads_back
        if named and (state.output_on or "WDOG" not in state.tripped):
            self._end(
                "watchdog",
                f"the current went after {took_s:.2g} s of silence, but the supply reads back "
                f"'{state.tripped or 'no trip'}', output {'on' if state.output_on else 'off'}; its watchdog's trip was "
                f"wanted",
            )
        self._supply.clear_trip()
        cleared = self._supply.read_back()
        if cleared.tripped or cleared.output_on:
            self._end(
                "watchdog",
                f"after clearing the trip the supply reads back '{cleared.tripped or 'no trip'}', output "
                f"{'on' if cleared.output_on else 'off'}",
            )
        why = "read back as WDOG" if named else "which this supply does not say"
        self._say("watchdog", f"cut after {took_s:.2g} s of silence, {why}, cleared with the output off")


_WORDS = {
    "time_s": "time",
    "supply_voltage_V": "supply voltage",
    "reference_voltage_V": "sense resistor",
    "load_cell_voltage_V": "load cell",
}
