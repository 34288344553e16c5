"""How hot the wire must be, and how hot it can be, from the power that was measured in it.

Lumped heat balance ``C dT/dt = P − h (T − T_amb)``.  Latent heat is left out, so the answer errs
on the hot side while the wire transforms.  The balance is kept twice: with the heat loss of the
parameters, and with the least that the wire may have (``thermal.heat_loss_margin``): a wire that
hangs in a tube loses its heat more slowly than one in the open.  What limits the current is the
second.

The wire is a thermometer beside it, which knows nothing of heat loss (:func:`hottest_C`); and one whose resistance
falls too slowly is no hot one that cools (:func:`~.cooling.cooling_C`).  What it says bounds both balances from
above: else a limit that provides for any heat loss would not let a wire contract, and one that loses more than the
parameters say would be held for a hot one.  A second thermometer reads the same resistance by what was identified of
this very wire: at which temperature it has transformed so far (:class:`Transforms`).

What a step makes of all this lies in rows of numbers, so that one kernel does it.

Nothing is known of a wire when an actuator begins: it may come from another that was ended while
the wire was hot.  So it starts as hot as a wire may be and cools by the balance, which takes a few
of the wire's time constants, or until its resistance is seen to stand.  And it may be another
wire than the calibrated one: whether it has contracted its resistance tells only beside what it
has shown cold (:func:`keep_cold`); where it stands at what the calibrated one shows cold, it is that.
"""

from __future__ import annotations

import math
from math import exp, expm1, inf, isfinite, nan

from sma_actuator.base.calibration import Calibration
from sma_actuator.base.jit import Floats, floats, jit
from sma_actuator.base.sections import ThermalParameters

from .ambient import Ambient
from .cold import (
    COLD_TIMES,
    IS_IT,
    SHOWN_COLD,
    COLD_Ohm,
    LEAST_Ohm,
    MOST_Ohm,
    RESTED_times,
    SEEN_times,
    ask_anew,
    begin_cold,
    keep_cold,
)
from .cooling import ANEW, COOLING, begin_cooling, cooling_C
from .transformed import (
    CAPACITY_WITHIN,
    FALLS,
    Transforms,
    cold_Ohm,
    contracted_Ohm,
    more_than_contracted,
    returns_at_most_C,
    shows_cold,
    shows_cold_no_more,
    transforms_at_C,
)

#: The hottest that a wire may be is aimed at with this distance, for noise and a resistance that rises.
HEADROOM_K = 5.0
#: So near to the hottest that is aimed at, the balance has come to its limit.
AT_LIMIT_K = 1.0
#: A wire rests with power that warms it by no more than this, at its least heat loss: what `init` writes as bias, 8 K.
REST_K = 10.0
#: Time over which a resistance is averaged, and from which on one is of another time.
SMOOTH_s, LONG_AGO_s = 0.2, 1.0
#: Share by which a load changes from one reading to the next where it is another one.
OTHER_LOAD = 0.03
#: So often a load may turn lately, as a weight that swings, before it counts as noise.
MOST_TURNS = 2.0
#: Time, in the wire's time constants without its latent heat, over which power and rise are averaged to tell the loss.
LOSING_TIMES = 8
#: The most that latent heat takes of it, as a rise of temperature; wires that were measured: 20 to 30 K.
LATENT_K = 40.0
#: What a wire may lose less in the time that nobody looks leaves this share of the loss that it has shown.  One that
#: transforms may be at 150 °C for all that is known; with less than 0.83 it would never be let warmer than it is,
#: however cold that is.  With 0.9 it warms by a twelfth every LOSING_TIMES, until its resistance says that it is hot.
SUDDENLY = 0.9
#: The margin of a wire that by its resistance has not contracted: half of a heat loss that is known so well.  What more
#: there is, is for a fan that stops while a contracted one is held hot.  It is no less, since another wire in its place
#: may show more.
NOT_CONTRACTED_MARGIN = 2.0 * CAPACITY_WITHIN


@jit
def _after_C(
    temperature_C: float, power_W: float, dt_s: float, ambient_C: float, heat_capacity_J_K: float, heat_loss_W_K: float
) -> float:
    """See :meth:`HeatBalance.step`."""
    if not (isfinite(power_W) and 0.0 <= dt_s < inf and isfinite(ambient_C)):
        return temperature_C
    settled_C = ambient_C + power_W / heat_loss_W_K
    return settled_C + (temperature_C - settled_C) * exp(-dt_s * heat_loss_W_K / heat_capacity_J_K)


