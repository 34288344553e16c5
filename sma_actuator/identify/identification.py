"""Logs in, a complete parameter file out."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sma_actuator.base.one_thread import one_thread
from sma_actuator.base.parameters import ConfigError, to_mapping
from sma_actuator.calibration.learning import calibration_of
from sma_actuator.calibration.training import words_of
from sma_actuator.config import BenchConfig, Config, bench_from_mapping
from sma_actuator.derived import Derived, derived, with_derived, without_derived
from sma_actuator.estimation.chain import stresses_inside_Pa
from sma_actuator.estimation.models.thesis import wrong_alloy
from sma_actuator.logs.bench_log import BenchLog, averaged
from sma_actuator.logs.experiments import Experiment, IdentificationError
from sma_actuator.logs.kinds import LEFT_OUT, MANY, PARTIAL, make_experiments, usable_logs
from sma_actuator.logs.sense import EXPANDS, counts_contraction
from sma_actuator.logs.static import STATIC

from .fatigue import Fatigue, fit_fatigue
from .fitters import FITTERS, METHODS, Asked, Fitter, Progress
from .fitters.fitting import predict
from .fitters.normalised import as_one_wire
from .measured import lowest_current_A, measured
from .ranges import MARGIN, check_width, distinct_stresses, shortest_m, shortest_seen_m, without_misjudged
from .verdict import Verdict, judge
from .verdict.errors import LogError, log_errors
from .verdict.unseen import unseen_of

WHOLE_RANGE = "whole_range"
#: Model of the thesis for each alloy.
THESIS_MODEL = {"ni-ti": "flexinol", "ni-ti-cu": "furukawa"}
_COMPARED = ("thermal.heat_loss", "estimator.thermal_time_constant")
_FAR = 1.6  #: factor by which a parameter that is given may be off what was measured without a word


@dataclass(frozen=True, slots=True)
class Identification:
    """A calibrated model, and how good it is."""

    mapping: dict[str, Any]  #: the bench's parameters with the model in them: what the node runs on
    config: Config  #: the same, checked
    intervals: dict[str, list[tuple[float, float]]]  #: 95 % of every coefficient, by bootstrap over cycles
    errors: list[LogError]  #: of the logs it was fitted on
    fit: Any  #: how it was found, as its fitter has it
    experiments: tuple[Experiment, ...]
    fatigue: Fatigue | None = None
    notes: list[str] = field(default_factory=list)  #: what the user should know
    reasons: Mapping[str, str] = field(default_factory=dict)  #: of parameters that the logs told, by dotted name
    verdict: Verdict = field(kw_only=True)  #: what it is good for
    bounds: list[str] = field(default_factory=list, kw_only=True)  #: a sentence for every bound that binds
    beside: str = field(default="", kw_only=True)  #: how it compares with the thesis's model of the alloy
    rather: bool = field(default=False, kw_only=True)  #: whether that is the better one for these logs
    chosen: str = field(default="", kw_only=True)  #: why it is this model, where nobody asked for one


def identify_best(
    logs: Sequence[BenchLog], config_mapping: Mapping[str, Any], progress: Progress = lambda fraction: None
) -> Identification:
    """Fit the best model that the logs allow: the whole range's, or the thesis's where that cannot be or is worse.

    ``chosen`` of the result says which and why.  Raises what :func:`identify` raises.
    """
    thesis = THESIS_MODEL[bench_from_mapping(with_derived(config_mapping)).wire.alloy]
    try:
        found = identify(logs, config_mapping, WHOLE_RANGE, progress=progress)
        if not found.rather:
            return dataclasses.replace(found, chosen=found.beside)
        why = found.beside
    except IdentificationError as error:
        why = str(error)
    return dataclasses.replace(identify(logs, config_mapping, thesis, progress=progress), chosen=f"{thesis}: {why}")


@one_thread()
def identify(
    logs: Sequence[BenchLog],
    config_mapping: Mapping[str, Any],
    model_type: str,
    method: str = "joint",
    variant: str = "average",
    order: int | None = None,
    progress: Progress = lambda fraction: None,
) -> Identification:
    """Fit a model of ``model_type`` on bench logs.

    ``config_mapping`` holds the bench's parameters (a model in it is replaced), at least the wire: what drives a
    wire need not be there, and what the logs tell of it is taken from them.  ``order`` of the
    stress polynomials; None: chosen on held-out cycles (appendix C: 2).  ``variant`` of the
    Ni-Ti-Cu model.  Raises IdentificationError naming what the logs lack, BenchLogError, ConfigError.
    """
    fitter = _fitter(model_type, method)
    notes: list[str] = []
    ready = _ready(logs, config_mapping, model_type, fitter, notes)
    mapping, bench, experiments = ready.mapping, ready.bench, ready.experiments
    fitted = fitter.fit(experiments, bench, Asked(method, variant, order, progress))
    notes += ready.at_odds + list(fitted.notes)
    followed = _follow_anew(mapping, ready.follows)
    mapping["model"] = {"type": model_type, **to_mapping(fitted.coefficients)}
    _, known = calibrated(mapping, experiments, at_rest=not fitter.any_size)
    followed = _follow_anew(_without(mapping, followed), list(followed))  # gains follow from the calibration too
    config, reasons = Config.for_tools(mapping), ready.reasons | followed
    notes += known
    if config.calibration.training.changed:
        notes.append(words_of(config.calibration.training.changed, bench.wire.full_stroke_m))
    model = config.model.build(bench.wire)
    full_stroke_m, unseen = bench.wire.full_stroke_m, fitted.unseen
    seen_too = unseen is None or any(STATIC in t.log.metadata for t in experiments)
    replayed = unseen_of(experiments, predict(model, experiments), full_stroke_m)
    fatigue = fit_fatigue(ready.fatigued) if ready.fatigued else None
    return Identification(
        mapping=mapping,
        config=config,
        intervals={name: _interval(draws) for name, draws in fitted.samples.items()},
        errors=log_errors(model, experiments, model.displacement_range_m, bench.wire.full_stroke_m),
        fit=fitted.how,
        experiments=tuple(experiments),
        fatigue=fatigue,
        notes=notes + _said_of_cycles(experiments),
        reasons=reasons,
        verdict=judge(
            replayed if unseen is None else unseen,
            experiments,
            model.displacement_range_m,
            full_stroke_m,
            model_type=model_type,
            seen_too=seen_too,
            replayed=replayed,
            bounds=fitted.bounds,
            foreign_loads_N=foreign_loads_N(experiments, config),
        ),
        bounds=fitted.bounds,
        beside=fitted.beside,
        rather=fitted.rather,
    )


@dataclass(frozen=True, slots=True)
class _Ready:
    """Logs and bench as a model is fitted on them."""

    mapping: dict[str, Any]  #: the bench's parameters, without a model
    bench: BenchConfig  #: the same, checked
    experiments: list[Experiment]
    fatigued: list[Experiment]  #: of many cycles, which are not fitted
    follows: list[str]  #: names of parameters that follow from others, and are to once more
    reasons: dict[str, str]  #: of parameters that the logs told, by dotted name
    at_odds: list[str]  #: a sentence for each that is given and far from what they tell


def _ready(
    logs: Sequence[BenchLog], config_mapping: Mapping[str, Any], model_type: str, fitter: Fitter, notes: list[str]
) -> _Ready:
    """What is fitted, with what the logs tell of the bench; adds to ``notes`` what of them was left out."""
    logs = [averaged(log) for log in logs]
    mapping, follows = without_derived(config_mapping)
    for stale in ("effects", "calibration", "model"):
        mapping.pop(stale, None)
    bench = bench_from_mapping(with_derived(mapping))
    # Before the fit: a model of another alloy would be found after minutes, or fit badly first.
    if wrong := wrong_alloy(model_type, bench.wire):
        raise ConfigError(wrong)
    if "bias_current" not in mapping.get("supply", {}) and math.isfinite(lowest_A := lowest_current_A(logs, bench)):
        mapping.setdefault("supply", {})["bias_current"] = lowest_A
        bench = bench_from_mapping(with_derived(mapping))
    if not fitter.any_size:
        logs = usable_logs(logs, bench, notes.append)
    everything = (
        as_one_wire(logs, with_derived(mapping)) if fitter.any_size else make_experiments(logs, bench, fitter.remembers)
    )
    _refuse_still(everything)
    _refuse_contraction(everything, bench.wire.strain_length_m, notes.append)
    everything = without_misjudged(everything, notes.append)
    reasons: dict[str, str] = {}
    at_odds: list[str] = []
    if not fitter.any_size:
        reasons, at_odds = _add_measured(mapping, measured(everything, mapping, bench))
        if reasons:
            bench = bench_from_mapping(with_derived(mapping))
            everything = without_misjudged(make_experiments(logs, bench, fitter.remembers))
    fatigued = [t for t in everything if t.kind == MANY]
    experiments = [t for t in everything if t.kind != MANY]
    return _Ready(mapping, bench, experiments, fatigued, follows, reasons, at_odds)


def calibrated(
    mapping: dict[str, Any], experiments: Sequence[Experiment], at_rest: bool = True
) -> tuple[Config, list[str]]:
    """Put into ``mapping`` what its model looks like on its own logs, and end its working range where the model sees
    the wire end; the whole, checked, and what the user should know of that.

    ``at_rest``: see :func:`calibration_of`.
    """
    notes = _within_what_is_seen(mapping, experiments)
    mapping["calibration"] = to_mapping(calibration_of(experiments, Config.for_tools(mapping), at_rest))
    return Config.for_tools(mapping), notes


def _said_of_cycles(experiments: Sequence[Experiment]) -> list[str]:
    """What the user should know of how the logs' cycles counted."""
    out = []
    if not any(t.kind == PARTIAL for t in experiments):
        out.append(
            "all logs count as full cycles, since in most of them the wire rests at both ends and none of that load "
            "goes further: minor loops, and with them the transition, rest on these alone"
        )
    return out + [
        f"{t.name}: fitted on {t.cycle[-1]} of its {t.cycle[-1] + t.log.metadata[LEFT_OUT]} full cycles, which repeat "
        f"each other"
        for t in experiments
        if LEFT_OUT in t.log.metadata
    ]


