"""The arrows between the rooms of the house run one way."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "sma_actuator"
CORE = ("base", "config", "estimation.chain", "control.pid", "control.setpoints", "safety.supervisor", "actuator")
EDGES = {"rclpy", "pyvisa", "matplotlib", "rich", "jinja2", "sklearn", "joblib"}


def _imports(path: Path) -> set[str]:
    """Dotted names of the modules a file imports, those of the package without its name."""
    names = set()
    depth = len(path.relative_to(PACKAGE).parts)
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = path.relative_to(PACKAGE).parts[: depth - node.level] if node.level else ()
            module = ".".join((*base, *([node.module] if node.module else [])))
            names.add(module)
            names |= {f"{module}.{alias.name}".lstrip(".") for alias in node.names}
    return {name.removeprefix("sma_actuator.") for name in names}


def _edges_loaded_with(*modules: str) -> list[str]:
    names = ", ".join(f"sma_actuator.{name}" for name in modules)
    code = f"import sys, {names}; print(*sorted({EDGES!r} & set(sys.modules)))"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120)
    return loaded.stdout.split()


def test_the_core_loads_without_ros_instruments_or_plotting():
    assert _edges_loaded_with(*CORE) == []


def test_the_node_loads_of_them_ros_alone():
    pytest.importorskip("rclpy")
    assert _edges_loaded_with("ros.node") == ["rclpy"]


@pytest.mark.parametrize(
    "path", sorted([*(PACKAGE / "bench").rglob("*.py"), *(PACKAGE / "plant").rglob("*.py")]), ids=lambda p: p.name
)
def test_the_physics_knows_nothing_of_what_is_judged_against_it(path):
    rooms = {name.split(".")[0] for name in _imports(path)}
    judged = {
        "estimation",
        "control",
        "safety",
        "diagnosis",
        "identify",
        "characterise",
        "replay",
        "actuator",
        "driver",
    }
    assert not rooms & judged