class HeatBalance:
    """Temperature of a wire, stepped exactly for power that is constant over the step."""

    __slots__ = ("temperature_C",)

    def __init__(self, temperature_C: float):
        self.temperature_C = temperature_C

    def step(
        self, power_W: float, dt_s: float, ambient_C: float, heat_capacity_J_K: float, heat_loss_W_K: float
    ) -> float:
        """Advance by ``dt_s`` ≥ 0 and return the temperature [°C].

        Exact: ``T ← T_∞ + (T − T_∞) exp(−h dt / C)`` with ``T_∞ = T_amb + P/h``.  Arguments that
        are not finite leave the temperature as it is: a gap in the readings cannot cool the wire.
        """
        self.temperature_C = _after_C(self.temperature_C, power_W, dt_s, ambient_C, heat_capacity_J_K, heat_loss_W_K)
        return self.temperature_C


#: What a thermometer remembers: the resistance, smooth, and the load of then; how long ago that is; the least
#: resistance since the wire was certainly not hotter than it transforms at, and how hot it was then at the most.
_SHOWN_Ohm, _LOAD_N, _GAP_s, _LEAST_Ohm, _THEN_C = range(5)
THERMOMETER = 5


@jit
def hottest_C(
    state: Floats,
    first: int,
    resistance_Ohm: float,
    load_N: float,
    dt_s: float,
    at_most_C: float,
    transformed_C: float,
    contracted_Ohm: float,
    slope_1_K: float,
) -> float:
    """How hot the wire can be at most [°C] by its resistance, NaN where none was measured, whatever heat it loses.

    A wire that transforms shows less resistance the hotter it gets; one that has contracted, and is austenite
    all through, shows more.  So one that shows the least since it was certainly no hotter than any wire transforms at
    (``transformed_C``) is no hotter than that; and one that shows more than the least is either longer again or hotter
    by what that makes of its austenite's resistance.  Both are counted as the second.  Where ``transformed_C`` is not
    the same all the time, what it was when the wire showed the least counts, if that was more.

    ``at_most_C``: what was known before.  Resistance that comes with another load says nothing of heat.  A wire
    that has contracted shows no more than ``contracted_Ohm``, however hot it may be.  ``slope_1_K``: the least by which
    the resistance of its austenite rises, as a share.  What is remembered begins at the ``first`` of ``state``
    (:func:`begin_thermometer`).
    """
    gap_s = state[first + _GAP_s] + dt_s
    if not isfinite(resistance_Ohm):
        state[first + _GAP_s] = gap_s
        return inf
    shown_Ohm, least_Ohm, was_N = state[first + _SHOWN_Ohm], state[first + _LEAST_Ohm], state[first + _LOAD_N]
    if not (isfinite(shown_Ohm) and gap_s < LONG_AGO_s):
        shown_Ohm, least_Ohm = resistance_Ohm, nan
    elif _is_other(load_N, was_N):
        least_Ohm += resistance_Ohm - shown_Ohm
        shown_Ohm = resistance_Ohm
    shown_Ohm -= expm1(-gap_s / SMOOTH_s) * (resistance_Ohm - shown_Ohm)
    then_C = state[first + _THEN_C]
    if at_most_C < transformed_C or shown_Ohm > contracted_Ohm or shown_Ohm <= least_Ohm:
        least_Ohm, then_C = shown_Ohm, transformed_C
    state[first + _SHOWN_Ohm], state[first + _LOAD_N] = shown_Ohm, load_N
    state[first + _GAP_s], state[first + _LEAST_Ohm], state[first + _THEN_C] = 0.0, least_Ohm, then_C
    if not least_Ohm > 0.0:  # not known; or of no wire, as where the leads alone are measured
        return inf
    return max(then_C, transformed_C) + (shown_Ohm - least_Ohm) / (slope_1_K * least_Ohm)


@jit
def _is_other(load_N: float, was_N: float) -> bool:
    """Whether a load is another one than that of the reading before."""
    return abs(load_N - was_N) > OTHER_LOAD * abs(was_N)


def begin_thermometer(state: Floats, first: int) -> None:
    """Nothing is known yet."""
    for each in (_SHOWN_Ohm, _LOAD_N, _LEAST_Ohm):
        state[first + each] = nan


#: What of shown loss is remembered: the power and the rise, both smooth.
_POWER_W, _RISE_K = range(2)
SHOWN_LOSS = 2