def foreign_loads_N(experiments: Sequence[Experiment], config: Config) -> tuple[float, float] | None:
    """Below and above which load the estimate says that it is outside its calibration, where all logs are of one; else
    None."""
    if distinct_stresses(experiments) != 1:
        return None
    low_Pa, high_Pa = stresses_inside_Pa(config.model.build(config.wire).stress_range_Pa)
    return low_Pa * config.wire.area_m2, high_Pa * config.wire.area_m2


def _refuse_still(experiments: Sequence[Experiment]) -> None:
    """Raise IdentificationError where no log shows that anything moves."""
    if experiments and not any(_moved_m(t) > 0.0 for t in experiments):
        names = ", ".join(dict.fromkeys(t.part_of or t.log.source for t in experiments))
        raise IdentificationError(
            f"{names}: the displacement does not move; see whether the sensor is connected, and whether that is its "
            "column"
        )


def _refuse_contraction(experiments: Sequence[Experiment], length_m: float, say: Callable[[str], None]) -> None:
    """Raise IdentificationError where the displacement counts contraction: the model would ask for heat where it should
    cool.

    All logs are of one sensor: what those say in which it moved more counts, and of others ``say`` is told.  A log in
    which a wire was held back from contracting says nothing: it expands with its heat.
    """
    turned = [
        t
        for t in experiments
        if _moved_m(t) > EXPANDS * length_m
        and counts_contraction(t.resistance_Ohm, t.signals.current_A, t.displacement_m)
    ]
    if not turned:
        return
    sources = dict.fromkeys(t.part_of or t.log.source for t in turned)
    names = ", ".join(sources) if len(turned) < len(experiments) or len(sources) == 1 else f"all {len(sources)} logs"
    grows = f"{names}: the displacement grows while the wire is heated"
    if 2.0 * sum(map(_moved_m, turned)) < sum(map(_moved_m, experiments)):
        say(f"{grows}, in the others it falls: held back by the heat limit, or of a sensor that is turned")
        return
    how = (
        "turn the signs of reference_sensor.slope and reference_sensor.offset in the bench file"
        if "displacement_m" not in turned[0].log
        else "turn it with a minus before its unit, as --unit displacement_m=-mm"
    )
    raise IdentificationError(
        f"{grows}, so it counts contraction, and extension is positive here; a node with a model of it would go to "
        f"full current. {how[0].upper()}{how[1:]}"
    )


