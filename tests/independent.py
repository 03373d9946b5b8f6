# SPDX-License-Identifier: MIT
"""Routes to the answers that share nothing with the package's own, and what several tests need."""

from dataclasses import replace
from functools import cache, lru_cache
from itertools import pairwise

import mpmath
import numpy as np
from numpy.polynomial import chebyshev

import pipedyn as pp

leggauss = cache(np.polynomial.legendre.leggauss)


def lagrangian_equations(
    lengths,
    centres,
    radii,
    springs,
    beta,
    gamma,
    delta,
    aspirating,
    alpha,
    u,
    drag=0,
    points=None,
    inflow_share=1,
    jet_angle=0,
):
    """The paper's eqs. (1)-(9) from its Lagrangian, as a function of (q, q', q'') that vanishes.

    Written with L = EI = mu_p + mu_f = 1, so mu_f = beta, V = u / sqrt(beta), g = gamma. delta
    gives each joint a dashpot delta k_j beside its spring, which the paper does not have. A fixed
    part at the clamp shifts everything alike and changes nothing. Fluid enters with the share of
    the end's velocity, and leaves at jet_angle to the last segment: two momenta of the end's force.
    A point of the chain is given by the lengths c of the segments before it: sum_j c_j t_j.
    """
    n = len(lengths)
    length, chi, eta, k, xi = (
        exact_numbers(x) for x in (lengths, centres, radii, springs, points or [0] * n)
    )
    beta, gamma, delta, alpha, u, drag, share, angle = exact_numbers(
        (beta, gamma, delta, alpha, u, drag, inflow_share, jet_angle)
    )
    speed = u / mpmath.sqrt(beta)
    flow = (-1 if aspirating else 1) * speed
    nodes = np.array([[length[i] if i < j else 0 * u for i in range(n)] for j in range(n + 1)])
    middles = nodes[:-1] + chi[:, None] * (nodes[1:] - nodes[:-1])
    dragged = nodes[:-1] + xi[:, None] * (nodes[1:] - nodes[:-1])

    def tangents(q):
        return np.array([[mpmath.sin(x), mpmath.cos(x)] for x in q])

    def lagrangian(q, v):
        along, across = tangents(q), tangents(q + mpmath.pi / 2)
        velocities = (middles * v) @ across
        fluid = velocities + flow * along
        kinetic = (1 - beta) * (velocities**2).sum(1) + beta * (fluid**2).sum(1) + (eta * v) ** 2
        total = (length * (kinetic / 2 + gamma * (middles @ along)[:, 1])).sum()
        total -= (k * np.diff(q, prepend=0) ** 2).sum() / 2
        return total

    def loads(q, v):
        """Points and the forces on them."""
        along, across = tangents(q), tangents(q + mpmath.pi / 2)
        for c, size, normal in zip(dragged, length, across, strict=True):
            slip = ((c * v) @ across) @ normal
            yield c, -drag * size * abs(slip) * slip * normal
        end = (nodes[-1] * v) @ across
        if aspirating:
            yield nodes[-1], beta * speed * (share * end - alpha * speed * along[-1])
        else:
            yield nodes[-1], -beta * speed * (end + alpha * speed * tangents(q[-1:] + angle)[0])

    def residual(q, v, a):
        units = np.eye(n, dtype=int)

        def momentum(q, v):
            return np.array([slope(lambda w: lagrangian(q, w), v, unit) for unit in units])

        left = slope(lambda t: momentum(q + t * v, v + t * a), 0, 1)
        left -= [slope(lambda x: lagrangian(x, v), q, unit) for unit in units]
        across = tangents(q + mpmath.pi / 2)
        for c, force in loads(q, v):
            left -= c * (across @ force)
        moments = delta * k * np.diff(v, prepend=0)
        return left + moments - [*moments[1:], 0]

    return residual


def slope(f, x, direction):
    """Central difference of f at x: 40 digits, where mpmath works with 80."""
    step = mpmath.mpf(10) ** -20
    return (f(x + step * direction) - f(x - step * direction)) / (2 * step)


def exact_numbers(values):
    """Decimal numbers as they are written, in as many digits as mpmath works with."""
    return np.array([mpmath.mpf(str(x)) for x in values])


@mpmath.workdps(80)
def lagrangian_operators(*numbers, **more):
    """M, C and K of the equations above, linearised about the straight pipe, as floats."""
    residual, n = lagrangian_equations(*numbers, **more), len(numbers[0])
    columns = [
        slope(lambda x: residual(*np.split(x, 3)), 0, unit) for unit in np.eye(3 * n, dtype=int)
    ]
    stiffness, damping, mass = np.split(np.transpose(columns).astype(float), 3, axis=1)
    return mass, damping, stiffness


