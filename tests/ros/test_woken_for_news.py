"""The executor of a node is woken only for news, not for each output."""

import signal

import pytest

pytest.importorskip("rclpy")
from geometry_msgs.msg import WrenchStamped
from std_srvs.srv import SetBool

NAME = "/sma_actuator"

_COUNTING = """
import atexit, sys
from sma_actuator.ros import node, publishers
calls = {"_publish": 0, "_take_news": 0}
def counted(name, inner):
    def call(self, *arguments):
        calls[name] += 1
        return inner(self, *arguments)
    setattr(publishers.Publishers, name, call)
for name in calls:
    counted(name, getattr(publishers.Publishers, name))
code = node.main()
print(f"woken for {calls['_take_news']} of {calls['_publish']} outputs", file=sys.stderr)
sys.exit(code)
"""


def test_the_executor_sleeps_while_nothing_is_new(start_bench, make_config, start_node, client):
    """A node whose executor is woken for each output takes several times what its loop takes."""
    bench = start_bench("--load", "weight:0.98")
    parameters = make_config(**{"instruments": bench.instruments(), "loop.rate": 50.0, "loop.samples_per_block": 20})
    node = start_node(parameters, program=("-c", _COUNTING))
    client.spin_until(lambda: client.call(f"{NAME}/enable", SetBool, SetBool.Request(data=True)).success)
    loads = client.listen(f"{NAME}/load", WrenchStamped)
    client.spin_until(lambda: len(loads) >= 100)
    node.popen.send_signal(signal.SIGTERM)
    assert node.ends_in_order()
    woken, outputs = (int(word) for word in node.words.split("woken for ")[1].split()[:3:2])
    assert outputs >= 100
    # A machine that stalls is news as well: readings late, limits that come and go.  Woken for each would be all of
    # them.
    assert woken < 0.8 * outputs, f"the executor was woken for {woken} of {outputs} outputs"
