# SPDX-License-Identifier: MIT
"""The modular method in redundant coordinates, M q'' = f and A q'' = b: a dense, independent route.

The package finds the motion of scenes in the angles of the segments, by recursion. Here each module
has its inertia and forces in q = (x_j, y_j, phi_j), j = 1 .. n, and knows of no other: x_j across
and y_j down is the position of node j, phi_j the angle of joint j, which has no inertia. One null
space of all constraints at once gives the accelerations.

Source: Orsino and Di Giulio, eqs. (2)-(6) and (9)-(11); Orsino (2016).
"""

import math

import independent
import numpy as np
import scipy.linalg

from pipedyn import modular as md


def across(along):
    """Vectors l n = (l t_y, -l t_x) normal to vectors l t, each a row."""
    return along[:, ::-1] * [1.0, -1.0]


def nodes_of(scene, columns, order=0):
    """Positions of nodes 0, 1, .. at q (3 n, ...), or velocities (order 1): (n + 1, 2, ...)."""
    inner = columns.reshape(scene.integrated, 3, *columns.shape[1:])[:, :2]
    first = np.zeros_like(inner[:1])
    first[0, 1] = 0.0 if order else scene._layout.base
    return np.concatenate([first, inner])


def between(values, share, segment):
    """Values at shares of segments' lengths from the clamped side, interpolated from nodes."""
    return values[segment] + share[:, None] * (values[segment + 1] - values[segment])


def mass(scene, q):
    """Mass matrix M, shape (3 n, 3 n), at coordinates q, shape (3 n,).

    A segment with the masses on it has the kinetic energy m (|r*'|^2 + (eta / l)^2 |r_j' -
    r_{j-1}'|^2) / 2, r* = (1 - chi) r_{j-1} + chi r_j. Mass m_n that moves only across the segment
    has m_n (a^2 + a b + b^2) / 6, a = n . r_{j-1}', b = n . r_j'.
    """
    layout, n = scene._layout, scene.integrated
    normals = across(np.diff(nodes_of(scene, q), axis=0)) / layout.lengths[:, None]
    whole = np.zeros((3 * n + 3, 3 * n + 3))
    for j, (m, chi, eta, m_n) in enumerate(scene.core.chain.bodies()):
        own = m * np.outer([1.0 - chi, chi], [1.0 - chi, chi])
        own += m * (eta / layout.lengths[j]) ** 2 * np.array([[1.0, -1.0], [-1.0, 1.0]])
        pair = np.kron(own, np.eye(2))
        pair += np.kron(m_n / 6.0 * np.array([[2, 1], [1, 2]]), np.outer(normals[j], normals[j]))
        at = [3 * j, 3 * j + 1, 3 * j + 3, 3 * j + 4]
        whole[np.ix_(at, at)] += pair
    whole = whole[3:, 3:]
    for part in scene.modules:
        if isinstance(part, md.Custom) and part.mass is not None:
            whole[np.ix_(part.index, part.index)] += part.mass
    return whole


def load(law, numbers, r, angle, t, n, v, omega):
    """Force (k, 2) and couple (k,) of a law, or those per length, at k moving places.

    r: positions, (k, 2); angle: of the tangents; t, n: unit vectors along and normal to the pipe;
    v: velocities; omega: rates of the angle. Of added mass chi, of the kinetic energy T = chi v_n^2
    / 2, v_n = n . v, the change of its momentum chi v_n n as n turns acts as a force, and the
    derivative of T by the angle as a couple. Laws that only test_terms.py has are left to it.
    """
    number, *others = numbers
    x, v_n, v_t = r[:, 0], np.sum(n * v, axis=1), np.sum(t * v, axis=1)
    none = np.zeros(len(r))
    if law == "added_mass":
        force = number * omega[:, None] * (v_t[:, None] * n + v_n[:, None] * t)
        return force, -number * v_n * v_t
    if law == "viscosity":
        return -number * v_n[:, None] * n, none
    if law == "stretching":
        return np.outer(number * (1.0 - r[:, 1]) - others[0] * v[:, 1], [0.0, 1.0]), none
    across = {"spring": x, "foundation": x, "cubic_spring": x**3, "damper": v[:, 0]}
    return np.outer(-number * (none if law == "point_mass" else across[law]), [1.0, 0.0]), none


