"""Mutation: change the guards one place at a time, and see that a test notices.

    python benchmarks/mutants.py                            every target, as ``make mutants``
    python benchmarks/mutants.py safety/thermal             one of them
    python benchmarks/mutants.py --every 5 --minutes 8      a sample, as far as one gets; called again, it goes on

The places and the changes are those of cosmic-ray, and one more, that of leaving a statement out.  Which tests run a
line is measured once; a mutant of that line gets these tests and no other, the quickest first, in a process of its own
whose copy of the package is the mutated one (also for the processes that a test starts).  A test that hangs on a mutant
has noticed it.  A mutant that no test notices and that ``mutants_equivalent.yaml`` does not explain makes the command
fail.

What was found is kept in ``benchmarks/mutants_tried.json`` and not tried again until the function changes in which the
mutant stands, or a test where it lived; which mutants there are, and which tests run which line, in
``out/mutants_known.json``, which may be deleted.  ``docs/mutants.md`` is written from the former, with the targets that
were tried before.
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import functools
import gc
import hashlib
import json
import math
import os
import random
import shutil
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import parso
import yaml
from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.operators.operator import Operator
from cosmic_ray.plugins import get_operator

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = "sma_actuator"
EQUIVALENT = Path(__file__).with_name("mutants_equivalent.yaml")
TRIED = Path(__file__).with_name("mutants_tried.json")
KNOWN = ROOT / "out" / "mutants_known.json"
PAGE = ROOT / "docs" / "mutants.md"
#: A mutated source, and the tests that are there to judge it.
_GUARDS = ("tests/safety/test_guard_edges.py", "tests/safety/test_contradicted.py", "tests/test_docs.py")
_DRIVER = (
    "tests/driver/test_output.py",
    *(f"tests/driver/test_driver_{name}.py" for name in ("edges", "steps", "on_bench", "thread")),
    "tests/driver/test_slow_instruments.py",
    "tests/driver/test_late_answers.py",
    "tests/driver/test_who_held_it_up.py",
)
TARGETS = {
    **{f"safety/guards/{name}": _GUARDS for name in ("program", "supply", "readings", "estimate", "setpoints", "wire")},
    "safety/records": (*_GUARDS, "tests/safety/test_faults.py"),
    "safety/lately": ("tests/safety/test_lately.py", *_GUARDS),
    "safety/formula": ("tests/safety/test_formula.py", "tests/test_docs.py"),
    "safety/timing": _GUARDS,
    "safety/faults": (*_GUARDS, "tests/safety/test_faults.py"),
    "safety/supervisor": ("tests/safety/test_supervisor_edges.py", *_GUARDS),
    **{
        f"safety/{name}": (*_GUARDS, *(f"tests/safety/test_{tests}.py" for tests in ("thermal", "limits", "hot_end")))
        for name in ("ambient", "cold", "thermal")
    },
    **{f"driver/{name}": _DRIVER for name in ("driver", "link", "loop", "output", "requests", "warm_up", "watchman")},
    "driver/statistics": ("tests/driver/test_statistics.py", *_DRIVER),
    "instruments/scpi": ("tests/instruments",),
    "instruments/supply": ("tests/instruments",),
    **{
        f"instruments/{name}": ("tests/instruments", "tests/driver/test_late_answers.py")
        for name in ("session", "byte_streams")
    },
    "instruments/claim": ("tests/instruments",),
    "instruments/phrases": ("tests/instruments/test_phrases.py", "tests/instruments/test_dialects.py"),
    "instruments/dialect": ("tests/instruments",),
    "instruments/pymeasure_adapter": ("tests/instruments",),
    **{
        f"actuator/{name}": (
            "tests/test_actuator.py",
            "tests/test_actuator_edges.py",
            "tests/safety/test_limits.py",
            "tests/safety/test_guards.py",
            "tests/control/test_tuning.py",
        )
        for name in ("actuator", "following", "measured", "offered", "said", "tuner")
    },
    **{
        f"pair/{name}": ("tests/driver/test_pair.py", "tests/driver/test_pair_edges.py")
        for name in ("driver", "fit", "stepped")
    },
    "estimation/hot_end": ("tests/estimation/test_hot_end_seen.py",),
    "estimation/chain": ("tests/estimation/test_chain.py",),
    "safety/alive": ("tests/safety/test_alive.py",),
    "safety/drift": ("tests/safety/test_drift.py",),
    "safety/reach": ("tests/safety/test_reach.py",),
    "safety/limits": ("tests/safety/test_limits.py", "tests/test_docs.py"),
    "control/commanding": ("tests/control/test_commanding.py",),
    "control/feed_forward": ("tests/control/test_feed_forward.py",),
    "ros/publishing": ("tests/ros/test_publishing.py",),
    "ros/guard": ("tests/ros/test_guard.py",),
    "view/server": ("tests/view/test_view_server.py",),
}
OPERATORS = (
    *(
        f"ReplaceComparisonOperator_{a}_{b}"
        for a, b in (
            ("Lt", "LtE"),
            ("Lt", "GtE"),
            ("LtE", "Lt"),
            ("LtE", "Gt"),
            ("Gt", "GtE"),
            ("Gt", "LtE"),
            ("GtE", "Gt"),
            ("GtE", "Lt"),
            ("Eq", "NotEq"),
            ("NotEq", "Eq"),
            ("Is", "IsNot"),
            ("IsNot", "Is"),
        )
    ),
    *(
        f"ReplaceBinaryOperator_{a}_{b}"
        for a, b in (("Add", "Sub"), ("Sub", "Add"), ("Mul", "Div"), ("Div", "Mul"), ("FloorDiv", "Mul"))
    ),
    "ReplaceUnaryOperator_USub_UAdd",
    "ReplaceUnaryOperator_Delete_Not",
    "AddNot",
    "ReplaceTrueWithFalse",
    "ReplaceFalseWithTrue",
    "ReplaceAndWithOr",
    "ReplaceOrWithAnd",
    "ReplaceBreakWithContinue",
    "ReplaceContinueWithBreak",
    "ExceptionReplacer",
    "NumberReplacer",
    "ZeroIterationForLoop",
)
#: Changes of nothing but which side of a bound the bound itself is on.
AT_THE_BOUND = tuple(
    f"ReplaceComparisonOperator_{a}_{b}" for a, b in (("Lt", "LtE"), ("LtE", "Lt"), ("Gt", "GtE"), ("GtE", "Gt"))
)
#: Words for the log are not looked at: leaving one out harms no wire.
UNWATCHED = ("_log.",)
#: Nobody reads what pytest says; a test that hangs is ended here; of its plug-ins only that of hypothesis is wanted.
QUICKLY = ("-q", "--assert=plain", "-o", "timeout=0", "-p", "pytest_timeout", "-p", "_hypothesis_pytestplugin")
QUICKLY += ("-p", "no:cacheprovider")
#: A mutant may hang where the code did not: a test has so long, and as many times its own time.
LEAST_s, TIMES = 20.0, 6.0
#: The same in time of the processor, which a busy machine does not lengthen: a loop without end is ended so.
LEAST_OF_PROCESSOR_s = 4.0


class LeaveOut(Operator):
    """Leaves a statement out: a call, a raise, or what is assigned to an attribute or an element."""

    def mutation_positions(self, node: Any) -> Iterator[tuple]:
        """Where a statement can be left out."""
        if node.type == "simple_stmt" and self._matters(node.children[0]):
            yield node.start_pos, node.end_pos

    def mutate(self, node: Any, index: int) -> Any:
        """``pass`` in the statement's place."""
        node.children[0] = parso.parse(node.children[0].get_first_leaf().prefix + "pass").children[0]
        return node

    @staticmethod
    def _matters(statement: Any) -> bool:
        text = statement.get_code(include_prefix=False)
        if text.startswith(UNWATCHED):
            return False
        if statement.type == "expr_stmt":
            return (
                statement.children[0].type in ("atom_expr", "power")
                or statement.children[0].type == "testlist_star_expr"
            )
        return statement.type in ("atom_expr", "power", "raise_stmt")

    @classmethod
    def examples(cls) -> tuple:
        """None; the operator is this command's own."""
        return ()


