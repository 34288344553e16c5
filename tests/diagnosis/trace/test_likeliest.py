"""The likeliest parameters and their evidence, where both have a closed form: rows that are linear in two sizes."""

import dataclasses
import math
from types import SimpleNamespace

import numpy as np
import pytest
import scipy

from sma_actuator.diagnosis.trace.candidates import Candidate
from sma_actuator.diagnosis.trace.covariance import Covariance
from sma_actuator.diagnosis.trace.likeliest import likeliest
from sma_actuator.diagnosis.trace.limits import LIMITS
from sma_actuator.diagnosis.trace.pairs import beside
from sma_actuator.diagnosis.trace.problem import Likeliest, curved
from sma_actuator.estimation.effects.free import Free, size

NAME, N = "load_cell_drift", 200
SLOPES = np.random.default_rng(2).standard_normal((N, 2)) * (0.7, 2.0)  # of a size that is typical
SMOOTH = 2.0 * np.column_stack((np.linspace(-1.0, 1.0, N), np.ones(N)))
TYPICAL = np.array([0.2, 0.05])  # N, N/s


class Made:
    """Evidence of which no more is known than its rows."""

    def compare(self, effects):
        return SimpleNamespace(rows=self.residual(effects))


class Line(Made):
    """Evidence in which a load cell's zero and its change move every row in proportion."""

    def __init__(self, base, slopes=SLOPES):
        self.base, self.slopes = base, slopes

    def residual(self, effects):
        drift = effects[NAME]
        return self.base + self.slopes @ (np.array([drift.offset, drift.rate]) / TYPICAL)


def candidate(limit=100.0, least=None, other_at=(), least_rate=None, both=False):
    """``both``: neither may be nothing."""
    other_at = ("low",) if both else other_at
    offset = size("offset", limit * TYPICAL[0], TYPICAL[0], least, other_at)
    rate = size("rate", limit * TYPICAL[1], TYPICAL[1], least_rate, ("low",) if both else ())
    return Candidate(NAME, (offset, rate), {})


def of(true, limit=100.0, **of_offset):
    """(rows without an effect, what is likeliest, the covariance); ``true``: sizes, in what is typical."""
    base = np.random.default_rng(3).standard_normal(N) + SMOOTH @ (0.5, -0.4) - SLOPES @ true
    usual = Covariance(SMOOTH)
    return base, likeliest(Line(base), [candidate(limit, **of_offset)], usual), usual


@pytest.mark.parametrize("true", [(1.0, -2.0), (0.0, 0.0), (-6.0, 4.0)])
def test_the_likeliest_sizes_are_those_of_the_normal_equations(true):
    base, found, usual = of(true)
    a, b = usual.whiten(SLOPES), usual.whiten(base)
    information = a.T @ a + np.eye(2) / LIMITS.size**2
    expected = -np.linalg.solve(information, a.T @ b)
    np.testing.assert_allclose(found.u, expected, atol=1e-4)
    assert found.values[NAME] == pytest.approx(dict(zip(("offset", "rate"), expected * TYPICAL, strict=True)), abs=1e-4)
    assert np.abs(found.u - true).max() < 4.0 * np.sqrt(np.diag(np.linalg.inv(information))).max()


def test_laplaces_evidence_is_exact_where_all_is_linear_and_normal():
    """So much as if the effect were one more smooth error, of the size that was known of it before the logs."""
    for true in ((1.0, -2.0), (0.0, 0.0)):
        base, found, usual = of(true, both=True)
        expected = as_smooth_errors(base, slice(None))
        assert found.log_evidence(usual) == pytest.approx(expected, abs=1e-3)


def as_smooth_errors(base, which):
    """The logarithm of the likelihood, were the slopes of some sizes smooth errors."""
    together = Covariance(SMOOTH, LIMITS.size * SLOPES[:, which])
    return together.log_likelihood(float(np.sum(together.whiten(base) ** 2)))


