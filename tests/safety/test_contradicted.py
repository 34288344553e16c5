"""A displacement sensor bears witness: what load cell and channels that lie make of the position, it contradicts; an
honest load, whatever hangs on the wire next, it never does."""

import math
from dataclasses import replace

import pytest
from rig import Rig

from sma_actuator.base.share import shared_file
from sma_actuator.base.signals import Mode, Quality
from sma_actuator.config import Config, read_parameter_file
from sma_actuator.plant.loads import Schedule, Spring, Weight
from sma_actuator.safety.faults import FAULTS
from sma_actuator.safety.guards.estimate import APART, APART_s, position_contradicted
from sma_actuator.safety.records import Memory, Step

BEGINS_s, PERIOD_s = 25.0, 9.0
LOADS = (Weight(0.98), Weight(1.96), Spring(400.0, 0.6))


@pytest.fixture(params=["sine", pytest.param("steps", marks=pytest.mark.long)])
def move(request):
    """Move a wire to and fro for so long, or until it is off; the first time that each fault was in the status."""

    def to(rig, seconds):
        begun_s, seen = rig.bench.time_s, {}
        while rig.bench.time_s - begun_s < seconds and rig.status.mode is not Mode.OFF:
            turn = 2.0 * rig.bench.time_s / PERIOD_s
            share = 0.5 - 0.5 * math.cos(math.pi * turn) if request.param == "sine" else math.floor(turn) % 2
            short_m, long_m = (float(rig.status.values[name]) for name in ("shortest_m", "longest_m"))
            rig.actuator.offer_setpoint(rig.now_s, long_m + (0.15 + 0.7 * share) * (short_m - long_m))
            rig.run(0.2)
            seen.setdefault(rig.status.fault, rig.bench.time_s - begun_s)
        return {fault: at_s for fault, at_s in seen.items() if fault}

    return to


def driven(load, wire="flexinol"):
    """A wire with a displacement sensor and the parameters that ship."""
    rig = Rig(read_parameter_file(shared_file(f"config/{wire}.yaml")), wire=wire, load=load)
    rig.enable()
    return rig


def with_load_N(config, reading, change):
    """A reading whose load cell shows ``change`` of what it would."""
    cell = config.load_cell
    load_N = change(cell.slope * reading.load_cell_voltage_V + cell.offset)
    return replace(reading, load_cell_voltage_V=(load_N - cell.offset) / cell.slope)


def swapped(rig):
    """The channels of load cell and displacement sensor, from now on."""
    shunt_Ohm = rig.config.instruments.daq.lvdt_shunt_resistance
    return lambda reading: replace(
        reading,
        load_cell_voltage_V=reading.lvdt_current_A * shunt_Ohm,
        lvdt_current_A=reading.load_cell_voltage_V / shunt_Ohm,
    )


def sinking(rig):
    """A load that is shown ever less, by a tenth a second, with the noise that it has."""
    begun_s, whole_N = rig.bench.time_s, rig.output.signals.load_N
    return lambda reading: with_load_N(
        rig.config, reading, lambda load_N: load_N - whole_N * (1.0 - 0.9 ** (rig.bench.time_s - begun_s))
    )


def doubled(rig):
    """Twice the load."""
    return lambda reading: with_load_N(rig.config, reading, lambda load_N: 2.0 * load_N)


@pytest.mark.parametrize(
    ("lie", "load"),
    [
        *((swapped, load) for load in LOADS[:2]),
        *((sinking, load) for load in LOADS),
        (doubled, Weight(0.98)),
    ],
)
def test_a_load_that_is_none_ends_the_drive_within_a_cycle_and_a_half(move, lie, load):
    rig = driven(load)
    assert move(rig, BEGINS_s) == {}
    rig.reading_of = lie(rig)
    assert "load_dead" in move(rig, 1.5 * PERIOD_s), rig.status.message


def test_where_the_motion_covers_that_a_load_has_changed_it_is_said_at_least(move):
    """A spring's load changes as fast as the channels that are swapped do."""
    rig = driven(LOADS[2])
    assert move(rig, BEGINS_s) == {}
    rig.reading_of = swapped(rig)
    assert {"load_dead", "position_contradicted"} & set(move(rig, PERIOD_s)), rig.status.message


def test_a_displacement_sensor_that_freezes_is_said_and_the_drive_goes_on(move):
    rig = driven(Weight(0.98))
    assert move(rig, BEGINS_s) == {}
    stands_A = rig.output.reading.lvdt_current_A
    rig.reading_of = lambda reading: replace(reading, lvdt_current_A=stands_A)
    assert set(move(rig, 2.0 * PERIOD_s)) == {"position_contradicted"}
    assert rig.status.mode is Mode.TRACKING
    rig.reading_of = lambda reading: reading
    rig.run(0.1)
    assert rig.status.fault == ""


