"""What slow instruments want is said, and is enough; quick ones want nothing."""

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from sma_actuator.base.share import shared_file
from sma_actuator.bench import InProcessDaq, InProcessSupply, VirtualBench, VirtualClock
from sma_actuator.check import SelfTest
from sma_actuator.check.command import PATIENCE_s, with_patience
from sma_actuator.check.found import Level
from sma_actuator.check.pace import Pace
from sma_actuator.config import bench_from_mapping, read_parameter_file
from sma_actuator.driver import CHECK_PERIOD_s
from sma_actuator.instruments import InstrumentLost

MAPPING = read_parameter_file(shared_file("config/flexinol_bench.yaml"))
BENCH = bench_from_mapping(MAPPING)


def with_written(mapping, wanted):
    """The parameters with what was to be written."""
    changed = yaml.safe_load(yaml.safe_dump(mapping))
    for name, value in wanted.items():
        *sections, last = name.split(".")
        inside = changed
        for section in sections:
            inside = inside.setdefault(section, {})
        inside[last] = value
    return changed


@given(st.floats(1e-3, 0.3), st.floats(1e-3, 0.4), st.floats(1e-4, 0.08), st.floats(1.0, 1.9))
def test_what_is_to_be_written_is_valid_and_lets_such_instruments_do(supply_s, daq_s, setting_s, slowest):
    pace = Pace.of(
        [(supply_s, daq_s, setting_s)] * 8 + [(slowest * supply_s, slowest * daq_s, slowest * setting_s)], BENCH
    )
    if not pace.too_slow:
        assert supply_s + daq_s + setting_s <= 1.0 / BENCH.loop.rate
        return
    config = bench_from_mapping(with_written(MAPPING, pace.wanted))  # refuses what does not fit together
    share = config.loop.samples_per_block / BENCH.loop.samples_per_block
    for of_block in (1.0, share):  # the DAQ's time may be its latency, or its block's
        steps = [(supply_s, of_block * daq_s, setting_s)] * 8
        steps += [(slowest * supply_s, slowest * of_block * daq_s, slowest * setting_s)]
        again = Pace.of(steps, config)
        assert not again.too_slow and not again.is_tight


def test_a_quick_pair_with_one_slow_answer_keeps_its_rate_and_gets_a_longer_time_out():
    pace = Pace.of([(0.01, 0.02, 0.002)] * 9 + [(0.3, 0.02, 0.002)], BENCH)
    assert "loop.rate" not in pace.wanted and "loop.samples_per_block" not in pace.wanted
    assert pace.wanted["instruments.supply.timeout"] == pytest.approx(0.6)


@pytest.mark.parametrize(("setting_s", "rate_Hz"), [(0.01, 1.2), (0.15, 1.0)])
def test_the_looks_at_the_supplys_settings_that_are_due_in_a_step_have_their_time(setting_s, rate_Hz):
    """Of an OWON SPE, which takes 0.15 s for each, two are due in a step: at 1.3 Hz every step came too late."""
    pace = Pace.of([(0.575, 0.03, setting_s)] * 10, BENCH)
    assert pace.wanted["loop.rate"] == rate_Hz
    assert 0.605 + 2 * setting_s <= 1.0 / rate_Hz <= 2 * CHECK_PERIOD_s


def test_a_daq_that_is_slow_by_its_long_blocks_gets_shorter_ones_and_then_a_higher_rate():
    pace = Pace.of([(0.01, 0.6, 0.002)] * 10, BENCH)
    config = bench_from_mapping(with_written(MAPPING, pace.wanted))
    share = config.loop.samples_per_block / BENCH.loop.samples_per_block
    assert share < 0.1
    again = Pace.of([(0.01, share * 0.6, 0.002)] * 10, config)
    assert again.most_Hz > 0.9 * BENCH.loop.rate > 5.0 * config.loop.rate
    assert again.could_be_twice_as_quick
    _, _, written = again.sentence.partition("; write loop.rate: ")
    quicker = bench_from_mapping(with_written(MAPPING, {"loop.rate": float(written.partition(",")[0])}))
    last = Pace.of([(0.01, share * 0.6, 0.002)] * 10, quicker)
    assert not last.too_slow and not last.is_tight and not last.could_be_twice_as_quick


