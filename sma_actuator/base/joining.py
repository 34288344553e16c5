"""How a program of this package that speaks to a node joins ROS 2."""

from __future__ import annotations

import os


def beside_a_node() -> list[str]:
    """Arguments for ``rclpy.init``; to be asked for before ROS 2 is used first.

    Unless the environment says otherwise, Fast DDS then speaks over UDP on one computer too: by its shared memory the
    programs of two users, as of a node in a container, find each other and lose every message, and what killed
    programs leave there can deafen later ones (Fast-DDS issues 3535, 5053, pull request 4728).  The discovery range
    LOCALHOST overrides that: rmw_fastrtps then adds the shared memory by itself.
    There is no log file, so no folder is needed for one: where none can be written, ROS 2 would not begin.
    """
    os.environ.setdefault("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4")
    return ["--ros-args", "--disable-external-lib-logs"]
