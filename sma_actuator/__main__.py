"""``python -m sma_actuator`` is the command ``sma-actuator``."""

import sys

from sma_actuator.cli.main import main

sys.exit(main())