@mpmath.workdps(80)
def lagrangian_accelerations(states, *numbers, **more):
    """q'' of the equations above at states (2 n, k), shape (n, k)."""
    residual, n = lagrangian_equations(*numbers, **more), len(numbers[0])
    result = np.empty((n, states.shape[1]))
    for j, state in enumerate(states.T):
        q, v = np.split(np.array([mpmath.mpf(x) for x in state]), 2)
        at_rest = residual(q, v, np.zeros(n, dtype=int))
        mass = np.array([residual(q, v, unit) - at_rest for unit in np.eye(n, dtype=int)]).T
        result[:, j] = np.linalg.solve(mass.astype(float), -at_rest.astype(float))
    return result


def any_segments(n, *seed):
    """Segments of a chain with nothing equal or homogeneous, and a base, by `Chain`'s names."""
    rng = np.random.default_rng([n, *seed])
    lengths = rng.uniform(0.4, 1.6, n)
    return {
        "lengths": 0.9 * lengths / lengths.sum(),
        "springs": rng.uniform(0.5, 2.0, n) * n,
        "centres": rng.uniform(0.2, 0.8, n),
        "gyration_radii": rng.uniform(0.1, 0.5, n) / n,
        "drag_points": rng.uniform(0.0, 1.0, n),
        "base": 0.1,
    }


