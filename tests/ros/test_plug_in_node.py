"""A package adds a control law and a dialect; the node drives a wire with them, or says why it does not."""

import pytest

pytest.importorskip("rclpy")
from plug_in import environment
from processes import wait_until
from std_msgs.msg import Float64
from std_srvs.srv import SetBool

from sma_msgs_py import setpoint_message

NAME = "/sma_actuator"


@pytest.mark.parametrize(
    ("line", "does", "said"),
    [
        ("        self.reference_m = setpoint_m\n", "raise SystemExit(3)", "SystemExit: 3"),
        ('        """The law with this band."""\n', "raise RuntimeError('no licence')", "RuntimeError: no licence"),
    ],
    ids=["leaves in a step", "raises when it is built"],
)
def test_a_law_that_does_not_come_through_the_warm_up_ends_the_node_with_its_words(
    line, does, said, tmp_path, monkeypatch, make_config, start_bench, start_node
):
    bench = start_bench()
    parameters = make_config(instruments=bench.instruments())
    parameters["controller"] = {"type": "on_off", "band": 1e-4}
    monkeypatch.setenv("PYTHONPATH", environment(tmp_path)["PYTHONPATH"])
    law = tmp_path / "site/sma_tiny/on_off.py"
    written = law.read_text()
    assert written.count(line) == 1
    law.write_text(written.replace(line, f"{line}        {does}\n"))
    node = start_node(parameters, fresh=True)
    assert node.ends() == 1
    assert f"sma_actuator_node: {NAME}: {said}\n" in node.words
    assert "on_off.py" in node.words and "waiting for the instruments" not in node.words
    assert bench.current_A() == 0.0


def test_a_wire_is_driven_by_a_law_and_a_dialect_of_another_package(
    tmp_path, monkeypatch, make_config, start_bench, start_node, client
):
    bench = start_bench("--load", "weight:0.98")
    parameters = make_config(instruments=bench.instruments(), **{"instruments.supply.dialect": "tiny_supply"})
    parameters["controller"] = {"type": "on_off", "band": 1e-4}
    monkeypatch.setenv("PYTHONPATH", environment(tmp_path)["PYTHONPATH"])
    start_node(parameters, fresh=True)
    client.next(f"{NAME}/command_current", Float64)
    client.spin_until(
        lambda: client.call(f"{NAME}/enable", SetBool, SetBool.Request(data=True)).success, what="enabling"
    )
    bias_A, much_A = 0.05, 0.15  # the limit of the wire's temperature lies above that
    client.next(f"{NAME}/command_current", Float64, lambda m: m.data == pytest.approx(bias_A))
    client.publish(f"{NAME}/setpoint", setpoint_message(0.0010))
    client.next(f"{NAME}/command_current", Float64, lambda m: m.data > much_A)
    wait_until(lambda: bench.current_A() > much_A, what="the current at the wire")
    client.publish(f"{NAME}/setpoint", setpoint_message(0.0040))
    client.next(f"{NAME}/command_current", Float64, lambda m: m.data == pytest.approx(bias_A))
