"""``python -m sma_actuator.replay``, the same as ``sma-actuator replay``."""

import sys

from ..cli import main

sys.exit(main(["replay", *sys.argv[1:]]))
