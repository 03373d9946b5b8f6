# SPDX-License-Identifier: MIT
"""Base class of all models: its size, linear operators, equations of motion and centreline."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from functools import cached_property
from numbers import Real
from operator import attrgetter
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipedyn import _core
from pipedyn.models.pipe import OWN_NUMBERS, Pipe, checked_pipe
from pipedyn.models.profile import values_along
from pipedyn.util import check
from pipedyn.util.archive import Saved, saved_as
from pipedyn.util.check import Array
from pipedyn.util.errors import resolved
from pipedyn.util.result import POWER, Result

BALANCED = 1e-8
"""Largest residual force of an equilibrium, in units of 1 + |gamma| + a u^2: in 11 searches with
five models Newton's method left 6e-16 at most."""

DENSE_LIMIT = 4000
"""Largest dof for which dense operators are computed: seven matrices take 128 MB each."""

ROWS = 10
"""Number of rows of a drive: u', then position, velocity and acceleration of the base, (x, y) each,
then z of each."""

BASE_ROWS = [1, 2, 7], [3, 4, 8], [5, 6, 9]
"""Rows of position, velocity and acceleration of the base in a drive, (x, y, z) each."""

COMPLEX_STEP = 1e-30
"""Size of a complex step: no difference cancels, and its square is lost beside any number."""

LARGEST_DISPLACEMENT = 1e100
"""Largest coordinate of a small displacement, at which sums of coordinates stay finite."""

LARGEST_ANGLE = 1e6
"""Largest coordinate of a shape: sine and cosine of greater angles lose their digits."""

ANGLES: dict[str, Any] = {"low": -LARGEST_ANGLE, "high": LARGEST_ANGLE}
"""Range of the coordinates of a shape, for `check.array`."""


@saved_as("Operators")
class Operators(Result):
    """Linear operators about a configuration at rest, each of shape (dof, dof).

    M q'' + C q' + K q = 0 with C = s * u * (gyroscopic + end_flux) + damping and
    K = stiffness + a * u^2 * flux + s * u' * unsteady. With hysteresis, motions
    q ~ exp(lambda tau) with Im lambda > 0 have K + i * loss. The matrix gyroscopic is
    skew and end_flux is symmetric, of rank one (two about a bent pipe). Both and unsteady contain
    the factor sqrt(beta), and end_flux also `inflow_share`.

    Attributes:
        mass: M, symmetric and positive definite.
        gyroscopic: Coriolis part of C, skew.
        end_flux: flux through the free end, symmetric.
        damping: Kelvin-Voigt damping, symmetric; for a scene also all other linear resistance.
        stiffness: springs or bending, and gravity; symmetric unless a custom module is not.
        flux: centrifugal force and the end's follower force.
        unsteady: force of the fluid's acceleration along the pipe when the flow speed changes.
        direction: s, 1 ejecting and -1 aspirating.
        centrifugal: alpha.
        loss: loss factor of hysteresis times the elastic stiffness; None without hysteresis.

    Example:
        >>> operators = pp.Chain(pp.Pipe(0.2), n=2).operators()
        >>> operators.mass.round(4)
        array([[0.1667, 0.0625],
               [0.0625, 0.0417]])
        >>> bool((operators.gyroscopic == -operators.gyroscopic.T).all())
        True
    """

    mass: Array
    gyroscopic: Array
    end_flux: Array
    damping: Array
    stiffness: Array
    flux: Array
    unsteady: Array
    direction: float
    centrifugal: float
    loss: Array | None = None

    def at(self, u: float, u_dot: float = 0.0) -> tuple[Array, Array, NDArray[Any]]:
        """(M, C, K) at flow speed u >= 0 and rate du/dtau; with hysteresis K is complex.

        Example:
            >>> M, C, K = pp.Chain(pp.Pipe(0.2), n=2).operators().at(4.0)
            >>> K.round(3)
            array([[-2.,  6.],
                   [-2.,  2.]])
        """
        u = check.real("u", u, low=0.0, high=1e100)
        velocity = self.direction * u * (self.gyroscopic + self.end_flux) + self.damping
        stiffness = self.stiffness + self.centrifugal * u**2 * self.flux
        u_dot = check.real("u_dot", u_dot, low=-1e100, high=1e100)
        if u_dot:
            stiffness = stiffness + self.direction * u_dot * self.unsteady
        return self.mass, velocity, stiffness if self.loss is None else stiffness + 1j * self.loss


@saved_as("Power")
class Power(
    Result, units=dict.fromkeys(("flow", "joints", "drag", "others", "base", "total"), POWER)
):
    """Power of each kind of force, in EI / (L T): numbers, or shape (k,) for k states.

    Attributes:
        flow: power of the flow; at a steady speed all of it enters at the free end.
        joints: power of Kelvin-Voigt damping, <= 0.
        drag: power of quadratic drag, <= 0.
        others: power of all forces that a plain pipe does not have.
        base: power of the base's motion; the energy is counted in the frame of the base.
    """

    flow: float | Array
    joints: float | Array
    drag: float | Array
    others: float | Array
    base: float | Array = 0.0

    @property
    def total(self) -> float | Array:
        """Rate of change of the energy, dE/dtau, along the motion."""
        return self.flow + self.joints + self.drag + self.others + self.base


CORE_MATRICES = tuple(field.name for field in fields(Operators)[:7])
"""Names of the matrices of `Operators` that the core computes, the same in the core."""

core_matrices = attrgetter(*CORE_MATRICES)


def operators_from(core: _core.Operators, pipe: Pipe) -> Operators:
    """`Operators` from the core's matrices and the pipe's two factors."""
    matrices = dict(zip(CORE_MATRICES, core_matrices(core), strict=True))
    return Operators(**matrices, direction=pipe.direction, centrifugal=pipe.alpha)


