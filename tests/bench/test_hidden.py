"""Hidden effects change what they should, and only that."""

import functools

import numpy as np
import pytest

from sma_actuator.bench import Schedule, Spring, VirtualBench, Weight
from sma_actuator.bench.hidden import FOREIGN, TWINS, hidden_effects
from sma_actuator.bench.hidden.hiding import HiddenBench
from sma_actuator.plant.worlds import HOME, WORLDS

ALL = hidden_effects()
SESSION_s = 36.0
STRENGTH = {
    "lead_resistance": 0.1,
    "contact_drift": 0.2,
    "voltage_offset": 0.01,
    "reference_self_heating": 0.1,
    "shunt": 0.01,
    "self_heating": 5e-4,
    "ambient_temperature": 6.0,
    "thermal_expansion": 4e-5,
    "elastic_compliance": 3e-4,
    "fatigue": 2e-4,
    "creep": 3e-4,
    "minor_loop_memory": 5e-4,
    "rate": 0.1,
    "load_cell_drift": 0.2,
    "load_cell_gain": 0.1,
    "sense_resistance": 0.03,
    "load_cell_nonlinearity": 0.1,
    "slip": 5e-4,
    "backlash": 4e-4,
    "reference_lag": 0.2,
    "reference_gain": 0.05,
    "reference_nonlinearity": 2e-4,
    "reference_drift": 5e-4,
    "heat_loss": 0.3,
    "first_pulse_set": 2e-4,
    "current_feedthrough": 1e-3,
    "channel_delay": 0.3,
    "prior_wear": 3e-4,
    "draught": 0.3,
    "hum": 2e-4,
    "lvdt_nonlinearity": 2e-4,
    "contact_bounce": 0.2,
    "stick_slip": 3e-4,
    "thermo_voltage": 2e-4,
    "clock_skew": 0.3,
    "cross_talk": 0.02,
}
VOLTAGE, REFERENCE, LOAD, LVDT, AMBIENT = range(5)
#: Channels that an effect reaches, under a constant weight.  All others must stay as they are, bit by bit.
REACHES = {
    **dict.fromkeys(
        ("lead_resistance", "contact_drift", "voltage_offset", "contact_bounce", "thermo_voltage", "cross_talk"),
        frozenset({VOLTAGE}),
    ),
    **dict.fromkeys(("sense_resistance", "reference_self_heating"), frozenset({VOLTAGE, REFERENCE})),
    **dict.fromkeys(("load_cell_drift", "load_cell_gain", "load_cell_nonlinearity"), frozenset({LOAD})),
    **dict.fromkeys(
        (
            "thermal_expansion",
            "elastic_compliance",
            "creep",
            "minor_loop_memory",
            "rate",
            "slip",
            "backlash",
            "reference_lag",
            "reference_gain",
            "reference_nonlinearity",
            "reference_drift",
            "first_pulse_set",
            "current_feedthrough",
            "channel_delay",
            "hum",
            "lvdt_nonlinearity",
            "stick_slip",
            "clock_skew",
        ),
        frozenset({LVDT}),
    ),
    "self_heating": {VOLTAGE, LVDT},  # more resistance, more heat
    "shunt": {VOLTAGE, LVDT},
    "heat_loss": {VOLTAGE, LVDT},
    "draught": {VOLTAGE, LVDT},
    "fatigue": {VOLTAGE, LVDT},
    "prior_wear": {VOLTAGE, LVDT},
    "ambient_temperature": {VOLTAGE, LVDT, AMBIENT},
}


def drive(bench, seconds=SESSION_s):
    """Blocks of 50 samples, averaged, shape (n, 5), under full and incomplete pulses."""
    bench.supply.set_voltage(15.0)
    bench.supply.set_output(True)
    rows = []
    for k in range(round(seconds * 20)):
        t = k / 20
        hot = 1.0 < t < 6.0 or 15.0 < t < 17.0 or 18.5 < t < 20.5 or 22.0 < t < 27.0
        bench.supply.set_current(0.3 if hot else 0.05)
        bench.advance((k + 1) / 20)
        rows.append(bench.daq.block(50)[0].mean(axis=0))
    return np.array(rows)


