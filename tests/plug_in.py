"""The example of a package that adds parts, installed beside this one for processes that a test starts."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

EXAMPLE = Path(__file__).resolve().parents[1] / "examples" / "plug_in"


def environment(folder: Path) -> dict[str, str]:
    """The variables of a process that finds the package; its metadata are made from its pyproject.toml."""
    site = folder / "site"
    shutil.copytree(EXAMPLE, site, ignore=shutil.ignore_patterns("*.egg-info", "__pycache__"))
    made = [sys.executable, "-c", "import setuptools; setuptools.setup()", "-q", "egg_info"]
    subprocess.run(made, cwd=site, check=True, capture_output=True, timeout=120)
    path = os.pathsep.join(filter(None, (str(site), os.environ.get("PYTHONPATH", ""))))
    return {**os.environ, "PYTHONPATH": path}
