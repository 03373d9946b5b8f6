# SPDX-License-Identifier: MIT
"""Parts of a scene: modules, which have inertia and forces, and the constraints between them.

A part is a description in numbers; its effect on a state is compiled (cpp/pipedyn/modular/). Only
`Custom` modules, which users write, compute in Python. Effects at a place of the pipe, for example
of a point mass or a spring to the axis, are terms of the pipe: see `pipedyn.models.terms`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipedyn.models.chain import LARGEST_CHAIN
from pipedyn.util import check
from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array

MOST_MASS = 1e6
"""Largest mass of a Custom module; a pipe's terms have the same limit."""

MASSLESS = 1e-10
"""Share of the largest inertia below which an inertia counts as rounding of 0."""

PART_RANGES: dict[str, dict[str, Any]] = {
    "length": {"low": 1e-7, "high": 1.0},
    "centre": {"low": 0.0, "high": 1.0},
    "drag_point": {"low": 0.0, "high": 1.0},
    "gyration_radius": {"low": 0.0, "high": 1e3},
    "mass": {"low": 0.0, "high": 1e6, "open_low": True},
    "stiffness": {"low": 0.0, "high": 1e15},
    "damping": {"low": 0.0, "high": 1e9},
    "rest_angle": {"low": -1e3, "high": 1e3},
    "base": {"low": 0.0, "high": 1.0, "open_high": True},
    "x": {"low": -1e3, "high": 1e3},
    "y": {"low": -1e3, "high": 1e3},
}
"""Ranges of parts' numbers: those of `Chain` and of a pipe's terms, or limits far beyond use."""

FIRST = {"joint": 1, "segment": 2, "node": 1}
"""Lowest number of a place; the highest is `LARGEST_CHAIN`."""


class Part:
    """Base class of modules and constraints, which checks their numbers."""

    def __post_init__(self) -> None:
        """Checks that each number lies in its range, and converts it to its type."""
        for item in fields(self):  # type: ignore[arg-type]
            value, name = getattr(self, item.name), f"{item.name} of {type(self).__name__}"
            if item.name in FIRST:
                value = check.count(name, value, low=FIRST[item.name], high=LARGEST_CHAIN)
            elif value is not None or item.default is not None:
                value = check.real(name, value, **PART_RANGES[item.name])
            object.__setattr__(self, item.name, value)


class Module(Part):
    """A part with inertia or forces of its own."""


class Constraint(Part):
    """A part that prescribes a relation between coordinates."""


@saved_as("Segment")
@dataclass(frozen=True)
class Segment(Module):
    """A rigid piece of the pipe; the scene's j-th segment lies between nodes j - 1 and j.

    Its weight is included.

    Attributes:
        length: l_j in L, > 0.
        centre: its centre of mass, as a fraction chi_j of the length, in [0, 1].
        gyration_radius: eta_j in L about the centre of mass, >= 0; if None, that of a homogeneous
            segment, l_j / sqrt(12).
        drag_point: place at which drag acts, as a fraction xi_j of the length, in [0, 1].
        mass: mass with the fluid inside, > 0, in units of the pipe's mass (mu_p + mu_f) L; if None,
            that of a uniform pipe, which equals the length.
    """

    length: float
    centre: float = 0.5
    gyration_radius: float | None = None
    drag_point: float = 0.5
    mass: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.gyration_radius is None:
            object.__setattr__(self, "gyration_radius", self.length / math.sqrt(12.0))


@saved_as("TorsionalSpring")
@dataclass(frozen=True)
class TorsionalSpring(Module):
    """A spring that resists the bending of a joint.

    Its moment is -stiffness (phi_j - rest_angle) - damping phi_j'.

    Attributes:
        joint: number of the joint, from 1; joint j connects segment j to segment j - 1, joint 1
            connects segment 1 to the root, and joint n + 1 connects a guided or clamped end, if
            the pipe has one, to segment n.
        stiffness: moment per angle, in EI / L, >= 0.
        damping: moment per rate of the angle, in EI T / L, >= 0; if None, the pipe's Kelvin-Voigt
            damping, delta times the stiffness.
        rest_angle: angle phi_j at which the spring has no moment, rad.
    """

    joint: int
    stiffness: float
    damping: float | None = None
    rest_angle: float = 0.0


@saved_as("InternalFlow")
@dataclass(frozen=True)
class InternalFlow(Module):
    """The fluid that moves through all segments and the free end; its numbers are the pipe's.

    Source: Orsino and Di Giulio, eqs. (2)-(6).
    """


@saved_as("Drag")
@dataclass(frozen=True)
class Drag(Module):
    """Quadratic drag at the segments' drag points; its coefficient is the pipe's.

    Source: Orsino and Di Giulio, eq. (9).
    """


UserLaw: TypeAlias = Callable[..., Any]
"""A function that a user writes: an energy, a force or a derivative of a force."""


