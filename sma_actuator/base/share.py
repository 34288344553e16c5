"""Where the files that come with the package are found: installed by colcon, by pip, or a checkout."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from .parameters import ConfigError


def shared_file(relative: str) -> Path:
    """Path of a shared file, as ``config/flexinol.yaml``.  Raises ConfigError where there is none.

    The ROS wheels leave AMENT_PREFIX_PATH unset, so the ament index is not asked but looked
    through like any other prefix.
    """
    prefixes = [p for p in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if p]
    places = [Path(__file__).resolve().parents[2]]
    places += [Path(prefix) / "share" / "sma_actuator" for prefix in [*prefixes, sys.prefix]]
    for place in places:
        if (place / relative).is_file():
            return place / relative
    raise ConfigError(f"{relative}: not found in {', '.join(map(str, places))}; is the package installed?")
