# PYTHON_ARGCOMPLETE_OK
"""The command ``sma-actuator``, also as ``python -m sma_actuator``.

It imports next to nothing: until a command is loaded, which takes seconds, Ctrl-C ends the process on the spot, since
there is nothing to tidy up; an exception would come up inside whatever is being imported.
"""

import os
import signal
import sys


def main() -> int:
    """Load the command that is asked for, and run it; its exit code."""
    before = signal.getsignal(signal.SIGINT)
    if before is signal.default_int_handler:  # not where it is ignored: in the background
        signal.signal(signal.SIGINT, lambda number, _: os._exit(128 + number))
    from sma_actuator.cli.main import parsed, run

    args = parsed(sys.argv[1:])
    signal.signal(signal.SIGINT, before)
    return run(args)


if __name__ == "__main__":
    sys.exit(main())
