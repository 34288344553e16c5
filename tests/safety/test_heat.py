"""By the bench's truth no wire gets hotter than ``thermal.max_temperature``, whatever is believed of its heat loss."""

import itertools
import re
from dataclasses import replace
from pathlib import Path

import pytest
from rig import Rig

from sma_actuator import characterise
from sma_actuator.actuator import Actuator
from sma_actuator.base.share import shared_file
from sma_actuator.base.signals import Command
from sma_actuator.bench import InProcessDaq, InProcessSupply, VirtualClock
from sma_actuator.bench.bench import Setup, VirtualBench
from sma_actuator.bench.chain import Chain
from sma_actuator.bench.real import wire_of
from sma_actuator.characterise.programs import hold
from sma_actuator.config import Config, bench_from_mapping, read_parameter_file
from sma_actuator.control.pid import PidController
from sma_actuator.derived import derived, still_air_W_m2K
from sma_actuator.plant.loads import Weight
from sma_actuator.plant.worlds import HOME

WIRES = ("flexinol", "furukawa")
SHIPPED = ("flexinol", "flexinol_normalised", "furukawa", "furukawa_normalised")
#: What takes long is driven with the Ni-Ti-Cu wire alone, which gets hotter, in the quick tests.
ONE_QUICKLY = [pytest.param("flexinol", marks=pytest.mark.long), "furukawa"]


class Greedy(PidController):
    """A controller that wants all it can get."""

    def step(self, position_m, setpoint_m, dt_s, limit_A):
        return limit_A


def begin_anew(rig):
    """A new actuator, as after configure or a new start: it knows nothing of the old one."""
    rig.actuator = Actuator(rig.config)
    rig.actuator._following.controller = Greedy(rig.config.controller, rig.config.supply.bias_current)
    rig.supply.open()
    rig.written = Command(0.0, False)


def greedy(name, heat_loss_factor=1.0, changes=(), **setup):
    mapping = read_parameter_file(shared_file(f"config/{name}.yaml"))
    mapping["calibration"].get("hot_end", {}).pop("cooling_rise", None)  # what the limit of current does, it does alone
    config = Config.from_mapping(mapping).replace(dict(changes))
    rig = Rig(config.to_mapping(), name.split("_")[0], Weight(0.98), **setup)
    rig.bench.inject("draught", heat_loss_factor)
    begin_anew(rig)
    rig.run(0.2)
    return rig


def hottest_C(rig, seconds):
    """The highest true temperature of the wire within a time."""
    end_s, hottest = rig.bench.time_s + seconds, -1e9
    while rig.bench.time_s < end_s:
        rig.step()
        hottest = max(hottest, rig.bench.truth.temperature_C)
    return hottest


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.long if "normalised" in n else ()) for n in SHIPPED]
)
@pytest.mark.parametrize("divisor", [*(pytest.param(less, marks=pytest.mark.long) for less in (1.0, 2.0)), 3.0])
def test_all_the_current_there_is_for_ever_leaves_an_enclosed_wire_below_its_limit(name, divisor):
    rig = greedy(name, 1.0 / divisor)
    rig.enable()
    assert hottest_C(rig, 90.0) < rig.config.thermal.max_temperature
    assert rig.bench.supply.output_on, rig.status


def test_without_the_margin_an_enclosed_wire_is_burnt():
    rig = greedy("furukawa", 1 / 3, {"thermal.heat_loss_margin": 1.0})
    rig.enable()
    assert hottest_C(rig, 60.0) > 1.5 * rig.config.thermal.max_temperature


@pytest.mark.parametrize("wire", ONE_QUICKLY)
def test_beginning_anew_again_and_again_does_not_heat_it_further(wire):
    """Configure and clean up, or start again: seventeen times, each as soon as it is hot."""
    rig = greedy(wire, 1 / 3)
    hottest = 0.0
    for _ in range(17):
        rig.enable()
        hottest = max(hottest, hottest_C(rig, 6.0))
        begin_anew(rig)
        rig.run(0.2)
    assert 120.0 < hottest < rig.config.thermal.max_temperature


@pytest.mark.parametrize("wire", ONE_QUICKLY)
def test_nor_does_killing_it_with_the_current_on(wire):
    """The watchdog of the supply cuts the current; nobody looks until then."""
    rig = greedy(wire, 1 / 3)
    hottest = 0.0
    for _ in range(12):
        rig.enable()
        hottest = max(hottest, hottest_C(rig, 4.0))
        while rig.bench.supply.output_on:
            rig.bench.advance(rig.bench.time_s + 0.01)
            hottest = max(hottest, rig.bench.truth.temperature_C)
        begin_anew(rig)
        rig.run(0.2)
    assert 120.0 < hottest < rig.config.thermal.max_temperature


