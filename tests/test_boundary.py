# SPDX-License-Identifier: MIT
"""Boundaries of stability in two numbers: against crossings, counts and published numbers."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import pipedyn as pp

BUCKLING = pp.Pipe(0.2, damping=0.005)
STANDING = {"gamma": (-60.0, 20.0), "u": (0.0, 8.0)}


@pytest.fixture(scope="module")
def over_beta():
    ranges = {"beta": (0.01, 0.98), "u": (0.0, 17.4)}
    return pp.boundary(pp.Continuum(pp.Pipe(0.2)), "beta", "u", ranges, criticality=False)


@pytest.fixture(scope="module")
def standing():
    return pp.boundary(pp.Continuum(BUCKLING), "gamma", "u", STANDING, criticality=False)


def place(found, kind):
    (point,) = [point for point in found.points if point.kind == kind]
    return point


def eigenvalues(model, u):
    """All of them, from the equations of motion."""
    return np.linalg.eigvals(model.jacobian(0.0, np.zeros(2 * model.coordinates), u))


def below(found, x, y, start):
    """Unstable roots at a point: those of the lower edge and what curves add on the way up."""
    count = start
    for curve in found.curves:
        at = np.flatnonzero((curve.x[:-1] - x) * (curve.x[1:] - x) < 0.0)
        for k in at:
            share = (x - curve.x[k]) / (curve.x[k + 1] - curve.x[k])
            if curve.y[k] + share * (curve.y[k + 1] - curve.y[k]) < y:
                count += int(np.sign(curve.x[k + 1] - curve.x[k]) * curve.change[k])
    return count


# ------------------------------------------------------------------------ points on the curves


def test_points_of_the_continuous_pipe_are_its_critical_speeds(over_beta):
    rng = np.random.default_rng(17)
    for curve in over_beta.curves:
        assert curve.error < 1e-9
        for k in rng.choice(np.flatnonzero(np.abs(curve.slopes[:, 0]) >= 0.3), 2, replace=False):
            found = pp.crossings(pp.Continuum(pp.Pipe(curve.x[k])), 1.01 * curve.y[k])
            nearest = min(found, key=lambda c: abs(c.speed - curve.y[k]))
            assert curve.y[k] == pytest.approx(nearest.speed, abs=1e-9 + nearest.error)
            assert curve.frequency[k] == pytest.approx(nearest.frequency, rel=1e-8)
            assert curve.sides[k].min() == min(nearest.unstable_before, nearest.unstable_after)


@pytest.mark.parametrize("beta", [0.295, 0.67, 0.9])
def test_the_first_curve_turns_back_where_the_critical_speed_leaps(over_beta, beta):
    first = over_beta.curves[0]
    assert first.unstable.max() == 0
    assert np.count_nonzero(np.diff(np.sign(first.x - beta))) == 3


def test_unstable_roots_that_leave_the_window_enter_it(over_beta, standing):
    """Curves and their changes give the number of unstable roots anywhere, by eigenvalues."""
    assert over_beta.failures == standing.failures == ()
    rng = np.random.default_rng(3)
    for found, low in ((over_beta, None), (standing, 0.01)):
        for _ in range(8):
            (left, right), (_, top) = found.ranges
            x, y = rng.uniform(left, right), rng.uniform(0.1, top)
            name = found.names[0]
            model = pp.Galerkin(replace(found.model.pipe, **{name: x}), 24, "legendre")
            start = 0 if low is None else int((eigenvalues(model, low).real > 1e-9).sum())
            values = pp.eigenvalues(model, y, 16)
            assert below(found, x, y, start) == int((values.real > 0.0).sum())
            assert found.unstable(x, y) == int((values.real > 0.0).sum())


@pytest.mark.parametrize(
    ("pipe", "name", "ends", "speeds"),
    [
        # physics of supports and hysteresis: Paidoussis (1970) has 5.79 near the latter
        (pp.Pipe(0.2, hysteresis=0.05), "hysteresis", (0.02, 0.1), (5.664183, 5.900876)),
        (pp.Pipe(0.2, root=pp.RootSpring(1.0)), "root.stiffness", (0.5, 2.0), (5.237511, 5.040909)),
        (
            pp.Pipe(0.1, terms=[pp.Foundation(1.0)]),
            "terms[0].stiffness",
            (10, 100),
            (4.783532, 5.133889),
        ),
        (
            pp.Pipe(0.2, terms=[pp.Tension(1.0)]),
            "Tension.load",
            (-2, 20),
            (4.976284857, 8.583785800),
        ),
        (pp.Pipe(0.2), "alpha", (0.8, 2.0), (6.947846171, 3.358684218)),
    ],
)
def test_curves_end_at_known_critical_speeds(pipe, name, ends, speeds):
    ranges = {name: ends, "u": (0.0, 7.5)}
    found = pp.boundary(pp.Continuum(pipe), name, "u", ranges, criticality=False)
    curve = next(c for c in found.curves if c.kind == "flutter" and c.unstable[0] == 0)
    reached = dict(zip(curve.x[[0, -1]].tolist(), curve.y[[0, -1]].tolist(), strict=True))
    for end, speed in zip(ends, speeds, strict=True):
        if speed < 7.5:
            assert reached[end] == pytest.approx(speed, abs=6e-7)


def test_a_window_without_the_flow_speed_has_the_same_points():
    pipe = pp.Pipe(0.4, terms=[pp.PointMass(1.0, 0.1)])
    ranges = {"PointMass.mass": (0.0, 1.0), "gamma": (-5.0, 40.0)}
    chain = pp.Chain(pipe, 5)
    found = pp.boundary(chain, "PointMass.mass", "gamma", ranges, u=6.0, criticality=False)
    assert found.failures == ()
    assert found.curves
    for curve in found.curves:
        k = len(curve) // 2
        mass = pp.PointMass(1.0, curve.x[k])
        other = chain.with_pipe(replace(pipe, gamma=curve.y[k], terms=(mass,)))
        nearest = min(pp.crossings(other, 8.0), key=lambda c: abs(c.speed - 6.0))
        assert nearest.speed == pytest.approx(6.0, abs=1e-9)
        assert nearest.frequency == pytest.approx(curve.frequency[k], abs=1e-8)


@pytest.mark.parametrize(
    "stiffest", [30.0, *(pytest.param(k, marks=pytest.mark.slow) for k in (60.0, 100.0)), 1000.0]
)
def test_flutter_in_a_closed_curve_is_found_in_windows_of_any_size(stiffest):
    """Between root stiffness 0.89 and 5.71; lines are even in the angle that the spring passes."""
    chain = pp.Chain(pp.Pipe(0.2, gamma=10.0, root=pp.RootSpring(1.0)), 5)
    ranges = {"root.stiffness": (0.01, stiffest), "u": (0.0, 12.0)}
    found = pp.boundary(chain, "root.stiffness", "u", ranges, criticality=False)
    assert found.failures == ()
    (closed,) = [curve for curve in found.curves if curve.ends == ("closed", "closed")]
    assert closed.x.min() == pytest.approx(0.888, abs=0.005)
    assert closed.x.max() == pytest.approx(5.71, abs=0.03)
    inside = chain.with_pipe(replace(chain.pipe, root=pp.RootSpring(3.0)))
    for u, count in ((9.5, 2), (9.7, 4), (9.9, 2)):
        assert (eigenvalues(inside, u).real > 0.0).sum() == found.unstable(3.0, u) == count


def test_a_scene_and_a_chain_have_one_boundary():
    pipe = pp.Pipe(0.3, damping=0.01)
    ranges = {"Spring.stiffness": (0.0, 40.0), "u": (0.0, 9.0)}
    models = [
        pp.Chain(replace(pipe, terms=(pp.Spring(0.5, 1.0),)), 3),
        pp.modular.chain(pipe, 3).plus(pp.Spring(0.5, 1.0)),
    ]
    one, other = (
        pp.boundary(model, "Spring.stiffness", "u", ranges, criticality=False) for model in models
    )
    assert len(one.curves) == len(other.curves) > 0
    for a, b in zip(one.curves, other.curves, strict=True):
        assert a.y[[0, -1]] == pytest.approx(b.y[[0, -1]], abs=1e-10)


# --------------------------------------------------------------------------- organising points


def test_flutter_meets_divergence_where_the_book_says():
    """Paidoussis, Fluid-Structure Interactions, vol. 1, p. 387: 2.2458, -46.0014."""
    ranges = {"gamma": (-60.0, 0.0), "u": (0.0, 4.0)}
    two_modes = pp.Galerkin(BUCKLING, 2, "beam")
    found = pp.boundary(two_modes, "gamma", "u", ranges, criticality=False)
    point = place(found, "Hopf-pitchfork")
    assert (point.x, point.y) == pytest.approx((-46.00146312, 2.24583504), abs=1e-8)
    assert point.unstable == 0


def test_the_continuous_pipe_has_a_zero_root_and_a_pair_on_the_axis_there(standing):
    point = place(standing, "Hopf-pitchfork")
    assert (point.x, point.y) == pytest.approx((-44.0276, 2.35536), abs=5e-5)  # as printed
    values = pp.eigenvalues(pp.Continuum(replace(BUCKLING, gamma=point.x)), point.y, 8)
    neutral = values[np.abs(values.real) < 1e-7]
    assert sorted(neutral.imag) == pytest.approx(
        [-point.frequencies[0], 0.0, point.frequencies[0]], abs=1e-7
    )


def test_zero_is_a_double_eigenvalue_where_flutter_ends_on_divergence(standing):
    """At a Bogdanov-Takens point K v = 0, w^T K = 0 and w^T C v = 0."""
    point = place(standing, "Bogdanov-Takens")
    (ended,) = [c for c in standing.curves if "Bogdanov-Takens" in c.ends]
    assert ended.frequency.min() == 0.0
    model = pp.Galerkin(replace(BUCKLING, gamma=point.x), 20, "legendre")
    _, damping, stiffness = model.operators().at(point.y)
    left, sizes, right = np.linalg.svd(stiffness)
    assert sizes[-1] < 1e-10 * sizes[0]
    around = np.abs(left[:, -1]) @ np.abs(damping) @ np.abs(right[-1])
    assert abs(left[:, -1] @ damping @ right[-1]) < 1e-9 * around


def test_flutter_that_no_line_meets_is_followed_from_the_divergence_that_it_leaves():
    """Its curve leaves a Bogdanov-Takens point inside and the window between two lines."""
    pipe = pp.Pipe(0.2, terms=[pp.Damper(0.5, 1.0)])
    ranges = {"gamma": (-30.0, 50.0), "Damper.coefficient": (0.0, 20.0)}
    chain = pp.Chain(pipe, 2)
    found = pp.boundary(chain, "gamma", "Damper.coefficient", ranges, u=7.0, criticality=False)
    assert found.failures == ()
    point = place(found, "Bogdanov-Takens")
    (curve,) = [c for c in found.curves if "Bogdanov-Takens" in c.ends]
    end = 0 if curve.ends[0] == "Bogdanov-Takens" else -1
    assert (curve.x[end], curve.y[end]) == pytest.approx((point.x, point.y), abs=1e-9)
    k = len(curve) // 2
    damper = pp.Damper(0.5, curve.y[k])
    values = eigenvalues(chain.with_pipe(replace(pipe, gamma=curve.x[k], terms=(damper,))), 7.0)
    nearest = values[np.argmin(np.abs(values - 1j * curve.frequency[k]))]
    assert abs(nearest - 1j * curve.frequency[k]) < 1e-9


def test_two_pairs_lie_on_the_axis_at_a_double_hopf_point():
    chain = pp.Chain(pp.Pipe(0.2, terms=[pp.PointMass(1.0, 0.1)]), 4)
    ranges = {"PointMass.mass": (0.0, 0.5), "u": (3.0, 10.0)}
    found = pp.boundary(chain, "PointMass.mass", "u", ranges, criticality=False)
    point = place(found, "double Hopf")
    there = chain.with_pipe(replace(chain.pipe, terms=(pp.PointMass(1.0, point.x),)))
    values = eigenvalues(there, point.y)
    neutral = np.sort(values[(np.abs(values.real) < 1e-8) & (values.imag > 0.0)].imag)
    assert neutral == pytest.approx(point.frequencies, abs=1e-8)
    assert point.unstable == int((values.real > 1e-6).sum())


def test_criticality_changes_at_a_bautin_point():
    """The first Lyapunov coefficients of `hopf` on either side have their zero there."""
    ranges = {"beta": (0.4, 0.7), "u": (4.0, 8.0)}
    found = pp.boundary(pp.Chain(pp.Pipe(0.2), 3), "beta", "u", ranges)
    point = place(found, "Bautin")
    sides = [pp.hopf(pp.Chain(pp.Pipe(point.x + step), 3)) for step in (-1e-3, 1e-3)]
    first, last = (one.lyapunov for one in sides)
    assert first * last < 0.0
    assert abs(first + last) < 0.02 * abs(first - last)  # a line through 0, but for its bend
    (curve,) = found.curves
    assert set(curve.criticality) == {"supercritical", "subcritical"}
    assert (curve.criticality == "subcritical").tolist() == (curve.lyapunov > 0.0).tolist()
    for k in (0, len(curve) - 1):
        own = pp.hopf(pp.Chain(pp.Pipe(curve.x[k]), 3))
        assert curve.lyapunov[k] == pytest.approx(own.lyapunov, rel=1e-6)


def test_a_change_of_criticality_that_is_not_solved_for_is_told():
    words = "beta", "u", {"beta": (0.4, 0.7), "u": (4.0, 8.0)}
    bautin = place(pp.boundary(pp.Chain(pp.Pipe(0.2), 3), *words), "Bautin")

    class Unsure(pp.Chain):
        """A user's own model, whose forces have no derivatives near that point."""

        def motion_jacobian(self, *given):
            if abs(self.pipe.beta - bautin.x) < 1e-3:
                raise pp.NotConverged("no derivative")
            return super().motion_jacobian(*given)

    found = pp.boundary(Unsure(pp.Pipe(0.2), 3), *words)
    assert found.points == ()
    (only,) = found.failures
    assert only.startswith("a point of kind Bautin near (0.")
    assert "the criticality is not known all along the step" in only