@pytest.mark.parametrize("true", [(1.0, -2.0), (0.0, 0.0), (0.9, 0.0), (0.0, -0.3)])
def test_nothing_is_paid_for_a_size_that_an_effect_has_no_need_of(true):
    """A zero that was moved need not move on: it was moved, or moves, or both, each as likely before the logs."""
    base, found, usual = of(true)
    each = [as_smooth_errors(base, which) for which in ([0], [1], [0, 1])]
    assert found.log_evidence(usual) == pytest.approx(np.logaddexp.reduce(each) - math.log(3.0), abs=1e-3)
    assert [list(none) for none in found.problem.without] == [[], [0], [1]]


def test_what_is_usual_may_be_taken_off_before_what_else_is_off_together():
    """So it is taken off once for many covariances: the evidence is that of both at once."""
    more = np.random.default_rng(9).standard_normal((N, 3))
    for true in ((1.0, -2.0), (0.0, 0.0)):
        _, found, _ = of(true)
        usual, whole = Covariance(SMOOTH, share=0.5), Covariance(SMOOTH, more, share=0.5)
        rest = found.whitened(usual).log_evidence(Covariance(usual.whiten(more)))
        assert usual.log_likelihood(0.0) + rest == pytest.approx(found.log_evidence(whole), abs=1e-9)
        assert abs(found.log_evidence(whole) - found.log_evidence(usual)) > 0.1


@pytest.mark.parametrize("true", [(1.0, -2.0), (0.0, 0.0), (-0.1, 1.0)])
def test_nothing_is_paid_for_what_cannot_be(true):
    """A size of one sign: before the logs it was normal over that half alone, and so is what they leave likely."""
    base, found, usual = of(true, least=0.0, both=True)
    a = usual.whiten(SLOPES)
    information = a.T @ a + np.eye(2) / LIMITS.size**2
    mean, deviation = -np.linalg.solve(information, a.T @ usual.whiten(base)), np.sqrt(np.linalg.inv(information)[0, 0])
    together = Covariance(SMOOTH, LIMITS.size * SLOPES)
    both_signs = together.log_likelihood(float(np.sum(together.whiten(base) ** 2)))
    expected = both_signs + float(scipy.stats.norm.logsf(-mean[0] / deviation)) + math.log(2.0)
    assert found.log_evidence(usual) == pytest.approx(expected, abs=0.05)


def panels(low, high, around):
    """Places and weights of Gauss and Legendre's rule between two ends, finest where a likelihood is largest."""
    widths = np.concatenate(([0.0], 2.0 ** np.arange(-9.0, 8.0)))
    edges = np.unique(np.clip(np.concatenate((around - widths, around + widths)), low, high))
    x, weight = np.polynomial.legendre.leggauss(8)
    half = 0.5 * np.diff(edges)[:, None]
    return (edges[:-1, None] + half * (x + 1.0)).ravel(), (half * weight).ravel()


def densely(found, covariance):
    """Logarithm of the mean likelihood over what two sizes may be before the logs, by numerical integration."""
    p = found.problem
    line, ends = p.evidence, np.array((p.low, p.high))
    (one, of_one), (other, of_other) = (panels(*ends[:, k], found.u[k]) for k in (0, 1))
    before = [-0.5 * (at / p.spread[k]) ** 2 for k, at in enumerate((one, other))]
    a, b = covariance.whiten(line.slopes), covariance.whiten(line.base)
    (c, d), (_, e) = a.T @ a
    up, up_other = a.T @ b
    squares = np.add.outer(c * one**2 + 2.0 * up * one, e * other**2 + 2.0 * up_other * other)
    squares += 2.0 * d * np.outer(one, other) + b @ b
    likely = covariance.log_likelihood(0.0) - 0.5 * squares + np.add.outer(*before)
    (low, high), mean = ends / p.spread, np.log(np.multiply.outer(of_one, of_other))
    usual = np.sum(np.log(scipy.stats.norm.cdf(high) - scipy.stats.norm.cdf(low))) + 2.0 * 0.5 * math.log(2.0 * math.pi)
    return float(np.logaddexp.reduce(likely + mean, axis=None) - usual - np.sum(np.log(p.spread)))