@jit
def shown_loss_W_K(
    state: Floats, first: int, power_W: float, dt_s: float, rise_K: float, capacity_J_K: float, loss_W_K: float
) -> float:
    """How much heat a wire loses at the least [W/K], by what flowed into it and did not make it hotter than it can be.

    A wire's rise is its power over its loss, smoothed by its own time constant, but for what latent heat takes.  So
    both smoothed by a longer one stand in the same proportion, whatever the power did.  With :data:`LOSING_TIMES` of
    the parameters' that holds of every wire that loses more than so many times less than they say; 0 below that.

    ``power_W``: in the wire alone, 0 or NaN where none was measured; ``rise_K``: how much hotter than the coldest
    surroundings it can be.  What is remembered begins at the ``first`` of ``state``, with zeros.
    """
    if not 0.0 < dt_s < inf:
        dt_s = 0.0
    time_s = LOSING_TIMES * capacity_J_K / loss_W_K
    weight = -expm1(-dt_s / time_s)
    state[first + _POWER_W] += weight * ((power_W if isfinite(power_W) else 0.0) - state[first + _POWER_W])
    state[first + _RISE_K] += weight * (rise_K - state[first + _RISE_K])
    lost_W = state[first + _POWER_W] - capacity_J_K * LATENT_K / time_s
    shown_W_K = lost_W / max(rise_K, state[first + _RISE_K], 1.0)
    return shown_W_K if shown_W_K > capacity_J_K / time_s else 0.0


#: What is remembered of a load that turns: itself, its last change to another one, and how often it turned.
_LAST_N, _CHANGE_N, _TURNS = range(3)
TURNED = 3


@jit
def turned(state: Floats, first: int, load_N: float, dt_s: float) -> float:
    """How often, in the last second or so, a load has changed to another one and back.

    What resistance does as the load changes is not heat (:func:`hottest_C`); in a load that noise changes all the time
    heat would hide.  What is remembered begins at the ``first`` of ``state``, with zeros.
    """
    turns = state[first + _TURNS] * exp(-dt_s / LONG_AGO_s) if 0.0 <= dt_s < inf else 0.0
    change_N = load_N - state[first + _LAST_N]
    if _is_other(load_N, state[first + _LAST_N]):
        turns += change_N * state[first + _CHANGE_N] < 0.0
        state[first + _CHANGE_N] = change_N
    state[first + _LAST_N], state[first + _TURNS] = load_N, turns
    return turns


#: Where in the memory of a wire's heat both thermometers, the shown loss, the load that turns, the cold and the look at
#: one that cools begin.
_BY_ITSELF, _BY_ITS_OWN, _SHOWN = 0, THERMOMETER, 2 * THERMOMETER
_TURNED, _COLD = _SHOWN + SHOWN_LOSS, _SHOWN + SHOWN_LOSS + TURNED
_COOLING = _COLD + SHOWN_COLD


@jit
def _transforms_Ohm(
    state: Floats,
    at_most_C: float,
    transformed_C: float,
    max_C: float,
    just_contracted_Ohm: float,
    most_contracted_Ohm: float,
    known_Ohm: float,
    transforms: Floats,
    stress_Pa: float,
) -> float:
    """What a wire shows more than has not contracted, that is no hotter than ``at_most_C``.

    One that has shown cold what the calibrated one does shows contracted no more than the least that it has shown, and
    what heat adds to that.  Another wire in its place may show more contracted, but not as much as itself before.
    """
    hotter = (min(at_most_C, max_C) - transformed_C) / (max_C - transformed_C) if max_C > transformed_C else 0.0
    by_then_Ohm = just_contracted_Ohm + max(hotter, 0.0) * (most_contracted_Ohm - just_contracted_Ohm)
    by_then_Ohm = contracted_Ohm(by_then_Ohm, most_contracted_Ohm, state[_COLD + COLD_Ohm], known_Ohm)
    no_more_Ohm = (1.0 - FALLS) * state[_COLD + MOST_Ohm]
    if state[_COLD + IS_IT] > 0.0:
        least_Ohm = by_then_Ohm * more_than_contracted(transforms, stress_Pa, state[_COLD + LEAST_Ohm])
        no_more_Ohm = min(no_more_Ohm, least_Ohm)
    return max(by_then_Ohm, no_more_Ohm)