@pytest.mark.parametrize("wire", WIRES)
def test_without_a_watchdog_a_killed_computer_leaves_a_current_that_the_wire_survives(wire):
    rig = greedy(wire, 1 / 3, {"supply.watchdog_timeout": 0.0, "supply.allow_no_watchdog": True})
    rig.enable()
    rig.run(2.0)
    rig.bench.advance(rig.bench.time_s + 120.0)
    assert rig.bench.supply.output_on
    assert 120.0 < rig.bench.truth.temperature_C < rig.config.thermal.max_temperature


@pytest.mark.parametrize("wire", ONE_QUICKLY)
@pytest.mark.parametrize("ambient_C", [15.0, pytest.param(24.0, marks=pytest.mark.long)])
def test_without_a_watchdog_a_wire_contracts_wholly_and_is_safe_as_long_as_anybody_looks(wire, ambient_C):
    """As `init` writes it for most supplies; held at 67 to 78 °C a ninth was martensite still, for ever."""
    unwatched = {"supply.watchdog_timeout": 0.0, "supply.allow_no_watchdog": True, "thermal.unwatched_margin": 1.25}
    rig = greedy(wire, 1.0, {**unwatched, "thermal.ambient_temperature": ambient_C}, ambient_C=ambient_C)
    rig.enable()
    assert hottest_C(rig, 60.0) < rig.config.thermal.max_temperature
    assert rig.bench.truth.martensite < 0.01
    rig.bench.inject("draught", 0.5)  # a cover
    assert hottest_C(rig, 60.0) < rig.config.thermal.max_temperature
    rig.bench.inject("draught", 1.0)
    rig.run(60.0)
    rig.bench.advance(rig.bench.time_s + 120.0)  # the computer is gone
    assert rig.bench.supply.output_on
    assert 110.0 < rig.bench.truth.temperature_C < rig.config.thermal.max_temperature


def fine(alloy, diameter_m, watchdog_s, ambient_C):
    """A rig with a wire that is quicker than the time in which nobody looks, as `init` has it without a calibration."""
    mapping = read_parameter_file(shared_file(f"config/{alloy}_bench.yaml"))
    thicker = mapping["wire"]["diameter"] / diameter_m
    mapping = {name: mapping[name] for name in ("wire", "circuit", "load_cell", "reference_sensor", "instruments")}
    mapping["wire"]["diameter"] = diameter_m
    mapping["circuit"]["reference_resistance"] *= 10.0
    mapping["load_cell"] = {name: value / thicker**2 for name, value in mapping["load_cell"].items()}
    mapping["supply"] = {"watchdog_timeout": watchdog_s, "allow_no_watchdog": True}
    mapping["thermal"] = {"ambient_temperature": ambient_C}
    for name, found in derived(mapping).items():
        section, _, key = name.partition(".")
        mapping.setdefault(section, {}).setdefault(key, found.value)
    config = bench_from_mapping(mapping)
    home, usual = wire_of(alloy, HOME), Chain()
    transfer = home.heat_transfer_W_m2K * still_air_W_m2K(diameter_m) / still_air_W_m2K(home.diameter_m)
    chain = replace(
        usual,
        reference_resistance_Ohm=config.circuit.reference_resistance,
        load_cell_slope_N_V=usual.load_cell_slope_N_V / thicker**2,
        load_cell_offset_N=usual.load_cell_offset_N / thicker**2,
    )
    wire = replace(home, diameter_m=diameter_m, heat_transfer_W_m2K=transfer)
    bench = VirtualBench(Setup(wire, chain, Weight(1.5e8 * config.wire.area_m2), ambient_C=ambient_C), 1)
    supply, daq = InProcessSupply(bench, config), InProcessDaq(bench, config)
    return characterise.Rig(config, supply, daq, VirtualClock(bench)), bench


#: Each once in the quick tests.
FINE = {("flexinol", 25e-6, 0.0), ("furukawa", 50e-6, 1.0)}


@pytest.mark.parametrize(
    "alloy, diameter_m, watchdog_s",
    [
        pytest.param(*each, marks=() if each in FINE else pytest.mark.long)
        for each in itertools.product(WIRES, (25e-6, 50e-6), (0.0, 1.0))
    ],
)
def test_a_fine_wire_of_which_nothing_is_known_contracts_in_a_cool_room_and_is_safe_at_half_the_loss(
    alloy, diameter_m, watchdog_s
):
    """Watched too seldom for its thermometer, it was held at 91 °C for ever, a tenth of it martensite."""
    for loses in (1.0, 0.5):
        rig, bench = fine(alloy, diameter_m, watchdog_s, 15.0)
        bench.inject("draught", loses)
        hottest = [0.0]
        with rig.opened():
            most_A = rig.config.supply.max_current
            rig.record(hold(most_A, 40.0), lambda _: hottest.append(bench.hottest_C))  # noqa: B023
        assert max(hottest) < rig.config.thermal.max_temperature
        assert bench.truth.martensite < 0.02


