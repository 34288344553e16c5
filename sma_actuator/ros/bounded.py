"""How much a request holds is looked at before Python objects are made of it.

rclpy makes them of all that it has taken, and holds up every thread of the process meanwhile, the control loop's too:
6 s for a request to set 100 000 parameters.  A subscription can be had as bytes, a service cannot.  So rclpy is given, in the
place of the type of a request, one that counts in the C structure what there is and makes nothing of too much.
"""

from __future__ import annotations

import ctypes
from typing import Any

from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    GetParameterTypes,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
from rclpy.service import Service

#: Names or parameters of one request: some more than a node has.
MOST_NAMES = 500
#: Characters and numbers of one request: a parameter file may have as many.
MOST_CONTENT = 200_000


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


_OF = {
    DescribeParameters: _Sequence,
    GetParameters: _Sequence,
    GetParameterTypes: _Sequence,
    ListParameters: _Sequence,
    SetParameters: _Parameter,
    SetParametersAtomically: _Parameter,
}  #: services of parameters, and what the sequence holds that every request of them begins with


def too_much(address: int, kind: Any) -> str:
    """Why the request at ``address`` will not be looked at, or ""."""
    asked = _Sequence.from_address(address)
    if asked.size > MOST_NAMES:
        return f"it has {asked.size} names, more than {MOST_NAMES}; ask in parts"
    content = 0
    for each in (kind * asked.size).from_address(asked.data) if asked.size else ():
        content += each.size if isinstance(each, _Sequence) else _content(each)
    if content > MOST_CONTENT:
        return f"it has {content} characters and values, more than {MOST_CONTENT}"
    return ""


def _content(parameter: Any) -> int:
    texts = parameter.arrays[4]
    inside = (_Sequence * min(texts.size, MOST_CONTENT)).from_address(texts.data) if texts.size else ()
    counted = (parameter.name, parameter.string_value, *parameter.arrays, *inside)
    return sum(each.size for each in counted)


class Refused(Exception):
    """What is had in the place of a request that is too much."""


_capsule_pointer = ctypes.pythonapi.PyCapsule_GetPointer
_capsule_pointer.restype, _capsule_pointer.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]
_capsule_name = ctypes.pythonapi.PyCapsule_GetName
_capsule_name.restype, _capsule_name.argtypes = ctypes.c_char_p, [ctypes.py_object]
_new_capsule = ctypes.pythonapi.PyCapsule_New
_new_capsule.restype = ctypes.py_object
_new_capsule.argtypes = [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p]
_Convert = ctypes.PYFUNCTYPE(ctypes.py_object, ctypes.c_void_p)


class _Type:
    """A service's type whose requests are looked at first; what is too much becomes a ``Refused``."""

    def __init__(self, kind: Any):
        whole: Any = type(kind.Request)
        whole.__import_type_support__()
        capsule = whole._CONVERT_TO_PY
        name = _capsule_name(capsule)
        convert = _Convert(_capsule_pointer(capsule, name))

        def looked_at(address: int) -> Any:
            why = too_much(address, _OF[kind])
            return Refused(why) if why else convert(address)

        self._called = _Convert(looked_at)  # as long as this is there
        as_ever = {each: getattr(whole, each) for each in ("_CREATE_ROS_MESSAGE", "_DESTROY_ROS_MESSAGE")}
        made = _new_capsule(ctypes.cast(self._called, ctypes.c_void_p), name, None)
        self.Request, self.Response = type("Request", (), {**as_ever, "_CONVERT_TO_PY": made})(), kind.Response


def bound(service: Service) -> None:
    """Have a service that is asked about parameters refuse what is too much."""
    if service.srv_type in _OF:
        service.srv_type = _Type(service.srv_type)