@functools.cache
def plain(load="weight", seed=0):
    return drive(VirtualBench.from_name("flexinol", seed=seed, load=LOADS[load]))


#: Of others' kinetics, and of all that differs at once.
QUICK = ("lagoudas", "foreign")
LOADS = {
    "weight": Weight(0.98),
    "spring": Spring(300.0, 0.5),
    "steps": Schedule([(0.0, Weight(0.98)), (13.0, Weight(1.5)), (30.0, Weight(0.6))]),
}


@functools.cache
def hidden(load="weight", seed=0, seconds=SESSION_s, **effects):
    """What a session shows that was driven once for all tests that look at it: nobody may change it."""
    bench = HiddenBench.from_name("flexinol", seed=seed, load=LOADS[load], hidden=effects, session_s=SESSION_s)
    return drive(bench, seconds)


def displacement_m(rows):
    return rows[:, LVDT] / 10.0 * 0.315842 - 1.2195e-3


def load_N(rows):
    return rows[:, LOAD] * 12.7297 - 0.0598


def resistance_Ohm(rows):
    return (rows[:, VOLTAGE] - rows[:, REFERENCE]) / rows[:, REFERENCE] - 0.25


def test_every_effect_says_what_it_is():
    assert len(FOREIGN) >= 6 and not set(TWINS) & set(FOREIGN)
    assert set(STRENGTH) == set(REACHES) == set(ALL)
    for effect in ALL.values():
        assert effect.__doc__.endswith(".") and effect.unit and effect.where


@pytest.mark.parametrize("load", LOADS)
def test_strengths_of_zero_are_the_virtual_bench(load):
    assert np.array_equal(hidden(load, **dict.fromkeys(ALL, 0.0)), plain(load))


@pytest.mark.parametrize("again_s", [SESSION_s / 3, pytest.param(SESSION_s, marks=pytest.mark.long)])
@pytest.mark.parametrize("name", ALL)
def test_an_effect_reaches_its_channels_alone_and_repeats_itself(name, again_s):
    rows = hidden(**{name: STRENGTH[name]})
    changed = {int(i) for i in np.flatnonzero((rows != plain()).any(axis=0))}
    # Feedback through the resistance may move the last bit of the current.
    settled = np.abs(rows - plain()).max(axis=0) > 1e-9
    assert {int(i) for i in np.flatnonzero(settled)} == REACHES[name], changed
    again = hidden(seconds=again_s, **{name: STRENGTH[name]})
    assert np.array_equal(rows[: len(again)], again)


@pytest.mark.parametrize("name", ALL)
def test_a_weak_effect_is_weak(name):
    weak = 1e-9 * STRENGTH[name] if name not in ("rate", "reference_lag") else 1e-5
    rows = hidden("steps", seconds=20.0, **{name: weak})
    assert np.abs(rows - plain("steps")[: len(rows)])[:, :4].max() < 2e-3  # some units of the converter's last place


@functools.cache
def shown_m(world, *effect):
    """What the displacement sensor of a Ni-Ti-Cu wire shows [m]; ``effect``: its name and strength."""
    pulse_A = 0.8 if world.startswith("hot") else 0.6
    bench = HiddenBench.from_name(
        "furukawa", seed=0, load=Weight(1.5), physics=world, hidden=dict([effect] if effect else []), session_s=19.0
    )
    bench.supply.set_voltage(15.0)
    bench.supply.set_output(True)
    rows = []
    for k in range(190):
        bench.supply.set_current(pulse_A if 10 < k < 50 or 120 < k < 126 or 160 < k < 180 else 0.05)
        bench.advance((k + 1) / 10)
        rows.append(bench.daq.block(50)[0].mean(axis=0))
    return displacement_m(np.array(rows))


