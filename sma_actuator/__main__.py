"""The command ``sma-actuator``, also as ``python -m sma_actuator``, and the program ``sma_actuator_node``.

It imports next to nothing: until either is loaded, which takes seconds, Ctrl-C ends the process on the spot, since
there is nothing to tidy up; an exception would come up inside whatever is being imported.
"""

# argcomplete looks for this word in the first thousand characters: PYTHON_ARGCOMPLETE_OK

import atexit
import contextlib
import gc
import os
import signal
import sys
from collections.abc import Iterator


def main() -> int:
    """Load the command that is asked for, and run it; its exit code."""
    _leave_memory_to_the_system()
    with _ended_on_the_spot():
        from sma_actuator.cli.main import parsed, run

        args = parsed(sys.argv[1:])
    return run(args)


def node() -> int:
    """Load the nodes, and run them; the exit code."""
    _leave_memory_to_the_system()
    with _ended_on_the_spot():
        try:
            from sma_actuator.ros.node import main as run_nodes
        except ModuleNotFoundError as error:
            if error.name is None or error.name.startswith("sma_actuator"):
                raise
            from sma_actuator.base.errors import without_ros

            sys.exit(f"sma_actuator_node: {without_ros(error)}")
    return run_nodes()


def _leave_memory_to_the_system() -> None:
    """Have the interpreter not look, as it ends, for what refers to itself: of all that numba has made, that takes a
    quarter of the time in which a command does nothing else."""
    atexit.register(gc.freeze)


@contextlib.contextmanager
def _ended_on_the_spot() -> Iterator[None]:
    before = signal.getsignal(signal.SIGINT)
    if before is signal.default_int_handler:  # not where it is ignored: in the background
        signal.signal(signal.SIGINT, lambda number, _: os._exit(128 + number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


if __name__ == "__main__":
    sys.exit(main())
