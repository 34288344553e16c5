"""Two wires against each other on one joint: angle and co-contraction to a setpoint for each wire, and back.

Both wires lie around one pulley of radius ``r``, in series with what gives (a tendon, a spring).  Where they are taut

    δ_1 + F_1 / k = at_zero_1 − r θ        δ_2 + F_2 / k = at_zero_2 + r θ

so the angle is all that the pulley leaves of their two displacements: the second thing that two currents can decide is
how hard the wires pull against each other.  Co-contraction is the tension of the wire that pulls less; the other pulls
as much, and what the world asks of the joint besides.

The angle gives each wire its place.  The error of the co-contraction shortens both by the same length, a proportional
and an integral part: wires that are asked to be shorter than the pulley lets them be pull harder, and none is asked to
be where it is not, once the tension is there.  No step of the angle is asked for faster than the wire that must get
longer lets go: the reference stays so near the joint that the pull which this asks for ends at the tension limit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import copysign, hypot, inf, isfinite, nan
from typing import Any

from sma_actuator.base.parameters import LONGEST_NAME, from_mapping, parameter, refuse, to_mapping
from sma_actuator.base.signals import JointEstimate

#: Tension below which a wire counts as slack, and its displacement says nothing of the joint: some times a load cell's
#: noise.
SLACK_N = 0.05
#: The integral part of the common shortening: as a share of what a working range has of displacement.
LARGEST_INTEGRAL = 0.2
#: No wire is asked for more than this share of the tension limit; the rest is for what overshoots.
MOST_ASKED = 0.9
#: Both wires are asked to be longer by up to this, as a share of a working range, from half of the way between the
#: tension that is wanted of the wire that pulls more and the limit on: enough to cut what their integrals still ask
#: for.
LARGEST_EASE = 0.3
#: Tension is taken for what it will be so much later, where it rises: a wire goes on pulling while it is still hot.
LOOK_AHEAD_s = 0.2
#: What bends a command, in words.
LIMITS = {
    "angle_range": "the angle is outside what both wires can reach",
    "angle_rate": "the angle moves faster than it is followed",
    "angle_reach": "the wire that must get longer does not let go faster",
    "cocontraction": "another co-contraction than asked for",
    "tension": "the tension is near its limit",
}
#: Sign of the angle to which each wire turns the joint as it contracts.
SIGNS = (1.0, -1.0)


@dataclass(frozen=True, slots=True)
class PairParameters:
    """A joint that two wires turn."""

    joint_name: str = parameter("sma_joint", "name in the published JointState", hi=LONGEST_NAME)
    wires: tuple[str, ...] = parameter(
        description="names of the two wires' nodes; as the first contracts, the joint turns to positive angles",
        hi=LONGEST_NAME,
    )
    pulley_radius: float = parameter(
        description="radius of the pulley", unit="m", lo=1e-4, hi=1.0, hint="metres are wanted: 4 mm is 0.004"
    )
    displacement_at_zero: tuple[float, ...] = parameter(
        description="displacement of each wire, taut and without tension, at angle zero", unit="m", lo=-0.1, hi=1.0
    )
    series_stiffness: float = parameter(
        0.0, "stiffness of what is in series with each wire, tendon or spring; 0: nothing gives", "N/m", 0.0, 1e9
    )
    tension_limit: float = parameter(
        description="tension that neither wire is asked for, co-contraction and the world's torque together",
        unit="N",
        lo=1e-3,
        hi=1e4,
    )
    cocontraction: float = parameter(
        description="tension of the wire that pulls less, until another is asked for",
        unit="N",
        lo=1e-3,
        hi=1e4,
        live="either",
    )
    least_cocontraction: float = parameter(
        description="the least that can be asked for: what both wires' models were identified above, and no slack",
        unit="N",
        lo=1e-3,
        hi=1e4,
    )
    tension_gain: float = parameter(
        5e-4,
        "by how much both wires are asked to be shorter for each newton that lacks",
        "m/N",
        0.0,
        0.1,
        live="either",
    )
    tension_integral_time: float = parameter(
        2.0, "time in which the same is asked for once more, while it lacks", "s", 0.05, 1e3, live="either"
    )
    angle_rate_limit: float = parameter(
        1.0, "fastest change of the angle that is followed", "rad/s", 1e-4, 1e3, live="lower"
    )
    joint_command_timeout: float = parameter(
        0.5,
        "silence on the joint command topic that counts as lost, once one is followed: the joint is held; 0: never",
        "s",
        0.0,
        3600.0,
        live="lower",
        zero_is_never=True,
    )

    @classmethod
    def from_mapping(cls, mapping: Mapping[str, Any], source: str = "") -> PairParameters:
        """Check what stands below ``ros__parameters``.  Raises ConfigError with one sentence for every problem."""
        parameters, problems = from_mapping(cls, mapping)
        problems = problems or parameters._cross_checks()
        refuse(problems, source)
        assert isinstance(parameters, cls)
        return parameters

    def replace(self, changes: Mapping[str, Any]) -> PairParameters:
        """A copy with some parameters changed, checked as a whole."""
        return PairParameters.from_mapping({**to_mapping(self), **changes})

    def _cross_checks(self) -> list[str]:
        """What no single range can say."""
        found = []
        if len(self.wires) != 2 or self.wires[0] == self.wires[-1]:
            found.append(f"wires: [{', '.join(self.wires)}]; the names of the nodes of two wires are wanted")
        if len(self.displacement_at_zero) != 2:
            found.append(
                f"displacement_at_zero: {len(self.displacement_at_zero)} are given; one for each wire is wanted"
            )
        if not self.least_cocontraction <= self.cocontraction < self.tension_limit:
            found.append(
                f"cocontraction: {self.cocontraction:g} N is not between least_cocontraction, "
                f"{self.least_cocontraction:g} N, and tension_limit, {self.tension_limit:g} N"
            )
        return found


@dataclass(frozen=True, slots=True)
class WireState:
    """What is known of one wire: NaN where nothing is."""

    displacement_m: float
    uncertainty_m: float
    load_N: float
    velocity_m_s: float = nan


class Pair:
    """The law of one joint, with its memory.  Not thread-safe: one owner.

    ``ranges_m`` are the working ranges of the wires, least and largest displacement of each.
    """

    def __init__(self, parameters: PairParameters, ranges_m: Sequence[tuple[float, float]]):
        self.parameters = parameters
        self._ranges_m = tuple(ranges_m)
        self._span_m = min(high_m - low_m for low_m, high_m in self._ranges_m)
        self.estimate = JointEstimate()
        self.reset()

    def reset(self) -> None:
        """Nothing is asked for: the slack is taken up, and the joint held where it is then."""
        self.asked_rad = nan  #: NaN: where it is
        self.commanded = False  #: an angle was asked for
        self.asked_N = self.parameters.cocontraction
        self.reference_rad = nan  #: the angle as far as it is followed yet
        self._integral_m = 0.0
        self._tension_N = inf  #: of the step before; nothing rises from it yet
        self.limits: tuple[str, ...] = ()

    def hold(self) -> None:
        """No angle is asked for any more: the joint is held where it is, with the co-contraction that it has."""
        self.asked_rad, self.commanded = nan, False

    def cancel(self) -> None:
        """The motion ends where the reference has come, and the joint follows to there: where it is would be a step
        back."""
        self.asked_rad, self.commanded = self.reference_rad, False

    # --- geometry ---------------------------------------------------------------------------------

    def displacements_m(self, angle_rad: float, tensions_N: Sequence[float]) -> tuple[float, float]:
        """Where the wires are at an angle, taut with these tensions."""
        p = self.parameters
        first_m, second_m = (
            at_zero_m - sign * p.pulley_radius * angle_rad - self._given_m(tension_N)
            for sign, at_zero_m, tension_N in zip(SIGNS, p.displacement_at_zero, tensions_N, strict=True)
        )
        return first_m, second_m

    def angles_rad(self, wires: Sequence[WireState]) -> tuple[float, float]:
        """Where each wire by itself has the joint; a slack one could let it go further."""
        p = self.parameters
        first_rad, second_rad = (
            sign * (at_zero_m - wire.displacement_m - self._given_m(wire.load_N)) / p.pulley_radius
            for sign, at_zero_m, wire in zip(SIGNS, p.displacement_at_zero, wires, strict=True)
        )
        return first_rad, second_rad

    def _given_m(self, tension_N: float) -> float:
        """By how much what is in series gives."""
        return tension_N / self.parameters.series_stiffness if self.parameters.series_stiffness > 0.0 else 0.0

    def range_rad(self, tension_N: float) -> tuple[float, float]:
        """Least and largest angle at which both wires, with that tension, are in their working ranges."""
        low_rad, high_rad = -inf, inf
        at_zero_m = self.displacements_m(0.0, (tension_N, tension_N))
        for sign, place_m, ends_m in zip(SIGNS, at_zero_m, self._ranges_m, strict=True):
            ends_rad = [sign * (place_m - end_m) / self.parameters.pulley_radius for end_m in ends_m]
            low_rad, high_rad = max(low_rad, min(ends_rad)), min(high_rad, max(ends_rad))
        return low_rad, high_rad

    def see(self, wires: Sequence[WireState]) -> JointEstimate:
        """The joint as the wires show it that are taut: their mean.

        What both have from one model they have against each other on a pulley, and their mean is free of it: so none
        counts less. Its uncertainty is that of what the calibration of both leaves, as if it came together, and of what
        they contradict each other by, which only one of them has: independent, as the root of their squares.
        """
        angles_rad = self.angles_rad(wires)
        taut = [
            (angle_rad, wire, -sign * wire.velocity_m_s)
            for sign, angle_rad, wire in zip(SIGNS, angles_rad, wires, strict=True)
            if wire.load_N >= SLACK_N and isfinite(angle_rad)
        ]
        radius_m, many = self.parameters.pulley_radius, len(taut)
        taut_rad = [angle_rad for angle_rad, _, _ in taut]
        first_N, second_N = (wire.load_N for wire in wires)
        self.estimate = JointEstimate(
            angle_rad=sum(taut_rad) / many if many else nan,
            uncertainty_rad=hypot(
                sum(wire.uncertainty_m for _, wire, _ in taut) / many / radius_m, max(taut_rad) - min(taut_rad)
            )
            if many
            else nan,
            cocontraction_N=min(first_N, second_N) if isfinite(first_N + second_N) else nan,
            torque_Nm=radius_m * (first_N - second_N),
            velocity_rad_s=sum(turning_m_s for _, _, turning_m_s in taut) / many / radius_m if many else nan,
        )
        return self.estimate

    # --- what is wanted ---------------------------------------------------------------------------

    def command(self, angle_rad: float, cocontraction_N: float = nan) -> str:
        """Take an angle and a co-contraction; "" or the sentence why they were refused.  NaN: the one before stands."""
        for name, value in (("angle", angle_rad), ("co-contraction", cocontraction_N)):
            if not (isfinite(value) or value != value):
                return f"joint command refused: its {name} is {value}; a finite number is wanted"
        if cocontraction_N < 0.0:
            return f"joint command refused: its co-contraction, {cocontraction_N:g} N, is below zero; wires only pull"
        if angle_rad == angle_rad:
            self.asked_rad, self.commanded = float(angle_rad), True
        if cocontraction_N == cocontraction_N:
            self.asked_N = float(cocontraction_N)
        return ""

    def shared_N(self, torque_Nm: float) -> float:
        """The co-contraction that is asked for, as far as the limit and the torque on the joint leave room for it."""
        p = self.parameters
        room_N = MOST_ASKED * p.tension_limit - abs(torque_Nm) / p.pulley_radius
        return max(min(max(self.asked_N, p.least_cocontraction), room_N), 0.0)

    def step(self, wires: Sequence[WireState], dt_s: float) -> tuple[float, float]:
        """Setpoints of both wires [m] for what is known of them now; NaN before anything is."""
        p = self.parameters
        seen = self.see(wires)
        if not isfinite(seen.cocontraction_N + sum(self.angles_rad(wires))):
            return nan, nan
        wanted_N = self.shared_N(seen.torque_Nm)
        limits = {"cocontraction"} if wanted_N != self.asked_N else set()
        lacking_N = wanted_N - seen.cocontraction_N
        pull_N = wanted_N + abs(seen.torque_Nm) / p.pulley_radius
        ease_m = self._ease_m(max(wire.load_N for wire in wires), pull_N, dt_s)
        if ease_m > 0.0:
            limits.add("tension")
        reference_rad = self._refer(wires, wanted_N, dt_s, limits)
        self._integrate(lacking_N, dt_s)
        shorter_m = p.tension_gain * lacking_N + self._integral_m - ease_m
        self.limits = tuple(sorted(limits))
        first_m, second_m = self.displacements_m(reference_rad, [wire.load_N for wire in wires])
        return first_m - shorter_m, second_m - shorter_m

    def _ease_m(self, tension_N: float, pull_N: float, dt_s: float) -> float:
        """By how much both wires are asked to be longer so that neither comes to the tension limit."""
        p = self.parameters
        rise_N = max(tension_N - self._tension_N, 0.0) / dt_s * LOOK_AHEAD_s if dt_s > 0.0 else 0.0
        self._tension_N = tension_N
        room_N = max(p.tension_limit - pull_N, 0.0) / 2.0
        over_N = tension_N + rise_N - (p.tension_limit - room_N)
        if not over_N >= 0.0:
            return 0.0
        return LARGEST_EASE * self._span_m * (min(over_N / room_N, 1.0) if room_N > 0.0 else 1.0)

    def _integrate(self, lacking_N: float, dt_s: float) -> None:
        p = self.parameters
        most_m = LARGEST_INTEGRAL * self._span_m
        change_m = p.tension_gain * lacking_N * dt_s / p.tension_integral_time
        self._integral_m = min(max(self._integral_m + change_m, -most_m), most_m)

    def _refer(self, wires: Sequence[WireState], wanted_N: float, dt_s: float, limits: set[str]) -> float:
        """Let the reference go on towards what is asked for."""
        p, here_rad = self.parameters, self.estimate.angle_rad
        if not isfinite(here_rad):  # slack: the middle of what the wires allow, until they are taut
            self.reference_rad = sum(self.angles_rad(wires)) / 2.0
            return self.reference_rad
        if not isfinite(self.asked_rad):
            self.asked_rad = here_rad
        if not isfinite(self.reference_rad):
            self.reference_rad = here_rad
        low_rad, high_rad = self.range_rad(wanted_N)
        asked_rad = min(max(self.asked_rad, low_rad), high_rad)
        if asked_rad != self.asked_rad:
            limits.add("angle_range")
        most_rad = p.angle_rate_limit * dt_s
        change_rad = asked_rad - self.reference_rad
        if abs(change_rad) > most_rad:
            limits.add("angle_rate")
            change_rad = copysign(most_rad, change_rad)
        # The wire that pulls is asked for no more than what brings it to the limit of its tension.
        tension_N = max(wanted_N, *(wire.load_N for wire in wires))
        lead_rad = p.tension_gain * max(p.tension_limit - tension_N, 0.0) / p.pulley_radius
        reference_rad = self.reference_rad + change_rad
        self.reference_rad = min(max(reference_rad, here_rad - lead_rad), here_rad + lead_rad)
        if self.reference_rad != reference_rad:
            limits.add("angle_reach")
        return self.reference_rad