def test_drag_decides_the_criticality_where_there_is_any():
    ranges = {"beta": (0.4, 0.7), "u": (4.0, 8.0)}
    found = pp.boundary(pp.Chain(pp.Pipe(0.2, drag=0.5), 2), "beta", "u", ranges)
    (curve,) = found.curves
    for k in (0, len(curve) - 1):
        own = pp.hopf(pp.Chain(pp.Pipe(curve.x[k], drag=0.5), 2))
        assert curve.criticality[k] == own.criticality


def test_bent_equilibria_lie_where_the_cubic_coefficient_says():
    """Near a supercritical divergence beyond it, near a subcritical one before."""
    pipe = pp.Pipe(0.2, damping=0.01)
    ranges = {"gamma": (-18.0, -7.0), "u": (0.5, 2.5)}
    found = pp.boundary(pp.Chain(pipe, 2), "gamma", "u", ranges)
    point = place(found, "degenerate pitchfork")
    (curve,) = [c for c in found.curves if c.kind == "divergence" and 0 in c.unstable]
    for word, sign in (("supercritical", 1.0), ("subcritical", -1.0)):
        k = np.flatnonzero(curve.criticality == word)[3]
        right, up = curve.slopes[k]
        # Across the curve to the side with one more unstable root, or to the other.
        across = sign * np.sign(curve.change[k]) * np.array([-up * 11.0, right * 2.0])
        for away in (1.0, -1.0):
            gamma, u = np.array([curve.x[k], curve.y[k]]) + 2e-3 * away * across
            q = pp.equilibria(pp.Chain(replace(pipe, gamma=gamma), 2), u).q
            sizes = np.abs(q).max(axis=1)
            small = np.count_nonzero((sizes > 1e-6) & (sizes < 0.3))
            assert small == (2 if away > 0.0 else 0)
    ((k, _),) = curve.organising
    near = slice(k - 2, k + 4)
    through = np.polyfit(curve.x[near] - point.x, curve.lyapunov[near], 5)
    assert abs(np.polyval(through, 0.0)) < 1e-6