def projected(operators: Operators, basis: Array) -> Operators:
    """Operators in coordinates z, given those in q = basis z, with basis of shape (dof, r)."""
    found = vars(operators).copy()
    for name, of in found.items():
        if isinstance(of, np.ndarray):
            found[name] = basis.T @ of @ basis
    # Rounding would leave it not quite skew.
    found["gyroscopic"] = 0.5 * (found["gyroscopic"] - found["gyroscopic"].T)
    return Operators(**found)


own_numbers = attrgetter(*OWN_NUMBERS)


def stored(name: str, doc: str) -> Any:
    """A read-only property that returns the attribute with a private name."""
    return property(attrgetter(name), doc=doc)


UNIFORM = _core.Profile()
"""Profile of a property that is uniform along the pipe, in the core's form."""


def core_pipe(pipe: Pipe, applied: Sequence[Any] = (), root_across: float = 0.0) -> _core.Pipe:
    """The pipe's numbers in the core's form, with laws of applied forces.

    root_across: that of the pipe, for a model in three dimensions.
    """
    return _core.Pipe(  # positional arguments: keywords would double the time
        own_numbers(pipe),
        pipe.flow == "aspirating",
        [
            *(law for term in pipe.terms for law in term.laws(pipe.damping, not pipe.end_guided)),
            *applied,
        ],
        pipe.root_stiffness,
        pipe.end,
        pipe.supports,
        UNIFORM if pipe.stiffness is None else pipe.stiffness.core,
        UNIFORM if pipe.mass is None else pipe.mass.core,
        root_across,
    )


class OfPipe(Saved):
    """Base class of all that has a pipe, discretised or continuous. Immutable; pickles."""

    def __init__(self, pipe: Pipe) -> None:
        self._pipe = checked_pipe(pipe)

    pipe: Pipe = stored("_pipe", "The pipe with its terms.")

    @property
    def approximates_pipe(self) -> bool:
        """Whether the model converges to the continuous pipe as its number of coordinates grows."""
        return True

    @property
    def dimensions(self) -> int:
        """Number of dimensions in which the pipe moves, 2 or 3."""
        return 2

    @property
    def planar(self) -> Any:
        """The model of the same pipe that moves in the plane z = 0: of a planar model itself."""
        return self

    @property
    def planes(self) -> tuple[Any, ...]:
        """Planar models whose small motions are those of this model; empty if it is one of them."""
        return ()

    @property
    def rests_bent(self) -> bool:
        """Whether the configuration chosen by `about` is not the straight pipe."""
        return False

    @cached_property
    def resisted(self) -> bool:
        """Whether linear forces but the flow's and Kelvin-Voigt damping depend on velocities."""
        return bool(self._pipe.terms) and core_pipe(self._pipe).resisted

    def __getstate__(self) -> dict[str, Any]:
        """All attributes but the cached properties, as compiled objects do not pickle."""
        kind = type(self)
        return {name: value for name, value in self.__dict__.items() if not hasattr(kind, name)}

    def archived(self) -> dict[str, Any]:
        """Fields that a file stores: the constructor's arguments by name, and some others."""
        return {"pipe": self._pipe}

    def with_pipe(self, pipe: Pipe) -> Self:
        """The model with another pipe, the same discretisation, if any, and the same springs.

        Raises:
            ValueError: for a pipe that the model's constructor refuses; for another stiffness or
                mass along the pipe, on which the discretisation depends; for supports that the
                configuration of `about` does not meet.
            TypeError: for an argument that is not a pipe.
        """
        for name in ("stiffness", "mass"):
            if getattr(checked_pipe(pipe), name) != getattr(self._pipe, name):
                raise ValueError(
                    f"pipe must have the {name} along it that the model was made for, got {pipe!r}"
                )
        other = object.__new__(type(self))
        other.__dict__.update(self.__getstate__())
        OfPipe.__init__(other, pipe)
        parts = attrgetter("beta", "terms", "root", "end", "supports")
        if parts(pipe) != parts(self._pipe):
            other._check_pipe()
        return other

    def _check_pipe(self) -> None:
        """Raises ValueError if the model does not accept the pipe."""