@jit
def _shown_C(
    state: Floats,
    resistance_Ohm: float,
    load_N: float,
    dt_s: float,
    at_most_C: float,
    transformed_C: float,
    own_C: float,
    transforms_Ohm: float,
    slope_1_K: float,
) -> tuple[float, float]:
    """What both thermometers say: of a wire that transforms below a temperature, and below this one's own.

    Where the heat balance calls it hotter than it is known to transform at, one of them errs: the hotter counts.
    """
    own_C = min(own_C, transformed_C)
    return (
        hottest_C(state, _BY_ITSELF, resistance_Ohm, load_N, dt_s, at_most_C, transformed_C, transforms_Ohm, slope_1_K),
        hottest_C(state, _BY_ITS_OWN, resistance_Ohm, load_N, dt_s, at_most_C, own_C, transforms_Ohm, slope_1_K),
    )


@jit
def _cools(
    state: Floats,
    cools: bool,
    at_its_limit: bool,
    astray: bool,
    most_C: float,
    returns_C: float,
    transformed_C: float,
    alike: bool,
    until_cold: bool,
    cold_shown: bool,
    was_seen: bool,
    tells: bool,
) -> bool:
    """Whether the wire is let cool: from its limit on, where it is not where it should be (``astray``), until it is
    colder than it transforms at.

    A new one is told by nothing before it was seen (``was_seen``), unless it is cold by then.  One that shows what it
    is known to show cold is then waited for until it is no hotter than it returns at, for two looks at the most.  One
    that shows no more cold than contracted (``alike``) is told from that on its way alone: each time it begins cold.
    The calibrated one that the limit has held back is waited for until its resistance ``tells`` that it transforms, or
    it shows cold again: from there it contracts in one go.
    """
    begins = at_its_limit and astray
    if alike and begins and not cools:
        state[_COLD + COLD_Ohm] = state[_COLD + MOST_Ohm] = inf
    is_new = state[_COLD + COLD_Ohm] == inf
    unseen = is_new and not was_seen and state[_COLD + RESTED_times] < COLD_TIMES
    looks = unseen or (alike and state[_COLD + SEEN_times] < ANEW)
    waits = is_new and cold_shown and state[_COLD + SEEN_times] < 2.0 * ANEW
    is_told = most_C < (returns_C if waits else transformed_C) and not looks and not (is_new and (alike or until_cold))
    if until_cold and state[_COLD + IS_IT] > 0.0:
        is_told = is_told and (tells or (cold_shown and most_C < returns_C))
    return (cools or begins) and not is_told