def test_counts_change_along_a_curve_at_the_organising_points_that_lie_on_it():
    """In so wide a window two lie in a step. u^2 = k^2 pi^2 + s / (k^2 pi^2) is mode k's load."""
    foundation = pp.Foundation(10.0)
    pipe = pp.Pipe(0.6, damping=0.005, root="pinned", end="pinned", terms=(foundation,))
    window = {"Foundation.stiffness": (0.0, 1e7), "u": (0.1, 300.0)}
    model = pp.Galerkin(pipe, 3, "beam")
    found = pp.boundary(model, "Foundation.stiffness", "u", window, criticality=False)
    loads = (np.arange(1, 4) * np.pi) ** 2

    def others_unstable(mode, stiffness):
        """On that mode's curve of divergence, by eigenvalues."""
        soil = replace(foundation, stiffness=stiffness)
        speed = np.sqrt(loads[mode] + stiffness / loads[mode])
        values = pp.eigenvalues(model.with_pipe(replace(pipe, terms=(soil,))), speed)
        return int((np.delete(values, np.argmin(np.abs(values))).real > 1e-6).sum())

    changes = 0
    for curve in found.curves:
        steps = curve.organising[:, 0]
        assert np.unique(steps).size == steps.size
        if curve.kind != "divergence":
            continue
        np.testing.assert_array_equal(np.flatnonzero(np.diff(curve.unstable)), np.sort(steps))
        for k, i in curve.organising:
            mode = int(np.argmin(np.abs(loads + curve.x[k] / loads - curve.y[k] ** 2)))
            point = found.points[i].x
            for end in (k, k + 1):
                near = point + 0.02 * (curve.x[end] - point)
                assert others_unstable(mode, near) == curve.unstable[end]
            changes += 1
    assert changes >= 6


