"""A time that depends on the parameters: written once, computed and printed from that."""

from __future__ import annotations

import operator
from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce
from typing import Any

_SUM, _PRODUCT, _ATOM = range(3)  #: how tightly the outermost operation binds


@dataclass(frozen=True, slots=True, eq=False)
class Formula:
    """An expression of parameters and numbers; ``str`` gives its text, a call its value for a configuration."""

    text: str
    value: Callable[[Any], float]
    binds: int = _ATOM

    def __call__(self, config: Any) -> float:
        """The value for a configuration."""
        return self.value(config)

    def __str__(self) -> str:
        return self.text

    def __add__(self, other: Formula | float) -> Formula:
        return _join(self, "+", other, operator.add, _SUM)

    def __radd__(self, other: float) -> Formula:
        return _number(other) + self

    def __mul__(self, other: Formula | float) -> Formula:
        return _join(self, "*", other, operator.mul, _PRODUCT)

    def __rmul__(self, other: float) -> Formula:
        return _number(other) * self

    def __truediv__(self, other: Formula | float) -> Formula:
        return _join(self, "/", other, operator.truediv, _PRODUCT)

    def __rtruediv__(self, other: float) -> Formula:
        return _number(other) / self


def parameter_value(name: str) -> Formula:
    """The value of the parameter with a dotted name."""
    return Formula(name, lambda config: float(reduce(getattr, name.split("."), config)))


def seconds(value: float) -> Formula:
    """A time that depends on nothing."""
    return _number(value)


def longest(*terms: Formula | float) -> Formula:
    """The largest of several times."""
    formulas = [_as_formula(term) for term in terms]
    return Formula(f"max({', '.join(map(str, formulas))})", lambda config: max(f(config) for f in formulas))


def _number(value: float) -> Formula:
    return Formula(f"{value:g}", lambda _config: value)


def _as_formula(term: Formula | float) -> Formula:
    return term if isinstance(term, Formula) else _number(term)


def _join(left: Formula, sign: str, other: Formula | float, compute: Callable[..., float], binds: int) -> Formula:
    right = _as_formula(other)
    before = f"({left})" if left.binds < binds else str(left)
    after = f"({right})" if binds == _PRODUCT and right.binds != _ATOM else str(right)
    space = "" if sign == "/" else " "
    return Formula(f"{before}{space}{sign}{space}{after}", lambda config: compute(left(config), right(config)), binds)