@pytest.mark.parametrize("signs", [(0.0, None), (0.0, 0.0)])
def test_of_what_is_possible_the_evidence_is_the_integral(signs):
    """Of sizes of one sign that go together, however far beyond it they would be likeliest, and under the covariance
    of another hypothesis too."""
    for seed in range(60):
        rng = np.random.default_rng(seed)
        slopes = rng.standard_normal((N, 2)) @ rng.standard_normal((2, 2)) / 10.0
        true = 2.0 * rng.standard_normal(2)
        line = Line(rng.standard_normal(N) + SMOOTH @ (0.5, -0.4) - slopes @ true, slopes)
        found = likeliest(line, [candidate(least=signs[0], least_rate=signs[1], both=True)], Covariance(SMOOTH))
        for covariance in (Covariance(SMOOTH), Covariance(SMOOTH, share=0.5)):
            assert found.log_evidence(covariance) == pytest.approx(densely(found, covariance), abs=0.02), seed


def test_a_range_without_any_width_is_a_number():
    """What its bounds leave no choice costs nothing, and is worth what the rows say of it there."""
    base, _, usual = of((0.0, -2.0))
    fixed = likeliest(Line(base), [candidate(limit=0.0)], usual)
    assert fixed.u == pytest.approx(0.0, abs=1e-6)
    assert fixed.log_evidence(usual) == pytest.approx(usual.log_likelihood(float(np.sum(usual.whiten(base) ** 2))))


def test_what_is_not_there_costs_what_it_could_have_been():
    """Occam's factor: an effect that moves nothing is less likely than nothing, one that is there by far more."""
    for true, sign in (((0.0, 0.0), -1.0), ((1.0, 1.0), 1.0)):
        base, found, usual = of(true)
        nothing = usual.log_likelihood(float(np.sum(usual.whiten(base) ** 2)))
        assert sign * (found.log_evidence(usual) - nothing) > 3.0


def test_it_begins_where_it_was_already_and_sees_no_rows_but_its_own():
    base, found, usual = of((1.0, -2.0))
    again = likeliest(Line(base), [candidate()], usual, found.values)
    np.testing.assert_allclose(again.u, found.u, atol=1e-4)
    seen = np.arange(N) < N // 2
    spoiled = np.where(seen, base, 1e3)
    some, same = (likeliest(Line(b), [candidate()], usual.of(seen), None, seen) for b in (base, spoiled))
    np.testing.assert_array_equal(some.u, same.u)


def test_a_size_at_the_end_of_what_is_possible_is_another_effect():
    _, inside, _ = of((1.0, -2.0))
    assert inside.objection == ""
    _, at_end, _ = of((1.0, -8.0), limit=4.0)
    assert at_end.objection.startswith(f"{NAME}'s rate comes to -0.2 N/s, the end of what is possible")


def test_a_size_that_cannot_be_negative_is_another_effect_at_zero_only_where_that_is_said():
    """A wear that moves no end is a contact that drifts; one that leaves the resistance as it is, is still a wear."""
    _, wear, _ = of((-1.0, -2.0), least=0.0)
    assert wear.values[NAME]["offset"] == 0.0 and wear.objection == ""
    _, contact, _ = of((-1.0, -2.0), least=0.0, other_at=("low",))
    assert contact.objection.startswith(f"{NAME}'s offset comes to 0 N, the end of what is possible")
    _, there, _ = of((2.0, -2.0), limit=20.0, least=0.0, other_at=("low",))
    assert there.objection == ""


def test_a_shape_is_found_from_whichever_start_leads_there():
    """A lag of which nothing is known but its range: there is a minimum at each end, and the deeper one wins."""
    time_s = np.linspace(0.0, 60.0, N)

    class Rise(Made):
        """Rows in which something comes with a time constant."""

        def residual(self, effects):
            drift = effects["contact_drift"]
            return 8.0 * (1.0 - np.exp(-time_s / 20.0)) - drift.resistance / 0.01 * (
                1.0 - np.exp(-time_s / drift.time_constant)
            )

    slow = Free("time_constant", 0.3, 900.0, 1.0, (1.0, 30.0, 600.0))
    c = Candidate("contact_drift", (size("resistance", 1.0, 0.01, 0.0), slow), {})
    usual = Covariance()
    found = likeliest(Rise(), [c], usual)
    assert found.values["contact_drift"]["time_constant"] == pytest.approx(20.0, rel=0.15)
    assert found.values["contact_drift"]["resistance"] == pytest.approx(0.08, rel=0.15)


