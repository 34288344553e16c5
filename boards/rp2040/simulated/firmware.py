"""The board's own files, run by this Python: in this process, or as a program at the end of a socket."""

from __future__ import annotations

import importlib.util
import socket
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

HERE = Path(__file__).parent
#: In the order of who imports whom; the first three are simulated, the others are those of the board.
FILES = [*(HERE / f"{name}.py" for name in ("machine", "time", "usb"))] + [
    HERE.parent / f"{name}.py" for name in ("parts", "board", "scpi", "main")
]


def load(call: Callable[[str], str]) -> ModuleType:
    """The module ``main`` of a board of its own, whose parts answer to ``call``."""
    link = ModuleType("link")
    link.call_world = call  # type: ignore[attr-defined]
    names = ["link", *(path.stem for path in FILES)]
    before = {name: sys.modules[name] for name in names if name in sys.modules}
    sys.modules["link"] = link
    try:
        for path in FILES:
            spec = importlib.util.spec_from_file_location(path.stem, path)
            assert spec is not None
            assert spec.loader is not None
            sys.modules[path.stem] = module = importlib.util.module_from_spec(spec)
            spec.loader.exec_module(module)
        return module
    finally:
        for name in names:
            sys.modules.pop(name, None)
        sys.modules.update(before)


def main() -> None:
    """Run it; the world is at the other end of the socket that the argument numbers."""
    line = socket.socket(fileno=int(sys.argv[1])).makefile("rw", newline="\n")

    def call(text: str) -> str:
        line.write(text + "\n")
        line.flush()
        answer = line.readline()
        if not answer.endswith("\n"):
            raise SystemExit  # the processor was started anew, or the world has ended
        return answer[:-1]

    load(call).main()


if __name__ == "__main__":
    main()