def test_curves_of_lost_stability_alone_are_the_same_curves():
    pipe = pp.Pipe(0.2, terms=[pp.PointMass(1.0, 0.1)])
    ranges = {"PointMass.mass": (0.0, 1.0), "u": (0.0, 9.0)}
    words = pp.Chain(pipe, 4), "PointMass.mass", "u", ranges
    every = pp.boundary(*words, criticality=False)
    some = pp.boundary(*words, criticality=False, only_stability=True)
    stable = [c for c in every.curves if 0 in c.unstable]
    assert 0 < len(stable) == len(some.curves) < len(every.curves)
    ends = [sorted([c.y[0], c.y[-1]]) for c in stable]
    assert [sorted([c.y[0], c.y[-1]]) for c in some.curves] == [
        pytest.approx(end, abs=1e-10) for end in ends
    ]


HELD = pp.Pipe(0.1, root="pinned", end="pinned", damping=0.005, terms=(pp.Foundation(10.0),))


@pytest.mark.parametrize("damping", [0.005, 0.0])
@pytest.mark.parametrize(
    "make",
    [lambda pipe: pp.Galerkin(pipe, 6, "beam"), lambda pipe: pp.Chain(pipe, 8), pp.Continuum],
    ids=["beam", "chain", "continuum"],
)
def test_buckling_modes_exchange_where_two_curves_of_divergence_cross(make, damping):
    """Modes i and j of a pinned pipe at k = (i j)^2 pi^4, u^2 = (i^2 + j^2) pi^2."""
    model = make(replace(HELD, damping=damping))
    ranges = {"Foundation.stiffness": (0.0, 1000.0), "u": (0.0, 12.0)}
    found = pp.boundary(model, "Foundation.stiffness", "u", ranges, criticality=False)
    first, second = sorted(found.points, key=lambda point: point.x)
    assert first.kind == second.kind == "double divergence"
    assert damping == 0.0 or found.failures == ()
    assert all("Bogdanov-Takens" not in c.ends for c in found.curves)
    if not isinstance(model, pp.Chain):
        assert first.x == pytest.approx(4.0 * np.pi**4, rel=1e-9)
        assert first.y == pytest.approx(np.pi * np.sqrt(5.0), rel=1e-9)
        assert second.x == pytest.approx(9.0 * np.pi**4, rel=1e-9)
        assert second.y == pytest.approx(np.pi * np.sqrt(10.0), rel=1e-9)
    if not isinstance(model, pp.Continuum):
        for point, below_zero in ((first, 0), (second, 1)):
            held = replace(model.pipe, terms=(pp.Foundation(point.x),))
            stiffness = model.with_pipe(held).operators().at(point.y)[2]
            values = np.sort(np.linalg.eigvals(stiffness).real)
            assert np.count_nonzero(values < -1e-7) == below_zero
            assert np.abs(values[below_zero : below_zero + 2]).max() < 1e-8 < values[below_zero + 2]


