"""Two benches whose wires turn one joint against each other."""

from __future__ import annotations

import numpy as np

from sma_actuator.plant.joint import Joint, simulate_joint
from sma_actuator.plant.worlds import HOME

from .bench import Setup, STEP_s, VirtualBench, run_events
from .real import wire_of


class JointBench:
    """The joint between two wires, each with a supply and a DAQ of its own.  Either's ``advance`` advances both.

    It turns to positive angles where the first wire contracts.  What hangs on the wires is the joint: their own loads
    count no more.
    """

    def __init__(self, first: VirtualBench, second: VirtualBench, joint: Joint):
        self.benches: tuple[VirtualBench, ...] = (first, second)
        self.joint = joint
        self.angle_rad = 0.0
        self.torque_Nm = 0.0  #: from outside; may be set at any time
        self._at_zero_m = np.array(joint.at_zero_m)
        for bench in self.benches:
            bench.joint = self

    @classmethod
    def from_name(
        cls, name: str, joint: Joint, seed: int = 0, physics: str = HOME, ambient_C: float = 22.0
    ) -> JointBench:
        """A joint with two wires of that name; their noise has the seeds ``seed`` and ``seed + 1``."""
        wire = wire_of(name, physics)
        if wire.coil_diameter_m:
            raise ValueError(f"'{name}' is a coil; the joint of the bench takes straight wires")
        setups = [Setup(wire, load=joint.load(number), ambient_C=ambient_C) for number in range(2)]
        return cls(VirtualBench(setups[0], seed), VirtualBench(setups[1], seed + 1), joint)

    def advance(self, until_s: float) -> None:
        """Let the physics of both run to bench time ``until_s`` [s]."""
        run_events(self.benches, self._run, round(until_s / STEP_s))

    def _run(self, steps: int) -> None:
        for bench in self.benches:
            bench._set_inputs()
        rows = np.array([bench._row for bench in self.benches])
        first, second = ((b.constants, b._wire, b._inputs, b._ring) for b in self.benches)
        joint = self.joint
        self.angle_rad = simulate_joint(
            steps,
            STEP_s,
            self.angle_rad,
            self.torque_Nm,
            joint.radius_m,
            self._at_zero_m,
            joint.stiffness_N_m,
            joint.damping_Nms,
            first,
            second,
            rows,
        )
        for bench, row in zip(self.benches, rows, strict=True):
            bench._row = int(row)
            bench._count(steps)
