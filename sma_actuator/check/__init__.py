"""Whether a wire is wired as its parameters say: every instrument asked, a little current, and the watchdog put to the
test."""

from .command import add_arguments, look_first, next_step, run
from .found import Found, passed
from .selftest import SelfTest

__all__ = ["Found", "SelfTest", "add_arguments", "look_first", "next_step", "passed", "run"]
