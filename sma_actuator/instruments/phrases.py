"""One thing said to an instrument, and what its answer means: the entries of a dialect.

A command is one or more texts and the scale of its value.  A query is a text and the way from the line that answers it
to a value: a pattern that takes header and unit off, a field of a list, a scale, bits of a status word, words for yes
and no.
"""

from __future__ import annotations

import dataclasses
import functools
import re
import string
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from math import copysign, inf, isfinite, nan
from typing import Any, Self

from .patterns import Pattern

#: What stands in for the placeholders when a file is checked.
_TRIAL = {"channel": 1, "value": 0.5, "channels": "101,102", "samples": 50, "readings": 100}
#: How a value may be written: sign, zeros, width and decimals that a line has, and a kind that instruments read; no
#: percent, no marks between thousands.
_WRITTEN = re.compile(r"[+-]?0?\d{0,2}(\.\d{1,2})?[deEfgG]?", re.ASCII)
_WITH_A_COMMA = re.compile(r"[+-]?\d+,\d+")
_YES = {"on", "yes", "true"}
_YAMLS_WORDS = {True: "yes", False: "no"}  #: what YAML makes of the bare words as keys
_NO = {"off", "no", "false"}  #: not the empty answer: it proves nothing

SEPARATORS = (",", ";", "\t", " ", "")  #: what may stand between the numbers of a DAQ's answer; nothing: signs do
#: Where a number begins whose sign is all that tells it from the one before.
_SIGNED = re.compile(r"(?<![eE])(?=[+-])")

#: What the answer of a query is → the entries that say how it is read, beside ``ask``.
READINGS = {
    "text": ("answer",),
    "number": ("answer", "field", "base", "scale", "length", "bytes"),
    "numbers": ("answer", "scale", "separator", "columns"),
    "code": ("answer", "field", "base", "none", "length", "bytes"),
    "truth": ("answer", "field", "base", "mask", "yes", "no", "length", "bytes"),
    "words": ("answer", "field", "length"),
}


@dataclass(frozen=True, slots=True)
class Command:
    """Texts that change something."""

    texts: tuple[str, ...]
    scale: float  #: by which a value in ampere, volt or second is multiplied before it is written

    @classmethod
    def read(
        cls, name: str, entry: Any, allowed: Collection[str], needed: str | None, problems: list[str]
    ) -> Self | None:
        """Read an entry; what is wrong with it goes to ``problems``."""
        mapping = dict(entry) if isinstance(entry, Mapping) else {"tell": entry}
        texts = _texts(mapping.pop("tell", None))
        scale = mapping.pop("scale", 1.0)
        problems += [f"{name}.{key}: no such entry; known are tell, scale" for key in mapping]
        problems += _not_a_scale(f"{name}.scale", scale)
        if not texts:
            problems.append(f"{name}: {entry!r} is neither a text nor a list of them")
            return None
        seen = _wrong_placeholders(name, texts, allowed, problems)
        if needed is not None and needed not in seen:
            problems.append(f"{name}: {' | '.join(texts)!r} has no placeholder {{{needed}}}")
        return cls(texts, float(scale) if is_number(scale) else 1.0)

    def lines(self, values: Mapping[str, Any]) -> list[str]:
        """The texts, filled in."""
        if self.scale != 1.0 and "value" in values:
            values = {**values, "value": values["value"] * self.scale}
        return [text.format(**values) for text in self.texts]

    def lines_of_each(self, numbers: Sequence[int], values: Mapping[str, Any]) -> list[str]:
        """The texts, filled in; one with ``{channel}`` once for each of these channels."""
        return [
            text.format(**{**values, "channel": number})
            for text in self.texts
            for number in (numbers if asks_one(text) else numbers[:1])
        ]

    def at_most(self, value: float) -> float:
        """The most that the digits of its texts can say and that is no more than a value: the last digit must not lift
        a current over its limit."""
        written = value * self.scale
        for digits in _digits_of_value(self.texts):
            written = _rounded_down(written, digits)
        return written / self.scale


def asks_one(text: str) -> bool:
    """Whether a text is of one channel: it has the placeholder ``{channel}``, however written."""
    return any(name == "channel" for _, name, _, _ in string.Formatter().parse(text))


