"""Judge a model on a bench log: what the node would have estimated, beside what was measured.

python examples/replay_a_log.py LOG.csv MODEL.yaml
"""

import sys

from sma_actuator.config import Config
from sma_actuator.logs.bench_log import read_bench_log
from sma_actuator.replay import replay

log, config = read_bench_log(sys.argv[1]), Config.load(sys.argv[2])
(replayed,) = replay([log], {"model": config})
error = replayed.errors["model"]
print(
    f"{log.name}: {error.working_percent:.2f} % of the stroke in the working range, {error.full_percent:.2f} % in all"
)
