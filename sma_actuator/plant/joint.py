"""A joint that two wires turn against each other: a pulley, and in series with each wire what gives (a tendon, a
spring).

The contraction of the first wire turns the joint to positive angles.  A wire and what is in series with it together
are as long as the pulley leaves them: ``δ + F / k = at_zero ∓ r θ``, or slack where the wire alone is longer.  So to
each wire the joint is a spring whose far end moves, and the kernels of a single wire serve for both.  The pulley has no
inertia: ``b dθ/dt = r (F_1 − F_2) + torque``.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

from sma_actuator.base.jit import jit

from . import physics
from .loads import Spring


@dataclass(frozen=True, slots=True)
class Joint:
    """The mechanism.  Raises ValueError, in a sentence, for one that cannot be."""

    radius_m: float
    at_zero_m: tuple[float, float]  #: displacement of each taut wire at angle zero, without tension
    stiffness_N_m: float = 2e4  #: of what is in series with each wire
    damping_Nms: float = 1e-3

    def __post_init__(self) -> None:
        for name, value in (
            ("radius", self.radius_m),
            ("stiffness", self.stiffness_N_m),
            ("damping", self.damping_Nms),
        ):
            if not 0.0 < value < inf:
                raise ValueError(f"{name} of the joint, {value:g}, is not a number above zero")

    def load(self, number: int) -> Spring:
        """What hangs on one of the wires at angle zero."""
        return Spring(self.stiffness_N_m, preload_N=0.0, preload_displacement_m=self.at_zero_m[number])


def parse_joint(text: str) -> Joint:
    """``RADIUS,DISPLACEMENT[,DISPLACEMENT]``: in metres; one displacement stands for both wires.  Raises ValueError."""
    try:
        radius_m, first_m, *rest = (float(v) for v in text.split(","))
        if len(rest) < 2:
            return Joint(radius_m, (first_m, rest[0] if rest else first_m))
    except ValueError as error:
        raise ValueError(f"'{text}' is no joint: {error}") from error
    raise ValueError(f"'{text}' is no joint: its radius and the displacement of the wires at angle zero are wanted")


@jit
def simulate_joint(
    steps, step_s, angle_rad, torque_Nm, radius_m, at_zero_m, stiffness_N_m, damping_Nms, first, second, rows
):
    """As :func:`.physics.simulate`, for two wires of one joint; the angle after the last step.

    ``first`` and ``second`` are constants, state, inputs and ring of a wire, ``rows`` (2,) where it goes on in its
    ring.  Each wire takes a step at the angle that stands, then the pulley turns to where their tensions balance.  That
    step is implicit in what gives least in a taut wire, so that it cannot overshoot, however stiff that is.  A wire
    transforms by its load of the step before, which on a stiff tendon would swing from step to step; so the mean of two
    is that load.
    """
    c_1, wire_1, inputs_1, ring_1 = first
    c_2, wire_2, inputs_2, ring_2 = second
    inputs_1[physics.STIFFNESS] = stiffness_N_m
    inputs_2[physics.STIFFNESS] = stiffness_N_m
    one = min(steps, 1)  # for a literal one numba would compile the whole physics of a wire once more
    for _ in range(steps):
        inputs_1[physics.SPRING_AT] = at_zero_m[0] - radius_m * angle_rad
        inputs_2[physics.SPRING_AT] = at_zero_m[1] + radius_m * angle_rad
        before_1, before_2 = wire_1.whole[physics.LOAD], wire_2.whole[physics.LOAD]
        rows[0] = physics.simulate(one, step_s, c_1, wire_1, inputs_1, ring_1, rows[0])
        rows[1] = physics.simulate(one, step_s, c_2, wire_2, inputs_2, ring_2, rows[1])
        load_1 = wire_1.whole[physics.LOAD] = 0.5 * (before_1 + wire_1.whole[physics.LOAD])
        load_2 = wire_2.whole[physics.LOAD] = 0.5 * (before_2 + wire_2.whole[physics.LOAD])
        taut = int(load_1 > 0.0) + int(load_2 > 0.0)
        stiffness_Nm = radius_m * radius_m * stiffness_N_m * taut
        angle_rad += (radius_m * (load_1 - load_2) + torque_Nm) * step_s / (damping_Nms + stiffness_Nm * step_s)
    return angle_rad
