"""``python -m sma_actuator.forward``, the same as ``sma-actuator forward``."""

import sys

from ..cli import main

sys.exit(main(["forward", *sys.argv[1:]]))
