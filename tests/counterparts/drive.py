"""A program that drives through a counterpart until it is ended: ``drive.py BACK_DOOR`` with the parameters as JSON
on its standard input.  It prints one line once current flows."""

import json
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))
from counterpart import BackDoor, Rig
from ending import signals_end_the_program


def main():
    with signals_end_the_program():
        rig = Rig(json.load(sys.stdin), BackDoor(int(sys.argv[1])))
        with rig.driver:
            rig.driver.start()
            rig.drive()
            print("it flows", flush=True)
            while True:
                time.sleep(60.0)


if __name__ == "__main__":
    main()
