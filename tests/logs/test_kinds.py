"""What a log holds is seen in its data: without a label, cut together, in any order the same model comes out."""

import dataclasses
import shutil

import numpy as np
import pytest
import yaml
from characterised import identified, virtual_rig

from sma_actuator.characterise.plan import default_heat_current_A
from sma_actuator.characterise.programs import held_currents
from sma_actuator.config import bench_from_mapping
from sma_actuator.logs.bench_log import write_bench_log
from sma_actuator.logs.kinds import FULL, MANY, PARTIAL, make_experiments
from sma_actuator.plant.loads import Weight

LOADS = ("0.300N", "0.600N", "1.200N", "2.000N")


def model_of(flexinol, logs, out):
    found = identified(logs, flexinol.folder / "bench.yaml", out, "--no-extension")
    assert not any("count as full cycles" in note for note in found["notes"])
    return yaml.safe_load(out.read_text())["sma_actuator"]["ros__parameters"]["model"]


@pytest.fixture(scope="module")
def labelled(flexinol, tmp_path_factory):
    logs = sorted(flexinol.folder.glob("p*_*N.csv"))
    assert len(logs) == 8 and all(log.with_suffix(".json").exists() for log in logs)
    return model_of(flexinol, logs, tmp_path_factory.mktemp("labelled") / "model.yaml")


@pytest.mark.long
def test_logs_without_a_label_give_the_same_model(flexinol, labelled, tmp_path):
    folder = tmp_path / "bare"
    folder.mkdir()
    for i, log in enumerate(sorted(flexinol.folder.glob("p*_*N.csv"))):
        shutil.copy(log, folder / f"run{i}.csv")
    assert model_of(flexinol, [folder], tmp_path / "model.yaml") == labelled


def together(flexinol, words, gap_s=0.05):
    """One log of several, on one clock, without a label."""
    logs = [log for word in words for log in flexinol.only(word)]
    columns, start_s = {name: [] for name in logs[0].columns if name != "setpoint_m"}, 0.0
    for log in logs:
        for name, parts in columns.items():
            parts.append(log[name] - log["time_s"][0] + start_s if name == "time_s" else log[name])
        start_s = float(columns["time_s"][-1][-1]) + gap_s
    return dataclasses.replace(logs[0], columns={n: np.concatenate(v) for n, v in columns.items()}, metadata={})


@pytest.mark.parametrize(
    "words", [[f"pulses_{n}", f"partial_{n}"] for n in LOADS] + [[f"partial_{n}", f"pulses_{n}"] for n in LOADS]
)
def test_a_log_of_both_kinds_is_cut_where_they_meet(flexinol, words):
    experiments = make_experiments([together(flexinol, words)], bench_from_mapping(flexinol.mapping))
    assert [experiment.kind for experiment in experiments] == [
        {"pulses": FULL, "partial": PARTIAL}[w.split("_")[0]] for w in words
    ]
    separate = make_experiments([flexinol.only(word)[0] for word in words], bench_from_mapping(flexinol.mapping))
    assert [experiment.cycle[-1] for experiment in experiments] == [experiment.cycle[-1] for experiment in separate]


@pytest.mark.long  # that its parts are told apart where they meet, above
@pytest.mark.parametrize("gap_s", [0.05, 30.0], ids=["one after the other", "with pauses"])
def test_one_log_of_everything_gives_nearly_the_same_model(flexinol, labelled, tmp_path, gap_s):
    words = [f"{kind}_{load}" for load in LOADS for kind in ("pulses", "partial")]
    write_bench_log(tmp_path / "all.csv", together(flexinol, words, gap_s))
    model = model_of(flexinol, [tmp_path / "all.csv"], tmp_path / "model.yaml")
    assert model["displacement_range"] == pytest.approx(labelled["displacement_range"], abs=2e-5)
    for name in ("heating_slope", "heating_intercept", "cooling_slope", "cooling_intercept"):
        stress_Pa = np.array([16e6, 60e6, 110e6])
        ours, theirs = (np.polynomial.polynomial.polyval(stress_Pa, m[name]) for m in (model, labelled))
        np.testing.assert_allclose(ours, theirs, rtol=0.03)


@pytest.mark.long
def test_of_many_full_cycles_some_are_fitted_and_that_is_said(textbook, tmp_path, capsys):
    """Of a wire whose pulses end where they began: six times the same log is then one that goes on."""
    once = model_of(textbook, sorted(textbook.folder.glob("p*_*N.csv")), tmp_path / "once.yaml")
    for load in LOADS:
        write_bench_log(tmp_path / f"{load}.csv", together(textbook, [f"pulses_{load}"] * 6))
    logs = [*tmp_path.glob("*.csv"), *textbook.folder.glob("partial_*.csv")]
    model = model_of(textbook, logs, tmp_path / "model.yaml")
    assert "0.600N.csv: fitted on 8 of its 12 full cycles" in capsys.readouterr().err
    assert model["displacement_range"] == pytest.approx(once["displacement_range"], abs=2e-5)


def test_many_full_cycles_are_no_more_than_wear_only_beside_others_of_their_load(textbook):
    """Fifteen and more in a row repeat what another log of that load shows; of a load without one they are all that
    is known."""
    config = bench_from_mapping(textbook.mapping)
    many = [together(textbook, [f"pulses_{load}"] * 8) for load in LOADS[:2]]
    few = textbook.only(f"pulses_{LOADS[0]}")
    kinds = [t.kind for t in make_experiments([*many, *few], config, remembered=True)]
    assert kinds == [MANY, FULL, FULL]


def test_partial_cycles_that_start_cold_are_not_taken_for_full_ones(flexinol):
    bare = [dataclasses.replace(log, metadata={}) for log in flexinol.only("partial", "pulses_0.600N", "pulses_1.200N")]
    experiments = make_experiments(bare, bench_from_mapping(flexinol.mapping))
    assert {t.name: t.kind for t in experiments} == {t.name: t.name.split("_")[0] for t in experiments}


def test_weights_one_after_the_other_are_stretches_of_their_own(flexinol):
    words = [f"pulses_{load}" for load in LOADS]
    experiments = make_experiments([together(flexinol, words)], bench_from_mapping(flexinol.mapping))
    loads_N = [float(np.mean(experiment.signals.load_N)) for experiment in experiments]
    np.testing.assert_allclose(loads_N, [0.3, 0.6, 1.2, 2.0], atol=0.02)
    assert all(experiment.kind == FULL for experiment in experiments)


def test_held_currents_are_never_cut_since_each_stands_on_those_before_it(flexinol):
    _, rig, _ = virtual_rig("flexinol", load=Weight(2.1))
    bias_A, heat_A = rig.config.supply.bias_current, default_heat_current_A(rig.config)
    with rig.opened():
        log = rig.record(held_currents(np.sqrt(np.linspace(bias_A**2, heat_A**2, 6)), hold_s=5.0, cool_s=7.0))
    config = bench_from_mapping(flexinol.mapping)
    assert len(make_experiments([log], config)) > 1  # some of the steps look like full cycles
    (whole,) = make_experiments([dataclasses.replace(log, metadata={**log.metadata, "kind": "levels"})], config)
    assert whole.kind == PARTIAL and len(whole.signals.time_s) > 0.95 * len(log)