def test_of_instruments_slower_than_their_time_outs_check_says_what_to_write_and_then_they_pass():
    """In the bench's own time, where an answer takes exactly so long."""
    timeout_s = 0.1  # else the lowest rate would be too quick for read-back, settings and block
    mapping = with_written(MAPPING, {"supply.watchdog_timeout": 0.0, "supply.allow_no_watchdog": True})
    mapping = with_written(mapping, {f"instruments.{name}.timeout": timeout_s for name in ("supply", "daq")})
    delay_s = 1.2 * timeout_s
    for level in (Level.WRONG, Level.OK):
        config = bench_from_mapping(mapping)
        bench = VirtualBench.from_name("flexinol")
        bench.advance(0.2)
        bench.inject("slow_answers", delay_s)
        patient = with_patience(config)
        test = SelfTest(config, InProcessSupply(bench, patient), InProcessDaq(bench, patient), VirtualClock(bench))
        (*_, said) = (each for each in test.run() if each.part == "speed")
        assert said.level is level, said.sentence
        assert not bench.supply.output_on
        _, _, written = said.sentence.partition("; write ")
        pairs = (pair.split(": ") for pair in written.split(", ") if pair)
        mapping = with_written(mapping, {name: yaml.safe_load(value) for name, value in pairs})
    assert mapping["instruments"]["supply"]["timeout"] > delay_s and mapping["loop"]["rate"] < BENCH.loop.rate


@pytest.mark.parametrize("of_reading_s", [0.02, 0.2], ids=["it comes", "it does not come in time"])
def test_a_daq_that_cannot_read_such_a_block_is_told_to_read_one_and_then_what_a_step_takes(of_reading_s):
    """As a multiplexer with the block that init leaves to it: 50 readings of each channel took 10 s, and all that was
    said was that no answer came."""

    class Multiplexer(InProcessDaq):
        def read_block(self):
            took_s = of_reading_s * 4 * config.loop.samples_per_block
            clock.sleep_until_s(clock.now_s() + min(took_s, PATIENCE_s))
            if took_s > PATIENCE_s:
                raise InstrumentLost("no complete answer to 'READ?' within 5 s")
            return super().read_block()

    mapping = MAPPING
    for wanted in ("loop.samples_per_block: 1", "loop.rate: "):
        config = bench_from_mapping(mapping)
        bench = VirtualBench.from_name("flexinol")
        bench.advance(0.2)
        bench.inject("slow_answers", 0.01)
        clock, patient = VirtualClock(bench), with_patience(config)
        test = SelfTest(config, InProcessSupply(bench, patient), Multiplexer(bench, patient), clock)
        (*_, said) = (each for each in test.run() if each.level is Level.WRONG)
        assert said.part == "speed" and wanted in said.sentence, said.sentence
        assert wanted == "loop.rate: " or "timeout" not in said.sentence  # which a block of one wants shorter
        assert not bench.supply.output_on
        mapping = with_written(mapping, {"loop.samples_per_block": 1})


def test_what_a_step_takes_with_one_reading_is_said_at_once_where_the_daq_can_be_opened_anew():
    """A multiplexer wanted three checks: one said the block, one the rate, and one that all was well."""

    class Multiplexer(InProcessDaq):
        def __init__(self, bench, config):
            super().__init__(bench, config)
            self.took_s = 0.02 * 4 * config.loop.samples_per_block

        def read_block(self):
            clock.sleep_until_s(clock.now_s() + self.took_s)
            return super().read_block()

    mapping, levels = MAPPING, []
    for _ in range(2):
        config = bench_from_mapping(mapping)
        bench = VirtualBench.from_name("flexinol")
        bench.advance(0.2)
        bench.inject("slow_answers", 0.01)
        clock, patient = VirtualClock(bench), with_patience(config)
        daq = Multiplexer(bench, patient)
        test = SelfTest(
            config, InProcessSupply(bench, patient), daq, clock, lambda other, bench=bench: Multiplexer(bench, other)
        )
        (*_, said) = (each for each in test.run() if each.part == "speed")
        levels.append(said.level)
        _, _, written = said.sentence.partition("; write ")
        pairs = (pair.split(": ") for pair in written.split(", ") if pair)
        mapping = with_written(mapping, {name: yaml.safe_load(value) for name, value in pairs})
    assert levels == [Level.WRONG, Level.OK] and mapping["loop"]["samples_per_block"] == 1
