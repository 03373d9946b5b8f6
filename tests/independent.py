# SPDX-License-Identifier: MIT
"""Routes to the answers that share nothing with the package's own."""

from functools import lru_cache

import mpmath
import numpy as np
import sympy
from numpy.polynomial import chebyshev


def lagrangian_equations(
    lengths, centers, radii, springs, beta, gamma, delta, aspirating, alpha, u, drag=0, points=None
):
    """The paper's eqs. (1)-(9) from its Lagrangian, as expressions that vanish, and (q, q', q'').

    Written with L = EI = mu_p + mu_f = 1, so mu_f = beta, V = u / sqrt(beta), g = gamma. delta
    gives each joint a dashpot delta k_j beside its spring, which the paper does not have. A fixed
    part at the clamp shifts everything alike and changes nothing.
    """
    n = len(lengths)
    q, v, a = (sympy.symbols(f"{letter}1:{n + 1}") for letter in "qva")
    length, chi, eta, k, xi = (
        [sympy.Rational(str(x)) for x in numbers]
        for numbers in (lengths, centers, radii, springs, points or [0] * n)
    )
    beta, gamma, delta, alpha, u, drag = (
        sympy.Rational(str(x)) for x in (beta, gamma, delta, alpha, u, drag)
    )
    speed = u / sympy.sqrt(beta)
    sign = -1 if aspirating else 1

    def rate(expression):
        return sum(sympy.diff(expression, x) * dx for x, dx in zip(q, v, strict=True))

    tangents = [sympy.Matrix([sympy.sin(x), sympy.cos(x)]) for x in q]
    nodes = [sympy.zeros(2, 1)]
    for j in range(n):
        nodes.append(nodes[-1] + length[j] * tangents[j])
    lagrangian = 0
    forces = []
    for j in range(n):
        velocity = ((1 - chi[j]) * nodes[j] + chi[j] * nodes[j + 1]).applyfunc(rate)
        fluid = velocity + sign * speed * tangents[j]
        height = (1 - chi[j]) * nodes[j][1] + chi[j] * nodes[j + 1][1]
        kinetic = (1 - beta) * velocity.dot(velocity) + beta * fluid.dot(fluid)
        kinetic += eta[j] ** 2 * v[j] ** 2
        turn = q[j] - (q[j - 1] if j else 0)
        lagrangian += length[j] * (kinetic + 2 * gamma * height) / 2 - k[j] * turn**2 / 2
        if drag:
            where = (1 - xi[j]) * nodes[j] + xi[j] * nodes[j + 1]
            normal = sympy.Matrix([sympy.cos(q[j]), -sympy.sin(q[j])])
            across = where.applyfunc(rate).dot(normal)
            forces.append((where, -drag * length[j] * sympy.Abs(across) * across * normal))
    end = nodes[-1].applyfunc(rate)
    if aspirating:
        force = beta * speed * (end - alpha * speed * tangents[-1])
    else:
        force = -beta * speed * (end + speed * tangents[-1])
    forces.append((nodes[-1], force))
    dissipation = sum(delta * k[j] * (v[j] - (v[j - 1] if j else 0)) ** 2 / 2 for j in range(n))

    equations = []
    for row in range(n):
        momentum = sympy.diff(lagrangian, v[row])
        equation = rate(momentum) - sympy.diff(lagrangian, q[row])
        equation += sum(sympy.diff(momentum, x) * dx for x, dx in zip(v, a, strict=True))
        equation -= sum(force.dot(sympy.diff(where, q[row])) for where, force in forces)
        equations.append(equation + sympy.diff(dissipation, v[row]))
    return equations, q, v, a


def lagrangian_operators(*numbers, **more):
    """M, C and K of the equations above, linearised about the straight pipe, as floats."""
    equations, q, v, a = lagrangian_equations(*numbers, **more)
    rest = dict.fromkeys([*q, *v, *a], 0)
    operators = (np.empty((len(q), len(q))) for _ in range(3))
    mass, damping, stiffness = operators
    for row, equation in enumerate(equations):
        for column in range(len(q)):
            mass[row, column] = sympy.diff(equation, a[column]).subs(rest)
            damping[row, column] = sympy.diff(equation, v[column]).subs(rest)
            stiffness[row, column] = sympy.diff(equation, q[column]).subs(rest)
    return mass, damping, stiffness


