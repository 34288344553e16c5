"""Work spread over processes or a cluster, by joblib: where is decided around the call, not in it."""

from __future__ import annotations

import os
import signal
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any

import joblib
from joblib.parallel import LokyBackend, get_active_backend

from sma_actuator.base.interrupts import handled_signals, noted_signals
from sma_actuator.base.parameters import ConfigError
from sma_actuator.base.parent import end_with

Call = tuple[Callable[..., Any], tuple[Any, ...]]

#: Said of a process that ended between two calls because it had grown: another takes its place, and nothing is lost.
warnings.filterwarnings("ignore", "A worker stopped while some jobs were given to the executor", UserWarning)


@contextmanager
def spread(jobs: int, in_order: bool = True) -> Iterator[Callable[[Iterable[Call]], Iterator[Any]]]:
    """A function that makes calls, (function, arguments), and gives their results, ``jobs`` at a time.

    ``in_order``: as they were asked for, or else each as soon as it is there.  By joblib, so that
    ``joblib.parallel_config`` around it decides where.
    """
    if jobs == 1:
        yield lambda calls: (function(*arguments) for function, arguments in calls)
        return
    here = {"backend": _EndingWithUs()} if isinstance(get_active_backend()[0], LokyBackend) else {}
    with joblib.Parallel(n_jobs=jobs, return_as="generator" if in_order else "generator_unordered", **here) as pool:
        yield lambda calls: pool(joblib.delayed(function)(*arguments) for function, arguments in calls)


class _EndingWithUs(LokyBackend):
    """Processes that end with their parent, whatever ends that: they would reckon on, and then wait five minutes for
    more."""

    def configure(self, *args: Any, **kwargs: Any) -> Any:
        """As joblib does it, and each begins so: at once, all of them, whom no Ctrl-C leaves half begun with a
        traceback each."""
        with noted_signals(handled_signals()) as interrupts:
            jobs = super().configure(*args, initializer=end_with, initargs=(os.getpid(), signal.SIGKILL), **kwargs)
            self._workers.submit(int)
        interrupts.raise_noted()
        return jobs


@contextmanager
def cluster(address: str | None) -> Iterator[None]:
    """Have joblib work on the Dask cluster at ``address``, where one is named.

    Raises ConfigError where there is none, or Dask is not installed.
    """
    if not address:
        yield
        return
    try:
        from dask.distributed import Client

        client = Client(address, timeout=10)
    except ModuleNotFoundError as error:
        raise ConfigError(f"--dask: needs the Python package '{error.name}' (extra 'fleet')") from error
    except (OSError, ValueError) as error:
        raise ConfigError(
            f"--dask: no scheduler answers at '{address}' ({error}); start one with `dask scheduler`"
        ) from error
    with client, joblib.parallel_config("dask"):
        yield
