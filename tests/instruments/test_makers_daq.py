"""DAQs by their makers' packages: what is asked of the packages, and what they say where the maker's library is
missing.

Nobody here has the hardware.  LabJack's package is real and speaks to a library of ours; of NI's, whose library cannot
be stood in for so easily, every call is held against the signature of the real package.
"""

import ctypes
import inspect
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from sma_actuator.base.parameters import ConfigError
from sma_actuator.config import Config
from sma_actuator.instruments import InstrumentLost, InstrumentRefused, open_daq
from sma_actuator.instruments.clock import MonotonicClock

CHANNELS = {"supply_voltage_channel": 3, "reference_voltage_channel": 1, "load_cell_channel": 2}
VOLTS = {1: 0.1, 2: 1.5, 3: 0.65}


@pytest.fixture
def make_daq(make_config):
    made = []

    def make(package, **changes):
        section = {"package": package, "resource": "Dev1", "timeout": 0.5, **CHANNELS, **changes}
        config = Config.from_mapping(make_config(**{"instruments.daq": section, "loop.samples_per_block": 4}))
        made.append(open_daq(config, MonotonicClock()))
        return made[-1]

    yield make
    for daq in made:
        daq.close()


def reads(daq):
    reading = daq.read_block()
    return reading.supply_voltage_V, reading.reference_voltage_V, reading.load_cell_voltage_V


