"""DAQs without a command language of their own: their makers' Python packages speak to them.

Both packages want a library of the maker's beside them, which no package registry has.  Neither has been tried on the
hardware: what is known of them is their documentation, and that the calls below fit the packages.
"""

from __future__ import annotations

import contextlib
import importlib
import math
from abc import ABC, abstractmethod
from collections.abc import Iterator
from typing import Any

import numpy as np

from sma_actuator.base.parameters import ConfigError
from sma_actuator.base.signals import Reading

from . import Clock, InstrumentLost, InstrumentRefused
from .channels import Channels
from .claim import Claim
from .parameters import InstrumentSections

RANGE_V = 10.0  #: of a converter of NI's; a LabJack's is this when it is switched on


class MakersDaq(ABC):
    """A DAQ behind the interface :class:`sma_actuator.instruments.Daq`, by a package of its maker's."""

    package = ""  #: to be imported
    install = ""  #: what has to be done for it

    def __init__(self, config: InstrumentSections, clock: Clock):
        self._resource = config.instruments.daq.resource
        self._timeout_s = config.instruments.daq.timeout
        self._loop = config.loop
        self._clock = clock
        self._channels = Channels(config.instruments.daq)
        self._claim: Claim | None = None
        self._device: Any = None
        self.patience_s = 0.0  #: of no use here: what a package waits for in vain is gone
        self.identity = ""
        try:
            self._maker = importlib.import_module(self.package)
        except Exception as error:  # a library of the maker's that is missing raises what the package likes
            raise ConfigError(
                f"instruments.daq.package: {self.package} cannot be imported ({error}); {self.install}"
            ) from error

    @property
    def _name(self) -> str:
        return f"daq at {self._resource}"

    def open(self) -> None:
        """Connect and begin to sample.  Raises InstrumentLost or InstrumentRefused."""
        self._channels.check(f"instruments.daq.package {self.package}", measures_celsius=False)
        if not self._resource:
            raise InstrumentRefused(f"instruments.daq.resource: is empty; {self.install}")
        self._let_go()
        if self._claim is None:
            try:
                self._claim = Claim(f"{self.package} {self._resource}")
            except OSError as error:
                raise InstrumentRefused(
                    f"{self._name}: another program on this computer, or another part of this one, samples with it"
                ) from error
        with self._errors_named(f"; {self.install}"):
            self._connect()

    def read_block(self) -> Reading:
        """The mean of the newest block; NaN for channels that are not configured."""
        if self._device is None:
            raise InstrumentLost(f"{self._name}: not connected")
        with self._errors_named():
            samples = self._block()
        return self._channels.reading(self._clock.now_s(), samples.mean(axis=0).tolist())

    def close(self) -> None:
        """Give it back.  Never raises."""
        self._let_go()
        if self._claim is not None:
            self._claim.release()
            self._claim = None

    def _let_go(self) -> None:
        device, self._device = self._device, None
        if device is not None:
            with contextlib.suppress(Exception):  # nothing depends on a device that is given up
                self._disconnect(device)

    @contextlib.contextmanager
    def _errors_named(self, advice: str = "") -> Iterator[None]:
        try:
            yield
        except Exception as error:  # each package raises its own
            self._let_go()
            raise InstrumentLost(f"{self._name}: {' '.join(str(error).split())}{advice}") from error

    @abstractmethod
    def _connect(self) -> None:
        """Set ``_device`` and ``identity``, and begin to sample."""

    @abstractmethod
    def _block(self) -> np.ndarray:
        """The newest block, (samples, channels) [V], within the time-out."""

    @abstractmethod
    def _disconnect(self, device: Any) -> None:
        """Let go of it."""


class NationalInstruments(MakersDaq):
    """A device of NI-DAQmx, sampled by its own clock; channel n is ``ain``.

    https://nidaqmx-python.readthedocs.io; NI-DAQmx Help, "Reading Samples: Relative To and Offset".
    """

    package = "nidaqmx"
    install = (
        "NI-DAQmx and the extra 'nidaqmx' are wanted (`nidaqmx installdriver` fetches the driver), and the name that "
        "NI MAX gives the device, as Dev1"
    )

    def _connect(self) -> None:
        constants = importlib.import_module("nidaqmx.constants")
        samples, rate_Hz = self._loop.samples_per_block, self._loop.sample_rate
        self.identity = str(self._maker.system.Device(self._resource).product_type)
        self._device = task = self._maker.Task()
        for number in self._channels.numbers:
            task.ai_channels.add_ai_voltage_chan(f"{self._resource}/ai{number}", min_val=-RANGE_V, max_val=RANGE_V)
        task.timing.cfg_samp_clk_timing(
            rate_Hz, sample_mode=constants.AcquisitionType.CONTINUOUS, samps_per_chan=max(10 * samples, 1000)
        )
        task.in_stream.overwrite = constants.OverwriteMode.OVERWRITE_UNREAD_SAMPLES
        task.start()
        task.read(samples, timeout=self._timeout_s + samples / rate_Hz)  # until there is a block to look back at
        task.in_stream.relative_to = constants.ReadRelativeTo.MOST_RECENT_SAMPLE
        task.in_stream.offset = -samples

    def _block(self) -> np.ndarray:
        return np.array(self._device.read(self._loop.samples_per_block, timeout=self._timeout_s)).T

    def _disconnect(self, device: Any) -> None:
        device.close()


class LabJack(MakersDaq):
    """A LabJack T4, T7 or T8, asked for as many readings as a block has; channel n is ``AINn``.

    https://support.labjack.com/docs/ljm-library-users-guide (eReadNames, library configuration).
    """

    package = "labjack.ljm"
    install = "LabJack's LJM library and the extra 'labjack' are wanted, and the device's serial number, address or ANY"

    def _connect(self) -> None:
        limit_ms = math.ceil(1e3 * self._timeout_s)
        try:
            for what in ("LJM_SEND_RECEIVE_TIMEOUT_MS", "LJM_OPEN_TCP_DEVICE_TIMEOUT_MS"):
                self._maker.writeLibraryConfigS(what, limit_ms)
        except AttributeError as error:  # the package prints so when it is imported, and goes on without it
            raise RuntimeError("LabJack's library cannot be loaded") from error
        self._device = self._maker.openS("ANY", "ANY", self._resource)
        product, _, serial, *_ = self._maker.getHandleInfo(self._device)
        self.identity = f"LabJack T{product}, serial {serial}"

    def _block(self) -> np.ndarray:
        names = [f"AIN{number}" for number in self._channels.numbers] * self._loop.samples_per_block
        values = self._maker.eReadNames(self._device, len(names), names)
        return np.reshape(values, (self._loop.samples_per_block, -1))

    def _disconnect(self, device: Any) -> None:
        self._maker.close(device)


#: By the names that ``instruments.daq.package`` knows.
PACKAGES: dict[str, type[MakersDaq]] = {"nidaqmx": NationalInstruments, "labjack": LabJack}
