"""Who has claimed an instrument is found, whatever other processes do meanwhile."""

import os
import sys

import pytest

from sma_actuator.instruments.claim import Claim

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="processes are looked up in /proc")


def test_a_process_that_ends_while_it_is_looked_at_hides_nobody(monkeypatch):
    """All others do, at once: looking for who holds a supply is what `stop` does where no node answers."""
    others, here = [], f"/proc/{os.getpid()}/"

    def ending(look):
        def at(path="."):
            text = f"{os.fspath(path)}/"
            if text.startswith("/proc/") and "/fd/" in text and not text.startswith(here):
                others.append(text)
                raise FileNotFoundError(text)
            return look(path)

        return at

    for look in ("scandir", "listdir"):
        monkeypatch.setattr(os, look, ending(getattr(os, look)))
    resource = "TCPIP::127.0.0.1::5025::SOCKET"
    assert Claim.holder(resource) is None
    claim = Claim(resource)
    try:
        assert Claim.holder(resource) == os.getpid() and others
    finally:
        claim.release()
    assert Claim.holder(resource) is None
