"""``python -m sma_actuator.identify``, the same as ``sma-actuator identify``."""

import sys

from ..cli import main

sys.exit(main(["identify", *sys.argv[1:]]))