# ------------------------------------------------------------------- edges on which nothing damps

ASPIRATING = pp.Pipe(0.2, flow="aspirating")


@pytest.mark.parametrize(
    ("model", "top"),
    [
        (pp.Galerkin(ASPIRATING, 6), 0.1),
        (pp.Galerkin(ASPIRATING, 8, "legendre"), 0.02),
        (pp.Chain(ASPIRATING, 4), 0.02),
        (pp.Continuum(ASPIRATING), 0.02),
    ],
    ids=["modes", "legendre", "chain", "continuum"],
)
def test_curves_that_meet_where_all_roots_lie_on_the_axis_end_there_and_nothing_else(model, top):
    """Aspirating pipes lose stability at a flow in proportion to their damping."""
    ranges = {"damping": (0.0, top), "u": (0.0, 50.0 * top)}
    found = pp.boundary(model, "damping", "u", ranges)
    assert found.failures == found.points == ()
    assert {curve.kind for curve in found.curves} == {"flutter"}
    for curve in found.curves:
        assert 0.0 in (curve.x[0] + curve.y[0], curve.x[-1] + curve.y[-1])  # the corner, exactly
        assert curve.unstable[[0, -1]].tolist() == curve.unstable[[1, -2]].tolist()
    assert not isinstance(model, pp.Chain) or len(found.curves) == 4  # one for each mode
    for curve in found.curves[:3]:
        k = len(curve) // 2
        for sign in (-1.0, 1.0):
            right, up = curve.slopes[k] * [top, 50.0 * top]
            x, y = curve.x[k] - sign * 1e-4 * up / 50.0, curve.y[k] + sign * 1e-4 * right * 50.0
            there = replace(model.pipe, damping=x)
            small = pp.Galerkin(there, 16, "legendre") if isinstance(model, pp.Continuum) else None
            values = eigenvalues(small or model.with_pipe(there), y)
            near = values[np.argmin(np.abs(values - 1j * curve.frequency[k]))]
            side = curve.sides[k][0 if sign > 0.0 else 1]
            assert (near.real > 0.0) == (side > curve.unstable[k])


