"""Kernels: compiled before they have to be quick, kept where they can be, plain Python where neither is so."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

numba = pytest.importorskip("numba", reason="numba is not installed (extra 'speed')")

_KERNEL = """
from sma_actuator.base.jit import at_once, inlined, jit

@inlined
def more(x):
    return x + 1.0

@jit
def twice(x):
    return 2.0 * more(x)
"""

_QUICK = """
import time
from kernel import at_once, twice
with at_once():
    began_s = time.process_time()
    assert twice(2.0) == 6.0 and time.process_time() - began_s < 0.1
assert not twice.signatures
assert twice(2.0) == 6.0 and len(twice.signatures) == 1
with at_once():
    assert (twice(2.0), twice(3)) == (6.0, 8.0) and len(twice.signatures) == 1
"""

#: The folder of the module, and the user's own, as they are on a root file system that is read-only.
_READ_ONLY = """
import tempfile, types
from numba.core import caching

def file_in(dir):
    if not str(dir).startswith(tempfile.gettempdir()):
        raise PermissionError(dir)
    return tempfile.TemporaryFile(dir=dir)

caching.tempfile = types.SimpleNamespace(TemporaryFile=file_in)
"""


def run(folder, code, **environment):
    """Run ``code`` beside the kernel in a process of its own; what it writes to stderr."""
    (folder / "kernel.py").write_text(_KERNEL)
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, timeout=150.0, env=environment
    )
    assert done.returncode == 0, done.stderr
    return done.stderr


@pytest.fixture
def bare():
    """The environment without what says where caches lie."""
    return {name: value for name, value in os.environ.items() if name not in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME")}


def test_who_is_in_a_hurry_gets_plain_python_and_nobody_else(tmp_path, bare):
    run(tmp_path, _QUICK, **bare)
    assert list((tmp_path / "__pycache__").glob("*.nbi"))


def test_a_numba_that_is_told_to_compile_nothing_does_not(tmp_path, bare):
    run(tmp_path, "from kernel import at_once, twice; assert twice(2.0) == 6.0", NUMBA_DISABLE_JIT="1", **bare)


def test_a_kernel_that_makes_an_array_is_refused_since_nobody_counts_who_holds_it():
    from sma_actuator.base.jit import jit

    with pytest.raises(numba.errors.NumbaError, match="NRT required but not enabled"):
        jit(lambda n: np.zeros(n)[0])(3)


@pytest.mark.parametrize("shared", [False, True], ids=["own", "open to others"])
def test_where_nothing_else_can_be_written_a_private_folder_keeps_them(tmp_path, bare, shared):
    temporary, sources = tmp_path / "tmp", tmp_path / "sources"
    temporary.mkdir()
    sources.mkdir()
    place = temporary / f"sma_actuator-{os.getuid()}"
    if shared:  # others could put code there
        place.mkdir(mode=0o777)
        place.chmod(0o777)
    code = (
        _READ_ONLY + "from kernel import twice; assert twice(2.0) == 6.0; print(sum(twice.stats.cache_hits.values()))"
    )
    environment = {**bare, "TMPDIR": str(temporary), "XDG_CACHE_HOME": "/proc/none"}
    for _ in range(1 if shared else 2):  # what was kept is found again
        run(sources, code + "\nimport sys; sys.exit(twice.stats.cache_path is None)" * (not shared), **environment)
    found = list(place.rglob("*.nbi"))
    assert bool(found) is not shared
    assert not list(sources.rglob("*.nbi"))


#: Serves a bench and drives it, or drives one in the bench's time, and says what ran as plain Python.
_SERVED = """
import logging, socket, sys
from sma_actuator.bench import VirtualBench
from sma_actuator.bench.joint import JointBench
from sma_actuator.bench.server import background
from sma_actuator.plant.joint import parse_joint

logging.basicConfig(level=logging.DEBUG, format="%(message)s")
joint = JointBench.from_name("flexinol", parse_joint("0.02,0.003"), 0)
benches = {"wire": lambda: VirtualBench.from_name("furukawa"), "joint": lambda: joint.benches}[sys.argv[1]]()
with background(benches) as server:
    for instrument, line in (("daq", "READ:AVER?"), ("daq", "READ?"), ("supply", "MEAS:CURR?"), ("daq", "BENC:TRUT?")):
        with socket.create_connection(("127.0.0.1", server.ports[0][instrument])) as connection:
            connection.sendall((line + "\\n").encode())
            assert connection.recv(4096)