@dataclass(frozen=True, slots=True)
class Mutant:
    """One changed place."""

    target: str
    operator: str
    occurrence: int
    line: int
    before: str
    after: str
    key: str  #: stays the same while the function does in which it stands
    function: str  #: its name, with that of its class

    @property
    def words(self) -> str:
        """As it stands in the list of equivalent mutants."""
        return f"{self.before} → {self.after}"

    @property
    def source(self) -> str:
        """The whole file with that one place changed."""
        return mutate_code(path_of(self.target).read_text(encoding="utf-8"), _operator(self.operator), self.occurrence)


def _operator(name: str) -> Operator:
    return LeaveOut() if name == "LeaveOut" else get_operator(f"core/{name}")()


def _known(what: str, target: str, of: str, find: Callable[[], Any]) -> Any:
    """What was found out about a target before, as long as what it was found ``of`` stands; else what is found now."""
    known = json.loads(KNOWN.read_text()) if KNOWN.exists() else {}
    place = f"{what} {target}"
    if known.get(place, {}).get("of") != of:
        known[place] = {"of": of, "found": find()}
        KNOWN.parent.mkdir(parents=True, exist_ok=True)
        KNOWN.write_text(json.dumps(known))
    return known[place]["found"]


def mutants_of(target: str) -> list[Mutant]:
    """Every mutant of a source file that still is Python and differs in more than words or annotations."""
    of = _digest_of(path_of(target).read_bytes() + repr((OPERATORS, UNWATCHED)).encode())
    return [Mutant(target, *each) for each in _known("mutants of", target, of, lambda: _mutants_of(target))]


