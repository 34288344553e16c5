"""The firmware of the board, with simulated parts and a wire: what it lets flow, what it says of that, and when it
cuts."""

import itertools
import math

import numpy as np
import pytest
from virtual_board import VirtualBoard

from sma_actuator.bench import VirtualBench
from sma_actuator.plant import physics

SENSE_Ohm, LEADS_Ohm = 0.1, 0.02


@pytest.fixture
def board():
    return VirtualBoard()


def resistance_Ohm(board):
    circuit_V, sense_V = map(float, board.ask("FETC? (@101,102)").split(","))
    return SENSE_Ohm * (circuit_V / sense_V - 1.0) - LEADS_Ohm


def test_it_starts_off_and_says_who_it_is(board):
    assert board.ask("*IDN?") == "SMA Actuator,RP2040 board,0001,1"
    assert board.ask("OUTP?;CURR?;:OUTPut:PROTection:TRIPped?") == "0;0;NONE"
    assert not board.world.heats


@pytest.mark.parametrize("current_A", [0.06, 0.12, 0.25, 0.4])
def test_it_lets_flow_what_it_is_told_and_shows_the_wire_as_it_is(board, current_A):
    board.drive(current_A)
    board.run(5.0)  # until nothing moves
    truth = board.bench.truth
    assert truth.current_A == pytest.approx(current_A, rel=0.003)
    assert float(board.ask("MEAS:CURR?")) == pytest.approx(current_A, rel=0.003)
    assert resistance_Ohm(board) == pytest.approx(board.bench.truth.resistance_Ohm, abs=0.006)
    cell, displacement_V, room_C = map(float, board.ask("FETC? (@103:105)").split(","))
    assert 19.5 * cell - 0.0585 == pytest.approx(truth.load_N, abs=2e-3)
    assert 0.0315842 * displacement_V - 1.2195e-3 == pytest.approx(board.bench.truth.displacement_m, abs=5e-6)
    assert room_C == pytest.approx(22.0, abs=0.4)


def test_pulses_heat_a_wire_as_the_direct_current_does_that_the_board_says():
    """Step by step through every pulse: so the world, and the driver, may take √share × current for a direct
    current."""
    full_A, share, period_s, step_s = 0.6, 0.25, 10e-3, 0.1e-3
    ends = []
    for pulses in (False, True):
        bench = VirtualBench.from_name("flexinol")
        bench.supply.set_voltage(20.0)
        bench.supply.ocp_on = False
        bench._set_inputs()
        inputs, ring, row = bench._inputs, np.zeros((8192, len(physics.COLUMNS))), 0
        for _ in range(300):
            for is_on, part_s in ((True, share * period_s), (False, (1.0 - share) * period_s)):
                inputs[physics.OUTPUT_ON] = is_on or not pulses
                inputs[physics.CURRENT_SET] = full_A if pulses else math.sqrt(share) * full_A
                # The bench's supply settles within a millisecond: the MOSFET does not.
                bench._state[physics.CURRENT] = inputs[physics.CURRENT_SET] if inputs[physics.OUTPUT_ON] else 0.0
                steps = round(part_s / step_s)
                row = physics.simulate(steps, step_s, bench.constants, bench._wire, inputs, ring, row)
        ends.append((float(bench._state[physics.TEMPERATURE]), float(bench._state[physics.DISPLACEMENT])))
    (direct_C, direct_m), (pulsed_C, pulsed_m) = ends
    assert direct_m < 0.001  # it has contracted, from 4 mm
    assert pulsed_C == pytest.approx(direct_C, abs=1.5)
    assert pulsed_m == pytest.approx(direct_m, abs=15e-6)


def test_less_than_can_be_measured_does_not_flow(board):
    board.drive(0.02)
    assert board.bench.truth.current_A == 0.0
    assert board.ask("OUTP:PROT:TRIP?") == "NONE"
    board.tell("CURR 0.06")
    board.run(0.3)
    assert board.bench.truth.current_A == pytest.approx(0.06, rel=0.003)


def test_off_is_off_in_the_middle_of_a_pulse(board):
    board.drive(0.4)
    while not board.world._is_powered:
        board._turn()
    board.board.off()
    assert not board.world.heats
    assert not board.world._is_powered


def test_a_silent_line_is_cut_off_and_stays_so_until_a_person_clears_it(board):
    board.drive(0.3)
    silent_s = board.now_s()
    board.tell("OUTP:PROT:WDOG:DEL 0.4")
    while board.world.heats:
        board.run(0.001)
        board.world.hear(b"\xff\xfe\nATZ\nFETC? (@101)\n")  # noise, and questions for measurements
        board.said.clear()
    assert 0.4 <= board.now_s() - silent_s <= 0.46
    board.run(0.1)
    board.said.clear()
    assert board.ask("OUTP?;OUTP:PROT:TRIP?") == "0;WDOG"
    board.tell("*CLS;OUTP ON")
    assert board.ask("SYST:ERR?") == '-221,"Settings conflict"'
    board.tell("OUTP:PROT:CLE")
    assert not board.world.heats
    board.tell("OUTP ON")
    board.run(0.3)
    assert board.world.heats


