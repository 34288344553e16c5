"""No heating into a region where the sign of the feedback is not known.

The wire of this bench is of another physics: its austenite's resistance rises five times as steeply with temperature as
that of the bench's own wires, and its transformation ends in a broad tail.  Fully contracted, it shows more resistance
the hotter it gets, and a model reads that as extension.  It is characterised and identified as any wire, from its own
logs.
"""

import dataclasses
import math

import numpy as np
import pytest
from rig import Rig as Stand

from sma_actuator.base.share import shared_file
from sma_actuator.base.signals import Quality
from sma_actuator.bench import InProcessDaq, InProcessSupply, VirtualBench, VirtualClock
from sma_actuator.bench.bench import Setup
from sma_actuator.characterise import PlanOptions, Rig, characterise, make_plan
from sma_actuator.characterise.operators import BenchOperator
from sma_actuator.config import Config, bench_from_mapping, read_parameter_file
from sma_actuator.control.heat import Landing
from sma_actuator.control.pid import PidController
from sma_actuator.control.tracking import TrackingErrors
from sma_actuator.estimation.chain import Chain
from sma_actuator.estimation.hot_end import HotEnd
from sma_actuator.identify import identify
from sma_actuator.logs.bench_log import read_bench_log
from sma_actuator.plant.loads import Spring, Weight
from sma_actuator.plant.materials import WIRES
from sma_actuator.safety.limits import CURRENT_MAX
from sma_actuator.safety.reach import Reach
from sma_actuator.safety.thermal import WireHeat

#: The thesis's mean output error under control, exclusive model of the Ni-Ti wire, % of full stroke (its Table 4).
THESIS_PCT = 3.80
#: And of steps with Ni-Ti-Cu where the load is not constant (its Table 9).  There this model takes a wire that is
#: contracted for one that is 7 % of the stroke longer, which a limit of heat that did not let it contract kept out of
#: sight.
SPRING_PCT = 4.32
#: Temperature coefficient of the austenite's resistivity [1/K]; that of the bench's own wires is 0.4e-3 and 0.3e-3.
STEEP = {"flexinol": 2e-3, "furukawa": 1.5e-3}
TAIL_K = 15.0
STEPS = (0.70, 0.30, 0.85, 0.50, 0.15, 0.60, 0.05, 0.90, 0.40, 0.0, 1.0, 0.0)
LOADS = (Weight(0.98), Spring(stiffness_N_m=150.0, preload_N=0.8), Spring(stiffness_N_m=400.0, preload_N=0.4))


def reversing_wire(name):
    """A wire of the bench whose resistance rises again at the hot end."""
    wire = WIRES[name]
    material = wire.material
    austenite = dataclasses.replace(material.austenite, resistivity_temperature_coefficient_1_K=STEEP[name])
    finish_C = material.austenite_finish_C + TAIL_K
    material = dataclasses.replace(material, austenite=austenite, austenite_finish_C=finish_C)
    return dataclasses.replace(wire, material=material)


@pytest.fixture(scope="module", params=["flexinol", pytest.param("furukawa", marks=pytest.mark.long)])
def identified(request, tmp_path_factory):
    """Name and parameters of such a wire, identified from its own logs."""
    name, folder = request.param, tmp_path_factory.mktemp(request.param)
    mapping = read_parameter_file(shared_file(f"config/{name}_bench.yaml"))
    config = bench_from_mapping(mapping)
    bench = VirtualBench(Setup(reversing_wire(name)), seed=3)
    rig = Rig(config, InProcessSupply(bench, config), InProcessDaq(bench, config), VirtualClock(bench))
    options = PlanOptions(
        loads_N=(0.4, 0.7, 1.1, 1.5, 2.0) if name == "flexinol" else (0.6, 1.0, 1.5, 2.2, 3.0),
        masses_kg=(0.02, 0.1, 0.2),
        pulses=2,
        set_points=4,
        probe_places=6,
        average_s=1.0,
        skip=("training", "fatigue"),
    )
    operator = BenchOperator(bench, config.wire.max_stress * config.wire.area_m2, config.wire.full_stroke_m)
    characterise(mapping, make_plan(config, options), rig, operator, folder)
    logs = [read_bench_log(p) for kind in ("pulses", "partial") for p in sorted(folder.glob(f"{kind}_*.csv"))]
    return name, identify(logs, read_parameter_file(folder / "bench.yaml"), name, variant="transition", order=2).mapping


def stand(identified, load):
    name, mapping = identified
    rig = Stand(mapping, name, load)
    rig.bench = VirtualBench(Setup(reversing_wire(name), load=load), seed=5)
    rig.supply, rig.daq = InProcessSupply(rig.bench, rig.config), InProcessDaq(rig.bench, rig.config)
    rig.supply.open()
    rig.daq.open()
    rig.actuator = type(rig.actuator)(rig.config)
    rig.outputs.clear()
    rig.run(8.0)
    rig.enable()
    return rig