@pytest.mark.parametrize(
    "physics",
    [name if name in QUICK else pytest.param(name, marks=pytest.mark.long) for name in WORLDS if name != HOME],
)
@pytest.mark.parametrize("name", [n for n in TWINS if TWINS[n].where == "wire"])
def test_an_effect_in_the_wire_works_in_every_physics(name, physics):
    """It moves what the displacement sensor shows about as much as at home, with pulses that contract the wire alike.

    That needs more current the hotter a wire contracts: 0.6 s of 0.6 A contract it by half at home and not at all in
    `hot`, where they leave no minor loop to remember; 0.8 A contract it by a third there.
    """

    at_home, here = (np.abs(shown_m(world, name, STRENGTH[name]) - shown_m(world)).max() for world in (HOME, physics))
    assert at_home > 1e-5
    assert 0.15 * at_home < here < 6.0 * at_home


def test_what_was_drawn_depends_on_the_seed():
    assert not np.array_equal(
        hidden(seed=1, slip=5e-4)[:, LVDT] - plain(seed=1)[:, LVDT], hidden(slip=5e-4)[:, LVDT] - plain()[:, LVDT]
    )


def test_an_unknown_effect_is_refused():
    with pytest.raises(ValueError, match="'gremlins' is no hidden effect"):
        HiddenBench.from_name("flexinol", hidden={"gremlins": 1.0})


def test_leads_add_their_resistance_and_nothing_else():
    assert resistance_Ohm(hidden(lead_resistance=0.1))[1:] - resistance_Ohm(plain())[1:] == pytest.approx(0.1, abs=3e-3)
    drifted = resistance_Ohm(hidden(contact_drift=1.0)) - resistance_Ohm(plain())
    assert abs(drifted[1]) < 5e-3 and 0.1 < drifted[-1] < 0.4 and (np.diff(drifted[::40]) > 0).all()


def test_a_voltage_offset_counts_most_where_the_current_is_small():
    error = resistance_Ohm(hidden(voltage_offset=0.01)) - resistance_Ohm(plain())
    assert error[80] == pytest.approx(0.01 / 0.3, abs=3e-3)
    assert error[10] == pytest.approx(0.01 / 0.05, abs=2e-2)


def test_the_sense_resistor_warms_with_its_own_heat():
    rows, before = hidden(reference_self_heating=0.2), plain()
    share = rows[:, REFERENCE] / before[:, REFERENCE] - 1.0
    assert abs(share[10]) < 1e-3 and 1e-3 < share[115] <= 0.2 * 0.09 + 1e-3
    # What is too much is read at the wire and at the sense resistor alike: the wire seems to have less.
    assert resistance_Ohm(rows)[115] < resistance_Ohm(before)[115]


def test_a_sense_resistor_of_another_value_shows_another_current_and_leaves_the_wire_alone():
    rows, before = hidden(sense_resistance=0.03), plain()
    assert rows[115, REFERENCE] == pytest.approx(1.03 * before[115, REFERENCE], abs=1e-3)
    shown_Ohm, true_Ohm = resistance_Ohm(rows)[115], resistance_Ohm(before)[115]
    assert 1.03 * (shown_Ohm + 0.25) == pytest.approx(true_Ohm + 0.25, rel=2e-3)
    assert displacement_m(rows)[115] == pytest.approx(displacement_m(before)[115], abs=1e-6)


def test_a_shunt_takes_current_from_the_wire():
    bench = HiddenBench.from_name("flexinol", load=LOADS["weight"], hidden={"shunt": 0.02})
    rows = drive(bench, 5.0)
    truth = bench.truth
    assert rows[-1, REFERENCE] == pytest.approx(0.3, abs=1e-3)
    assert truth.power_W == pytest.approx(
        (0.3 / (1 + 0.02 * truth.resistance_Ohm)) ** 2 * truth.resistance_Ohm, rel=1e-3
    )
    assert resistance_Ohm(rows)[-1] == pytest.approx(truth.resistance_Ohm / (1 + 0.02 * truth.resistance_Ohm), abs=2e-2)


