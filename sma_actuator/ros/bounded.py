"""How much a request holds is looked at before Python objects are made of it.

rclpy makes them of all that it has taken, and holds up every thread of the process meanwhile, the control loop's too: 6
s for a request to set 100 000 parameters.  A subscription can be had as bytes, a service cannot.  So rclpy is given, in
the place of the type of a request, one that counts in the C structure what there is and makes nothing of too much.  The
same goes for the goals of an action.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    GetParameterTypes,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
from rclpy.service import Service
from type_description_interfaces.srv import GetTypeDescription
from unique_identifier_msgs.msg import UUID

#: Names or parameters of one request: some more than a node has.
MOST_NAMES = 500
#: Characters and numbers of one request: the parameters of a wire have a tenth of it.
MOST_CONTENT = 200_000
#: Of a trajectory, as it is sent: some thousand points.
LONGEST_TRAJECTORY_B = 500_000


class _Sequence(ctypes.Structure):
    """A sequence, or a string, of rosidl's C structures."""

    _fields_ = [("data", ctypes.c_void_p), ("size", ctypes.c_size_t), ("capacity", ctypes.c_size_t)]


class _Parameter(ctypes.Structure):
    """``rcl_interfaces/msg/Parameter``."""

    _fields_ = [
        ("name", _Sequence),
        ("type", ctypes.c_uint8),
        ("bool_value", ctypes.c_bool),
        ("integer_value", ctypes.c_int64),
        ("double_value", ctypes.c_double),
        ("string_value", _Sequence),
        ("arrays", _Sequence * 5),
    ]


class _Transition(ctypes.Structure):
    """The request of ``lifecycle_msgs/srv/ChangeState``."""

    _fields_ = [("id", ctypes.c_uint8), ("label", _Sequence)]


class _Description(ctypes.Structure):
    """The request of ``type_description_interfaces/srv/GetTypeDescription``, but for the word at its end."""

    _fields_ = [("type_name", _Sequence), ("type_hash", _Sequence)]


class _Trajectory(ctypes.Structure):
    """``trajectory_msgs/msg/JointTrajectory``, and the one of several degrees of freedom."""

    _fields_ = [
        ("stamp", ctypes.c_uint8 * 8),
        ("frame_id", _Sequence),
        ("joint_names", _Sequence),
        ("points", _Sequence),
    ]


class _Motion(ctypes.Structure):
    """The request of ``control_msgs/action/FollowJointTrajectory``, but for the time at its end."""

    _fields_ = [
        ("identity", ctypes.c_uint8 * 16),
        ("trajectory", _Trajectory),
        ("multi_dof_trajectory", _Trajectory),
        ("tolerances", _Sequence * 4),
    ]


_MOTION_FIELDS = {
    "trajectory": "trajectory_msgs/JointTrajectory",
    "multi_dof_trajectory": "trajectory_msgs/MultiDOFJointTrajectory",
    "path_tolerance": "sequence<control_msgs/JointTolerance>",
    "component_path_tolerance": "sequence<control_msgs/JointComponentTolerance>",
    "goal_tolerance": "sequence<control_msgs/JointTolerance>",
    "component_goal_tolerance": "sequence<control_msgs/JointComponentTolerance>",
    "goal_time_tolerance": "builtin_interfaces/Duration",
}  #: of the Jazzy release; of a goal that is laid out otherwise nothing is looked at here
_SEQUENCE_WORDS = 3  #: of 8 bytes: where it is, how long, and for how much there is room
_POINT_WORDS, _LISTS_OF_A_POINT = 13, 4  #: of 8 bytes: four sequences and a duration
_POINT_B, _NUMBER_B = 4 * _LISTS_OF_A_POINT + 8, 8  #: as they are sent: four lengths and a duration, and each number

_OF = {
    DescribeParameters: _Sequence,
    GetParameters: _Sequence,
    GetParameterTypes: _Sequence,
    ListParameters: _Sequence,
    SetParameters: _Parameter,
    SetParametersAtomically: _Parameter,
}  #: services of parameters, and what the sequence holds that every request of them begins with
#: Others whose requests hold texts, and how they are laid out: a label of 20 MB was a sentence of the log.
_TEXTS_OF = {ChangeState: _Transition, GetTypeDescription: _Description}


def too_much(address: int, kind: Any) -> str:
    """Why the request at ``address`` will not be looked at, or ""."""
    asked = _Sequence.from_address(address)
    if asked.size > MOST_NAMES:
        return f"it has {asked.size} names, more than {MOST_NAMES}; ask in parts"
    content = 0
    for each in (kind * asked.size).from_address(asked.data) if asked.size else ():
        content += each.size if isinstance(each, _Sequence) else _content(each)
    return _too_much_content(content)


def too_wordy(address: int, kind: Any) -> str:
    """The same of a request that holds texts."""
    asked = kind.from_address(address)
    texts = [getattr(asked, name) for name, of in kind._fields_ if of is _Sequence]
    return _too_much_content(sum(text.size for text in texts))


