"""What a step of the loop takes the instruments, and the parameters that slower ones want."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sma_actuator.base.sections import Loop
from sma_actuator.config import BenchConfig
from sma_actuator.driver import CHECK_PERIOD_s
from sma_actuator.instruments import INSTRUMENTS_SHARE, highest_rate_Hz
from sma_actuator.instruments.parameters import least_reading_timeout_s

#: A time-out is this many times the slowest answer that was seen in ten steps: a rare one may be half as slow again.
TIMEOUT_TIMES = 2.0
#: Where the supply leaves the DAQ no time within a step, its block is to take this share of the supply's.
DAQ_SHARE = 0.5
LEAST_RATE_Hz = 1.0  #: of loop.rate
USUAL_RATE_Hz = Loop().rate
RATE_SHARE = 0.9  #: of the highest rate, that is advised: the next ten steps take a little longer than these


#: So many of the supply's settings are looked at in one step at the most.
MOST_SETTINGS = 4


@dataclass(frozen=True, slots=True)
class Pace:
    """Times of one step, and what is to be written where they are too long."""

    supply_s: float  #: usual
    daq_s: float
    setting_s: float  #: of a look at one of the supply's settings
    rate_Hz: float  #: of the loop, as it is
    most_Hz: float  #: that the two allow as they are
    wanted: dict[str, float]  #: parameter → value, of those that do not allow such times; empty: all do

    @classmethod
    def of(cls, times_s: Sequence[tuple[float, float, float]], config: BenchConfig) -> Pace:
        """Of ``times_s`` of supply, DAQ and a look at one of the supply's settings in some steps."""
        supply_s, daq_s, setting_s = (float(median) for median in np.median(times_s, axis=0))
        slowest_s = np.max(times_s, axis=0)
        both_s, rate_Hz = supply_s + daq_s, config.loop.rate
        most_Hz = _highest_Hz(both_s, setting_s) if both_s else math.inf
        instruments = config.instruments
        fits = both_s + _settings(rate_Hz) * setting_s <= 1.0 / rate_Hz and slowest_s[0] <= instruments.supply.timeout
        fits = fits and slowest_s[1] <= instruments.daq.timeout
        wanted = {} if fits else _wanted(supply_s, daq_s, most_Hz, slowest_s, config)
        return cls(supply_s, daq_s, setting_s, rate_Hz, most_Hz, wanted)

    @property
    def both_s(self) -> float:
        """Of one step."""
        return self.supply_s + self.daq_s

    @property
    def too_slow(self) -> bool:
        """Whether the loop cannot run so."""
        return bool(self.wanted)

    @property
    def is_tight(self) -> bool:
        """Whether nothing is left for the program."""
        return self.rate_Hz > self.most_Hz * (1.0 + 1e-9)

    @property
    def could_be_twice_as_quick(self) -> bool:
        """Whether the loop reads less than half as often as it could and usually does, as after a block was made
        shorter."""
        return not self.wanted and self.rate_Hz <= 0.5 * min(RATE_SHARE * self.most_Hz, USUAL_RATE_Hz)

    @property
    def sentence(self) -> str:
        """All of it in words."""
        said = (
            f"a step takes the supply {self.supply_s * 1e3:.3g} ms, a look at one of its settings "
            f"{self.setting_s * 1e3:.3g} ms and the DAQ {self.daq_s * 1e3:.3g} ms"
        )
        if not self.wanted:
            quicker_Hz = min(_down(RATE_SHARE * self.most_Hz), USUAL_RATE_Hz) if self.could_be_twice_as_quick else 0.0
            write = f"; write loop.rate: {quicker_Hz:g}, which follows a quick wire better" if quicker_Hz else ""
            return f"{said}, so loop.rate can be {self.most_Hz:.3g} Hz at the most; it is {self.rate_Hz:g} Hz{write}"
        wanted = ", ".join(f"{name}: {value:g}" for name, value in self.wanted.items())
        return f"{said}, too long for loop.rate, {self.rate_Hz:g} Hz, or the time-outs; write {wanted}"


def _settings(rate_Hz: float) -> int:
    """How many settings are looked at in a step that looks at any."""
    return min(math.ceil(1.0 / rate_Hz / CHECK_PERIOD_s), MOST_SETTINGS)


def _highest_Hz(both_s: float, setting_s: float) -> float:
    """The loop's rate that such times allow: the slower it is, the more settings are due in a step."""
    rates_Hz = [highest_rate_Hz(both_s + number * setting_s) for number in range(1, MOST_SETTINGS + 1)]
    return next((rate_Hz for number, rate_Hz in enumerate(rates_Hz, 1) if _settings(rate_Hz) <= number), rates_Hz[-1])


def _wanted(
    supply_s: float, daq_s: float, most_Hz: float, slowest_s: np.ndarray, config: BenchConfig
) -> dict[str, float]:
    """Parameters that such times want and that are not so already."""
    loop, safety, instruments = config.loop, config.safety, config.instruments
    # What of the DAQ's time its block takes is not known: the rate is one that such times allow, and where the block is
    # made shorter the next check says by how much it can be higher.
    for_daq_s = max(INSTRUMENTS_SHARE / loop.rate - supply_s, DAQ_SHARE * supply_s)
    samples = max(1, math.floor(min(1.0, for_daq_s / daq_s) * loop.samples_per_block + 1e-9)) if daq_s else 1
    rate_Hz = loop.rate if loop.rate <= most_Hz * (1.0 + 1e-9) else max(LEAST_RATE_Hz, _down(RATE_SHARE * most_Hz))
    supply_timeout_s = max(instruments.supply.timeout, _up(TIMEOUT_TIMES * slowest_s[0]))
    daq_timeout_s = max(instruments.daq.timeout, _up(TIMEOUT_TIMES * slowest_s[1]))
    least_s = least_reading_timeout_s(supply_timeout_s, daq_timeout_s, rate_Hz)
    wanted = {
        "loop.rate": (loop.rate, rate_Hz),
        "loop.samples_per_block": (loop.samples_per_block, samples),
        "instruments.supply.timeout": (instruments.supply.timeout, supply_timeout_s),
        "instruments.daq.timeout": (instruments.daq.timeout, daq_timeout_s),
        "safety.reading_timeout": (safety.reading_timeout, max(safety.reading_timeout, _up(1.001 * least_s))),
    }
    if config.supply.watchdog_timeout:
        held_s = max(config.supply.watchdog_timeout, _up(2.0 / rate_Hz))
        wanted["supply.watchdog_timeout"] = (config.supply.watchdog_timeout, held_s)
    return {name: value for name, (is_now, value) in wanted.items() if value != is_now}


def _down(value: float) -> float:
    """With two digits, not above it."""
    scale = 10.0 ** (math.floor(math.log10(value)) - 1)
    return round(math.floor(value / scale + 1e-9) * scale, 12)


def _up(value: float) -> float:
    """With two digits, not below it."""
    scale = 10.0 ** (math.floor(math.log10(value)) - 1)
    return round(math.ceil(value / scale) * scale, 12)
