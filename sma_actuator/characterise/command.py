"""``sma-actuator characterise``."""

from __future__ import annotations

import argparse
import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from sma_actuator.base.calibration import Calibration
from sma_actuator.base.options import number_within
from sma_actuator.base.parameter_file import read_parameter_file
from sma_actuator.base.parameters import ConfigError
from sma_actuator.base.share import shared_file
from sma_actuator.bench.real import PHYSICS, physics_name
from sma_actuator.check.command import look_first
from sma_actuator.config import BenchConfig, bench_from_mapping
from sma_actuator.console import add_output_arguments, notes, questions, refuse_to_overwrite, results, typed, write_json
from sma_actuator.console.asking import Asking, paused, read_answers
from sma_actuator.instruments import InstrumentError
from sma_actuator.logs.kinds import FOLLOWED, FULL, LEVELS, PARTIAL
from sma_actuator.plant.materials import WIRES
from sma_actuator.plant.worlds import HOME

from .operators import BenchOperator, Operator, ScpiBenchOperator, TerminalOperator
from .parts import RUN
from .plan import Part, PlanOptions, make_plan
from .rig import Rig
from .session import BENCH_FILE, characterise


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``sma-actuator characterise``."""
    parser.add_argument(
        "--out",
        type=Path,
        required=True,
        metavar="DIR",
        help="folder of logs; one that holds finished parts is resumed",
    )
    _of_the_bench(parser.add_argument_group("the wire and its bench"))
    _of_the_plan(parser.add_argument_group("what is measured"))
    _of_a_pulse(parser.add_argument_group("the pulses"))
    add_output_arguments(parser, "the manifest")


def _of_the_bench(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--config", type=Path, metavar="BENCH.yaml", help="parameters of the bench (a model in it is ignored)"
    )
    group.add_argument(
        "--virtual",
        choices=sorted(WIRES),
        help="a wire of the virtual bench in this process, unattended",
    )
    group.add_argument(
        "--physics",
        type=physics_name,
        metavar="NAME",
        help=f"with --virtual: what the wire is made of and how it transforms: {PHYSICS} (default {HOME})",
    )
    group.add_argument(
        "--unattended-bench",
        metavar="VISA",
        help="the instruments are a virtual bench; its BENCh: commands are at this resource",
    )
    group.add_argument("--seed", type=number_within(0, kind=int), default=0, help="seed of the virtual bench's noise")
    group.add_argument(
        "--hidden",
        type=_effect,
        action="append",
        default=[],
        metavar="EFFECT=STRENGTH",
        help="with --virtual: an undeclared effect in the bench, in SI units, for trying `trace`; may be repeated (see "
        "docs/tracing.md)",
    )
    group.add_argument(
        "--answers",
        type=Path,
        metavar="ANSWERS.yaml",
        help="answers to what a person would be asked, as 'hang_load: done' or 'place_probe: [1.0, 2.0]' (mm); the "
        "rest is asked",
    )


def _of_the_plan(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--loads",
        type=_numbers,
        default=(),
        metavar="N,N,...",
        help="weights in newtons, probe included (default: 15 to 120 MPa)",
    )
    group.add_argument(
        "--spring",
        type=_spring,
        action="append",
        default=[],
        metavar="N/m,N",
        help="also a spring: stiffness and preload; may be repeated",
    )
    group.add_argument("--masses", type=_numbers, default=(), metavar="g,g,...", help="calibration masses in grams")
    group.add_argument(
        "--set-points",
        type=number_within(1, kind=int),
        default=5,
        help="set points of the partial cycles (default %(default)s)",
    )
    group.add_argument(
        "--levels",
        type=number_within(2, 20, int),
        default=6,
        metavar="N",
        help="N currents held one after the other at each load, which `whole_range` learns positions that are held "
        "from (default %(default)s; --skip levels: none)",
    )
    group.add_argument(
        "--follow",
        type=Path,
        metavar="NODE.yaml",
        help="a second round: the model in this file (from `init --start`) drives the wire to held positions, a sine "
        "and a triangle at each load; give the logs to identify together with the first round's",
    )
    _of_the_cycles(group)


def _of_the_cycles(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--training-cycles",
        type=number_within(0, kind=int),
        default=PlanOptions().training_cycles,
        help="cycles of a new wire before anything is measured: until its ends stand, at most so many "
        "(default %(default)s)",
    )
    group.add_argument(
        "--fatigue-cycles", type=number_within(0, kind=int), default=100, help="cycles at the end (default %(default)s)"
    )
    group.add_argument(
        "--average",
        type=number_within(0.0, 3600.0),
        default=10.0,
        metavar="S",
        help="time averaged at each calibration point (default %(default)s)",
    )
    group.add_argument(
        "--skip",
        action="append",
        default=[],
        choices=["check", *sorted(RUN)],
        help="leave out this kind of part, or the check of the wiring before anything is heated; may be repeated",
    )


def _of_a_pulse(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--heat-current",
        type=number_within(0.0),
        default=0.0,
        metavar="A",
        help="amplitude of the pulses (default: from the thermal section)",
    )
    group.add_argument(
        "--heat-time",
        type=number_within(0.0, 3600.0),
        default=0.0,
        metavar="S",
        help="length of a pulse (default: from the thermal section)",
    )
    group.add_argument(
        "--cool-time",
        type=number_within(0.0, 3600.0),
        default=0.0,
        metavar="S",
        help="pause after a pulse (default: from the thermal section); up to four times as long while the wire still "
        "moves",
    )
    group.add_argument(
        "--pulses", type=number_within(1, kind=int), default=3, help="pulses at each load (default %(default)s)"
    )


def run(args: argparse.Namespace) -> int:
    """Measure what the folder lacks; 0 when every part is finished."""
    from .page import write_page

    refuse_to_overwrite(args)
    _refuse_what_is_no_bench(args)
    path = args.config or args.follow or shared_file(f"config/{args.virtual or 'flexinol'}_bench.yaml")
    mapping = read_parameter_file(path)
    config = bench_from_mapping(mapping, str(path))
    plan = make_plan(config, _plan_options(args))
    shown = _Shown(args, plan)
    rig, operator = _virtual(args, config, plan) if args.virtual else _instruments(args, config, shown)

    def first() -> None:
        # A calibration in the file is that of an older model; the wire of the bench in this process has no wiring.
        if not args.virtual and "check" not in args.skip:
            with paused(shown.bar):
                unknown = dataclasses.replace(rig.config, calibration=Calibration())
                look_first(unknown, rig.supply, rig.daq, rig.clock, shown.console)

    with shown.bar:
        virtual = {"virtual": args.virtual, "physics": args.physics or HOME} if args.virtual else {}
        say = shown.console.print
        try:
            manifest = characterise(mapping, plan, rig, operator, args.out, shown.progress, first, say, virtual)
        except (InstrumentError, KeyboardInterrupt):
            if (args.out / "manifest.json").exists():
                say(f"what is measured stays in {args.out}; the same command goes on there")
            raise
    write_page(args.out, manifest)
    write_json(args, manifest.data)
    results(args).print(
        f"{len(plan)} parts are in {args.out}: logs, {manifest.path.name}, bench.yaml and calibration.html"
    )
    _say_what_is_next(args, plan, shown.console)
    return 0


def _refuse_what_is_no_bench(args: argparse.Namespace) -> None:
    """Raise ConfigError where options ask for another kind of bench than the one that is named."""
    if args.hidden and not args.virtual:
        raise ConfigError("--hidden: only the virtual bench (--virtual) can hide an effect")
    if args.hidden and (args.out / "manifest.json").exists():
        raise ConfigError(
            f"--hidden: {args.out} holds logs already, which may hide something else; a new folder is wanted"
        )
    if args.physics and not args.virtual:
        raise ConfigError("--physics: only the virtual bench (--virtual) has a choice of physics")


def _plan_options(args: argparse.Namespace) -> PlanOptions:
    return PlanOptions(
        loads_N=args.loads,
        springs_N_m=tuple(args.spring),
        masses_kg=tuple(m * 1e-3 for m in args.masses),
        heat_current_A=args.heat_current,
        heat_s=args.heat_time,
        cool_s=args.cool_time,
        pulses=args.pulses,
        set_points=args.set_points,
        levels=args.levels,
        training_cycles=args.training_cycles,
        fatigue_cycles=args.fatigue_cycles,
        average_s=args.average,
        skip=tuple(args.skip),
        follow=str(args.follow or ""),
    )


class _Shown:
    """How far it is: a bar, or a line for each part where nothing can be written over."""

    def __init__(self, args: argparse.Namespace, plan: Sequence[Part]) -> None:
        self.console = notes(args)
        self.bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TextColumn("{task.percentage:3.0f} %"),
            TimeRemainingColumn(),
            console=self.console,
            transient=True,
            disable=args.quiet or not self.console.is_terminal,
        )
        self._task = self.bar.add_task("characterise", total=sum(part.duration_s for part in plan))
        self._before_s = {part.name: sum(p.duration_s for p in plan[:i]) for i, part in enumerate(plan)}
        self._begun: set[str] = set()

    def progress(self, part: Part, elapsed_s: float) -> None:
        """``part`` is under way for so long."""
        if self.bar.disable and part.name not in self._begun:
            self._begun.add(part.name)
            of_all = f"part {len(self._begun)} of {len(self._before_s)}"
            ahead = f"about {part.duration_s:.0f} s" if elapsed_s < part.duration_s else "measured already"
            self.console.print(f"{of_all}: {part.name}, {ahead}")
        done_s = self._before_s[part.name] + min(elapsed_s, part.duration_s)
        self.bar.update(self._task, completed=done_s, description=part.name)


def _virtual(args: argparse.Namespace, config: BenchConfig, plan: Sequence[Part]) -> tuple[Rig, Operator]:
    """The virtual bench in this process."""
    from sma_actuator.bench import HiddenBench, InProcessDaq, InProcessSupply, VirtualClock, setup_of

    setup = setup_of(args.virtual, config, "--virtual")
    try:
        bench = HiddenBench.from_name(
            args.virtual,
            args.seed,
            physics=args.physics or HOME,
            hidden=dict(args.hidden),
            session_s=sum(p.duration_s for p in plan),
            **setup,
        )
    except ValueError as error:
        raise ConfigError(f"{'--hidden' if 'hidden' in str(error) else '--virtual'}: {error}") from error
    rig = Rig(config, InProcessSupply(bench, config), InProcessDaq(bench, config), VirtualClock(bench))
    return rig, BenchOperator(bench, _largest_force_N(config), config.wire.full_stroke_m)


def _instruments(args: argparse.Namespace, config: BenchConfig, shown: _Shown) -> tuple[Rig, Operator]:
    """The instruments of the file, and who hangs the loads: a person, or a bench that is told to."""
    from sma_actuator.instruments import open_instruments
    from sma_actuator.instruments.clock import MonotonicClock

    if args.config is None:
        raise ConfigError("--config: a bench file is wanted, `sma-actuator init` asks for it and writes it")
    clock = MonotonicClock()
    rig = Rig(config, *open_instruments(config, clock), clock)
    if args.unattended_bench:
        return rig, ScpiBenchOperator(args.unattended_bench, _largest_force_N(config), config.wire.full_stroke_m)
    return rig, TerminalOperator(Asking(questions(), read_answers(args.answers), lambda: paused(shown.bar)), rig)


def _largest_force_N(config: BenchConfig) -> float:
    return config.wire.max_stress * config.wire.area_m2


def _say_what_is_next(args: argparse.Namespace, plan: Sequence[Part], console: Console) -> None:
    """Which command takes these logs, where it can."""
    done = {part.kind for part in plan}
    logs = " ".join(f"{typed(args.out)}/{kind}_*.csv" for kind in (FULL, PARTIAL, LEVELS, FOLLOWED) if kind in done)
    if logs:
        bench, model = f"--config {typed(args.out / BENCH_FILE)}", "--out my_wire.yaml"
        if args.follow:  # the model that drove the wire, from both rounds
            logs = f"FIRST_ROUND/p*.csv FIRST_ROUND/levels_*.csv {logs}"
            model = f"--model {read_parameter_file(args.follow)['model']['type']} --out better_wire.yaml"
        console.print(f"next: sma-actuator identify {logs} {bench} {model}")


def _effect(text: str) -> tuple[str, float]:
    name, _, strength = text.partition("=")
    try:
        return name, float(strength)
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"'{text}' is no effect; EFFECT=STRENGTH is wanted, as voltage_offset=0.004"
        ) from None


def _numbers(text: str) -> tuple[float, ...]:
    try:
        return tuple(float(word) for word in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is not a list of numbers separated by commas") from None


def _spring(text: str) -> tuple[float, float]:
    numbers = _numbers(text)
    if len(numbers) != 2 or not all(0.0 < number < math.inf for number in numbers):
        raise argparse.ArgumentTypeError(
            f"'{text}' is no spring; stiffness and preload, both above zero, are wanted, as 100,0.5"
        )
    return numbers[0], numbers[1]
