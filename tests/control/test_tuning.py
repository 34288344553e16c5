"""Gains from the wire itself: what is read in a relay test, a whole tuning on the bench, and every way out of one."""

import contextlib
import dataclasses

import numpy as np
import pytest
from rig import Rig

from sma_actuator.base.interrupts import Interrupts
from sma_actuator.base.share import shared_file
from sma_actuator.base.signals import Mode
from sma_actuator.base.yaml_text import with_values
from sma_actuator.cli import tune as tune_command
from sma_actuator.cli.main import main
from sma_actuator.config import Config, copy_tables
from sma_actuator.control.tuning import GAINS, RESTLESS, GivenUp, Trial, gains_of, swings_from_A_m, swings_of
from sma_actuator.plant.loads import Weight

SHIPPED = Config.load(shared_file("config/flexinol.yaml"))
OFF = {f"controller.{name}": getattr(SHIPPED.controller, name) for name in GAINS}


def relay_test(dead_time_s=(0.2, 0.4), slope_m_sA2=(0.02, 0.01), holding_A=0.2, step_s=0.01):
    """What an integrating wire does that answers late, heated (first) and cooled."""
    time_s, place_m, current_A = [0.0], [0.002], [0.4]
    heats, changed_s = True, 0.0
    while time_s[-1] < 40.0:
        place = place_m[-1]
        if heats != (place > 0.00195 if heats else place > 0.00205):
            heats, changed_s = not heats, time_s[-1]
        flows_A = 0.4 if heats else 0.05
        late = time_s[-1] - changed_s < dead_time_s[not heats]
        acts_A = (0.05 if heats else 0.4) if late else flows_A
        warms = acts_A > holding_A
        place_m.append(place - slope_m_sA2[not warms] * (acts_A**2 - holding_A**2) * step_s)
        time_s.append(time_s[-1] + step_s)
        current_A.append(flows_A)
    return np.array(time_s), np.array(place_m), np.array(current_A)


def test_a_relay_test_tells_heating_from_cooling():
    swings = swings_of(*relay_test())
    assert swings.heating.dead_time_s == pytest.approx(0.2, abs=0.03)
    assert swings.cooling.dead_time_s == pytest.approx(0.4, abs=0.03)
    # The current that holds the wire is that of the mean heat, which is shared out by how long each way takes.
    way_A2 = 0.4**2 - swings.holding_A**2
    assert swings.heating.slope_m_sA2 * way_A2 == pytest.approx(0.02 * (0.4**2 - 0.2**2), rel=0.05)


def test_the_rules_are_those_of_an_integrating_process():
    swings = swings_of(*relay_test(dead_time_s=(0.3, 0.3), slope_m_sA2=(0.01, 0.01)))
    gains = gains_of(swings, period_s=0.0, time_constant_s=1.7)
    slope_m_sA = 2.0 * swings.holding_A * swings.heating.slope_m_sA2
    assert gains["kp"] == pytest.approx(1.0 / (slope_m_sA * 2.0 * 0.3), rel=0.1)
    assert gains["kp"] / gains["ki"] == pytest.approx(1.7)
    assert gains["kd"] == 0.0


def test_a_wire_that_does_not_swing_is_given_up():
    time_s, place_m, current_A = relay_test()
    with pytest.raises(GivenUp, match=r"the wire swung \d times .* is the load one that it lifts"):
        swings_of(time_s[:300], place_m[:300], current_A[:300])


def test_the_gain_at_which_the_current_swings_is_told_from_the_largest_calm_one():
    def trial(unrest):
        return Trial(worth=0.1, unrest=unrest)

    calm = {(400.0, 240.0, 0.0): trial(0.01), (800.0, 480.0, 0.0): trial(0.02)}
    assert swings_from_A_m(calm) == pytest.approx(800.0 * RESTLESS / 0.02)
    assert swings_from_A_m({**calm, (1600.0, 960.0, 0.0): trial(2.0 * RESTLESS)}) == 1600.0
    assert swings_from_A_m({(1600.0, 960.0, 0.0): trial(2.0 * RESTLESS)}) == 1600.0


