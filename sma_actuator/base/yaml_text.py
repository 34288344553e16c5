"""YAML, read in one way everywhere: parameter files, dialects, wires and what stands after ``-p``.

Stricter than YAML itself, so that what a file says is what a person reads in it, and so that no file costs more
time than its size: a key twice in a section, numbers that YAML reads otherwise than a person (010 is 8 to it),
types of its own, aliases, deep nesting and huge files are refused in a sentence that names the line.
"""

from __future__ import annotations

import re
from collections.abc import Hashable, Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml
from yaml.composer import Composer
from yaml.constructor import SafeConstructor

from .content import content_of
from .parameters import ConfigError

#: Sixteen of the longest wires, coils, with their tables take 530 000: six seconds, or one and a half by libyaml.
LONGEST_TEXT = 600_000
#: Sections within sections; the deepest parameter lies five down.
DEEPEST_LEVEL = 32
_TAG = "tag:yaml.org,2002:"
_TYPES = {"bool", "float", "int", "map", "null", "seq", "str", "timestamp"}
#: Numbers that a person, YAML 1.1, YAML 1.2 and ROS's parser read alike.
_PLAIN_NUMBER = re.compile(
    r"[-+]?(?:0|[1-9][0-9]*|0x[0-9A-Fa-f]+|(?:0|[1-9][0-9]*)?\.[0-9]*(?:[eE][-+]?[0-9]+)?|(?:0|[1-9][0-9]*)[eE][-+]?[0-9]+"
    r"|\.(?:inf|Inf|INF|nan|NaN|NAN))"
)
#: What only looks like one: a zero in front (eight to YAML 1.1, text where a nine follows), separators, base 60.
_ODD_NUMBER = re.compile(r"[-+]?(?:0[0-9_]|[0-9][0-9_]*[_:])[0-9_:.]*(?:[eE][-+]?[0-9]+)?|[-+]?0[bo][0-9_]+")


class _Refusal(yaml.MarkedYAMLError):
    """YAML, but not as it is taken here."""

    def __init__(self, problem: str, mark: Any):
        super().__init__(problem=problem, problem_mark=mark)


class _Plain(SafeConstructor):
    """Before a loader it refuses what is not plain."""

    level = 0

    def compose_node(self, parent: Any, index: Any) -> Any:
        """Bounded in depth, and without aliases: a few lines of them stand for gigabytes, and ROS's parser has none."""
        if self.check_event(yaml.AliasEvent):
            event = self.peek_event()
            raise _Refusal("an alias (*name) is not taken; write the values out", event.start_mark)
        self.level += 1
        if self.level > DEEPEST_LEVEL:
            raise _Refusal(f"nested more than {DEEPEST_LEVEL} levels deep", self.peek_event().start_mark)
        node = super().compose_node(parent, index)
        self.level -= 1
        return node

    def construct_object(self, node: Any, deep: bool = False) -> Any:
        """A value; one that only looks like a number or a date, or is of a type of YAML's own, is refused where it
        stands."""
        kind = node.tag.removeprefix(_TAG)
        if node.tag.startswith(_TAG) and kind not in _TYPES:
            raise _Refusal(f"!!{kind} is not taken; plain numbers, texts, lists and sections are", node.start_mark)
        number = kind in ("int", "float")
        if (number and not _PLAIN_NUMBER.fullmatch(node.value)) or (
            _is_bare(node) and _ODD_NUMBER.fullmatch(node.value)
        ):
            raise _Refusal(
                f"{_brief(node.value)} is read as different numbers by different readers of YAML; write it plainly, as "
                "10 or 1.0e-3, or in quotes where it is a text",
                node.start_mark,
            )
        try:
            return super().construct_object(node, deep=deep)
        except ValueError as error:
            raise _Refusal("a number or date that cannot be read", node.start_mark) from error

    def construct_mapping(self, node: Any, deep: bool = False) -> Any:
        """A section; of a key that stands in it twice PyYAML would take the last without a word."""
        lines: dict[Any, int] = {}
        for key_node, _ in node.value:
            key = self.construct_object(key_node, deep=True)
            if not isinstance(key, Hashable):
                raise _Refusal("a list or section cannot be a name", key_node.start_mark)
            if key in lines:
                raise _Refusal(f"'{key}' stands here twice, first in line {lines[key]}", key_node.start_mark)
            lines[key] = key_node.start_mark.line + 1
        return super().construct_mapping(node, deep=deep)


class _PythonLoader(_Plain, yaml.SafeLoader):
    """Where PyYAML was built without libyaml."""


