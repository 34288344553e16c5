"""The tables of a calibration in one word, as parameter files had them before 0.2: JSON, compressed, in base64.

They are read for as long as there are such files; what is written today has them beside it (:mod:`.sidecar`).
"""

from __future__ import annotations

import base64
import binascii
import json
import zlib
from collections.abc import Mapping
from typing import Any

from .parameters import ConfigError

#: What stands for the lists of a section.
TABLES = "tables"
#: No calibration comes near it.
MOST_BYTES = 2_000_000


def unpacked(section: Mapping[str, Any], name: str) -> dict[str, Any]:
    """The section with its lists; one that stands there by itself counts before that in ``tables``.

    Raises ConfigError, whose sentence names the section ``name``, where the word is damaged.
    """
    if TABLES not in section:
        return dict(section)
    word = section[TABLES]
    damaged = ConfigError(
        f"{name}.{TABLES}: is damaged; it is written by `sma-actuator identify` and cannot be edited: "
        "identify the wire again, or take the line from the file that was written"
    )
    if not isinstance(word, str):
        raise damaged
    try:
        content = zlib.decompressobj()
        text = content.decompress(base64.b64decode("".join(word.split()), validate=True), MOST_BYTES)
        lists = json.loads(text) if content.eof else None
    except (binascii.Error, zlib.error, ValueError, RecursionError) as error:
        raise damaged from error
    if not isinstance(lists, dict):
        raise damaged
    return {**lists, **{key: value for key, value in section.items() if key != TABLES}}