def _mutants_of(target: str) -> list[tuple[str, int, int, str, str, str, str]]:
    source = path_of(target).read_text(encoding="utf-8")
    pieces = _pieces(source)
    whole = get_ast(source)
    lines = source.splitlines()
    quiet = _lines_without_behaviour(source)
    dump = ast.dump(ast.parse(source))
    found = {}
    there: dict[tuple[str, str], int] = {}
    for name in (*OPERATORS, "LeaveOut"):
        operator = _operator(name)
        places = [place for node in ast_nodes(whole) for place in operator.mutation_positions(node)]
        for occurrence in range(len(places)):
            try:
                mutated = mutate_code(source, operator, occurrence)
            except AttributeError:  # cosmic-ray's ExceptionReplacer does not know a dotted name
                continue
            if mutated is None:
                continue
            try:
                same = ast.dump(ast.parse(mutated)) == dump
            except SyntaxError:
                continue
            if same:
                continue
            after = mutated.splitlines()
            changed = [
                number
                for number in range(max(len(lines), len(after)))
                if number >= len(lines) or number >= len(after) or lines[number] != after[number]
            ]
            first = changed[0]
            if first + 1 in quiet:
                continue
            shown = after[first].strip() if first < len(after) else ""
            function, piece = pieces.get(first + 1, ("", lines[first]))
            number = there[name, piece] = there.get((name, piece), 0) + 1
            key = _digest_of(f"{piece} {name} {number}".encode())
            found[mutated] = (name, occurrence, first + 1, lines[first].strip(), shown, key, function)
    return list(found.values())


def _pieces(source: str) -> dict[int, tuple[str, str]]:
    """Name of the function that each line belongs to, and its text or that of the statement in a module or class."""
    pieces: dict[int, tuple[str, str]] = {}

    def walk(within: ast.Module | ast.ClassDef, name: str) -> None:
        for node in within.body:
            here = f"{name}.{getattr(node, 'name', '')}".lstrip(".")
            if isinstance(node, ast.ClassDef):
                walk(node, here)
            else:
                text = f".{here} {ast.get_source_segment(source, node)}"
                pieces.update(dict.fromkeys(range(node.lineno, node.end_lineno + 1), (here, text)))

    walk(ast.parse(source), "")
    return pieces


def _lines_without_behaviour(source: str) -> set[int]:
    """Lines of log calls, of what only type checkers read, and of how a record is kept in memory (``@dataclass``,
    ``@record``)."""
    quiet: set[int] = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ClassDef):
            kept = ("dataclass", "record")
            quiet |= {each.lineno for each in node.decorator_list if ast.unparse(each).startswith(kept)}
        if (
            isinstance(node, ast.Expr)
            and isinstance(node.value, ast.Call)
            and ast.unparse(node.value).startswith(UNWATCHED)
        ):
            quiet |= set(range(node.lineno, node.end_lineno + 1))
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            quiet |= set(range(node.lineno, node.end_lineno + 1))
    return quiet


