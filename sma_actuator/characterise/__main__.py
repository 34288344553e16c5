"""``python -m sma_actuator.characterise``, the same as ``sma-actuator characterise``."""

import sys

from ..cli import main

sys.exit(main(["characterise", *sys.argv[1:]]))