@jit
def _heat_step(
    state: Floats,
    likely_C: float,
    most_C: float,
    guessed_K: float,
    cools: bool,
    astray: bool,
    until_cold: bool,
    power_W: float,
    dt_s: float,
    ambient_C: float,
    resistance_Ohm: float,
    load_N: float,
    most_contracted_Ohm: float,
    just_contracted_Ohm: float,
    wire_W: float,
    transforms: Floats,
    stress_Pa: float,
    return_C: float,
    shifts_K_Pa: tuple[float, float],
    then_C: float,
    slope_1_K: float,
    capacity_J_K: float,
    loss_W_K: float,
    margin: float,
    transformed_C: float,
    max_C: float,
    coldest_C: float,
) -> tuple[float, float, float, bool, float, float]:
    """See :meth:`WireHeat.step`."""
    likely_C = _after_C(likely_C, power_W, dt_s, ambient_C, capacity_J_K, loss_W_K)
    guessed_K *= exp(-max(dt_s, 0.0) * loss_W_K / capacity_J_K)
    if state[_BY_ITSELF + _SHOWN_Ohm] > just_contracted_Ohm:
        margin = min(margin, NOT_CONTRACTED_MARGIN)
    longest_s = capacity_J_K * margin / loss_W_K
    settled_C, same_load = ambient_C + power_W * margin / loss_W_K, not _is_other(load_N, state[_BY_ITSELF + _LOAD_N])
    returns_C = min(returns_at_most_C(return_C, stress_Pa, shifts_K_Pa[0], then_C), transformed_C)
    # Where any wire has returned by then that says nothing; this one's without a load, which is lower, does.
    cold_C = returns_C if returns_C < transformed_C else min(return_C, transformed_C)
    if isfinite(resistance_Ohm) and state[_BY_ITSELF + _GAP_s] + dt_s >= LONG_AGO_s:
        ask_anew(state, _COLD)
    known_Ohm, may_be_it = cold_Ohm(transforms, stress_Pa), state[_COLD + IS_IT] >= 0.0
    was_seen = isfinite(state[_BY_ITSELF + _SHOWN_Ohm])
    cold_shown = may_be_it and shows_cold(transforms, state[_BY_ITSELF + _SHOWN_Ohm], stress_Pa, known_Ohm)
    falls_C = cooling_C(
        state, _COOLING, resistance_Ohm, same_load, dt_s, settled_C, longest_s, slope_1_K, returns_C, cold_shown
    )
    at_most_C = min(_after_C(most_C, power_W, dt_s, ambient_C, capacity_J_K, loss_W_K / margin), falls_C)
    transforms_Ohm = _transforms_Ohm(
        state,
        at_most_C,
        transformed_C,
        max_C,
        just_contracted_Ohm,
        most_contracted_Ohm,
        known_Ohm,
        transforms,
        stress_Pa,
    )
    own_C = max(transforms_at_C(transforms, resistance_Ohm, stress_Pa, shifts_K_Pa[1], then_C), likely_C)
    shown_C, own_C = _shown_C(
        state, resistance_Ohm, load_N, dt_s, at_most_C, transformed_C, own_C, transforms_Ohm, slope_1_K
    )
    most_C, likely_C = min(at_most_C, shown_C, own_C), min(likely_C, shown_C)
    shown_Ohm, rests = state[_BY_ITSELF + _SHOWN_Ohm], cools or power_W * margin <= REST_K * loss_W_K
    cold_shown = may_be_it and shows_cold(transforms, shown_Ohm, stress_Pa, known_Ohm)
    is_cold = cold_shown and at_most_C <= cold_C < transformed_C
    measured_Ohm = shown_Ohm if isfinite(resistance_Ohm) else nan
    keep_cold(state, _COLD, measured_Ohm, dt_s / longest_s, rests, is_cold, at_most_C, transformed_C)
    at_its_limit = most_C > max_C - HEADROOM_K - AT_LIMIT_K and at_most_C < shown_C
    alike = shown_Ohm < just_contracted_Ohm and shows_cold_no_more(known_Ohm, just_contracted_Ohm)
    cools = _cools(
        state,
        cools,
        at_its_limit,
        astray,
        most_C,
        cold_C,
        transformed_C,
        alike,
        until_cold,
        cold_shown,
        was_seen,
        shown_Ohm > transforms_Ohm,
    )
    shown_W_K = shown_loss_W_K(state, _SHOWN, wire_W, dt_s, most_C - coldest_C, capacity_J_K, loss_W_K)
    # At its limit only the least that it may lose counts: else it would be called ever hotter.
    shown_W_K *= turned(state, _TURNED, load_N, dt_s) <= MOST_TURNS and not at_its_limit
    return likely_C, most_C, guessed_K, cools, SUDDENLY * shown_W_K, margin


