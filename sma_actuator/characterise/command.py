"""``sma-actuator characterise``."""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path

from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from sma_actuator.base.calibration import Calibration
from sma_actuator.base.options import number_within
from sma_actuator.base.parameter_file import read_parameter_file
from sma_actuator.base.parameters import ConfigError
from sma_actuator.base.share import shared_file
from sma_actuator.bench.real import PHYSICS, physics_name
from sma_actuator.check import look_first
from sma_actuator.config import bench_from_mapping
from sma_actuator.console import add_output_arguments, notes, questions, refuse_to_overwrite, results, write_json
from sma_actuator.console.asking import Asking, paused, read_answers
from sma_actuator.plant.worlds import HOME

from .operators import BenchOperator, Operator, ScpiBenchOperator, TerminalOperator
from .parts import RUN
from .plan import Part, PlanOptions, make_plan
from .rig import Rig
from .session import BENCH_FILE, characterise


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``sma-actuator characterise``."""
    parser.add_argument(
        "--config", type=Path, metavar="BENCH.yaml", help="parameters of the bench (a model in it is ignored)"
    )
    parser.add_argument(
        "--virtual",
        metavar="WIRE",
        help="the virtual bench in this process, unattended: flexinol, furukawa, coil or bundle",
    )
    parser.add_argument(
        "--physics",
        type=physics_name,
        metavar="NAME",
        help=f"with --virtual: what the wire is made of and how it transforms: {PHYSICS} (default {HOME})",
    )
    parser.add_argument(
        "--unattended-bench",
        metavar="VISA",
        help="the instruments are a virtual bench; its BENCh: commands are at this resource",
    )
    parser.add_argument(
        "--out",
        type=Path,
        required=True,
        metavar="DIR",
        help="folder of logs; one that holds finished parts is resumed",
    )
    parser.add_argument(
        "--loads",
        type=_numbers,
        default=(),
        metavar="N,N,...",
        help="weights in newtons, probe included (default: 15 to 120 MPa)",
    )
    parser.add_argument(
        "--spring",
        type=_numbers,
        action="append",
        default=[],
        metavar="N/m,N",
        help="also a spring: stiffness and preload; may be repeated",
    )
    parser.add_argument("--masses", type=_numbers, default=(), metavar="g,g,...", help="calibration masses in grams")
    parser.add_argument(
        "--heat-current",
        type=number_within(0.0),
        default=0.0,
        metavar="A",
        help="amplitude of the pulses (default: from the thermal section)",
    )
    parser.add_argument(
        "--heat-time",
        type=number_within(0.0, 3600.0),
        default=0.0,
        metavar="S",
        help="length of a pulse (default: from the thermal section)",
    )
    parser.add_argument(
        "--cool-time",
        type=number_within(0.0, 3600.0),
        default=0.0,
        metavar="S",
        help="pause after a pulse (default: from the thermal section); up to four times as long while the wire still "
        "moves",
    )
    parser.add_argument(
        "--pulses", type=number_within(1, kind=int), default=3, help="pulses at each load (default %(default)s)"
    )
    parser.add_argument(
        "--set-points",
        type=number_within(1, kind=int),
        default=5,
        help="set points of the partial cycles (default %(default)s)",
    )
    parser.add_argument(
        "--levels",
        type=number_within(2, 20, int),
        default=0,
        metavar="N",
        help="also N currents held one after the other at each load, for `--model whole_range`; 6 is a good number",
    )
    parser.add_argument(
        "--follow",
        type=Path,
        metavar="NODE.yaml",
        help="a second round: the model in this file (from `init --start`) drives the wire to held positions, a sine "
        "and a triangle "
        "at each load; give the logs to identify together with the first round's",
    )
    parser.add_argument(
        "--training-cycles",
        type=number_within(0, kind=int),
        default=40,
        help="cycles of a new wire before anything is measured (default %(default)s)",
    )
    parser.add_argument(
        "--fatigue-cycles", type=number_within(0, kind=int), default=100, help="cycles at the end (default %(default)s)"
    )
    parser.add_argument(
        "--average",
        type=number_within(0.0, 3600.0),
        default=10.0,
        metavar="S",
        help="time averaged at each calibration point (default %(default)s)",
    )
    parser.add_argument(
        "--skip",
        action="append",
        default=[],
        choices=["check", *sorted(RUN)],
        help="leave out this kind of part, or the check of the wiring before anything is heated; may be repeated",
    )
    parser.add_argument("--seed", type=number_within(0, kind=int), default=0, help="seed of the virtual bench's noise")
    parser.add_argument(
        "--hidden",
        type=_effect,
        action="append",
        default=[],
        metavar="EFFECT=STRENGTH",
        help="with --virtual: an undeclared effect in the bench, in SI units, for trying `trace`; may be repeated (see "
        "docs/tracing.md)",
    )
    parser.add_argument(
        "--answers",
        type=Path,
        metavar="ANSWERS.yaml",
        help="answers to what a person would be asked, as 'hang_load: done' or 'place_probe: [1.0, 2.0]' (mm); the "
        "rest is asked",
    )
    add_output_arguments(parser, "the manifest")


def run(args: argparse.Namespace) -> int:
    """Measure what the folder lacks; 0 when every part is finished."""
    from .page import write_page

    refuse_to_overwrite(args)
    console = notes(args)
    bar = Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:3.0f} %"),
        TimeRemainingColumn(),
        console=console,
        transient=True,
        disable=args.quiet or not console.is_terminal,  # where nothing can be written over, lines say how far it is
    )
    path = (
        args.config
        or args.follow
        or shared_file(f"config/{args.virtual}_bench.yaml" if args.virtual else "config/flexinol_bench.yaml")
    )
    mapping = read_parameter_file(path)
    config = bench_from_mapping(mapping, str(path))
    options = PlanOptions(
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
    plan = make_plan(config, options)
    largest_force_N = config.wire.max_stress * config.wire.area_m2
    if args.hidden and not args.virtual:
        raise ConfigError("--hidden: only the virtual bench (--virtual) can hide an effect")
    if args.hidden and (args.out / "manifest.json").exists():
        raise ConfigError(
            f"--hidden: {args.out} holds logs already, which may hide something else; a new folder is wanted"
        )
    if args.physics and not args.virtual:
        raise ConfigError("--physics: only the virtual bench (--virtual) has a choice of physics")
    if args.virtual:
        from sma_actuator.bench import HiddenBench, InProcessDaq, InProcessSupply, VirtualClock

        try:
            bench = HiddenBench.from_name(
                args.virtual,
                args.seed,
                like=config.wire,
                physics=args.physics or HOME,
                hidden=dict(args.hidden),
                session_s=sum(p.duration_s for p in plan),
            )
        except ValueError as error:
            raise ConfigError(f"{'--hidden' if 'hidden' in str(error) else '--virtual'}: {error}") from error
        rig = Rig(config, InProcessSupply(bench, config), InProcessDaq(bench, config), VirtualClock(bench))
        operator: Operator = BenchOperator(bench, largest_force_N)
    else:
        from sma_actuator.instruments import open_instruments
        from sma_actuator.instruments.clock import MonotonicClock

        if args.config is None:
            raise ConfigError("--config: a bench file is wanted, `sma-actuator init` asks for it and writes it")
        clock = MonotonicClock()
        rig = Rig(config, *open_instruments(config, clock), clock)
        if args.unattended_bench:
            operator = ScpiBenchOperator(args.unattended_bench, largest_force_N)
        else:
            operator = TerminalOperator(Asking(questions(), read_answers(args.answers), lambda: paused(bar)), rig)
    with bar:
        task = bar.add_task("characterise", total=sum(part.duration_s for part in plan))
        before_s = {part.name: sum(p.duration_s for p in plan[:i]) for i, part in enumerate(plan)}

        begun: set[str] = set()

        def progress(part: Part, elapsed_s: float) -> None:
            if bar.disable and part.name not in begun:
                begun.add(part.name)
                console.print(f"part {len(begun)} of {len(plan)}: {part.name}, about {part.duration_s:.0f} s")
            bar.update(task, completed=before_s[part.name] + min(elapsed_s, part.duration_s), description=part.name)

        def first() -> None:
            # A calibration in the file is that of an older model; the wire of the bench in this process has no wiring.
            if not args.virtual and "check" not in args.skip:
                with paused(bar):
                    unknown = dataclasses.replace(rig.config, calibration=Calibration())
                    look_first(unknown, rig.supply, rig.daq, rig.clock, console)

        manifest = characterise(mapping, plan, rig, operator, args.out, progress, first)
    write_page(args.out, manifest)
    write_json(args, manifest.data)
    results(args).print(
        f"{len(plan)} parts are in {args.out}: logs, {manifest.path.name}, bench.yaml and calibration.html"
    )
    logs = " ".join(
        f"{args.out}/{kind}_*.csv"
        for kind in ("pulses", "partial", "levels", "followed")
        if kind in {p.kind for p in plan}
    )
    if logs:
        first_round = "FIRST_ROUND/*.csv " if args.follow else ""
        console.print(
            f"next: sma-actuator identify {first_round}{logs} --config {args.out / BENCH_FILE} --out my_wire.yaml"
        )
    return 0


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
