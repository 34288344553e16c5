"""The self-test: a wire that is wired as its parameters say passes, each wiring mistake gets its own sentence."""

import json
import math
import re
import shlex
from dataclasses import replace

import pytest

from sma_actuator.base.calibration import Calibration
from sma_actuator.base.share import shared_file
from sma_actuator.bench import InProcessDaq, InProcessSupply, VirtualClock, Weight
from sma_actuator.bench.bench import Setup, VirtualBench
from sma_actuator.check import SelfTest, passed
from sma_actuator.check.found import Level
from sma_actuator.check.probe import Probe
from sma_actuator.cli.main import main
from sma_actuator.config import Config, bench_from_mapping, read_parameter_file, write_parameter_file
from sma_actuator.instruments import InstrumentLost
from sma_actuator.plant.worlds import wire_in_world
from sma_actuator.safety.thermal import HEADROOM_K


class Stand:
    """A virtual bench, and the self-test on it; ``mistake(stand)`` makes one."""

    def __init__(self, mistake=lambda stand: None, wire="flexinol", load_N=0.98):
        self.config = Config.load(shared_file(f"config/{wire}.yaml"))
        self.setup = Setup(wire_in_world(wire), load=Weight(load_N))
        self.faults = {}
        self.after_opening = lambda bench: None
        self.stands_still_s = 0.0  # this computer, while current flows
        self.reads_back = InProcessSupply.reads_back
        mistake(self)
        self.bench = VirtualBench(self.setup, seed=3)
        self.bench.advance(0.2)
        for name, value in self.faults.items():
            self.bench.inject(name, value)
        supply = InProcessSupply(self.bench, self.config)
        genuine, self.most_A = supply.set_current, 0.0

        def set_current(current_A):
            genuine(current_A)
            if current_A > self.most_A > 0.0:  # more than the bias
                self.bench.advance(self.bench.time_s + self.stands_still_s)
            self.most_A = max(self.most_A, current_A)

        supply.set_current = set_current
        supply.reads_back = self.reads_back
        opened = supply.open
        supply.open = lambda: (opened(), self.after_opening(self.bench))
        self.test = SelfTest(self.config, supply, InProcessDaq(self.bench, self.config), VirtualClock(self.bench))
        self.found = self.test.run()
        self.wrong = [each.sentence for each in self.found if each.level is Level.WRONG]

    def chain(self, **values):
        self.setup = replace(self.setup, chain=replace(self.setup.chain, **values))

    def change(self, **values):
        self.config = self.config.replace({name.replace("__", "."): value for name, value in values.items()})


def swapped_channels(stand):
    stand.change(instruments__daq__supply_voltage_channel=102, instruments__daq__reference_voltage_channel=101)


def swapped_with_the_load_cell(name):
    return lambda stand: stand.change(
        **{
            f"instruments__daq__{name}_channel": 103,
            "instruments__daq__load_cell_channel": getattr(stand.config.instruments.daq, f"{name}_channel"),
        }
    )


def longer_wire(stand):
    wire = stand.setup.wire
    stand.setup = replace(stand.setup, wire=replace(wire, length_m=2.0 * wire.length_m))