def test_a_start_that_promises_less_may_lead_further():
    """One shape takes off two thirds of the squares at once and then no more, another a third, and in the end all."""
    hidden, beside_it = np.zeros(N), np.zeros(N)
    hidden[0] = beside_it[1] = 1.0

    class TwoValleys(Made):
        """Rows that a short time constant nearly explains, and a certain long one."""

        def residual(self, effects):
            drift = effects["contact_drift"]
            tau = math.log(drift.time_constant)
            angle = 0.6 + 0.2 * (tau / 2.0) ** 2 if tau < 2.0 else 0.4 * (tau - math.log(100.0))
            return 30.0 * hidden - drift.resistance / 0.01 * (math.cos(angle) * hidden + math.sin(angle) * beside_it)

    slow = Free("time_constant", 0.3, 9000.0, 1.0, (1.0, 1000.0))
    c = Candidate("contact_drift", (size("resistance", 1.0, 0.01, 0.0), slow), {})
    found = likeliest(TwoValleys(), [c], Covariance())
    assert found.values["contact_drift"]["time_constant"] == pytest.approx(100.0, rel=0.1)


def test_one_more_effect_is_sketched_with_the_shape_that_it_has_beside_the_first_one():
    """A drift that has to take a lead's part too comes at once alone, and late beside it."""
    time_s = np.linspace(0.0, 60.0, N)

    class Both(Made):
        """Rows in which a lead and a drift that comes with a time constant are hidden."""

        def residual(self, effects):
            def rise(resistance, time_constant):
                return 300.0 * resistance * (1.0 - np.exp(-time_s / time_constant))

            rows = 20.0 + rise(0.05, 30.0)
            if "lead_resistance" in effects:
                rows = rows - 1000.0 * effects["lead_resistance"].resistance
            drift = effects.get("contact_drift")
            return rows - (rise(drift.resistance, drift.time_constant) if drift else 0.0)

    lead = Candidate("lead_resistance", (size("resistance", 1.0, 0.01),), {})
    slow = Free("time_constant", 0.3, 900.0, 1.0, (1.0, 30.0, 600.0))
    drift = Candidate("contact_drift", (size("resistance", 1.0, 0.01, 0.0), slow), {})
    usual = Covariance()
    first, other = (likeliest(Both(), [c], usual) for c in (lead, drift))
    both = likeliest(Both(), [lead, drift], usual, first.values)
    assert other.values["contact_drift"]["time_constant"] < 10.0
    assert both.log_evidence(usual) > first.log_evidence(usual) + 100.0
    assert beside(first, other, usual) == pytest.approx(both.log_evidence(usual), abs=10.0)


def test_how_wide_the_likely_is_is_seen_across_jumps():
    """An estimate jumps where a branch turns a sample earlier: a slope within a jump says a hundred times too much, and
    one beside it nothing.  The evidence is that of the integral."""

    class Jumps(Line):
        """Rows that follow a load cell's zero in steps, of which many are within its standard deviation."""

        def residual(self, effects):
            steps = np.round(effects[NAME].offset / TYPICAL[0] / 2e-3 + 0.01 * np.arange(N))
            return self.base + 2e-3 * SLOPES[:, 0] * steps

    usual = Covariance(SMOOTH)
    base = np.random.default_rng(8).standard_normal(N) - SLOPES[:, 0]
    c = Candidate(NAME, (size("offset", 20.0, TYPICAL[0]),), {})
    found = likeliest(Jumps(base), [c], usual)
    units = np.linspace(-2.0, 4.0, 6001)
    off = np.array([found.problem.cost(usual, found.problem.residual(u), u) for u in units[:, None]])
    logarithms = -0.5 * (off + usual.log_determinant) - 0.5 * math.log(2.0 * math.pi) - math.log(LIMITS.size)
    whole = float(np.logaddexp.reduce(logarithms)) + math.log(units[1] - units[0])
    assert found.log_evidence(usual) == pytest.approx(whole, abs=0.2)
    axes, sides = (
        1e-3 * np.eye(1),
        tuple(found.problem.residual(found.u + sign * 1e-3)[:, None] for sign in (-1.0, 1.0)),
    )
    how_curved = curved(usual, found.rows, axes / LIMITS.size, sides)
    within = Likeliest(found.problem, found.u, found.rows, axes, sides, how_curved)
    assert abs(within.log_evidence(usual) - whole) > 0.2


