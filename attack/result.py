"""What an attack brings home: counts, worst times, and what broke a promise."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field


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
