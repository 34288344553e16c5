"""Model health without a reference sensor: what it says of wires that are as they were calibrated, and of others."""

import numpy as np
import pytest

from sma_actuator.base.share import shared_file
from sma_actuator.base.signals import Branch, Estimate, Health, Quality, Signals
from sma_actuator.bench import InProcessDaq, InProcessSupply, VirtualClock, Weight
from sma_actuator.bench.hidden.hiding import HiddenBench
from sma_actuator.cli.main import main
from sma_actuator.config import Config
from sma_actuator.driver import Driver
from sma_actuator.estimation.chain import Estimates
from sma_actuator.estimation.health import ModelHealth
from sma_actuator.logs.bench_log import read_bench_log
from sma_actuator.logs.recorder import BenchLogRecorder


def used(hidden, mornings=4, folder=None):
    """The outputs of a wire that is switched on in the morning, moved about, and left alone; recorded in ``folder``."""
    config = Config.load(shared_file("config/flexinol.yaml"))
    recorder = None
    if folder is not None:
        config = config.replace({"recorder.folder": str(folder)})
        recorder = BenchLogRecorder(config, "wire")
    bench = HiddenBench.from_name("flexinol", seed=5, load=Weight(0.98), hidden=hidden)
    outputs = []
    supply, daq, clock = InProcessSupply(bench, config), InProcessDaq(bench, config), VirtualClock(bench)
    with Driver(config, supply, daq, clock, outputs.append, recorder) as driver:
        driver.run_for(20.0)
        for _ in range(mornings):
            assert driver.enable(True)[0]
            driver.run_for(4.0)
            for position_m in (0.0010, 0.0028):
                driver.offer_setpoint(position_m)
                driver.run_for(4.0)
            assert driver.enable(False)[0]
            driver.run_for(20.0)
    if recorder is not None:
        recorder.close()
    return outputs


@pytest.fixture(scope="module")
def as_calibrated():
    return used({})


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("recorded")


@pytest.fixture(scope="module")
def with_longer_leads(folder):
    return used({"lead_resistance": 0.05}, folder=folder)


def words(outputs):
    return [event for output in outputs for event in output.events if event.startswith("model health")]


def test_a_wire_as_it_was_calibrated_is_said_to_be_one_and_never_anything_else(as_calibrated):
    assert words(as_calibrated) == ["model health: the model holds, by resistance at cold rest"]
    assert as_calibrated[0].health.state is Health.UNKNOWN
    verdict = as_calibrated[-1].health
    assert verdict.state is Health.HOLDS
    assert verdict.error_m < 0.02 * 0.004
    assert verdict.cycles == 3, "that of the fourth morning is told with the next reading"


def test_longer_leads_are_said_with_the_error_of_the_position_and_what_could_be_the_cause(with_longer_leads):
    verdict = with_longer_leads[-1].health
    assert verdict.state is Health.DUE
    (said,) = words(with_longer_leads)
    assert said.startswith("model health: calibration due: resistance at cold rest is 0.0")
    assert "Not seen this way: a slip or creep in crimps" in said
    assert "leads or contacts with more resistance" in verdict.causes
    assert not any("heat loss" in cause or "less resistance" in cause for cause in verdict.causes)
    # What it says the position is wrong by is what it is wrong by.
    wrong_m = np.nanmean(
        [
            abs(o.estimate.displacement_m - o.signals.reference_displacement_m)
            for o in with_longer_leads
            if o.estimate.quality is Quality.DETERMINATE
        ]
    )
    assert verdict.error_m == pytest.approx(wrong_m, rel=0.4)
    first_s = next(o.signals.time_s for o in with_longer_leads if o.health.state is Health.DUE)
    assert verdict.since_s < first_s < 100.0


def test_of_a_log_it_says_what_it_said_live(with_longer_leads):
    outputs = [o for o in with_longer_leads if o.reading is not None]

    def column(record, name):
        return np.array([getattr(getattr(o, record), name) for o in outputs], dtype=float)

    signals = Signals(**{name: column("signals", name) for name in Signals.__dataclass_fields__})
    fields = {name: column("estimate", name) for name in Estimate.__dataclass_fields__}
    nothing = np.full(len(outputs), np.nan)
    estimates = Estimates(**fields, signals=signals, resistance_Ohm=nothing, model_m=nothing, heat_W=nothing)
    config = Config.load(shared_file("config/flexinol.yaml"))
    judge = ModelHealth(config, config.supply.bias_current)
    ((when_s, verdict),) = judge.run(estimates)
    assert when_s == next(o.signals.time_s for o in outputs if o.health.state is Health.DUE)
    assert verdict.state is Health.DUE
    assert judge.verdict == outputs[-1].health