@functools.cache
def _digits_of_value(texts: tuple[str, ...]) -> tuple[str, ...]:
    """How each placeholder of a value is written."""
    fields = (field for text in texts for field in string.Formatter().parse(text))
    return tuple(how or "" for _, name, how, _ in fields if name == "value")


def _rounded_down(value: float, digits: str) -> float:
    text = format(value, digits)
    if float(text) > value:
        nearest = Decimal(text)
        text = format(nearest - Decimal(1).scaleb(int(nearest.as_tuple().exponent)), digits)
    return float(text)


@dataclass(frozen=True, slots=True)
class Query:
    """A text that asks, and what the line that answers it means."""

    text: str
    answer: Pattern | None = None  #: its one group is the value
    field: int = 0  #: of a list with commas, counted from 1; 0: it is no list
    base: int = 10
    scale: float = 1.0
    mask: Mapping[int, int] | int = (
        0  #: bits of a status word, any of which says yes; by channel where it depends on that
    )
    yes: Pattern | None = None
    no: Pattern | None = None
    separator: str = ","  #: of a list of numbers; a blank: any number of blanks; nothing: each begins with its sign
    columns: int = 0  #: of a list that has all that there is, whatever is wanted; 0: it has what is wanted
    none: Pattern | None = None  #: the answer where there is no error, of one that says so in words
    length: int = 0  #: characters of an answer that has no end; 0: it is a line
    bytes: int = 0  #: the same, of an answer that is no text but a number, its highest byte first

    @classmethod
    def read(cls, name: str, entry: Any, allowed: Collection[str], reading: str, problems: list[str]) -> Self | None:
        """Read an entry whose answer is a ``reading`` (a key of READINGS); what is wrong with it goes to
        ``problems``."""
        mapping = dict(entry) if isinstance(entry, Mapping) else {"ask": entry}
        mapping = {_YAMLS_WORDS.get(key, key) if isinstance(key, bool) else key: mapping[key] for key in mapping}
        text = mapping.pop("ask", None)
        known = READINGS[reading]
        problems += [
            f"{name}.{key}: no such entry here; known are ask, {', '.join(known)}" for key in mapping.keys() - known
        ]
        if not isinstance(text, str) or not text:
            shown = f"has {len(text)} texts; a query has one" if isinstance(text, list) else "is not a text"
            problems.append(f"{name}: {text!r} {shown}")
            return None
        _wrong_placeholders(name, (text,), allowed, problems)
        for key, (fits, wanted) in _QUERY_CHECKS.items():
            if key in mapping and not fits(mapping[key]):
                why = why_no_pattern(mapping[key]) if key in _PATTERNS else ""
                problems.append(f"{name}.{key}: {mapping[key]!r}; {wanted} is wanted{why}")
                del mapping[key]
        if "answer" in mapping and Pattern(mapping["answer"]).groups != 1:
            problems.append(f"{name}.answer: {mapping['answer']!r} has not one group; the value goes in (parentheses)")
        if ("yes" in mapping) != ("no" in mapping):
            problems.append(f"{name}: yes and no are wanted together: an answer that is neither proves nothing")
        if "length" in mapping and "bytes" in mapping:
            problems.append(f"{name}: length is of a text and bytes of a number; one of them is wanted")
        compiled = {key: Pattern(mapping[key]) for key in _PATTERNS if key in mapping}
        entries: dict[str, Any] = {key: value for key, value in mapping.items() if key in known}
        return cls(text, **{**entries, **compiled})

    def filled(self, values: Mapping[str, Any]) -> Self:
        """This query with the placeholders of its text filled in.  Raises KeyError for a channel without bits."""
        mask = self.mask[values["channel"]] if isinstance(self.mask, Mapping) else self.mask
        return dataclasses.replace(self, text=self.text.format(**values), mask=mask)

    def value(self, reply: str) -> str:
        """The part of an answer that counts.  Raises ValueError for one of another shape."""
        if self.answer is not None:
            found = self.answer.fullmatch(reply.strip())
            if found is None or found[1] is None:
                raise ValueError(f"'{reply}' is not like '{self.answer.pattern}'")
            reply = found[1]
        if self.field:
            parts = reply.split(",")
            if len(parts) < self.field:
                raise ValueError(f"'{reply}' has no field {self.field}")
            reply = parts[self.field - 1]
        return reply.strip()

    def number(self, reply: str) -> float:
        """A number; raises ValueError for an answer that is none."""
        value = self.value(reply)
        return self.scale * (number(value) if self.base == 10 else float(_integer(value, self.base)))

    def numbers(self, reply: str, channels: Sequence[int] = ()) -> list[float]:
        """A list of numbers; raises ValueError for an answer that is none.

        Of one with columns those of ``channels``, counted from 1; what stands in the others need not be numbers.
        """
        if self.separator:
            parts = reply.split(self.separator.strip(" ") or None)
        else:
            parts = _SIGNED.split(reply)[1:]  # before the first sign stands the instrument's own mark
        if self.columns:
            if not parts or len(parts) % self.columns:
                raise ValueError(f"'{reply}' has {len(parts)} columns, not {self.columns}")
            rows = range(0, len(parts), self.columns)
            parts = [parts[row + channel - 1] for row in rows for channel in channels]
        return [self.number(part) for part in parts]

    def code(self, reply: str) -> int:
        """The whole number at the beginning of an answer, 0: no error; raises ValueError where there is none.

        Of one that says errors in words: 0 or 1.
        """
        value = self.value(reply)
        if self.none is not None:
            return 0 if self.none.fullmatch(value) else 1
        return _integer(value if self.field or self.answer else value.split(",")[0].strip(), self.base)

    def truth(self, reply: str) -> bool:
        """Yes or no; raises ValueError for an answer that is neither."""
        value = self.value(reply)
        if self.mask:
            assert isinstance(self.mask, int)  # filled
            return bool(_integer(value, self.base) & self.mask)
        if self.yes is not None and self.no is not None:
            if self.no.fullmatch(value):
                return False
            if self.yes.fullmatch(value):
                return True
            raise ValueError(f"'{reply}' is neither '{self.yes.pattern}' nor '{self.no.pattern}'")
        return yes(value)


