"""Parts by name: this package's own and those that installed packages bring."""

import importlib
import os
import signal
import subprocess
import sys
from importlib.metadata import entry_points
from pathlib import Path

import pytest
from waiting import wait_until

from sma_actuator.base import plug_ins
from sma_actuator.base.plug_ins import PlugInError
from sma_actuator.base.registry import PartRefusedError, Registry

PACKAGE = "sma_tiny"


@pytest.fixture
def install(tmp_path, monkeypatch):
    """A package on the path with real metadata: ``install(source, entry points of the group "tiny.parts")``."""

    def install(source, **points):
        (tmp_path / f"{PACKAGE}.py").write_text(source)
        metadata = tmp_path / f"{PACKAGE}-1.2.dist-info"
        metadata.mkdir(exist_ok=True)
        (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {PACKAGE}\nVersion: 1.2\n")
        (metadata / "entry_points.txt").write_text(
            "[tiny.parts]\n" + "".join(f"{name} = {value}\n" for name, value in points.items())
        )
        monkeypatch.syspath_prepend(str(tmp_path))
        importlib.invalidate_caches()
        monkeypatch.setitem(sys.modules, "tiny_registry", sys.modules[__name__])

    yield install
    sys.modules.pop(PACKAGE, None)


@pytest.fixture(autouse=True)
def parts(monkeypatch):
    monkeypatch.setenv("SMA_ACTUATOR_PLUG_INS", "")
    made = Registry("part", "tiny.parts", lambda name, part: "it is not callable" if not callable(part) else "")
    made.register("own")(int)
    monkeypatch.setattr(sys.modules[__name__], "PARTS", made, raising=False)
    return made


REGISTERS = "from tiny_registry import PARTS\n@PARTS.register('more')\nclass More: pass\n"


def test_parts_come_in_the_order_of_registration_and_know_their_name(parts):
    parts.register("second")(float)
    assert list(parts) == ["own", "second"] and parts.name_of(float) == "second"
    with pytest.raises(KeyError):
        parts.name_of(str)


def test_a_part_that_is_wrong_or_there_already_is_refused(parts):
    with pytest.raises(PartRefusedError, match="part 'own': there is one of that name"):
        parts.register("own")(float)
    with pytest.raises(PartRefusedError, match="part 'new': it is not callable"):
        parts.register("new")(3)


def test_an_installed_package_adds_a_part(parts, install):
    install(REGISTERS, more=PACKAGE)
    assert "more" in parts and parts["more"].__name__ == "More" and list(parts) == ["own", "more"]


@pytest.mark.parametrize(
    ("source", "said"),
    [
        ("raise RuntimeError('no licence')", "cannot be loaded: RuntimeError: no licence"),
        ("import nothing_of_this_name", "ModuleNotFoundError: No module named 'nothing_of_this_name'"),
        ("", "registers no part 'more'"),
        ("from tiny_registry import PARTS\nPARTS.register('own')(str)", "there is one of that name already"),
    ],
)
def test_a_broken_package_is_named_every_time_and_stops_nobody_who_wants_another_part(parts, install, source, said):
    install(source, more=PACKAGE)
    assert parts["own"] is int
    for _ in range(2):
        with pytest.raises(PlugInError, match=f"package '{PACKAGE}' 1.2: its entry point more = {PACKAGE}") as raised:
            list(parts)
        assert said in str(raised.value)


@pytest.mark.parametrize(
    ("source", "said"),
    [
        ("import time\ntime.sleep(3600)", "does not come to an end within 2 s when it is imported; mend the package"),
        ("import subprocess, time\nsubprocess.Popen(['sleep', '20'])\ntime.sleep(20)", "within 2 s"),
        (
            "import os\nos._exit(0)",
            "ends the process with code 0 when it is imported; mend the package or uninstall it",
        ),
        ("import sys\nsys.exit('no licence')", "ends the process with code 1 when it is imported"),
        ("import os, signal\nos.kill(os.getpid(), signal.SIGSEGV)", "ends the process with signal 11"),
        ("print('loaded')\nimport os\nos._exit(3)", "ends the process with code 3"),
    ],
    ids=["hangs", "hangs with a child", "leaves at once", "leaves", "breaks", "lies"],
)
def test_a_package_that_hangs_or_ends_the_process_is_named_and_does_so_in_another(
    parts, install, monkeypatch, source, said
):
    if "within 2 s" in said:
        monkeypatch.setattr(plug_ins, "LOAD_TIMEOUT_s", 2.0)
    install(source, more=PACKAGE)
    assert parts["own"] is int
    with pytest.raises(PlugInError, match=f"package '{PACKAGE}' 1.2: its entry point more = {PACKAGE}") as raised:
        list(parts)
    assert said in str(raised.value)


def test_who_looks_at_a_package_that_hangs_ends_with_the_program(install, tmp_path):
    """Killed meanwhile, it left a process behind that never came to an end."""
    install(
        f"import os, time\nopen({str(tmp_path / 'looks')!r}, 'w').write(str(os.getpid()))\ntime.sleep(3600)",
        more=PACKAGE,
    )
    words = f"import sys; sys.path.insert(0, {str(tmp_path)!r})\n"
    words += "from importlib.metadata import entry_points\nfrom sma_actuator.base.plug_ins import load_plug_in\n"
    words += "(point,) = entry_points(group='tiny.parts')\nload_plug_in(point)"
    program = subprocess.Popen([sys.executable, "-c", words])
    looks = tmp_path / "looks"
    wait_until(lambda: looks.exists() and looks.read_text(), what="the look at the package")
    program.kill()
    program.wait()
    wait_until(lambda: not Path("/proc", looks.read_text()).exists(), what="its end")


def test_a_package_that_takes_the_signals_when_it_is_imported_does_not_keep_them(parts, install):
    """By them a program is ended, and its output switched off."""
    taken = (signal.SIGTERM, signal.SIGUSR1)
    before = [signal.getsignal(number) for number in taken]
    source = "import signal\nfor number in (15, 10):\n    signal.signal(number, signal.SIG_IGN)\n"
    install(f"{source}{REGISTERS}", more=PACKAGE)
    assert "more" in parts
    assert [signal.getsignal(number) for number in taken] == before


def test_what_was_imported_without_harm_is_not_looked_at_again_also_by_processes_started_later(
    parts, install, monkeypatch
):
    install(REGISTERS, more=PACKAGE)
    assert "more" in parts
    assert os.environ["SMA_ACTUATOR_PLUG_INS"]
    monkeypatch.setattr(plug_ins.subprocess, "run", None)
    (again,) = entry_points(group="tiny.parts")
    assert plug_ins.load_plug_in(again).__name__ == PACKAGE