def rig_of(**changes):
    """A cool wire that is held."""
    rig = Rig(
        SHIPPED.replace({name.replace("__", "."): value for name, value in changes.items()}).to_mapping(),
        load=Weight(0.98),
    )
    rig.skew_s += 3600.0
    rig.run(0.2)
    rig.enable()
    return rig


def tune(rig):
    done, sentence = rig.actuator.tune(rig.now_s)
    assert done, sentence
    assert "tuning" in rig.step().events
    assert rig.status.mode is Mode.TUNING


def test_it_reckons_with_the_period_of_the_loop():
    rig = rig_of()
    tune(rig)
    assert rig.actuator._tuner.running._around.period_s == 1.0 / rig.config.loop.rate


@pytest.fixture(scope="module")
def tuned():
    """A wire tuned from gains ten times too high; outputs from then on."""
    rig = rig_of(**{name.replace(".", "__"): 10.0 * value for name, value in OFF.items()})
    rig.outputs.clear()
    tune(rig)
    begun_s = rig.now_s
    while rig.status.mode is Mode.TUNING and rig.now_s - begun_s < 400.0:
        rig.step()
    return rig


def test_in_less_than_five_minutes_without_a_fault_and_never_above_the_bound(tuned):
    found = tuned.output.tuned
    assert found is not None, tuned.status.values["tuning"]
    assert found.duration_s < 280.0
    assert [o.status.fault for o in tuned.outputs if o.status.fault] == []
    most_A = max(o.command.current_A for o in tuned.outputs)
    assert most_A <= SHIPPED.controller.tuning_current * SHIPPED.supply.max_current
    assert most_A > 0.8 * SHIPPED.supply.max_current
    assert found.before == pytest.approx({name: 10.0 * OFF[f"controller.{name}"] for name in GAINS})
    assert tuned.status.values["tuning"].startswith("done: kp ")
    # With a quicker integral a wire that stands still inside its hysteresis hunts to and fro over it.
    time_constant_s = SHIPPED.thermal.heat_capacity / SHIPPED.thermal.heat_loss
    assert found.gains["kp"] / found.gains["ki"] > 0.99 * time_constant_s


def test_the_gains_are_taken_over_without_a_jump(tuned):
    before_A = tuned.output.command.current_A
    taken = tuned.config.replace({f"controller.{name}": value for name, value in tuned.outputs[-1].tuned.gains.items()})
    tuned.actuator.update(taken)
    tuned.step()
    assert tuned.status.mode is Mode.HOLD
    assert tuned.output.command.current_A == pytest.approx(before_A, abs=0.02)
    held_m = tuned.output.setpoint_m
    tuned.run(5.0)
    assert tuned.output.estimate.displacement_m == pytest.approx(held_m, abs=0.02 * SHIPPED.wire.full_stroke_m)


def mean_error_m(config):
    """Of steps over the middle of the range."""
    rig = Rig(config.to_mapping(), load=Weight(0.98))
    rig.skew_s += 3600.0
    rig.run(0.2)
    rig.enable()
    low_m, high_m = config.model.build(config.wire).displacement_range_m
    errors_m = []
    for part in (0.7, 0.3, 0.5):
        setpoint_m = low_m + part * (high_m - low_m)
        rig.actuator.offer_setpoint(rig.now_s, setpoint_m)
        rig.outputs.clear()
        rig.run(10.0)
        errors_m += [abs(setpoint_m - output.estimate.displacement_m) for output in rig.outputs]
    return float(np.mean(errors_m))


def test_the_command_writes_gains_as_good_as_the_shipped_ones_and_keeps_those_of_before(tmp_path, capsys):
    path = tmp_path / "wire.yaml"
    text = shared_file("config/flexinol.yaml").read_text(encoding="utf-8")
    copy_tables(shared_file("config/flexinol.yaml"), path)
    path.write_text(text.replace("kp: 400.0", "kp: 40.0").replace("ki: 320.0", "ki: 32.0"))
    assert main(["tune", "--config", str(path), "--virtual", "flexinol", "-q"]) == 0
    assert "(before: kp 40 A/m, ki 32 A/(m·s), kd 0 A·s/m)" in capsys.readouterr().out
    assert "    # Tuned; before: kp 40 A/m, ki 32 A/(m·s), kd 0 A·s/m\n    controller:\n" in path.read_text()
    found = Config.load(path)
    assert dataclasses.replace(found.controller, **{k: OFF[f"controller.{k}"] for k in GAINS}) == SHIPPED.controller
    assert mean_error_m(found) < 1.1 * mean_error_m(SHIPPED)


