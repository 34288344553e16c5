"""A short attack with every test run; ``make attack`` runs the long one and writes docs/attack.md."""

import subprocess
import sys

import pytest

from attack import ends, heat, hours, lies, lines, soak
from attack.promises import Promises, read_table
from attack.proxy import Mischief
from attack.result import Result
from sma_actuator.base.share import shared_file
from sma_actuator.config import copy_tables
from sma_actuator.plant.loads import Weight
from sma_actuator.safety.reach import Reach

#: One mischief of each sort; the long attack does all of them, on both instruments.
SPOILT = (
    ("supply", Mischief("drop")),
    ("supply", Mischief("garble")),
    ("supply", Mischief("empty")),
    ("supply", Mischief("trickle")),
    ("supply", Mischief("refuse", "none")),
    ("daq", Mischief("late", delay_s=0.7)),
    ("daq", Mischief("trickle")),
    ("daq", Mischief("extra")),
    ("daq", Mischief("flood")),
)


def _unbroken(result: Result) -> None:
    assert result.violations == [], result.verdict()


class TestTheJudge:
    def test_every_time_in_the_table_of_faults_can_be_worked_out(self, config):
        promises = Promises(config.to_mapping())
        assert len(read_table()) > 20
        assert all(0.0 <= promises.within_s(fault) < 60.0 for fault in promises.rows)

    def test_a_current_that_stays_is_found(self):
        session = hours.Session(0, seconds=1.0)
        _let_current_flow(session.bench, 0.2)
        session.bench.watch = session.look
        session.expect_off_within(0.1)
        session.bench.advance(session.bench.time_s + 0.09)
        assert session.result.violations == []
        session.bench.advance(session.bench.time_s + 0.1)
        assert [violation.rule.split(":")[0] for violation in session.result.violations] == [
            "the current is not off in time"
        ]

    def test_a_wire_above_its_limit_and_too_much_current_are_found(self):
        session = hours.Session(0, seconds=1.0)
        _let_current_flow(session.bench, 0.9)
        session.bench.watch = session.look
        session.bench.advance(20.0)
        assert {violation.rule for violation in session.result.violations} == {
            "the wire is above its limit of temperature",
            "more than supply.max_current flows",
        }


def _let_current_flow(bench, current_A):
    bench.supply.set_voltage(20.0)
    bench.supply.set_ocp(1.0)
    bench.supply.set_current(current_A)
    bench.supply.set_output(True)


class TestHalfTheHeatLoss:
    """In the physics that loses least; ``python -m attack heat`` takes all of them."""

    WORST = heat.UNITS.index(("flexinol", "vertical"))

    def test_no_wire_gets_too_hot_by_the_driver(self):
        heating = heat.Heating(self.WORST)
        heating.judge("held", heating.driven(heat.LOADS[0], 20.0, "held"))
        assert heating.result.worst["flexinol in vertical, held [°C]"] > 110.0
        _unbroken(heating.result)

    def test_nor_by_characterise(self):
        heating = heat.Heating(self.WORST)
        heating.judge("characterise", heating.characterised())
        assert heating.result.worst["flexinol in vertical, characterise [°C]"] > 150.0
        _unbroken(heating.result)

    def test_nor_under_a_cover_that_is_put_over_it(self):
        heating = heat.Heating(self.WORST)
        heating.judge("covered", heating.driven(heat.LOADS[0], 40.0, "covered"))
        _unbroken(heating.result)

    def test_nor_does_one_that_shows_more_than_that_of_the_calibration(self):
        """Contracted it shows 4 % more, and 8e-4 a kelvin: as much as the other one cold.  It came to 263 °C."""
        heating = heat.Heating(heat.UNITS.index(("flexinol", "drawn-5")))
        heating.judge("held", heating.driven(heat.LOADS[0], 30.0, "held"))
        _unbroken(heating.result)

    @pytest.mark.parametrize("restart_s", [20.0, heat.RESTART_s])
    def test_nor_does_one_that_is_thinner_than_the_calibrated_one(self, restart_s, monkeypatch):
        """It shows a tenth more, contracted as cold, and came to 409 °C, begun anew to 293 °C."""
        monkeypatch.setattr(heat, "RESTART_s", restart_s)
        heating = heat.Heating(self.WORST)
        heating.judge("thinner", heating.driven(heat.LOADS[0], 20.0, "thinner"))
        _unbroken(heating.result)

    def test_and_the_hottest_wire_that_was_measured_contracts_and_is_held(self):
        heating = heat.Heating(heat.UNITS.index(("flexinol", "hot")))
        heating.judge_contraction("the largest load", heating.contracted(Weight(2.84), 110.0))
        _unbroken(heating.result)

    def test_as_does_one_that_expands_with_heat_before_its_clamped_ends_transform(self):
        heating = heat.Heating(heat.UNITS.index(("furukawa", "drawn-9")))
        assert heating.stroke(Weight(1.98))[2] < 100.0, "where it turns; its ends follow at 157 °C"
        heating.judge_contraction("a middle load", heating.contracted(Weight(1.98), 45.0))
        _unbroken(heating.result)

    def test_which_the_judge_would_not_believe_of_limits_that_are_too_low(self):
        heating = heat.Heating(heat.UNITS.index(("flexinol", "hot")))
        too_low = {"thermal.derate_temperature": 80.0, "thermal.max_temperature": 110.0}
        heating.config = heating.config.replace(too_low)
        heating.judge_contraction("a light load", heating.contracted(Weight(0.3), 100.0))
        assert len(heating.result.violations) == 1

    def test_nor_would_the_judge_miss_it(self):
        heating = heat.Heating(self.WORST, heat_loss=0.1)
        heating.judge("held", heating.driven(heat.LOADS[0], 20.0, "held"))
        assert len(heating.result.violations) == 1


