"""Start one node with a parameter file.

``ros2 launch sma_actuator sma_actuator.launch.py params_file:=/path/to/your.yaml``

The node configures and activates itself (its parameter ``autostart``); with ``autostart:=false`` it
waits for a lifecycle manager, or for ``ros2 lifecycle set``.  Nobody outside this machine is heard unless
``discovery_range:=SUBNET``, or the environment, says so (docs/security.md).  The same without launch:
``ros2 run sma_actuator sma_actuator_node --ros-args --params-file FILE``.
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument, SetEnvironmentVariable
from launch.substitutions import EnvironmentVariable, LaunchConfiguration
from launch_ros.actions import LifecycleNode
from launch_ros.parameter_descriptions import ParameterValue

from launch import LaunchDescription


def generate_launch_description():
    """One node; ends when the node ends, with the output off."""
    default_file = str(Path(get_package_share_directory("sma_actuator")) / "config" / "flexinol.yaml")
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "params_file", default_value=default_file, description="YAML file with the parameters"
            ),
            DeclareLaunchArgument(
                "name", default_value="sma_actuator", description="name of the node, and of its section in the file"
            ),
            DeclareLaunchArgument("namespace", default_value="", description="namespace of the node"),
            DeclareLaunchArgument("autostart", default_value="true", description="whether the node activates itself"),
            DeclareLaunchArgument(
                "discovery_range",
                default_value=EnvironmentVariable("ROS_AUTOMATIC_DISCOVERY_RANGE", default_value="LOCALHOST"),
                description="who is heard: LOCALHOST, SUBNET or OFF",
            ),
            DeclareLaunchArgument("enclave", default_value="/", description="enclave of SROS2"),
            SetEnvironmentVariable("ROS_AUTOMATIC_DISCOVERY_RANGE", LaunchConfiguration("discovery_range")),
            LifecycleNode(
                package="sma_actuator",
                executable="sma_actuator_node",
                name=LaunchConfiguration("name"),
                namespace=LaunchConfiguration("namespace"),
                parameters=[
                    LaunchConfiguration("params_file"),
                    {"autostart": ParameterValue(LaunchConfiguration("autostart"), value_type=bool)},
                ],
                ros_arguments=["--enclave", LaunchConfiguration("enclave")],
                output="screen",
                emulate_tty=True,
            ),
        ]
    )
