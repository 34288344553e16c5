"""What an attack brings home: counts, worst times, and what broke a promise."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any


@dataclass(frozen=True, slots=True)
class Violation:
    """One broken promise, and how to see it again."""

    rule: str  #: short, the same for the same rule
    detail: str
    replay: str  #: the command that shows it again

    def __str__(self) -> str:
        return f"{self.rule}: {self.detail} [{self.replay}]"


@dataclass(slots=True)
class Result:
    """Counts and violations of one attack or of many."""

    counts: Counter[str] = field(default_factory=Counter)
    worst: dict[str, float] = field(default_factory=dict)  #: largest value seen, by name with its unit
    violations: list[Violation] = field(default_factory=list)

    def to_mapping(self) -> dict[str, Any]:
        """As it is kept in a file."""
        violations = [asdict(violation) for violation in self.violations]
        return {"counts": dict(self.counts), "worst": self.worst, "violations": violations}

    @classmethod
    def from_mapping(cls, kept: Mapping[str, Any]) -> Result:
        """What a file has kept of one."""
        violations = [Violation(**violation) for violation in kept["violations"]]
        return cls(Counter(kept["counts"]), dict(kept["worst"]), violations)

    def see(self, name: str, value: float) -> None:
        """Keep ``value`` where it is the largest of its name."""
        if value > self.worst.get(name, float("-inf")):
            self.worst[name] = value

    def add(self, other: Result) -> None:
        """Take in the result of another attack."""
        self.counts += other.counts
        for name, value in other.worst.items():
            self.see(name, value)
        self.violations += other.violations

    def verdict(self) -> str:
        """Empty where nothing was broken, else every broken promise once, with how often."""
        often = Counter(violation.rule for violation in self.violations)
        first = {violation.rule: violation for violation in reversed(self.violations)}
        return "\n".join(f"{count} × {first[rule]}" for rule, count in often.most_common())
