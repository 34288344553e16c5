"""What the fields of other people's tables say: a number with any marks, a reading that is missing, a date, a clock;
where in a file the table begins; and the numbers of whole columns."""

from __future__ import annotations

import datetime
import math
import re
from collections.abc import Callable, Iterable, Sequence

import numpy as np

from .errors import BenchLogError
from .tables import EVENT_COLUMN
from .units import is_unit

Moment = datetime.datetime | datetime.time
#: What instruments and spreadsheets write where there is no reading.
_MISSING = {
    *("", "-", "--", "---", "nan", "+nan", "-nan", "1.#qnan", "-1.#ind", "n/a", "na", "null", "none"),
    *("#n/a", "#na", "#nv", "#value!", "#wert!", "#div/0!", "#num!", "#zahl!", "#ref!", "#bezug!"),
    *("ol", "+ol", "-ol", "ovld", "over", "overflow", "overload", "overrange", "err", "error", "invalid"),
}
_NUMBER = re.compile(r"[-+]?(?:\d+|\d{1,3}(?:[.,]\d{3})+)?(?:[.,]\d*)?(?:[eE][-+]?\d+)?")
#: SCPI's numbers for a reading beyond the range and for none at all, whatever mark the rest of the file has.
_NO_NUMBER = re.compile(r"[-+]?9[.,]91?0*e\+?37", re.IGNORECASE)
_COMMA_IN_SECONDS = re.compile(r"(\d\d:\d\d:\d\d),(\d)")
_DAY_FIRST = re.compile(r"^(\d{1,2})\.(\d{1,2})\.(\d{4})")
_YEAR_FIRST = re.compile(r"^(\d{4})/(\d{1,2})/(\d{1,2})")
_WHICH_FIRST = re.compile(r"^\d{1,2}/\d{1,2}/(?:\d{4}|\d\d)[ T,]+(?=\d{1,2}:)")
_HALF_DAY = re.compile(r"(?<![:\d])(0?[1-9]|1[0-2])(:\d\d(?::\d\d(?:\.\d*)?)?) ?([AaPp])\.?[Mm]\.?$")
_ONE_DIGIT_HOUR = re.compile(r"(^|[ T])(\d:)")
_DAY_s = 86400.0
_FEWEST_COLUMNS = 2  #: of a table that is looked for; a file of one has no time
_UNFILLED = 1  #: columns at the end that no row has, as the comments of LabVIEW


def is_missing(text: str) -> bool:
    """Whether it stands where a reading would."""
    return text.strip().lower() in _MISSING or _NO_NUMBER.fullmatch(text.strip()) is not None


def is_number(text: str) -> bool:
    """Whether it is a number, with a decimal point or comma, and marks between thousands."""
    text = text.strip()
    try:
        float(text)
    except ValueError:
        return _NUMBER.fullmatch(text) is not None and any(c.isdigit() for c in text)
    return "_" not in text  # Python's own way to write numbers: 1_0 is ten to nobody else


def decimal_mark(texts: Iterable[str], known: str = "") -> str:
    """The mark before decimals in these numbers, "" where none tells; the other one then stands between thousands.

    A mark that stands before just three digits may be either; ``known``: what was found before.  Raises ValueError with
    two numbers that contradict each other.
    """
    seen: dict[str, str] = {}
    for text in texts:
        digits = re.split(r"[eE]", text.strip())[0].lstrip("+-")
        point, comma = digits.count("."), digits.count(",")
        if is_missing(text) or (not point and not comma):
            continue
        if point and comma:
            mark = max(".,", key=digits.rfind)
        elif point + comma > 1:
            mark = "," if point else "."
        elif re.fullmatch(r"[1-9]\d{0,2}[.,]\d{3}", digits):
            continue
        else:
            mark = "." if point else ","
        seen.setdefault(mark, text.strip())
    if len(seen) > 1:
        raise ValueError(f"'{seen['.']}' and '{seen[',']}' have different decimal marks")
    mark = next(iter(seen), known)
    if known and mark != known:
        raise ValueError(f"'{seen[mark]}' has another decimal mark than the numbers before")
    return mark