#: mistake → words that no other has.
MISTAKES = {
    "supply and sense resistor swapped": (swapped_channels, ("channels of supply voltage and sense resistor are "
                                                            "swapped")),
    "sense resistor and load cell swapped": (
        swapped_with_the_load_cell("reference_voltage"),
        "sense resistor reads 81.7 mV with the output off, no zero error",
    ),
    "supply voltage and load cell swapped": (
        swapped_with_the_load_cell("supply_voltage"),
        "supply voltage reads 81.7 mV with the output off, no zero error",
    ),
    "load cell reversed": (lambda s: s.faults.update(channel_reversed=103), "a wire cannot push"),
    "sense resistor reversed": (lambda s: s.faults.update(channel_reversed=102), ("the taps of the sense resistor are "
                                                                                 "swapped")),
    "supply voltage reversed": (lambda s: s.faults.update(channel_reversed=101), "the supply voltage reads backwards"),
    "another sense resistor": (lambda s: s.chain(reference_resistance_Ohm=0.5), "so it has 0.5 Ω"),
    "a sense resistor of the next decade": (lambda s: s.chain(reference_resistance_Ohm=0.1), "so it has 0.1"),
    "sense resistor's taps off": (lambda s: s.chain(reference_resistance_Ohm=0.0), "its taps are off"),
    "longer leads": (lambda s: s.chain(lead_resistance_Ohm=0.55), "the leads have other than circuit.lead_resistance"),
    "no wire": (lambda s: s.faults.update(open_wire=float("nan")), "the circuit is open"),
    "bridged wire": (lambda s: s.faults.update(short_wire=0.2), "something bridges the wire"),
    "another wire": (longer_wire, "is wire.length that between the crimps"),
    "load cell not connected": (lambda s: s.faults.update(channel_stuck=103), "the channel of the load cell reads"),
    "sense resistor over range": (lambda s: s.faults.update(channel_saturated=102), "sense resistor reads 9.9e+37 V"),
    "supply delivers something else": (lambda s: s.faults.update(current_disagrees=0.5), "says that it delivers 25 mA"),
    "watchdog does not cut": (lambda s: s.faults.update(watchdog_dead=1.0), "the watchdog did not cut within"),
    "watchdog is not armed": (lambda s: s.faults.update(watchdog_dead=0.0), ("watchdog was armed and does not read "
                                                                             "back "
                                                                            "so")),
    "limits set by somebody": (
        lambda s: setattr(s, "after_opening", lambda bench: bench.supply.set_ocp(1.0)),
        "does not hold its limits",
    ),
    "too much load": (lambda s: setattr(s, "setup", replace(s.setup, load=Weight(4.0))), ("more than wire.max_stress "
                                                                                         "allows")),
    "noisy channel": (
        lambda s: s.chain(noise_V=(1.5e-4, 0.05, 2e-4, 1.5e-4, 0.02)),
        "screen and ground it",
    ),
}  # fmt: skip


@pytest.mark.parametrize("wire", ["flexinol", "furukawa"])
def test_a_wire_that_is_as_its_parameters_say_passes(wire):
    stand = Stand(wire=wire)
    assert passed(stand.found), stand.wrong
    parts = [each.part for each in stand.found if each.level is Level.OK]
    assert parts == [
        "identity", "trips", "rate", "noise", "load cell", "bias", "resistance", "leads", "linearity", "heat",
        "watchdog", "output",
    ]  # fmt: skip
    (watchdog,) = [each.sentence for each in stand.found if each.part == "watchdog"]
    assert "read back as WDOG, cleared with the output off" in watchdog
    assert stand.most_A <= 2.0 * stand.config.supply.bias_current


@pytest.mark.parametrize(("mistake", "sentence"), MISTAKES.values(), ids=MISTAKES)
def test_each_mistake_gets_its_own_sentence_and_the_output_is_off_afterwards(mistake, sentence):
    stand = Stand(mistake)
    assert not passed(stand.found)
    assert sentence in " / ".join(stand.wrong)
    others = [words for _, words in MISTAKES.values() if words != sentence]
    assert not [words for words in others if words in " / ".join(stand.wrong)]
    assert stand.test.off_confirmed
    assert not stand.bench.supply.output_on
    assert stand.bench.supply.current_A == 0.0


def test_a_computer_that_stands_still_while_current_flows_is_no_bad_contact():
    stand = Stand(lambda stand: setattr(stand, "stands_still_s", 1.5))
    (sentence,) = stand.wrong
    assert "this computer stood still for longer than supply.watchdog_timeout, 1 s" in sentence
    assert [each.part for each in stand.found[-2:]] == ["watchdog", "output"], "nothing is concluded from no current"
    assert stand.test.off_confirmed


def during_more_current(config, happens):
    """What the self-test finds where ``happens(supply)`` does, once, as soon as more than the bias current is told."""
    bench = VirtualBench(Setup(wire_in_world("flexinol"), load=Weight(0.98)), seed=3)
    bench.advance(0.2)
    supply = InProcessSupply(bench, config)
    genuine, over = supply.set_current, []

    def set_current(current_A):
        if current_A > config.supply.bias_current and not over:
            over.append(current_A)
            return happens(supply)
        return genuine(current_A)

    supply.set_current = set_current
    test = SelfTest(config, supply, InProcessDaq(bench, config), VirtualClock(bench))
    return [each.sentence for each in test.run() if each.level is Level.WRONG]


