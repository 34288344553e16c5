"""A program gone mad: publishes setpoints as fast as it can until it is killed.  ``python flood.py TOPIC``."""

import os
import sys

import rclpy
from std_msgs.msg import Float64

if __name__ == "__main__":
    rclpy.init()
    node = rclpy.create_node(f"flood{os.getpid()}")
    publisher = node.create_publisher(Float64, sys.argv[1], 10)
    print("ready", flush=True)
    while True:
        publisher.publish(Float64(data=0.0021))
