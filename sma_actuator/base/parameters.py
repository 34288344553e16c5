"""How a parameter is declared: once, with its description, unit and range.

A section of parameters is a frozen dataclass whose fields are made by :func:`parameter`.  From
that one declaration come the validation of YAML files, the ROS parameter descriptors of the node
and the parameter table of the documentation.
"""

from __future__ import annotations

import dataclasses
import difflib
import math
from collections.abc import Callable, Collection, Iterator, Mapping, Set
from typing import Any, Literal, get_args

from .errors import UserError
from .registry import Registry

_REQUIRED = object()
_MOST_UNKNOWN = 20  #: unknown parameters of a section that are named
_NOT_GIVEN = object()
#: Characters of a text: PATH_MAX of Linux, as some name a file.
LONGEST_LINE = 4096
#: Characters of a name: NAME_MAX of Linux; topics of ROS 2 with a name in them have as many at the most.
LONGEST_NAME = 255

#: Whether a parameter may be changed while the wire is driven, and which way.  What bounds what a wrong command or
#: reading may do, or for how long, guards: while current may flow it becomes only stricter.  So every live parameter
#: says which values guard more, of choices the later ones, or that either way guards the same: gains, filters, goals.
Live = Literal["", "lower", "higher", "later", "either"]


class ConfigError(UserError, ValueError):
    """A configuration that must not reach the wire.  ``problems`` holds one sentence each."""

    def __init__(self, problems: list[str] | str):
        self.problems = [problems] if isinstance(problems, str) else list(problems)
        super().__init__("\n".join(self.problems))


@dataclasses.dataclass(frozen=True, slots=True)
class Declaration:
    """What is known of a parameter besides its value."""

    description: str
    unit: str = ""
    lo: float = -math.inf
    hi: float = math.inf  #: of a text, how many characters it may have
    choices: tuple[str, ...] = ()
    live: Live = ""  #: whether it may be changed while the wire is driven, and then which value guards more
    optional: bool = False  #: NaN, "" or an empty list stand for "not given"
    hint: str = ""  #: what a value outside the range usually means
    zero_is_never: bool = False  #: of a bound: 0 stands for none, and guards least

    @property
    def stricter(self) -> str:
        """Of what guards, which values guard more, in words; "" of all else."""
        if self.live == "later":
            return f"later in {', '.join(self.choices)}"
        if self.live in ("lower", "higher"):
            return f"{self.live}, never 0" if self.zero_is_never else self.live
        return ""

    def loosens(self, before: Any, after: Any) -> bool:
        """Whether less is guarded after a change: while current may flow, that is no live change."""
        return bool(self.stricter) and self._guards(after) < self._guards(before)

    def _guards(self, value: Any) -> float:
        """How much a value guards, in whatever unit."""
        if self.live == "later":
            return self.choices.index(value)
        if self.zero_is_never and value == 0:
            return -math.inf
        return float(value if self.live == "higher" else -value)


def parameter(
    default: Any = _REQUIRED,
    description: str = "",
    unit: str = "",
    lo: float = -math.inf,
    hi: float = math.inf,
    choices: tuple[str, ...] = (),
    live: Live = "",
    optional: bool = False,
    hint: str = "",
    zero_is_never: bool = False,
) -> Any:
    """Declare one parameter as a dataclass field; without ``default`` it must be given."""
    if live not in get_args(Live):
        raise ValueError(
            f"live={live!r}; one of {', '.join(map(repr, get_args(Live)))} is wanted: which value guards more"
        )
    declaration = Declaration(description, unit, lo, hi, tuple(choices), live, optional, hint, zero_is_never)
    metadata = {"parameter": declaration}
    if default is _REQUIRED:
        return dataclasses.field(metadata=metadata, kw_only=True)
    if isinstance(default, (list, tuple)):
        return dataclasses.field(default=tuple(default), metadata=metadata, kw_only=True)
    return dataclasses.field(default=default, metadata=metadata, kw_only=True)


def section(default_factory: Any, description: str) -> Any:
    """Declare a nested section (another dataclass of parameters)."""
    return dataclasses.field(default_factory=default_factory, metadata={"section": description}, kw_only=True)


def typed_section(variants: Callable[[], Registry[Any]], description: str, default: str = "") -> Any:
    """Declare a section whose parameter ``type`` decides what else it holds.

    ``variants`` gives the registry that holds, for each value of ``type``, the dataclass of its parameters.
    Without ``default`` the type must be given.
    """
    return dataclasses.field(metadata={"variants": variants, "section": description, "type": default}, kw_only=True)


def sections_by_name(registry: Registry[Any]) -> Any:
    """Declare that a section holds others beside its parameters, each named like the class in ``registry`` it is of.

    The field maps the names of those that are there to their sections.
    """
    return dataclasses.field(default_factory=dict, metadata={"named": registry}, kw_only=True)