def test_a_load_that_is_changed_under_a_frozen_sensor_is_not_accused(move):
    """It contradicted before."""
    rig = driven(Weight(0.98))
    move(rig, BEGINS_s)
    stands_A = rig.output.reading.lvdt_current_A
    rig.reading_of = lambda reading: replace(reading, lvdt_current_A=stands_A)
    while rig.status.fault != "position_contradicted":
        assert set(move(rig, 0.2)) <= {"position_contradicted"}
    rig.bench.load = Weight(1.5)
    assert set(move(rig, 2.0 * PERIOD_s)) <= {"position_contradicted"}


@pytest.mark.parametrize("wire", ["flexinol", pytest.param("furukawa", marks=pytest.mark.long)])
@pytest.mark.parametrize(
    "load",
    [
        Schedule(((0.0, Weight(0.98)), (25.0, Spring(300.0, 0.5)), (35.0, Weight(1.7)), (45.0, Weight(0.4)))),
        Schedule(tuple((0.1 * number, Weight(0.98 * 0.99**number)) for number in range(100))),
        Schedule(tuple((25.0 + 0.1 * number, Weight(1.96 * 0.985**number)) for number in range(80))),
    ],
    ids=["another", "leaks at once", "leaks"],
)
def test_no_honest_load_is(move, wire, load):
    assert move(driven(load, wire), 60.0) == {}


def with_a_model_that_errs(share, from_N, to_N):
    """The parameters that ship; at the second load the model is wrong by so much of the stroke, at the first by
    nothing."""
    parameters = read_parameter_file(shared_file("config/flexinol.yaml"))
    wire = Config.from_mapping(parameters).wire
    slope_m_Pa = share * wire.full_stroke_m * wire.area_m2 / (to_N - from_N)
    for name in ("heating_intercept", "cooling_intercept"):
        parameters["model"][name][0] -= slope_m_Pa * from_N / wire.area_m2
        parameters["model"][name][1] += slope_m_Pa
    return parameters


@pytest.mark.parametrize("share", [-0.15, 0.15])
@pytest.mark.parametrize(("from_N", "to_N"), [(0.98, 1.9), (1.47, 0.69)])
def test_no_load_is_dead_because_the_model_errs_at_it(move, share, from_N, to_N):
    """The displacement has leapt with it."""
    load = Schedule(((0.0, Weight(from_N)), (BEGINS_s, Weight(to_N))))
    rig = Rig(with_a_model_that_errs(share, from_N, to_N), load=load)
    rig.enable()
    assert set(move(rig, BEGINS_s + 1.5 * PERIOD_s)) == {"position_contradicted"}


@pytest.fixture
def contradicted(make_rig):
    """Whether a sensor that is apart by so much, and by half of so wide a 95 % interval, contradicts after so long."""
    rig = make_rig()
    rig.enable()

    def told(apart_m, half_m, lasts_s=APART_s, quality=Quality.DETERMINATE, settled=True, is_read=True):
        output, memory, said = rig.output, Memory(), ""
        reading = output.reading if is_read else None
        for now_s in (100.0, 100.0 + lasts_s):
            place_m = 1.5e-3
            said = position_contradicted.look(
                Step(
                    rig.config,
                    memory,
                    now_s,
                    0.05,
                    True,
                    settled,
                    output.reading,
                    reading,
                    replace(output.signals, reference_displacement_m=place_m + apart_m),
                    replace(output.estimate, displacement_m=place_m, uncertainty_m=half_m, quality=quality),
                    None,
                    output.command,
                    None,
                )
            )
        return said

    return told


class TestTheBound:
    """Of a wire of 4 mm of stroke."""

    @pytest.mark.parametrize("side", [1.0, -1.0])
    @pytest.mark.parametrize("half_m", [0.0, 0.3e-3, math.nan])
    def test_it_is_a_tenth_of_the_stroke_and_the_interval(self, contradicted, side, half_m):
        bound_m = APART * 4e-3 + (0.0 if math.isnan(half_m) else half_m)
        assert contradicted(side * (bound_m + 1e-9), half_m)
        assert not contradicted(side * (bound_m - 1e-9), half_m)

    def test_it_lasts_a_second(self, contradicted):
        assert contradicted(1e-3, 0.0, 1.0)
        assert not contradicted(1e-3, 0.0, 0.999)

    def test_it_is_told(self, contradicted):
        assert contradicted(-1.25e-3, 0.0) == "it reads -1.25 mm from 1.5 mm"

    @pytest.mark.parametrize("quality", Quality)
    def test_an_estimate_outside_the_calibration_contradicts_nothing(self, contradicted, quality):
        assert bool(contradicted(1e-3, 0.0, quality=quality)) == (quality < Quality.OUTSIDE_CALIBRATION)

    @pytest.mark.parametrize("there_is", [{"settled": False}, {"is_read": False}])
    def test_nor_does_one_that_belongs_to_no_reading(self, contradicted, there_is):
        assert contradicted(1e-3, 0.0, **there_is) == ""

    def test_without_a_sensor_nothing_is(self, contradicted):
        assert contradicted(math.nan, 0.0) == ""


def test_the_table_says_both():
    assert "more than 10 % of the full stroke and half of the estimate's 95 % interval for 1 s" in (
        FAULTS["position_contradicted"].detector
    )
    assert "contradicts the position (as in position_contradicted)" in FAULTS["load_dead"].detector