class LjmLibrary:
    """What of LabJack's library is called; its device has ``volts``."""

    def __init__(self):
        self.limits_ms, self.opened, self.closed, self.lost = {}, "", 0, False

    def LJM_WriteLibraryConfigS(self, name, value):
        self.limits_ms[name] = value.value
        return 0

    def LJM_OpenS(self, device, connection, identifier, handle):
        self.opened = identifier.decode()
        handle._obj.value = 7
        return 1227 if self.opened == "nobody" else 0

    def LJM_GetHandleInfo(self, handle, product, connection, serial, *_):
        assert handle == 7
        product._obj.value, serial._obj.value = 7, 470012345
        return 0

    def LJM_eReadNames(self, handle, count, names, values, error):
        assert handle == 7
        for place in range(count.value):
            volts = VOLTS[int(names[place].removeprefix(b"AIN"))]
            values._obj[place] = volts + 0.01 * (place // len(VOLTS) - 1.5)
        return 1239 if self.lost else 0

    def LJM_Close(self, handle):
        self.closed += 1
        return 0

    def LJM_ErrorToString(self, code, text):
        text.value = b"LJME_RECONNECT_FAILED"


def forget_labjack():
    for name in [name for name in sys.modules if name.partition(".")[0] == "labjack"]:
        del sys.modules[name]


@pytest.fixture
def ljm(monkeypatch):
    forget_labjack()
    pytest.importorskip("labjack", reason="extra 'labjack' is not installed")
    library, load = LjmLibrary(), ctypes.CDLL
    monkeypatch.setattr(
        ctypes, "CDLL", lambda name, *a, **k: library if "LabJackM" in str(name) else load(name, *a, **k)
    )
    yield library
    forget_labjack()


def test_a_labjack_gives_the_mean_of_a_block_by_channel(ljm, make_daq):
    daq = make_daq("labjack", resource="470012345")
    daq.open()
    assert (ljm.opened, daq.identity) == ("470012345", "LabJack T7, serial 470012345")
    assert set(ljm.limits_ms.values()) == {500}
    assert reads(daq) == pytest.approx((VOLTS[3], VOLTS[1], VOLTS[2]))
    daq.close()
    assert ljm.closed == 1


def test_a_labjack_that_is_lost_says_so_and_can_be_opened_again(ljm, make_daq):
    daq = make_daq("labjack")
    daq.open()
    ljm.lost = True
    with pytest.raises(InstrumentLost, match="daq at Dev1: .*1239"):
        daq.read_block()
    with pytest.raises(InstrumentLost, match="not connected"):
        daq.read_block()
    ljm.lost = False
    daq.open()
    assert reads(daq)[1] == pytest.approx(VOLTS[1])
    with pytest.raises(InstrumentLost, match="1227.*LJM library and the extra 'labjack' are wanted"):
        make_daq("labjack", resource="nobody").open()


def test_without_labjacks_library_a_sentence_says_what_is_wanted(make_daq):
    pytest.importorskip("labjack", reason="extra 'labjack' is not installed")
    with pytest.raises(InstrumentLost, match="library cannot be loaded; LabJack's LJM library .* wanted"):
        make_daq("labjack").open()


@pytest.mark.parametrize("package", ("nidaqmx", "labjack"))
def test_without_the_makers_package_a_sentence_says_what_is_wanted(make_daq, monkeypatch, package):
    forget_labjack()
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(
        ConfigError, match=f"instruments.daq.package: {package}.* cannot be imported .*extra '{package}'"
    ):
        make_daq(package)


class NiTask:
    """Holds every call against the signature of NI's package, and remembers it."""

    def __init__(self, nidaqmx, log):
        from nidaqmx.task import InStream, Timing
        from nidaqmx.task.collections import AIChannelCollection

        self._real, self._log = nidaqmx.Task, log
        self.channels = []
        self.ai_channels = SimpleNamespace(
            add_ai_voltage_chan=self._like(AIChannelCollection.add_ai_voltage_chan, self.channels)
        )
        self.timing = SimpleNamespace(cfg_samp_clk_timing=self._like(Timing.cfg_samp_clk_timing, log))
        log.stream = self.in_stream = type("Stream", (), dict.fromkeys(("overwrite", "relative_to", "offset")))()
        assert all(hasattr(InStream, name) for name in ("overwrite", "relative_to", "offset"))

    @staticmethod
    def _like(real, calls):
        def call(*values, **named):
            calls.append(inspect.signature(real).bind(None, *values, **named).arguments)

        return call

    def start(self):
        assert callable(self._real.start)
        self._log.append("start")

    def read(self, *values, **named):
        asked = inspect.signature(self._real.read).bind(None, *values, **named).arguments
        self._log.append(asked)
        if self._log.lost:
            from nidaqmx.errors import DaqReadError

            raise DaqReadError("The device is not present", -201003, 0)
        volts = [VOLTS[int(channel["physical_channel"].removeprefix("Dev1/ai"))] for channel in self.channels]
        noise = np.linspace(-0.01, 0.01, asked["number_of_samples_per_channel"])
        return [(one + noise).tolist() for one in volts]

    def close(self):
        assert callable(self._real.close)
        self._log.append("close")


class Log(list):
    lost = False
    stream = None


@pytest.fixture
def ni(monkeypatch):
    nidaqmx = pytest.importorskip("nidaqmx", reason="extra 'nidaqmx' is not installed")
    log = Log()
    stand_in = SimpleNamespace(
        Task=lambda: NiTask(nidaqmx, log),
        system=SimpleNamespace(Device=lambda name: SimpleNamespace(product_type="USB-6211")),
    )
    monkeypatch.setitem(sys.modules, "nidaqmx", stand_in)
    return log


def test_ni_samples_by_its_own_clock_and_the_newest_block_is_read(ni, make_daq):
    daq = make_daq("nidaqmx")
    daq.open()
    assert daq.identity == "USB-6211"
    timing, *rest = ni
    assert timing["rate"] == 1000.0 and timing["sample_mode"].name == "CONTINUOUS"
    assert rest[0] == "start" and rest[1]["number_of_samples_per_channel"] == 4
    assert (ni.stream.overwrite.name, ni.stream.relative_to.name) == ("OVERWRITE_UNREAD_SAMPLES", "MOST_RECENT_SAMPLE")
    assert ni.stream.offset == -4
    assert reads(daq) == pytest.approx((VOLTS[3], VOLTS[1], VOLTS[2]))
    assert ni[-1]["timeout"] == 0.5
    daq.close()
    assert ni[-1] == "close"


def test_an_ni_device_that_is_lost_says_so(ni, make_daq):
    daq = make_daq("nidaqmx")
    daq.open()
    ni.lost = True
    with pytest.raises(InstrumentLost, match="daq at Dev1: The device is not present"):
        daq.read_block()
    assert ni[-1] == "close"


def test_without_ni_daqmx_a_sentence_says_how_to_get_it(make_daq):
    pytest.importorskip("nidaqmx", reason="extra 'nidaqmx' is not installed")
    with pytest.raises(InstrumentLost, match="nidaqmx installdriver"):
        make_daq("nidaqmx").open()


def test_one_program_alone_samples_with_a_device(ni, make_daq):
    make_daq("nidaqmx").open()
    with pytest.raises(InstrumentRefused, match="another part of this one, samples with it"):
        make_daq("nidaqmx").open()


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"load_cell_channel": 0}, "cannot do without that channel"),
        ({"ambient_temperature_channel": 5}, "reads every channel in volts"),
        ({"resource": ""}, "instruments.daq.resource: is empty"),
    ],
)
def test_channels_that_will_not_do_are_refused(ni, make_daq, changes, sentence):
    with pytest.raises(InstrumentRefused, match=sentence):
        make_daq("nidaqmx", **changes).open()


def test_a_package_that_nobody_knows_is_refused_with_the_parameters(make_daq):
    with pytest.raises(ConfigError, match=r"instruments\.daq\.package: .*nidaqmx.*labjack"):
        make_daq("daqmx")
