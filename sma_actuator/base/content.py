"""What stands in a file that others may have made: no pipe is waited for, and nothing is read to no end."""

from __future__ import annotations

import errno
import json
import os
import stat
from pathlib import Path
from typing import Any

#: Of JSON beside logs: all parameters of a wire with all their tables take a tenth of it.
LONGEST_JSON_B = 10_000_000


def content_of(path: Path, longest_B: int) -> bytes:
    """The content of a file, or ``longest_B`` and one byte of what is longer.  Raises OSError, also for a pipe."""
    with open(path, "rb", opener=_at_once) as stream:
        if stat.S_ISFIFO(os.fstat(stream.fileno()).st_mode):
            raise OSError(errno.EINVAL, "it is a pipe")
        return stream.read(longest_B + 1)


def _at_once(path: str, flags: int) -> int:
    return os.open(path, flags | os.O_NONBLOCK)


def json_of(path: Path) -> Any:
    """What a file of JSON holds.  Raises OSError, and ValueError where it is none or as long as none is."""
    content = content_of(path, LONGEST_JSON_B)
    if len(content) > LONGEST_JSON_B:
        raise ValueError(f"longer than {LONGEST_JSON_B} bytes")
    try:
        return json.loads(content)
    except RecursionError:
        raise ValueError("nested too deeply") from None