def test_of_an_instrument_that_is_lost_while_more_flows_the_first_reason_is_said():
    """The bias current is told again afterwards; that this cannot be told is no reason."""

    def lost(supply):
        def not_connected(_):
            raise InstrumentLost("not connected")

        supply.set_current = not_connected
        raise InstrumentLost("no answer within 0.6 s")

    wrong = during_more_current(Config.load(shared_file("config/flexinol.yaml")), lost)
    assert wrong == ["no answer within 0.6 s"]


def test_an_output_that_goes_off_while_more_flows_is_no_zero_error_of_a_channel():
    wrong = during_more_current(
        Config.load(shared_file("config/flexinol.yaml")), lambda supply: supply.set_output(False)
    )
    assert len(wrong) == 1 and "the output went off by itself" in wrong[0]


def test_a_wire_without_a_model_is_looked_at_too_before_it_is_heated(tmp_path, capsys):
    mapping = read_parameter_file(shared_file("config/flexinol_bench.yaml"))
    del mapping["load_cell"]
    path = tmp_path / "bench.yaml"
    write_parameter_file(path, mapping, "as init writes it")
    words = ["check", "--config", str(path), "--virtual", "flexinol", "--json", str(tmp_path / "found.json")]
    assert main(words) == 0
    found = {each["part"]: each for each in json.loads((tmp_path / "found.json").read_text())}
    assert {part for part, each in found.items() if each["level"] == "warning"} == {"load cell", "leads"}
    assert "`sma-actuator characterise` makes it" in found["load cell"]["sentence"]
    next_ = f"next: measure the wire: sma-actuator characterise --config {shlex.quote(str(path))}"
    assert next_ in capsys.readouterr().err
    mapping["instruments"]["daq"]["lvdt_channel"] = 0
    write_parameter_file(path, mapping, "without a displacement sensor")
    assert main([*words, "--force"]) == 0
    said = capsys.readouterr()
    assert re.search("look +displacement +not measured: instruments.daq.lvdt_channel is 0", said.out)
    assert "next: identify a model from logs" in said.err
    del mapping["circuit"]["reference_resistance"]
    write_parameter_file(path, mapping, "without a sense resistor")
    assert main([*words, "--force"]) == 1
    assert "circuit.reference_resistance: missing" in capsys.readouterr().err


def test_a_load_cell_whose_digits_are_coarse_would_be_taken_for_stuck():
    """A converter of 16 bits, ±10 V, of which one sample is read, as a DAQ without memory does."""

    def coarse(stand):
        stand.chain(noise_V=(1.5e-4,) * 4 + (0.02,))
        stand.change(loop__samples_per_block=1, loop__rate=5.0, safety__reading_timeout=3.0)

    stand = Stand(coarse)
    assert passed(stand.found), stand.wrong
    (said,) = [each for each in stand.found if each.part == "digits"]
    assert said.level is Level.WARNING
    said_s = re.search("taken for stuck after safety.stuck_time, 2 s: write safety.stuck_time: (.*?),", said.sentence)[
        1
    ]
    stand = Stand(lambda stand: (coarse(stand), stand.change(safety__stuck_time=float(said_s))))
    assert "digits" not in [each.part for each in stand.found]


def test_in_a_slow_loop_a_few_readings_of_the_sense_resistor_that_are_alike_would_be_taken_for_stuck():
    """A multimeter's noise is a digit or two: at a few readings a second as many alike in a row last for seconds."""

    def slow(stand):
        stand.chain(noise_V=(2e-3, 4e-4, 3e-3, 1.5e-4, 0.02))  # of steps of 0.3 mV
        stand.change(
            loop__samples_per_block=1, loop__rate=4.0, safety__reading_timeout=3.0, supply__watchdog_timeout=2.0
        )

    stand = Stand(slow)
    assert passed(stand.found), stand.wrong
    (said,) = [each for each in stand.found if each.part == "digits"]
    assert said.level is Level.WARNING and "of the readings of the sense resistor are like another" in said.sentence
    said_s = float(re.search("write safety.stuck_time: (.*?),", said.sentence)[1])
    assert 2.0 < said_s <= 8.0, "of 10 to 40 % by chance, once in a million million readings"


