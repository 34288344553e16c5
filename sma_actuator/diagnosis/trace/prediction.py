"""What a model with some effects predicts of a log: what its chain makes of the readings, and what the reference sensor
then shows of where the wire is, and not of where its model has it.

What follows the wire with a memory (play, a lag, a filter) follows it through the errors that its model is known to
make.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sma_actuator.base.remembered import Remembered
from sma_actuator.config import Config
from sma_actuator.estimation.chain import Chain, Judged
from sma_actuator.estimation.effects import Effect
from sma_actuator.estimation.effects.frame import Frame, Place

AFTER_THE_MODEL = ("at_displacement", "shown")  #: stages of the chain
SMOOTHED_s = 0.3  #: within which a wire does not go to and fro


@dataclass(frozen=True, slots=True)
class Prediction:
    """A model with effects on one log, arrays of shape (n,)."""

    shown_m: np.ndarray  #: displacement that the reference sensor should show
    model_m: np.ndarray  #: displacement of the strain model alone
    sensor_m: np.ndarray  #: what it should show beyond what the load pulls at
    beside_m: np.ndarray  #: how much further than the wire it should show the joint, where the wire is as expected
    expected_m: np.ndarray  #: residual that is expected, of the samples that are compared
    heating: np.ndarray
    resistance_Ohm: np.ndarray  #: as the strain model sees it
    power_W: np.ndarray
    heat_W: np.ndarray  #: what of it the calibration's heat balance sees
    stress_Pa: np.ndarray
    elapsed_s: np.ndarray
    before_s: float  #: how long the sessions before this one lasted


@dataclass(frozen=True, slots=True)
class Where:
    """Where the wire is on a log, as far as is known: the model's displacement with the residual that is expected
    there.

    What follows it with a memory follows the wire and not the model.
    """

    chain: Chain
    place: Place
    found: Judged
    expected_m: np.ndarray

    def shown_beside_the_model_m(self) -> np.ndarray:
        """What the reference sensor shows of the expected residual."""
        if not any(hasattr(effect, stage) for effect in self.chain.effects for stage in AFTER_THE_MODEL):
            return self.expected_m
        model_m = self.found.model_m
        # A model has nothing but the resistance to tell when the wire turns, and near its ends that is late.
        turns = dataclasses.replace(self, place=dataclasses.replace(self.place, resistance_range_Ohm=math.nan))
        return turns._through(model_m + self.expected_m, steady=True) - self._through(model_m)

    def beyond_the_load_m(self) -> np.ndarray:
        """How much further than where the load pulls the sensor shows the joint."""
        true_m = self.found.model_m + self.expected_m
        return self._through(true_m, steady=True, beyond_the_load=True) - true_m

    def predicted(self, kept: np.ndarray | slice, compared: np.ndarray) -> Prediction:
        """What all this predicts of the samples ``kept`` of the log; ``compared``: those that a residual is made of."""
        p, shown_beside_m = self.found, self.shown_beside_the_model_m()
        return Prediction(
            shown_m=p.shown_m[kept],
            model_m=p.model_m[kept],
            sensor_m=self.beyond_the_load_m()[kept],
            beside_m=(p.shown_m - p.model_m + shown_beside_m - self.expected_m)[kept],
            expected_m=shown_beside_m[compared],
            heating=p.branch[kept].astype(bool),
            resistance_Ohm=p.resistance_Ohm[kept],
            power_W=p.signals.power_W[kept],
            heat_W=p.heat_W[kept],
            stress_Pa=p.signals.stress_Pa[kept],
            elapsed_s=p.elapsed_s[kept],
            before_s=p.before_s,
        )

    def _through(self, displacement_m: np.ndarray, steady: bool = False, beyond_the_load: bool = False) -> np.ndarray:
        """What the sensor shows of a displacement; ``beyond_the_load``: by what comes after the place that the load
        pulls at.

        ``steady``: what lies behind the load follows the wire, and not the noise of the resistance that tells where the
        wire is: a wire at rest leaves the play as it is, and noise would take it up.
        """
        acts = [
            (getattr(effect, stage), np.full(effect.STATES, np.nan), steady and effect.BEHIND_THE_LOAD)
            for stage in AFTER_THE_MODEL
            for effect in self.chain.effects
            if hasattr(effect, stage) and (stage == "shown" or effect.BEHIND_THE_LOAD or not beyond_the_load)
        ]
        if not acts:
            return displacement_m
        found = self.found
        frame = Frame.of(found.signals, float(found.time_s[0] - found.elapsed_s[0]), found.before_s)
        frame.heating, frame.cycles = found.branch.astype(bool), np.ones(len(displacement_m))
        frame.displacement_m = displacement_m.copy()
        for act, state, steadily in acts:
            noise_m = frame.displacement_m - smooth(frame.displacement_m, self._period_s) if steadily else 0.0
            frame.displacement_m = frame.displacement_m - noise_m
            act(frame, state, self.place)
            frame.displacement_m = frame.displacement_m + noise_m
        return frame.displacement_m

    @property
    def _period_s(self) -> float:
        return float(np.median(np.diff(self.found.time_s)))


def smooth(values: np.ndarray, period_s: float) -> np.ndarray:
    """Running mean over SMOOTHED_s of n values that are so far apart."""
    n = max(1, round(SMOOTHED_s / period_s))
    return np.convolve(np.pad(values, (n // 2, n - 1 - n // 2), mode="edge"), np.full(n, 1.0 / n), mode="valid")


class FollowedAnew(Chain):
    """A chain that is asked for whole logs alone, each from the beginning of its loop.

    Most steps of a fit leave the wire's readings as they were, and with them what branch and strain model make of
    these, which is remembered.
    """

    def __init__(self, config: Config, effects: Mapping[str, Effect], remembered: Remembered):
        super().__init__(config, effects)
        self._remembered = remembered

    def _follow(self, *readings: np.ndarray) -> tuple[np.ndarray, ...]:
        if self._started:
            raise ValueError("a log is followed from its beginning: forget the loop before it")
        follow = super()._follow
        found = self._remembered.of(lambda: follow(*readings), *readings)
        self._started = True
        return found