def lagrangian_accelerations(states, *numbers, **more):
    """q'' of the equations above at states (2 n, k), shape (n, k)."""
    equations, q, v, a = lagrangian_equations(*numbers, **more)
    residual = sympy.lambdify([*q, *v, *a], equations, cse=True)
    n = len(q)
    result = np.empty((n, states.shape[1]))
    for j, state in enumerate(states.T):
        still = np.array(residual(*state, *np.zeros(n)))
        mass = np.array([residual(*state, *unit) for unit in np.eye(n)]).T - still[:, None]
        result[:, j] = np.linalg.solve(mass, -still)
    return result


def dense_rates(chain, y, u):
    """dy/dt of a chain by the equations of motion in the angles, with a dense mass matrix.

    y may be complex, its imaginary part small.
    """
    pipe, n = chain.pipe, chain.dof
    length, springs, points = chain.lengths, chain.springs, chain.drag_points
    signed, thrust = u, u**2
    if pipe.flow == "aspirating":
        signed, thrust = -u, pipe.alpha * u**2
    angle, rate = y[:n], y[n:]
    beyond = length[::-1].cumsum()[::-1] - length
    arm = chain.centers * length
    moment = length * (beyond + arm)
    near, far = np.minimum.outer(range(n), range(n)), np.maximum.outer(range(n), range(n))
    coupling = length[near] * moment[far]
    own = length**2 * beyond + length * (arm**2 + chain.gyration_radii**2)
    np.fill_diagonal(coupling, own)
    between = angle[:, None] - angle
    elastic = springs * (np.diff(angle, prepend=0.0) + pipe.damping * np.diff(rate, prepend=0.0))
    momentum = np.triu(np.outer(length, length) * np.cos(between), 1) @ rate
    force = coupling * np.sin(between) @ rate**2
    force += np.sqrt(pipe.beta) * signed * (length**2 * rate + 2.0 * momentum)
    force += thrust * length * np.sin(angle[-1] - angle) + pipe.gamma * moment * np.sin(angle)
    force += elastic - np.append(elastic[1:], 0.0)
    # Row j of lever: velocity of drag point j across its segment due to each rate.
    lever = np.tril(np.cos(between) * length, -1) + np.diag(points * length)
    across = lever @ rate
    force += lever.T @ (pipe.drag * length * np.sign(across.real) * across**2)
    return np.concatenate([rate, np.linalg.solve(coupling * np.cos(between), -force)])


def dense_jacobian(chain, y, u):
    """Derivative of the above by complex steps, which lose no digits."""
    step = 1e-30
    columns = [dense_rates(chain, y + 1j * step * unit, u).imag / step for unit in np.eye(y.size)]
    return np.stack(columns, axis=1)


def determinant(value, u, beta, *, centrifugal=1.0, direction=1.0, damping=0.0):
    """Determinant of the four exponentials of the continuous pipe without gravity, in mpmath.

    With w = exp(a s + lambda tau), (1 + delta lambda) a^4 + c u^2 a^2 + 2 sqrt(beta) s u lambda a
    + lambda^2 = 0; rows: w and w' at the clamp, w'' and w''' at the free end. Divided by the
    Vandermonde determinant, so that it does not vanish where two exponents meet.
    """
    value, u, beta = mpmath.mpmathify(value), mpmath.mpmathify(u), mpmath.mpmathify(beta)
    thrust = mpmath.mpmathify(centrifugal) * u**2
    coriolis = 2 * mpmath.sqrt(beta) * direction * u * value
    elastic = 1 + damping * value
    polynomial = [elastic, 0, thrust, coriolis, value**2]
    a = mpmath.polyroots(polynomial, maxsteps=200, extraprec=60)
    largest = max(x.real for x in a)
    rows = [
        [mpmath.mpf(1)] * 4,
        list(a),
        [x**2 * mpmath.exp(x - largest) for x in a],
        [x**3 * mpmath.exp(x - largest) for x in a],
    ]
    meeting = mpmath.mpf(1)
    for i in range(4):
        for j in range(i):
            meeting *= a[i] - a[j]
    return mpmath.det(mpmath.matrix(rows)) / meeting


