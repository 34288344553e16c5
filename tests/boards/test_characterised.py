"""A wire on the board from nothing to a model, and driven with it."""

import dataclasses

import pytest
from characterised import SHORT
from virtual_board import VirtualBoard

from sma_actuator.base.parameter_file import read_parameter_file
from sma_actuator.characterise import Rig, characterise, make_plan
from sma_actuator.characterise.operators import BenchOperator
from sma_actuator.cli.main import main
from sma_actuator.config import Config, bench_from_mapping
from sma_actuator.driver import Driver
from sma_actuator.instruments import open_instruments

PLAN = dataclasses.replace(SHORT, skip=("lead_resistance", "fatigue"))


class Person(BenchOperator):
    """Needs a second to hang something, in which the board reads the load cell."""

    def __init__(self, board, largest_force_N, extended_m):
        super().__init__(board.bench, largest_force_N, extended_m)
        self._board = board

    def _put(self, load):
        self._bench.load = load
        self._board.run(1.0)


@pytest.mark.long
def test_a_wire_is_characterised_identified_and_driven_on_the_board(tmp_path, monkeypatch):
    board = VirtualBoard()
    _, supply, daq = board.instruments(monkeypatch)
    mapping = board.mapping()
    for identified in ("model", "calibration", "reference_sensor", "load_cell"):
        del mapping[identified]
    config = bench_from_mapping(mapping)
    rig = Rig(config, supply, daq, board)
    operator = Person(board, config.wire.max_stress * config.wire.area_m2, config.wire.full_stroke_m)
    manifest = characterise(mapping, make_plan(config, PLAN), rig, operator, tmp_path / "logs")
    assert not board.world.heats
    assert manifest.data["parts"]
    cell = read_parameter_file(tmp_path / "logs" / "bench.yaml")["load_cell"]
    assert cell["slope"] == pytest.approx(19.5, rel=0.005)

    logs = [str(path) for kind in ("pulses", "partial") for path in sorted((tmp_path / "logs").glob(f"{kind}_*.csv"))]
    wire = tmp_path / "wire.yaml"
    assert main(["identify", *logs, "--config", str(tmp_path / "logs" / "bench.yaml"), "--out", str(wire)]) == 0

    board = VirtualBoard(load_N=0.49)
    board.instruments(monkeypatch)  # its line
    config = Config.from_mapping(read_parameter_file(wire))
    driver = Driver(config, *open_instruments(config, board), board)
    driver.open()
    driver.run_for(0.5)
    done, words = driver.enable(True)
    assert done, words
    driver.run_for(5.0)
    for target_m in (0.0025, 0.0012, 0.0022):
        for _ in range(24):
            driver.offer_setpoint(target_m)
            output = driver.run_for(0.25)
        assert output.status.fault == "", output.status.message
        assert board.bench.truth.displacement_m == pytest.approx(target_m, abs=0.2e-3)
    assert driver.stop()
    assert not board.world.heats
