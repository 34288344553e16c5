"""The record of a characterisation: which parts are finished, and what they gave."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sma_actuator.base.content import json_of
from sma_actuator.base.parameters import ConfigError
from sma_actuator.logs.files import write_atomically

from .plan import Part

FILE_NAME = "manifest.json"


class Manifest:
    """``manifest.json`` in a folder of logs, rewritten as a whole after every part."""

    def __init__(self, folder: Path, wire: Mapping[str, Any]):
        self.path = Path(folder) / FILE_NAME
        self.data: dict[str, Any] = {"wire": dict(wire), "calibration": {}, "parts": {}}
        if self.path.exists():
            try:
                self.data = json_of(self.path)
                found = self.data["wire"]
                self.data["parts"], self.data["calibration"]
            except (OSError, ValueError, KeyError, TypeError) as error:
                raise ConfigError(f"{self.path}: is not a manifest of a characterisation ({error})") from error
            if found != dict(wire):
                raise ConfigError(
                    f"{self.path}: belongs to another wire ({found}); use another folder for {dict(wire)}"
                )

    def finished(self, part: Part) -> bool:
        """Whether this very part has been measured.  Raises ConfigError where it was planned differently."""
        record = self.data["parts"].get(part.name)
        if record is None:
            return False
        if record["parameters"] != json.loads(json.dumps(dict(part.parameters))):
            raise ConfigError(
                f"{self.path}: part {part.name} was measured with other settings ({record['parameters']}); "
                "give the same options to resume, or use another folder"
            )
        return True

    def finish(self, part: Part, logs: list[str], results: Mapping[str, Any], calibration: Mapping[str, Any]) -> None:
        """Record a part; its logs are on disk by now."""
        self.data["parts"][part.name] = {
            "kind": part.kind,
            "parameters": dict(part.parameters),
            "logs": logs,
            "results": dict(results),
        }
        self.data["calibration"].update(calibration)
        text = json.dumps(self.data, indent=1) + "\n"
        write_atomically(self.path, lambda stream: stream.write(text.encode()))
