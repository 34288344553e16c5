"""Two nodes that want the same supply: one drives, the other waits and is silent, for every word would feed the
watchdog.  Two of one name with a supply each: DDS hands a request to both, and the answer says so."""

import pytest

pytest.importorskip("rclpy")
from liar import Liar
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from processes import wait_until
from std_srvs.srv import SetBool
from test_node import _enabled


@pytest.fixture
def instruments(start_bench):
    """(bench, proxy that counts connections to its supply, section ``instruments`` through the proxy)."""
    bench = start_bench("--load", "weight:0.98")
    proxy = Liar(bench.ports[0]["supply"])
    section = bench.instruments()
    section["supply"]["resource"] = proxy.resource
    yield bench, proxy, section
    proxy.close()


def test_a_node_that_waits_says_no_word_to_the_supply_and_drives_when_the_other_is_killed(
    instruments, make_config, start_node, client
):
    bench, proxy, section = instruments
    first = start_node({"first": make_config(instruments=section)}, names=["first"])
    _enabled(client, "/first")
    wait_until(lambda: bench.current_A() > 0.04)
    opened = proxy.opened
    second = start_node({"second": make_config(instruments=section)}, names=["second"])
    second.says("another program on this computer, or another part of this one, speaks to it")
    # Once more when somebody asks, beside those that it makes by itself.
    request = ChangeState.Request(transition=Transition(id=Transition.TRANSITION_CONFIGURE))
    assert not client.call("/second/change_state", ChangeState, request).success
    assert proxy.opened == opened, "the second node has spoken to the supply"
    assert bench.current_A() > 0.04
    first.popen.kill()
    wait_until(lambda: bench.current_A() == 0.0, what="end of the current")
    client.spin_until(
        lambda: client.call("/second/get_state", GetState).current_state.label == "active", what="the second node"
    )
    _enabled(client, "/second")
    wait_until(lambda: bench.current_A() > 0.04)


def test_who_enables_a_node_hears_that_another_has_its_name(start_bench, make_config, start_node, client):
    for bench in (start_bench(), start_bench()):
        start_node({"twin": make_config(instruments=bench.instruments())}, names=["twin"]).says("ready: ")
    answers = []

    def both_are_known():  # to each other: discovery takes its time
        answers.append(client.call("/twin/enable", SetBool, SetBool.Request(data=True)))
        return "another node on this network is called /twin" in answers[-1].message

    client.spin_until(both_are_known, what="a word of the other")
    assert answers[-1].success
