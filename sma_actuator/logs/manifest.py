"""The list of the files that a recorder wrote, kept beside them: no other file is ever changed or removed.

A file is known by its name and its inode, so that one which somebody put in its place is left alone, and a
link never leads out of the folder.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import json
import logging
import os
import stat
import time
from collections.abc import Iterator
from pathlib import Path

from sma_actuator.base.parameters import ConfigError

from .files import write_atomically

_log = logging.getLogger(__name__)

Files = dict[str, int]  #: name → inode, oldest first
#: A list of the most files that there may be, of the longest names, takes half of it.
LARGEST_B = 100_000_000
#: Another recorder keeps the lock while it writes the list; who keeps it longer is none.
LOCKED_s = 2.0
_LOOK_s = 0.01  #: between two looks whether it is free


class Manifest:
    """What the recorders of one name wrote into one folder."""

    def __init__(self, folder: Path, recorder: str):
        self.path = folder / f".{recorder}.manifest.json"
        self._folder = folder
        self._recorder = recorder
        self._known: Files | None = None  #: as it was when it was last read or written here

    @contextlib.contextmanager
    def changing(self) -> Iterator[Files]:
        """The files, to be changed: kept afterwards, and locked meanwhile against other processes.

        A list that somebody has spoilt since it was read here is written anew, as it was then: what another process
        wrote into it meanwhile is left alone from then on.

        Raises OSError where the list cannot be written, or somebody keeps it locked; ConfigError where it was none from
        the first.
        """
        handle = os.open(self._folder, os.O_RDONLY | os.O_DIRECTORY)
        try:
            _lock(handle)
            before: Files | None = None
            try:
                before = self._read()
            except ConfigError:
                if self._known is None:
                    raise
                _log.warning("%s was spoilt by somebody else; it is written anew", self.path)
            files = dict(self._known or {} if before is None else before)
            yield files
            if files != before:
                text = json.dumps({"recorder": self._recorder, "files": files}, indent=1) + "\n"
                write_atomically(self.path, lambda stream: stream.write(text.encode()))
            self._known = files
        finally:
            os.close(handle)

    def _read(self) -> Files:
        if not os.path.lexists(self.path):
            return {}
        try:
            # Not awaited where somebody has put a pipe in its place.
            with os.fdopen(os.open(self.path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK), "rb") as stream:
                found = os.fstat(stream.fileno())
                text = stream.read() if stat.S_ISREG(found.st_mode) and found.st_size <= LARGEST_B else b""
            data = json.loads(text)
            files = data["files"]
            if data["recorder"] == self._recorder and all(isinstance(inode, int) for inode in files.values()):
                return dict(files)
        except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
            pass
        raise ConfigError(
            f"recorder.folder: {self.path} is not the list of the files that the recorder '{self._recorder}' wrote; "
            "move it away, and the recorder starts a new one (it then leaves all older logs alone)"
        )

    def is_own(self, files: Files, name: str) -> bool:
        """Whether there is a file of that name and it is the one that was written."""
        try:
            found = os.lstat(self._folder / name)
        except OSError:
            return False
        return stat.S_ISREG(found.st_mode) and found.st_ino == files.get(name)

    def remove(self, files: Files, name: str) -> bool:
        """Remove an own file and forget it; whether it was there."""
        own = self.is_own(files, name)
        if own:
            (self._folder / name).unlink()
        files.pop(name, None)
        return own


def _lock(handle: int) -> None:
    """Lock an open folder against other processes.  Raises OSError where one of them does not let it go."""
    until_s = time.monotonic() + LOCKED_s
    while True:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            if time.monotonic() >= until_s:
                raise OSError(errno.EWOULDBLOCK, "another process keeps it locked") from None
            time.sleep(_LOOK_s)
        else:
            return
