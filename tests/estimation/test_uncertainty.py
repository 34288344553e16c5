"""How far an estimate may be off: it covers the truth, and says after a pause that little is known."""

from dataclasses import replace
from math import isnan

import numpy as np
import pytest

from sma_actuator.base.calibration import IntervalSection, TrainingSection
from sma_actuator.base.lookup import row_of
from sma_actuator.base.share import shared_file
from sma_actuator.base.signals import Mode, Quality
from sma_actuator.bench import InProcessDaq, InProcessSupply, VirtualBench, VirtualClock, Weight
from sma_actuator.config import Config
from sma_actuator.driver import Driver
from sma_actuator.estimation.uncertainty import Uncertainty, _left_m


@pytest.fixture(scope="module")
def outputs():
    """A wire that is moved about, switched off in mid-stroke for a moment, and moved again."""
    config = Config.load(shared_file("config/flexinol.yaml"))
    bench = VirtualBench.from_name("flexinol", seed=7, load=Weight(0.98))
    out = []
    supply, daq, clock = InProcessSupply(bench, config), InProcessDaq(bench, config), VirtualClock(bench)
    with Driver(config, supply, daq, clock, out.append) as driver:
        driver.run_for(10.0)
        for pause_s in (0.4, 30.0):
            assert driver.enable(True)[0]
            driver.run_for(2.0)
            for position_m in (0.0010, 0.0028, 0.0015, 0.0022):
                driver.offer_setpoint(position_m)
                driver.run_for(6.0)
            assert driver.enable(False)[0]
            driver.run_for(pause_s)
    return out


def known(outputs):
    return [o for o in outputs if o.estimate.quality is not Quality.INVALID]


def test_where_nothing_is_measured_nothing_is_said(outputs):
    assert all(isnan(o.estimate.uncertainty_m) for o in outputs if o.estimate.quality is Quality.INVALID)
    assert all(o.estimate.uncertainty_m > 0.0 for o in known(outputs))
    last = [o for o in known(outputs) if o.status.mode is not Mode.OFF][-1]
    assert last.status.values["uncertainty_m"] == last.estimate.uncertainty_m


def test_it_covers_what_the_reference_sensor_shows(outputs):
    inside = [
        abs(o.estimate.displacement_m - o.signals.reference_displacement_m) <= o.estimate.uncertainty_m
        for o in known(outputs)
    ]
    assert np.mean(inside) > 0.9


def test_after_a_pause_it_is_as_wide_as_the_loop_and_shrinks_as_the_wire_moves(outputs):
    """Switched on again in mid-stroke: the resistance alone does not say on which side of the loop the wire is."""
    began = [i for i, o in enumerate(outputs) if "enabled" in o.events]
    assert len(began) == 2
    after = known(outputs[began[1] :])
    model = Config.load(shared_file("config/flexinol.yaml"))
    heating_m, cooling_m = model.model.build(model.wire).limits_m(
        after[0].signals.resistance_Ohm, after[0].signals.stress_Pa
    )
    assert after[0].estimate.uncertainty_m >= 0.5 * abs(heating_m - cooling_m)
    assert after[-1].estimate.uncertainty_m < 0.5 * after[0].estimate.uncertainty_m


def test_without_a_calibration_nothing_is_said(make_rig):
    rig = make_rig()
    rig.enable()
    assert isnan(rig.output.estimate.uncertainty_m)


@pytest.mark.parametrize("places", [(1e-3,), (1e-3, 2e-3), (1e-3, 1.5e-3, 4e-3)])
def test_one_sample_is_interpolated_as_numpy_does(places):
    values = [(7.0 * place) ** 2 for place in places]
    for x in (0.0, 1e-3, 1.2e-3, 1.5e-3, 3.999e-3, 4e-3, 5e-3):
        assert _left_m(row_of((places, values)), 0, x) == pytest.approx(np.interp(x, places, values), rel=1e-12)


@pytest.mark.parametrize("interval_of_its_own", [True, False])
def test_of_a_wire_that_changed_while_it_was_calibrated_half_of_that_is_unknown(outputs, interval_of_its_own):
    """What came with the first cycles it has lost since, what came evenly only half of."""
    output = known(outputs)[-1]
    config = Config.load(shared_file("config/flexinol.yaml"))
    calibration = config.calibration
    if interval_of_its_own:  # as whole_range says it: no table of what is left
        calibration = replace(calibration, interval=IntervalSection())
    in_training = replace(calibration, training=TrainingSection(changed=1e-4))
    model = config.model.build(config.wire)
    stands_m, trains_m = (
        Uncertainty(model, each).step(output.signals, output.estimate) for each in (calibration, in_training)
    )
    assert trains_m - stands_m == pytest.approx(0.5e-4)