def test_asked_to_end_it_ends_with_the_output_off_and_nothing_written(tmp_path, capsys, monkeypatch):
    path = tmp_path / "wire.yaml"
    text = shared_file("config/flexinol.yaml").read_text(encoding="utf-8")
    copy_tables(shared_file("config/flexinol.yaml"), path)
    path.write_text(text)
    drivers = []

    @contextlib.contextmanager
    def signals():
        """A signal comes when the wire has been tuned for a moment."""
        interrupts, driver_of = Interrupts(), tune_command._driver

        def driver_with_a_signal(config, args, put):
            def noting(output):
                put(output)
                if output.status.values["tuning"].startswith("relay test, 3"):
                    interrupts.note(2)

            drivers.append(driver_of(config, args, noting))
            return drivers[-1]

        monkeypatch.setattr(tune_command, "_driver", driver_with_a_signal)
        yield interrupts

    monkeypatch.setattr(tune_command, "noted_signals", signals)
    assert main(["tune", "--config", str(path), "--virtual", "flexinol"]) == 130
    assert "relay test, 2 of 12 turns" in capsys.readouterr().err
    assert path.read_text() == text
    assert drivers[0][0].output_is_off


def test_what_cannot_be_done_is_refused_before_current_flows(tmp_path, capsys):
    path = tmp_path / "wire.yaml"
    text = shared_file("config/flexinol.yaml").read_text(encoding="utf-8")
    copy_tables(shared_file("config/flexinol.yaml"), path)
    path.write_text(text)
    assert main(["tune", "--config", str(path), "--virtual", "flexinol", "--out", str(path)]) == 1
    assert "exists already; --force overwrites it" in capsys.readouterr().err
    low = ["tune", "--config", str(path), "--virtual", "flexinol", "--current", "0.02"]
    assert main(low) == 1
    assert "controller.tuning_current: 0.05 is outside its range" in capsys.readouterr().err
    assert path.read_text() == text


