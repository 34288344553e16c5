"""The records that pass along the loop, from a raw reading to a current command.

Every name carries its SI unit (degrees Celsius for temperatures).  A quantity that was not
measured is NaN, never zero and never None.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass, field
from math import nan
from typing import Generic, TypeVar

import numpy as np

from .record import record

#: One sample (float), or n of them (array of shape (n,)): what the records of a log hold is what one step holds.
Value = TypeVar("Value", float, np.ndarray)

#: Share of the bias current below which there is no current to measure resistance with.
MEASURABLE = 0.5


@record(frozen=True, slots=True)
class Reading(Generic[Value]):
    """One averaged block of raw channels, as the DAQ gives it.

    ``time_s`` is on the clock of the loop (monotonic), at the end of the block.
    """

    time_s: Value
    supply_voltage_V: Value
    reference_voltage_V: Value
    load_cell_voltage_V: Value
    lvdt_current_A: Value = nan  # type: ignore[assignment]  # not measured
    ambient_temperature_C: Value = nan  # type: ignore[assignment]  # not measured


@record(frozen=True, slots=True)
class SupplyState:
    """What the supply answers when it is asked; not what we believe we told it."""

    time_s: float  #: when it was asked, where the answer came late; NaN, or of now: it came in time
    current_setting_A: float
    output_on: bool
    voltage_V: float
    current_A: float
    tripped: str = ""  #: "" or a comma-joined list of OVP, OCP, OTP, WDOG
    cut_off_A: float = 0.0  #: of the current that it was told last, what the digits of that command left out


@record(frozen=True, slots=True)
class Signals(Generic[Value]):
    """Physical quantities of the wire, after the calibrations of chapter 3 of the thesis."""

    time_s: Value
    resistance_Ohm: Value
    current_A: Value
    power_W: Value  #: electrical power in the wire alone, I²R
    load_N: Value
    stress_Pa: Value
    reference_displacement_m: Value = nan  # type: ignore[assignment]  # not measured
    ambient_temperature_C: Value = nan  # type: ignore[assignment]  # not measured
    tare_N: Value = 0.0  # type: ignore[assignment]  #: load that counts as zero, taken off load_N already


class Branch(enum.IntEnum):
    """Which transformation the wire is taken to undergo."""

    COOLING = 0
    HEATING = 1


class Quality(enum.IntEnum):
    """How far an estimate can be trusted, best first."""

    DETERMINATE = 0
    INDETERMINATE_COLD = 1  #: near full extension: R moves with temperature, δ does not
    INDETERMINATE_HOT = 2  #: near full contraction: likewise
    OUTSIDE_CALIBRATION = 3  #: stress or resistance beyond what the coefficients were fitted on
    INVALID = 4  #: an input was not finite


@record(frozen=True, slots=True)
class Estimate:
    """What the strain model makes of the signals.  Extension is positive."""

    time_s: float
    displacement_m: float
    strain: float
    velocity_m_s: float
    branch: Branch
    quality: Quality
    uncertainty_m: float = nan  #: half of the 95 % interval; NaN where the model has none

    def with_uncertainty(self, uncertainty_m: float) -> Estimate:
        """The same, with half of its 95 % interval [m]."""
        return Estimate(
            self.time_s,
            self.displacement_m,
            self.strain,
            self.velocity_m_s,
            self.branch,
            self.quality,
            uncertainty_m,
        )


@dataclass(frozen=True, slots=True)
class JointEstimate:
    """What is known of a joint that two wires turn."""

    angle_rad: float = nan  #: NaN where both wires are slack
    uncertainty_rad: float = nan  #: half of the 95 % interval
    cocontraction_N: float = nan  #: tension of the wire that pulls less
    torque_Nm: float = nan  #: of both wires together, against the world's
    velocity_rad_s: float = nan  #: as far as the wires show it; what is in series is left out


class Mode(enum.Enum):
    """What the controller is doing with the wire."""

    OFF = "off"  #: supply output off, no current at all
    HOLD = "hold"  #: holding the position it had when it was enabled or lost its setpoint
    TRACKING = "tracking"  #: following setpoints
    TUNING = "tuning"  #: moved about by a tuning of the gains


@record(frozen=True, slots=True)
class Command:
    """What the supply is to be told.  Built by the supervisor alone."""

    current_A: float
    output_on: bool


OFF = Command(0.0, False)


@record(frozen=True, slots=True)
class Status:
    """The state of one actuator in a form that can be published."""

    mode: Mode
    fault: str = ""  #: name of the latched or active fault, "" when there is none
    limits: tuple[str, ...] = ()  #: names of the limits acting now
    message: str = ""  #: the same in words
    values: dict[str, float | str] = field(default_factory=dict)


class Health(enum.IntEnum):
    """Whether the model still holds, by what the wire itself shows."""

    UNKNOWN = 0  #: too little has been seen
    HOLDS = 1
    DUE = 2  #: a calibration is due


@dataclass(frozen=True, slots=True)
class Sign:
    """One sign of a model's health as it stands."""

    deviation: float  #: from what is expected, in Ω or K; the median of the last readings
    bound: float
    side: int  #: +1 or −1 where it is beyond its bound, else 0
    since_s: float  #: loop time of the first reading of that run, NaN where it is within
    readings: int


@dataclass(frozen=True, slots=True)
class Verdict:
    """What is known of a model's health."""

    state: Health = Health.UNKNOWN
    words: str = "not known yet"
    since_s: float = nan  #: loop time from which a calibration has been due
    error_m: float = nan  #: what the position is wrong by, if the resistance is off everywhere as at the ends
    causes: tuple[str, ...] = ()  #: effects that could be it, in words
    signs: dict[str, Sign] = field(default_factory=dict)
    cycles: int = 0  #: of the wire since the beginning


@dataclass(frozen=True, slots=True)
class Tuned:
    """Gains of the control law that a tuning has found."""

    gains: dict[str, float]
    before: dict[str, float]
    by_rules: dict[str, float]  #: what followed from the relay test alone
    duration_s: float


@record(frozen=True, slots=True)
class Output:
    """Everything one step has to say."""

    signals: Signals  #: of the last usable reading
    estimate: Estimate
    command: Command
    status: Status
    setpoint_m: float  #: what the controller was asked for, NaN where nothing
    tare_N: float = 0.0  #: load that counts as zero
    events: tuple[str, ...] = ()  #: what was asked, changed or went wrong since the step before
    reading: Reading | None = None  #: as it came from the DAQ, None where nothing came
    health: Verdict = field(default_factory=Verdict)  #: of the model
    tuned: Tuned | None = None  #: what a tuning has found that has ended with this step