def test_the_load_cell_lies_and_the_load_does_not():
    for name in ("load_cell_gain", "load_cell_nonlinearity"):
        assert np.array_equal(displacement_m(hidden("spring", **{name: 0.1})), displacement_m(plain("spring")))
    assert load_N(hidden(load_cell_gain=0.1))[-1] == pytest.approx(1.078, abs=5e-3)
    assert load_N(hidden(load_cell_drift=0.2))[-1] == pytest.approx(1.18, abs=5e-3)


def test_a_wire_that_heats_up_more_shows_it_hot_and_not_cold():
    error = resistance_Ohm(hidden(self_heating=5e-4)) - resistance_Ohm(plain())
    assert abs(error[10]) < 0.03 and error[115] > 0.1


def test_the_surroundings_are_warmer_and_the_thermometer_knows():
    rows = hidden(ambient_temperature=6.0)
    assert 5.0 - 1.0 < rows[0, AMBIENT] - 22.0 < 8.0
    assert resistance_Ohm(rows)[15] < resistance_Ohm(plain())[15] - 0.01, "warmer, it rests with less martensite"


def test_expansion_follows_the_temperature():
    error = displacement_m(hidden(thermal_expansion=4e-5)) - displacement_m(plain())
    assert abs(error[10]) < 2e-5 and 1e-4 < error[115] < 4e-4


def test_the_mount_yields_with_the_load():
    error = displacement_m(hidden("steps", elastic_compliance=3e-4)) - displacement_m(plain("steps"))
    loads = load_N(plain("steps"))
    far_from_steps = np.r_[20:255, 265:595, 605:700]
    assert error[far_from_steps] == pytest.approx((3e-4 * loads)[far_from_steps], abs=1.5e-5)


@pytest.mark.parametrize("name, value", [("elastic_compliance", 3e-4), ("thermal_expansion", 2e-4), ("slip", 1e-3)])
def test_a_spring_holds_the_joint_and_not_the_wire(name, value):
    rows = hidden("spring", **{name: value})
    pulled_N = np.maximum(0.5 + 300.0 * (0.004 - displacement_m(rows)), 0.0)
    still = np.r_[15, 110:118, 280, 530:539, 700]
    assert load_N(rows)[still] == pytest.approx(pulled_N[still], abs=0.02)


def test_fatigue_goes_with_the_square_root_of_the_cycles_and_shrinks_the_stroke():
    """The hot end moves by the whole strength, the cold one by two fifths of it."""
    worn, fresh = hidden(fatigue=2e-4), plain()
    error = displacement_m(worn) - displacement_m(fresh)
    assert abs(error[:100]).max() < 1e-5  # no cycle is complete
    hot, cold = slice(500, 530), slice(700, 715)  # at the end of the last pulse, and after it
    cycles = np.array([2, 3, 4])  # the incomplete pulses may count
    moved = error[hot].mean() / (2e-4 * (np.sqrt(cycles) - 1.0))
    assert abs(moved - 1.0).min() < 0.1
    counted = cycles[abs(moved - 1.0).argmin()]
    assert error[cold].mean() == pytest.approx(0.4 * 2e-4 * (np.sqrt(counted + 1) - 1.0), rel=0.15)
    assert resistance_Ohm(worn)[-1] > resistance_Ohm(fresh)[-1]


def test_a_wire_worn_before_is_longer_from_the_first_reading_and_contracts_less_far():
    worn, fresh = hidden(prior_wear=3e-4), plain()
    error = displacement_m(worn) - displacement_m(fresh)
    hot, cold = error[500:530].mean(), error[5]  # at the end of the last pulse, and before the first
    assert hot == pytest.approx(3e-4, rel=0.15) and 0.2 * 3e-4 < cold < 0.65 * 3e-4
    assert error[700:715].mean() == pytest.approx(cold, rel=0.1)  # and no more comes
    assert resistance_Ohm(worn)[0] > resistance_Ohm(fresh)[0]


