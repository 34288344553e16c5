"""Whether logs of a wire are fit to test what nobody has tested on a real one: resistance and load against strain.

Each requirement is a function that looks at all logs together and says what it found; the page
``docs/send-us-a-log.md`` tells a lab how to meet them.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from .bench_log import BenchLog, averaged, longest_pause_s, uncalibrated_resistance_and_current
from .cycles import SAME_LOAD, cycle_numbers, cycles_of, is_driven, which_are_full
from .sense import counts_pull_as_negative, log_counts_contraction

#: What the requirements ask for.
SLOWEST_PERIOD_s = 0.051  #: 20 Hz, and a little for a clock that is not exact
LEAST_MEASURED = 0.98  #: share of the rows that have a resistance: a small current flows also while the wire cools
FEWEST_LOADS = 3
SPRING_SPREAD = 0.3  #: relative spread of the load within one log from which it pulls at a spring
FULL_SHARE = 0.9  #: of the widest stroke, below which a cycle is partial
FEWEST_FULL = 2  #: full cycles for each load: one shows no repeatability
FEWEST_PARTIAL = 4
FEWEST_READINGS = 32  #: of which a spectrum, or two clocks, can be told
LARGEST_STEP = 0.002  #: of the stroke: how finely the displacement must be resolved
LARGEST_NOISE = 0.01  #: of the range of resistance, from one reading to the next
REST_s = 1.0
PLAUSIBLE_STRAIN = (0.005, 0.09)
LATEST_s = 5.0  #: so far a channel's clock is looked for, and no further than a quarter of the mean cycle
LATE_s = 0.3  #: resistance and displacement of the virtual bench's wires are within 0.1 s of each other
MOVES_TOGETHER = 0.3  #: correlation of two channels' rates from which their clocks can be compared
SLOWEST_TONE_Hz = 1.0  #: what is slower may be the drive
SMALLEST_TONE = 0.001  #: amplitude over the channel's range …
LONE = 3.0  #: … and over every other line within a fifth of its frequency: the corners of a drive make combs of lines
OVER_NOISE = 10.0  #: … and over the median of these
MOST_LINES = 100  #: that are looked at, the loudest first
MOST_REPEATED = 0.01  #: share of the rows that may repeat the row before to the last digit
MOST_FLAT = 0.2  #: share of the rows that may stand at the very largest or smallest displacement, to the last digit


@dataclass(frozen=True, slots=True)
class Finding:
    """One requirement, what the logs have of it, and what would meet it."""

    requirement: str
    found: str
    met: bool
    remedy: str
    needed: bool = True  #: without it the logs cannot be used; else they could only say more


@dataclass(frozen=True, slots=True)
class Seen:
    """A cycle and what was on the wire meanwhile."""

    load_N: float
    spread: float  #: of the load, relative
    stroke_m: float
    rests_cold: bool
    rests_hot: bool
    full: bool


def judge(logs: Sequence[BenchLog], length_m: float = math.nan) -> list[Finding]:
    """Every requirement, held against the logs of one wire; resistance and load are there, for a reader refuses logs
    without.

    ``length_m`` of the wire, where known, makes a strain of the stroke.
    """
    findings = [_witnessed(logs)]
    if not findings[0].met:
        return findings
    cycles = cycles_in(logs)
    if not cycles:  # nothing else could be asked of such logs
        remedy = "switch the current on and off, so that the wire moves, and record that"
        return [*findings, Finding("the wire is heated and cools", "no cycle in any log", False, remedy)]
    if not _stroke_m(logs) > 0.0:
        remedy = "see whether the sensor is connected, and whether that is its column"
        return [*findings, Finding("the displacement moves", "one value in every row", False, remedy)]
    requirements: tuple[Callable[[Sequence[BenchLog], Sequence[Seen]], Finding], ...] = (
        _rate,
        _measured,
        _loads,
        _full_cycles,
        _partial_cycles,
        _rests,
        _resolution,
        _not_clipped,
        _noise,
        _one_clock,
        _no_tone,
        _new_readings,
        _pulls,
        _direction,
    )
    findings += [requirement(logs, cycles) for requirement in requirements]
    return [*findings, *([] if math.isnan(length_m) else [_strain(logs, length_m)]), _ambient(logs)]


def displacement_m(log: BenchLog) -> np.ndarray:
    """Displacement of a log; of a raw sensor up to a factor."""
    return log["displacement_m"] if "displacement_m" in log else log["lvdt_current_A"]


def load_N(log: BenchLog) -> np.ndarray:
    """Load of a log; of a raw load cell up to a factor."""
    return log["load_N"] if "load_N" in log else log["load_cell_voltage_V"]


def cycles_in(logs: Sequence[BenchLog]) -> list[Seen]:
    """The cycles of all logs, told by their current, and which of them are full, as `identify` judges them."""
    stretches, found = [], []
    for log in logs:
        for piece in _sessions(averaged(log)):
            moved, pull = displacement_m(piece), load_N(piece)
            driven = is_driven(uncalibrated_resistance_and_current(piece)[1])
            cycles = cycles_of(moved, driven, cycle_numbers(driven))
            means = [float(np.mean(pull[c.start : c.stop])) for c in cycles]
            changes = [k for k, (a, b) in enumerate(itertools.pairwise(means), 1) if abs(b - a) > SAME_LOAD * abs(a)]
            for first, last in itertools.pairwise((0, *changes, len(cycles))):
                if first < last:
                    stretches.append((cycles[first:last], float(np.mean(means[first:last]))))
                    found += [(c, pull[c.start : c.stop]) for c in cycles[first:last]]
    full = which_are_full([cycles for cycles, _ in stretches], [load for _, load in stretches])
    return [
        Seen(float(np.mean(pull)), _spread(pull), c.stroke, c.rests_cold, c.rests_hot, bool(is_full))
        for (c, pull), is_full in zip(found, itertools.chain(*full), strict=True)
    ]


def _sessions(log: BenchLog) -> list[BenchLog]:
    """A log cut where it pauses, without the readings in which something is missing."""
    good = np.isfinite(uncalibrated_resistance_and_current(log)[1] + displacement_m(log) + load_N(log))
    kept = dataclasses.replace(log, columns={name: values[good] for name, values in log.columns.items()})
    starts = np.flatnonzero(np.diff(kept["time_s"]) > longest_pause_s(log)) + 1
    edges = itertools.pairwise((0, *(int(start) for start in starts), len(kept)))
    return [kept.slice(first, last) for first, last in edges if last - first > 1]


def _spread(pull: np.ndarray) -> float:
    mean = float(np.mean(pull))
    return float(np.subtract(*np.percentile(pull, (97.5, 2.5))) / abs(mean)) if mean else math.inf


def _witnessed(logs: Sequence[BenchLog]) -> Finding:
    missing = [log.name for log in logs if not log.has_reference]
    return Finding(
        "displacement is measured beside the wire",
        f"missing in {', '.join(missing)}" if missing else "in all logs",
        not missing,
        "put a displacement sensor (LVDT, laser, encoder) beside the wire, and record it on the same clock",
    )


def _rate(logs: Sequence[BenchLog], cycles: Sequence[Seen]) -> Finding:
    slowest_s = max(log.period_s for log in logs)
    pauses = sum(int((np.diff(log["time_s"]) > longest_pause_s(log)).sum()) for log in logs)
    found = f"{1.0 / slowest_s:.3g} readings a second" + (f", {pauses} pauses" if pauses else "")
    return Finding("20 readings a second or more", found, slowest_s <= SLOWEST_PERIOD_s, "record at 20 to 100 Hz")


def _measured(logs: Sequence[BenchLog], cycles: Sequence[Seen]) -> Finding:
    shares = [float(np.isfinite(uncalibrated_resistance_and_current(log)[0]).mean()) for log in logs]
    return Finding(
        "resistance is measured all the time",
        f"in {min(shares):.0%} of the rows",
        min(shares) >= LEAST_MEASURED,
        "let a small current flow also while the wire cools (a tenth to a fifth of the heating current): cooling is "
        "half of the loop",
    )


def _loads(logs: Sequence[BenchLog], cycles: Sequence[Seen]) -> Finding:
    weights = distinct_loads([c.load_N for c in cycles if c.spread < SPRING_SPREAD])
    springs = any(c.spread >= SPRING_SPREAD for c in cycles)
    found = f"{len(weights)} weights" + (", and a spring" if springs else "")
    return Finding(
        f"{FEWEST_LOADS} loads",
        found,
        len(weights) >= FEWEST_LOADS or (springs and len(weights) >= 1),
        "hang three weights one after the other, the largest some four times the smallest; a spring besides is welcome",
    )


def distinct_loads(loads_N: Sequence[float]) -> list[float]:
    """Loads that differ."""
    out: list[float] = []
    for each_N in sorted(loads_N):
        if not out or abs(each_N - out[-1]) > SAME_LOAD * abs(out[-1]):
            out.append(each_N)
    return out


def _full_cycles(logs: Sequence[BenchLog], cycles: Sequence[Seen]) -> Finding:
    weights = [c.load_N for c in cycles if c.spread < SPRING_SPREAD] or [c.load_N for c in cycles]
    counts = [
        sum(c.full and abs(c.load_N - each_N) <= SAME_LOAD * abs(each_N) for c in cycles)
        for each_N in distinct_loads(weights)
    ]
    fewest = min(counts, default=0)
    return Finding(
        f"{FEWEST_FULL} full cycles at each load",
        f"{fewest} at the load with the fewest",
        fewest >= FEWEST_FULL,
        "heat until nothing moves any more, wait, cool until nothing moves any more, wait; three times at each load",
    )


def _partial_cycles(logs: Sequence[BenchLog], cycles: Sequence[Seen]) -> Finding:
    widest_m = max((c.stroke_m for c in cycles), default=0.0)
    partial = [c for c in cycles if not c.full and 0.05 * widest_m < c.stroke_m < FULL_SHARE * widest_m]
    return Finding(
        f"{FEWEST_PARTIAL} partial cycles",
        f"{len(partial)}",
        len(partial) >= FEWEST_PARTIAL,
        "turn back half-way a few times, at different positions: on a robot the wire hardly ever goes from end to end",
    )


def _rests(logs: Sequence[BenchLog], cycles: Sequence[Seen]) -> Finding:
    cold, hot = (any(getattr(c, name) for c in cycles) for name in ("rests_cold", "rests_hot"))
    words = {(True, True): "at both ends", (True, False): "only cold", (False, True): "only hot"}
    return Finding(
        "rests at both ends",
        words.get((cold, hot), "none"),
        cold and hot,
        f"hold still for {REST_s:g} s or more before the current goes on and before it goes off: the ends anchor "
        f"everything else",
    )


def _stroke_m(logs: Sequence[BenchLog]) -> float:
    return max(float(np.nanmax(displacement_m(log)) - np.nanmin(displacement_m(log))) for log in logs)


def _resolution(logs: Sequence[BenchLog], cycles: Sequence[Seen]) -> Finding:
    steps = []
    for log in logs:
        moved_m = displacement_m(log)
        changes = np.diff(np.sort(moved_m[np.isfinite(moved_m)]))
        changes = changes[changes > 0.0]
        # Of many readings the sorted values lie as close as the converter lets them.
        steps.append(float(np.median(changes)) if len(changes) < 0.2 * len(log) and len(changes) else 0.0)
    share = max(steps) / _stroke_m(logs)
    return Finding(
        f"displacement resolved to {LARGEST_STEP:.1%} of the stroke",
        f"steps of {share:.2%}" if share else "no steps seen",
        share <= LARGEST_STEP,
        "use a smaller range of the displacement sensor or of its converter",
    )


def _not_clipped(logs: Sequence[BenchLog], cycles: Sequence[Seen]) -> Finding:
    shares = []
    for log in logs:
        moved_m = displacement_m(log)
        ends = (moved_m == np.nanmax(moved_m)).mean(), (moved_m == np.nanmin(moved_m)).mean()
        shares.append(max(float(e) for e in ends))
    return Finding(
        "the displacement sensor does not reach its end",
        f"{max(shares):.0%} of the rows at the very end",
        max(shares) < MOST_FLAT,
        "move the sensor so that the whole stroke lies inside its range; a mechanical stop does the same harm",
    )


def _noise(logs: Sequence[BenchLog], cycles: Sequence[Seen]) -> Finding:
    shares = []
    for log in logs:
        resistance_Ohm, _ = uncalibrated_resistance_and_current(log)
        known_Ohm = resistance_Ohm[np.isfinite(resistance_Ohm)]
        if len(known_Ohm) < 3:
            shares.append(math.inf)
            continue
        span_Ohm = float(np.subtract(*np.percentile(known_Ohm, (99.0, 1.0))))
        second = known_Ohm[2:] - 2.0 * known_Ohm[1:-1] + known_Ohm[:-2]  # a straight line has none
        noise_Ohm = float(np.median(np.abs(second))) / (0.6745 * math.sqrt(6.0))
        shares.append(noise_Ohm / span_Ohm if span_Ohm > 0.0 else math.inf)
    return Finding(
        f"noise of the resistance below {LARGEST_NOISE:.0%} of its range",
        f"{max(shares):.2%}",
        max(shares) <= LARGEST_NOISE,
        "measure with four wires, average over a whole period of the mains, or let more current flow while cooling",
    )


def _one_clock(logs: Sequence[BenchLog], cycles: Sequence[Seen]) -> Finding:
    pairs = [pair for log in logs for pair in _clocks(log)]
    worst = max(pairs, key=lambda pair: abs(pair[2]), default=("", "", 0.0, ""))
    channel, other, late_s, name = worst
    late = "late" if late_s > 0.0 else "early"
    return Finding(
        "all channels on one clock",
        f"{channel} is {abs(late_s):.1f} s {late} against {other} in {name}" if pairs else "nothing moves together",
        abs(late_s) <= LATE_s,
        f"record all channels on one clock, or shift the times of {channel or 'one'} by {abs(late_s):.1f} s",
    )


def _clocks(log: BenchLog) -> list[tuple[str, str, float, str]]:
    """(channel, the one it is held against, how late it is [s], name of the log) of the channels that move together."""
    resistance_Ohm, _ = uncalibrated_resistance_and_current(log)
    pulls_N, moved_m = load_N(log), displacement_m(log)
    pairs = [("the displacement", moved_m, "the resistance", resistance_Ohm)]
    if np.subtract(*np.nanpercentile(pulls_N, (97.5, 2.5))) > SPRING_SPREAD * abs(float(np.nanmean(pulls_N))):
        pairs.append(("the load", pulls_N, "the displacement", moved_m))
    out = []
    for name, values, other_name, other in pairs:
        late_s = _late_s(log["time_s"], values, other, _cycle_s(log))
        if late_s is not None:
            out.append((name, other_name, late_s, log.name))
    return out


def _cycle_s(log: BenchLog) -> float:
    return float(np.ptp(log["time_s"])) / max(len(cycles_in([log])), 1)


def _late_s(time_s: np.ndarray, values: np.ndarray, others: np.ndarray, cycle_s: float) -> float | None:
    """By how much ``values`` come later than ``others``: where their rates go together best; None where they never
    do."""
    good = np.isfinite(values + others)
    if good.sum() < FEWEST_READINGS:
        return None
    period_s = float(np.median(np.diff(time_s)))
    even_s = np.arange(time_s[0], time_s[-1], period_s)
    width = max(1, round(REST_s / 3.0 / period_s))
    a, b = (
        np.diff(np.convolve(np.interp(even_s, time_s[good], x[good]), np.ones(width) / width, mode="valid"))
        for x in (values, others)
    )
    most = int(min(LATEST_s, 0.25 * cycle_s, 0.25 * float(np.ptp(time_s))) / period_s)
    scale = float(np.sqrt((a @ a) * (b @ b)))
    if most < 1 or not scale > 0.0:
        return None
    many = 1 << (len(a) + len(b) - 2).bit_length()
    whole = np.fft.irfft(np.fft.rfft(a, many) * np.fft.rfft(b[::-1], many), many) / scale  # at every lag
    middle = len(b) - 1
    together = np.abs(whole[middle - most : middle + most + 1])
    best = int(np.argmax(together))
    return (best - most) * period_s if together[best] >= MOVES_TOGETHER else None


def _no_tone(logs: Sequence[BenchLog], cycles: Sequence[Seen]) -> Finding:
    found = [
        (share, f"{frequency_Hz:.3g} Hz in {name}, {share:.2%} of its range, in {log.name}")
        for log in logs
        for name, values in _channels(log).items()
        for frequency_Hz, share in [_tone(log["time_s"], values)]
        if share > 0.0
    ]
    return Finding(
        "no tone in a channel",
        max(found)[1] if found else "none",
        not found,
        "look for what hums or shakes at that frequency (or faster: what is above half the rate of readings shows "
        "below it), and average over its whole periods",
        needed=False,
    )


def _channels(log: BenchLog) -> dict[str, np.ndarray]:
    resistance_Ohm, _ = uncalibrated_resistance_and_current(log)
    return {"the displacement": displacement_m(log), "the load": load_N(log), "the resistance": resistance_Ohm}


def _tone(time_s: np.ndarray, values: np.ndarray) -> tuple[float, float]:
    """(frequency [Hz], amplitude over the range) of the one line that stands out of a channel's spectrum; (0, 0) for
    none."""
    good = np.isfinite(values)
    if good.sum() < FEWEST_READINGS:
        return 0.0, 0.0
    period_s = float(np.median(np.diff(time_s)))
    even = np.interp(np.arange(time_s[0], time_s[-1], period_s), time_s[good], values[good])
    window = np.hanning(len(even))
    amplitude = 2.0 * np.abs(np.fft.rfft((even - even.mean()) * window)) / window.sum()
    frequency_Hz = np.fft.rfftfreq(len(even), period_s)
    span = float(np.subtract(*np.percentile(even, (99.0, 1.0))))
    loud = np.flatnonzero((frequency_Hz > SLOWEST_TONE_Hz) & (amplitude > SMALLEST_TONE * span))
    for peak in loud[np.argsort(-amplitude[loud])][:MOST_LINES]:
        near = np.abs(frequency_Hz - frequency_Hz[peak]) < 0.2 * frequency_Hz[peak]
        near[max(peak - 3, 0) : peak + 4] = False  # the line itself, as wide as the window makes it
        others = amplitude[near]
        if span > 0.0 and len(others) and amplitude[peak] > max(LONE * others.max(), OVER_NOISE * np.median(others)):
            # Between two bins a line is spread over both; Hann's window makes one and a half of its square.
            line = math.sqrt(float(np.sum(amplitude[peak - 2 : peak + 3] ** 2)) / 1.5)
            return float(frequency_Hz[peak]), line / span
    return 0.0, 0.0


def _new_readings(logs: Sequence[BenchLog], cycles: Sequence[Seen]) -> Finding:
    shares = [(_repeated(log), log.name) for log in logs]
    share, name = max(shares)
    return Finding(
        "every row is a new reading",
        f"{share:.0%} of the rows of {name} repeat the row before",
        share <= MOST_REPEATED,
        "log no faster than the instruments measure, or leave the repeated rows out",
        needed=False,
    )


def _repeated(log: BenchLog) -> float:
    """Share of the rows that are the row before in all channels."""
    channels = [values for name, values in log.columns.items() if name != "time_s" and _moves(values)]
    same = [(values[1:] == values[:-1]) | (np.isnan(values[1:]) & np.isnan(values[:-1])) for values in channels]
    return float(np.mean(np.all(same, axis=0))) if same and len(log) > 1 else 0.0


def _moves(values: np.ndarray) -> bool:
    known = values[np.isfinite(values)]
    return bool(len(known) and np.ptp(known) > 0.0)


def _pulls(logs: Sequence[BenchLog], cycles: Sequence[Seen]) -> Finding:
    loads_N = {log.name: log["load_N"] for log in logs if "load_N" in log}
    most_N = max((abs(float(np.nanmedian(each_N))) for each_N in loads_N.values()), default=0.0)
    pushed = [name for name, each_N in loads_N.items() if counts_pull_as_negative(each_N, most_N)]
    return Finding(
        "the load pulls",
        f"it is negative in {', '.join(pushed)}" if pushed else "it does",
        not pushed,
        "turn its sign round: --unit load_N=-N",
    )


def _direction(logs: Sequence[BenchLog], cycles: Sequence[Seen]) -> Finding:
    turned = [log.name for log in logs if log_counts_contraction(log)]
    return Finding(
        "displacement grows when the wire gets longer",
        f"it grows with the heat in {', '.join(turned)}" if turned else "it does",
        not turned,
        "turn its sign round: --unit displacement_m=-mm",
    )


def _strain(logs: Sequence[BenchLog], length_m: float) -> Finding:
    raw = any("displacement_m" not in log for log in logs)
    strain = _stroke_m(logs) / length_m
    low, high = PLAUSIBLE_STRAIN
    return Finding(
        f"a stroke of {low:.1%} to {high:.0%} of the length",
        "of a raw sensor: not known" if raw else f"{strain:.2%}",
        raw or low <= strain <= high,
        "check the unit of the displacement and --length",
    )


def _ambient(logs: Sequence[BenchLog]) -> Finding:
    there = all("ambient_temperature_C" in log for log in logs)
    return Finding(
        "ambient temperature is measured",
        "in all logs" if there else "not in all logs",
        there,
        "put a thermometer beside the wire, or write down the temperature of the room: --map "
        "ambient_temperature_C=22.5",
        needed=False,
    )
