"""Records of ``sma_actuator.base.signals`` to standard messages, and back where a client needs it.

Positions in m (extension is positive), velocities in m/s, tension and load in N, currents in A.
``stamp`` is a ``builtin_interfaces/Time``: the time of sampling, in ROS time.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from builtin_interfaces.msg import Duration, Time
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from geometry_msgs.msg import WrenchStamped
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from sma_actuator.base.signals import Command, Estimate, Health, JointEstimate, Mode, Signals, Status, Verdict

_OWN_KEYS = ("mode", "fault", "limits")


def joint_state_message(joint_name: str, estimate: Estimate, signals: Signals, stamp: Time) -> JointState:
    """Estimated position [m] and velocity [m/s], and the tension of the wire [N]."""
    message = JointState(name=[joint_name], position=[estimate.displacement_m])
    message.velocity = [estimate.velocity_m_s]
    message.effort = [signals.load_N]
    message.header.stamp = stamp
    return message


def position_velocity_tension_from(message: JointState) -> tuple[float, float, float]:
    """Position [m], velocity [m/s] and tension [N] of the only joint; NaN where it has none."""
    position, velocity, effort = (
        values[0] if len(values) else math.nan for values in (message.position, message.velocity, message.effort)
    )
    return position, velocity, effort


def reference_message(joint_name: str, signals: Signals, stamp: Time) -> JointState:
    """Displacement measured by the reference sensor [m]."""
    message = JointState(name=[joint_name], position=[signals.reference_displacement_m])
    message.header.stamp = stamp
    return message


def signals_message(values: Mapping[str, float], happened: str, stamp: Time) -> JointState:
    """Named values, whatever they are: ``name[i]`` has the value ``position[i]``.

    ``happened`` says what changed before; it goes where a message of joints names a frame, which these have not.
    """
    message = JointState(name=list(values), position=list(map(float, values.values())))
    message.header.stamp = stamp
    message.header.frame_id = happened
    return message


def signals_from(message: JointState) -> dict[str, float]:
    """The named values of :func:`signals_message`."""
    return dict(zip(message.name, message.position, strict=True))


def load_message(frame_id: str, signals: Signals, stamp: Time) -> WrenchStamped:
    """Load on the wire, ``force.x`` [N]."""
    message = WrenchStamped()
    message.header.stamp = stamp
    message.header.frame_id = frame_id
    message.wrench.force.x = signals.load_N
    return message


def load_from(message: WrenchStamped) -> float:
    """Load [N]."""
    return message.wrench.force.x


def command_current_message(command: Command) -> Float64:
    """Current that flows by command [A]: zero where the output is off."""
    return Float64(data=command.current_A if command.output_on else 0.0)


def setpoint_message(position_m: float) -> Float64:
    """Setpoint [m]."""
    return Float64(data=float(position_m))


def position_from(message: Float64) -> float:
    """Setpoint [m], as it came: it may be NaN."""
    return message.data


def joint_command_message(joint_name: str, position_m: float) -> JointState:
    """Where a joint should be [m]."""
    return JointState(name=[joint_name], position=[float(position_m)])


def joint_command_from(message: JointState, joint_name: str) -> float:
    """Where one joint should be [m], as it came: it may be NaN.

    Raises ValueError with a sentence where the message does not say.
    """
    column = _column_of(message, joint_name)
    if column >= len(message.position):
        raise ValueError(f"joint command refused: it has no position for {joint_name}")
    return message.position[column]


def _column_of(message: JointState, joint_name: str) -> int:
    names = list(message.name)
    if joint_name not in names:
        raise ValueError(
            f"joint command refused: it is for {', '.join(names) or 'no joint'}, and this joint is {joint_name}"
        )
    return names.index(joint_name)


def pair_command_message(joint_name: str, angle_rad: float, cocontraction_N: float = math.nan) -> JointState:
    """Angle [rad], as position, and co-contraction [N], as effort, of a joint that two wires turn."""
    return JointState(name=[joint_name], position=[float(angle_rad)], effort=[float(cocontraction_N)])


def pair_command_from(message: JointState, joint_name: str) -> tuple[float, float]:
    """Angle [rad] and co-contraction [N] as they came: NaN where one is not given.

    Raises ValueError with a sentence where the message is not for this joint.
    """
    column = _column_of(message, joint_name)
    angle_rad, cocontraction_N = (
        values[column] if column < len(values) else math.nan for values in (message.position, message.effort)
    )
    return angle_rad, cocontraction_N


def joint_estimate_message(joint_name: str, estimate: JointEstimate, stamp: Time) -> JointState:
    """Angle [rad] and co-contraction [N] of a joint that two wires turn, as they are asked for, and its velocity
    [rad/s]."""
    message = pair_command_message(joint_name, estimate.angle_rad, estimate.cocontraction_N)
    message.velocity = [estimate.velocity_rad_s]
    message.header.stamp = stamp
    return message


def trajectory_message(joint_name: str, times_s: list[float], positions_m: list[float]) -> JointTrajectory:
    """Positions [m] at times [s] from now."""
    message = JointTrajectory(joint_names=[joint_name])
    for time_s, position_m in zip(times_s, positions_m, strict=True):
        seconds = math.floor(time_s)
        nanoseconds = min(999_999_999, round((time_s - seconds) * 1e9))
        message.points.append(
            JointTrajectoryPoint(
                positions=[float(position_m)], time_from_start=Duration(sec=seconds, nanosec=nanoseconds)
            )
        )
    return message


def trajectory_from(message: JointTrajectory, joint_name: str) -> tuple[list[float], list[float], list[float] | None]:
    """Times [s] from the start, positions [m] and, where every point has one, velocities [m/s] of one joint.

    The joint is found by its name; a message that names no joint, or whose points hold one position
    each, needs none.  Raises ValueError with a sentence where it cannot be told which.
    """
    names = list(message.joint_names)
    if names.count(joint_name) > 1:
        raise ValueError(f"trajectory refused: it names {joint_name} more than once")
    if joint_name in names:
        column = names.index(joint_name)
    elif len(names) == 0 or names == [""]:
        column = 0
    else:
        raise ValueError(f"trajectory refused: it moves {', '.join(names)}, this joint is {joint_name}")
    width = max(1, len(names))
    times_s, positions_m, velocities_m_s = [], [], []
    for number, point in enumerate(message.points):
        if len(point.positions) != width:
            raise ValueError(
                f"trajectory refused: point {number} has {len(point.positions)} positions for {width} "
                f"joint{'s' * (width > 1)}"
            )
        times_s.append(point.time_from_start.sec + 1e-9 * point.time_from_start.nanosec)
        positions_m.append(point.positions[column])
        if len(point.velocities) == width:
            velocities_m_s.append(point.velocities[column])
    if velocities_m_s and len(velocities_m_s) != len(positions_m):
        raise ValueError(
            f"trajectory refused: {len(velocities_m_s)} of {len(positions_m)} points have a velocity; all or none is "
            f"wanted"
        )
    return times_s, positions_m, velocities_m_s or None


def time_message(since_1970_ns: int) -> Time:
    """ROS time as messages have it; zero, "not known", where they have no room for it: before 1970, and from 2038
    on."""
    seconds, nanoseconds = divmod(since_1970_ns, 1_000_000_000)
    return Time(sec=seconds, nanosec=nanoseconds) if 0 <= seconds < 2**31 else Time()


def start_from(message: JointTrajectory, now_ns: int) -> float:
    """When the trajectory begins, in seconds after ``now_ns`` of ROS time; without a stamp at once."""
    stamp = message.header.stamp
    if stamp.sec == 0 and stamp.nanosec == 0:
        return 0.0
    return 1e-9 * (stamp.sec * 1_000_000_000 + stamp.nanosec - now_ns)


def diagnostic_status_from(name: str, hardware_id: str, status: Status) -> DiagnosticStatus:
    """Level ERROR with a fault, WARN while a limit acts, else OK; the words; the values as text."""
    level = DiagnosticStatus.ERROR if status.fault else DiagnosticStatus.WARN if status.limits else DiagnosticStatus.OK
    values = {"mode": status.mode.value, "fault": status.fault, "limits": ", ".join(status.limits), **status.values}
    return DiagnosticStatus(
        level=level,
        name=name,
        hardware_id=hardware_id,
        message=status.message,
        values=[KeyValue(key=key, value=_text(value)) for key, value in values.items()],
    )


def health_status_from(name: str, hardware_id: str, verdict: Verdict, now_s: float) -> DiagnosticStatus:
    """Level WARN where a calibration is due, else OK; the words; every sign as text.  ``now_s`` is loop time."""
    values: dict[str, float | str] = {
        "state": verdict.state.name.lower(),
        "due_for_s": now_s - verdict.since_s,
        "position_error_m": verdict.error_m,
        "cycles": str(verdict.cycles),
        "causes": "; ".join(verdict.causes),
    }
    for sign, reading in verdict.signs.items():
        values |= {
            f"{sign}_deviation": reading.deviation,
            f"{sign}_bound": reading.bound,
            f"{sign}_readings": str(reading.readings),
        }
    return DiagnosticStatus(
        level=DiagnosticStatus.WARN if verdict.state is Health.DUE else DiagnosticStatus.OK,
        name=name,
        hardware_id=hardware_id,
        message=verdict.words,
        values=[KeyValue(key=key, value=_text(value)) for key, value in values.items()],
    )


def status_from(message: DiagnosticStatus) -> Status:
    """The Status a message was made of; numbers among its values are numbers again."""
    values = {pair.key: pair.value for pair in message.values}
    return Status(
        mode=Mode(values["mode"]),
        fault=values["fault"],
        limits=tuple(filter(None, values["limits"].split(", "))),
        message=message.message,
        values={key: _number(value) for key, value in values.items() if key not in _OWN_KEYS},
    )


def _text(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:.6g}"


def _number(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text