def test_a_program_that_stands_still_is_started_anew_and_its_gate_is_off(board):
    board.drive(0.3)
    still_s = board.now_s()
    board.stands_still = True
    while board.world.heats:
        board.run(0.001)
    assert 0.4 <= board.now_s() - still_s <= 0.55
    assert board.world.was_reset


@pytest.mark.parametrize(
    ("happens", "trip", "within_s"),
    [
        (lambda board: board.bench.inject("short_wire"), "OCP", 0.02),
        (lambda board: board.tell("CURR:PROT 0.25"), "OCP", 0.02),
        (lambda board: board.tell("VOLT:PROT 1.0"), "OVP", 0.02),
        (lambda board: setattr(board.world, "gate_stuck", True), "GATE", 0.4),
        (lambda board: setattr(board.world, "gate_stuck", False), "GATE", 0.4),
        (lambda board: board.world.dead.add("meter"), "GATE", 0.4),
    ],
    ids=["short", "over-current", "over-voltage", "always conducts", "never conducts", "meter dead"],
)
def test_what_goes_wrong_trips(board, happens, trip, within_s):
    board.drive(0.3)
    happens(board)
    begun_s = board.now_s()
    while board.board.is_on:
        board.run(0.001)
        board.tell("*OPC")  # of the line's watchdog this is not about
        assert board.now_s() - begun_s < within_s
    assert board.board.trips[0] == trip
    assert board.board._gate._pulses is None


def test_a_mosfet_that_conducts_is_noticed_before_anything_is_switched_on(board):
    board.world.gate_stuck = True
    board.run(0.1)
    assert board.ask("OUTP:PROT:TRIP?") == "GATE"
    assert float(board.ask("MEAS:CURR?")) > 0.4


def test_an_open_wire_has_the_voltage_that_is_not_exceeded_and_no_current(board):
    board.bench.inject("open_wire")
    board.drive(0.3)
    assert float(board.ask("MEAS:VOLT?")) == pytest.approx(3.0, rel=0.01)
    assert abs(float(board.ask("MEAS:CURR?"))) < 1e-3


def test_a_load_cell_that_was_left_in_the_middle_of_a_word_is_read_again(board):
    board.run(0.2)
    while board.world._cell_left == 0:  # its word has begun
        board.world.call("pin 17 1")
        board.world.call("pin 17 0")
    board.world._cell_bits = -1  # what stands on its line looks like "not done yet", for ever
    board.program = board.start()
    board.run(0.5)
    assert 19.5 * float(board.ask("FETC? (@103)")) - 0.0585 == pytest.approx(0.98, abs=2e-3)


def test_parts_that_are_not_there_have_no_value_and_the_others_go_on(board):
    board.world.dead |= {"cell", "converter"}
    board.run(1.0)
    assert board.ask("FETC? (@103:104)") == "9.91E+37,9.91E+37"
    board.drive(0.2)
    assert board.bench.truth.current_A == pytest.approx(0.2, rel=0.003)


@pytest.mark.parametrize(
    ("line", "error"),
    [
        ("CURR 1.5", '-222,"Data out of range"'),
        ("CURR nan", '-222,"Data out of range"'),
        ("CURR", '-109,"Missing parameter"'),
        ("CURR much", '-104,"Data type error"'),
        ("OUTP maybe", '-104,"Data type error"'),
        ("OUTP:PROT:WDOG OFF", '-113,"Undefined header"'),
        ("OUTP:PROT:WDOG:DEL 60", '-222,"Data out of range"'),
        ("ROUT:SCAN (@101,106)", '-222,"Data out of range"'),
        ("ROUT:SCAN 101", '-104,"Data type error"'),
        ("HELLO", '-113,"Undefined header"'),
        ("CURR 0.1" + " " * 600, '-223,"Too much data"'),
    ],
)
def test_what_it_cannot_obey_it_says_and_does_not(board, line, error):
    board.tell(line)
    board.run(0.1)
    assert board.ask("CURR?;SYST:ERR?;SYST:ERR?") == f'0;{error};0,"No error"'


@pytest.mark.parametrize("current_A", [0.05, 0.2])
def test_the_load_cell_is_read_anew_between_rare_pulses(board, current_A):
    board.drive(current_A)
    loads_V = []
    for _ in range(40):
        board.run(0.044)
        loads_V.append(board.ask("FETC? (@103)"))
    assert sum(before == after for before, after in itertools.pairwise(loads_V)) <= 1, (
        "noise: two may be equal by chance"
    )
    assert board.ask("OUTP:PROT:TRIP?") == "NONE"