def fixed(queries: Iterable[Query]) -> dict[str, tuple[int, bool]]:
    """Text of each query whose answer has no end → its bytes, and whether they are a number."""
    return {each.text: (each.length or each.bytes, each.bytes > 0) for each in queries if each.length or each.bytes}


def yes(reply: str) -> bool:
    """A boolean reply: a word, or a number as SCPI may write it (``1``, ``+1``, ``1.000000E+00``).

    Raises ValueError for one that is none.
    """
    word = reply.strip().strip('"').lower()
    if word in _YES or word in _NO:
        return word in _YES
    if re.fullmatch(r"[+-]?\d+(\.\d*)?(e[+-]?\d+)?", word) and float(word) in (0.0, 1.0):
        return float(word) == 1.0
    raise ValueError(f"'{reply}' is neither on nor off")


def number(reply: str) -> float:
    """A numeric reply; 9.91e37 is SCPI's NaN, ±9.9e37 its infinity (SCPI-99, 7.2.1.4, 7.2.1.5).

    Raises ValueError for one that is none.
    """
    if "_" in reply:  # Python's own way to write numbers
        raise ValueError(f"'{reply}' is not a number")
    try:
        value = float(reply)
    except ValueError:
        why = "has a decimal comma; a point is wanted" if _WITH_A_COMMA.fullmatch(reply) else "is not a number"
        raise ValueError(f"'{reply}' {why}") from None
    if isfinite(value) and abs(value) >= 9.9e37:
        return nan if abs(value) > 9.905e37 else copysign(inf, value)
    return value


def _integer(text: str, base: int) -> int:
    """A whole number; ``0x`` and SCPI's ``#H`` say themselves that it is hexadecimal."""
    if found := re.fullmatch(r"(?:0x|#h)([0-9a-f]+)", text, re.IGNORECASE):
        return int(found[1], 16)
    if base == 16 and re.fullmatch(r"[0-9a-fA-F]+", text):
        return int(text, 16)
    if base == 10 and re.fullmatch(r"[+-]?\d+", text):
        return int(text)
    raise ValueError(f"'{text}' is not a whole number")