def type_of(field: dataclasses.Field[Any], instance: Any) -> str:
    """The value of ``type`` that stands for ``instance`` in a section made by :func:`typed_section`."""
    name: str = field.metadata["variants"]().name_of(type(instance))
    return name


def type_declaration(field: dataclasses.Field[Any]) -> Declaration:
    """The declaration of the parameter ``type`` of a section made by :func:`typed_section`."""
    return Declaration(f"type of the {field.metadata['section']}")


def declaration_of(field: dataclasses.Field[Any]) -> Declaration:
    """The :class:`Declaration` of a dataclass field made by :func:`parameter`."""
    declaration: Declaration = field.metadata["parameter"]
    return declaration


def check(name: str, value: Any, declaration: Declaration, kind: str) -> tuple[Any, str]:
    """Convert ``value`` to the declared type; return it and a sentence when it will not do.

    ``kind`` is the annotation of the field as text: ``float``, ``int``, ``bool``, ``str``,
    ``tuple[float, ...]`` or ``tuple[str, ...]``.
    """
    if kind.startswith("tuple"):
        if isinstance(value, (str, bytes, Mapping, Set)) or not hasattr(value, "__iter__"):
            return value, f"{name}: {_shown(value)} is not a list, as [a, b] is"
        inner = "float" if "float" in kind else "int" if "int" in kind else "str"
        items = []
        for i, item in enumerate(value):
            converted, problem = check(f"{name}[{i}]", item, declaration, inner)
            if problem:
                return value, problem
            items.append(converted)
        if not items and not declaration.optional:
            return value, f"{name}: the list is empty; {_wanted(declaration, inner)}"
        return tuple(items), ""
    if kind == "str":
        return value, _problem_of_text(name, value, declaration)
    if kind == "bool":
        return (value, "") if isinstance(value, bool) else (value, f"{name}: {_shown(value)} is not true or false")
    return _check_number(name, value, declaration, kind)


def _problem_of_text(name: str, value: Any, declaration: Declaration) -> str:
    if not isinstance(value, str):
        return f"{name}: {_shown(value)} is not text"
    if declaration.optional and value == "":
        return ""
    if declaration.choices:
        known = ", ".join(declaration.choices)
        return "" if value in declaration.choices else f"{name}: {_shown(value)} is not one of {known}"
    wanted = _wanted(declaration, "str")
    if not value.isprintable():
        return f"{name}: {_shown(value)} holds what cannot be printed, as the end of a line; {wanted}"
    if not value.strip():
        return f"{name}: is empty; {wanted}"
    return f"{name}: {_shown(value)} is too long; {wanted}" if len(value) > longest(declaration) else ""


def longest(declaration: Declaration) -> int:
    """How many characters a text may have."""
    return int(min(declaration.hi, LONGEST_LINE))


def _check_number(name: str, value: Any, declaration: Declaration, kind: str) -> tuple[Any, str]:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        text = f"{name}: {_shown(value)} is not a number; {_wanted(declaration, kind)}"
        if isinstance(value, str) and _is_number(value):
            text += f" (YAML reads {value} as text: write it with a decimal point, 1.0e-6)"
        return value, text
    try:
        number = float(value)
    except OverflowError:  # a whole number of hundreds of digits
        number = math.inf if value > 0 else -math.inf
    if math.isnan(number) and declaration.optional and kind == "float":
        return number, ""
    if not (math.isfinite(number) and declaration.lo <= number <= declaration.hi):
        hint = f"; {declaration.hint}" if declaration.hint else ""
        return value, f"{name}: {number:g} is outside its range; {_wanted(declaration, kind)}{hint}"
    if kind == "int":
        if int(value) != value:
            return value, f"{name}: {value!r} is not a whole number; {_wanted(declaration, kind)}"
        return int(value), ""
    return number, ""


def _shown(value: Any) -> str:
    """The value as it stands in a sentence: not more of it than a person reads."""
    text = repr(value)
    return text if len(text) <= 80 else f"{text[:60]}… ({len(text)} characters)"


def _brief(name: str) -> str:
    return name if len(name) <= 80 else f"{name[:60]}…"


def _wanted(declaration: Declaration, kind: str) -> str:
    if declaration.choices:
        return f"one of {', '.join(declaration.choices)} is wanted ({declaration.description})"
    if "str" in kind:
        return f"one line of at most {longest(declaration)} characters is wanted ({declaration.description})"
    if kind == "bool":
        return f"true or false is wanted ({declaration.description})"
    unit = f" {declaration.unit}" if declaration.unit not in ("", "1") else ""
    lo, hi = declaration.lo, declaration.hi
    if math.isinf(lo) and math.isinf(hi):
        return f"a finite number{unit} is wanted ({declaration.description})"
    if math.isinf(hi):
        return f"at least {lo:g}{unit} is wanted ({declaration.description})"
    if math.isinf(lo):
        return f"at most {hi:g}{unit} is wanted ({declaration.description})"
    return f"{lo:g} to {hi:g}{unit} is wanted ({declaration.description})"


