# SPDX-License-Identifier: MIT
"""The motion of a chain in three dimensions from virtual work: a dense, independent route.

The package has a recursion in the frames of the segments, with derivatives by hand. Here all
derivatives of the tangents are those of the analytic function t(a), by complex steps and by
Cauchy's integral, the fluid's force is integrated along the segments, and the damped rate of a
joint is the rate of its moment's components in the frame that is carried along the pipe without
twist.
"""

import numpy as np

STEP = 1e-30


def tangents(a):
    """Tangents, (n, 3), of rotation vectors (a_x, a_z), (n, 2), real or complex."""
    rho = np.sqrt((a**2).sum(axis=1))
    share = np.where(rho == 0.0, 1.0, np.sin(rho) / np.where(rho == 0.0, 1.0, rho))
    return np.stack([share * a[:, 0], np.cos(rho), share * a[:, 1]], axis=1)


def jacobian(a):
    """Derivatives of the tangents by both coordinates of their segment, (n, 3, 2)."""
    steps = [tangents(a + 1j * STEP * np.eye(2)[k]).imag / STEP for k in range(2)]
    return np.stack(steps, axis=2)


def second(a, rates):
    """Second derivatives of the tangents along rates, (n, 3), by Cauchy's integral."""
    turns = np.exp(2j * np.pi * np.arange(64) / 64)
    reach = 0.5 / (1.0 + np.abs(rates).max())
    values = np.stack([tangents(a + reach * turn * rates) for turn in turns])
    return 2.0 * np.tensordot(turns**-2, values, axes=1).real / (turns.size * reach**2)


def product(a, b):
    """Vector product along the last axis, also of complex vectors."""
    turns = (1, 2), (2, 0), (0, 1)
    return np.stack([a[i] * b[j] - a[j] * b[i] for i, j in turns])


def moments(a, springs):
    """Moments of the joints, (n, 3), in components of a frame carried along the pipe without twist.

    The frame is that of the segment before the joint; between two segments it is turned by the
    smallest rotation that takes one tangent to the other.
    """
    axis = np.array([[0.0, 1.0, 0.0]], dtype=a.dtype)
    frame, before, found = np.eye(3, dtype=a.dtype), axis[0], []
    beyond = axis if len(springs) > len(a) else axis[:0]  # at a guided end
    for t, spring in zip([*tangents(a), *beyond], springs, strict=True):
        v, cosine = product(before, t), before @ t
        apart, beside = t - before, t + before
        angle = np.arctan(np.sqrt(apart @ apart) / np.sqrt(beside @ beside))
        size = np.sqrt(v @ v)
        found.append(spring * (2.0 * angle / size if size != 0.0 else 1.0) * (frame @ v))
        turned = [row * cosine + product(v, row) + v * (v @ row) / (1.0 + cosine) for row in frame]
        frame, before = np.stack(turned), t
    return np.stack(found)


def all_springs(chain):
    """Stiffness of the joints, that of a guided end included; a root's spring is in series."""
    springs = np.append(chain.springs, chain.end_spring if chain.pipe.end_guided else [])
    if chain.pipe.root != "clamped":
        springs[0] *= chain.pipe.root_stiffness / (chain.pipe.root_stiffness + springs[0])
    return springs


def uneven_root(chain):
    """Stiffness and damping of the first joint for rotation along z, less those along x."""
    if chain.pipe.root in ("clamped", "pinned") or chain.pipe.root.stiffness_across is None:
        return 0.0, 0.0
    own = chain.springs[0]
    x, z = (k / (k + own) for k in (chain.pipe.root.stiffness, chain.pipe.root.stiffness_across))
    return own * (z - x), chain.pipe.damping * own * (z**2 - x**2)


def potential(chain, a):
    """Elastic energy of the joints and potential energy of the pipe's weight."""
    steps = chain.lengths[:, None] * tangents(a)
    heights = chain.base + np.cumsum(steps, axis=0) - steps
    centres = heights[:, 1] + chain.centres * steps[:, 1]
    elastic = (moments(a, np.sqrt(all_springs(chain))) ** 2).sum() / 2.0
    elastic += 0.5 * uneven_root(chain)[0] * a[0, 1] ** 2
    return elastic - chain.pipe.gamma * (chain.masses * centres).sum()


def slope(function, points=16, reach=0.05):
    """Derivative at 0 of an analytic function of one complex number, by Cauchy's integral."""
    turns = np.exp(2j * np.pi * np.arange(points) / points)
    values = np.stack([function(reach * turn) for turn in turns])
    return np.tensordot(turns**-1, values, axes=1) / (points * reach)


def carried(a, vector):
    """A vector at the root in the frame that is carried to the end of the chain without twist."""
    before = np.array([0.0, 1.0, 0.0])
    for t in tangents(a):
        v, cosine = np.cross(before, t), before @ t
        vector = vector * cosine + np.cross(v, vector) + v * (v @ vector) / (1.0 + cosine)
        before = t
    return vector