@saved_as("Custom")
@dataclass(frozen=True)
class Custom(Module):
    """A module that a user writes in Python. It may have any forces, and is slower than others.

    Its functions take the coordinates it touches, q = (x, y of each node, then phi of each joint),
    shape (k,), and their rates. Derivatives that are not given are computed by complex step, so the
    functions must accept complex arrays and be built of analytic functions (no abs, sign, conj,
    norm or real part; with these, derivatives must be given). When an `Assembly` is made, the
    functions are called at displacements up to a pipe's length, and all derivatives are compared
    with differences. Scenes can be pickled, for use in processes, if the functions can, for example
    if they are defined at the top of a module.

    Attributes:
        nodes: numbers of the nodes it touches, from 1; y is measured downward from the clamp.
        joints: numbers of the joints it touches, from 1.
        energy: potential energy energy(q), in EI / L.
        force: generalized force force(q, qdot), shape (k,); if None, minus the energy's gradient.
            `Power.others` contains the force's power less that of minus the energy's gradient.
        force_by_q: derivative of the force by q, shape (k, k), a row for each force.
        force_by_qdot: derivative of the force by qdot, shape (k, k), a row for each force.
        mass: constant mass matrix, shape (k, k), symmetric, positive semidefinite; if None, there
            is no inertia.
        name: name of the module in error messages.
    """

    nodes: tuple[int, ...] = ()
    joints: tuple[int, ...] = ()
    energy: UserLaw | None = None
    force: UserLaw | None = None
    force_by_q: UserLaw | None = None
    force_by_qdot: UserLaw | None = None
    mass: ArrayLike | None = None
    name: str = "Custom"

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name.strip():
            raise TypeError(f"name of a Custom module must be a word, got {check.shown(self.name)}")
        for places in ("nodes", "joints"):
            given = getattr(self, places)
            if not isinstance(given, tuple | list | range | np.ndarray) or np.ndim(given) != 1:
                raise TypeError(
                    f"{places} of {self.name} must be a tuple of numbers, got {check.shown(given)}"
                )
            checked = tuple(
                check.count(f"{places} of {self.name}", place, high=LARGEST_CHAIN)
                for place in given
            )
            if len(set(checked)) < len(checked):
                raise ValueError(f"{places} of {self.name} must differ, got {checked}")
            object.__setattr__(self, places, checked)
        if self.size == 0:
            raise ValueError(f"{self.name} must touch nodes or joints, got none")
        for function in ("energy", "force", "force_by_q", "force_by_qdot"):
            given = getattr(self, function)
            check.instance(f"{function} of {self.name}", given, Callable | None, "a function")
        if self.energy is None and self.force is None and self.mass is None:
            raise ValueError(f"{self.name} must have an energy, a force or a mass")
        if self.force is None and self.force_by_qdot is not None:
            raise ValueError(f"force_by_qdot of {self.name} must come with a force")
        if self.mass is not None:
            rows = self._checked_mass(self.mass).tolist()
            object.__setattr__(self, "mass", tuple(map(tuple, rows)))

    def _checked_mass(self, given: ArrayLike) -> Array:
        """The argument mass as an array (k, k), symmetric and positive semidefinite."""
        name, k = f"mass of {self.name}", self.size
        raw = np.array(check.numbers(name, given, "an array of real numbers"), dtype=float)
        if raw.shape != (k, k):
            raise ValueError(f"{name} must have shape ({k}, {k}), got {raw.shape}")
        size = float(np.abs(raw).max())
        if not size <= MOST_MASS:
            raise ValueError(f"{name} must be finite and at most {MOST_MASS:g}, got {size:g}")
        if np.abs(raw - raw.T).max() > 1e-12 * size:
            raise ValueError(f"{name} must be symmetric")
        if np.linalg.eigvalsh(raw)[0] < -1e-12 * size:
            raise ValueError(f"{name} must be positive semidefinite")
        return raw

    def _inertia_rows(self, coordinates: int) -> Array:
        """Rows W, (rank, coordinates), of the module's mass W^T W in redundant coordinates."""
        if self.mass is None:
            return np.zeros((0, coordinates))
        values, vectors = np.linalg.eigh(np.array(self.mass, dtype=np.float64))
        inert = values > MASSLESS * values[-1]
        rows = np.zeros((np.count_nonzero(inert), coordinates))
        rows[:, self.index] = np.sqrt(values[inert])[:, None] * vectors[:, inert].T
        return rows

    @property
    def size(self) -> int:
        """Number k of the coordinates that the module touches."""
        return 2 * len(self.nodes) + len(self.joints)

    @property
    def index(self) -> NDArray[np.intp]:
        """Indices of the touched coordinates among the redundant ones, shape (k,)."""
        pairs = [(3 * node - 3, 3 * node - 2) for node in self.nodes]
        angles = [3 * joint - 1 for joint in self.joints]
        return np.array([*(i for pair in pairs for i in pair), *angles], dtype=np.intp)


@saved_as("Clamp")
@dataclass(frozen=True)
class Clamp(Constraint):
    """The constraint that holds segment 1 at the fixed end, turned by phi_1 from the axis.

    Attributes:
        base: length of a fixed part of the pipe between the clamp and joint 1, in L, in [0, 1).

    Source: Orsino and Di Giulio, eq. (10).
    """

    base: float = 0.0


@saved_as("Joint")
@dataclass(frozen=True)
class Joint(Constraint):
    """The constraint that connects a segment to the one before, at the angle phi_j between them.

    Attributes:
        segment: number of the segment, from 2.

    Source: Orsino and Di Giulio, eq. (11).
    """

    segment: int


@saved_as("Guide")
@dataclass(frozen=True)
class Guide(Constraint):
    """The constraint that holds a node on the axis, x = 0; the node can slide along the axis.

    Attributes:
        node: number of the node, from 1.
    """

    node: int


@saved_as("Pin")
@dataclass(frozen=True)
class Pin(Constraint):
    """The constraint that holds a node at one place, about which the pipe can turn.

    Attributes:
        node: number of the node, from 1.
        x: transverse coordinate of the place, in L.
        y: coordinate of the place along the axis, in L, downward from the clamp.
    """

    node: int
    x: float
    y: float


def part_text(part: Part) -> str:
    """A part as text for messages: its class and numbers, or the name of a Custom module."""
    if isinstance(part, Custom):
        return part.name
    values = ((item.name, getattr(part, item.name)) for item in fields(part))  # type: ignore[arg-type]
    return f"{type(part).__name__}({', '.join(f'{k}={v:g}' for k, v in values if v is not None)})"