def forces(scene, y, u, drive=None, load=load):
    """Forces of all modules at a state [q, q'], shape (3 n,).

    The flow exerts, for each segment, -sqrt(beta) U r_j' on node j - 1 and sqrt(beta) U r_{j-1}' on
    node j, -sqrt(beta) U' l t in the middle of the segment, and on the free end -share sqrt(beta) U
    r_n' - a U^2 (cos jet_angle t + sin jet_angle n). Segments have their weights, less the mass
    times the acceleration of the base. Joints have -k (phi - psi) - c phi'. Drag at a segment's
    drag point is -kappa l |v| v n, v = n . r'. Terms and custom modules add theirs. The forcing
    `drive`, shape (7,), has U' and the motion of the base, on which inflow, drag and terms depend.
    `load` states the laws of the terms.
    """
    rate, *moves = np.zeros(7) if drive is None else drive
    place, speed, acceleration = np.reshape(moves, (3, 2))
    layout, lengths, chain = scene._layout, scene._layout.lengths, scene.core.chain
    pipe, n = layout.acting(scene.pipe), scene.integrated
    q, rates = np.split(y, 2)
    nodes, velocities = nodes_of(scene, q), nodes_of(scene, rates, order=1)
    along, every, middle = np.diff(nodes, axis=0), np.arange(n), np.full(n, 0.5)
    normal, on_nodes = across(along) / lengths[:, None], np.zeros_like(nodes)

    def add(share, loads, segment):
        """Adds loads at shares of segments' lengths to the nodes at both ends."""
        np.add.at(on_nodes, segment, (1.0 - share)[:, None] * loads)
        np.add.at(on_nodes, segment + 1, share[:, None] * loads)

    heavy, chi, _, across_alone = chain.bodies().T
    fluid = math.sqrt(pipe.beta) * pipe.direction
    add(chi, np.outer(heavy, [0.0, pipe.gamma] - acceleration), every)
    add(middle, -fluid * rate * along, every)
    v = np.sum(normal * (between(velocities, layout.drag_points, every) + speed), axis=1)
    add(layout.drag_points, normal * (-pipe.drag * lengths * np.abs(v) * v)[:, None], every)
    add(middle, normal * (-across_alone * (normal @ acceleration))[:, None], every)

    angle, turning = np.cumsum(q[2::3]), np.sum(across(along) * np.diff(velocities, axis=0), axis=1)
    for term in pipe.terms:
        segment, arm, weight = np.transpose(independent.places(layout, term.place))
        segment = segment.astype(np.intp)
        share, t, n_at = arm / lengths[segment], along[segment], normal[segment]
        where, moving = (between(of, share, segment) for of in (nodes, velocities))
        t, omega = t / lengths[segment, None], turning[segment] / lengths[segment] ** 2
        if term.law != "stretching":  # it acts between the pipe and the base
            where, moving = where + place, moving + speed
        numbers = term.law_numbers(pipe.damping)
        force, couple = load(term.law, numbers, where, angle[segment], t, n_at, moving, omega)
        add(share, weight[:, None] * force, segment)
        pair = n_at * (weight * couple / lengths[segment])[:, None]  # opposite forces on the nodes
        np.add.at(on_nodes, segment, -pair)
        np.add.at(on_nodes, segment + 1, pair)

    on_nodes[:-1] -= fluid * u * velocities[1:]
    on_nodes[1:] += fluid * u * velocities[:-1]
    on_nodes[-1] += fluid * u * ((1.0 - pipe.inflow_share) * speed)
    on_nodes[-1] -= fluid * u * pipe.inflow_share * velocities[-1]
    end = np.array([0.0, 1.0]) if layout.guided else along[-1] / lengths[-1]
    jet = math.cos(pipe.jet_angle) * end + math.sin(pipe.jet_angle) * across(end[None])[0]
    on_nodes[-1] -= pipe.alpha * u**2 * jet

    spring, damping, rest = chain.joints.T
    joints = rest[:n] - spring[:n] * q[2::3] - damping[:n] * rates[2::3]
    if layout.guided:  # acts on the last segment's angle, the sum of the joints'
        joints -= spring[n] * q[2::3].sum() + damping[n] * rates[2::3].sum()
    total = np.column_stack([on_nodes[1:], joints]).ravel()
    for part in scene.modules:
        if not isinstance(part, md.Custom):
            continue
        at = part.index
        if part.force is not None:
            total[at] += part.force(q[at], rates[at])
        elif part.energy is not None:
            steps = 1e-30j * np.eye(at.size)
            total[at] -= [part.energy(q[at] + step).imag / 1e-30 for step in steps]
    return total


