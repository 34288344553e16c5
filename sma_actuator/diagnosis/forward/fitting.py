"""Least squares of the forward model on whole runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from sma_actuator.base.errors import UserError
from sma_actuator.base.one_thread import one_thread

from .kernel import POSITION, simulate
from .runs import Run
from .wire import ForwardWire

#: The maker's temperatures hold to about this.
TOLERANCE_K = 10.0
#: The maker does not say at which stress they were taken; the stress of use, 172 MPa, is the most it can be.
STATED_AT_Pa = 172e6

#: Of the span that physics leaves a value: standard deviation about where its search begins, before any run.
KNOWN_WITHIN = 0.5

_SCREEN = 8  #: evaluations from each start before the best two go on


@dataclass(frozen=True)
class ForwardFree:
    """One value the fit may move: dotted name, unit, bounds and where it starts."""

    name: str
    unit: str
    lo: float
    hi: float
    start: float

    def at_bound(self, value: float) -> bool:
        """Whether the fit ended within 1 % of the span from a bound."""
        return min(value - self.lo, self.hi - value) < 0.01 * (self.hi - self.lo)


def plain_parameters(wire: ForwardWire) -> list[ForwardFree]:
    """What of the plain model is fitted: losses and capacity, latent heat, temperatures, strain.

    Specific heat: calorimetry gives 450 to 620 J/(kg·K), the maker 837, to 10 %.
    The four temperatures may lie a tolerance away from the maker's, and lower by the shift from
    the stress of use to none.  Widths take the place of the finish temperatures, so that a band
    cannot turn inside out.
    """
    w = wire.wire
    down = TOLERANCE_K + STATED_AT_Pa / w.stress_slope_Pa_K

    def around(name, value):
        return ForwardFree(name, "°C", value - down, value + TOLERANCE_K, value - 0.5 * down)

    return [
        ForwardFree("surroundings.heat_transfer_W_m2K", "W/(m²·K)", 10.0, 300.0, wire.surroundings.heat_transfer_W_m2K),
        ForwardFree(
            "wire.specific_heat_J_kgK", "J/(kg·K)", 450.0, 920.0, min(max(w.specific_heat_J_kgK, 460.0), 900.0)
        ),
        ForwardFree("wire.latent_heat_J_kg", "J/kg", 5e3, 35e3, min(max(w.latent_heat_J_kg, 6e3), 34e3)),
        around("wire.austenite_start_C", w.austenite_start_C),
        ForwardFree("austenite_width_K", "K", 2.0, 50.0, w.austenite_finish_C - w.austenite_start_C),
        around("wire.martensite_start_C", w.martensite_start_C),
        ForwardFree("martensite_width_K", "K", 2.0, 50.0, w.martensite_start_C - w.martensite_finish_C),
        ForwardFree("wire.transformation_strain", "", 0.002, 0.06, w.transformation_strain),
    ]


#: What is fitted as a width, as (start, width, finish, sign).
_WIDTHS = (
    ("wire.austenite_start_C", "austenite_width_K", "wire.austenite_finish_C", 1.0),
    ("wire.martensite_start_C", "martensite_width_K", "wire.martensite_finish_C", -1.0),
)


def apply(wire: ForwardWire, free: Sequence[ForwardFree], values: np.ndarray) -> ForwardWire:
    """The wire with fitted values in it."""
    found = {f.name: float(v) for f, v in zip(free, values, strict=True)}
    for start, width, finish, sign in _WIDTHS:
        if width in found:
            found[finish] = found[start] + sign * found.pop(width)
    return wire.with_values(found)


def predict(wire: ForwardWire, run: Run) -> np.ndarray:
    """Modelled position [m] above the run's zero, averaged over each step as :attr:`Run.coarse_position_m` is.

    A sample shows the position at the moment its duty begins to act, so those of a step lie, on
    average, a little before its middle; of a step of one sample, at its beginning.
    """
    ends = simulate(wire, run.coarse_duty, run.step_s)[:, POSITION]
    beginnings = np.concatenate([[0.0], ends[:-1]])
    return beginnings + 0.5 * (run.block - 1) / run.block * (ends - beginnings)


def residual_m(wire: ForwardWire, run: Run) -> np.ndarray:
    """Measured minus modelled."""
    return run.coarse_position_m - predict(wire, run)


@dataclass(frozen=True)
class ForwardFit:
    """A fitted wire: the values found, in the order of ``free``, and the RMS of what is left [m]."""

    wire: ForwardWire
    free: tuple[ForwardFree, ...]
    values: np.ndarray
    rms_m: float


@one_thread()
def fit(
    wire: ForwardWire,
    free: Sequence[ForwardFree],
    runs: Sequence[Run],
    starts: Sequence[np.ndarray],
    evaluations: int = 40,
    left_m: float = 0.0,
) -> ForwardFit:
    """The best of the fits from ``starts``; every run weighs the same, however long.

    ``left_m``: how far off a run may be that is explained, so that what was known before counts too; 0: it does not.
    """
    lo, hi = np.array([f.lo for f in free]), np.array([f.hi for f in free])
    span = hi - lo
    weights = [1.0 / np.sqrt(len(run.coarse_duty) * len(runs)) for run in runs]
    usual = (np.array([f.start for f in free]) - lo) / span

    def wrong(x):
        candidate = apply(wire, free, lo + span * np.clip(x, 0.0, 1.0))
        out = [w * residual_m(candidate, run) for w, run in zip(weights, runs, strict=True)]
        known = left_m / KNOWN_WITHIN / np.sqrt(len(runs)) * (x - usual)
        return 1e3 * np.concatenate([*out, known])

    def go(x, most):
        return least_squares(
            wrong, x, bounds=(0.0, 1.0), diff_step=1e-4, max_nfev=most, xtol=1e-5, ftol=1e-5, gtol=1e-9
        )

    begins = [np.clip((np.asarray(start) - lo) / span, 1e-3, 1.0 - 1e-3) for start in starts]
    if len(begins) > 2:  # only the best two of a few steps go to the end
        begins = [found.x for found in sorted((go(x, _SCREEN) for x in begins), key=lambda found: found.cost)[:2]]
    best = min((go(x, evaluations) for x in begins), key=lambda found: found.cost, default=None)
    if best is None or not np.isfinite(best.cost):
        raise UserError("the forward model cannot be fitted: it gives no finite position at any start")
    values = lo + span * best.x
    of_runs = 1e-3 * best.fun[: -len(free)]
    return ForwardFit(apply(wire, free, values), tuple(free), values, float(np.sqrt(np.sum(of_runs**2))))


def fit_for_new_runs(
    wire: ForwardWire,
    free: Sequence[ForwardFree],
    runs: Sequence[Run],
    starts: Sequence[np.ndarray],
    evaluations: int,
) -> ForwardFit:
    """The likeliest values by the runs and by what was known before them.

    Few runs leave much open: those without cooling all of martensite, steps all that a ramp would show; and a fit of
    them alone ends where it happens to.  A run is one reading as far off as the fit leaves it: the next one differs
    from it all along, not by the noise of its samples (Gelman et al., Bayesian Data Analysis, 3rd ed. 2013, ch. 5).
    """
    alone = fit(wire, free, runs, starts, evaluations)
    return fit(wire, free, runs, [alone.values], evaluations, alone.rms_m)


def plain_starts(free: Sequence[ForwardFree]) -> list[np.ndarray]:
    """A few starts: the maker's, wider and cooler bands with less and with more heat capacity, and a wire that little
    power makes hot (else the mean voltage, a fraction of the RMS, would find no way to move the slider at all)."""
    first = np.array([f.start for f in free])
    out = [first]
    for heat, width, cooler, loss in ((600.0, 25.0, 5.0, 1.0), (780.0, 15.0, -5.0, 1.0), (470.0, 30.0, 10.0, 0.2)):
        values = first.copy()
        for i, f in enumerate(free):
            if f.name.endswith("specific_heat_J_kgK"):
                values[i] = heat
            elif f.name.endswith("width_K"):
                values[i] = width
            elif f.name.endswith("start_C"):
                values[i] -= cooler
            elif f.name.endswith("heat_transfer_W_m2K"):
                values[i] *= loss
        out.append(values)
    return out