@pytest.mark.parametrize("alloy", ONE_QUICKLY)
@pytest.mark.parametrize("watchdog_s", [0.0, 1.0])
def test_a_fine_wire_that_is_covered_when_it_is_hot_stays_below_its_limit(alloy, watchdog_s):
    rig, bench = fine(alloy, 50e-6, watchdog_s, 15.0)
    bench.inject("draught", 0.5, at_s=bench.time_s + 20.0)
    hottest = [0.0]
    with rig.opened():
        rig.record(hold(rig.config.supply.max_current, 40.0), lambda _: hottest.append(bench.hottest_C))
    assert 150.0 < max(hottest) < rig.config.thermal.max_temperature


@pytest.mark.parametrize("wire", ONE_QUICKLY)
def test_a_sensor_that_says_arctic_cold_does_not_heat_it(wire):
    rig = greedy(wire, 1 / 3, ambient_C=35.0, changes={"thermal.ambient_temperature": 35.0})
    genuine = rig.daq.read_block

    def cold():
        reading = genuine()
        return type(reading)(
            reading.time_s,
            reading.supply_voltage_V,
            reading.reference_voltage_V,
            reading.load_cell_voltage_V,
            reading.lvdt_current_A,
            -59.0,
        )

    rig.daq.read_block = cold
    rig.run(0.5)
    assert rig.status.fault == "ambient_doubted"
    assert rig.actuator.enable(rig.now_s, True)[0], "a broken thermometer is no reason to stand still"
    assert hottest_C(rig, 60.0) < rig.config.thermal.max_temperature


@pytest.mark.parametrize("name", SHIPPED)
def test_a_wire_of_which_nothing_is_known_may_have_full_current_after_a_few_seconds(name):
    rig = greedy(name)
    rig.run(9.0)
    rig.enable()
    rig.run(0.5)
    assert max(output.command.current_A for output in rig.outputs) == rig.config.supply.max_current


@pytest.mark.parametrize("wire", ONE_QUICKLY)
def test_an_enclosed_wire_that_is_moved_to_and_fro_is_seen_and_named(wire):
    mapping = read_parameter_file(shared_file(f"config/{wire}.yaml"))
    for divisor, seen in ((1.0, False), (3.0, True)):
        rig = Rig(mapping, wire, Weight(0.98))
        rig.bench.inject("draught", 1.0 / divisor)
        rig.run(1.0)
        rig.enable()
        lo_m, hi_m = rig.config.model.displacement_range
        for _ in range(3):
            for position_m in (lo_m, hi_m):
                rig.actuator.offer_setpoint(rig.now_s, position_m)
                rig.run(15.0)
        assert (rig.status.fault == "heat_loss_wrong") == seen, (divisor, rig.status)
        if seen:
            shown_mm = float(re.search(r"contracted to (\S+) mm", rig.status.message)[1])
            assert shown_mm < 1e3 * rig.config.calibration.hot_end.cooling_position < 50.0 * shown_mm


def still_air_C(wire, current_A):
    """True temperature of the bench's wire after two minutes with a current."""
    bench = VirtualBench.from_name(wire, load=Weight(0.98), ambient_C=24.0)
    bench.supply.set_voltage(20.0)
    bench.supply.set_current(current_A)
    bench.supply.set_output(True)
    bench.advance(120.0)
    return bench.truth.temperature_C


@pytest.mark.parametrize("name", SHIPPED)
def test_the_currents_of_the_shipped_files_harm_no_wire_in_still_air_for_ever(name):
    config = Config.load(shared_file(f"config/{name}.yaml"))
    wire = name.split("_")[0]
    for current_A in (config.supply.max_current, config.supply.over_current_trip):
        assert still_air_C(wire, current_A) < config.thermal.max_temperature


@pytest.mark.parametrize("wire", WIRES)
def test_what_the_files_of_the_bench_say_of_their_currents_is_so(wire):
    path = Path(shared_file(f"config/{wire}_bench.yaml"))
    supply = bench_from_mapping(read_parameter_file(path)).supply
    for name in ("max_current", "over_current_trip"):
        said = re.search(rf"^ *{name}: .*?# A; for ever in still air: (\d+) °C$", path.read_text(), re.MULTILINE)
        assert said, f"{path}: {name} does not say how hot it makes the wire"
        assert int(said[1]) == round(still_air_C(wire, getattr(supply, name)))
