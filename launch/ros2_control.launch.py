"""Start one node and ros2_control on top of it: a joint_trajectory_controller moves the wire.

``ros2 launch sma_actuator ros2_control.launch.py params_file:=/path/to/your.yaml urdf:=/path/to/robot.urdf.xacro``

Wants the packages ``controller_manager``, ``joint_state_broadcaster``, ``joint_trajectory_controller``,
``joint_state_topic_hardware_interface``, ``robot_state_publisher`` and ``xacro``.  The wire stays off until
``~/enable``.
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import Command, LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from launch import LaunchDescription

CONTROLLERS = ("joint_state_broadcaster", "joint_trajectory_controller")


def generate_launch_description():
    """The node by its own launch file, the controller manager, the controllers."""
    share = Path(get_package_share_directory("sma_actuator"))
    urdf = ParameterValue(
        Command(["xacro ", LaunchConfiguration("urdf"), " params_file:=", LaunchConfiguration("params_file")]),
        value_type=str,
    )
    controllers = LaunchConfiguration("controllers_file")
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "params_file",
                default_value=str(share / "config" / "flexinol.yaml"),
                description="YAML file with the parameters of the wire",
            ),
            DeclareLaunchArgument(
                "urdf", default_value=str(share / "urdf" / "one_wire.urdf.xacro"), description="the robot"
            ),
            DeclareLaunchArgument(
                "controllers_file",
                default_value=str(share / "urdf" / "controllers.yaml"),
                description="YAML file with the controllers",
            ),
            IncludeLaunchDescription(
                PythonLaunchDescriptionSource(str(share / "launch" / "sma_actuator.launch.py")),
                launch_arguments={"params_file": LaunchConfiguration("params_file")}.items(),
            ),
            Node(
                package="robot_state_publisher",
                executable="robot_state_publisher",
                parameters=[{"robot_description": urdf}],
            ),
            Node(
                package="controller_manager",
                executable="ros2_control_node",
                parameters=[{"robot_description": urdf}, controllers],
                output="screen",
            ),
            *(
                Node(
                    package="controller_manager",
                    executable="spawner",
                    arguments=[name, "--param-file", controllers, "--controller-manager-timeout", "60"],
                )
                for name in CONTROLLERS
            ),
        ]
    )
