# SPDX-License-Identifier: MIT
"""The parts of a scene: modules, which bring inertia and forces, and the constraints between them.

Each is a description in numbers; what it does to a state is compiled (cpp/pipedyn/modular/). Only
`Custom` modules, a user's own, compute in Python. What acts at a place of the pipe, such as a point
mass or a spring to the axis, is a term of the pipe: see `pipedyn.models.terms`.
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
"""Largest mass of a Custom, as of the terms of a pipe."""

MASSLESS = 1e-10
"""Inertia below this share of the largest is what rounding leaves of a semidefinite one."""

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
"""Ranges of the parts' numbers: those of `Chain` and of a pipe's terms, others far beyond use."""

FIRST = {"joint": 1, "segment": 2, "node": 1}
"""Least number of a place; no scene has more segments than a chain."""


class Part:
    """What modules and constraints share."""

    def __post_init__(self) -> None:
        """Replaces each number by one of its own type, if it lies in its range."""
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
    """A part that ties coordinates together."""


@saved_as("Segment")
@dataclass(frozen=True)
class Segment(Module):
    """A rigid piece of the pipe; the scene's j-th segment lies between nodes j - 1 and j.

    Its weight is included.

    Attributes:
        length: l_j in L, > 0.
        centre: its centre of mass, as a fraction chi_j of the length, in [0, 1].
        gyration_radius: eta_j in L about the centre of mass, >= 0; where None that of a homogeneous
            segment, l_j / sqrt(12).
        drag_point: where drag acts on it, as a fraction xi_j of the length, in [0, 1].
        mass: with its fluid in the pipe's, (mu_p + mu_f) L, > 0; where None that of a uniform pipe,
            its length.
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
    """A spring that bends a joint: the moment -stiffness (phi_j - rest_angle) - damping phi_j'.

    Attributes:
        joint: number of the joint, from 1; joint j holds segment j to segment j - 1, joint 1 holds
            segment 1 to the root, and joint n + 1, where the pipe has one, a guided or clamped end
            to segment n.
        stiffness: in EI / L, >= 0.
        damping: moment in unit rate, in EI T / L, >= 0; where None the pipe's Kelvin-Voigt damping,
            delta times the stiffness.
        rest_angle: phi_j without moment, rad.
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


UserFunction: TypeAlias = Callable[..., Any]


@saved_as("Custom")
@dataclass(frozen=True)
class Custom(Module):
    """A module of the user's own, written in Python: slower than the others, with any forces.

    Its functions take the coordinates it touches, q = (x, y of each node, then phi of each joint),
    shape (k,), and their rates. Derivatives that are not given are taken by complex step, so the
    functions must accept complex arrays and be built of analytic ones (no abs, sign, conj, norm or
    real part; those need derivatives of their own). When an `Assembly` is made they are tried,
    and all derivatives compared with differences, at displacements up to a pipe's length. Scenes
    pickle, for processes, if the functions do: those defined at the top of a module.

    Attributes:
        nodes: numbers of the nodes it touches, from 1; y is measured downward from the clamp.
        joints: numbers of the joints it touches, from 1.
        energy: potential energy energy(q), in EI / L.
        force: generalized force force(q, qdot), shape (k,); where None, minus the energy's
            gradient. What it does beyond that gradient counts as work of `Power.others`.
        force_by_q: derivative of the force by q, shape (k, k): rows the force.
        force_by_qdot: derivative of the force by qdot, shape (k, k).
        mass: constant inertia, shape (k, k), symmetric, positive semidefinite; none where None.
        name: what errors call it.
    """

    nodes: tuple[int, ...] = ()
    joints: tuple[int, ...] = ()
    energy: UserFunction | None = None
    force: UserFunction | None = None
    force_by_q: UserFunction | None = None
    force_by_qdot: UserFunction | None = None
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
            if given is not None and not callable(given):
                raise TypeError(
                    f"{function} of {self.name} must be a function, got {check.shown(given)}"
                )
        if self.energy is None and self.force is None and self.mass is None:
            raise ValueError(f"{self.name} must have an energy, a force or a mass")
        if self.force is None and self.force_by_qdot is not None:
            raise ValueError(f"force_by_qdot of {self.name} must come with a force")
        if self.mass is not None:
            rows = self._checked_mass(self.mass).tolist()
            object.__setattr__(self, "mass", tuple(map(tuple, rows)))

    def _checked_mass(self, given: ArrayLike) -> Array:
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
        """Rows W of its mass W^T W among so many redundant coordinates."""
        if self.mass is None:
            return np.zeros((0, coordinates))
        values, vectors = np.linalg.eigh(np.array(self.mass, dtype=np.float64))
        inert = values > MASSLESS * values[-1]
        rows = np.zeros((np.count_nonzero(inert), coordinates))
        rows[:, self.index] = np.sqrt(values[inert])[:, None] * vectors[:, inert].T
        return rows

    @property
    def size(self) -> int:
        """Number k of coordinates it touches."""
        return 2 * len(self.nodes) + len(self.joints)

    @property
    def index(self) -> NDArray[np.intp]:
        """Where these are among the redundant coordinates, shape (k,)."""
        pairs = [(3 * node - 3, 3 * node - 2) for node in self.nodes]
        angles = [3 * joint - 1 for joint in self.joints]
        return np.array([*(i for pair in pairs for i in pair), *angles], dtype=np.intp)


@saved_as("Clamp")
@dataclass(frozen=True)
class Clamp(Constraint):
    """Segment 1 held at the fixed end: its direction is phi_1 from the axis.

    Attributes:
        base: length of a fixed part of the pipe between the clamp and joint 1, in L, in [0, 1).

    Source: Orsino and Di Giulio, eq. (10).
    """

    base: float = 0.0


@saved_as("Joint")
@dataclass(frozen=True)
class Joint(Constraint):
    """Segment `segment` held to the one before, phi its angle from that one's direction.

    Attributes:
        segment: number of the segment, from 2.

    Source: Orsino and Di Giulio, eq. (11).
    """

    segment: int


@saved_as("Guide")
@dataclass(frozen=True)
class Guide(Constraint):
    """A node held on the axis, x = 0, free to slide along it.

    Attributes:
        node: number of the node, from 1.
    """

    node: int


@saved_as("Pin")
@dataclass(frozen=True)
class Pin(Constraint):
    """A node held at one place, free to turn.

    Attributes:
        node: number of the node, from 1.
        x: transverse place, in L.
        y: place along the axis, in L, downward from the clamp.
    """

    node: int
    x: float
    y: float


def part_text(part: Part) -> str:
    """The part in a message: its class with its numbers."""
    if isinstance(part, Custom):
        return part.name
    values = ((item.name, getattr(part, item.name)) for item in fields(part))  # type: ignore[arg-type]
    return f"{type(part).__name__}({', '.join(f'{k}={v:g}' for k, v in values if v is not None)})"