def test_gains_of_a_quicker_loop_are_named_with_those_of_this_one():
    """Where loop.rate is lowered in the file that init wrote, as `check` says, kp stays that of 20 Hz."""
    stand = Stand(
        lambda stand: stand.change(
            loop__rate=2.5, safety__reading_timeout=3.0, supply__watchdog_timeout=1.0, controller__kp=400.0
        )
    )
    (said,) = [each for each in stand.found if each.part == "gains"]
    assert said.level is Level.WARNING
    kp, ki = map(float, re.search("write controller.kp: (.*), controller.ki: (.*)", said.sentence).groups())
    assert ki > 0.0 and kp < 300.0
    chosen = Stand(
        lambda stand: stand.change(
            loop__rate=2.5, safety__reading_timeout=3.0, supply__watchdog_timeout=1.0, controller__kp=kp
        )
    )
    assert "gains" not in [each.part for each in chosen.found]


def test_leads_that_nobody_has_measured_may_have_some_resistance():
    """60 mm of 0.2 mm Ni-Ti-Cu have 2.1 Ohm: with 0.31 Ohm of leads `check` called a new bench wrong, and
    `characterise`, which measures leads, did not begin."""

    def new(stand, leads_Ohm):
        stand.chain(lead_resistance_Ohm=leads_Ohm)
        stand.change(circuit__lead_resistance=0.0)
        stand.config = replace(stand.config, calibration=Calibration())

    stand = Stand(lambda stand: new(stand, 0.4), wire="furukawa")
    assert passed(stand.found), stand.wrong
    (said,) = [each for each in stand.found if each.part == "leads"]
    assert said.level is Level.WARNING and "not measured yet" in said.sentence
    too_long = Stand(lambda stand: new(stand, 0.9), wire="furukawa")
    assert "is wire.length that between the crimps" in too_long.wrong[0]


@pytest.mark.parametrize("load_N", [0.98, 3.0, 4.4])
def test_a_cold_wire_under_a_heavy_load_is_longer_and_thinner(load_N):
    """60 mm of Ni-Ti-Cu have 2.24 Ohm under 3 N; `check` took 2.2 for the most, and called the right wire wrong."""
    stand = Stand(wire="furukawa", load_N=load_N)
    assert passed(stand.found), stand.wrong


class CountedClock(VirtualClock):
    """Time of a bench, of somebody who does not wait for ever."""

    sleeps = 0

    def sleep_until_s(self, deadline_s):
        self.sleeps += 1
        assert self.sleeps < 100
        super().sleep_until_s(deadline_s)


@pytest.mark.parametrize("rate_Hz", [3.5, 7.0, 20.0])
def test_a_wait_ends_where_a_period_is_no_whole_number_of_the_clocks_steps(rate_Hz):
    stand = Stand(lambda stand: stand.change(safety__reading_timeout=2.0, loop__rate=rate_Hz))
    clock = CountedClock(stand.bench)
    began_s = clock.now_s()
    supply, daq = InProcessSupply(stand.bench, stand.config), InProcessDaq(stand.bench, stand.config)
    Probe(stand.config, supply, daq, clock).wait(2.0 / rate_Hz)
    assert clock.now_s() - began_s == pytest.approx(2.0 / rate_Hz, abs=1e-3)


def test_without_a_load_the_sign_of_the_load_cell_is_not_told():
    stand = Stand(load_N=0.0)
    (said,) = [each for each in stand.found if each.part == "load cell"]
    assert said.level is Level.WARNING
    assert "hang something on the wire" in said.sentence


def test_of_a_supply_that_does_not_tell_what_tripped_nothing_is_said_that_was_not_read():
    """As a Keysight N6700: after its watchdog has cut, OUTP? still answers 1, and nothing names the trip."""

    def taciturn(stand):
        stand.reads_back = frozenset({"voltage_setting"})
        stand.after_opening = say_less

    def say_less(bench):
        cut = bench.supply.trip
        bench.supply.trip = lambda name: (cut(name), bench.supply.trips.clear())

    stand = Stand(taciturn)
    said = {each.part: each.sentence for each in stand.found}
    assert passed(stand.found), stand.wrong
    assert "of silence, which this supply does not say, cleared with the output off" in said["watchdog"]
    assert said["trips"].startswith("compliance voltage 4 V read back as programmed")
    assert said["trips"].endswith("this supply has no over-current trip that can be read back")


