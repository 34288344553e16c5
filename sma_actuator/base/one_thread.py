"""Linear algebra on one thread: the fits here have hundreds of columns, not thousands.

A library that spreads them over all cores waits for each of them by turning in circles: on a machine that does anything
else a fit takes three to ten times as long, and on a quiet one it gains nothing.  Many fits at a time go to processes.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, nullcontext

try:
    from threadpoolctl import threadpool_limits
except ModuleNotFoundError:
    threadpool_limits = None


@contextmanager
def one_thread() -> Iterator[None]:
    """``with one_thread():``, or ``@one_thread()`` on a function: linear algebra keeps to the calling thread
    meanwhile."""
    with nullcontext() if threadpool_limits is None else threadpool_limits(1):
        yield
