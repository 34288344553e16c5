"""A session that hangs in another thread."""

import contextlib
import threading


@contextlib.contextmanager
def hanging(session):
    """In this block another thread has the session, as one has that waits for an answer."""
    held, release = threading.Event(), threading.Event()

    def hang():
        with session.lock:
            held.set()
            release.wait(60.0)

    thread = threading.Thread(target=hang)
    thread.start()
    try:
        assert held.wait(60.0)
        yield
    finally:
        release.set()
        thread.join(60.0)
