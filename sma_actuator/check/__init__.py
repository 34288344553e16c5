"""Whether a wire is wired as its parameters say: every instrument asked, a little current, and the watchdog put to the
test."""

from .found import Found, passed
from .selftest import SelfTest

__all__ = ["Found", "SelfTest", "passed"]