def follow(rig, parts, dwell_s, said=("",)):
    """Errors, and the share of the time and the longest time [s] at all the current there is with a wire that is too
    short already."""
    low_m, high_m = rig.config.model.displacement_range
    full_m = rig.config.wire.full_stroke_m
    errors, steps, latched, running, longest = TrackingErrors(full_m), 0, 0, 0, 0
    for part in parts:
        setpoint_m = low_m + part * (high_m - low_m)
        end_s = rig.bench.time_s + dwell_s
        while rig.bench.time_s < end_s - 1e-9:
            assert rig.actuator.offer_setpoint(rig.now_s, setpoint_m) == ""
            output = rig.step()
            assert output.status.fault in said, output.status.message
            errors.add(setpoint_m, output.estimate.displacement_m, output.signals.reference_displacement_m)
            too_short = rig.bench.truth.displacement_m < setpoint_m - 0.05 * full_m
            running = running + 1 if too_short and CURRENT_MAX.name in output.status.limits else 0
            longest = max(longest, running)
            latched += running > 0
            steps += 1
    return errors.as_dict(), latched / steps, longest * rig.period_s


@pytest.mark.parametrize(
    "load",
    [LOADS[0], *(pytest.param(spring, marks=pytest.mark.long) for spring in LOADS[1:])],
    ids=("weight", "spring", "stiff spring"),
)
def test_the_wire_follows_over_its_whole_working_range_and_never_latches_hot(identified, load):
    rig = stand(identified, load)
    errors, latched, longest_s = follow(rig, STEPS, 20.0)
    assert latched < 0.005
    assert longest_s < 1.0
    on_springs = identified[0] == "furukawa" and isinstance(load, Spring)
    most_percent = SPRING_PCT if on_springs else THESIS_PCT
    assert errors["control_error_pct_stroke"] < most_percent and errors["output_error_pct_stroke"] < most_percent


def test_without_what_the_calibration_knows_of_the_hot_end_it_does_latch(identified, monkeypatch):
    """The same, with the working range of before and the resistance believed at all times."""
    name, mapping = identified
    before_m = [0.34e-3 if name == "flexinol" else 0.23e-3, mapping["model"]["displacement_range"][1]]
    model = {**mapping["model"], "displacement_range": before_m}
    monkeypatch.setattr(HotEnd, "known", property(lambda self: False, lambda self, value: None), raising=False)
    monkeypatch.setattr(Reach, "step", lambda *_, **__: None)
    monkeypatch.setattr(WireHeat, "power_limit_W", lambda *_: math.inf)  # the other that would keep it from it …
    monkeypatch.setattr(
        Landing, "limit_A", lambda *_: math.inf
    )  # … and the law's own, which gives no more than it takes
    thermal = {**mapping["thermal"], "heat_loss_margin": 1.0}
    rig = stand((name, {**mapping, "model": model, "thermal": thermal}), Weight(0.98))
    # The displacement sensor sees it.
    _, latched, _ = follow(rig, (1.0, 0.0) * 3, 20.0, ("", "position_contradicted"))
    assert latched > 0.05


class Greedy(PidController):
    """A controller that heats whatever it sees."""

    def step(self, position_m, setpoint_m, dt_s, limit_A):
        return limit_A


def test_the_estimate_says_that_it_does_not_see_and_where_the_wire_is(identified):
    rig = stand(identified, Weight(0.98))
    rig.actuator._following.controller = Greedy(rig.config.controller, rig.config.supply.bias_current)
    rig.run(8.0)
    assert rig.bench.truth.temperature_C > 70.0
    assert rig.output.estimate.quality is Quality.INDETERMINATE_HOT
    wrong_m = abs(rig.output.estimate.displacement_m - rig.bench.truth.displacement_m)
    assert wrong_m < 0.02 * rig.config.wire.full_stroke_m


def test_the_hot_end_is_seen_alike_live_and_in_replay(identified):
    rig = stand(identified, Weight(0.98))
    follow(rig, (1.0, 0.0, 0.5), 10.0)
    outputs = rig.outputs[200:]
    config = Config.from_mapping(identified[1])
    one, many = Chain(config), Chain(config)
    signals = [o.signals for o in outputs]
    together = type(signals[0])(
        **{f.name: np.array([getattr(s, f.name) for s in signals]) for f in dataclasses.fields(signals[0])}
    )
    experiment = many.run(together)
    for i, s in enumerate(signals):
        estimate = one.step(s)[1]
        assert estimate.quality == experiment.quality[i]
        assert estimate.displacement_m == pytest.approx(experiment.displacement_m[i], abs=1e-12, nan_ok=True)
    assert Quality.INDETERMINATE_HOT in set(experiment.quality)
