"""Strain from resistance as others do it: the literature's models, for comparison on the same logs.

Each is fitted on the determinate samples of the same calibration logs as the project's models.  As
published, all but the neural network know nothing of the load.
"""

from __future__ import annotations

import warnings
from typing import Protocol

import numpy as np
import scipy  # whose modules are loaded where they are first asked for: half of what a program takes to start
from numpy.polynomial import Polynomial

from sma_actuator.base.jit import jit
from sma_actuator.base.parameters import ConfigError
from sma_actuator.identify.fitters.fitting import LOSS_SCALE, Data
from sma_actuator.logs.experiments import Experiment


class Baseline(Protocol):
    """A way to get displacement from resistance."""

    name: str

    def fit(self, data: Data) -> None:
        """Learn from calibration logs."""

    def predict(self, experiment: Experiment) -> np.ndarray:
        """Displacement [m], shape (n,)."""


def _column(data: Data, name: str) -> np.ndarray:
    return np.concatenate([getattr(t, name) for t in data.experiments])


class PolynomialInResistance:
    """δ as a polynomial in R; of order 1 it is linear in the normalised resistance λ, ξ ≈ λ (2.16, 2.17)."""

    def __init__(self, order: int):
        self.order = order
        self.name = "linear in λ (2.16, 2.17)" if order == 1 else f"polynomial of order {order}"

    def fit(self, data: Data) -> None:
        """Least squares over both branches."""
        chosen = data.counts
        self._curve = Polynomial.fit(_column(data, "resistance_Ohm")[chosen], data.displacement_m[chosen], self.order)

    def predict(self, experiment: Experiment) -> np.ndarray:
        """The curve, held at its ends."""
        return self._curve(np.clip(experiment.resistance_Ohm, *self._curve.domain))


class TwoLines:
    """A line for heating and a line for cooling, switched by state (Meier et al.)."""

    name = "two lines, switched (Meier)"

    def fit(self, data: Data) -> None:
        """Least squares on each branch."""
        resistance_Ohm, heating = _column(data, "resistance_Ohm"), _column(data, "heating")
        self._lines = []
        for branch in (~heating, heating):
            chosen = data.counts & branch
            self._lines.append(Polynomial.fit(resistance_Ohm[chosen], data.displacement_m[chosen], 1))

    def predict(self, experiment: Experiment) -> np.ndarray:
        """The line of the present branch."""
        cooling, heating = (line(experiment.resistance_Ohm) for line in self._lines)
        return np.where(experiment.heating, heating, cooling)


@jit
def _duhem(x, start, alpha, f, g, out):
    """dy = α |dx| (f(x) − y) + g(x) dx, f and g polynomials, lowest order first; exact decay over each step."""
    y = start
    out[0] = y
    for k in range(1, len(x)):
        step = x[k] - x[k - 1]
        middle = 0.5 * (x[k] + x[k - 1])
        target = 0.0
        for i in range(len(f) - 1, -1, -1):
            target = target * middle + f[i]
        slope = 0.0
        for i in range(len(g) - 1, -1, -1):
            slope = slope * middle + g[i]
        y = target + (y - target) * np.exp(-alpha * abs(step)) + slope * step
        out[k] = y


class Duhem:
    """Duhem differential hysteresis with polynomials of third and second order (Liu et al.)."""

    name = "Duhem hysteresis (Liu)"
    _F, _G = 4, 3  #: coefficients of f and g

    def fit(self, data: Data) -> None:
        """Robust least squares; starts on the mean curve."""
        chosen = data.counts
        resistance_Ohm = _column(data, "resistance_Ohm")
        low, high = np.percentile(resistance_Ohm[chosen], (1, 99))
        self._centre_Ohm, self._scale_Ohm = 0.5 * (low + high), 0.5 * (high - low)
        self._stroke_m = data.full_stroke_m
        mean = np.polynomial.polynomial.polyfit(
            (resistance_Ohm[chosen] - self._centre_Ohm) / self._scale_Ohm,
            data.displacement_m[chosen] / self._stroke_m,
            self._F - 1,
        )

        def residuals(theta):
            self._theta = theta
            error = (np.concatenate([self.predict(t) for t in data.experiments]) - data.displacement_m)[
                chosen
            ] / self._stroke_m
            return np.clip(np.nan_to_num(error, nan=10.0), -10.0, 10.0)

        slope = np.polynomial.polynomial.polyder(mean)
        starts = [np.concatenate([[np.log(rate)], mean, share * slope]) for rate in (1.0, 5.0) for share in (0.3, 0.9)]
        best = min(starts, key=lambda theta: np.abs(residuals(theta)).mean())
        self._theta = scipy.optimize.least_squares(
            residuals, best, loss="soft_l1", f_scale=LOSS_SCALE, x_scale="jac", max_nfev=80
        ).x

    def predict(self, experiment: Experiment) -> np.ndarray:
        """Begins on f."""
        x = (experiment.resistance_Ohm - self._centre_Ohm) / self._scale_Ohm
        alpha, f, g = np.exp(np.clip(self._theta[0], -10, 10)), self._theta[1 : 1 + self._F], self._theta[1 + self._F :]
        out = np.empty(len(x))
        _duhem(x, float(np.polynomial.polynomial.polyval(x[0], f)), alpha, f, g, out)
        return out * self._stroke_m


class NeuralNetwork:
    """A small multilayer perceptron on R, σ, branch, and R and σ where the branch last turned (scikit-learn)."""

    name = "neural network (MLP 16-16)"

    def fit(self, data: Data) -> None:
        """Trains on the determinate samples, seeded."""
        try:
            from sklearn.exceptions import ConvergenceWarning
            from sklearn.neural_network import MLPRegressor
            from sklearn.pipeline import make_pipeline
            from sklearn.preprocessing import StandardScaler
        except ModuleNotFoundError as error:
            raise ConfigError("the neural network needs the package 'scikit-learn' (extra 'baselines')") from error

        self._stroke_m = data.full_stroke_m
        features = np.concatenate([self._features(t) for t in data.experiments])[data.counts]
        network = MLPRegressor(
            hidden_layer_sizes=(16, 16), activation="tanh", alpha=1e-5, max_iter=400, random_state=0, solver="lbfgs"
        )
        self._network = make_pipeline(StandardScaler(), network)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ConvergenceWarning)  # max_iter is its early stopping
            self._network.fit(features, data.displacement_m[data.counts] / self._stroke_m)

    def predict(self, experiment: Experiment) -> np.ndarray:
        """Forward pass."""
        return self._network.predict(self._features(experiment)) * self._stroke_m

    @staticmethod
    def _features(experiment: Experiment) -> np.ndarray:
        turned = np.flatnonzero(np.diff(experiment.heating, prepend=experiment.heating[:1]))
        last = np.concatenate([[0], turned])[np.searchsorted(turned, np.arange(len(experiment.heating)), side="right")]
        return np.column_stack(
            (
                experiment.resistance_Ohm,
                experiment.stress_Pa,
                experiment.heating,
                experiment.resistance_Ohm[last],
                experiment.stress_Pa[last],
            )
        )


def all_baselines() -> list[Baseline]:
    """One of each, not yet fitted."""
    return [
        PolynomialInResistance(1),
        *(PolynomialInResistance(n) for n in (3, 4, 6)),
        TwoLines(),
        Duhem(),
        NeuralNetwork(),
    ]