def any_chain(n, *seed, **pipe):
    """A chain of these, one joint without its spring."""
    segments = any_segments(n, *seed)
    segments["springs"][n // 2] = 0.0
    return pp.Chain(pp.Pipe(0.3, **pipe), **segments)


def gauss(count):
    """Gauss's nodes and weights on 0 to 1."""
    nodes, weights = leggauss(count)
    return 0.5 * (nodes + 1.0), 0.5 * weights


def panels(kinks, count=30):
    """Gauss's nodes and weights between all kinks."""
    ends = np.unique(np.clip([0.0, *kinks, 1.0], 0.0, 1.0))
    nodes, weights = leggauss(count)
    half = np.diff(ends)[:, None] / 2
    return (ends[:-1, None] + half * (1.0 + nodes)).ravel(), (half * weights).ravel()


def derivative(function, h):
    """Eighth-order central difference at 0."""
    weights = [1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280]
    return sum(c * function(k * h) for k, c in zip(range(-4, 5), weights, strict=True)) / h


def second_derivative(function, h):
    """Eighth-order central difference at 0."""
    weights = (-1 / 560, 8 / 315, -1 / 5, 8 / 5)
    sides = zip((4, 3, 2, 1), weights, strict=True)
    pairs = sum(c * (function(k * h) + function(-k * h)) for k, c in sides)
    return (pairs - 205 / 72 * function(0.0)) / h**2


def derivative_along(function, at, direction, step=0.02):
    """Derivative of a function at a point along a direction."""
    return derivative(lambda h: function(at + h * direction), step)


def second_derivative_along(function, at, direction, step=0.04):
    """Second derivative of a function at a point along a direction."""
    return second_derivative(lambda h: function(at + h * direction), step)


def places(chain, at):
    """(segment, arm, weight) of a place of a chain, or of Simpson's points all along it."""
    if at is None:
        return [
            (j, part * length, weight * length / 6.0)
            for j, length in enumerate(chain.lengths)
            for part, weight in ((0.0, 1.0), (0.5, 4.0), (1.0, 1.0))
        ]
    rest = at - chain.base
    for j, length in enumerate(chain.lengths):
        if 0.0 < rest <= (1.0 + 1e-9) * length or (rest > length and j == len(chain.lengths) - 1):
            return [(j, min(rest, length), 1.0)]
        rest -= length
    return []


@lru_cache(maxsize=8)
def _inertia(chain, digits=0):
    """Of a chain: inertia but for angles, first moments, and forces across the axis.

    The latter as (law, coefficient, lever): the places of a load move by lever @ sin(angle).
    digits: of mpmath, if any.
    """
    number = np.vectorize(mpmath.mpf, otypes=[object]) if digits else np.asarray
    n, length, radii = chain.dof, number(chain.lengths), number(chain.gyration_radii)
    beyond = length[::-1].cumsum()[::-1] - length
    arm = number(chain.centres) * length
    moment = length * (beyond + arm)
    near, far = np.minimum.outer(range(n), range(n)), np.maximum.outer(range(n), range(n))
    coupling = length[near] * moment[far]
    own = length**2 * beyond + length * (arm**2 + radii**2)
    np.fill_diagonal(coupling, own)
    forces = []
    for term in chain.pipe.terms:
        number, *_ = term.numbers.values()
        for j, at, weight in places(chain, term.place):
            lever = np.where(np.arange(n) < j, length, 0.0)
            lever[j] = at
            if term.law == "point_mass":
                coupling += number * np.outer(lever, lever)
                coupling[j, j] += term.inertia
                moment = moment + number * lever
            else:
                share = 1.0 if term.law == "damper" else weight
                forces.append((term.law, share * number, lever))
    return coupling, moment, forces


def dense_rates(chain, y, u, digits=0):
    """dy/dt of a chain by the equations of motion in the angles, with a dense mass matrix.

    y may be complex, its imaginary part small. The terms of the pipe act by the displacement of
    their place, lever @ sin(angle), a load per length by Simpson's rule on each segment. With
    digits, the same in mpmath.
    """
    sin, cos, sqrt, number = np.sin, np.cos, np.sqrt, np.asarray
    if digits:
        sin, cos = (np.frompyfunc(of, 1, 1) for of in (mpmath.sin, mpmath.cos))
        sqrt, number = mpmath.sqrt, np.vectorize(mpmath.mpmathify, otypes=[object])
    pipe, n, y, u = chain.pipe, chain.dof, number(y), number(u)[()]
    length, springs, points = map(number, (chain.lengths, chain.springs, chain.drag_points))
    signed, thrust = -u if pipe.flow == "aspirating" else u, pipe.alpha * u**2
    angle, rate = y[:n], y[n:]
    coupling, moment, levers = _inertia(chain, digits)
    across_axis = np.zeros(n, dtype=y.dtype)
    for law, size, lever in levers:
        if law == "damper":
            across_axis += size * (lever @ (rate * cos(angle))) * lever
        else:
            across_axis += size * (lever @ sin(angle)) * lever
    between = angle[:, None] - angle
    elastic = springs * (np.diff(angle, prepend=0.0) + pipe.damping * np.diff(rate, prepend=0.0))
    momentum = np.triu(np.outer(length, length) * cos(between), 1) @ rate
    force = coupling * sin(between) @ rate**2
    force += sqrt(pipe.beta) * signed * (length**2 * rate + 2.0 * momentum)
    end = np.array([length @ (rate * cos(angle)), -length @ (rate * sin(angle))])
    missing = sqrt(pipe.beta) * signed * (1.0 - pipe.inflow_share) * end
    force -= length * (missing[0] * cos(angle) - missing[1] * sin(angle))
    jet = angle[-1] + pipe.jet_angle
    force += thrust * length * sin(jet - angle) + pipe.gamma * moment * sin(angle)
    force += elastic - np.append(elastic[1:], 0.0) + across_axis * cos(angle)
    # Row j of lever: velocity of drag point j across its segment due to each rate.
    lever = np.tril(cos(between) * length, -1) + np.diag(points * length)
    across = lever @ rate
    force += lever.T @ (pipe.drag * length * np.sign(across.real) * across**2)
    mass = coupling * cos(between)
    if digits:
        return np.concatenate([rate, list(mpmath.lu_solve(*map(mpmath.matrix, (mass, -force))))])
    return np.concatenate([rate, np.linalg.solve(mass, -force)])


def exact_rates(chain, y, u, digits=60):
    """The above in mpmath, in so many digits."""
    with mpmath.workdps(digits):
        return dense_rates(chain, y, u, digits)


def dense_jacobian(chain, y, u):
    """Derivative of the above by complex steps, which lose no digits."""
    step = 1e-30
    columns = [dense_rates(chain, y + 1j * step * unit, u).imag / step for unit in np.eye(y.size)]
    return np.stack(columns, axis=1)


@lru_cache(maxsize=8)
def _collocation(size):
    """Values at Gauss points s of w, w', w'' and w'''' when w'''' is a Chebyshev polynomial."""
    x = np.cos(np.pi * (np.arange(size) + 0.5) / size)
    tables = []
    for k in range(size):
        fourth = np.zeros(k + 1)
        fourth[k] = 1.0
        third = chebyshev.chebint(fourth, lbnd=1.0, scl=0.5)
        second = chebyshev.chebint(third, lbnd=1.0, scl=0.5)
        first = chebyshev.chebint(second, lbnd=-1.0, scl=0.5)
        value = chebyshev.chebint(first, lbnd=-1.0, scl=0.5)
        tables.append([chebyshev.chebval(x, c) for c in (value, first, second, fourth)])
    return 0.5 * (x + 1.0), *np.transpose(tables, (1, 2, 0))


def collocation_matrices(pipe, u, size=40):
    """Mass, damping and stiffness of the strong form of the continuous pipe's equation.

    Chebyshev collocation of w''''; the four boundary conditions are met exactly.
    """
    s, value, first, second, fourth = _collocation(size)
    aspirating = pipe.flow == "aspirating"
    thrust = (pipe.alpha) * u**2
    tension = thrust - pipe.gamma * (1.0 - s)
    stiffness = fourth + tension[:, None] * second + pipe.gamma * first
    damping = 2.0 * np.sqrt(pipe.beta) * (-u if aspirating else u) * first + pipe.damping * fourth
    return value, damping, stiffness


def collocation_eigenvalues(pipe, u, size=40):
    """Eigenvalues of the strong form, lowest first."""
    return quadratic_eigenvalues(*collocation_matrices(pipe, u, size))


def quadratic_eigenvalues(mass, damping, stiffness):
    """All eigenvalues of lambda^2 M + lambda C + K by the dense inverse problem, lowest first."""
    n = len(mass)
    step = np.zeros((2 * n, 2 * n))
    step[:n] = -np.linalg.solve(stiffness, np.hstack([damping, mass]))
    step[n:, :n] = np.eye(n)
    mu = np.linalg.eigvals(step)
    values = 1.0 / mu[np.abs(mu) > 1e-300]
    return values[np.argsort(np.abs(values), kind="stable")]


def companion_eigenvalues(mass, damping, stiffness):
    """All eigenvalues by the textbook companion matrix of M^-1 C and M^-1 K."""
    n = len(mass)
    companion = np.zeros((2 * n, 2 * n), dtype=np.result_type(mass, damping, stiffness, 0.0))
    companion[:n, n:] = np.eye(n)
    companion[n:, :n] = -np.linalg.solve(mass, stiffness)
    companion[n:, n:] = -np.linalg.solve(mass, damping)
    return np.linalg.eigvals(companion)


def unstable_count(model, u, threshold=1e-7):
    """Number of eigenvalues of a small model with a positive real part, from its matrices."""
    return int(np.sum(companion_eigenvalues(*model.operators().at(u)).real > threshold))


def worst(found, exact):
    """Largest error relative to the largest entry."""
    return np.abs(found - exact).max() / np.abs(exact).max()


def distances(found, reference):
    """Distance of each value found to the nearest of the reference, relative to its size or 1."""
    found, reference = np.asarray(found), np.asarray(reference)
    nearest = np.abs(found[:, None] - reference[None, :]).min(axis=1)
    return nearest / np.maximum(np.abs(found), 1.0)


def exact_jacobian(chain, y, u, digits=80):
    """Derivative of the above by differences in as many digits."""
    with mpmath.workdps(digits):
        step, y = mpmath.mpf(10) ** (-digits // 3), [mpmath.mpf(x) for x in y]
        here, columns = exact_rates(chain, y, u, digits), []
        for k in range(len(y)):
            there = exact_rates(chain, [x + step * (i == k) for i, x in enumerate(y)], u, digits)
            columns.append([float((b - a) / step) for a, b in zip(here, there, strict=True)])
        return np.transpose(columns)


@cache
def integrals_from_the_clamp(nodes):
    """Gauss's nodes, weights on 0 to 1, and what integrates up to each of these, (nodes, nodes)."""
    x, weights = leggauss(nodes)
    s, weights = 0.5 * (1.0 + x), 0.5 * weights
    table = np.polynomial.legendre.legvander(x, nodes)
    degrees = np.arange(nodes)
    series = (2.0 * degrees[:, None] + 1.0) * table[:, :-1].T * weights
    upward = table[:, 1:] - np.concatenate([-np.ones((nodes, 1)), table[:, :-2]], axis=1)
    return s, weights, upward / (2.0 * (2.0 * degrees + 1.0)) @ series


def pipe_rates(model, y, u, nodes=400):
    """dy/dt of a reduced model by virtual work, integrals by one fine Gauss rule.

    What is integrated from the clamp to s is the integral of its Legendre series.
    """
    pipe, m = model.pipe, model.dof
    s, weights, from_clamp = integrals_from_the_clamp(nodes)
    slope, bend = model.functions(s, 1), model.functions(s, 2)
    angle, turning = slope @ y[:m], slope @ y[m:]
    tangent = np.array([np.sin(angle), np.cos(angle)])
    normal = np.array([np.cos(angle), -np.sin(angle)])
    moved = from_clamp @ (normal[:, :, None] * slope)
    swung = from_clamp @ (tangent * turning**2)[:, :, None]
    flow, thrust = -u if pipe.flow == "aspirating" else u, pipe.alpha * u**2
    across = np.sum(normal * np.einsum("dsm,m->ds", moved, y[m:]), axis=0)
    load = -(2.0 * np.sqrt(pipe.beta) * flow * turning + pipe.drag * np.abs(across) * across)
    body = load * normal + swung[:, :, 0] + np.array([[0.0], [pipe.gamma]])
    force = np.einsum("s,ds,dsm->m", weights, body, moved)
    force -= (weights * (bend @ (y[:m] + pipe.damping * y[m:]))) @ bend
    end = model.functions([1.0], 1)[0] @ y[:m] + pipe.jet_angle
    swept = weights @ (normal[:, :, None] * slope)
    force -= thrust * np.array([np.sin(end), np.cos(end)]) @ swept
    missing = (1.0 - pipe.inflow_share) * swept @ y[m:]
    force += np.sqrt(pipe.beta) * flow * missing @ swept
    mass = np.einsum("s,dsi,dsj->ij", weights, moved, moved)
    return np.concatenate([y[m:], np.linalg.solve(mass, force)])


def legendre_highest(m, digits=60, rounds=40):
    """Highest frequency of m Legendre functions, gamma = u = 0, by inverse iteration in mpmath.

    The elastic stiffness is the identity; an integral of P_i is (P_(i+1) - P_(i-1)) / (2 i + 1),
    so the mass matrix has nine diagonals.
    """

    def integral(polynomial):
        result = {}
        for i, c in polynomial.items():
            part = c / (2 * (2 * i + 1))
            result[i + 1] = result.get(i + 1, 0) + part
            low, sign = (i - 1, -1) if i else (0, 1)
            result[low] = result.get(low, 0) + sign * part
        return result

    with mpmath.workdps(digits):
        functions = [integral(integral({i: mpmath.sqrt(2 * i + 1)})) for i in range(m)]
        near = [range(max(0, i - 4), i) for i in range(m)]
        lower, pivots = {}, []
        for i, one in enumerate(functions):
            for j in [*near[i], i]:
                other = functions[j]
                entry = sum(c * other[k] / (2 * k + 1) for k, c in one.items() if k in other)
                taken = [k for k in near[i] if k < j and (j, k) in lower]
                entry -= sum(lower[i, k] * lower[j, k] * pivots[k] for k in taken)
                if j < i:
                    lower[i, j] = entry / pivots[j]
            pivots.append(entry)
        x = [mpmath.mpf((-1) ** i * (i + 1)) for i in range(m)]
        for _ in range(rounds):
            size = mpmath.sqrt(mpmath.fdot(x, x))
            x = [a / size for a in x]
            y = list(x)
            for i in range(m):
                y[i] -= sum(lower[i, k] * y[k] for k in near[i])
            y = [a / p for a, p in zip(y, pivots, strict=True)]
            for i in reversed(range(m)):
                y[i] -= sum(lower[k, i] * y[k] for k in range(i + 1, min(m, i + 5)))
            square, x = mpmath.fdot(x, y), y
        return float(mpmath.sqrt(square))


def beck_speed(digits=30):
    """Critical speed of the pipe without fluid mass, a column under a follower force.

    Where its frequency equation, with P = u^2, has a double root: P^2 + 2 w^2 (1 + cosh a cos b)
    + P w sinh a sin b = 0, a^2 and b^2 being -+P / 2 + sqrt(P^2 / 4 + w^2) (Beck 1952).
    """
    with mpmath.workdps(digits):

        def misfit(load, w):
            root = mpmath.sqrt(load**2 / 4 + w**2)
            a, b = mpmath.sqrt(root - load / 2), mpmath.sqrt(root + load / 2)
            coupled = 2 * w**2 * (1 + mpmath.cosh(a) * mpmath.cos(b))
            return load**2 + coupled + load * w * mpmath.sinh(a) * mpmath.sin(b)

        load, _ = mpmath.findroot(
            lambda p, w: (misfit(p, w), mpmath.diff(lambda x: misfit(p, x), w)), (20, 11)
        )
        return float(mpmath.sqrt(load))


def series_crossing(pipe, u, omega, digits=60):
    """(u, omega) where an eigenvalue of the continuous pipe lies on the axis, by the series below.

    omega 0 asks for a divergence.
    """
    tolerance = mpmath.mpf(10) ** (-digits // 2)
    with mpmath.workdps(digits):
        if omega == 0.0:
            speed = mpmath.findroot(
                lambda x: series_misfit(pipe, 0, x, digits).real,
                (mpmath.mpf(u) * (1 - 1e-9), mpmath.mpf(u) * (1 + 1e-9)),
                *("secant", tolerance),
                verify=False,
            )
            return float(speed), 0.0

        def parts(speed, frequency):
            misfit = series_misfit(pipe, 1j * frequency, speed, digits)
            return misfit.real, misfit.imag

        guess = mpmath.mpf(u), mpmath.mpf(omega)
        speed, frequency = mpmath.findroot(parts, guess, tol=tolerance, verify=False)
        return float(speed), float(frequency)


def chain_newton_step(chain, value, u, digits=30):
    """Newton's correction of an eigenvalue of a chain, by shooting from its free end in mpmath.

    From any angle and displacement of the free end, the moments about the joints give one segment
    after another; an eigenvalue lets a combination of two such shapes meet the clamp.
    """
    with mpmath.workdps(digits):
        value = mpmath.mpmathify(complex(value))
        step = (value or 1) * mpmath.mpf(10) ** -(digits // 3)
        here = clamp_misfit(chain, value, u)
        there = clamp_misfit(chain, value + step, u)
        return complex(-here * step / (there - here))


def chain_crossing(chain, u, omega, digits=30):
    """(u, omega) where an eigenvalue i omega of a chain lies on the axis, by shooting in mpmath."""
    with mpmath.workdps(digits):

        def misfit(speed, frequency):
            value = clamp_misfit(chain, 1j * frequency, speed)
            return value.real, value.imag

        guess = mpmath.mpf(u), mpmath.mpf(omega)
        u, omega = mpmath.findroot(misfit, guess, tol=mpmath.mpf(10) ** (-2 * digits // 3))
        return u, omega


def clamp_misfit(chain, value, u):
    """Zero where lambda is an eigenvalue."""
    pipe = chain.pipe
    aspirating = pipe.flow == "aspirating"
    thrust = mpmath.mpf(pipe.alpha) * u**2
    coriolis = mpmath.sqrt(pipe.beta) * (-u if aspirating else u) * value
    elastic = 1 + pipe.damping * value + mpmath.mpc(0, pipe.hysteresis)
    square = value**2
    placed = [(term, spot) for term in pipe.terms for spot in places(chain, term.place)]
    ends = ((1, 0), (0, 1))  # angle and place of the free end
    # Of both, from there on: angle and place of a joint, force and moment there.
    columns = [[mpmath.mpc(x) for x in (*end, 0, 0)] for end in ends]
    beyond = mpmath.mpf(0)  # mass
    for k in reversed(range(chain.dof)):
        length, stiffness = mpmath.mpf(chain.lengths[k]), elastic * mpmath.mpf(chain.springs[k])
        arm = mpmath.mpf(chain.centres[k]) * length
        heavy, following, dragged = square * length, thrust * length, 2 * coriolis * length
        turned = heavy * mpmath.mpf(chain.gyration_radii[k]) ** 2 - following
        turned += length * (coriolis * length + pipe.gamma * (beyond + arm))
        beyond += length
        loads = [(arm, heavy)]
        for term, (j, at, weight) in placed:
            if j != k:
                continue
            number, *_ = term.numbers.values()
            factor = {"point_mass": square, "damper": value}.get(term.law, weight)
            loads.append((at, factor * number))
            if term.law == "point_mass":
                turned += pipe.gamma * number * at + square * term.inertia
                beyond += number
        for (tip_angle, tip), column in zip(ends, columns, strict=True):
            angle, node, force, moment = column
            clamped_side = node - length * angle
            moment -= length * force + turned * angle + dragged * (tip - node)
            moment -= following * tip_angle
            for at, load in loads:
                pull = load * (clamped_side + at * angle)
                moment, force = moment - at * pull, force + pull
            column[:] = angle - moment / stiffness, clamped_side, force, moment
    (a, b, *_), (c, d, *_) = columns
    return a * d - b * c


def series_misfit(pipe, value, u, digits):
    """Zero where lambda is an eigenvalue of the continuous pipe, in mpmath."""
    with mpmath.workdps(digits):
        rows, _ = _conditions(pipe, value, u)
        return mpmath.det(mpmath.matrix([row[1:] for row in rows]))


def series_response(pipe, omega, u, load="base", output=1.0, digits=40):
    """Displacement at an arc length per unit of a harmonic load, counted from a moving base.

    load: "base", or "force" or "moment" with its place.
    """
    with mpmath.workdps(digits):
        rows, seen = _conditions(pipe, 1j * mpmath.mpf(omega), u, load, output)
        free = mpmath.matrix([row[1:] for row in rows])
        parts = mpmath.lu_solve(free, mpmath.matrix([-row[0] for row in rows]))
        moved = seen[0] + sum(a * b for a, b in zip(parts, seen[1:], strict=False))
        return complex(moved) - (load == "base")


def _conditions(pipe, value, u, load=None, output=1.0):
    """Conditions at supports and at the end, and the displacement of a place, of each solution.

    The first solution is that of the load, the others begin with what the root leaves free and
    with the reactions of supports. Between places where something acts,

        (1 + delta lambda + i mu) w'''' = (T w')' + (J lambda^2 - alpha u^2) w''
            - 2 sqrt(beta) s u lambda w' - (lambda^2 (1 + chi) + sigma lambda + k) w.

    T, the weight and loads beyond, is linear in s, so that w = sum a_k (s - s_0)^k converges
    everywhere. Its terms cancel: digits must exceed what they lose. Sums are of integers, numbers
    times 2^bits, ten times as fast as mpmath's. At a place w'' grows by the couple and w''' falls
    by the load; a support's reaction is one more unknown, and its place one more equation.
    """
    aspirating = pipe.flow == "aspirating"
    bits = mpmath.mp.prec + 64

    def fixed(number):
        number = mpmath.mpmathify(number)
        return [int(mpmath.ldexp(part, bits)) for part in (number.real, number.imag)]

    def along(law):
        return sum(sum(t.numbers.values()) for t in pipe.terms if t.law == law)

    def total(here, name):
        return sum(mpmath.mpf(t.numbers.get(name, 0.0)) for t in here)

    value, u = mpmath.mpmathify(value), mpmath.mpf(u)
    elastic = 1 + mpmath.mpf(pipe.damping) * value + mpmath.mpc(0, pipe.hysteresis)
    coriolis = 2 * mpmath.sqrt(mpmath.mpf(pipe.beta)) * (-u if aspirating else u) * value
    inertia = mpmath.mpf(pipe.rotary_inertia) * value**2
    gamma, thrust = mpmath.mpf(pipe.gamma), mpmath.mpf(pipe.alpha) * u**2
    square = value**2 * (1 + along("added_mass")) + value * along("viscosity")
    square += along("foundation")
    laws = ("point_mass", "dead_load", "spring", "damper", "rotational_spring")
    placed = [t for t in pipe.terms if t.law in (*laws, "rotational_damper")]
    base = load == "base"
    loaded = {} if base or load is None else {load[1]: load[0]}
    places = 0.0, 1.0, output, *loaded, *pipe.supports, *(t.place for t in placed)
    root, rows = pipe.root_stiffness, []
    turned = [0, 0, 1, 0] if root == mpmath.inf else [0, 1, root / elastic, 0]
    starts = [base, 0, 0, 0], turned, [0, 0, 0, 1]
    columns = [[mpmath.mpc(x) for x in one] for one in starts]
    for low, high in pairwise(sorted(set(places))):
        beyond = [t for t in placed if t.place > low]
        tension = gamma * (1 - mpmath.mpf(low) + total(beyond, "mass"))
        tension += total(beyond, "load") + total(beyond, "force_y")
        h = mpmath.mpf(high) - mpmath.mpf(low)
        bend = fixed((tension + inertia - thrust) * h**2 / elastic)
        loads = (one / elastic for one in (gamma * h**3, coriolis * h**3, square * h**4))
        parts = bend, *map(fixed, loads)
        columns = [_along_span(column, h, parts, fixed, bits) for column in columns]
        here = [t for t in placed if t.place == high]
        mass, turning = total(here, "mass"), total(here, "inertia") * value**2
        held = mass * value**2
        for t in here:
            number = total([t], "stiffness") + value * total([t], "coefficient")
            if t.law.startswith("rotational"):
                turning += number
            else:
                held += number
        lost = gamma * mass + total(here, "load") + total(here, "force_y")
        if high == 1.0:
            lost += inertia
            held -= (1 - mpmath.mpf(pipe.inflow_share)) * coriolis / 2
        for column in columns:
            w, slope = column[:2]
            column[2] += turning * slope / elastic
            column[3] -= (held * w + lost * slope) / elastic
        if high in loaded:
            columns[0][2] -= (loaded[high] == "moment") / elastic
            columns[0][3] += (loaded[high] == "force") / elastic
        if high == output:
            seen = [w for w, *_ in columns]
        if high in pipe.supports:
            rows.append([w - base * (i == 0) for i, (w, *_) in enumerate(columns)])
            columns.append([mpmath.mpc(x) for x in (0, 0, 0, 1)])
    kept = {"free": (2, 3), "guided": (1, 3), "pinned": (0, 2), "clamped": (0, 1)}[pipe.end]
    for k in kept:
        rows.append([column[k] for column in columns])
        rows[-1][0] -= base and k == 0
    return [[*row, *[0] * (len(columns) - len(row))] for row in rows], seen


def _along_span(column, h, parts, fixed, bits):
    """Values of w, w', w'' and w''' at the end of a span of length h from those at its beginning.

    With b_k = a_k h^k, (k + 1) ... (k + 4) b_(k+4) is (k + 1) (k + 2) bend b_(k+2) - (k + 1)
    ((k + 1) weight + coriolis) b_(k+1) - square b_k.
    """
    (bend, bend_i), (weight, weight_i), (coriolis, coriolis_i), (square, square_i) = parts
    scaled = (x * h**k / mpmath.factorial(k) for k, x in enumerate(column))
    (a, a_i), (b, b_i), (c, c_i), (d, d_i) = map(fixed, scaled)
    sums = [[a + b + c + d, a_i + b_i + c_i + d_i], [b + 2 * c + 3 * d, b_i + 2 * c_i + 3 * d_i]]
    sums += [[2 * c + 6 * d, 2 * c_i + 6 * d_i], [6 * d, 6 * d_i]]
    k = quiet = 0
    while quiet < 8:
        p, p_i = weight * (k + 1) + coriolis, weight_i * (k + 1) + coriolis_i
        q, q_i = bend * (k + 2), bend_i * (k + 2)
        below = ((k + 2) * (k + 3) * (k + 4)) << bits
        e = q * c - q_i * c_i - p * b + p_i * b_i
        e_i = q * c_i + q_i * c - p * b_i - p_i * b
        e = (e - (square * a - square_i * a_i) // (k + 1)) // below
        e_i = (e_i - (square * a_i + square_i * a) // (k + 1)) // below
        a, a_i, b, b_i, c, c_i, d, d_i = b, b_i, c, c_i, d, d_i, e, e_i
        k += 1
        factor = 1
        for order, one in enumerate(sums):
            one[0], one[1] = one[0] + factor * d, one[1] + factor * d_i
            factor *= k + 3 - order
        quiet = quiet + 1 if abs(d) + abs(d_i) <= 2 else 0  # -1 is rounded too
    unit = mpmath.mpf(2) ** bits
    return [mpmath.mpc(*one) / (unit * h**n) for n, one in enumerate(sums)]


def series_newton_step(pipe, value, u, digits=60):
    """Newton's correction of an eigenvalue of the continuous pipe by the series above."""
    with mpmath.workdps(digits):
        value, step = mpmath.mpmathify(complex(value)), mpmath.mpf(10) ** -(digits // 3)
        here = series_misfit(pipe, value, u, digits)
        there = series_misfit(pipe, value * (1 + step), u, digits)
        return complex(-here * value * step / (there - here))


def tells_its_distance(found, start, exact):
    """Asserts that `discretisation` bounds the distance to the continuum, and is ten times it at
    most where that is more than the solvers' own errors; returns whether it is.

    found, start: critical speeds of a model and of the continuous pipe; exact: the true one.
    """
    distance = abs(found.speed - exact)
    # A few units in the last place of the speed are lost where the reference is rounded.
    assert distance <= found.discretisation + 4e-16 * exact
    if distance <= found.error + start.error:
        return False
    assert found.discretisation <= 10.0 * distance
    return True


def assert_differences(by, find, pipe, steps, rel=1e-5, least=0.0):
    """Asserts that sensitivities of a crossing are differences of its speed and frequency.

    by: the sensitivities; find: finds the crossing of a pipe; steps: of the pipe's numbers, by
    name; rel, least: the relative error allowed, and the absolute one.
    """
    for name, step in steps.items():
        ahead, behind = (
            find(replace(pipe, **{name: getattr(pipe, name) + h})) for h in (step, -step)
        )
        for quantity in ("speed", "frequency"):
            slope = (getattr(ahead, quantity) - getattr(behind, quantity)) / (2.0 * step)
            off = getattr(getattr(by, quantity), name) - slope
            assert abs(off) <= max(rel * abs(slope), least), (name, quantity)


def bent_state(model, rng, angle, speed=14.0, falling=2):
    """A random state whose largest angle and rate are given, coefficients like i^-falling."""
    m = model.dof
    slopes = model.functions(np.linspace(0.0, 1.0, 200), 1)
    fall = np.abs(slopes).max(axis=0) * np.arange(1.0, m + 1.0) ** falling
    q, rate = rng.normal(size=(2, m)) / fall
    q *= angle / np.abs(slopes @ q).max()
    rate *= speed * angle / np.abs(slopes @ rate).max()
    return np.concatenate([q, rate])
