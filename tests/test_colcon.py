"""With ROS 2 sourced the package is built by colcon; colcon itself comes as a wheel, so that is tested here."""

import ast
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[1]
COLCON = shutil.which("colcon", path=str(Path(sys.executable).parent)) or shutil.which("colcon")
pytestmark = pytest.mark.skipif(COLCON is None, reason="colcon is not installed (extra 'test')")


@pytest.fixture(scope="module")
def workspace(tmp_path_factory):
    folder = tmp_path_factory.mktemp("workspace")
    ignore = shutil.ignore_patterns(
        ".venv", ".git", "__pycache__", "*.egg-info", "build", "install", "log", "out", ".hypothesis"
    )
    shutil.copytree(ROOT, folder / "src" / "sma_actuator", ignore=ignore)
    return folder


def _colcon(workspace: Path, *words: str) -> str:
    done = subprocess.run([COLCON, *words], cwd=workspace, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_colcon_sees_an_ament_python_package(workspace):
    # An invalid package.xml would silently demote it to a plain (python) package.
    assert "(ros.ament_python)" in _colcon(workspace, "list")


@pytest.mark.long  # the job `ros` builds with it on every push
def test_colcon_installs_node_launch_file_and_configurations(workspace):
    _colcon(workspace, "build")
    prefix = workspace / "install" / "sma_actuator"
    installed = {str(path.relative_to(prefix)) for path in prefix.rglob("*") if path.is_file()}
    assert {
        "lib/sma_actuator/sma_actuator_node",
        "lib/sma_actuator/sma-actuator",
        "share/ament_index/resource_index/packages/sma_actuator",
        "share/sma_actuator/package.xml",
        "share/sma_actuator/launch/sma_actuator.launch.py",
        *(f"share/sma_actuator/launch/{name}.launch.py" for name in ("ros2_control", "bench", "wires", "rviz")),
        "share/sma_actuator/urdf/one_wire.rviz",
        "share/sma_actuator/urdf/sma_wire.xacro",
        "share/sma_actuator/urdf/controllers.yaml",
        "share/sma_actuator/config/flexinol.yaml",
        "share/sma_actuator/config/flexinol.tables.npz",
        "share/sma_actuator/config/furukawa.yaml",
    } <= installed
    # As a person does who has sourced the workspace.
    path = subprocess.run(
        ["bash", "-c", ". install/local_setup.bash && command -v sma-actuator"],
        cwd=workspace,
        capture_output=True,
        text=True,
        env={"PATH": "/usr/bin:/bin"},
        check=True,
    )
    assert Path(path.stdout.strip()) == prefix / "lib" / "sma_actuator" / "sma-actuator"


def test_what_tools_of_ros_read_is_there():
    catkin = pytest.importorskip("catkin_pkg.package")
    changelog = pytest.importorskip("catkin_pkg.changelog")
    package = catkin.parse_package(str(ROOT / "package.xml"))
    changelog.get_changelog_from_path(str(ROOT), package.name).foreach_version(lambda *_: None)
    keys = yaml.safe_load((ROOT / "rosdep.yaml").read_text())
    wanted = {each.name for each in package.exec_depends}
    assert set(keys) <= wanted, "a key that nothing asks for"
    # The format wants an address; one that nobody ever wrote a commit under names nobody.
    assert not [each.email for each in package.maintainers if each.email.endswith(".invalid")]
    assert all(set(systems) == {"debian", "ubuntu"} for systems in keys.values())


def _imported(path: Path) -> set[str]:
    """Packages of ROS that a file imports."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names.add(node.module.split(".")[0])
        elif isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
    return {n for n in names if re.fullmatch(r"rclpy|ament_\w+|launch\w*|\w+_(msgs|srvs|interfaces)", n)}


def test_rosdep_is_asked_for_every_package_of_ros_that_is_imported_or_launched():
    text = (ROOT / "package.xml").read_text(encoding="utf-8")
    asked = set(re.findall(r"<exec_depend>(.+)</exec_depend>", text))
    files = [f for top in ("sma_actuator", "sma_msgs_py", "launch") for f in (ROOT / top).rglob("*.py")]
    imported = set().union(*map(_imported, files)) - {"control_msgs"}  # an action more where it is installed
    assert len(imported) > 10
    assert imported <= asked
    launched = re.findall(r'package="(\w+)"', "".join(f.read_text() for f in (ROOT / "launch").glob("*.py")))
    said = set(re.findall(r"_depend>(\w+)<", text)) | set(re.findall(r"\w+", text.split("Optional, of ROS:")[1]))
    assert set(launched) - {"sma_actuator"} <= said
