"""What a log may take in memory, whatever it takes on disk: looked at before it is read, and held while libraries read
it."""

from __future__ import annotations

import contextlib
import errno
import resource
from collections.abc import Iterator
from pathlib import Path

from .errors import BenchLogError

#: That a log may take in memory: an hour of forty columns at 800 Hz.  A few bytes can stand for any number of numbers
#: in every format that packs.
LARGEST_B = 1_000_000_000
#: What any file may stand for, and how many times its own size one that stands for more: measured numbers pack to a
#: third of what they take, those of few digits and columns that stand still to a tenth.
SMALL_B, MOST_TIMES = 50_000_000, 100
#: What a library may take and write where a file lies about that: as much as the log, its bytes, and objects of them
#: twice.
UNPACKING_B = 4 * LARGEST_B


def refuse_larger(path: Path, size_B: float) -> None:
    """Raise BenchLogError where what a file holds takes more memory than a log may."""
    if size_B > LARGEST_B:
        raise BenchLogError(
            f"{path}: takes more than {LARGEST_B / 1e9:g} GB where it is unpacked; cut the log into parts"
        )
    if size_B > max(SMALL_B, MOST_TIMES * path.stat().st_size):
        raise BenchLogError(
            f"{path}: {path.stat().st_size} bytes that stand for {size_B / 1e6:.0f} MB; no log packs so well"
        )


@contextlib.contextmanager
def unpacking(path: Path) -> Iterator[None]:
    """While libraries unpack a file: what it says of its own size they may believe, or not look at.

    Raises BenchLogError where it takes more than ``UNPACKING_B`` of memory, or as much in a file.
    """
    pages = Path("/proc/self/statm").read_text().split()[0]
    most_B = {resource.RLIMIT_AS: int(pages) * resource.getpagesize() + UNPACKING_B, resource.RLIMIT_FSIZE: UNPACKING_B}
    before = {each: resource.getrlimit(each) for each in most_B}
    try:
        for each, (soft_B, hard_B) in before.items():
            stands_B = [b for b in (soft_B, hard_B) if b != resource.RLIM_INFINITY]
            resource.setrlimit(each, (min([most_B[each], *stands_B]), hard_B))
        yield
    except (MemoryError, OSError) as error:
        if isinstance(error, OSError) and error.errno != errno.EFBIG:
            raise
        raise BenchLogError(
            f"{path}: takes more than {UNPACKING_B / 1e9:g} GB where it is unpacked; cut the log into parts"
        ) from error
    finally:
        for each, limits in before.items():
            resource.setrlimit(each, limits)
