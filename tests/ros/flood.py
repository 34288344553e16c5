"""A program gone mad, until it is killed: ``python flood.py TOPIC`` publishes setpoints as fast as it can; ``python
flood.py SERVICE RATE`` asks for ``~/enable`` true so many times a second, awaits no answer, and pauses from SIGUSR1 to
SIGUSR2 (two of one signal may come as one)."""

import os
import signal
import sys
import time

import rclpy
from std_msgs.msg import Float64
from std_srvs.srv import SetBool

if __name__ == "__main__":
    rclpy.init()
    node = rclpy.create_node(f"flood{os.getpid()}")
    if len(sys.argv) > 2:
        client, period_s = node.create_client(SetBool, sys.argv[1]), 1.0 / float(sys.argv[2])
        going = [True]
        signal.signal(signal.SIGUSR1, lambda *_: going.clear())
        signal.signal(signal.SIGUSR2, lambda *_: going.append(True))
        while not client.wait_for_service(1.0):
            pass
        print("ready", flush=True)
        while True:
            if going:
                client.call_async(SetBool.Request(data=True))
            time.sleep(period_s)
    publisher = node.create_publisher(Float64, sys.argv[1], 10)
    print("ready", flush=True)
    while True:
        publisher.publish(Float64(data=0.0021))
