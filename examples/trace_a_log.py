"""Find what a model lacks in logs with a measured displacement, without the command and its files.

python examples/trace_a_log.py MODEL.yaml LOG.csv …
"""

import sys

from sma_actuator.config import Config
from sma_actuator.diagnosis.trace import Evidence, trace
from sma_actuator.logs.bench_log import read_bench_log

if __name__ == "__main__":  # the fits run in processes of their own
    evidence = Evidence([read_bench_log(path) for path in sys.argv[2:]], Config.load(sys.argv[1]))
    tracing = trace(evidence, without=("minor_loop_memory", "rate"))
    print(f"{tracing.verdict}: {', '.join(tracing.names) or 'nothing'}")
    before, after = (errors.percent.mean() for errors in (tracing.before, tracing.after))
    print(f"{before:.2f} % of the stroke before, {after:.2f} % after, in the mean over cycles")
