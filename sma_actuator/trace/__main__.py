"""``python -m sma_actuator.trace``, the same as ``sma-actuator trace``."""

import sys

from ..cli import main

sys.exit(main(["trace", *sys.argv[1:]]))