def number(text: str, mark: str) -> float:
    """The number, NaN where it is missing.  ``mark``: before decimals.  Raises ValueError."""
    if is_missing(text):
        return math.nan
    if "_" in text:
        raise ValueError(f"'{text}' is not a number")
    other = "," if mark == "." else "."
    return float(text.strip().replace(other, "").replace(mark, "."))


def moment(text: str) -> Moment | None:
    """A date, or a time of day, of ISO 8601 or as people and spreadsheets write it; None where it is neither.

    ``31.12.2026 23:59:59,9``, ``2026/12/31 23:59:59.9``, ``11:59:59.9 PM``.  Of ``12/11/2026 23:59:59`` it is the time
    of day: nobody knows whether the month or the day comes first, and a log that goes on past midnight needs neither.
    """
    text = _COMMA_IN_SECONDS.sub(r"\1.\2", text.strip())
    text = _DAY_FIRST.sub(lambda d: f"{d[3]}-{int(d[2]):02}-{int(d[1]):02}", text)
    text = _YEAR_FIRST.sub(lambda d: f"{d[1]}-{int(d[2]):02}-{int(d[3]):02}", text)
    text = _WHICH_FIRST.sub("", text)
    text = _HALF_DAY.sub(lambda t: f"{int(t[1]) % 12 + 12 * (t[3] in 'Pp'):02}{t[2]}", text)
    for kind in (datetime.datetime, datetime.time):
        try:
            return kind.fromisoformat(_ONE_DIGIT_HOUR.sub(r"\g<1>0\2", text))
        except ValueError:
            pass
    return None


def seconds_between(first: Moment, last_s: float, now: Moment) -> float:
    """From the first of a column's moments until now; ``last_s``: of the row before, since a clock begins again at
    midnight.  Raises TypeError where the two are of different kinds."""
    if isinstance(first, datetime.datetime) and isinstance(now, datetime.datetime):
        return (now - first).total_seconds()
    if isinstance(first, datetime.datetime) or isinstance(now, datetime.datetime):
        raise TypeError("a date and a time of day")
    day = datetime.date(2000, 1, 1)
    seconds = (datetime.datetime.combine(day, now) - datetime.datetime.combine(day, first)).total_seconds()
    return seconds + _DAY_s * round((last_s - seconds) / _DAY_s)


def _is_value(text: str) -> bool:
    return bool(text.strip()) and (is_number(text) or is_missing(text) or moment(text) is not None)


def find_table(rows: Sequence[Sequence[str]]) -> tuple[int, int, int] | None:
    """Which row has the names of the columns, where the numbers begin, and how much speaks for it; None where there is
    no table.

    It is where the most values stand in rows of one width, with names right above them, or a row of units between; the
    same names again belong to the same table.
    """
    tables: dict[tuple[str, ...], tuple[int, int, int]] = {}
    begin = 0
    while begin < len(rows):
        width, end, values = len(rows[begin]), begin, 0
        while end < len(rows) and len(rows[end]) == width and _mostly_values(rows[end]):
            values += sum(1 if _is_value(text) else -1 for text in rows[end] if text.strip())
            end += 1
        at = _names_above(rows, begin, end) if end > begin else None
        if at is not None:
            names, first, before = tables.get(tuple(rows[at]), (at, begin, 0))
            tables[tuple(rows[at])] = names, first, before + values
        begin = max(end, begin + 1)
    return max(tables.values(), key=lambda table: table[2], default=None)


def _mostly_values(fields: Sequence[str]) -> bool:
    filled = [text for text in fields if text.strip()]
    # First what is asked quickly: with every other separator than its own a line is one long text.
    return any(map(is_number, filled)) and 2 * sum(map(_is_value, filled)) >= max(_FEWEST_COLUMNS, len(filled))


def _names_above(rows: Sequence[Sequence[str]], begin: int, end: int) -> int | None:
    above = begin - 1
    if above > 0 and are_units(rows[above]) and _are_names(rows[above - 1], rows[begin:end]):
        above -= 1
    return above if above >= 0 and _are_names(rows[above], rows[begin:end]) else None