class _LibyamlLoader(_Plain, Composer, getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """By the parser that ROS has too, in a fifth of the time; nodes are composed as in Python."""

    def __init__(self, text: str):
        yaml.CSafeLoader.__init__(self, text)
        Composer.__init__(self)


for _kind in (_PythonLoader, _LibyamlLoader):  # 175.0e6 is a number, as to ROS's parser; PyYAML wants 175.0e+6
    _kind.add_implicit_resolver(
        "tag:yaml.org,2002:float",
        re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)[eE][-+]?[0-9]+$"),
        list("-+.0123456789"),
    )
_Loader = _LibyamlLoader if yaml.__with_libyaml__ else _PythonLoader


def _is_bare(node: yaml.Node) -> bool:
    """Whether it is a word without quotes."""
    return isinstance(node, yaml.ScalarNode) and not node.style


def _brief(text: str) -> str:
    return text if len(text) <= 40 else f"{text[:30]}…"


class _Dumper(yaml.SafeDumper):
    """Lists side by side: a calibration's tables take lines, not pages."""


_Dumper.add_representer(list, lambda dumper, values: dumper.represent_sequence("tag:yaml.org,2002:seq", values, True))
_KEY = re.compile(r"( *)([A-Za-z_]\w*):")


def yaml_of(mapping: Mapping[str, Any], comments: Mapping[str, str] | None = None) -> str:
    """Text of a nested mapping; ``comments`` stand behind the parameters they belong to, by dotted name."""
    text = yaml.dump(mapping, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=120)
    if not comments:
        return text
    lines, inside = [], list[tuple[int, str]]()
    for line in text.splitlines():
        key = _KEY.match(line)
        comment = ""
        if key:
            indent = len(key[1])
            inside = [outer for outer in inside if outer[0] < indent] + [(indent, key[2])]
            comment = comments.get(".".join(name for _, name in inside), "")
        lines.append(f"{line}  # {comment}" if comment else line)
    return "\n".join(lines) + "\n"


def with_values(text: str, source: str, section: Sequence[str], values: Mapping[str, float], comment: str) -> str:
    """``text`` with other numbers in one section, and a comment above it; everything else stays as it was written.

    Raises ConfigError where the section is not there.
    """
    parse_yaml(text, source)
    key, place = None, yaml.compose(text, Loader=_Loader)
    for name in section:
        inside = place.value if isinstance(place, yaml.MappingNode) else ()
        found = [(k, v) for k, v in inside if k.value == name]
        if not found or not isinstance(found[0][1], yaml.MappingNode):
            raise ConfigError(f"{source}: has no section {'.'.join(section)}")
        key, place = found[0]
    assert key is not None
    standing = {k.value: v for k, v in place.value}
    edits = []
    for name, value in values.items():
        if name in standing:
            edits.append((standing[name].start_mark.index, standing[name].end_mark.index, repr(value)))
        elif place.flow_style:
            edits.append((place.start_mark.index + 1, place.start_mark.index + 1, f"{name}: {value!r}, "))
        else:
            first = place.start_mark.index
            edits.append((first, first, f"{name}: {value!r}\n{' ' * place.start_mark.column}"))
    line = key.start_mark.index - key.start_mark.column
    edits.append((line, line, f"{' ' * key.start_mark.column}# {comment}\n"))
    for begin, end, new in sorted(edits, key=lambda edit: edit[0], reverse=True):
        text = text[:begin] + new + text[end:]
    return text


def parse_yaml(text: str, source: str) -> Any:
    """The document in ``text``.  Raises ConfigError; its sentence names ``source`` and the line."""
    if len(text) > LONGEST_TEXT:
        raise ConfigError(f"{source}: is longer than {LONGEST_TEXT} characters; no file of parameters is")
    try:
        return yaml.load(text, Loader=_Loader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        # What is missing at the end of a text is so for libyaml in a line beyond it.
        place = f"{source}: line {min(mark.line, text.count(chr(10))) + 1}" if mark is not None else source
        words = " ".join(filter(None, (error.context, error.problem)))
        if mark is not None and "\t" in "".join(text.splitlines()[mark.line : mark.line + 1])[: mark.column + 1]:
            words += "; a tab stands there, where YAML wants blanks"
        raise ConfigError(f"{place}: {words if isinstance(error, _Refusal) else f'is not YAML: {words}'}") from error
    except yaml.YAMLError as error:
        raise ConfigError(f"{source}: is not YAML: {' '.join(str(error).split())}") from error


def read_yaml(path: str | Path, wanted: str) -> Any:
    """The document in a file.  Raises ConfigError; its sentence names the file, and says that ``wanted`` is wanted."""
    path = Path(path)
    try:
        text = content_of(path, 4 * LONGEST_TEXT).decode("utf-8-sig")  # so much UTF-8 is too long in any case
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror or error}); {wanted} is wanted") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: is not text ({error.reason} at byte {error.start}); {wanted} is wanted") from error
    return parse_yaml(text, str(path))
