"""Compile a kernel where numba is installed, run it as plain Python where it is not.

The kernels are written once, for one sample; the loop over many samples is a kernel too.  With
numba a replay runs some hundred times faster; the node does not need it.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import TypeVar

Kernel = TypeVar("Kernel", bound=Callable)

try:
    if os.environ.get("SMA_ACTUATOR_NO_JIT"):
        raise ImportError
    from numba import njit

    COMPILED = True

    def jit(function: Kernel) -> Kernel:
        """Compile ``function`` to machine code and keep it in the on-disk cache."""
        return njit(cache=True, error_model="numpy")(function)

    def inlined(function: Kernel) -> Kernel:
        """Compile ``function`` into each of its callers: for parts of a loop that are handed arrays, whose counting of
        references would else cost more than they do."""
        return njit(inline="always", error_model="numpy")(function)

except ImportError:
    COMPILED = False

    def jit(function: Kernel) -> Kernel:
        """Leave ``function`` as it is: numba is not installed (extra ``speed``)."""
        return function

    def inlined(function: Kernel) -> Kernel:
        """As :func:`jit`."""
        return function
