"""What the tests of every area share: one complete configuration, changed where a test needs it."""

from __future__ import annotations

import atexit
import contextlib
import copy
import fcntl
import gc
import itertools
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import HealthCheck, settings
from left_behind import end_with_this_process
from once import made_once
from rig import Rig

import sma_actuator
from sma_actuator.base.jit import COMPILED
from sma_actuator.base.one_thread import one_thread
from sma_actuator.base.share import shared_file
from sma_actuator.config import Config

if TYPE_CHECKING:
    from characterised import Characterised

    from sma_actuator.identify import Identification

# A machine may stand still at any instant: an example that takes long, or is drawn slowly, has not failed.
settings.register_profile("patient", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("patient")

_WATCHER = end_with_this_process()

# Before rclpy is imported: nothing outside this machine is heard, and no two workers of a run hear each other.
_WORKER = os.environ.get("PYTEST_XDIST_WORKER", "").removeprefix("gw")
_RUN = os.getppid() + int(_WORKER) if _WORKER else os.getpid()
os.environ["ROS_DOMAIN_ID"] = str(20 + _RUN % 80)
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"

# nohup, and a shell's job in the background, hand down signals that are ignored to every program under test.
if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

#: A 0.1524 mm × 100 mm Ni-Ti wire; every required parameter, the calibrations, and no other.
_NI_TI: dict[str, Any] = {
    "wire": {"alloy": "ni-ti", "length": 0.100, "diameter": 0.1524e-3},
    "circuit": {"reference_resistance": 1.0, "lead_resistance": 0.25},
    "load_cell": {"slope": 12.7297, "offset": -0.0598},
    "reference_sensor": {"slope": 0.315842, "offset": -0.0012195},
    "supply": {"max_current": 0.40, "max_voltage": 6.0, "over_current_trip": 0.45},
    "estimator": {"heating_power": 0.20},
    "controller": {"kp": 200.0, "ki": 200.0},
    "thermal": {"heat_capacity": 5.5e-3, "heat_loss": 5.0e-3},
    "safety": {"resistance_min": 1.0, "resistance_max": 20.0, "load_spike": 2.0},
    "model": {
        "type": "flexinol",
        "calibrated_length": 0.100,
        "calibrated_diameter": 0.1524e-3,
        "heating_slope": [4.3e-3],
        "heating_intercept": [-19.4e-3],
        "cooling_slope": [4.3e-3],
        "cooling_intercept": [-18.6e-3],
        "initial_slope": 1.0e-3,
        "transition_rate": 10.0,
        "stress_range": [0.0, 175.0e6],
        "displacement_range": [0.2e-3, 4.2e-3],
    },
}


def merged(base: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """``base`` with ``changes`` put into it, section by section."""
    out = copy.deepcopy(dict(base))
    for key, value in changes.items():
        head, _, rest = key.partition(".")
        if rest:
            out[head] = merged(out.get(head, {}), {rest: value})
        elif isinstance(value, Mapping) and isinstance(out.get(head), Mapping):
            out[head] = merged(out[head], value)
        else:
            out[head] = copy.deepcopy(value)
    return out


#: Tests that mostly wait for processes, and tests that mostly reckon: together they fill a machine, and they take
#: longest.
_WAITING = (
    "tests/ros",
    "tests/counterparts",
    "tests/view",
    "tests/cli",
    "tests/attack",
    "tests/check",
    "tests/driver",
    "tests/bench",
    "tests/instruments",
    "tests/boards",
)
_RECKONING = (
    "tests/identify",
    "tests/diagnosis",
    "tests/fleet",
    "tests/test_tutorial",
    "tests/replay",
    "tests/estimation",
    "tests/safety",
    "tests/test_live_parameters",
)


#: What takes longest as one scope, of both kinds: begun last it would leave the other workers with nothing to do.
_LONGEST = (
    "tests/diagnosis/trace/test_trace.py",
    "tests/instruments/test_families.py",
    "tests/identify/test_one_load.py",
    "tests/driver/test_half_answers.py",
    "tests/ros/test_remote_commands.py",
    "tests/driver/test_slow_instruments.py",
    "tests/identify/test_identify.py",
    "tests/ros/test_odd_messages.py::TestWhileDriving",
    "tests/diagnosis/trace/test_trace_command.py",
    "tests/view/test_view.py",
    "tests/identify/test_characterise_prompts.py",
    "tests/identify/test_whole_range.py",
    "tests/counterparts/test_counterparts.py",
    "tests/ros/test_late_starts.py",
    "tests/fleet/test_fleet.py",
    "tests/ros/test_node.py::TestEnd",
    "tests/attack/test_attack.py",
    "tests/base/test_jit.py",
    "tests/ros/test_node.py::TestHolding",
    "tests/driver/test_stands_still.py",
    "tests/safety/test_hot_end.py",
    "tests/test_examples.py",
    "tests/test_state_machine.py",
)

#: What many tests call first: the bench, and each model's estimate of many samples and of one.
_WANTED_BY_MANY = (
    "from sma_actuator.bench.server import BenchServer, VirtualBench as B; BenchServer(B.from_name('flexinol'))",
    (
        "import numpy as np; from sma_actuator.config import Config; from sma_actuator.estimation.chain import Chain; "
        "from sma_actuator.base.signals import Signals; "
        "signals, one = Signals(*np.ones((9, 40))), Signals(*np.ones(9)); "
        "[(Chain(c).run(signals), Chain(c).step(one)) for c in map(Config.load, sys.argv[1:])]"
    ),
)


def pytest_sessionstart(session: pytest.Session) -> None:
    """Do once what every worker of a fresh clone would do: compile what many want, and rewrite the tests' assertions,
    which is most of collecting them."""
    if not getattr(session.config.option, "numprocesses", None):
        return
    tests, package = Path(__file__).parent, Path(sma_actuator.__file__).parent
    rewritten = len([*tests.rglob("__pycache__/test_*-pytest-*.pyc")]) >= len([*tests.rglob("test_*.py")])
    rewriting, compiling = None, []
    if not rewritten and not sys.dont_write_bytecode:
        collecting = [sys.executable, "-m", "pytest", "--collect-only", "-qq", *session.config.args]
        rewriting = subprocess.Popen(collecting, stdout=subprocess.DEVNULL)
    if COMPILED and not any(package.rglob("*.nbi")):
        files = [str(shared_file(f"config/{wire}.yaml")) for wire in ("flexinol", "furukawa", "coil")]
        programs = [[sys.executable, "-c", f"import sys; {text}", *files] for text in _WANTED_BY_MANY]
        compiling = [subprocess.Popen(program) for program in programs]
    assert not any(process.wait(600) for process in compiling)
    if rewriting is not None:
        rewriting.wait(600)  # what does not collect, the workers say


@atexit.register  # before anything else is, so that it runs last: what others started they end in good order
def nothing_outlives_the_tests() -> None:
    """Nothing that a test started does."""
    if _WATCHER is not None and _WATCHER.stdin is not None:
        _WATCHER.stdin.close()
        with contextlib.suppress(subprocess.TimeoutExpired):
            _WATCHER.wait(20.0)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The longest classes and files, those that wait and that reckon in turn, then all others: so no worker is left
    alone with one of them."""
    scopes: dict[str, list[pytest.Item]] = {}
    for item in items:
        scopes.setdefault(item.nodeid.rpartition("::")[0], []).append(item)
    waiting, reckoning = ([name for name in scopes if name.startswith(rooms)] for rooms in (_WAITING, _RECKONING))
    mixed = [name for pair in itertools.zip_longest(waiting, reckoning) for name in pair if name is not None]
    longest = [name for name in _LONGEST if name in scopes]
    items[:] = [item for name in dict.fromkeys([*longest, *mixed, *scopes]) for item in scopes[name]]


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[None]:
    """What is collected stays to the end: a fifth of the time to collect it was to look for what of it is garbage."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()
        gc.freeze()


@pytest.fixture(scope="session", autouse=_WORKER != "" and COMPILED)
def in_turn(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """A kernel that another worker is compiling is waited for, and then read: to compile it takes each as long."""
    from numba.core.compiler_lock import global_compiler_lock
    from numba.core.dispatcher import Dispatcher

    folder = tmp_path_factory.getbasetemp().parent / "compiling"
    folder.mkdir(exist_ok=True)
    compile_for = Dispatcher.compile

    def compile_in_turn(kernel: Any, types: Any) -> Any:
        function = kernel.py_func
        if not function.__module__.startswith("sma_actuator."):
            return compile_for(kernel, types)
        # First the lock that threads share: one that waits for it must not hold what the thread that has it will want.
        with global_compiler_lock, (folder / f"{function.__module__}.{function.__qualname__}").open("w") as turn:
            fcntl.flock(turn, fcntl.LOCK_EX)
            return compile_for(kernel, types)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Dispatcher, "compile", compile_in_turn)
        yield


@pytest.fixture(scope="session", autouse=True)
def logs_of_ros(tmp_path_factory: pytest.TempPathFactory) -> None:
    """They go with the tests that wrote them, and not into a home, where perhaps nothing can be written."""
    os.environ.setdefault("ROS_LOG_DIR", str(tmp_path_factory.mktemp("ros_log")))


@pytest.fixture(scope="session", autouse=True)
def on_one_thread() -> Iterator[None]:
    """Linear algebra does: threads that wait for a core that another worker has, turn in circles on their own."""
    with one_thread():
        yield


@pytest.fixture(scope="session")
def make_config() -> Callable[..., dict[str, Any]]:
    """``make_config(supply={"max_current": 0.3}, **{"loop.rate": 100.0})``: a nested mapping for
    Config.from_mapping."""

    def make(**changes: Any) -> dict[str, Any]:
        return merged(_NI_TI, changes)

    return make


@pytest.fixture
def make_rig(make_config: Callable[..., dict[str, Any]]) -> Callable[..., Rig]:
    """``make_rig(**changes)``: a rig whose configuration differs from the common one by ``changes``."""
    return lambda **changes: Rig(make_config(**changes))


@pytest.fixture
def config(make_config: Callable[..., dict[str, Any]]) -> Config:
    return Config.from_mapping(make_config())


@pytest.fixture(scope="session")
def flexinol(tmp_path_factory: pytest.TempPathFactory) -> Characterised:
    """The Ni-Ti wire of the virtual bench, characterised once for all tests."""
    from characterised import Characterised

    return made_once(tmp_path_factory, "flexinol", partial(Characterised, "flexinol"))


@pytest.fixture(scope="session")
def identified_flexinol(flexinol: Characterised, tmp_path_factory: pytest.TempPathFactory) -> Identification:
    """The model of all of its logs, second order."""
    from sma_actuator.identify import identify

    def make(_: Path) -> Identification:
        return identify(flexinol.logs, flexinol.mapping, "flexinol", order=2)

    return made_once(tmp_path_factory, "identified_flexinol", make)


@pytest.fixture(scope="session")
def textbook(tmp_path_factory: pytest.TempPathFactory) -> Characterised:
    """The Ni-Ti wire in the physics of the thesis's models: its kinetics end somewhere, so a cycle repeats exactly."""
    from characterised import Characterised

    return made_once(tmp_path_factory, "textbook", partial(Characterised, "flexinol", physics="liang_rogers"))


@pytest.fixture(scope="session")
def furukawa(tmp_path_factory: pytest.TempPathFactory) -> Characterised:
    """The Ni-Ti-Cu wire of the virtual bench, characterised once for all tests."""
    from characterised import Characterised

    return made_once(tmp_path_factory, "furukawa", partial(Characterised, "furukawa"))