def test_a_trip_that_lets_the_wire_burn_is_said_with_what_it_survives():
    def careless(stand):
        supply = replace(stand.config.supply, max_current=1.0, over_current_trip=1.1)
        stand.config = replace(stand.config, supply=supply)

    (trips,) = [each for each in Stand(careless).found if each.part == "trips"]
    assert trips.level is Level.WARNING
    # 1.1² A² · 4.93 Ω over 0.00503 W/K of still air is 1 190 K above it, and 171 K are 0.417 A.
    assert "1.1 A for ever heats this wire to 121" in trips.sentence
    assert "; 0.417 A is what it survives" in trips.sentence


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"supply__watchdog_timeout": 0.0, "supply__allow_no_watchdog": True}, "unwatched_margin below 3"),
        ({"thermal__heat_capacity": 3e-4, "thermal__heat_loss": 4e-3}, "heat_loss_margin below 3"),
    ],
    ids=["no watchdog", "quick"],
)
def test_it_says_to_what_temperature_the_limit_of_current_lets_the_wire_come(change, named):
    """One that needs 100 °C was held at 82 by a supply without a watchdog, 50 µm at 87 by any: nobody had said so."""
    stand = Stand(lambda s: s.change(**change))
    (said,) = [each for each in stand.found if each.part == "heat"]
    thermal = stand.config.thermal
    rise_K = (thermal.max_temperature - HEADROOM_K - thermal.ambient_temperature) / 3.0
    assert said.level is Level.WARNING and passed(stand.found)
    comes_C = float(re.search(r"comes to (\d+) °C", said.sentence)[1])
    assert comes_C == pytest.approx(thermal.ambient_temperature + rise_K, abs=3.0)
    assert f"a thermal.{named}" in said.sentence
    assert ("looked at more often" in said.sentence) == (named != "unwatched_margin below 3"), "what holds for ever"


def test_of_a_usual_wire_behind_a_watchdog_it_says_that_it_will_contract():
    (said,) = [each for each in Stand().found if each.part == "heat"]
    assert said.level is Level.OK


def test_it_names_no_more_current_than_may_flow():
    """Of a wire that is let come to 208 °C it said 456 mA, at a max_current of 400 and a trip at 450."""
    stand = Stand(lambda stand: stand.change(supply__max_current=0.2))
    (said,) = [each for each in stand.found if each.part == "heat"]
    assert said.sentence.startswith("no more than 200 mA flow, of which the wire comes to ")
    assert said.sentence.endswith(" °C by thermal.heat_loss (supply.max_current)")


def test_of_a_supply_that_was_never_opened_nobody_says_that_it_read_back_off():
    stand = Stand(lambda stand: stand.faults.update(supply_silent=1.0))
    assert not stand.test.off_confirmed
    assert "not confirmed to be off, since the supply was not opened: unless another program" in stand.wrong[-1]


def self_test(stand, supply):
    """The self-test of a stand with a supply that is otherwise."""
    return SelfTest(stand.config, supply, InProcessDaq(stand.bench, stand.config), VirtualClock(stand.bench))


def opened_again(change=lambda supply, daq: None):
    """What the test says at the end, of instruments that are opened once more as the node opens them; and itself."""
    stand = Stand()
    supply, daq = InProcessSupply(stand.bench, stand.config), InProcessDaq(stand.bench, stand.config)
    change(supply, daq)
    test = self_test(stand, InProcessSupply(stand.bench, stand.config))
    test.as_written = lambda: (supply, daq)
    return {each.part: each for each in test.run()[-2:]}, test, stand


def test_that_the_node_can_open_both_is_said_last_but_that_the_output_is_off():
    found, test, stand = opened_again()
    assert found["opening"].level is Level.OK and found["output"].level is Level.OK
    assert test.off_confirmed and not stand.bench.supply.output_on


