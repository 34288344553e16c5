"""A coil from the model that was identified on the bench: estimated, driven, guarded, as a wire is."""

import numpy as np
import pytest
from rig import Rig

from sma_actuator.base.parameter_file import read_parameter_file
from sma_actuator.base.parameters import ConfigError
from sma_actuator.base.share import shared_file
from sma_actuator.base.signals import Mode
from sma_actuator.cli.remote.move import beyond_words
from sma_actuator.config import Config
from sma_actuator.plant.loads import Weight


@pytest.fixture
def mapping():
    return read_parameter_file(shared_file("config/coil.yaml"))


def test_it_goes_where_it_is_told_over_centimetres_and_knows_how_sure_it_is(mapping):
    rig = Rig(mapping, "coil", load=Weight(0.13))
    full_m = rig.config.wire.full_stroke_m
    rig.enable()
    covered = []
    for asked_m in (0.030, 0.012, 0.040):
        rig.actuator.offer_setpoint(rig.now_s, asked_m)
        for _ in range(600):
            rig.actuator.offer_setpoint(rig.now_s, asked_m)
            estimate = rig.step().estimate
            covered.append(abs(rig.bench.truth.displacement_m - estimate.displacement_m) <= estimate.uncertainty_m)
        assert rig.status.mode is Mode.TRACKING and rig.status.fault == "", rig.status.message
        assert abs(rig.bench.truth.displacement_m - asked_m) < 0.02 * full_m, asked_m
    assert np.mean(covered) > 0.8


def test_beyond_its_long_end_no_heat_holds_it_back_from_where_it_goes_by_itself(mapping):
    """The end is where it came in the time that its calibration gave it; held there it took a quarter more current than
    the bias, and a Ni-Ti wire up to three times that, for ever."""
    rig = Rig(mapping, "coil", load=Weight(0.13))
    full_m, bias_A = rig.config.wire.full_stroke_m, rig.config.supply.bias_current

    def go(asked_m, seconds):
        for _ in range(round(seconds / rig.period_s)):
            rig.actuator.offer_setpoint(rig.now_s, asked_m)
            rig.step()

    rig.enable()
    go(0.030, 15.0)
    assert "setpoint_range" not in rig.status.limits
    little_m = rig.status.values["longest_m"] + 0.01 * full_m
    go(little_m, 0.1)  # which it follows, and `move` says nothing else
    assert "setpoint_range" not in rig.status.limits and not beyond_words(little_m, rig.status)
    go(1.0, 30.0)
    assert "it goes to its long end" in beyond_words(1.0, rig.status)
    assert "setpoint_range" in rig.status.limits and "at its long end" in rig.status.message
    before = len(rig.outputs)
    go(1.0, 10.0)
    assert max(output.command.current_A for output in rig.outputs[before:]) < 1.01 * bias_A
    assert rig.bench.truth.displacement_m > rig.status.values["longest_m"]
    # Nothing has wound up: the setpoint stands close to where the wire is.
    assert 0.0 < rig.output.setpoint_m - rig.output.estimate.displacement_m < 0.025 * full_m
    go(0.030, 10.0)
    assert rig.bench.truth.displacement_m == pytest.approx(0.030, abs=0.02 * full_m)


def test_its_limit_is_a_stress_that_is_told_as_a_load_too(mapping):
    rig = Rig(mapping, "coil", load=Weight(0.13))
    rig.enable()
    rig.bench.load = Weight(0.36)  # 185 MPa
    rig.actuator.offer_setpoint(rig.now_s, 0.03)
    assert rig.seconds_until("stress_above_limit", 0.5) is not None or rig.status.fault == "load_spike"
    assert not rig.bench.supply.output_on


def test_a_model_of_another_form_is_refused(mapping):
    mapping["wire"] |= {"form": "wire"}
    del mapping["wire"]["coil_diameter"]
    with pytest.raises(ConfigError, match=r"wire.form: wire, but the coefficients were fitted on coil of 1.524 mm"):
        Config.from_mapping(mapping)