def test_creep_grows_under_load():
    error = displacement_m(hidden(creep=1e-3)) - displacement_m(plain())
    assert abs(error[0]) < 1e-5 and (np.diff(error[::60]) > 0).all() and error[-1] < 1e-3 * 0.98


def test_a_loop_that_turned_back_early_is_remembered_until_it_is_complete():
    error = np.abs(displacement_m(hidden(minor_loop_memory=5e-4)) - displacement_m(plain()))
    assert error[:290].max() < 5e-5 < error[340:450].max() and error[-1] < 5e-5


def test_rate_opens_the_loop_only_while_it_moves():
    error = np.abs(displacement_m(hidden(rate=0.1)) - displacement_m(plain()))
    assert error.max() > 1e-4 and error[110] < 1e-5 and error[-1] < 2e-5


def test_a_slip_shifts_from_then_on():
    rows = hidden(slip=5e-4)
    error = displacement_m(rows) - displacement_m(plain())
    jump = int(np.argmax(error > 2.5e-4))
    assert SESSION_s * 20 / 3 - 1 <= jump <= SESSION_s * 20 * 2 / 3 + 1
    assert np.abs(error[: jump - 1]).max() < 1e-5 and np.abs(error[jump + 1 :] - 5e-4).max() < 1e-5


def test_play_lets_the_sensor_wait_at_a_reversal():
    error = displacement_m(hidden(backlash=4e-4)) - displacement_m(plain())
    assert np.abs(error).max() == pytest.approx(2e-4, abs=2e-5)
    assert error[110] == pytest.approx(2e-4, abs=2e-5) and error[-1] == pytest.approx(-2e-4, abs=2e-5)


def test_the_reference_sensor_lies_in_its_three_ways():
    before = displacement_m(plain())
    assert displacement_m(hidden(reference_gain=0.05)) == pytest.approx(1.05 * before, abs=1e-5)
    drift = displacement_m(hidden(reference_drift=5e-4)) - before
    assert abs(drift[0]) < 2e-5 and drift[-1] == pytest.approx(5e-4, abs=2e-5)
    late = displacement_m(hidden(reference_lag=0.2))
    moving = slice(30, 110)
    assert (late[moving] - before[moving]).max() > 1e-4 and abs(late[-1] - before[-1]) < 1e-5


def test_the_first_full_pulse_leaves_the_wire_longer_once():
    error = displacement_m(hidden(first_pulse_set=2e-4)) - displacement_m(plain())
    assert np.abs(error[:20]).max() < 5e-6  # hardly anything has been transformed yet
    # The hot end of this wire keeps a tenth of its martensite; later pulses go hardly further and add hardly more.
    assert error[110] > 0.75 * 2e-4 and np.ptp(error[110:]) < 0.1 * error[110]


def test_what_feeds_through_steps_with_the_current():
    error = displacement_m(hidden(current_feedthrough=1e-3)) - displacement_m(plain())
    assert error[5] == pytest.approx(1e-3 * 0.05, abs=5e-6) and error[100] == pytest.approx(1e-3 * 0.3, abs=5e-6)
    jump = np.flatnonzero(np.abs(np.diff(error)) > 1e-4)
    assert 19 <= jump[0] <= 21 and np.abs(np.diff(error[25:115])).max() < 1e-5


def test_a_late_channel_shows_what_was():
    before, late = displacement_m(plain()), displacement_m(hidden(channel_delay=0.3))
    assert np.abs(late[6:] - before[:-6]).max() < 2e-5  # 0.3 s are six blocks of 50 ms
    assert np.abs(late - before).max() > 1e-4