def _is_number(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False


def look_up(cls: type, name: str, prefix: str = "") -> tuple[Declaration, str]:
    """Declaration and kind of the parameter with a dotted name below ``cls``, whose own is ``prefix``.

    Raises ConfigError where there is none.
    """
    head, _, rest = name.partition(".")
    fields = {f.name: f for f in dataclasses.fields(cls)}
    if head not in fields:
        raise ConfigError(no_such_parameter(head, fields, prefix))
    field = fields[head]
    if "parameter" in field.metadata and not rest:
        return declaration_of(field), str(field.type)
    if "variants" in field.metadata and rest:
        return _look_up_typed(field, rest, f"{prefix}{head}.")
    if "section" in field.metadata and rest:
        inside: Any = field.default_factory
        return look_up(inside, rest, f"{prefix}{head}.")
    raise ConfigError(f"{prefix}{name}: is no parameter")


def _look_up_typed(field: dataclasses.Field[Any], name: str, prefix: str) -> tuple[Declaration, str]:
    """As :func:`look_up`, in a section whose type decides what it holds: of its usual type first, then of any."""
    variants, usual = field.metadata["variants"](), field.metadata["type"]
    if name == "type":
        return dataclasses.replace(type_declaration(field), choices=tuple(variants)), "str"
    errors = []
    for each in sorted(variants, key=lambda variant: variant != usual):
        try:
            return look_up(variants[each], name, prefix)
        except ConfigError as error:
            errors.append(error)
    raise errors[0]


def from_mapping(cls: type, mapping: Mapping[str, Any], prefix: str = "") -> tuple[Any, list[str]]:
    """Build ``cls`` from a nested mapping; return it (or None) and every problem found.

    A class with ``contradictions()`` says itself what no single range can.
    """
    if not isinstance(mapping, Mapping):
        return None, [not_a_section(prefix.rstrip(".") or "configuration", mapping)]
    fields = {f.name: f for f in dataclasses.fields(cls) if f.init and "named" not in f.metadata}
    values, problems = _read_others(cls, {key: mapping[key] for key in mapping if key not in fields}, fields, prefix)
    for name, field in fields.items():
        given = mapping.get(name, _NOT_GIVEN)
        found: list[str] = []
        if "variants" in field.metadata:
            values[name], found = _read_typed_section(field, given, f"{prefix}{name}.")
        elif "section" in field.metadata:
            section_class: Any = field.default_factory
            if given is not _NOT_GIVEN or _wants_something(section_class):
                wanted: Any = {} if given is _NOT_GIVEN else given
                values[name], found = from_mapping(section_class, wanted, f"{prefix}{name}.")
        elif given is not _NOT_GIVEN:
            values[name], problem = check(f"{prefix}{name}", given, declaration_of(field), str(field.type))
            found = [problem] if problem else []
        elif _is_required(field):
            found = [f"{prefix}{name}: missing; {_wanted(declaration_of(field), str(field.type))}"]
        problems += found
    if problems:
        return None, problems
    built = cls(**values)
    found = [f"{prefix}{problem}" for problem in built.contradictions()] if hasattr(built, "contradictions") else []
    return (None, found) if found else (built, [])


def _read_others(
    cls: type, others: Mapping[str, Any], fields: Collection[str], prefix: str
) -> tuple[dict[str, Any], list[str]]:
    """What stands in a section beside its ``fields``: sections by name where it holds such, else nothing is right."""
    named = next((f for f in dataclasses.fields(cls) if "named" in f.metadata), None)
    if named is None:
        problems = [no_such_parameter(str(key), fields, prefix) for key in list(others)[:_MOST_UNKNOWN]]
        if len(others) > _MOST_UNKNOWN:
            problems.append(f"{prefix or 'the file'}: {len(others) - _MOST_UNKNOWN} more are unknown")
        return {}, problems
    registry, sections, problems = named.metadata["named"], {}, []
    unknown = []
    for key, given in others.items():
        if isinstance(key, str) and key in registry:
            sections[key], found = from_mapping(registry[key], given, f"{prefix}{key}.")
            problems += found
        else:
            unknown.append(key)
    known = f"known here: {', '.join(registry)} (a newer version may know more)"
    problems += [f"{prefix}{_brief(str(key))}: no such {registry.kind}; {known}" for key in unknown[:_MOST_UNKNOWN]]
    if len(unknown) > _MOST_UNKNOWN:
        problems.append(f"{prefix.rstrip('.')}: {len(unknown) - _MOST_UNKNOWN} more are unknown")
    return {named.name: sections}, problems


def refuse(problems: list[str], source: str) -> None:
    """Raise ConfigError with what is wrong with ``source``, where anything is."""
    if problems:
        raise ConfigError([f"{source}: {problem}" if source else problem for problem in problems])


def not_a_section(name: str, value: Any) -> str:
    """The sentence for what stands in the place of a section."""
    return f"{name}: {_shown(value)} is not a section of parameters"


def no_such_parameter(name: str, known: Collection[str], prefix: str = "") -> str:
    """The sentence for a parameter that does not exist, with the one that may be meant."""
    shown = _brief(name)
    near = difflib.get_close_matches(shown, known, n=1)
    help_ = f"did you mean {prefix}{near[0]}?" if near else f"known here: {', '.join(known)}"
    return f"{prefix}{shown}: no such parameter; {help_}"


def _read_typed_section(field: dataclasses.Field[Any], given: Any, prefix: str) -> tuple[Any, list[str]]:
    variants = field.metadata["variants"]()
    if given is _NOT_GIVEN and field.metadata["type"]:
        given = {}
    if not isinstance(given, Mapping) or not ("type" in given or field.metadata["type"]):
        return None, [f"{prefix}type: missing; one of {', '.join(variants)} is wanted"]
    name = given.get("type", field.metadata["type"])
    if not isinstance(name, str) or name not in variants:
        return None, [f"{prefix}type: {_shown(name)} is not one of {', '.join(variants)}"]
    return from_mapping(variants[name], {key: value for key, value in given.items() if key != "type"}, prefix)


def _wants_something(cls: type) -> bool:
    return any(_is_required(field) for field in dataclasses.fields(cls))


def _is_required(field: dataclasses.Field[Any]) -> bool:
    return field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING


def walk(instance: Any, prefix: str = "") -> Iterator[tuple[str, Any, Declaration, str]]:
    """Yield ``(dotted name, value, Declaration, kind)`` of every parameter of a section."""
    for field in dataclasses.fields(instance):
        value = getattr(instance, field.name)
        if "variants" in field.metadata:
            yield f"{prefix}{field.name}.type", type_of(field, value), type_declaration(field), "str"
        if "parameter" in field.metadata:
            yield f"{prefix}{field.name}", value, declaration_of(field), str(field.type)
        elif "named" in field.metadata:
            for name, section_ in value.items():
                yield from walk(section_, f"{prefix}{name}.")
        elif dataclasses.is_dataclass(value):
            yield from walk(value, f"{prefix}{field.name}.")


def live_changes(before: Any, after: Any) -> list[str]:
    """ "name old -> new" of every parameter that differs between two of the same section.

    Raises ConfigError where one of them cannot be changed while the actuator runs.
    """
    old = {name: repr(value) for name, value, *_ in walk(before)}
    differing = [(name, repr(value), declaration) for name, value, declaration, _ in walk(after)]
    differing = [each for each in differing if each[1] != old.get(each[0])]
    fixed = [name for name, _, declaration in differing if not declaration.live]
    if fixed:
        raise ConfigError([f"{name}: cannot be changed while the actuator runs; start it anew" for name in fixed])
    return [f"{name} {old.get(name)} -> {value}" for name, value, _ in differing]


def loosened(before: Any, after: Any) -> list[tuple[str, str, Declaration]]:
    """Name, "old → new" and declaration of every parameter of a section that guards less than ``before``."""
    old = {name: value for name, value, declaration, _ in walk(before) if declaration.stricter}
    return [
        (name, f"{_brief_value(old[name])} → {_brief_value(value)}", declaration)
        for name, value, declaration, _ in walk(after)
        if name in old and declaration.loosens(old[name], value)
    ]


def _brief_value(value: Any) -> str:
    return value if isinstance(value, str) else f"{value:g}"


def to_mapping(instance: Any) -> dict[str, Any]:
    """The nested mapping, fit for YAML, from which the section would be built again.

    Optional parameters that are not given are left out.
    """
    out: dict[str, Any] = {}
    for field in dataclasses.fields(instance):
        value = getattr(instance, field.name)
        if "parameter" in field.metadata:
            if declaration_of(field).optional and (value in ("", ()) or value != value):
                continue
            out[field.name] = list(value) if isinstance(value, tuple) else value
        elif "named" in field.metadata:
            out |= {name: to_mapping(section_) for name, section_ in value.items()}
        elif dataclasses.is_dataclass(value):
            nested = to_mapping(value)
            if "variants" in field.metadata:
                nested = {"type": type_of(field, value), **nested}
            if nested:
                out[field.name] = nested
    return out