def _too_much_content(content: int) -> str:
    if content > MOST_CONTENT:
        return f"it has {content} characters and values, more than {MOST_CONTENT}"
    return ""


def _content(parameter: Any) -> int:
    texts = parameter.arrays[4]
    inside = 0
    if texts.size:
        # One by one 200 000 took 29 ms, in which the node was not heard of.
        words = (ctypes.c_uint64 * (_SEQUENCE_WORDS * texts.size)).from_address(texts.data)
        inside = int(np.frombuffer(words, np.uint64).reshape(texts.size, _SEQUENCE_WORDS)[:, 1].sum())
    return inside + sum(each.size for each in (parameter.name, parameter.string_value, *parameter.arrays))


def too_long(motion: _Motion) -> str:
    """Why a goal will not be looked at, or ""."""
    others = [
        motion.trajectory.joint_names,
        motion.multi_dof_trajectory.joint_names,
        motion.multi_dof_trajectory.points,
    ]
    most = max(each.size for each in (*others, *motion.tolerances))
    if most > MOST_NAMES:
        return (
            f"it has a list of {most} names, tolerances or points of several degrees of freedom, more than {MOST_NAMES}"
        )
    points = motion.trajectory.points
    sent_B = _POINT_B * points.size
    if points.size and sent_B <= LONGEST_TRAJECTORY_B:
        words = (ctypes.c_uint64 * (_POINT_WORDS * points.size)).from_address(points.data)
        lists = np.frombuffer(words, np.uint64).reshape(points.size, _POINT_WORDS)[:, : 3 * _LISTS_OF_A_POINT]
        sent_B += _NUMBER_B * int(lists[:, 1::3].sum())
    if sent_B > LONGEST_TRAJECTORY_B:
        return f"its trajectory takes {sent_B} bytes, more than {LONGEST_TRAJECTORY_B}; send it in parts"
    return ""


class Refused(Exception):
    """What is had in the place of a request that is too much."""


class RefusedMotion(Refused):
    """The same of a goal, with what is wanted of its request: who it is, and itself."""

    def __init__(self, why: str, identity: UUID):
        super().__init__(why)
        vars(self).update(goal_id=identity, goal=self)


def _refusing(too: Callable[[int, Any], str], kind: Any) -> Callable[[int], Refused | None]:
    def look(address: int) -> Refused | None:
        why = too(address, kind)
        return Refused(why) if why else None

    return look


def _look_at_motion(address: int) -> Refused | None:
    motion = _Motion.from_address(address)
    why = too_long(motion)
    return RefusedMotion(why, UUID(uuid=list(motion.identity))) if why else None


_capsule_pointer = ctypes.pythonapi.PyCapsule_GetPointer
_capsule_pointer.restype, _capsule_pointer.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]
_capsule_name = ctypes.pythonapi.PyCapsule_GetName
_capsule_name.restype, _capsule_name.argtypes = ctypes.c_char_p, [ctypes.py_object]
_new_capsule = ctypes.pythonapi.PyCapsule_New
_new_capsule.restype = ctypes.py_object
_new_capsule.argtypes = [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p]
_Convert = ctypes.PYFUNCTYPE(ctypes.py_object, ctypes.c_void_p)


class _Type:
    """A service's type whose requests are looked at first; what is too much becomes what ``look`` makes of it."""

    def __init__(self, kind: Any, look: Callable[[int], Refused | None]):
        whole: Any = type(kind.Request)
        whole.__import_type_support__()
        capsule = whole._CONVERT_TO_PY
        name = _capsule_name(capsule)
        convert = _Convert(_capsule_pointer(capsule, name))

        def looked_at(address: int) -> Any:
            return look(address) or convert(address)

        self._called = _Convert(looked_at)  # as long as this is there
        as_ever = {each: getattr(whole, each) for each in ("_CREATE_ROS_MESSAGE", "_DESTROY_ROS_MESSAGE")}
        made = _new_capsule(ctypes.cast(self._called, ctypes.c_void_p), name, None)
        self.Request, self.Response = type("Request", (), {**as_ever, "_CONVERT_TO_PY": made})(), kind.Response


def bound(service: Service) -> None:
    """Have a service whose requests may be of any length refuse what is too much."""
    for too, of in ((too_much, _OF), (too_wordy, _TEXTS_OF)):
        if service.srv_type in of:
            service.srv_type = _Type(service.srv_type, _refusing(too, of[service.srv_type]))
            return


def bound_goals(server: Any) -> None:
    """Have a server of ``FollowJointTrajectory`` be asked about a ``RefusedMotion`` in the place of a goal that is too
    long."""
    action = server.action_type
    if list(action.Goal.get_fields_and_field_types().items()) != list(_MOTION_FIELDS.items()):
        return
    parts = {name: getattr(action.Impl, name) for name in dir(action.Impl) if not name.startswith("_")}
    parts["SendGoalService"] = _Type(action.Impl.SendGoalService, _look_at_motion)
    server._action_type = SimpleNamespace(
        Impl=SimpleNamespace(**parts), Goal=action.Goal, Result=action.Result, Feedback=action.Feedback
    )
