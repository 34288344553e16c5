"""Work on a log during which its process dies, once."""

import os
import signal
from pathlib import Path

from sma_actuator.replay.command import judge_logs

MARK = "SMA_FLEET_TEST_HAS_DIED"  #: names a file in the environment


def judge_logs_and_die_once(paths, config, options):
    mark = Path(os.environ[MARK])
    if "partial_1.200N" in paths[0].name and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return judge_logs(paths, config, options)