class Model(OfPipe, ABC):
    """A pipe with a finite number of degrees of freedom. Immutable; models pickle.

    Each model has, besides the coordinates q of users, elastic coordinates z, in which the elastic
    energy is |z|^2 / 2. Eigenvalues are computed in z, where rounding does not hide small ones.

    Every method raises ValueError for an argument of a wrong shape, out of range, or with NaN or
    infinity, and TypeError for an argument that is not a number or an array of real numbers.
    """

    def __init__(self, pipe: Pipe) -> None:
        super().__init__(pipe)
        self._reference: Array | None = None  # set by `about`; None: the straight pipe
        self._applied: Sequence[Any] = ()  # laws of applied forces

    def _check_pipe(self) -> None:
        if self._reference is not None:
            self._checked_reference(self._reference)

    def archived(self) -> dict[str, Any]:
        """Fields that a file stores, with the configuration chosen by `about`."""
        return {**super().archived(), "reference": self._reference}

    def _checked_reference(self, q: Any) -> Array:
        """The configuration of `about` in all coordinates, checked; else raises ValueError."""
        return check.array("reference", q, size=self.integrated, **ANGLES)

    @property
    @abstractmethod
    def dof(self) -> int:
        """Number of degrees of freedom."""

    @property
    def coordinates(self) -> int:
        """Number of coordinates of a configuration; more than dof if constraints tie them."""
        return self.dof

    @property
    def coordinate_kind(self) -> str:
        """Name of the kind of coordinates p; models of one kind can share states."""
        return f"angles of {self.integrated} segments"

    @property
    def matrix_rounding(self) -> float:
        """Rounding error of a matrix relative to its norm; 0 if it is relative to each entry."""
        return 0.0

    @property
    def is_varied(self) -> bool:
        """Whether other forces than a uniform pipe's act in small motions."""
        pipe = self._pipe
        return bool(pipe.terms or pipe.stiffness or pipe.mass)

    @cached_property
    def varied_stiffness(self) -> float:
        """Norm of the stiffness, in elastic coordinates, that other forces than its own add."""
        return self.pencil().term_stiffness() if self.is_varied else 0.0

    def refined(self) -> Model | None:
        """A model of the pipe with 1.5 times as many functions, at least four more.

        None for a chain or a scene, as their segments are given bodies.
        """
        return None

    @property
    def linear_cost(self) -> bool:
        """Whether a right-hand side and an eigenvalue cost O(dof), as for chains."""
        return False

    @property
    def elastic_share(self) -> Array:
        """Diagonal of the elastic stiffness in elastic coordinates: 1, less at free joints."""
        return np.ones(self.dof)

    @property
    def hides_turn(self) -> bool:
        """Whether a turn may be free in which moments of a follower force cancel by rounding only.

        Recursions find roots at zero by exact zeros; dense matrices do not need them.
        """
        pipe = self._pipe
        may_turn = pipe.gamma == 0.0 and pipe.fed_at_rest and 0.0 in self.elastic_share
        return may_turn and not any(core_pipe(pipe).added_stiffness)  # no spring opposes it

    @property
    def resolved_modes(self) -> int:
        """Number of lowest modes to track: all, or those that approximate the pipe's."""
        return self.dof

    @property
    def stations(self) -> Array:
        """Arc lengths at which the largest displacement of a mode is searched."""
        return np.linspace(0.0, 1.0, max(201, 8 * min(self.dof, 500) + 1))

    def with_applied(self, laws: Sequence[Any]) -> Self:
        """The model on which forces act that a drive gives, in the place of others, if any.

        laws: those of `AppliedForces`. Without a drive the forces are 0.
        """
        if list(laws) == list(self._applied):
            return self
        other = object.__new__(type(self))
        other.__dict__.update(self.__getstate__(), _applied=tuple(laws))
        return other

    def about(self, q: ArrayLike) -> Self:
        """A copy of the model that is linearised about another configuration at rest.

        `eigenvalues`, `modes`, `root_loci`, `crossings` and `critical_speed` accept the copy; they
        raise ValueError at flow speeds at which the configuration is no equilibrium. For a pipe
        that rests bent, they therefore apply at one speed only; `equilibrium_branch` finds where it
        loses stability. Without `about` they follow the rest to which the pipe comes as its loads,
        and then the flow, grow from zero.

        Args:
            q: the configuration, for instance one found by `equilibria`: its coordinates, or for a
                scene also the angles of its segments.

        Raises:
            ValueError, TypeError: for an array of a wrong shape or type, or one that misses a
            constraint.

        Example:
            >>> import pipedyn as pp
            >>> chain = pp.Chain(pp.Pipe(0.2, jet_angle=0.5), 8)
            >>> rest = pp.equilibria(chain, 4.0).q[0]
            >>> pp.eigenvalues(chain.about(rest), 4.0, 2).round(3)
            array([-4.371+4.899j, -4.371-4.899j])
        """
        other = self.with_pipe(self._pipe)
        other._reference = self._required_straight(self._coordinates(q))
        return other

    @property
    def _about_shown(self) -> str:
        rest = self._reference
        return f", about {check.shown(rest)}" if rest is not None and rest.any() else ""

    def unbalanced(self, u: float) -> float:
        """Largest force at rest, at the linearised configuration, over 1 + |gamma| + a u^2."""
        pipe, rest = self._pipe, self._reference
        size = 1.0 + abs(pipe.gamma) + pipe.alpha * u**2
        if rest is None:
            if pipe.rests_straight:
                return 0.0
            rest = np.zeros(self.integrated)
        turning = self.motion_rates(np.concatenate([rest, np.zeros_like(rest)]), u)[rest.size :]
        left = self.operators(rest).mass @ (self.free_directions(rest).T @ turning)
        return float(np.abs(left).max()) / size

    def require_equilibrium(self, *speeds: float) -> None:
        """Raises ValueError if the linearised configuration is no equilibrium at a speed."""
        if self._reference is None and self._pipe.rests_straight:
            return
        for u in speeds:
            rest = self.unbalanced(u)
            if rest > 1e-7:  # far above the residual of an equilibrium known to ten digits
                bent = ": a load across bends the straight pipe" if self._reference is None else ""
                raise ValueError(
                    f"the model must rest at u = {u:g} where it is linearised, got an unbalanced "
                    f"force of {rest:.1e}{bent}; choose about(q), q of equilibria(model, {u:g}), "
                    "or ask equilibrium_branch(model, q, u, speeds), whose points say where "
                    "stability is lost"
                )

    @abstractmethod
    def pencil(self) -> Any:
        """The pencil P(lambda) at any flow speed, in elastic coordinates, a `Pencil`."""

    @property
    @abstractmethod
    def core(self) -> Any:
        """The compiled model.

        Its equations of motion are for states [p, p'], shape (2 integrated,), or for k of them as
        columns; p are the coordinates that an integrator advances. With `works`, `rhs` takes [p,
        p', work done].
        """

    @property
    def calls_python(self) -> bool:
        """Whether the compiled equations of motion call functions written in Python."""
        return False

    @cached_property
    def equations(self) -> Any:
        """The compiled model, if its pipe has equations of motion in time.

        Raises:
            ValueError: with hysteresis, which is defined for harmonic oscillations only, or a term
                that acts in small motions alone.
        """
        self.require_large_motions()
        if self._pipe.hysteresis:
            raise ValueError(
                f"hysteresis must be 0 in motion, got {self._pipe.hysteresis:g}: a loss factor "
                "has no equation of motion; instead take damping=pipe.equivalent_damping(frequency)"
            )
        return self.core

    def require_large_motions(self, name: str = "model") -> None:
        """Raises ValueError for a pipe with a term that acts in small motions alone."""
        if reason := self._pipe.no_motion:
            raise ValueError(
                f"{name} must have terms that act in motions of any amplitude, and about bent "
                f"pipes, got {check.shown(self._pipe.terms)}: {reason}"
            )

    def _required_straight(self, rest: Array) -> Array:
        """The coordinates; ValueError if they are bent and one of the terms has no law there."""
        if rest.any():
            self.require_large_motions()
        return rest

    def operators(self, q: ArrayLike | None = None) -> Operators:
        """Seven linear operators in q, each (dof, dof), about a configuration at rest.

        The matrices mass, gyroscopic, end_flux and damping multiply q'' and q'; drag has no linear
        part at rest. stiffness is the derivative of the forces of bending, gravity and terms, flux
        that of the follower force. Small motions about q obey these operators if q is an
        equilibrium at the flow speed; elsewhere `jacobian` at rest also contains the derivative of
        the mass, -M^-1 (dM/dq q'').

        Args:
            q: coordinates, shape (dof,); default: the configuration of `about`, else the straight
                pipe, also if it does not rest there.

        Example:
            >>> chain = pp.Chain(pp.Pipe(0.2), n=2)
            >>> chain.operators().stiffness.round(3)
            array([[ 6., -2.],
                   [-2.,  2.]])

        Raises:
            ValueError: also for models with more than 4000 degrees of freedom.
        """
        self._check_dense()
        at = self._reference if q is None else self._required_straight(self._coordinates(q))

        def found(model: Self) -> Operators:
            core = model.core.operators() if at is None else model.core.operators(at)
            return operators_from(core, model.pipe)

        return self._with_loss(found)

    def _with_loss(self, of: Callable[[Self], Operators]) -> Operators:
        """The model's operators with hysteresis, mu dD/ddelta; damping D is linear in delta."""
        found = of(self)
        if not self._pipe.hysteresis:
            return found
        moved, step = self._stepped("damping")
        by_damping = step * (of(moved).damping - found.damping)
        return replace(found, loss=self._pipe.hysteresis * by_damping)

    def _stepped(self, number: str) -> tuple[Self, float]:
        """The model with a number of its pipe changed by 1 or -1 within its range; the change."""
        value = getattr(self._pipe, number)
        step = 1.0 if value < 1.0 else -1.0
        change: dict[str, Any] = {number: value + step}
        return self.with_pipe(replace(self._pipe, **change)), step

    @abstractmethod
    def elastic_operators(self) -> Operators:
        """Linear operators in elastic coordinates z, about the configuration at rest."""

    @abstractmethod
    def from_elastic(self, z: ArrayLike) -> NDArray[Any]:
        """Coordinates q, shape (dof, ...), from elastic coordinates of the same shape."""

    def rhs(
        self,
        t: float,
        y: ArrayLike,
        u: float | ArrayLike,
        *,
        u_dot: float | ArrayLike | None = None,
        base: ArrayLike | None = None,
    ) -> Array:
        """Rate of the state by geometrically exact equations, for any amplitude.

        The equations contain flow, gravity, bending, Kelvin-Voigt damping, quadratic drag and
        terms, each if the pipe has it. One call computes all k states with the processor's vector
        instructions. Several threads may call one model at the same time.

        Args:
            t: time; the result does not depend on it.
            y: state [q, q'], shape (2 c,) with c = `coordinates` (dof except for scenes), or (2 c,
                k) for k states; k may be 0.
            u: flow speed >= 0, in units of sqrt(EI / mu_f) / L; one number, or for k states also
                (k,).
            u_dot: rate of change of u, which accelerates the fluid along the pipe; a number, or for
                k states also (k,). Default: steady flow.
            base: position, velocity and acceleration of a moving base, each (x, y): shape (3, 2),
                or (3, 2, k) for k states; in three dimensions each (x, y, z). The base carries the
                clamp, all rigid supports and the axial support of the end (`Stretching`); q is
                measured from it. Drag and other terms belong to the ground, so that they depend on
                the base's motion. Default: at rest.

        Returns:
            dy/dt = [q', q''], of the same shape as y.

        Raises:
            NotResolved: for a state that the model or double precision does not resolve; the
                message gives the limit and the indices of these states among the k. `simulate`
                rejects a step to such a state.

        Example:
            >>> chain = pp.Chain(pp.Pipe(0.2), n=2)
            >>> chain.rhs(0.0, [0.1, 0.1, 0.0, 0.0], 4.0).round(3)
            array([ 0.   ,  0.   , -5.486,  8.229])
            >>> chain.rhs(0.0, np.zeros((4, 256)), 4.0).shape
            (4, 256)
        """
        steady = u_dot is None and base is None  # then a call of `_drive` is saved
        return self._rhs(t, y, u, None if steady else self._drive(y, u_dot, base))

    @cached_property
    def _rhs(self) -> Callable[..., Array]:
        """The compiled `rhs`, kept as looking it up takes a tenth of a call."""
        return self.equations.rhs

    @cached_property
    def _jacobian(self) -> Callable[..., Array]:
        """The compiled `jacobian`, kept like `_rhs`."""
        self._check_dense()
        return self.equations.jacobian

    def _drive(self, y: ArrayLike, u_dot: Any, base: Any) -> Array | None:
        """The drive in the core's form for states y, (ROWS,) or (ROWS, k); None without forcing.

        The other arguments are those of `rhs`.
        """
        if base is not None:
            self.require_base()
        if u_dot is None and base is None:
            return None
        columns = check.numbers("y", y, "an array of real numbers", longest=check.LONGEST).shape[1:]
        drive = np.zeros((ROWS, *columns))
        arguments = (("u_dot", u_dot, ()), ("base", base, (3, self.dimensions)))
        for name, given, shape in arguments:
            if given is None:
                continue
            values = check.doubles(name, given, "a real number or an array of them")
            shapes = dict.fromkeys((shape, (*shape, *columns)))
            if values.shape not in shapes:
                rule = f"have shape {' or '.join(map(str, shapes))}"
                raise ValueError(f"{name} must {rule}, got {values.shape}")
            each = np.atleast_1d(values)
            check.entries(name, each, np.isfinite(each), "be finite")
            if name == "u_dot":
                drive[0] = values
                continue
            values = values.reshape(*shape, *columns if values.ndim > 2 else (1,) * len(columns))
            drive[1:7].reshape(3, 2, *columns)[:] = values[:, :2]
            if self.dimensions == 3:
                drive[7:] = values[:, 2]
        return drive

    def require_base(self) -> None:
        """Raises ValueError if the model has no equations for a moving base."""

    def jacobian(
        self,
        t: float,
        y: ArrayLike,
        u: float | ArrayLike,
        *,
        u_dot: float | ArrayLike | None = None,
        base: ArrayLike | None = None,
    ) -> Array:
        """Derivative of `rhs` with respect to the state, analytic.

        Args:
            t: time; the result does not depend on it.
            y: state [q, q'], shape (2 c,), or (2 c, k) for k states of a chain or reduced model.
            u: flow speed >= 0, in units of sqrt(EI / mu_f) / L; one number, or for k states also
                (k,).
            u_dot: rate of change of u, as for `rhs`.
            base: motion of the base, as for `rhs`.

        Returns:
            d(dy/dt)/dy, shape (2 c, 2 c), or (k, 2 c, 2 c). The derivative of drag, d(|v| v) =
            2 |v| dv, is 0 where the velocity v is 0.

        Example:
            >>> chain = pp.Chain(pp.Pipe(0.2), n=2)
            >>> chain.jacobian(0.0, [0.1, 0.1, 0.0, 0.0], 4.0).round(2)
            array([[  0.  ,   0.  ,   1.  ,   0.  ],
                   [  0.  ,   0.  ,   0.  ,   1.  ],
                   [-13.71, -41.14,  -6.13,  -3.07],
                   [ 68.57,  13.71,   9.2 ,  -6.13]])

        Raises:
            NotResolved: as for `rhs`.
            ValueError: also for a chain with more than 4000 segments.
        """
        return self._jacobian(t, y, u, self._drive(y, u_dot, base))

    @property
    def integrated(self) -> int:
        """Number of coordinates p that an integrator advances."""
        return self.coordinates

    def initial_state(self, q0: ArrayLike, qdot0: ArrayLike | None) -> Array:
        """Initial state [p, p'], shape (2 integrated,), from the arguments of `simulate`."""
        size = self.coordinates
        given = np.zeros(size) if qdot0 is None else qdot0
        each = (("q0", q0), ("qdot0", given))
        return np.concatenate([self._rows(name, of, size) for name, of in each])

    def to_user(self, p: Array, pdot: Array) -> tuple[Array, Array]:
        """Coordinates and rates for users, (S, coordinates), from p and p', (S, integrated)."""
        q, rates = self.onto_constraints(p.T, pdot.T)
        return q.T, rates.T

    def from_user(self, q: Array, qdot: Array) -> Array:
        """States [p, p'], (S, 2 integrated), from users' q and qdot, (S, coordinates)."""
        return np.concatenate([q, qdot], axis=1)

    def _integrated_state(self, y: Any) -> Any:
        """States [p, p'] of an integrator, (2 integrated, ...), from users' states [q, q']."""
        return y

    def resting(self) -> Array:
        """Coordinates p of the configuration at rest, shape (integrated,)."""
        return np.zeros(self.integrated) if self._reference is None else self._reference

    @property
    def rests_bent(self) -> bool:
        """Whether the configuration chosen by `about` is not the straight pipe."""
        return self._reference is not None and bool(self._reference.any())

    def free_directions(self, p: Array) -> Array:
        """Basis of the changes of p that constraints allow at p, shape (integrated, dof)."""
        return np.eye(self.dof)

    def by_coordinates(self) -> Array:
        """Derivative of p at rest by the coordinates of `operators()`, shape (integrated, dof)."""
        return self.free_directions(self.resting())

    def onto_constraints(self, p: Array, rates: Array) -> tuple[Array, Array]:
        """Nearby p and rates that meet the constraints, (integrated, ...); NaN if none exist."""
        return p, rates

    def _alike(self, y: Array, other: Array) -> Array:
        """Another state [p, p', ...], by the equivalent coordinates that are nearest to y's."""
        return other

    def free_states(self, y: Array) -> Array:
        """Basis of the changes of [p, p'] that constraints allow, shape (2 integrated, 2 dof)."""
        return np.eye(2 * self.dof)

    @property
    def axisymmetric(self) -> bool:
        """Whether every motion turned about the axis is a motion; never so in a plane."""
        return False

    def from_plane(self, p: Array) -> Array:
        """Coordinates p, (integrated, ...), from those of `planar`: the same in a plane."""
        return p

    def into_plane(self, name: str, p: Array) -> Array:
        """Coordinates of `planar`, (integrated,), for p of the argument `name`; see `from_plane`.

        Raises:
            ValueError: if p does not lie in a plane in which `planar` moves.
        """
        return p

    def nearest_in_plane(self, p: Array) -> Array:
        """Coordinates of `planar`, (integrated,), nearest to p, which may be turned for that."""
        return p

    def lies_in_plane(self, p: Array) -> bool:
        """Whether coordinates p, (integrated,), lie in a plane in which `planar` moves."""
        return True

    def beyond_reach(self, x: Array) -> str:
        """Why the model has not the configuration x, (integrated,), of `planar`; empty if it has.

        In three dimensions joints of a chain and tangents of a reduced model turn by less than pi.
        """
        return ""

    def quarter_turn(self, p: Array) -> Array:
        """Coordinates, (integrated, ...), turned about the axis by a right angle, from x to z.

        Raises:
            ValueError: for a model that moves in a plane.
        """
        if self.dimensions == 2:
            raise ValueError(f"model must move in three dimensions, got {self!r}")
        x, z = np.split(p, 2)
        return np.concatenate([-z, x])

    def largest_angle(self, p: NDArray[Any]) -> float:
        """Largest angle of the pipe to first order in p, real or complex, of one or k states.

        The shape of p is (integrated,) or (integrated, k). The base class takes coordinates as
        angles.
        """
        return float(np.abs(p).max())

    def motion_rates(
        self, y: Array, u: float | Array, drive: Array | None = None, t: float = 0.0
    ) -> Array:
        """Rates of [p, p'], or of [p, p', W] with the work W done; shape (rows,) or (rows, k).

        They are NaN where the model does not resolve the state. drive: rows of the varying flow
        speed and the moving base, see `ROWS`, shape (ROWS,) or (ROWS, k).
        """
        works = len(y) > 2 * self.integrated
        return np.asarray(self.core.rhs(t, y, u, drive, refuses=False, works=works))

    def motion_jacobian(self, y: Array, u: float | Array, drive: Array | None = None) -> Array:
        """Jacobian of the rates of [p, p'], (2 integrated, 2 integrated), or k of them."""
        self._check_dense()
        return np.asarray(self.core.jacobian(0.0, y, u, drive, refuses=False))

    def motion_linearised(self, y: Array, u: float | Array, drive: Array | None = None) -> Array:
        """Rates of [p, p'] for k columns, with derivatives with respect to speed and state.

        The rows of the result, (k, 2 + 2 integrated, 2 integrated), are the rates, their derivative
        by the speed and the derivatives by [p, p'].
        """
        self._check_dense()
        return np.asarray(self.core.linearised(y, u, drive))

    def energy(self, y: ArrayLike, *, base: ArrayLike | None = None) -> float | Array:
        """Kinetic, elastic and gravitational energy in EI / L, 0 at rest on the straight pipe.

        The result is a number for a state y, shape (2 coordinates,), or has shape (k,) for states
        (2 coordinates, k). The energy is counted in the frame of the base, except that of springs
        fixed to the ground. base: as for `rhs`. Raises NotResolved as `rhs` does.

        Example:
            >>> chain = pp.Chain(pp.Pipe(0.2), n=2)
            >>> round(float(chain.energy([0.1, 0.0, 0.0, 0.0])), 12)  # of springs 4 and 2
            0.03
        """
        self.require_large_motions()
        return self.core.energy(self._integrated_state(y), drive=self._drive(y, None, base))

    def power(
        self,
        y: ArrayLike,
        u: float | ArrayLike,
        *,
        u_dot: float | ArrayLike | None = None,
        base: ArrayLike | None = None,
    ) -> Power:
        """Power of each kind of force, in EI / (L T); their total is dE/dt along the motion.

        Each entry of the result is a number or has shape (k,). States y are as for `energy`; flow
        speed u, u_dot and base are as for `rhs`. Raises NotResolved as `rhs` does.

        Example:
            >>> chain = pp.Chain(pp.Pipe(0.2), n=2)
            >>> chain.power([0.1, 0.1, 1.0, 1.0], 4.0)
            Power(flow=-1.788854, joints=0, drag=0, others=0)
        """
        drive = self._drive(y, u_dot, base)
        return Power(*self.equations.power(self._integrated_state(y), u, drive=drive))

    def shape(self, q: ArrayLike, s: ArrayLike) -> Array:
        """Centreline (x, y), inextensible at any amplitude: x is transverse, y points downward.

        Args:
            q: coordinates, shape (coordinates,).
            s: arc lengths from the clamp in L, each in [0, 1], shape (p,), or one number.

        Returns:
            Shape (p, 2), or (2,) for one arc length; in three dimensions (x, y, z), with one number
            more.

        Example:
            >>> chain = pp.Chain(pp.Pipe(0.2), n=2)
            >>> chain.shape([0.0, np.pi / 2.0], [0.0, 0.5, 1.0]).round(3)
            array([[0. , 0. ],
                   [0. , 0.5],
                   [0.5, 0.5]])
        """
        at, asked = arc_lengths(s)
        return self._centreline(q, at).reshape((*asked, self.dimensions))

    @abstractmethod
    def _centreline(self, q: ArrayLike, s: Array) -> Array:
        """The centreline of `shape` at arc lengths (p,), shape (p, dimensions)."""

    def deflection(self, q: ArrayLike, s: ArrayLike, derivative: int = 0) -> NDArray[Any]:
        """Transverse displacement to first order in q, about the configuration of linearisation.

        Args:
            q: displacement, real or complex, in the degrees of freedom of `operators`, shape (dof,)
                or (dof, k), or in the coordinates of a configuration as in `equilibria` and
                `simulate`, shape (coordinates,) or (coordinates, k); for a scene also the angles of
                its segments.
            s: arc lengths from the clamp in L, each in [0, 1], shape (p,), or one number.
            derivative: 0, or 1 for the pipe's angle of rotation, which is the slope of a straight
                pipe. A chain's angle is that of its segments at their middles; between them it is
                interpolated in proportion to the compliance passed, so linearly if the pipe is
                uniform.

        Returns:
            Shape (p,) or (p, k); for one number s, () or (k,). In three dimensions with an axis
            before these, of length 2, for x and z.

        Example:
            >>> chain = pp.Chain(pp.Pipe(0.2), n=2)
            >>> chain.deflection([0.1, 0.2], [0.5, 1.0]).round(6)
            array([0.05, 0.15])
        """
        at, asked = arc_lengths(s)
        order = check.count("derivative", derivative, low=0, high=1)
        given = self._columns("q", q, self.dof, self.integrated, self.coordinates)
        if given.ndim > 2:
            rule = f"({len(given)},) or ({len(given)}, k)"
            raise ValueError(f"q must have shape {rule}, got {given.shape}")
        columns = given.reshape(len(given), -1)
        if columns.shape[1] * at.size > check.LONGEST:
            raise ValueError(
                f"q and s must ask for at most {check.LONGEST} numbers, got {columns.shape[1]} "
                f"columns of q at {at.size} points"
            )
        found = self._deflected(self._moved(columns), at, order)
        return found.reshape((*found.shape[:-2], *asked, *given.shape[1:]))

    @abstractmethod
    def _deflected(self, p: NDArray[Any], s: Array, derivative: int) -> NDArray[Any]:
        """The result of `deflection` for changes of p, (integrated, k), at arc lengths (p,).

        The shape is (p, k), or (2, p, k) in three dimensions.
        """

    def _moved(self, columns: NDArray[Any]) -> NDArray[Any]:
        """Changes of p, (integrated, k), from columns in any coordinates of `deflection`."""
        return columns

    def tips(self, q: ArrayLike) -> Array:
        """Positions (x, y) of the free end, (k, 2), for k configurations, (coordinates, k).

        In three dimensions they are (x, y, z), (k, 3). If the end is held across, they are
        positions of the pipe's point `Pipe.tip_place`.

        Example:
            >>> chain = pp.Chain(pp.Pipe(0.2), n=2)
            >>> chain.tips([[0.0, 0.1], [0.0, 0.1]]).round(3)
            array([[0.   , 1.   ],
                   [0.1  , 0.995]])
        """
        columns = self._configurations("q", q)
        return resolved("tips", lambda: self._free_ends(columns, columns), batch=True)[
            : self.dimensions
        ].T

    def tip_velocities(self, q: ArrayLike, qdot: ArrayLike) -> Array:
        """Velocities (x', y') of the points of `tips`, in L / T, exact, (k, 2), for k states.

        Coordinates q and their rates qdot have shape (coordinates, k) each.
        """
        columns, rates = self._configurations("q", q), self._configurations("qdot", qdot)
        if columns.shape != rates.shape:
            raise ValueError(f"qdot must have the shape of q, {columns.shape}, got {rates.shape}")
        return resolved("tip_velocities", lambda: self._free_ends(columns, rates), batch=True)[
            self.dimensions :
        ].T

    def curvatures(self, q: ArrayLike) -> Array:
        """Largest curvature |theta'(s)| along the pipe in 1 / L, (k,), for k configurations.

        For chains and scenes it is the largest moment of a joint's spring over the pipe's EI
        between the middles of the segments beside it. With springs by a rule that is the curvature
        averaged over that length; with springs of one's own, that of a pipe with such a moment.

        Args:
            q: coordinates, shape (coordinates, k).

        Example:
            >>> chain = pp.Chain(pp.Pipe(0.2), n=2)
            >>> chain.curvatures([[0.1, 0.0], [0.1, 0.3]])  # springs 4 and 2
            array([0.4, 0.6])
        """
        columns = self._configurations("q", q)
        few = max(1, 1_000_000 // self.stations.size)  # curvatures at once, 8 MB
        parts = range(0, columns.shape[1], few)
        bent = [np.abs(self._bending(columns[:, i : i + few])).max(axis=0) for i in parts]
        return np.concatenate(bent)

    @abstractmethod
    def _bending(self, q: Array) -> Array:
        """Curvatures at places along the pipe, (places, k), for k configurations."""

    def end_motion(self, y: Array) -> Array:
        """Positions and velocities for `tips` and `tip_velocities` at k states [p, p'].

        The shape is (2 dimensions, k).

        Raises NotResolved for states that the model does not resolve.
        """
        q, rates = self.to_user(y[: self.integrated].T, y[self.integrated :].T)
        return np.asarray(resolved("tips", lambda: self._free_ends(q.T, rates.T), batch=True))

    @abstractmethod
    def _free_ends(self, q: Array, qdot: Array) -> Array:
        """Positions and velocities for `tips` and `tip_velocities`, shape (2 dimensions, k).

        The arguments are not checked; they have shape (coordinates, k).
        """

    @property
    def kinks_known(self) -> bool:
        """Whether `kinks` is complete; not with drag all along the pipe, little at each point."""
        return self.pipe.drag == 0.0

    def kinks(self, p: Array, pdot: Array, drive: Array | None = None) -> Array:
        """Functions zero where derivatives of forces jump, (how many, k), at p (integrated, k).

        They are distances of the places of terms from the stops that they hit. drive: rows of the
        varying speed and moving base, (ROWS, k), needed if the base moves.
        """
        met = [(term.place or 0.0, x) for term in self.pipe.terms for x in term.kinks]
        if not met:
            return np.empty((0, p.shape[1]))
        places, where = np.array(met).T
        moved = 0.0 if drive is None else drive[1]
        return self._across(p, places) + moved - where[:, None]

    def stop_places(self) -> tuple[Array, Array, Array]:
        """How far the places of stops are displaced, and the gaps of the stops, (places,).

        The displacements are W sin(B p) at p, (integrated,); the first array is B, or empty if B is
        the identity, the second is W.
        """
        met = [(term.place or 0.0, abs(x)) for term in self.pipe.terms for x in term.kinks]
        places, gaps = np.array(sorted(set(met))).reshape(-1, 2).T
        return *self._displacing(places), gaps

    @abstractmethod
    def _displacing(self, places: Array) -> tuple[Array, Array]:
        """The matrices B and W of `stop_places`."""

    def _across(self, p: Array, s: Array) -> Array:
        """Transverse displacements at points on the pipe, (points, k), at p (integrated, k)."""
        configurations, _ = self.to_user(p.T, np.zeros_like(p.T))
        return np.stack([self.shape(q, s)[:, 0] for q in configurations], axis=1)

    @abstractmethod
    def bent(self, angle: Callable[[Array], ArrayLike]) -> Array:
        """Coordinates q, shape (dof,), of a bent pipe, so that all models can start from one shape.

        `angle` is a function theta(s), rad from the straight pipe, of arc lengths s; (p,) to (p,).
        """

    @abstractmethod
    def sampled(self, angle: Callable[[Array], ArrayLike]) -> Array:
        """Coordinates p, shape (integrated,), from angles or rates theta(s), as for `bent`.

        They need not meet supports.
        """

    @staticmethod
    def _angles(angle: Callable[[Array], ArrayLike], s: Array, name: str = "angle") -> Array:
        check.instance(name, angle, Callable, "a function of arc length")
        return check.array(f"{name}(s)", values_along(name, angle, s), size=s.size, **ANGLES)

    def tip(self, q: ArrayLike) -> Array:
        """Position (x, y), shape (2,), of the free end; of `Pipe.tip_place` if that is held across.

        Example:
            >>> chain = pp.Chain(pp.Pipe(0.2), n=2)
            >>> chain.tip([0.0, np.pi / 2.0]).round(3)
            array([0.5, 0.5])
        """
        return self.shape(q, [self.pipe.tip_place])[0]

    def _check_dense(self) -> None:
        if self.dof > DENSE_LIMIT:
            raise ValueError(
                f"dense operators need at most {DENSE_LIMIT} degrees of freedom, got {self.dof}; "
                "eigenvalues, modes and root_loci take larger chains with count="
            )

    def _coordinates(self, q: ArrayLike) -> Array:
        return self._rows("q", q, self.coordinates)

    @staticmethod
    def _rows(name: str, given: ArrayLike, *sizes: int) -> Array:
        """Checks coordinates of a configuration or their rates, of one of the sizes."""
        return check.array(name, given, size=sizes, **ANGLES)

    def _columns(self, name: str, given: ArrayLike, *sizes: int) -> NDArray[Any]:
        """Checks one or several columns of real or complex numbers, each of dof or a given size."""
        sizes = tuple(dict.fromkeys(sizes or (self.dof,)))
        columns = check.numbers(
            *(name, given, "an array of real or complex numbers"),
            kinds="iufc",
            longest=check.LONGEST,
        )
        if columns.ndim == 0 or columns.shape[0] not in sizes or columns.size == 0:
            listed = " or ".join(f"({size}, ...)" for size in sizes)
            raise ValueError(f"{name} must have shape {listed}, got {columns.shape}")
        check.entries(name, columns, np.isfinite(columns), "be finite")
        with np.errstate(over="ignore"):  # numbers may be wider than a double
            largest = np.maximum(np.abs(columns.real), np.abs(columns.imag)).astype(np.float64)
        rule = f"be at most {LARGEST_DISPLACEMENT:g} in size"
        check.entries(name, columns, largest <= LARGEST_DISPLACEMENT, rule)
        return columns

    def _configurations(self, name: str, given: ArrayLike) -> Array:
        """Checks coordinates of k configurations, shape (coordinates, k)."""
        columns = self._columns(name, given, self.coordinates)
        if columns.ndim != 2:
            raise ValueError(f"{name} must have shape ({self.coordinates}, k), got {columns.shape}")
        if columns.dtype.kind == "c":
            raise TypeError(f"{name} must be real, got complex numbers")
        return columns


class Configurations:
    """Base class of results with configurations `q`, (S, coordinates), of a `model`."""

    q: Array
    model: Model

    @property
    def curvature(self) -> Array:
        """Largest curvature |theta'(s)| along the pipe in 1 / L, shape (S,)."""
        return self.model.curvatures(self.q.T) if len(self.q) else np.empty(0)


def loses_energy(model: Model, u: float) -> bool:
    """Whether anything may take energy from motions at a flow speed, so that they end somewhere."""
    return bool(u or model.pipe.damping or model.pipe.drag or model.resisted)


def arc_lengths(s: ArrayLike) -> tuple[Array, tuple[int, ...]]:
    """Arc lengths, 0 <= s <= 1, (p,), and the shape of s: (p,), or () for one number."""
    one = isinstance(s, Real) or (isinstance(s, np.ndarray) and s.ndim == 0)
    at = check.array("s", [s] if one else s, low=0.0, high=1.0)
    return at, () if one else at.shape