def are_units(fields: Sequence[str]) -> bool:
    """Whether a row below the names says their units."""
    filled = [text for text in fields if text.strip()]
    known = sum(map(is_unit, filled))
    return 2 * known > len(filled) and not any(map(is_number, filled))


def _are_names(fields: Sequence[str], below: Sequence[Sequence[str]]) -> bool:
    width = len(trimmed(fields))
    fits = all(not any(text.strip() for text in row[width:]) and len(row) >= width - _UNFILLED for row in below)
    return width >= _FEWEST_COLUMNS and fits and not any(text and is_number(text) for text in fields)


def trimmed(fields: Sequence[str]) -> list[str]:
    """The fields without those that are empty at the end: many programs end each row with a separator."""
    width = max((i + 1 for i, text in enumerate(fields) if text.strip()), default=0)
    return list(fields[:width])


class Columns:
    """What the columns of a table hold, by its first row, and their numbers, block by block."""

    def __init__(self, names: Sequence[str], usual_mark: str):
        """``usual_mark``: before decimals, where the numbers do not tell."""
        self.names, self._usual_mark = names, usual_mark
        self.events: dict[int, str] = {}  #: row → text of the column ``event``
        self.left_out: dict[str, str] = {}  #: columns of text, with the first
        self.moments: dict[str, Moment] = {}  #: columns of dates or times of day, with the first
        self.missing: dict[str, None] = {}  #: words that stood for a reading
        self.mark = ""  #: before decimals
        self._last_s: dict[str, float] = {}  #: of the moments
        self._known = False  #: whether the kinds of the columns are

    def of(self, rows: Sequence[Sequence[str]], first: int, place: Callable[[int], str]) -> np.ndarray:
        """The numbers of some rows, shape (rows, columns).

        ``first``: number of the first row; ``place`` says of a row of these where it stands.  Raises BenchLogError.
        """
        out = np.full((len(rows), len(self.names)), np.nan)
        if not rows:
            return out
        if not self._known:
            self._find_kinds(rows[0])
        numbers = []
        for j, name in enumerate(self.names):
            column = [fields[j] for fields in rows]
            if name == EVENT_COLUMN:
                self.events.update({first + i: text for i, text in enumerate(column) if text})
            elif name in self.moments:
                out[:, j] = [self._seconds(text, name, i, place) for i, text in enumerate(column)]
            elif name not in self.left_out:
                numbers.append((j, name, column))
        if any("," in text for _, _, column in numbers for text in column):
            told = (text for _, _, column in numbers for text in column if is_number(text))
            try:
                self.mark = decimal_mark(told, self.mark) or self._usual_mark
            except ValueError as error:
                raise BenchLogError(f"{place(0)} or after it: {error}; one of them is wanted") from None
        for j, name, column in numbers:
            out[:, j] = self._numbers(column, name, place)
        return out

    def _find_kinds(self, fields: Sequence[str]) -> None:
        """What the columns hold, by the first row."""
        self._known = True
        for name, text in zip(self.names, fields, strict=True):
            if name == EVENT_COLUMN or is_number(text) or is_missing(text):
                continue
            first = moment(text)
            if first is None:
                self.left_out[name] = text
            else:
                self.moments[name] = first

    def _numbers(self, column: list[str], name: str, place: Callable[[int], str]) -> np.ndarray:
        if self.mark != "," and not any("_" in text for text in column):
            try:
                return np.array(column, dtype=float)
            except ValueError:
                pass
        out = np.empty(len(column))
        for i, text in enumerate(column):
            try:
                out[i] = number(text, self.mark or ".")
            except ValueError:
                raise BenchLogError(f"{place(i)}, column {name}: '{text.strip()}' is not a number") from None
            if np.isnan(out[i]) and text.strip().lower() not in ("", "nan"):
                self.missing[text.strip()] = None
        return out

    def _seconds(self, text: str, name: str, i: int, place: Callable[[int], str]) -> float:
        now = moment(text)
        try:
            if now is None:
                raise TypeError
            self._last_s[name] = seconds_between(self.moments[name], self._last_s.get(name, 0.0), now)
        except TypeError:
            raise BenchLogError(f"{place(i)}, column {name}: '{text.strip()}' is not a date like the first") from None
        return self._last_s[name]