def constraints(scene, q, rates):
    """Residuals g(q), their rates A q' and b = A q'' of all constraints, shape (2 n + c,) each.

    Each joint, from the clamp on, has two rows, and each coordinate that guides and pins hold has
    one after these. With a = r_j - r_{j-1} and d = (r_{j-1} - r_{j-2}) / l_{j-1}, or (0, 1) at the
    clamp, a joint has g = (a . d - l_j cos phi_j, a x d - l_j sin phi_j). For rates (3 n, k) the
    last two results have k columns; A q' is A itself if the rates are the identity.
    """
    layout, columns = scene._layout, rates.reshape(rates.shape[0], -1)

    def directions(columns, order):
        """Vectors a and d of each joint as x + i y, shape (n, k), or their rates (order 1)."""
        x, y = np.moveaxis(nodes_of(scene, columns, order), 1, 0)
        a = np.diff(x + 1j * y, axis=0)
        first = np.full_like(a[:1], 1j * (1.0 - order))
        return a, np.concatenate([first, (a / layout.lengths[:, None])[:-1]])

    def listed(of_joints, held):
        """Real and imaginary rows of each joint, followed by rows of held coordinates."""
        joints = np.stack([of_joints.real, of_joints.imag], axis=1).reshape(-1, held.shape[1])
        return np.concatenate([joints, held])

    (a, d), (a_rate, d_rate) = directions(q[:, None], 0), directions(columns, 1)
    # For vectors written x + i y, conj(a) d = a . d + i a x d.
    bend, turning = layout.lengths[:, None] * np.exp(1j * q[2::3, None]), columns[2::3]
    residual = listed(np.conj(a) * d - bend, (q[layout.held] - layout.held_values)[:, None])
    drift = np.conj(a_rate) * d + np.conj(a) * d_rate - 1j * bend * turning
    wanted = -2.0 * np.conj(a_rate) * d_rate - bend * turning**2
    shape = (-1, *rates.shape[1:])
    return (
        residual[:, 0],
        listed(drift, columns[layout.held]).reshape(shape),
        listed(wanted, np.zeros((layout.held.size, columns.shape[1]))).reshape(shape),
    )


def accelerations(scene, y, u, drive=None, load=load):
    """Accelerations q'', shape (3 n,), by the null space of all constraints at once."""
    q, rates = np.split(y, 2)
    _, a, _ = constraints(scene, q, np.eye(q.size))
    _, _, b = constraints(scene, q, rates)
    ways, inertia = scipy.linalg.null_space(a, rcond=1e-9), mass(scene, q)
    assert ways.shape[1] == scene.dof
    whole = np.concatenate([ways.T @ inertia, a])
    right = np.concatenate([ways.T @ forces(scene, y, u, drive, load), b])
    return np.linalg.lstsq(whole, right, rcond=1e-12)[0]
