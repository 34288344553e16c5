"""Code of other installed packages, loaded so that nothing which it does on the way takes this process along.

What hangs, or ends the process, when it is imported is found in a process of its own first, and named.
"""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
import tempfile
from importlib.metadata import EntryPoint
from typing import Any

from .errors import UserError
from .interrupts import kept_handlers

#: How a sentence about a broken package ends.
MEND = "mend the package or uninstall it"
#: A package has so long to be imported: the largest take ten seconds on a slow machine.
LOAD_TIMEOUT_s = 60.0
#: Which entry points were imported without harm, by this process or the one that started it.
_HARMLESS = "SMA_ACTUATOR_PLUG_INS"
_LOOK = """
import os, signal, sys
from importlib.metadata import EntryPoint
parent, done, name, value, group, *sys.path[:] = sys.argv[1:]
from sma_actuator.base.parent import end_with
end_with(int(parent), signal.SIGKILL)  # one that hangs stays behind nobody
try:
    EntryPoint(name, value, group).load()
except Exception:
    pass  # is said where it is loaded for good
sys.__stdout__.write(done)
sys.__stdout__.flush()
"""


class PlugInError(UserError):
    """An installed package whose part cannot be loaded.  The sentence names the package."""


def described(point: EntryPoint) -> str:
    """An entry point and its package, to begin a sentence with."""
    package = f"package '{point.dist.name}' {point.dist.version}" if point.dist else "an installed package"
    return f"{package}: its entry point {point.name} = {point.value} ({point.group})"


def load_plug_in(point: EntryPoint) -> Any:
    """What an entry point names; what it does to signals when it is imported is undone, for they switch the output off.

    Raises PlugInError, whatever is wrong with it.
    """
    harm = _harm(point)
    if harm:
        raise PlugInError(f"{described(point)} {harm} when it is imported; {MEND}")
    try:
        with kept_handlers():
            return point.load()
    except (Exception, SystemExit) as error:  # whatever it is: the code is somebody else's
        raise PlugInError(f"{described(point)} cannot be loaded: {type(error).__name__}: {error}; {MEND}") from error


def _harm(point: EntryPoint) -> str:
    """What importing it does to a process, in words; empty where nothing."""
    version = point.dist.version if point.dist else ""
    key = hashlib.sha256(f"{point.group} {point.name} {point.value} {version}".encode()).hexdigest()[:16]
    known = os.environ.get(_HARMLESS, "").split()
    if key in known or not sys.executable:
        return ""
    # A plug-in that asks for parts of its own kind is not looked at again by the process that looks at it.
    harmless = " ".join([*known, key])
    command = [sys.executable, "-c", _LOOK, str(os.getpid()), key, point.name, point.value, point.group, *sys.path]
    with tempfile.TemporaryFile() as said:  # no pipe: what the package started may hold it open for ever
        try:
            code = subprocess.run(
                command,
                env={**os.environ, _HARMLESS: harmless},
                stdin=subprocess.DEVNULL,
                stdout=said,
                stderr=subprocess.DEVNULL,
                timeout=LOAD_TIMEOUT_s,
                start_new_session=True,
                check=False,
            ).returncode
        except subprocess.TimeoutExpired:
            return f"does not come to an end within {LOAD_TIMEOUT_s:g} s"
        said.seek(0)
        if not said.read().endswith(key.encode()):
            return f"ends the process with signal {-code}" if code < 0 else f"ends the process with code {code}"
    os.environ[_HARMLESS] = harmless
    return ""
