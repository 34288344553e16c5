"""A log of pulses as an experiment, of a wire that was written down and not driven."""

from __future__ import annotations

import numpy as np

from sma_actuator.base.signals import Signals
from sma_actuator.logs.bench_log import BenchLog
from sma_actuator.logs.experiments import Experiment


def pulsed_log(time_s, driven, displacement_m, load_N, part_of=""):
    """Arrays of shape (n,); ``driven``: bool, where the current is on.  Resistance goes with the displacement alone."""
    resistance_Ohm = 5.0 + 200.0 * displacement_m
    current_A = np.where(driven, 0.3, 0.05)
    signals = Signals(
        time_s=time_s,
        current_A=current_A,
        resistance_Ohm=resistance_Ohm,
        power_W=current_A**2 * resistance_Ohm,
        load_N=np.full(len(time_s), load_N),
        stress_Pa=np.full(len(time_s), load_N * 5e7),
        reference_displacement_m=displacement_m,
    )
    cycle = np.cumsum(np.diff(driven, prepend=False) & driven)
    return Experiment(BenchLog({}, {}), "pulses", signals, driven, driven, cycle, part_of)