def test_curves_of_modes_beyond_those_that_count_agree_with_the_others():
    """Hysteresis damps all modes alike: aspirating ones beyond the sixth flutter last."""
    ranges = {"hysteresis": (0.02, 0.06), "u": (0.0, 5.0)}
    found = pp.boundary(pp.Continuum(ASPIRATING), "hysteresis", "u", ranges, criticality=False)
    assert found.failures == ()
    top = sorted(
        (c.x[k], *sorted(c.sides[k])) for c in found.curves for k in (0, -1) if c.y[k] == 5.0
    )
    for (x, low, _), (to, _, high) in pairwise(top):
        assert low == high
        lossy = replace(ASPIRATING, hysteresis=0.5 * (x + to))
        values = pp.eigenvalues(pp.Galerkin(lossy, 24, "legendre"), 5.0, 24)
        assert (values.real > 0.0).sum() == low


def test_a_curve_that_touches_the_window_in_its_corner_is_none():
    model = pp.Galerkin(pp.Pipe(0.2), 6)
    speed = pp.critical_speed(model).speed
    ranges = {"beta": (0.1, 0.2), "u": (speed, 7.0)}
    found = pp.boundary(model, "beta", "u", ranges, criticality=False)
    assert found.failures == found.curves == ()
    growing = (eigenvalues(pp.Galerkin(pp.Pipe(0.15), 6), 6.0).real > 0.0).sum()
    assert found.unstable(0.15, 6.0) == growing == 2


@pytest.mark.parametrize("gammas", [(-60.0, 60.0), (-40.0, 0.0)])
def test_where_an_undamped_pipe_buckles_without_flow_nothing_else_is_unstable(gammas):
    """gamma -7.5829 of four segments: the first of the chain's stiffness matrices' zeros."""
    chain = pp.Chain(pp.Pipe(0.2), 4)
    found = pp.boundary(chain, "gamma", "u", {"gamma": gammas, "u": (0.0, 5.0)})
    ends = [(c, k) for c in found.curves for k in (0, -1) if c.y[k] == 0.0 and c.x[k] > -20.0]
    ((curve, k),) = ends
    stiffness = chain.with_pipe(pp.Pipe(0.2, gamma=curve.x[k])).operators().at(0.0)[2]
    first, second = np.linalg.eigvalsh(stiffness)[:2]
    assert abs(first) < 1e-9 < 0.1 < second
    assert curve.unstable[k] == 0
    assert curve.criticality[k] == "supercritical"