def determinant_crossing(beta, u, omega, digits=25, **more):
    """(u, omega) where an eigenvalue i omega lies on the axis, from a guess of both."""
    with mpmath.workdps(digits):

        def parts(speed, frequency):
            value = determinant(1j * frequency, speed, beta, **more)
            return value.real, value.imag

        u, omega = mpmath.findroot(parts, (mpmath.mpf(u), mpmath.mpf(omega)), tol=1e-30)
        return float(u), float(omega)


def determinant_eigenvalue(guess, u, beta, digits=25, **more):
    """The eigenvalue nearest to a guess."""
    with mpmath.workdps(digits):
        return complex(
            mpmath.findroot(
                lambda value: determinant(value, u, beta, **more),
                mpmath.mpmathify(guess),
                tol=1e-35,
            )
        )


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
    thrust = (pipe.alpha if aspirating else 1.0) * u**2
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
    companion = np.zeros((2 * n, 2 * n))
    companion[:n, n:] = np.eye(n)
    companion[n:, :n] = -np.linalg.solve(mass, stiffness)
    companion[n:, n:] = -np.linalg.solve(mass, damping)
    return np.linalg.eigvals(companion)


def unstable_count(model, u, threshold=1e-7):
    """Number of eigenvalues of a small model with a positive real part, from its matrices."""
    return int(np.sum(companion_eigenvalues(*model.operators().at(u)).real > threshold))


def distances(found, reference):
    """Distance of each value found to the nearest of the reference, relative to its size or 1."""
    found, reference = np.asarray(found), np.asarray(reference)
    nearest = np.abs(found[:, None] - reference[None, :]).min(axis=1)
    return nearest / np.maximum(np.abs(found), 1.0)


def chain_newton_step(chain, value, u, digits=30):
    """Newton's correction of an eigenvalue of a chain, by shooting from its free end in mpmath.

    From any angle and displacement of the free end, the moments about the joints give one segment
    after another; an eigenvalue lets a combination of two such shapes meet the clamp.
    """
    with mpmath.workdps(digits):
        value, step = mpmath.mpmathify(complex(value)), mpmath.mpf(10) ** -10
        here = clamp_misfit(chain, value, u)
        there = clamp_misfit(chain, value * (1 + step), u)
        return complex(-here * value * step / (there - here))


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
    thrust = mpmath.mpf(pipe.alpha if aspirating else 1.0) * u**2
    coriolis = mpmath.sqrt(pipe.beta) * (-u if aspirating else u) * value
    elastic = 1 + pipe.damping * value
    square = value**2
    columns = []
    for tip_angle, tip in ((mpmath.mpf(1), mpmath.mpf(0)), (mpmath.mpf(0), mpmath.mpf(1))):
        angle, node = mpmath.mpc(tip_angle), mpmath.mpc(tip)
        force = moment = beyond = mpmath.mpc(0)  # inertia forces beyond, the joint, the mass beyond
        for k in reversed(range(chain.dof)):
            length, spring = mpmath.mpf(chain.lengths[k]), mpmath.mpf(chain.springs[k])
            arm = mpmath.mpf(chain.centers[k]) * length
            clamped_side = node - length * angle
            inertia = square * length * (clamped_side + arm * angle)
            total = length * force + arm * inertia
            total += square * length * mpmath.mpf(chain.gyration_radii[k]) ** 2 * angle
            total += coriolis * length * (length * angle + 2 * (tip - node))
            total += thrust * length * (tip_angle - angle)
            total += pipe.gamma * length * (beyond + arm) * angle
            moment -= total
            force, node, beyond = force + inertia, clamped_side, beyond + length
            angle -= moment / (elastic * spring)
        columns.append((angle, node))
    (a, b), (c, d) = columns
    return a * d - b * c