def test_a_board_that_hears_nothing_in_time_after_its_line_is_opened_is_found_before_the_node_waits_for_it():
    """An Arduino began anew each time, which the patience of the test hid: it passed, and the node waited for ever."""

    def deaf():
        raise InstrumentLost("daq at ASRL/dev/ttyACM0: no complete answer to '?' within 0.2 s")

    found, test, stand = opened_again(lambda supply, daq: setattr(daq, "open", deaf))
    assert (
        found["opening"].level is Level.WRONG and "no complete answer to '?' within 0.2 s" in found["opening"].sentence
    )
    assert found["output"].level is Level.OK and test.off_confirmed and not stand.bench.supply.output_on


def test_what_opening_again_leaves_on_is_not_said_to_be_off():
    found, test, _ = opened_again(lambda supply, daq: setattr(supply, "shut_down", lambda: False))
    assert found["output"].level is Level.WRONG and not test.off_confirmed


@pytest.mark.parametrize(
    ("steps_A", "is_said"), [(1e-3, False), (4e-3, False), (5e-3, True), (7.3e-3, True), (0.02, True)]
)
def test_a_supply_that_takes_currents_in_coarse_steps_is_named_before_the_driver_doubts_it(steps_A, is_said):
    stand = Stand()
    supply = InProcessSupply(stand.bench, stand.config)
    genuine = supply.set_current
    bias_A = stand.config.supply.bias_current
    supply.set_current = lambda current_A: genuine(bias_A + round((current_A - bias_A) / steps_A) * steps_A)
    test = self_test(stand, supply)
    said = [each.sentence for each in test.run() if each.part == "steps"]
    assert bool(said) == is_said and all("it takes currents in coarser steps than its dialect" in each for each in said)


def test_a_bias_that_the_digits_of_a_dialect_cannot_write_is_named():
    stand = Stand(lambda stand: stand.change(supply__bias_current=0.049))
    supply = InProcessSupply(stand.bench, stand.config)
    genuine, measured = supply.set_current, supply.read_back
    supply.set_current = lambda current_A: genuine(math.floor(current_A * 100.0) / 100.0)
    supply.read_back = lambda: replace(measured(), cut_off_A=0.009)
    (wrong,) = [each.sentence for each in self_test(stand, supply).run() if each.level is Level.WRONG]
    assert wrong.endswith("digits leave of supply.bias_current: choose one that they can write")


def test_a_supply_that_says_its_setting_for_what_it_measures_is_called_so():
    """As by VOLT? in the place of MEAS:VOLT? in its dialect: the wiring is right."""
    stand = Stand()
    supply = InProcessSupply(stand.bench, stand.config)
    measured = supply.read_back
    supply.read_back = lambda: replace(measured(), voltage_V=stand.config.supply.max_voltage)
    (wrong,) = [each.sentence for each in self_test(stand, supply).run() if each.level is Level.WRONG]
    assert wrong.endswith("the supply delivers 4 V: to that it was set; does its dialect ask for what it measures?")


def test_asked_to_end_it_ends_with_the_output_off():
    stand = Stand()
    supply = InProcessSupply(stand.bench, stand.config)
    test = self_test(stand, supply)
    found = test.run(lambda: stand.bench.supply.output_on)
    assert [each.sentence for each in found if each.level is Level.WRONG] == ["ended before its time: asked to"]
    assert not stand.bench.supply.output_on
    assert test.off_confirmed


def test_where_off_is_not_confirmed_it_says_so_and_has_not_passed():
    def goes_silent(stand):
        stand.after_opening = lambda bench: bench.inject("supply_silent")

    stand = Stand(goes_silent)
    assert not stand.test.off_confirmed
    assert "look at the supply, switch it off by hand" in stand.wrong[-1]