def test_without_flow_an_undamped_pipe_buckles_whatever_its_mass_ratio():
    ranges = {"beta": (0.1, 0.9), "gamma": (-60.0, 10.0)}
    found = pp.boundary(pp.Galerkin(pp.Pipe(0.2), 6), "beta", "gamma", ranges, u=0.0)
    assert found.failures == ()
    upper, lower = sorted(found.curves, key=lambda c: -c.y[0])
    # A standing column under its own weight buckles at 7.8373 (Greenhill, 1881).
    assert upper.y == pytest.approx(-7.8373, abs=5e-4)
    assert upper.unstable.tolist() == [0] * len(upper)
    assert lower.unstable.tolist() == [1] * len(lower)


def test_curves_into_an_edge_without_flow_and_damping_say_why_they_end():
    ranges = {"inflow_share": (0.0, 1.0), "u": (0.0, 4.0)}
    found = pp.boundary(pp.Galerkin(ASPIRATING, 3), "inflow_share", "u", ranges, criticality=False)
    assert found.failures
    for sentence in found.failures:
        assert "without damping and flow, as beyond, all roots lie on the axis" in sentence


@pytest.mark.parametrize("name", ["alpha", "damping", "hysteresis"])
@pytest.mark.filterwarnings("ignore::pipedyn.UnusualPipe")
def test_numbers_from_their_lower_limit_beside_a_roots_stiffness(name):
    chain = pp.Chain(pp.Pipe(0.07, root=pp.RootSpring(3.0)), 3)
    top = {"alpha": 3.0, "damping": 2.0, "hysteresis": 0.9}[name]
    ranges = {"root.stiffness": (1.0, 400.0), name: (0.0, top)}
    found = pp.boundary(chain, "root.stiffness", name, ranges, u=5.2, criticality=False)
    assert found.failures == ()
    for curve in found.curves:
        k = len(curve) // 2
        pipe = replace(chain.pipe, root=pp.RootSpring(curve.x[k]), **{name: curve.y[k]})
        values = pp.eigenvalues(chain.with_pipe(pipe), 5.2)
        assert np.abs(values - 1j * curve.frequency[k]).min() < 1e-8
    for x, y in ((20.0, 0.1 * top), (300.0, 0.9 * top)):
        pipe = replace(chain.pipe, root=pp.RootSpring(x), **{name: y})
        assert found.unstable(x, y) == (pp.eigenvalues(chain.with_pipe(pipe), 5.2).real > 0).sum()


# ------------------------------------------------------------------------------------- refusals


@pytest.mark.parametrize(
    "make", [lambda pipe: pp.Galerkin(pipe, 8, "legendre"), pp.Continuum], ids=["legendre", "all"]
)
def test_modes_of_an_undamped_held_pipe_couple_where_its_crossings_say(make):
    """Pinned at both ends: divergences at pi and 2 pi, whatever beta, and then flutter."""
    pipe = pp.Pipe(0.5, root="pinned", end="pinned")
    ranges = {"beta": (0.05, 0.95), "u": (0.0, 7.0)}
    found = pp.boundary(make(pipe), "beta", "u", ranges, criticality=False)
    assert found.failures == ()
    statics = [c for c in found.curves if c.kind == "divergence"]
    assert sorted(float(c.y.mean()) for c in statics) == pytest.approx([np.pi, 2 * np.pi], abs=1e-6)
    (flutter,) = [c for c in found.curves if c.kind == "flutter"]
    for k in range(2, len(flutter), 5):
        there = make(replace(pipe, beta=flutter.x[k]))
        nearest = min(
            (c for c in pp.crossings(there, 7.5) if c.kind == "flutter"),
            key=lambda c: abs(c.speed - flutter.y[k]),
        )
        assert flutter.y[k] == pytest.approx(nearest.speed, abs=1e-8)
        assert flutter.frequency[k] == pytest.approx(nearest.frequency, abs=1e-5)
        assert sorted(flutter.sides[k]) == [nearest.unstable_before, nearest.unstable_after]
    for u in (6.25, 6.5):
        values = eigenvalues(pp.Galerkin(replace(pipe, beta=0.6), 12, "legendre"), u)
        assert found.unstable(0.6, u) == (values.real > 1e-6).sum()