def test_under_another_covariance_nothing_is_gained_where_nobody_looked():
    """Half of the rows want a larger size than the other half: where those are loud, the likelihood rises over all that
    was seen of it, and on beyond that it does not."""
    half, usual = np.arange(N) < N // 2, Covariance()
    base = np.random.default_rng(6).standard_normal(N) - SLOPES[:, 0] * np.where(half, -1.5, 1.5)
    c = Candidate(NAME, (size("offset", 20.0, TYPICAL[0]),), {})
    one = likeliest(Line(base), [c], usual)
    (at,), ((width,),) = one.u, one.axes

    class Ends(Line):
        """A size moves nothing more beyond what is likely."""

        def residual(self, effects):
            offset = np.clip(effects[NAME].offset / TYPICAL[0], at - 1.5 * width, at + 1.5 * width)
            return self.base + SLOPES[:, 0] * offset

    found = likeliest(Ends(base), [c], usual)
    loud = Covariance(alone=(np.where(half, 30.0, 1.0), np.ones(N)))
    units = np.linspace(-9.0, 9.0, 6001)
    off = np.array([found.problem.cost(loud, found.problem.residual(u), u) for u in units[:, None]])
    before = float(np.logaddexp.reduce(-0.5 * (units / LIMITS.size) ** 2))
    whole = float(np.logaddexp.reduce(-0.5 * (off + loud.log_determinant))) - before
    assert found.log_evidence(loud) < whole + 0.5


@pytest.mark.parametrize("share", [0.2, 0.5, 0.8])
def test_a_wall_beside_the_likeliest_makes_nothing_likelier(share):
    """Where a parameter is a little less all is far off (a wire that would be warm throughout): half of what is likely
    is behind that wall, and it is not mistaken for a slope that leads away from it."""
    base, free, usual = of((1.0, -2.0))
    (_, at), (_, width) = free.u, np.abs(free.axes).max(axis=1)
    wall = 30.0 * np.random.default_rng(5).standard_normal(N)

    class Walled(Line):
        def residual(self, effects):
            behind = effects[NAME].rate / TYPICAL[1] < at - share * width
            return super().residual(effects) + wall * behind

    found = likeliest(Walled(base), [candidate()], usual)
    np.testing.assert_allclose(found.u, free.u, atol=0.5 * width)
    for covariance in (usual, Covariance(SMOOTH, wall[:, None]), Covariance(3.0 * SMOOTH)):
        assert found.log_evidence(covariance) < free.log_evidence(covariance) + 0.5


def test_under_another_covariance_a_jump_does_not_make_a_parameter_free():
    """What an effect moves may be smooth errors there; where that leaves jumps alone, both sides may be likelier than
    the middle.  How narrow the likely is says the slope there and how curved it was under its own."""
    _, found, _ = of((1.0, -2.0))
    wide = Covariance(SMOOTH, SLOPES)
    jump = np.random.default_rng(4).standard_normal(N)
    jump *= math.sqrt(6.0 / np.sum(wide.whiten(jump) ** 2))
    jump *= np.sign(np.sum(wide.whiten(jump) * wide.whiten(found.rows)))
    higher = found.rows + jump
    here, *sides = (np.sum(wide.whiten(rows) ** 2, axis=0) for rows in (higher, *found.sides))
    assert all(np.all(side < here) for side in sides)
    less = 0.5 * float(here - np.sum(wide.whiten(found.rows) ** 2))
    jumped = dataclasses.replace(found, rows=higher)
    assert jumped.log_evidence(wide) == pytest.approx(found.log_evidence(wide) - less, abs=0.1)