def path_of(target: str) -> Path:
    """Source file of a target."""
    return ROOT / PACKAGE / f"{target}.py"


# --- which tests run which line ---------------------------------------------------------------------


def covering(target: str) -> tuple[dict[int, list[str]], dict[str, float]]:
    """Tests by the line of the target that they run, and how long each takes [s]; measured where it is not known
    yet."""
    of = _digest([path_of(target), *_tests_of(target)])
    lines, times = _known("lines of", target, of, lambda: _covering(target))
    return {int(line): tests for line, tests in lines.items()}, times


def _covering(target: str) -> tuple[dict[str, list[str]], dict[str, float]]:
    """The same, measured in a process of its own."""
    reader, writer = os.pipe()
    pid = os.fork()
    if pid == 0:
        code = 1
        try:
            os.close(reader)
            answer = _measure(target)
            with os.fdopen(writer, "w") as stream:
                json.dump(answer, stream)
            code = 0
        finally:
            os._exit(code)
    os.close(writer)
    with os.fdopen(reader) as stream:
        text = stream.read()
    os.waitpid(pid, 0)
    if not text:
        raise SystemExit(f"{target}: its tests fail without a mutant; run pytest {' '.join(TARGETS[target])}")
    lines, times = json.loads(text)
    return lines, times


def _measure(target: str) -> tuple[dict[int, list[str]], dict[str, float]]:
    import coverage
    import pytest

    times: dict[str, float] = {}
    measure = coverage.Coverage(data_file=None, include=[str(path_of(target))], config_file=False)

    class Watch:
        @pytest.hookimpl(wrapper=True)
        def pytest_runtest_protocol(self, item: Any) -> Any:
            measure.switch_context(item.nodeid)
            began_s = time.monotonic()
            result = yield
            times[item.nodeid] = time.monotonic() - began_s
            return result

    _quiet()
    os.chdir(ROOT)
    measure.start()
    code = pytest.main([*QUICKLY, *TARGETS[target]], plugins=[Watch()])
    measure.stop()
    if code:
        os._exit(int(code))
    data = measure.get_data()
    lines = data.contexts_by_lineno(str(path_of(target)))
    return {line: [test for test in tests if test] for line, tests in lines.items()}, times


def _quiet() -> None:
    os.environ["PYTEST_DISABLE_PLUGIN_AUTOLOAD"] = "1"
    nowhere = os.open(os.devnull, os.O_RDWR)
    for stream in (0, 1, 2):
        os.dup2(nowhere, stream)


# --- one mutant ---------------------------------------------------------------------------------------


def survives(target: str, source: str, tests: list[str], times: dict[str, float]) -> bool:
    """Whether no test notices the mutant.  One that hangs is noticed."""
    longest_s = sum(_longest_s(test, times) for test in tests)
    folder = Path(tempfile.mkdtemp(prefix="sma_mutant_"))
    try:
        _overlay(folder, target, source)
        pid = os.fork()
        if pid == 0:
            _judge(folder, target, tests, times)
        deadline_s = time.monotonic() + longest_s
        while time.monotonic() < deadline_s:
            ended, status = os.waitpid(pid, os.WNOHANG)
            if ended:
                _end_group(pid)
                return os.waitstatus_to_exitcode(status) == 0
            time.sleep(0.02)
        _end_group(pid)
        os.waitpid(pid, 0)
        return False
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _longest_s(test: str, times: dict[str, float]) -> float:
    return LEAST_s + TIMES * times.get(test, 0.0)


def _end_group(pid: int) -> None:
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(pid, signal.SIGKILL)


def _overlay(folder: Path, target: str, source: str) -> None:
    """The repository, of links but for the mutated file and the folders above it."""
    path = path_of(target).relative_to(ROOT)
    here, there = ROOT, folder
    for part in path.parts[:-1]:
        _link_all(here, there, but=part)
        here, there = here / part, there / part
        there.mkdir()
    _link_all(here, there, but=path.name)
    (folder / path).write_text(source, encoding="utf-8")


def _link_all(here: Path, there: Path, but: str) -> None:
    for each in here.iterdir():
        if each.name not in (but, ".git", "__pycache__"):
            (there / each.name).symlink_to(each)