def _moved_m(experiment: Experiment) -> float:
    """Between which places the wire was; 0 where none was measured."""
    known_m = experiment.displacement_m[np.isfinite(experiment.displacement_m)]
    return float(np.ptp(known_m)) if len(known_m) else 0.0


def _within_what_is_seen(mapping: dict[str, Any], experiments: Sequence[Experiment]) -> list[str]:
    """End the working range of ``mapping`` where the model sees the wire end; returns what the user should know."""
    if "displacement_range" not in mapping["model"]:
        return []
    config = Config.for_tools(mapping)
    full_stroke_m = config.wire.full_stroke_m
    low_m, high_m = mapping["model"]["displacement_range"]
    seen_m = shortest_seen_m(experiments, config)
    if seen_m <= low_m:
        return []
    check_width(seen_m, high_m, full_stroke_m)
    mapping["model"]["displacement_range"] = [seen_m, high_m]
    if seen_m <= low_m + MARGIN * full_stroke_m:
        return []
    by_itself = seen_m <= shortest_m(experiments) + 2.0 * MARGIN * full_stroke_m
    why = "it gets no shorter there" if by_itself else "its resistance has a minimum and rises again with temperature"
    return [
        (
            f"heated as far as it goes, the wire shows the model no less than {seen_m * 1e3:.2f} mm at some load: "
            f"{why}; the working range ends there, not at {low_m * 1e3:.2f} mm"
        )
    ]


