"""What an owner accepts of a supply that lacks it, so that it is opened all the same."""

UNSAFE = {f"supply.allow_{what}": True for what in ("no_watchdog", "single_session", "no_trips")}