def normal_inertia(chain, chi, a, rates, base):
    """Mass matrix and generalised forces at a'' = 0 of a mass chi that only v_n moves.

    They are Lagrange's equations of the kinetic energy chi / 2 int |v - (v . t) t|^2.
    """
    units = np.eye(a.size).reshape(a.size, *a.shape)
    points, shares = np.polynomial.legendre.leggauss(3)

    def kinetic(a, rates, velocity):
        t, turning = tangents(a), slope(lambda z: tangents(a + z * rates))
        total = 0.0
        for length, along, rate in zip(chain.lengths, t, turning, strict=True):
            for point, share in zip(0.5 * (points + 1.0), 0.5 * shares, strict=True):
                v = velocity + point * length * rate
                total += 0.5 * chi * share * length * (v @ v - (v @ along) ** 2)
            velocity = velocity + length * rate
        return total

    def momenta(a, rates, velocity):
        """Derivatives by the rates, of which the energy is a quadratic function."""
        ends = [[kinetic(a, rates + s * unit, velocity) for s in (1.0, -1.0)] for unit in units]
        return np.array([0.5 * (up - down) for up, down in ends])

    mass = np.stack([momenta(a, unit, np.zeros(3)) for unit in units]).real
    by_a = [slope(lambda z, way=way: kinetic(a + z * way, rates, base[1])) for way in units]
    change = slope(lambda z: momenta(a + z * rates, rates, base[1] + z * base[2]))
    return mass, (np.array(by_a) - change).real.reshape(a.shape)


def accelerations(chain, a, rates, u, u_dot=0.0, base=None, loads=None):
    """Second derivatives of the rotation vectors, (n, 2).

    base: position, velocity and acceleration of the base, (3, 3). loads: function of the positions
    and velocities of the ends of the segments, (n, 3) each, that returns forces on them, (n, 3).
    Supports, which the state must meet, are enforced by multipliers.
    """
    pipe, n, lengths = chain.pipe, len(a), chain.lengths
    base = np.zeros((3, 3)) if base is None else base
    by_a, t, bend = jacobian(a), tangents(a), second(a, rates)
    rate = np.einsum("jkc,jc->jk", by_a, rates)

    # Position of a place at the share x of segment j: sum of l_i t_i before it, and x l_j t_j.
    def place(share):
        return np.tril(np.ones((n, n)), -1) * lengths + np.diag(share * lengths)

    mass, force = np.zeros((n, 2, n, 2)), np.zeros((n, 2))

    def add(weights, of):
        """Adds the virtual work of vectors `of`, (n, 3), at the places with these weights."""
        force[:] += np.einsum("jk,jd,kdc->kc", weights, of, by_a)

    centres = place(chain.centres)
    turning = np.diag(chain.gyration_radii)
    for weights, falls in ((centres, True), (turning, False)):
        heavy = chain.masses[:, None] * weights
        mass += np.einsum("jk,jm,kdc,mde->kcme", heavy, weights, by_a, by_a)
        add(heavy, -weights @ bend)
        if falls:
            add(heavy, np.zeros((n, 3)) - base[2])
    points, shares = np.polynomial.legendre.leggauss(2)
    for point, share in zip(0.5 * (points + 1.0), 0.5 * shares, strict=True):
        moved = share * lengths[:, None] * np.sqrt(pipe.beta) * pipe.direction
        add(place(np.full(n, point)), -moved * (2.0 * u * rate + u_dot * t))
    ends = place(np.ones(n))
    end = np.zeros((n, 3))
    side = carried(a, np.array([1.0, 0.0, 0.0]))
    jet = np.cos(pipe.jet_angle) * t[-1] + np.sin(pipe.jet_angle) * side
    end[-1] = -pipe.alpha * u**2 * (np.array([0.0, 1.0, 0.0]) if pipe.end_guided else jet)
    velocity = base[1] + ends @ rate
    end[-1] += (1.0 - pipe.inflow_share) * np.sqrt(pipe.beta) * pipe.direction * u * velocity[-1]
    add(ends, end)
    if loads is not None:
        add(ends, loads(base[0] + [0.0, chain.base, 0.0] + ends @ t, velocity))
    at = place(chain.drag_points)
    moving = base[1] + at @ rate
    normal = moving - (moving * t).sum(axis=1)[:, None] * t
    add(at, -pipe.drag * lengths[:, None] * np.linalg.norm(normal, axis=1)[:, None] * normal)
    springs = all_springs(chain)
    damped = pipe.damping * springs
    damped[0] *= springs[0] / chain.springs[0]  # a root's spring is not damped
    slopes = np.zeros((len(damped), 3, n, 2))
    for k in range(n):
        for c in range(2):
            step = np.zeros((n, 2), dtype=complex)
            step[k, c] = 1j * STEP
            force[k, c] -= potential(chain, a + step).imag / STEP
            slopes[:, :, k, c] = moments(a + step, np.ones(len(damped))).imag / STEP
    seen = np.einsum("jdkc,kc->jd", slopes, rates)
    force -= np.einsum("j,jd,jdkc->kc", damped, seen, slopes)
    # A damper that resists the spin about x alone, and half of it about y.
    resisted = uneven_root(chain)[1] * np.array([1.0, 0.5, 0.0]) * np.cross(t[0], rate[0])
    force[0] -= np.cross(t[0], by_a[0].T) @ resisted
    for term in pipe.terms:  # besides those that `loads` has
        if term.law == "added_mass":
            more, pushed = normal_inertia(chain, term.chi, a, rates, base)
            mass += more.reshape(mass.shape)
            force += pushed
    # With multipliers of the accelerations x'' and z'' of the held ends of segments.
    across = ends[chain._held]
    rows = np.einsum("bk,kdc->bdkc", across, by_a)[:, [0, 2]].reshape(-1, 2 * n)
    lacking = -(across @ bend)[:, [0, 2]].ravel()
    size, held = 2 * n, len(rows)
    system = np.block([[mass.reshape(size, size), rows.T], [rows, np.zeros((held, held))]])
    found = np.linalg.solve(system, np.append(force.ravel(), lacking))
    return found[:size].reshape(n, 2)