def is_number(value: Any) -> bool:
    """Whether it is a number as YAML has them."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def pattern_or_none(text: Any, whole: bool = True) -> Pattern | None:
    """A regular expression; None where it is none that is bounded."""
    try:
        return Pattern(text, whole)
    except ValueError:
        return None


def why_no_pattern(text: Any, whole: bool = True) -> str:
    """Why :func:`pattern_or_none` is none, to end a sentence with; "" where it is one."""
    try:
        Pattern(text, whole)
    except ValueError as error:
        return f": {error}"
    return ""


def _counts(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value > 0


_PATTERNS = ("answer", "yes", "no", "none")
#: Entry → whether a value will do, and what is wanted.
_QUERY_CHECKS: dict[str, tuple[Callable[[Any], bool], str]] = {
    "answer": (lambda value: pattern_or_none(value) is not None, "a regular expression for the whole line"),
    "yes": (lambda value: pattern_or_none(value) is not None, "a regular expression, in quotes,"),
    "no": (lambda value: pattern_or_none(value) is not None, "a regular expression, in quotes,"),
    "none": (lambda value: pattern_or_none(value) is not None, "a regular expression, in quotes,"),
    "separator": (lambda value: value in SEPARATORS, f"one of {', '.join(map(repr, SEPARATORS))}"),
    "field": (_counts, "the number of a field, from 1 on,"),
    "columns": (_counts, "how many values an answer has, from 1 on,"),
    "length": (_counts, "how many characters an answer without an end has, from 1 on,"),
    "bytes": (_counts, "of how many bytes an answer without an end is a number, from 1 on,"),
    "base": (lambda value: value in (10, 16), "10 or 16"),
    "scale": (lambda value: not _not_a_scale("", value), "a number that is not zero"),
    "mask": (
        lambda value: (
            _counts(value)
            or (isinstance(value, Mapping) and bool(value) and all(map(_counts, [*value, *value.values()])))
        ),
        "the value of a bit, or the sum of several, as 0x10, or one for each channel, as {1: 0x10, 2: 0x20},",
    ),
}


def _not_a_scale(name: str, value: Any) -> list[str]:
    good = is_number(value) and isfinite(value) and value != 0.0
    return [] if good else [f"{name}: {value!r} is not a number that is not zero"]


def _texts(entry: Any) -> tuple[str, ...]:
    """The texts of an entry; none where it is neither a text nor a list of them."""
    texts = (entry,) if isinstance(entry, str) else tuple(entry) if isinstance(entry, list) else ()
    return texts if all(isinstance(text, str) and text for text in texts) else ()


def _wrong_placeholders(name: str, texts: tuple[str, ...], allowed: Collection[str], problems: list[str]) -> set[str]:
    """The placeholders that stand in texts; what is wrong with them goes to ``problems``."""
    seen: set[str] = set()
    for text in texts:
        if not text.isprintable():
            problems.append(f"{name}: {text!r} holds what cannot be printed, as the end of a line; one line is wanted")
        try:
            parsed = [
                (field, f"!{turned}" if turned else how or "")
                for _, field, how, turned in string.Formatter().parse(text)
                if field is not None
            ]
        except ValueError as error:
            problems.append(f"{name}: '{text}' cannot be filled in ({error})")
            continue
        used = {field for field, _ in parsed}
        for field, how in parsed:
            if not _WRITTEN.fullmatch(how):
                problems.append(
                    f"{name}: '{{{field}:{how}}}' is no way to write a number; one as {{{field}:.3f}} is wanted"
                )
                return used
        for field in sorted(used - set(allowed)):
            choice = ", ".join("{" + a + "}" for a in sorted(allowed)) or "none"
            problems.append(f"{name}: '{text}' has the placeholder {{{field}}}; allowed are {choice}")
        seen |= used
        if used <= set(allowed):
            try:
                text.format(**_TRIAL)
            except ValueError as error:
                problems.append(f"{name}: '{text}' cannot be filled in ({error})")
    return seen