def test_the_recording_holds_the_verdict_and_replay_comes_to_it_too(with_longer_leads, folder, capsys):
    (path,) = folder.glob("*.csv")
    (recorded,) = [event for _, event in read_bench_log(path).events if "model health" in event]
    assert recorded == words(with_longer_leads)[0]
    assert main(["replay", str(path), "--config", str(shared_file("config/flexinol.yaml")), "--health", "-q"]) == 0
    assert with_longer_leads[-1].health.words in capsys.readouterr().out


def test_without_a_calibration_it_says_that_it_does_not_know(make_config):
    config = Config.from_mapping(make_config())
    judge = ModelHealth(config, config.supply.bias_current)
    sample = Signals(0.0, 5.0, 0.05, 0.0125, 0.98, 54e6)
    assert not judge.step(sample, Estimate(0.0, 0.003, 0.03, 0.0, Branch.COOLING, Quality.DETERMINATE))
    assert judge.verdict.words == "not known: the calibration does not say what a resting wire shows"


def test_a_calibration_that_nowhere_rests_at_the_hot_end_is_enough():
    config = Config.load(shared_file("config/flexinol.yaml"))
    mapping = config.to_mapping()
    rest = {name: value for name, value in mapping["calibration"]["rest"].items() if not name.startswith("hot_")}
    without = {**mapping["calibration"], "rest": rest}
    bounds_Ohm = []
    for calibration in (mapping["calibration"], without):
        judge = ModelHealth(Config.from_mapping({**mapping, "calibration": calibration}), config.supply.bias_current)
        assert judge.known
        bounds_Ohm.append(judge._bound_Ohm)
    assert bounds_Ohm[1] == pytest.approx(bounds_Ohm[0], rel=0.2)


class TestSigns:
    """Made-up samples, so that one thing differs at a time."""

    config = Config.load(shared_file("config/flexinol.yaml"))

    def hold(self, judge, position_m, power_W, start_s, branch, seconds=25.0, resistance_Ohm=4.9):
        """A wire that is held; when that ends."""
        for time_s in np.arange(start_s, start_s + seconds, 0.05):
            signals = Signals(float(time_s), resistance_Ohm, 0.15, power_W, 0.98, 54e6, ambient_temperature_C=22.0)
            judge.step(signals, Estimate(float(time_s), position_m, 0.0, 0.0, branch, Quality.DETERMINATE))
        return start_s + seconds

    def life(self, heat, narrower_W=0.0):
        """Holds on both branches at changing places; from the fortieth on with ``heat`` times the power."""
        judge = ModelHealth(self.config, self.config.supply.bias_current)
        rng, time_s = np.random.default_rng(1), 0.0
        for number in range(70):
            position_m = float(rng.uniform(0.001, 0.003))
            branch = Branch(number % 2)
            power_W = 0.20 - 30.0 * position_m + (0.03 if branch is Branch.HEATING else -0.03)
            power_W += float(rng.normal(0.0, 0.002))
            if number >= 40:
                power_W = power_W * heat + (-narrower_W if branch is Branch.HEATING else narrower_W)
            time_s = self.hold(judge, position_m, power_W, time_s, branch)
        return judge.verdict

    def test_the_same_heat_for_the_same_places_is_no_sign(self):
        verdict = self.life(heat=1.0)
        assert set(verdict.signs) == {"hold", "width"}
        assert verdict.state is Health.UNKNOWN, "of the resistance nothing was seen"

    def test_a_draught_shows_in_the_heat_that_holds(self):
        verdict = self.life(heat=1.5)
        assert verdict.state is Health.DUE
        assert verdict.signs["hold"].side == 1
        assert any("heat loss" in cause for cause in verdict.causes)

    def test_training_shows_in_the_width_of_the_loop(self):
        verdict = self.life(heat=1.0, narrower_W=0.06)
        assert verdict.signs["width"].side == -1
        assert any("training or fatigue" in cause for cause in verdict.causes)
        assert not any("load cell" in cause for cause in verdict.causes)

    def test_the_contracted_wire_tells_a_warmer_resistivity_from_longer_leads(self):
        judge = ModelHealth(self.config, self.config.supply.bias_current)
        calibration = self.config.calibration
        cold_Ohm = float(np.interp(54e6, calibration.rest.cold_stress, calibration.rest.cold_resistance))
        time_s, rest_W = 0.0, 0.0132
        for _ in range(4):
            time_s = self.hold(judge, 0.0003, 0.45, time_s, Branch.HEATING, resistance_Ohm=4.46)
            time_s = self.hold(judge, 0.0043, rest_W, time_s, Branch.COOLING, seconds=40.0, resistance_Ohm=cold_Ohm)
        assert {name: sign.side for name, sign in judge.verdict.signs.items()} == {"cold": 0, "hot": 1}
        assert judge.verdict.causes[0].startswith("a sense resistor") or "resistivity" in " ".join(judge.verdict.causes)
        assert not any("leads" in cause for cause in judge.verdict.causes)