def test_the_command_prints_a_line_for_each_part_and_ends_with_1_where_something_is_wrong(capsys, tmp_path):
    config = shared_file("config/flexinol.yaml")
    assert (
        main(["check", "--config", str(config), "--virtual", "flexinol", "--json", str(tmp_path / "found.json")]) == 0
    )
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("ok     identity        the supply is SMA Actuator,Virtual Supply")
    assert lines[-1] == "ok     output          the output is off, and the supply has read that back"
    assert {each["level"] for each in json.loads((tmp_path / "found.json").read_text())} == {"ok"}
    mapping = read_parameter_file(config)
    mapping["circuit"]["lead_resistance"] = 3.0
    other = tmp_path / "other.yaml"
    write_parameter_file(other, mapping, "Other leads.")
    assert main(["check", "--config", str(other), "--virtual", "flexinol"]) == 1
    assert "WRONG" in capsys.readouterr().out


def self_test_of_a_bundle(said, wired, calibrated=False, bias_A=0.07):
    """What is wrong of four wires by a parameter file which says that they are connected so, where so many are, and
    so."""
    config = bench_from_mapping(read_parameter_file(shared_file("config/bundle_bench.yaml")))
    wire, (wires, connection) = replace(config.wire, connection=said), wired
    right = VirtualBench.from_name("bundle", like=wire).truth
    calibration = Calibration()
    if calibrated:
        cold = {"cold_stress": (20e6, 100e6), "cold_resistance": (right.resistance_Ohm,) * 2}
        calibration = replace(calibration, rest=replace(calibration.rest, **cold, cold_displacement=(4e-3, 4e-3)))
    low_Ohm, high_Ohm = wire.resistance_Ohm(0.4 * 0.7e-6), wire.resistance_Ohm(2.5e-6)
    supply = replace(config.supply, max_voltage=20.0, bias_current=bias_A)
    safety = replace(config.safety, resistance_min=low_Ohm, resistance_max=high_Ohm)
    config = replace(config, wire=wire, supply=supply, safety=safety, calibration=calibration)
    bench = VirtualBench.from_name("bundle", like=replace(wire, wires=wires, connection=connection))
    bench.advance(0.2)
    found = SelfTest(config, InProcessSupply(bench, config), InProcessDaq(bench, config), VirtualClock(bench)).run()
    return " ".join(each.sentence for each in found if each.level is Level.WRONG)


@pytest.mark.parametrize(("said", "wired"), [("series", "parallel"), ("parallel", "series")])
def test_a_bundle_that_is_wired_the_other_way_is_told_so(said, wired):
    """They were bridged by something, or of another length."""
    wrong = self_test_of_a_bundle(said, (4, wired))
    assert f"is wire.connection, {said}, as they are wired?" in wrong and f"bundle of 4 in {said}" in wrong
    assert "bridges" not in wrong and "wire.length" not in wrong
    assert not self_test_of_a_bundle(said, (4, said))


def test_a_voltage_beyond_the_range_of_its_channel_is_no_resistance():
    """It was 3.6e+38 Ω, and a zero error of -9.9e+40 mV."""
    wrong = self_test_of_a_bundle("series", (4, "series"), bias_A=0.14)
    assert wrong.startswith("the supply voltage is beyond the range of its channel at 280 mA") and "Ω" not in wrong


@pytest.mark.parametrize("carry", [1, 2, 3])
def test_wires_that_are_broken_in_a_bundle_are_counted(carry):
    wrong = self_test_of_a_bundle("parallel", (carry, "parallel"), calibrated=True)
    assert f"that is what {carry} of its 4 wires have" in wrong
    assert not self_test_of_a_bundle("parallel", (4, "parallel"), calibrated=True)


@pytest.mark.parametrize(
    ("part", "change", "wanted"),
    [
        ("voltage", {"supply__max_voltage": 4.0}, None),
        ("voltage", {"supply__max_voltage": 2.4}, "write supply.max_voltage: 3.3"),
        ("range", {"safety__channel_max_voltage": 10.0}, None),
        ("range", {"safety__channel_max_voltage": 2.5}, "supply.max_current: 0.37"),
    ],
)
def test_what_is_too_short_for_the_largest_current_is_seen_before_the_wire_is_driven(part, change, wanted):
    """0.4 A through 6.6 Ω are 2.6 V: it passed at the bias, and the driver switched off by the first pulse."""
    stand = Stand(lambda stand: stand.change(**change))
    said = [each for each in stand.found if each.part == part]
    assert [each.level for each in said] == ([Level.WARNING] if wanted else [])
    assert all(wanted in each.sentence for each in said) and not stand.wrong
