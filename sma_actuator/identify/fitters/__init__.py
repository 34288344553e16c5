"""What fits a strain model to logs, for every ``model.type``.

Another package registers one with ``FITTERS.register("its model.type")(Fitter(function))``, in a module
that its entry point in the group ``sma_actuator.fitters`` names; the model itself then needs nothing of
this room.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sma_actuator.base.registry import Registry
from sma_actuator.config import BenchConfig
from sma_actuator.identify.ranges import distinct_stresses, full_cycles
from sma_actuator.identify.verdict.unseen import Unseen
from sma_actuator.logs.experiments import Experiment, IdentificationError

from .flexinol import FlexinolFit, fit_appendix_c, fit_joint
from .furukawa import fit_furukawa
from .normalised import fit_furukawa_normalised, flexinol_normalised
from .whole_range import beside_the_thesis, fit_whole_range

METHODS = ("joint", "appendix-c")
Progress = Callable[[float], None]


@dataclass(frozen=True, slots=True)
class Asked:
    """How a fit is wanted."""

    method: str  #: one of METHODS
    variant: str  #: of the Ni-Ti-Cu model
    order: int | None  #: of the polynomials in stress; None: chosen on held-out cycles
    progress: Progress = lambda _fraction: None


@dataclass(frozen=True, slots=True)
class Fitted:
    """What a fit found."""

    coefficients: Any  #: the section ``model``
    samples: dict[str, np.ndarray] = field(default_factory=dict)  #: bootstrap, (samples, coefficients) of every field
    how: Any = None  #: how it was found, for the page
    notes: list[str] = field(default_factory=list)  #: what the user should know
    #: How it does on cycles that its fits have not seen; None: nobody looked.
    unseen: Unseen | None = None
    bounds: list[str] = field(default_factory=list)  #: a sentence for every bound that binds
    beside: str = ""  #: how it compares with the thesis's model of the alloy
    rather: bool = False  #: whether that is the better one for these logs


@dataclass(frozen=True, slots=True)
class Fitter:
    """A function that fits, and what it can do.  It raises IdentificationError naming what the logs lack."""

    fit: Callable[[Sequence[Experiment], BenchConfig, Asked], Fitted]  #: of the logs of a bench
    methods: tuple[str, ...] = ("joint",)
    any_size: bool = False  #: of logs of wires of several sizes, each rewritten as one of the same wire
    remembers: bool = False  #: the model knows the wire's past: a stretch of a log goes on from the one before
    extended: bool = True  #: identification ends with the effects that the model lacks on its own logs


#: The fitter of each ``model.type``.
FITTERS: Registry[Fitter] = Registry("fitter", "sma_actuator.fitters")


def _found(experiments: Sequence[Experiment], bench: BenchConfig, asked: Asked) -> FlexinolFit:
    if asked.method == "appendix-c":
        highest = min(2, max(distinct_stresses(full_cycles(experiments)) - 1, 0))
        return fit_appendix_c(experiments, bench.wire, highest if asked.order is None else asked.order)
    return fit_joint(
        experiments, bench.wire, None if asked.order is None else (asked.order, asked.order), asked.progress
    )


def _flexinol(experiments: Sequence[Experiment], bench: BenchConfig, asked: Asked) -> Fitted:
    found = _found(experiments, bench, asked)
    return Fitted(found.coefficients, found.samples, found, unseen=found.unseen, bounds=found.bounds)


def _flexinol_normalised(experiments: Sequence[Experiment], bench: BenchConfig, asked: Asked) -> Fitted:
    found = _found(experiments, bench, asked)
    coefficients, samples = flexinol_normalised(found, experiments, bench.wire)
    return Fitted(
        coefficients,
        samples,
        found,
        _one_size(experiments),
        unseen=found.unseen,
        bounds=found.bounds,
    )


def _furukawa(experiments: Sequence[Experiment], bench: BenchConfig, asked: Asked) -> Fitted:
    found = fit_furukawa(experiments, bench.wire, asked.variant, asked.order, asked.progress)
    return Fitted(found.coefficients, found.samples, found, unseen=found.unseen, bounds=found.bounds)


def _furukawa_normalised(experiments: Sequence[Experiment], bench: BenchConfig, asked: Asked) -> Fitted:
    coefficients, samples = fit_furukawa_normalised(experiments, bench.wire, asked.order)
    return Fitted(coefficients, samples, notes=_one_size(experiments))


def _one_size(experiments: Sequence[Experiment]) -> list[str]:
    """A sentence where a model for any size was fitted on one."""
    said = {(w.get("length_m"), w.get("diameter_m")) for w in (t.log.metadata.get("wire", {}) for t in experiments)}
    if len(said) > 1:
        return []
    return [
        (
            "every log is of a wire of the same size, so nothing says that this model holds for another; logs of at "
            "least two lengths or diameters would (each with its wire in the JSON file beside it)"
        )
    ]


def _whole_range(experiments: Sequence[Experiment], bench: BenchConfig, asked: Asked) -> Fitted:
    found = fit_whole_range(experiments, bench, asked.progress)
    fit_thesis = _flexinol if bench.wire.alloy == "ni-ti" else _furukawa
    rather = False
    try:
        thesis = fit_thesis(experiments, bench, Asked("joint", asked.variant, asked.order)).coefficients.build(
            bench.wire
        )
        rather, beside = beside_the_thesis(experiments, thesis, found, bench.wire.full_stroke_m)
    except IdentificationError as error:
        beside = f"take whole_range: there is no model of the thesis to compare with ({error})"
    return Fitted(
        found.coefficients,
        how=found,
        unseen=found.unseen,
        bounds=found.bounds,
        beside=beside,
        rather=rather,
    )


FITTERS.register("flexinol")(Fitter(_flexinol, METHODS))
FITTERS.register("flexinol_normalised")(Fitter(_flexinol_normalised, METHODS, any_size=True, extended=False))
FITTERS.register("furukawa")(Fitter(_furukawa))
FITTERS.register("furukawa_normalised")(Fitter(_furukawa_normalised, any_size=True, extended=False))
FITTERS.register("whole_range")(Fitter(_whole_range, remembers=True, extended=False))  # what is left is learned already