"""
_DRIVEN = """
import logging, sys
from sma_actuator.base.jit import at_once
from sma_actuator.bench import VirtualBench
from sma_actuator.bench.in_process import InProcessDaq, InProcessSupply, VirtualClock
from sma_actuator.config import Config, read_parameter_file
from sma_actuator.driver import Driver

logging.basicConfig(level=logging.DEBUG, format="%(message)s")
config = Config.from_mapping(read_parameter_file(sys.argv[1]))
bench = VirtualBench.from_name("furukawa" if config.wire.alloy == "ni-ti-cu" else "flexinol")
bench.advance(0.1)
bench.daq.block(1)
driver = Driver(config, InProcessSupply(bench, config), InProcessDaq(bench, config), VirtualClock(bench))
driver.open()
with at_once():
    driver.run_for(0.5)
    assert driver.enable(True)[0]
    for position_m in (0.002, 0.003, 0.0015):
        driver.offer_setpoint(position_m)
        driver.run_for(2.0)
    output = driver.run_for(1.0)
driver.stop()
assert output.status.mode.name == "TRACKING", output.status
"""


@pytest.mark.parametrize("kind", ["wire", "joint"])
def test_no_answer_of_a_bench_reaches_a_kernel_that_was_not_run_before_the_ports_opened(kind):
    from sma_actuator.base.jit import NOT_COMPILED

    done = subprocess.run([sys.executable, "-c", _SERVED, kind], capture_output=True, text=True, timeout=300.0)
    assert done.returncode == 0, done.stderr
    assert NOT_COMPILED not in done.stderr


@pytest.mark.parametrize(
    "model",
    [
        "furukawa",
        *(pytest.param(f"flexinol{form}", marks=pytest.mark.long) for form in ("", "_normalised")),
        pytest.param("furukawa_normalised", marks=pytest.mark.long),
    ],
)
def test_no_step_of_a_loop_reaches_a_kernel_that_was_not_run_before_it_began(model):
    from sma_actuator.base.jit import NOT_COMPILED

    file = Path(__file__).parents[2] / "config" / f"{model}.yaml"
    done = subprocess.run([sys.executable, "-c", _DRIVEN, file], capture_output=True, text=True, timeout=300.0)
    assert done.returncode == 0, done.stderr
    assert NOT_COMPILED not in done.stderr, done.stderr


_INNER = "from sma_actuator.base.jit import jit\nLARGE = {large}\n@jit\ndef inner(x):\n    return x + {more}\n"
_OUTER = """{imports}
from sma_actuator.base.jit import jit
@jit
def outer(x):
    return {product}
"""
#: Files of their own, since each has a cache of its own: one names what it uses, one names its module.
_OUTERS = {
    "by_name.py": _OUTER.format(imports="from inner import LARGE, inner", product="LARGE * inner(x)"),
    "by_module.py": _OUTER.format(imports="import inner", product="inner.LARGE * inner.inner(x)"),
    "both.py": "import by_name, by_module\nfor outer in (by_name.outer, by_module.outer):\n"
    "    print(outer(1.0), sum(outer.stats.cache_hits.values()))\n",
}


def test_a_kernel_is_compiled_anew_where_one_or_a_number_of_another_file_has_changed(tmp_path):
    """As after an upgrade that touched only that file."""
    for name, text in _OUTERS.items():
        (tmp_path / name).write_text(text)
    env = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "kept"), "PYTHONDONTWRITEBYTECODE": "1"}

    def said(**inner):
        if inner:
            (tmp_path / "inner.py").write_text(_INNER.format(**inner))
        done = subprocess.run(
            [sys.executable, "both.py"], cwd=tmp_path, env=env, capture_output=True, text=True, timeout=150.0
        )
        assert done.returncode == 0, done.stderr
        return done.stdout.splitlines()

    assert said(large=11.0, more=1.0) == ["22.0 0"] * 2
    assert said() == ["22.0 1"] * 2
    assert said(large=3.0, more=1.0) == ["6.0 0"] * 2
    assert said(large=3.0, more=2.0) == ["9.0 0"] * 2
