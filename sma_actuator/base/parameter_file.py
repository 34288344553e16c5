"""Parameter files as ROS 2 reads them: a section for each node, and which of them is meant."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from .commands import NODE_NAME
from .parameters import ConfigError
from .sidecar import SECTION, file_of, put_back
from .yaml_text import read_yaml


def read_sections(path: str | Path) -> Mapping[str, Any]:
    """The sections of a YAML parameter file.  Raises ConfigError; its sentence names the file."""
    document = read_yaml(path, "a YAML parameter file")
    if not isinstance(document, Mapping):
        raise ConfigError(f"{path}: holds no parameters; a section '{NODE_NAME}: ros__parameters:' is wanted")
    return document


def read_parameter_file(path: str | Path, node: str = NODE_NAME) -> dict[str, Any]:
    """The parameters of ``node`` (or of ``/**``) in a YAML file, with the tables that lie beside it.

    Raises ConfigError; its sentence names the file.  What stands beside the sections of nodes is refused, as ROS does:
    nobody would read it.
    """
    document = read_sections(path)
    mapping = _of_node(document, path, node)
    strays = [str(name) for name, held in document.items() if not _is_of_nodes(held)]
    if strays:
        raise ConfigError(
            f"{path}: {', '.join(strays)[:180]}: stands beside '{node}: ros__parameters:', where nothing reads it; "
            "move it under that line, and further in than that"
        )
    return put_back(mapping, Path(path))


def _is_of_nodes(held: Any) -> bool:
    """Whether parameters of nodes stand in a section, maybe of nodes in a namespace."""
    return isinstance(held, Mapping) and ("ros__parameters" in held or any(map(_is_of_nodes, held.values())))


def parameters_in(path: str | Path, node: str = NODE_NAME) -> dict[str, Any]:
    """What stands in the YAML file itself.  Raises ConfigError."""
    return _of_node(read_sections(path), path, node)


def _of_node(document: Mapping[str, Any], path: str | Path, node: str) -> dict[str, Any]:
    for name in (node, f"/{node}", "/**"):
        if isinstance(document.get(name), Mapping) and "ros__parameters" in document[name]:
            held = document[name]["ros__parameters"]
            if held is not None and not isinstance(held, Mapping):
                raise ConfigError(f"{path}: '{name}: ros__parameters:' holds no parameters; 'name: value' is wanted")
            return dict(held or {})
    found = ", ".join(map(str, document))
    found = found if len(found) <= 200 else f"{found[:180]}… ({len(document)} in all)"
    raise ConfigError(f"{path}: has no section '{node}: ros__parameters:'; found {found}")


def files_beside(path: str | Path) -> list[str]:
    """Names of the files of tables beside a parameter file.  Raises ConfigError."""
    held = [node.get("ros__parameters") for node in read_sections(path).values() if isinstance(node, Mapping)]
    found = [file_of(each[SECTION], str(path)) for each in held if isinstance(each, Mapping) and SECTION in each]
    return list(dict.fromkeys(found))
