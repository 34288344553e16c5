"""The lists of a section in one word: the tables of a calibration take some lines of a parameter file instead of pages.

The word is JSON, compressed, in base64, so it carries its own check sum, and a file and its tables cannot come apart.
"""

from __future__ import annotations

import base64
import binascii
import json
import textwrap
import zlib
from collections.abc import Mapping
from typing import Any

from .parameters import ConfigError

#: What stands for the lists of a section.
TABLES = "tables"
#: No calibration comes near it.
MOST_BYTES = 2_000_000
#: Characters between blanks, at which YAML can break the line.
_WORD = 20


def packed(section: Mapping[str, Any]) -> dict[str, Any]:
    """The section with its lists in the one word ``tables``, which is last; unchanged where it has none."""
    lists = {name: list(value) for name, value in section.items() if isinstance(value, (list, tuple)) and len(value)}
    if not lists:
        return dict(section)
    kept = {name: value for name, value in section.items() if not isinstance(value, (list, tuple))}
    word = base64.b64encode(zlib.compress(json.dumps(lists, separators=(",", ":")).encode(), 9)).decode()
    return {**kept, TABLES: " ".join(textwrap.wrap(word, _WORD))}


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