class WireHeat:
    """What is known of the heat of one wire.

    Where the balance has come to its limit and the resistance does not tell, a limit that stood would hold the wire
    where it is for ever.  So, where it is not where it should be, it is let cool (``cools``) until it certainly
    transforms, which takes a second or two: from there on its resistance tells.  So it is at the beginning.  One of
    which it does not tell yet is let cool until it has been seen cold (:meth:`let_cool`).
    """

    def __init__(self, parameters: ThermalParameters):
        self.ambient = Ambient(parameters)
        self.transforms = Transforms(Calibration(), parameters)  #: to be replaced where a calibration knows more
        self.cools = True  #: nothing is known of it yet
        self.astray = True  #: it is not where it should be, as far as whoever drives it knows
        self._until_cold = False  #: and it is, until it has been seen cold
        #: The temperature with the heat loss of the parameters, and no more than its resistance says.
        self.temperature_C = parameters.max_temperature
        #: The same with the least heat loss that the wire may have.
        self.at_most_C = parameters.max_temperature
        #: How much of ``temperature_C`` is a guess: what the balance began with, as much of it as has not cooled away.
        self.guessed_K = parameters.max_temperature - parameters.ambient_temperature
        self._shown_loss_W_K = 0.0
        self._margin = parameters.heat_loss_margin  #: by which its loss may be less now
        self._state = floats(_COOLING + COOLING)
        begin_thermometer(self._state, _BY_ITSELF)
        begin_thermometer(self._state, _BY_ITS_OWN)
        begin_cold(self._state, _COLD)
        begin_cooling(self._state, _COOLING)

    def step(
        self,
        power_W: float,
        dt_s: float,
        ambient_read_C: float,
        parameters: ThermalParameters,
        resistance_Ohm: float = math.nan,
        load_N: float = 0.0,
        contracted_Ohm: float = math.inf,
        just_contracted_Ohm: float = math.inf,
        wire_W: float = math.nan,
        stress_Pa: float = math.nan,
    ) -> None:
        """Keep both balances, on measured power [W]; resistance [Ω] and load [N] of the same reading, NaN where there
        is none.

        ``contracted_Ohm``, ``just_contracted_Ohm``: the most that a contracted wire shows up to max_temperature and to
        transformed_temperature (:func:`most_contracted_Ohm`);
        ``wire_W``: the power without that in its leads.
        """
        self.temperature_C, self.at_most_C, self.guessed_K, self.cools, self._shown_loss_W_K, self._margin = _heat_step(
            self._state,
            self.temperature_C,
            self.at_most_C,
            self.guessed_K,
            self.cools,
            self.astray,
            self._until_cold,
            power_W,
            dt_s,
            self.ambient.step(ambient_read_C, dt_s, parameters),
            resistance_Ohm,
            load_N,
            contracted_Ohm,
            just_contracted_Ohm,
            wire_W,
            self.transforms.row,
            stress_Pa,
            self.transforms.return_C,
            self.transforms.shifts_K_Pa,
            self.transforms.then_C,
            self.transforms.slope_1_K,
            parameters.heat_capacity,
            parameters.heat_loss,
            parameters.heat_loss_margin,
            parameters.transformed_temperature,
            parameters.max_temperature,
            _coldest_C(parameters),
        )

    def let_cool(self) -> None:
        """Try a wire anew that the limit holds back: until it has been seen cold, once; then until it transforms.

        Once it has been, what it shows more than contracted says that it transforms, whatever wire it is.
        """
        self.cools = self._until_cold = True

    def power_limit_W(self, horizon_s: float, parameters: ThermalParameters) -> float:
        """Power that may flow on for ``horizon_s`` without anybody looking and leave the wire below max_temperature.

        None in a wire that is let cool.  May be below zero: then the wire is too hot already.
        """
        return self._power_W(horizon_s, self._margin, parameters)

    def power_for_ever_W(self, parameters: ThermalParameters) -> float:
        """Power that may flow on for ever and leave a wire below max_temperature that loses heat_loss /
        unwatched_margin, or what it is known to lose.

        None in a wire that is let cool.
        """
        return self._power_W(inf, min(parameters.heat_loss_margin, parameters.unwatched_margin), parameters)

    def _power_W(self, horizon_s: float, margin: float, parameters: ThermalParameters) -> float:
        """Until the horizon, by the heat loss of the parameters / margin, or by what the wire has shown to lose.

        That was reckoned from the coldest surroundings, and so is what it leaves: in warmer ones it has shown more.
        """
        if self.cools:
            return 0.0
        by_margin_W = self._leaves_W(parameters.heat_loss / margin, self.ambient.temperature_C, horizon_s, parameters)
        if not self._shown_loss_W_K > 0.0:
            return by_margin_W
        return max(by_margin_W, self._leaves_W(self._shown_loss_W_K, _coldest_C(parameters), horizon_s, parameters))

    def _leaves_W(self, loss_W_K: float, ambient_C: float, horizon_s: float, parameters: ThermalParameters) -> float:
        """What a heat loss leaves until the horizon."""
        decay = math.exp(-horizon_s * loss_W_K / parameters.heat_capacity)
        settled_C = (parameters.max_temperature - HEADROOM_K - self.at_most_C * decay) / (1.0 - decay)
        return loss_W_K * (settled_C - ambient_C)


def _coldest_C(parameters: ThermalParameters) -> float:
    return parameters.ambient_temperature - parameters.ambient_tolerance


def derated_limit_A(
    temperature_C: float, max_current_A: float, bias_current_A: float, parameters: ThermalParameters
) -> float:
    """Highest current allowed at a temperature [A].

    ``max_current_A`` up to ``derate_temperature``, falling linearly to ``bias_current_A`` at
    ``max_temperature``; the bias also where the temperature is not a number.
    """
    if temperature_C <= parameters.derate_temperature:
        return max_current_A
    if not temperature_C < parameters.max_temperature:
        return bias_current_A
    span_C = parameters.max_temperature - parameters.derate_temperature
    return bias_current_A + (max_current_A - bias_current_A) * (parameters.max_temperature - temperature_C) / span_C
