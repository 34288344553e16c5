"""A process that drives an instrument of the bench, and is ended with the test."""

import json
import subprocess
import sys


class Program:
    """Runs ``script`` with a mapping of parameters; the first line that it prints is the process that waits for its
    end."""

    def __init__(self, script, mapping):
        self.process = subprocess.Popen(
            [sys.executable, "-c", script, json.dumps(mapping)], stdin=-1, stdout=-1, stderr=-1, text=True
        )
        self.waiting = int(self.process.stdout.readline())

    def close(self):
        self.process.kill()
        self.process.communicate()