WAYS_OUT = {
    "a setpoint": (
        lambda rig: rig.actuator.offer_setpoint(rig.now_s, 0.0025),
        Mode.TRACKING,
        "something else was wanted",
    ),
    "a stop of the motion": (lambda rig: rig.actuator.offer_trajectory(rig.now_s, [], []), Mode.HOLD, "something else"),
    "off": (lambda rig: rig.actuator.enable(rig.now_s, False), Mode.OFF, "the output was switched off"),
    "a fault": (
        lambda rig: rig.actuator.raise_fault(rig.now_s, "node_lost", "provoked"),
        Mode.OFF,
        "fault node_lost: provoked",
    ),
    "a reading that is a fault": (
        lambda rig: setattr(rig, "reading_of", lambda r: dataclasses.replace(r, load_cell_voltage_V=11.0)),
        Mode.OFF,
        "fault reading_saturated: ",
    ),
    "other gains": (
        lambda rig: rig.actuator.update(rig.config.replace({"controller.kp": 700.0})),
        Mode.HOLD,
        "the parameters of the controller were changed",
    ),
    "heat": (
        lambda rig: rig.actuator.update(rig.config.replace({"thermal.derate_temperature": 40.0})),
        Mode.HOLD,
        "thermal.derate_temperature is 40 °C: allow less current",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("happens", "mode", "why"), WAYS_OUT.values(), ids=WAYS_OUT)
def test_every_way_out_leaves_the_gains_of_before(happens, mode, why):
    rig = rig_of()
    if "derate" in why:
        happens(rig)
    tune(rig)
    rig.run(2.0)
    happens(rig)
    rig.run(0.2)
    assert rig.status.mode is mode
    assert rig.status.values["tuning"].startswith("given up: ")
    assert why in rig.status.values["tuning"]
    assert all(output.tuned is None for output in rig.outputs)
    assert rig.actuator._following.controller.gains == rig.actuator._config.controller
    if mode is Mode.OFF:
        assert not rig.bench.supply.output_on
    else:  # what flows then holds the wire, it is not that of the relay
        rig.run(5.0)
        assert abs(rig.output.estimate.displacement_m - rig.output.setpoint_m) < 0.05 * SHIPPED.wire.full_stroke_m


def test_what_the_relay_let_flow_does_not_flow_on():
    """In mid-heating: as a current to hold the wire with it is far too much."""
    rig = rig_of()
    tune(rig)
    bound_A = SHIPPED.controller.tuning_current * SHIPPED.supply.max_current
    while rig.output.command.current_A < 0.99 * bound_A:
        rig.step()
    rig.actuator.update(rig.config.replace({"controller.kp": 300.0}))
    assert rig.step().command.current_A < 0.5 * bound_A


def test_a_wire_that_the_current_does_not_move_is_given_up():
    rig = rig_of(controller__tuning_current=0.35)
    tune(rig)
    rig.run(32.0)
    assert rig.status.mode is Mode.HOLD
    assert "the wire swung 0 times" in rig.status.values["tuning"]


def test_a_wire_that_stress_keeps_from_the_middle_is_given_up():
    rig = rig_of(wire__max_stress=60e6, safety__stress_limit_fraction=0.5)
    done, sentence = rig.actuator.tune(rig.now_s)
    assert not done
    assert "heat and stress leave" in sentence
    rig = rig_of()
    tune(rig)
    rig.actuator.update(rig.config.replace({"safety.stress_limit_fraction": 0.2}))
    rig.run(2.0)
    assert "the wire is kept from the middle of its working range" in rig.status.values["tuning"]
    assert "stress_near_limit" in {limit for output in rig.outputs for limit in output.status.limits}


def test_refusals_say_why():
    rig = rig_of()
    rig.actuator.enable(rig.now_s, False)
    assert rig.actuator.tune(rig.now_s) == (False, "not tuned: the output is off; call ~/enable first")
    rig.step()
    rig.actuator.enable(rig.now_s, True)
    assert "where the wire is is not known yet" in rig.actuator.tune(rig.now_s)[1]
    rig.run(0.5)
    tune(rig)
    assert "being tuned already" in rig.actuator.tune(rig.now_s)[1]
    loaded = Rig(SHIPPED.to_mapping(), load=Weight(3.05))  # 95 % of max_stress
    loaded.enable()
    loaded.run(0.5)
    assert "let the wire cool, take load off" in loaded.actuator.tune(loaded.now_s)[1]


def test_no_tuning_begins_where_the_wire_is_not_known():
    rig = rig_of()
    assert rig.actuator.reset_estimator()[0]
    assert "where the wire is is not known yet" in rig.actuator.tune(rig.now_s)[1]
    rig.step()
    rig.reading_of = lambda r: dataclasses.replace(r, supply_voltage_V=1e-4, reference_voltage_V=1e-4)
    rig.step()
    assert "where the wire is is not known yet" in rig.actuator.tune(rig.now_s)[1]


@pytest.mark.parametrize(("times", "refused"), [(1.9, True), (2.1, False)])
def test_a_relay_wants_more_than_twice_the_bias(times, refused):
    supply = SHIPPED.supply
    bias_A = 0.1 * supply.max_current
    rig = rig_of(supply__bias_current=bias_A, controller__tuning_current=times * bias_A / supply.max_current)
    done, words = rig.actuator.tune(rig.now_s)
    assert done is not refused, words
    assert ("more than twice supply.bias_current is wanted" in words) is refused


@pytest.mark.parametrize(
    ("text", "after"),
    [
        ("a:\n  controller: {kp: 1.0, ki: 2} # mine\n", ("a:\n  # old\n  controller: {kd: 0.5, kp: 9.0, ki: 2} # "
                                                        "mine\n")),
        ("a:\n  controller:\n    ki: 3.0 # mine\n    kp: 1\n", ("a:\n  # old\n  controller:\n    kd: 0.5\n    ki: 3.0 "
                                                                "# "
                                                               "mine\n    kp: 9.0\n")),
    ],
)  # fmt: skip
def test_numbers_are_put_into_a_file_that_else_stays_as_it_is(text, after):
    assert with_values(text, "x.yaml", ("a", "controller"), {"kp": 9.0, "kd": 0.5}, "old") == after
