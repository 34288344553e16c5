"""Compile a kernel where numba is installed, run it as plain Python where it is not.

The kernels are written once, for one sample; the loop over many samples is a kernel too.  With
numba a replay runs some hundred times faster; the node does not need it.

A kernel is compiled when it is called first, which takes seconds, once on a machine: what was compiled is kept beside
the sources, or in the folder that ``NUMBA_CACHE_DIR`` names; where neither can be written, in the user's cache folder,
else in one of the user's own below the system's temporary folder.  Who cannot wait so long calls it under
:func:`at_once`.
"""

from __future__ import annotations

import contextlib
import hashlib
import logging
import os
import stat
import sys
import tempfile
import threading
import time
import types
from collections.abc import Callable, Iterator, MutableSequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

_log = logging.getLogger(__name__)
Kernel = TypeVar("Kernel", bound=Callable)
#: What :func:`floats` gives, mypy knows as this.
Floats = MutableSequence[float]

COMPILING = "compiling kernels"  #: how it is said that this is why nothing happens yet
NOT_COMPILED = "runs as plain Python: it was not compiled before it had to be quick"
_NEWS_s = 10.0  #: how often it is said that kernels are still being compiled
_PACKAGE = Path(__file__).parents[1]
_hurry = threading.local()


@contextlib.contextmanager
def at_once() -> Iterator[None]:
    """In this block, in this thread, nothing is compiled: a kernel that is not ready runs as plain Python."""
    before, _hurry.on = _in_a_hurry(), True
    try:
        yield
    finally:
        _hurry.on = before


def _in_a_hurry() -> bool:
    return getattr(_hurry, "on", False)


def _last_resort() -> str:
    """A cache folder below the system's temporary one, nobody else's: what lies in it is executed.  "" where there is
    none."""
    folder = Path(tempfile.gettempdir()) / f"sma_actuator-{os.getuid()}"
    with contextlib.suppress(OSError):
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
        if stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o077:
            return str(folder)
    return ""


@contextlib.contextmanager
def _without_coverage() -> Iterator[None]:
    """Numba imports it wherever it is installed, a sixth of its own import, and needs it only where it is at work."""
    missing = "coverage" not in sys.modules
    if missing:
        sys.modules["coverage"] = None  # type: ignore[assignment]
    try:
        yield
    finally:
        if missing:
            del sys.modules["coverage"]


try:
    if os.environ.get("SMA_ACTUATOR_NO_JIT"):
        raise ImportError
    with _without_coverage():
        import numba
    from numba import njit
    from numba.core import event

    COMPILED = True
    #: As no kernel makes an array, none needs its references counted; none is called from C.
    _ALL: dict[str, Any] = {"error_model": "numpy", "_nrt": False, "no_cfunc_wrapper": True}

    class _News(event.Listener):
        """Says that kernels are being compiled, and where they are kept."""

        def __init__(self) -> None:
            self._said_s = 0.0
            self._kernels = 0

        def on_start(self, event: Any) -> None:
            """The first of a process, and now and then another."""
            kernel = event.data["dispatcher"]
            if not kernel.py_func.__module__.startswith("sma_actuator."):
                return  # another's
            now_s = time.monotonic()
            if not self._kernels:
                _log.warning("%s, once on this machine; %s", COMPILING, _place(kernel))
                self._said_s = now_s
            elif now_s - self._said_s >= _NEWS_s:
                _log.warning("still %s, %d so far", COMPILING, self._kernels)
                self._said_s = now_s
            self._kernels += 1

        def on_end(self, event: Any) -> None:
            """Nothing."""

    event.register("numba:compile", _News())

    def _place(kernel: Any) -> str:
        """Where what is compiled will be found the next time."""
        folder = kernel.stats.cache_path
        if folder is None:
            return "no folder can be written to keep them in: set NUMBA_CACHE_DIR to one that can"
        place = Path(folder)
        return (
            f"kept in {place.parent}"
            if place.name != "__pycache__"
            else f"kept in {_PACKAGE}, in its __pycache__ folders"
        )

    def _kernel(function: Kernel, **how: bool) -> Kernel:
        try:
            kernel = njit(cache=True, **_ALL, **how)(function)
        except RuntimeError:  # of all places that numba knows none can be written
            numba.config.CACHE_DIR = _last_resort()
            kernel = njit(cache=bool(numba.config.CACHE_DIR), **_ALL, **how)(function)
        return _hurried(_fresh(kernel))

    def _fresh(kernel: Any) -> Any:
        """Have it compiled anew where a kernel that it calls, or a number that it uses, has changed in another file
        too: numba looks at its own file alone."""
        kept = getattr(getattr(kernel, "_cache", None), "_cache_file", None)
        if kept is not None:
            names, own = sorted(kernel.py_func.__code__.co_names), kernel.py_func.__globals__
            # What is called by the name of its module stands there.
            places = [own, *(vars(own[name]) for name in names if isinstance(own.get(name), types.ModuleType))]
            used = [(name, _stamp(place[name])) for place in places for name in names if name in place]
            kept._source_stamp = (kept._source_stamp, hashlib.sha256(repr(used).encode()).hexdigest())
        return kernel

    def _stamp(value: Any) -> Any:
        if isinstance(value, (bool, int, float, str, tuple)):
            return value
        return getattr(getattr(getattr(value, "_cache", None), "_cache_file", None), "_source_stamp", None)

    def jit(function: Kernel) -> Kernel:
        """Compile ``function`` to machine code and keep it in the on-disk cache.

        It may make no array, which is refused where it is compiled: what it works in it is handed.
        """
        return _kernel(function)

    def inlined(function: Kernel) -> Kernel:
        """As :func:`jit`, and put into each of its callers: for small parts of a loop."""
        return _kernel(function, forceinline=True)

    def _hurried(kernel: Any) -> Any:
        """Under :func:`at_once`, run what has not been compiled for these types as plain Python."""
        if numba.config.DISABLE_JIT:
            return kernel
        compiled_for = kernel._compile_for_args  # what numba asks where it has nothing for the types of the arguments

        def ready_or_plain(*args: Any) -> Any:
            if not _in_a_hurry():
                return compiled_for(*args)
            _log.debug("%s.%s %s", kernel.py_func.__module__, kernel.py_func.__name__, NOT_COMPILED)
            return kernel.py_func

        kernel._compile_for_args = ready_or_plain
        return kernel

except ImportError:
    COMPILED = False

    def jit(function: Kernel) -> Kernel:
        """Leave ``function`` as it is: numba is not installed (extra ``speed``)."""
        return function

    def inlined(function: Kernel) -> Kernel:
        """As :func:`jit`."""
        return function


def floats(count: int) -> Floats:
    """So many zeros for a kernel that is called in every step to remember in: a list where it is plain Python, which
    takes a number out of an array far more slowly."""
    return np.zeros(count) if COMPILED else [0.0] * count  # type: ignore[return-value]