def _judge(folder: Path, target: str, tests: list[str], times: dict[str, float]) -> None:
    """In a process of its own: exit with 0 where every test passes on the mutant; an alarm ends it where one hangs."""
    code = 1
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    try:
        os.setsid()
        _quiet()
        os.chdir(folder)
        os.environ["PYTHONPATH"] = str(folder)
        os.environ["PYTHONDONTWRITEBYTECODE"] = "1"
        sys.dont_write_bytecode = True
        sys.path[:] = [
            str(folder),
            *(p for p in sys.path if p and Path(p).resolve() not in (ROOT, ROOT / "benchmarks")),
        ]
        _forget(folder, target)
        import pytest

        from sma_actuator.base.jit import at_once

        if "@jit" in path_of(target).read_text(encoding="utf-8"):
            at_once().__enter__()  # a mutant that runs as plain Python has had its tests before it is compiled

        class Watch:
            @pytest.hookimpl(wrapper=True)
            def pytest_runtest_protocol(self, item: Any) -> Any:
                signal.setitimer(signal.ITIMER_REAL, _longest_s(item.nodeid, times))
                own_s = TIMES * times.get(item.nodeid, 0.0)
                signal.setitimer(signal.ITIMER_PROF, LEAST_OF_PROCESSOR_s + own_s)
                return (yield)

            @pytest.hookimpl(trylast=True)
            def pytest_sessionfinish(self, exitstatus: int) -> None:
                os._exit(int(exitstatus))  # what the tests have left behind is ended by who asked

        code = int(pytest.main(["-x", *QUICKLY, *tests], plugins=[Watch()]))
    except BaseException:  # noqa: BLE001 - an import that fails is a mutant noticed
        code = 1
    finally:
        os._exit(code)


def _forget(folder: Path, target: str) -> None:
    """Let the mutated module, and every module that uses it, be imported from ``folder``; what is compiled stays."""
    name = f"{PACKAGE}.{target.replace('/', '.')}"
    uses = {each: _imports(each) for each in sys.modules if each.startswith(PACKAGE)}
    changed = {name}
    while more := {each for each, used in uses.items() if used & changed} - changed:
        changed |= more
    for registry in _registries():  # which refuse a part whose name is taken
        registry._parts = {
            part_name: part for part_name, part in registry.registered.items() if part.__module__ not in changed
        }
    for each in changed:
        package, _, last = each.rpartition(".")
        vars(sys.modules[package]).pop(last, None) if package in sys.modules else None
        sys.modules.pop(each, None)
    for each, module in list(sys.modules.items()):
        if each.startswith(PACKAGE) and hasattr(module, "__path__"):
            module.__path__ = [str(folder.joinpath(*each.split(".")))]


def _registries() -> list[Any]:
    """Every registry of parts that is loaded."""
    from sma_actuator.base.registry import Registry

    loaded = [module for name, module in list(sys.modules.items()) if name.startswith(PACKAGE)]
    return [each for module in loaded for each in vars(module).values() if isinstance(each, Registry)]


