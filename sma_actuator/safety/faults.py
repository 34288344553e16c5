"""All faults, collected from the guards; ``docs/faults.md`` is printed from here (``python -m
sma_actuator.safety.faults``)."""

from __future__ import annotations

from collections.abc import Iterable

from .guards import estimate, program, readings, setpoints, supply, wire
from .limits import LIMITS
from .records import Fault

#: In the order in which one is named when several appear in the same step.
FAULTS: dict[str, Fault] = {
    fault.name: fault
    for module in (program, supply, readings, wire, estimate, setpoints)
    for fault in vars(module).values()
    if isinstance(fault, Fault)
}
_RANK = {fault: number for number, fault in enumerate(FAULTS.values())}


def gravest(faults: Iterable[Fault]) -> Fault:
    """The one of several faults that is named."""
    return min(faults, key=_RANK.__getitem__)


def markdown() -> str:
    """The text of ``docs/faults.md``."""
    out = [
        "# Limits and faults",
        "",
        "Printed from `sma_actuator/safety/` by `python -m sma_actuator.safety.faults > docs/faults.md`.",
        "",
        "A latched fault switches the output off in the step that detects it, and it stays off until `~/clear_fault`",
        "and then a new `~/enable`. Of a lost instrument *until it answers*: once both have answered for",
        "`safety.reading_timeout`, with the output read back as off, a new `~/enable` is enough. All else passes with",
        "its cause.",
        "",
        "*Within*: from the cause to the command, in seconds; `0` is the same step. What a busy computer holds this",
        "program up comes on top, until the supply's watchdog cuts, `supply.watchdog_timeout` after the last word.",
        "",
        "**Note** leaves out what is wrong and goes on; **hold** keeps the wire where it is, or at the last good",
        "setpoint; **bias** lowers the current to `supply.bias_current`; **off** is current zero and output off.",
        "",
        "## Limits",
        "",
        "A limit brings a value into its range, and passes by itself.",
        "",
        "| limit | in words | detected by | within | what to do |",
        "|---|---|---|---|---|",
    ]
    out += [f"| `{e.name}` | {e.words} | {e.detector} | `{e.within}` | {e.remedy} |" for e in LIMITS.values()]
    out += [
        "",
        "## Faults",
        "",
        "In the order in which one is named when several appear in the same step.",
        "",
        "| fault | in words | detected by | within | action | what to do |",
        "|---|---|---|---|---|---|",
    ]
    for e in FAULTS.values():
        action = f"`{e.action_by}`, latched where off" if e.action_by else e.action.value
        latches = " until it answers" if e.until_back else ", latched" if e.latches and not e.action_by else ""
        out.append(f"| `{e.name}` | {e.words} | {e.detector} | `{e.within}` | {action}{latches} | {e.remedy} |")
    return "\n".join(out) + "\n"


if __name__ == "__main__":
    print(markdown(), end="")  # noqa: T201
