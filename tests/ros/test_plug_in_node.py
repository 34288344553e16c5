"""A package adds a control law and a dialect; the node drives a wire with them, or says why it does not."""

import pytest

pytest.importorskip("rclpy")
from plug_in import environment
from processes import wait_until
from std_msgs.msg import Float64
from std_srvs.srv import SetBool, Trigger

from sma_msgs_py import setpoint_message

NAME = "/sma_actuator"


BUILT = '        """The law with this band."""\n'
STEPPED = "        self.reference_m = setpoint_m\n"


@pytest.fixture
def start_on_off(tmp_path, monkeypatch, make_config, start_bench, start_node):
    """Bench and node with the law of the package, in whose code something stands after a line, once ``now`` exists."""

    def start(line, does):
        bench = start_bench("--load", "weight:0.98")
        parameters = make_config(instruments=bench.instruments(), **{"instruments.supply.dialect": "tiny_supply"})
        parameters["controller"] = {"type": "on_off", "band": 1e-4}
        monkeypatch.setenv("PYTHONPATH", environment(tmp_path)["PYTHONPATH"])
        law = tmp_path / "site/sma_tiny/on_off.py"
        written = law.read_text()
        assert written.count(line) == 1
        law.write_text(written.replace(line, line + does))
        return bench, start_node(parameters, fresh=True)

    return start


LAW = f"{NAME}: control law 'on_off'"


@pytest.mark.parametrize(
    ("line", "does", "said"),
    [
        (BUILT, "        raise RuntimeError('no licence')\n", f"{LAW}: RuntimeError: no licence\n"),
        (BUILT, "        raise SystemExit(3)\n", f"{LAW}: SystemExit: 3\n"),
        ("class OnOff:\n", "    raise OSError('no licence')\n", "package 'sma-tiny' 0.1.0: its entry point on_off = "),
    ],
    ids=["raises when it is built", "leaves when it is built", "raises when it is imported"],
)
def test_a_law_that_cannot_be_made_ends_the_node_with_its_words(line, does, said, start_on_off):
    bench, node = start_on_off(line, does)
    assert node.ends() == 1
    assert f"\nsma_actuator_node: {said}" in f"\n{node.words}"
    assert "waiting for the instruments" not in node.words
    assert bench.current_A() == 0.0


@pytest.mark.parametrize(
    ("line", "leaves", "said"),
    [
        (STEPPED, "sys.exit(3)", "SystemExit: 3"),
        (STEPPED, "raise RuntimeError('worn')", "RuntimeError: worn"),
        ("        self.reference_m, self.output_A = position_m, output_A\n", "sys.exit(4)", "SystemExit: 4"),
    ],
    ids=["exit in a step", "exception in a step", "exit as it begins"],
)
def test_a_law_that_leaves_while_it_drives_is_a_fault_and_the_node_goes_on(
    line, leaves, said, tmp_path, start_on_off, client
):
    now = tmp_path / "now"
    bench, node = start_on_off(
        line, f"        import os, sys\n\n        if os.path.exists({str(now)!r}):\n            {leaves}\n"
    )

    def enabled():
        return client.call(f"{NAME}/enable", SetBool, SetBool.Request(data=True)).success

    client.spin_until(enabled, what="enabling")
    wait_until(lambda: bench.current_A() > 0.0, what="the current at the wire")
    if "position_m" in line:
        client.call(f"{NAME}/enable", SetBool, SetBool.Request(data=False))
        now.touch()
        client.spin_until(enabled, what="enabling")
    now.touch()
    wait_until(lambda: f"control law 'on_off': {said}" in node.words, what="the fault")
    wait_until(lambda: bench.current_A() == 0.0, what="the end of the current")
    now.unlink()
    assert client.call(f"{NAME}/clear_fault", Trigger).success
    client.spin_until(enabled, what="enabling")
    wait_until(lambda: bench.current_A() > 0.0, what="the current at the wire")


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