def _add_measured(mapping: dict[str, Any], found: Mapping[str, Derived]) -> tuple[dict[str, str], list[str]]:
    """Put into ``mapping`` what it does not give of what was measured.

    Returns the reasons, by dotted name, and a sentence for what is given and far from what was measured.
    """
    reasons, at_odds = {}, []
    measured_surroundings = "heat_loss" not in mapping.get("thermal", {})
    for name, each in found.items():
        section, _, key = name.partition(".")
        inside = mapping.setdefault(section, {})
        if key not in inside:
            if name != "thermal.ambient_temperature" or measured_surroundings:
                inside[key] = each.value
                reasons[name] = each.why
        elif name in _COMPARED and abs(math.log(inside[key] / each.value)) > math.log(_FAR):
            at_odds.append(
                f"{name} is given as {inside[key]:g}, where these logs say {each.value:g} ({each.why}); leave it out "
                "of the bench file, and the measured one is used"
            )
    return reasons, at_odds


def _without(mapping: dict[str, Any], names: Iterable[str]) -> dict[str, Any]:
    """The same mapping, and no longer these parameters in it."""
    for name in names:
        section, _, key = name.partition(".")
        mapping[section].pop(key, None)
    return mapping


def _follow_anew(mapping: dict[str, Any], names: Sequence[str]) -> dict[str, str]:
    """Put in what ``init`` had derived, from what was measured meanwhile; returns the reasons, by dotted name."""
    reasons = {}
    for name, each in derived(mapping).items():
        section, _, key = name.partition(".")
        if name in names and key not in mapping.get(section, {}):
            mapping.setdefault(section, {})[key] = each.value
            reasons[name] = each.why
    return reasons


def _fitter(model_type: str, method: str) -> Fitter:
    """The fitter of a model.  Raises ConfigError where there is none, or none that fits so."""
    if model_type not in FITTERS:
        raise ConfigError(f"model: '{model_type}' is not one of {', '.join(FITTERS)}")
    if method not in METHODS:
        raise ConfigError(f"method: '{method}' is not one of {', '.join(METHODS)}")
    fitter = FITTERS[model_type]
    if method not in fitter.methods:
        able = ", ".join(name for name, each in FITTERS.items() if method in each.methods)
        raise ConfigError(f"method: {method} is not for {model_type}; it is for {able}")
    return fitter


def _interval(draws: np.ndarray) -> list[tuple[float, float]]:
    low, high = np.percentile(draws, (2.5, 97.5), axis=0)
    return [(float(a), float(b)) for a, b in zip(low, high, strict=True)]
