"""A package adds a control law and a dialect; the node drives a wire with them, or says why it does not."""

import pytest

pytest.importorskip("rclpy")
from plug_in import environment
from processes import Bench, Client, NodeProcess, parameter_file, wait_until
from std_msgs.msg import Float64
from std_srvs.srv import SetBool, Trigger

from sma_msgs_py import setpoint_message

BUILT = '        """The law with this band."""\n'
BEGUN = "        self.reference_m, self.output_A = position_m, output_A\n"
STEPPED = "        self.reference_m = setpoint_m\n"


def with_law(folder, does):
    """The environment in which a law of the package is found, in whose code something stands after each of some
    lines."""
    found = environment(folder)["PYTHONPATH"]
    law = folder / "site/sma_tiny/on_off.py"
    written = law.read_text()
    for line, more in does.items():
        assert written.count(line) == 1
        written = written.replace(line, line + more)
    law.write_text(written)
    return found


def started(folder, monkeypatch, make_config, bench, does, *arguments, name="sma_actuator"):
    """A node of its own interpreter, which reads what of other packages there is."""
    parameters = make_config(instruments=bench.instruments(), **{"instruments.supply.dialect": "tiny_supply"})
    parameters["controller"] = {"type": "on_off", "band": 1e-4}
    monkeypatch.setenv("PYTHONPATH", with_law(folder, does))
    path = parameter_file(folder, {name: parameters})
    return NodeProcess(["--ros-args", "--params-file", str(path), *arguments], folder, fresh=True)


LAW = "/sma_actuator: control law 'on_off'"


@pytest.mark.parametrize(
    ("line", "does", "said"),
    [
        pytest.param(
            *(BUILT, "        raise RuntimeError('no licence')\n", f"{LAW}: RuntimeError: no licence\n"),
            marks=pytest.mark.long,
        ),
        (BUILT, "        raise SystemExit(3)\n", f"{LAW}: SystemExit: 3\n"),
        # What is said of a part that cannot be imported, tests/base/test_registry.py looks at.
        pytest.param(
            *("class OnOff:\n", "    raise OSError('no licence')\n"),
            "package 'sma-tiny' 0.1.0: its entry point on_off = ",
            marks=pytest.mark.long,
        ),
    ],
    ids=["raises when it is built", "leaves when it is built", "raises when it is imported"],
)
def test_a_law_that_cannot_be_made_ends_the_node_with_its_words(
    line, does, said, tmp_path, monkeypatch, make_config, start_bench
):
    bench = start_bench("--load", "weight:0.98")
    node = started(tmp_path, monkeypatch, make_config, bench, {line: does})
    assert node.ends() == 1
    assert f"\nsma_actuator_node: {said}" in f"\n{node.words}"
    assert "waiting for the instruments" not in node.words
    assert bench.current_A() == 0.0


NAME = "/driven/sma_actuator"


@pytest.fixture(scope="module")
def driven(folder, make_config):
    """(bench, node, client, folder) of a node with that law, which does what is written in files ``begun`` and
    ``stepped`` of the folder, where there are some."""
    does = {
        line: "        import contextlib\n        import pathlib\n\n        does = ''\n"
        "        with contextlib.suppress(FileNotFoundError):\n"
        f"            does = pathlib.Path({str(folder / name)!r}).read_text()\n"
        "        exec(does)\n"
        for line, name in ((BEGUN, "begun"), (STEPPED, "stepped"))
    }
    bench = Bench(folder, "--load", "weight:0.98")
    with pytest.MonkeyPatch.context() as patch:
        node = started(folder, patch, make_config, bench, does, "-r", "__ns:=/driven", name=NAME)
    client = Client()
    yield bench, node, client, folder
    client.close()
    node.close()
    bench.close()


def enable(client, on=True):
    """Whether it is."""
    return client.call(f"{NAME}/enable", SetBool, SetBool.Request(data=on)).success


def test_a_wire_is_driven_by_a_law_and_a_dialect_of_another_package(driven):
    bench, _, client, _ = driven
    client.next(f"{NAME}/command_current", Float64)
    client.spin_until(lambda: enable(client), what="enabling")
    bias_A, much_A = 0.05, 0.15  # the limit of the wire's temperature lies above that
    client.next(f"{NAME}/command_current", Float64, lambda m: m.data == pytest.approx(bias_A))
    client.publish(f"{NAME}/setpoint", setpoint_message(0.0010))
    client.next(f"{NAME}/command_current", Float64, lambda m: m.data > much_A)
    wait_until(lambda: bench.current_A() > much_A, what="the current at the wire")
    client.publish(f"{NAME}/setpoint", setpoint_message(0.0040))
    client.next(f"{NAME}/command_current", Float64, lambda m: m.data == pytest.approx(bias_A))


@pytest.mark.parametrize(
    ("where", "leaves", "said"),
    [
        ("stepped", "import sys; sys.exit(3)", "SystemExit: 3"),
        ("stepped", "raise RuntimeError('worn')", "RuntimeError: worn"),
        ("begun", "import sys; sys.exit(4)", "SystemExit: 4"),
    ],
    ids=["exit in a step", "exception in a step", "exit as it begins"],
)
def test_a_law_that_leaves_while_it_drives_is_a_fault_and_the_node_goes_on(where, leaves, said, driven):
    bench, node, client, folder = driven
    written, now = folder / "written", folder / where
    written.write_text(leaves)
    client.spin_until(lambda: enable(client), what="enabling")
    wait_until(lambda: bench.current_A() > 0.0, what="the current at the wire")
    if where == "begun":
        enable(client, on=False)
    written.rename(now)
    if where == "begun":
        client.spin_until(lambda: enable(client), what="enabling")
    wait_until(lambda: f"control law 'on_off': {said}" in node.words, what="the fault")
    wait_until(lambda: bench.current_A() == 0.0, what="the end of the current")
    now.unlink()
    assert client.call(f"{NAME}/clear_fault", Trigger).success
    client.spin_until(lambda: enable(client), what="enabling")
    wait_until(lambda: bench.current_A() > 0.0, what="the current at the wire")
