"""Start the virtual bench, a simulated wire, and the node at it: nothing else is needed.

``ros2 launch sma_actuator bench.launch.py``, then ``ros2 service call /sma_actuator/enable std_srvs/srv/SetBool "{data:
true}"``
"""

import sys
from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument, ExecuteProcess
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription


def generate_launch_description():
    """The bench at the ports of ``config/flexinol.yaml``, and a node that waits for it."""
    default_file = str(Path(get_package_share_directory("sma_actuator")) / "config" / "flexinol.yaml")
    bench = [sys.executable, "-m", "sma_actuator", "bench", "--supply-port", "5025", "--daq-port", "5026"]
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "params_file", default_value=default_file, description="YAML file with the parameters"
            ),
            DeclareLaunchArgument("load", default_value="weight:0.98", description="what hangs on the wire [N]"),
            ExecuteProcess(cmd=[*bench, "--load", LaunchConfiguration("load")], output="screen"),
            Node(
                package="sma_actuator",
                executable="sma_actuator_node",
                parameters=[LaunchConfiguration("params_file"), {"wait_for_instruments": True}],
                output="screen",
                emulate_tty=True,
            ),
        ]
    )
