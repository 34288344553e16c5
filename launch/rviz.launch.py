"""Show a wire in RViz as a joint that moves, beside a node that runs.

``ros2 launch sma_actuator rviz.launch.py params_file:=your.yaml``: the joint's limits are those of the file.  Wants the
packages ``robot_state_publisher``, ``rviz2`` and ``xacro``.  While the output is off nobody knows where the wire is,
and it stands still.
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument
from launch.substitutions import Command, LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from launch import LaunchDescription


def generate_launch_description():
    """The robot's description with the node's joint states, and RViz."""
    share = Path(get_package_share_directory("sma_actuator"))
    node = LaunchConfiguration("node")
    words = [
        "xacro ",
        LaunchConfiguration("urdf"),
        " params_file:=",
        LaunchConfiguration("params_file"),
        " node:=",
        node,
    ]
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "params_file",
                default_value=str(share / "config" / "flexinol.yaml"),
                description="YAML file with the parameters of the wire",
            ),
            DeclareLaunchArgument("node", default_value="/sma_actuator", description="full name of the node"),
            DeclareLaunchArgument(
                "urdf", default_value=str(share / "urdf" / "one_wire.urdf.xacro"), description="the robot"
            ),
            Node(
                package="robot_state_publisher",
                executable="robot_state_publisher",
                parameters=[{"robot_description": ParameterValue(Command(words), value_type=str)}],
                remappings=[("joint_states", [node, "/joint_states"])],
            ),
            Node(package="rviz2", executable="rviz2", arguments=["-d", str(share / "urdf" / "one_wire.rviz")]),
        ]
    )
