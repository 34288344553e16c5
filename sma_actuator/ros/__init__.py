"""The edge to ROS 2."""
