"""Work spread over processes or a cluster, by joblib: where is decided around the call, not in it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any

import joblib

from sma_actuator.base.parameters import ConfigError

Call = tuple[Callable[..., Any], tuple[Any, ...]]


@contextmanager
def spread(jobs: int, in_order: bool = True) -> Iterator[Callable[[Iterable[Call]], Iterator[Any]]]:
    """A function that makes calls, (function, arguments), and gives their results, ``jobs`` at a time.

    ``in_order``: as they were asked for, or else each as soon as it is there.  By joblib, so that
    ``joblib.parallel_config`` around it decides where.
    """
    if jobs == 1:
        yield lambda calls: (function(*arguments) for function, arguments in calls)
        return
    with joblib.Parallel(n_jobs=jobs, return_as="generator" if in_order else "generator_unordered") as pool:
        yield lambda calls: pool(joblib.delayed(function)(*arguments) for function, arguments in calls)


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