@pytest.mark.parametrize(
    ("model", "name", "values", "top"),
    [
        (
            pp.Galerkin(pp.Pipe(0.2, root="clamped", end="clamped"), 10, "legendre"),
            "beta",
            (0.05, 0.95),
            13.0,
        ),
        (
            pp.Galerkin(pp.Pipe(0.7, root="clamped", end="pinned"), 8, "legendre"),
            "gamma",
            (-50.0, 50.0),
            10.0,
        ),
        (
            pp.Galerkin(replace(HELD, beta=0.6, damping=0.0), 8, "beam"),
            "Foundation.stiffness",
            (0.0, 1000.0),
            12.0,
        ),
    ],
    ids=["clamped", "gravity", "foundation"],
)
def test_curves_of_a_conservative_pipe_say_how_many_roots_are_unstable_anywhere(
    model, name, values, top
):
    """Gyroscopic forces make a pipe stable again beyond a divergence, until modes couple."""
    found = pp.boundary(model, name, "u", {name: values, "u": (0.0, top)}, criticality=False)
    rng = np.random.default_rng(1)
    counts = []
    for _ in range(25):
        x, y = rng.uniform(*values), rng.uniform(0.2, top)
        if name == "Foundation.stiffness":
            pipe = replace(model.pipe, terms=(pp.Foundation(x),))
        else:
            pipe = replace(model.pipe, **{name: x})
        start = int((np.linalg.eigvalsh(model.with_pipe(pipe).operators().at(0.0)[2]) < 0.0).sum())
        counts.append(int((eigenvalues(model.with_pipe(pipe), y).real > 1e-5).sum()))
        assert counts[-1] == found.unstable(x, y) == below(found, x, y, start)
    assert set(counts) >= {0, 1, 2}


def test_coupled_modes_at_a_held_speed_are_left_to_crossings():
    pipe = pp.Pipe(0.5, root="pinned", end="pinned")
    model = pp.Galerkin(pipe, 6, "legendre")
    ranges = {"beta": (0.1, 0.9), "gamma": (-5.0, 5.0)}
    (only,) = pp.boundary(model, "beta", "gamma", ranges, u=6.2, criticality=False).failures
    assert "see `crossings`" in only


CHAIN = pp.Chain(pp.Pipe(0.2, terms=[pp.Stop(0.8, 0.1, 9.0), pp.Spring(1.0, 2.0)]), 2)
WINDOW = {"beta": (0.1, 0.9), "u": (0.0, 9.0)}


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("drag", "u", {"drag": (0, 1), "u": (0, 1)}), "x must have a part in small motions"),
        (("beta", "drag", {}), "y must have a part in small motions"),
        (("mass", "u", {}), "x must be one of 'u', 'beta', 'gamma'"),
        (("Stop.gap", "u", {}), "x must be one of 'u', 'beta', 'gamma'"),
        (("beta", "beta", WINDOW), "x and y must be two numbers, got 'beta' and 'beta'"),
        (("Spring.stiffness", "terms[1].stiffness", {}), "x and y must be two numbers"),
        (("beta", "u", {"beta": (0.1, 0.9)}), "ranges must have 'beta' and 'u', got ['beta']"),
        (("beta", "u", WINDOW | {"beta": (0.0, 0.9)}), "ranges['beta'] must lie in (0, 1), got 0"),
        (("beta", "u", WINDOW | {"beta": (0.9, 0.1)}), "ranges['beta'] must be (low, high)"),
        (("beta", "u", WINDOW | {"u": (-1.0, 2.0)}), "ranges['u'] must lie in [0, "),
        (("beta", "gamma", {"beta": (0.1, 0.9), "gamma": (0, 9)}), "u must be given where neither"),
        (("beta", 3, WINDOW), "y must be one of"),
        (("beta", "u", [WINDOW]), "ranges must map x and y to (low, high), got"),
    ],
)
def test_what_no_boundary_can_be_drawn_of_is_refused_by_name(words, message):
    with pytest.raises((ValueError, TypeError)) as caught:
        pp.boundary(CHAIN, *words)
    assert str(caught.value).startswith(message)


def test_a_large_pipe_and_a_second_flow_speed_are_refused():
    with pytest.raises(ValueError, match="u must not be given where it is x or y, got 3"):
        pp.boundary(CHAIN, "beta", "u", WINDOW, u=3.0)
    with pytest.raises(ValueError, match="model must have at most 500 degrees of freedom, got 501"):
        pp.boundary(pp.Chain(pp.Pipe(0.2), 501), "beta", "u", WINDOW)
    with pytest.raises(ValueError, match=r"x must lie in \[0.1, 0.9\], got 0.05"):
        pp.boundary(CHAIN, "beta", "u", WINDOW, criticality=False).unstable(0.05, 1.0)
