"""Parts by name: those of this package, and those that other installed packages bring.

A part (a strain model, an effect, a control law) registers itself by a decorator where it is written.
Another package brings one by an entry point of the registry's group, whose name is the part's and whose
value is the module, or anything in it, that registers it when it is imported::

    [project.entry-points."sma_actuator.effects"]
    stiction = "my_package.stiction"

Entry points are loaded once, the first time that a name is asked for which is not this package's own, or
that all names are.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from importlib.metadata import entry_points
from typing import Any, Generic, TypeVar

from .errors import UserError
from .plug_ins import MEND, PlugInError, described, load_plug_in

Part = TypeVar("Part")


class PartRefusedError(UserError, TypeError):
    """A part that does not say of itself what is wanted.  The sentence names it."""


class Registry(Mapping[str, Part], Generic[Part]):
    """The parts of one kind, in the order of ``rank`` and then of their registration, this package's own first.

    ``kind`` is what one is called in sentences.  ``group`` names the entry points of other packages.
    ``refusal(name, part)`` says in a sentence what is wrong with a part, or nothing.
    """

    def __init__(
        self,
        kind: str,
        group: str,
        refusal: Callable[[str, Part], str] = lambda _name, _part: "",
        rank: Callable[[Part], int] = lambda _part: 0,
    ):
        self.kind, self.group = kind, group
        self._refusal, self._rank = refusal, rank
        self._parts: dict[str, Part] = {}
        self._loaded = False
        self._broken: list[str] = []

    def register(self, name: str) -> Callable[[Part], Part]:
        """Decorate a part, which is known by ``name`` from then on.

        Raises PartRefusedError where the name is taken or the part does not say of itself what is wanted.
        """

        def add(part: Part) -> Part:
            taken = f"there is one of that name already, {self._parts[name]!r}" if name in self._parts else ""
            wrong = taken or self._refusal(name, part)
            if wrong:
                raise PartRefusedError(f"{self.kind} '{name}': {wrong}")
            self._parts[name] = part
            self._parts = dict(sorted(self._parts.items(), key=lambda item: self._rank(item[1])))
            return part

        return add

    @property
    def registered(self) -> Mapping[str, Part]:
        """Those that are known so far; no plug-in is loaded for it."""
        return self._parts

    def name_of(self, part: Any) -> str:
        """The name of a registered part.  Raises KeyError for any other."""
        for name, known in self._parts.items():
            if known is part:
                return name
        raise KeyError(part)

    def __getitem__(self, name: str) -> Part:
        if name not in self._parts:
            self._load()
        return self._parts[name]

    def __iter__(self) -> Iterator[str]:
        self._load()
        return iter(tuple(self._parts))

    def __len__(self) -> int:
        self._load()
        return len(self._parts)

    def _load(self) -> None:
        if not self._loaded:
            self._loaded = True  # before, for a plug-in may look at what is registered
            for point in entry_points(group=self.group):
                try:
                    load_plug_in(point)
                except PlugInError as error:
                    self._broken.append(str(error))
                else:
                    if point.name not in self._parts:
                        self._broken.append(f"{described(point)} registers no {self.kind} '{point.name}'; {MEND}")
        if self._broken:
            raise PlugInError("\n".join(self._broken))