@functools.cache
def _imports(name: str) -> frozenset[str]:
    """Modules of the package that a loaded module of it imports."""
    module = sys.modules[name]
    package = name if hasattr(module, "__path__") else name.rpartition(".")[0]
    used: set[str] = set()
    for node in ast.walk(ast.parse(Path(module.__file__).read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            used |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            parts = package.split(".")[: len(package.split(".")) - node.level + 1] if node.level else []
            base = ".".join((*parts, *([node.module] if node.module else [])))
            used |= {base, *(f"{base}.{alias.name}" for alias in node.names)}
    # Whoever imports a.b.c has imported a and a.b as well.
    return frozenset(
        ".".join(each.split(".")[:n])
        for each in used
        if each.startswith(PACKAGE)
        for n in range(2, each.count(".") + 2)
    )


def _warm_up() -> None:
    """Import and compile what no mutant changes, once; forks then have it."""
    import hypothesis.strategies  # noqa: F401
    import numpy  # noqa: F401
    import pytest  # noqa: F401
    import pyvisa  # noqa: F401

    from sma_actuator.bench.bench import VirtualBench
    from sma_actuator.bench.in_process import InProcessDaq, InProcessSupply, VirtualClock
    from sma_actuator.config import Config, read_parameter_file
    from sma_actuator.driver import Driver

    config = Config.from_mapping(read_parameter_file(ROOT / "config" / "flexinol.yaml"))
    bench = VirtualBench.from_name("flexinol")
    driver = Driver(config, InProcessSupply(bench, config), InProcessDaq(bench, config), VirtualClock(bench))
    driver.run_for(0.5)
    driver.enable(True)
    driver.run_for(0.5)
    driver.stop()
    for each in [each for each in sys.modules if each.startswith(PACKAGE)]:
        _imports(each)
    gc.freeze()  # no fork looks through what is here for rubbish


def _without(found: list[Mutant], known: dict[str, set[str]]) -> list[Mutant]:
    explained = {target: known.get(target, set()) for target in {mutant.target for mutant in found}}

    def names(mutant: Mutant) -> set[str]:
        at_bound = {f"bound: {mutant.before}"} if mutant.operator in AT_THE_BOUND else set()
        return {mutant.words, mutant.function} | at_bound

    return [mutant for mutant in found if not names(mutant) & explained[mutant.target]]


def equivalent() -> dict[str, set[str]]:
    """Mutants that no test can notice, functions where none can, and lines whose bounds are met by chance alone, by
    target; the file has the reason beside each."""
    groups = yaml.safe_load(EQUIVALENT.read_text(encoding="utf-8")) or []
    known: dict[str, set[str]] = {}
    for group in groups:
        known.setdefault(group["target"], set()).update(
            group.get("mutants", ()), group.get("functions", ()), (f"bound: {line}" for line in group.get("bounds", ()))
        )
        assert group["reason"], "every group of equivalent mutants has a reason"
    return known


# --- what was found ------------------------------------------------------------------------------------


class Findings:
    """Which mutants were tried, in a file, and which of them lived."""

    def __init__(self) -> None:
        self._all: dict[str, dict[str, Any]] = json.loads(TRIED.read_text()) if TRIED.exists() else {}
        self._lock = threading.Lock()

    def of(self, target: str, found: list[Mutant]) -> dict[str, bool]:
        """Whether it lives, by the key of each of these mutants that was tried."""
        kept = self._all.get(target, {"noticed": "", "alive": ""})
        lives = dict.fromkeys(kept["noticed"].split(), False) | dict.fromkeys(kept["alive"].split(), True)
        keys = {mutant.key for mutant in found}
        return {key: alive for key, alive in lives.items() if key in keys}

    def holds(self, target: str) -> bool:
        """Whether the tests are those that what lives has lived through."""
        return self._all.get(target, {}).get("tests") == _digest(_tests_of(target))

    def save(self, target: str, lives: dict[str, bool]) -> None:
        """Write what is known of a target into the file."""
        noticed, alive = (" ".join(sorted(key for key in lives if lives[key] is which)) for which in (False, True))
        with self._lock:
            kept = json.loads(TRIED.read_text()) if TRIED.exists() else {}  # of another run beside this one
            kept[target] = {"tests": _digest(_tests_of(target)), "alive": alive, "noticed": noticed}
            part = TRIED.with_suffix(".part")
            part.write_text(json.dumps({each: kept[each] for each in TARGETS if each in kept}, indent=1) + "\n")
            part.replace(TRIED)
            self._all = kept


def _tests_of(target: str) -> list[Path]:
    places = [ROOT / each for each in TARGETS[target]]
    return [path for place in places for path in (sorted(place.rglob("*.py")) if place.is_dir() else [place])]


def _digest(paths: list[Path]) -> str:
    return _digest_of(b"".join(path.read_bytes() for path in paths))


def _digest_of(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:10]


def _page(findings: Findings) -> str:
    alive: list[str] = []
    rooms: dict[str, list[int]] = {}
    known = equivalent()
    for target in TARGETS:
        everything = mutants_of(target)
        found = _without(everything, known)
        lives = findings.of(target, found)
        left = [mutant for mutant in found if lives.get(mutant.key)]
        row = (1, len(everything), len(everything) - len(found), len(lives), len(left))
        room = f"`{target.partition('/')[0]}`"
        rooms[room] = [a + b for a, b in zip(rooms.get(room, [0] * len(row)), row, strict=True)]
        alive += [f"- `{target}.py`: line {mutant.line},\n  `{mutant.words}`" for mutant in left]
    rooms["**all of these**"] = [sum(column) for column in zip(*rooms.values(), strict=True)]
    lines = [
        "# Mutants",
        "",
        "How well the tests hold what guards the wire. `make mutants` (`python benchmarks/mutants.py`) changes it one",
        "place at a time, runs the tests of that line, and writes this page. A mutant that no test notices is listed,",
        "or stands with its reason in `benchmarks/mutants_equivalent.yaml` because nobody could see what it changes.",
        "Those that were tried were drawn at random from the whole file, and count until the function changes in which",
        "they stand.",
        "",
        "| room | files | mutants | equivalent | tried | not noticed |",
        "|---|---|---|---|---|---|",
        *(f"| {room} | " + " | ".join(map(str, row)) + " |" for room, row in rooms.items()),
        "",
        "## Not noticed",
        "",
        *(alive or ["None."]),
    ]
    return "\n".join(lines) + "\n"


def main() -> int:
    """Mutate the targets; 0 where no mutant survives that is not explained."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("targets", nargs="*", choices=[*TARGETS, []], default=[])
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--every", type=int, default=1, help="take one of so many mutants, for a quick look")
    parser.add_argument("--lines", default="", metavar="FROM-TO", help="mutants of these lines alone")
    parser.add_argument("--minutes", type=float, default=math.inf, help="try no more mutants after so many minutes")
    options = parser.parse_args()
    sys.path.insert(0, str(ROOT))
    ends_s = time.monotonic() + 60.0 * options.minutes
    _warm_up()
    known, findings = equivalent(), Findings()
    living = 0
    for target in options.targets or TARGETS:
        unexplained = _without(mutants_of(target), known)
        lives = findings.of(target, unexplained)
        again = set() if findings.holds(target) else {key for key, alive in lives.items() if alive}
        lives = {key: alive for key, alive in lives.items() if key not in again}
        found = unexplained[:: options.every]
        if options.lines:
            first, _, last = options.lines.partition("-")
            found = [m for m in found if int(first) <= m.line <= int(last or first)]
        untried = [mutant for mutant in found if mutant.key not in lives]
        if untried and time.monotonic() < ends_s:
            # In an order that leaves an even sample where the time does not suffice; those that lived before come
            # first.
            order = sorted(random.Random(0).sample(untried, len(untried)), key=lambda each: each.key not in again)
            _try(target, order, lives, lambda: findings.save(target, lives), options.jobs, ends_s)  # noqa: B023 - at once
        findings.save(target, lives)
        left = [mutant for mutant in found if lives.get(mutant.key)]
        living += len(left)
        tried = sum(mutant.key in lives for mutant in found)
        print(f"{target}: {tried} of {len(found)} mutants, {len(left)} not noticed", flush=True)
        for mutant in left:
            print(f"  {target}.py:{mutant.line} [{mutant.operator}] {mutant.words}", flush=True)
    PAGE.write_text(_page(findings), encoding="utf-8")
    return 1 if living else 0


def _try(
    target: str, found: list[Mutant], lives: dict[str, bool], save: Callable[[], None], jobs: int, ends_s: float
) -> None:
    """Run the tests on mutants until the time is over; what came out goes into ``lives``, and is saved."""
    lines, times = covering(target)
    everything = sorted(times, key=times.__getitem__)
    # A module of constants is run by no test, but where it is imported.
    run = {test for tests in lines.values() for test in tests} or everything
    few = sorted(run, key=lambda test: times.get(test, 0.0))[:5]
    sound = path_of(target).read_text(encoding="utf-8")
    assert survives(target, sound, few, times), f"{target}: tests fail on the source as it is"
    assert not survives(target, "raise RuntimeError\n", few, times), f"{target}: the tests do not run the mutants"

    def live(mutant: Mutant) -> None:
        if time.monotonic() > ends_s:
            return
        tests = sorted(lines.get(mutant.line) or everything, key=lambda test: times.get(test, 0.0))
        lives[mutant.key] = survives(target, mutant.source, tests, times)
        save()

    with ThreadPoolExecutor(jobs) as pool:
        list(pool.map(live, found))


if __name__ == "__main__":
    sys.exit(main())
