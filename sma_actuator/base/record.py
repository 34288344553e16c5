"""Records that are made in every step: frozen for who checks types, and quick to make."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

__all__ = ["record"]

if TYPE_CHECKING:
    from dataclasses import dataclass as record
else:

    def record(*, frozen: bool, slots: bool) -> Callable[[Any], Any]:
        """A ``dataclass`` that mypy holds frozen; at run time it is not, which takes a sixth of the time to make."""
        return dataclass(slots=slots, unsafe_hash=frozen)