class TestEnds:
    """At home, with the shipped file; ``python -m attack ends`` makes a model of every wire in its physics first."""

    RULE = "an end is shown that is none"

    @pytest.fixture
    def driven(self, tmp_path, monkeypatch):
        monkeypatch.setattr(ends, "KEPT", tmp_path)
        shipped = shared_file("config/flexinol.yaml").read_text(encoding="utf-8")
        (tmp_path / "measured_flexinol.yaml").write_text(shipped, encoding="utf-8")
        copy_tables(shared_file("config/flexinol.yaml"), tmp_path / "measured_flexinol.yaml")
        its = ends.Ends(heat.UNITS.index(("flexinol", "measured")), 45.0)

        def drive():
            its.drive("a middle load", 0.98, hot=True)
            return {violation.rule for violation in its.result.violations}

        return drive

    def test_a_wire_that_is_switched_on_while_it_counts_as_hot_shows_none(self, driven):
        assert self.RULE not in driven()

    def test_nor_would_the_judge_miss_one(self, driven, monkeypatch):
        monkeypatch.setattr(Reach, "step", lambda self, *_, **__: setattr(self, "floor_m", 1.0))
        assert self.RULE in driven()


class TestLies:
    """At home; ``python -m attack lies`` takes every physics and load."""

    @pytest.fixture
    def lying(self):
        return lies.Lying(heat.UNITS.index(("flexinol", "measured")))

    @pytest.mark.parametrize("what", ["sense resistor", "voltage channel"])
    def test_a_drift_is_not_believed(self, lying, what):
        words = f"a {what} that rises by 0.4 % a second"
        lying.judge(words, lies.LIES[words], "sine", Weight(0.98))
        assert lying.result.counts["lies found"] == 1
        _unbroken(lying.result)

    def test_nor_is_a_load_cell_that_stands(self, lying):
        words = "a load cell that stands but for its converter's dither"
        lying.judge(words, lies.LIES[words], "sine", Weight(0.98))
        assert lying.result.counts["lies found"] == 1
        _unbroken(lying.result)

    @pytest.mark.parametrize("words", ["load and displacement channel swapped", "a displacement sensor that freezes"])
    def test_nor_are_channels_that_another_contradicts(self, lying, words):
        lying.judge(words, lies.LIES[words], "sine", Weight(0.98))
        assert lying.result.counts["lies found"] == 1
        _unbroken(lying.result)

    def test_nor_would_the_judge_miss_one_that_is(self, lying):
        words = "a sense resistor that rises by 0.4 % a second"
        lying.config = lying.config.replace({"safety.current_drift": 1.0, "instruments.daq.lvdt_channel": 0})
        lying.judge(words, lies.LIES[words], "held", Weight(0.98))
        assert [violation.rule for violation in lying.result.violations] == [f"believed: {words}"]


@pytest.mark.parametrize(("seconds", "settled_s"), [(120.0, 30.0), pytest.param(240.0, 60.0, marks=pytest.mark.long)])
class TestMemory:
    """Of a driver and its recorder for some thousand steps; ``python -m attack soak`` is a day."""

    def test_no_object_is_kept_for_longer_than_it_is_wanted(self, seconds, settled_s):
        result = soak.attack(0, seconds, settled_s)
        assert result.counts["steps"] >= 20 * seconds
        assert result.worst["objects grown"] < soak.MOST_GROWN_OBJECTS

    def test_nor_would_the_judge_miss_one_at_each_step(self, seconds, settled_s):
        steps = []
        result = soak.attack(0, seconds, settled_s, on_output=lambda output: steps.append(output.status.message + "!"))
        assert result.worst["objects grown"] > soak.MOST_GROWN_OBJECTS
        assert [violation.rule for violation in result.violations] == ["memory grows"]


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.long) for seed in (1, 2, 3))])
def test_virtual_minutes_of_faults_break_no_promise(seed):
    result = hours.Session(seed, seconds=180.0).run()
    assert result.counts["faults"] + result.counts["switched off"] + result.counts["restarts"] >= 3
    _unbroken(result)


@pytest.mark.timeout(240)
def test_spoilt_lines_break_no_promise():
    result = lines.attack(1, SPOILT)
    assert result.counts["lines spoilt"] == len(SPOILT)
    _unbroken(result)


@pytest.mark.long  # of each, quickly: tests/driver/test_driver_thread.py and tests/ros/test_odd_messages.py
@pytest.mark.timeout(180)
@pytest.mark.parametrize(
    ("what", "how_many"), (("kills", ("--count", "3")), ("boards", ("--count", "3")), ("fuzz", ("--messages", "10000")))
)
def test_kills_and_odd_messages_break_no_promise(what, how_many):
    pytest.importorskip("rclpy")
    run = subprocess.run(
        [sys.executable, "-m", "attack", what, "--jobs", "1", *how_many], capture_output=True, text=True, timeout=170
    )
    assert run.returncode == 0, run.stdout + run.stderr[-2000:]
