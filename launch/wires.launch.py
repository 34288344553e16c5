"""Start several wires in one process, and joints that two of them turn.

``ros2 launch sma_actuator wires.launch.py params_file:=wires.yaml nodes:="left right"``; a pair, as it is shipped:
``ros2 launch sma_actuator wires.launch.py joints:=joint``.  One section of the file for each node (docs/pair.md).
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription


def generate_launch_description():
    """One process; it ends with every output off."""
    default_file = str(Path(get_package_share_directory("sma_actuator")) / "config" / "pair.yaml")
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "params_file", default_value=default_file, description="YAML file with a section for each node"
            ),
            DeclareLaunchArgument("nodes", default_value="left right", description="names of the wires' nodes"),
            DeclareLaunchArgument("joints", default_value="", description="names of the joints' nodes"),
            OpaqueFunction(function=_process),
        ]
    )


def _process(context):
    nodes, joints = (LaunchConfiguration(name).perform(context).split() for name in ("nodes", "joints"))
    return [
        Node(
            package="sma_actuator",
            executable="sma_actuator_node",
            arguments=["--nodes", *nodes, *(["--joints", *joints] if joints else [])],
            parameters=[LaunchConfiguration("params_file")],
            output="screen",
            emulate_tty=True,
        )
    ]
