# SPDX-License-Identifier: MIT
"""What every model answers: its size, its operators, its motion and the line it draws."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import fields, replace
from functools import cached_property
from numbers import Real
from operator import attrgetter
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipedyn import _core
from pipedyn.models.drive import drive_of
from pipedyn.models.pencil import DensePencil, Pencil
from pipedyn.models.pipe import OWN_NUMBERS, Pipe
from pipedyn.models.profile import values_along
from pipedyn.util import check
from pipedyn.util.archive import Saved, saved_as
from pipedyn.util.check import Array
from pipedyn.util.errors import resolved
from pipedyn.util.power_iteration import largest_stretch
from pipedyn.util.result import Result
from pipedyn.util.units import POWER

BALANCED = 1e-8
"""Force that may be left at an equilibrium, in units of 1 + |gamma| + a u^2: in 11 searches of five
models Newton's method left 6e-16 at most."""

DENSE_LIMIT = 4000
"""Largest dof for which dense operators are made: seven matrices of 128 MB."""

LARGEST_RESULT = 1_000_000_000
"""Numbers in one result: 8 GB, and twice that if they are complex."""

COMPLEX_STEP = 1e-30
"""A complex step has no difference that cancels; its square is lost next to any number."""

LARGEST_DISPLACEMENT = 1e100
"""Coordinates of small displacements; their sums stay finite."""

LARGEST_ANGLE = 1e6
"""Coordinates of a shape; sine and cosine of greater angles lose their digits."""


@saved_as(
    "Operators", shapes={"n n": "mass gyroscopic end_flux damping stiffness flux unsteady loss"}
)
class Operators(Result):
    """Linear operators about a configuration at rest, each of shape (dof, dof).

    M q'' + C q' + K q = 0 with C = s u (gyroscopic + end_flux) + damping and
    K = stiffness + a u^2 flux + s u' unsteady, to which i loss comes where q ~ exp(lambda tau),
    Im lambda > 0. gyroscopic is skew and end_flux symmetric of rank one, about a bent pipe two;
    with unsteady they carry sqrt(beta), end_flux also `inflow_share`.

    Attributes:
        mass: M, symmetric and positive definite.
        gyroscopic: Coriolis part, skew.
        end_flux: flux through the free end, symmetric.
        damping: Kelvin-Voigt damping, symmetric; of a scene also what else resists velocities.
        stiffness: springs or bending, and gravity; symmetric unless a custom module is not.
        flux: centrifugal force and the end's follower force.
        unsteady: the fluid's acceleration in the pipe where the flow speed changes.
        direction: s, 1 ejecting and -1 aspirating.
        centrifugal: alpha.
        loss: hysteresis times the elastic stiffness; None without.

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

    @classmethod
    def restored(cls, fields: dict[str, Any]) -> Operators:
        """The operators of which a file kept this, if the two factors are of a pipe."""
        made = cls(**fields)
        if abs(made.direction) != 1.0 or not 0.0 <= made.centrifugal < math.inf:
            raise ValueError(
                "direction must be 1 or -1 and centrifugal >= 0, got "
                f"{made.direction:g} and {made.centrifugal:g}"
            )
        return made

    def at(self, u: float, u_dot: float = 0.0) -> tuple[Array, Array, NDArray[Any]]:
        """(M, C, K) at flow speed u >= 0 and its rate of change; with a loss K is complex.

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


@saved_as("Power", shapes={"k": "flow joints drag others base"})
class Power(
    Result, units=dict.fromkeys(("flow", "joints", "drag", "others", "base", "total"), POWER)
):
    """Rate of a state's energy by what does the work, each a number or, for k states, shape (k,).

    Attributes:
        flow: of the flow; at a steady speed all of it at the free end.
        joints: of Kelvin-Voigt damping, <= 0.
        drag: of quadratic drag, <= 0.
        others: of what is no part of a plain pipe.
        base: of the base's motion, in whose frame the energy is counted.
    """

    flow: float | Array
    joints: float | Array
    drag: float | Array
    others: float | Array
    base: float | Array = 0.0

    @property
    def total(self) -> float | Array:
        """dE/dt along the motion."""
        return self.flow + self.joints + self.drag + self.others + self.base


CORE_MATRICES = tuple(field.name for field in fields(Operators)[:7])
"""What the core answers of `Operators`, under its names."""


def operators_from(core: _core.Operators, pipe: Pipe, scale: Array | None = None) -> Operators:
    """The core's matrices, each times a scale (dof, dof), with the pipe's two flow factors."""
    matrices = {name: getattr(core, name) for name in CORE_MATRICES}
    if scale is not None:
        matrices = {name: scale * matrix for name, matrix in matrices.items()}
    return Operators(**matrices, direction=pipe.direction, centrifugal=pipe.alpha)


def projected(operators: Operators, basis: Array) -> Operators:
    """Operators in coordinates z, where the given ones are for basis z, shape (dof, r)."""
    matrices: dict[str, Any] = {
        name: basis.T @ of @ basis
        for name, of in vars(operators).items()
        if isinstance(of, np.ndarray)
    }
    return replace(operators, **matrices)


own_numbers = attrgetter(*OWN_NUMBERS)

UNIFORM = _core.Profile()
"""What does not vary along the pipe, as the core takes it."""


def core_pipe(pipe: Pipe) -> _core.Pipe:
    """The pipe's numbers as the core takes them."""
    return _core.Pipe(  # by place: names take as long as all the rest
        own_numbers(pipe),
        pipe.flow == "aspirating",
        [(t.law, t.place or 0.0, t.law_numbers(pipe.damping)) for t in pipe.terms],
        pipe.root_stiffness,
        pipe.end,
        pipe.supports,
        UNIFORM if pipe.stiffness is None else pipe.stiffness.core,
        UNIFORM if pipe.mass is None else pipe.mass.core,
    )


def checked_pipe(pipe: Any) -> Pipe:
    """The argument, if it is a pipe."""
    if not isinstance(pipe, Pipe):
        raise TypeError(f"pipe must be a Pipe, got {check.shown(pipe)}")
    return pipe


class OfPipe(Saved):
    """A pipe to be asked about, discretised or continuous. Immutable; pickles."""

    def __init__(self, pipe: Pipe) -> None:
        self._pipe = checked_pipe(pipe)

    @property
    def pipe(self) -> Pipe:
        """The pipe, with its terms."""
        return self._pipe

    @property
    def approximates_pipe(self) -> bool:
        """Whether the model tends to the continuous pipe as it grows."""
        return True

    @property
    def resisted(self) -> bool:
        """Whether velocities meet linear forces other than the flow's and Kelvin-Voigt damping."""
        return bool(self.pipe.terms) and core_pipe(self.pipe).resisted

    def __getstate__(self) -> dict[str, Any]:
        """All but what is computed at the first request and kept: compiled parts do not pickle."""
        kept = {name for name in self.__dict__ if hasattr(type(self), name)}
        return {name: value for name, value in self.__dict__.items() if name not in kept}

    def archived(self) -> dict[str, Any]:
        """What a file keeps of it, by the names of the constructor's arguments and others."""
        return {"pipe": self._pipe}

    def with_pipe(self, pipe: Pipe) -> Self:
        """A model of another pipe with this discretisation, if there is one, and its springs.

        Raises:
            ValueError: for a pipe that the model does not take, as when it is made; for another
                stiffness or mass along the pipe, which a discretisation follows; for supports that
                the configuration of `about` does not meet.
            TypeError: for what is no pipe.
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
        """Raises ValueError where the model does not take the pipe."""


class Model(OfPipe, ABC):
    """A pipe with a finite number of degrees of freedom. Immutable; models pickle.

    Besides the coordinates q that users see, each model has elastic coordinates z, in which the
    elastic energy is |z|^2 / 2: eigenvalues are computed there, where small ones survive rounding.

    Every method raises ValueError for an argument of another shape or out of range, NaN or infinity
    among its numbers, and TypeError for what is no number or array of real numbers.
    """

    def __init__(self, pipe: Pipe) -> None:
        super().__init__(pipe)
        self._reference: Array | None = None  # chosen by `about`; else the straight pipe

    def _check_pipe(self) -> None:
        if self._reference is not None:
            self._checked_reference(self._reference)

    def archived(self) -> dict[str, Any]:
        """What a file keeps of it, with the configuration that `about` chose."""
        return {**super().archived(), "reference": self._reference}

    def _checked_reference(self, q: Any) -> Array:
        """A configuration that `about` has kept, in all coordinates; else ValueError."""
        rule: dict[str, Any] = {"low": -LARGEST_ANGLE, "high": LARGEST_ANGLE}
        return check.array("reference", q, size=self.integrated, **rule)

    @property
    @abstractmethod
    def dof(self) -> int:
        """Number of degrees of freedom."""

    @property
    def coordinates(self) -> int:
        """Number of coordinates of a state; more than dof where something ties them."""
        return self.dof

    @property
    def coordinate_kind(self) -> str:
        """What p is, in words: models of one kind can go on from each other's states."""
        return f"angles of {self.integrated} segments"

    @property
    def matrix_rounding(self) -> float:
        """Share of its norm by which rounding may move a matrix; 0 if by that of its entries."""
        return 0.0

    def term_stiffness(self, pencil: Pencil) -> float:
        """Norm of what K has besides the elastic part; 0 of a uniform pipe without terms.

        From four products: measured, to 3 %, as the lowest modes feel most of it.
        """
        pipe = self.pipe
        varied = pipe.terms or pipe.stiffness or pipe.mass
        return self._stiffness_beside(pencil) if varied else 0.0

    @staticmethod
    def _stiffness_beside(pencil: Pencil) -> float:
        start = np.cos(np.arange(1.0, pencil.dof + 1.0))[:, None]
        return largest_stretch(lambda x: pencil.stiffness(x) - pencil.elastic(x), start, 4)

    def refined(self) -> Model | None:
        """A model of the pipe with half as many functions again, at least four more.

        None of a chain and a scene, whose segments are bodies in their own right.
        """
        return None

    @property
    def linear_cost(self) -> bool:
        """Whether a right-hand side and an eigenvalue cost O(dof), as of chains."""
        return False

    @property
    def elastic_share(self) -> Array:
        """Elastic stiffness by the elastic coordinates: 1 each, less where a joint has none."""
        return np.ones(self.dof)

    @property
    def resolved_modes(self) -> int:
        """How many modes, from the lowest, need tracking: all, or those that are the pipe's."""
        return self.dof

    @property
    def stations(self) -> Array:
        """Arc lengths among which the largest displacement of a mode is found."""
        return np.linspace(0.0, 1.0, max(201, 8 * min(self.dof, 500) + 1))

    def about(self, q: ArrayLike) -> Self:
        """A copy of the model whose linear questions are about another configuration at rest.

        `eigenvalues`, `modes`, `root_loci`, `crossings` and `critical_speed` take it; they refuse
        it at flow speeds at which the configuration is no equilibrium. So of a pipe that rests bent
        they answer at one speed; `equilibrium_branch` finds where it loses stability.

        Args:
            q: the configuration, one of those that `equilibria` finds: coordinates, of a scene also
                the angles of its segments.

        Raises:
            ValueError, TypeError: for what is no such array, or misses a constraint.

        Example:
            >>> import pipedyn as pp
            >>> chain = pp.Chain(pp.Pipe(0.2, jet_angle=0.5), 8)
            >>> rest = pp.equilibria(chain, 4.0).q[0]
            >>> pp.eigenvalues(chain.about(rest), 4.0, 2).round(3)
            array([-4.371+4.899j, -4.371-4.899j])
        """
        other = self.with_pipe(self._pipe)
        other._reference = self._coordinates(q)
        return other

    @property
    def _about_shown(self) -> str:
        rest = self._reference
        return f", about {check.shown(rest)}" if rest is not None and rest.any() else ""

    def unbalanced(self, u: float) -> float:
        """Largest force at rest where the model is linearised, relative to 1 + |gamma| + a u^2."""
        pipe, thrust = self.pipe, self.pipe.alpha * u**2
        size, rest = 1.0 + abs(pipe.gamma) + thrust, self._reference
        if rest is None:  # nothing but an inclined jet bends the straight pipe
            return pipe.thrust_across * u**2 / size
        turning = self.motion_rates(np.concatenate([rest, np.zeros_like(rest)]), u)[rest.size :]
        left = self.operators(rest).mass @ (self.free_directions(rest).T @ turning)
        return float(np.abs(left).max()) / size

    def require_equilibrium(self, *speeds: float) -> None:
        """Raises ValueError if the model cannot rest, where it is linearised, at a flow speed."""
        for u in speeds:
            rest = self.unbalanced(u)
            if rest > 1e-7:  # far above what an equilibrium to ten digits leaves
                bent = (
                    ""
                    if self._reference is not None
                    else (f": straight it does not with jet_angle = {self.pipe.jet_angle:.6g}")
                )
                raise ValueError(
                    f"the model must rest at u = {u:g} where it is linearised, got an unbalanced "
                    f"force of {rest:.1e}{bent}; choose about(q), q of equilibria(model, {u:g}), "
                    "or ask equilibrium_branch(model, q, u, speeds), whose points say where "
                    "stability is lost"
                )

    def pencil(self) -> Pencil:
        """P(lambda) at any flow speed, in elastic coordinates."""
        return DensePencil(self)

    @property
    @abstractmethod
    def core(self) -> Any:
        """The compiled model, which has the linear operators of the straight pipe."""

    @cached_property
    def motion(self) -> Any:
        """The compiled equations of motion.

        `rhs_and_power` takes [p, p', work done], shape (2 integrated + 1,) or of k states, with
        the coordinates p that an integrator advances; `energy` and `power` take states [q, q'].
        """
        return self.core

    @property
    def compiled(self) -> Any:
        """The compiled equations of motion; None if Python computes a part of them."""
        return self.motion

    @property
    def compiled_rates(self) -> Any:
        """What the core's integrators take: `compiled`, or a function.

        Of times (k,), states of k columns as `motion_rates` takes them, flow speeds (k,) and, if
        anything drives them, this, (ROWS, k).
        """
        whole = self.compiled
        if whole is not None:
            return whole
        return lambda t, y, u, drive=None: self.motion_rates(y, u, drive, t[0])

    @cached_property
    def equations(self) -> Any:
        """The compiled equations of motion, where the pipe has some.

        Raises:
            ValueError: with hysteresis, which is known of oscillations alone.
        """
        if self._pipe.hysteresis:
            raise ValueError(
                f"hysteresis must be 0 in motion, got {self._pipe.hysteresis:g}: a loss factor "
                "has no equation of motion; instead take damping=pipe.equivalent_damping(frequency)"
            )
        return self.motion

    def operators(self, q: ArrayLike | None = None) -> Operators:
        """Seven linear operators in q, each (dof, dof), about a configuration at rest.

        Mass, gyroscopic, end_flux and damping are what multiplies q'' and q' there; at rest drag
        has no linear part. stiffness is the derivative of the forces of bending, gravity and terms,
        flux that of the follower force. Small motions about q obey them where q is an equilibrium
        at the speed in question; elsewhere `jacobian` at rest has besides these the derivative of
        the mass, -M^-1 (dM/dq q'').

        Args:
            q: coordinates, shape (dof,); those of `about`, else the straight pipe, where not given.

        Example:
            >>> chain = pp.Chain(pp.Pipe(0.2), n=2)
            >>> chain.operators().stiffness.round(3)
            array([[ 6., -2.],
                   [-2.,  2.]])

        Raises:
            ValueError: also for more than 4000 degrees of freedom.
        """
        self._check_dense()
        at = self._reference if q is None else self._coordinates(q)

        def found(model: Self) -> Operators:
            core = model.core.operators() if at is None else model.motion.operators(at)
            return operators_from(core, model.pipe)

        return self._with_loss(found)

    def _with_loss(self, of: Callable[[Self], Operators]) -> Operators:
        """The model's operators, with what hysteresis adds: mu dD/ddelta, D being linear."""
        found, pipe = of(self), self._pipe
        if not pipe.hysteresis:
            return found
        step = 1.0 if pipe.damping < 1.0 else -1.0  # by which delta stays in its range
        moved = of(self.with_pipe(replace(pipe, damping=pipe.damping + step)))
        return replace(found, loss=pipe.hysteresis * step * (moved.damping - found.damping))

    @abstractmethod
    def elastic_operators(self) -> Operators:
        """Linear operators about rest in elastic coordinates z."""

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
        """Rate of the state, geometrically exact at any amplitude.

        Flow, gravity, bending, Kelvin-Voigt damping, quadratic drag and terms, each only where the
        pipe has it. A batch is one call; its members go through the processor's vectors together.
        Several threads may call one model at once.

        Args:
            t: time; nothing depends on it.
            y: state [q, q'], shape (2 c,) with c = `coordinates`, which is dof but for scenes, or
                (2 c, k) for k states; k may be 0.
            u: flow speed, in units of sqrt(EI / mu_f) / L, >= 0; for k states also one each, (k,).
            u_dot: its rate of change, which accelerates the fluid along the pipe; for k states also
                (k,). Steady where not given.
            base: where the base moves, its position, velocity and acceleration, (x, y) each, shape
                (3, 2), or (3, 2, k) for k states. The base carries the clamp, all that holds the
                pipe rigidly and what fixes its end axially (`Stretching`); q is counted from it.
                Drag and other terms see its motion: they rest on the ground. At rest where not
                given.

        Returns:
            dy/dt = [q', q''], of the shape of y.

        Raises:
            NotResolved: at a state that is beyond what the model or double precision resolves; says
                how far it does, and which of k states these are. Within `simulate` such a state is
                a step that is not taken.

        Example:
            >>> chain = pp.Chain(pp.Pipe(0.2), n=2)
            >>> chain.rhs(0.0, [0.1, 0.1, 0.0, 0.0], 4.0).round(3)
            array([ 0.   ,  0.   , -5.486,  8.229])
            >>> chain.rhs(0.0, np.zeros((4, 256)), 4.0).shape
            (4, 256)
        """
        if u_dot is None and base is None:
            return self._steady_rhs(t, y, u)
        return self.equations.rhs(t, y, u, drive=self._drive(y, u_dot, base))

    def _drive(self, y: ArrayLike, u_dot: Any, base: Any) -> Array | None:
        if base is not None:
            self.require_base()
        return drive_of(y, u_dot, base)

    def require_base(self) -> None:
        """Raises ValueError where it is not known what a moving base does to the model."""

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
            t: time; nothing depends on it.
            y: state [q, q'], shape (2 c,), or (2 c, k) for k states of a chain or reduced model.
            u: flow speed, in units of sqrt(EI / mu_f) / L, >= 0; for k states also one each, (k,).
            u_dot: its rate of change, as for `rhs`.
            base: its motion, as for `rhs`.

        Returns:
            d(dy/dt)/dy, shape (2 c, 2 c), or (k, 2 c, 2 c). Drag's share
            d(|v| v) = 2 |v| dv is 0 where v is.

        Example:
            >>> chain = pp.Chain(pp.Pipe(0.2), n=2)
            >>> chain.jacobian(0.0, [0.1, 0.1, 0.0, 0.0], 4.0).round(2)
            array([[  0.  ,   0.  ,   1.  ,   0.  ],
                   [  0.  ,   0.  ,   0.  ,   1.  ],
                   [-13.71, -41.14,  -6.13,  -3.07],
                   [ 68.57,  13.71,   9.2 ,  -6.13]])

        Raises:
            NotResolved: as for `rhs`.
            ValueError: also for more than 4000 segments of a chain.
        """
        if u_dot is None and base is None:
            return self._steady_jacobian(t, y, u)
        self._check_dense()
        return self.equations.jacobian(t, y, u, drive=self._drive(y, u_dot, base))

    # Kept, as finding these costs a tenth of a call.

    @cached_property
    def _steady_rhs(self) -> Callable[..., Array]:
        return self.equations.rhs

    @cached_property
    def _steady_jacobian(self) -> Callable[..., Array]:
        self._check_dense()
        return self.equations.jacobian

    @property
    def integrated(self) -> int:
        """Number of coordinates p that an integrator advances."""
        return self.coordinates

    def initial_state(self, q0: ArrayLike, qdot0: ArrayLike | None) -> Array:
        """[p, p'] to integrate from, shape (2 integrated,), of what `simulate` is given."""
        size = self.coordinates
        rule: dict[str, Any] = {"size": size, "low": -LARGEST_ANGLE, "high": LARGEST_ANGLE}
        q = check.array("q0", q0, **rule)
        rates = np.zeros(size) if qdot0 is None else check.array("qdot0", qdot0, **rule)
        return np.concatenate([q, rates])

    def to_user(self, p: Array, pdot: Array) -> tuple[Array, Array]:
        """Coordinates and rates for users, (S, coordinates), from those of p, (S, integrated)."""
        return p, pdot

    def from_user(self, q: Array, qdot: Array) -> Array:
        """States [p, p'], (S, 2 integrated), from coordinates and rates of users."""
        return np.concatenate([q, qdot], axis=1)

    def resting(self) -> Array:
        """Where p is at rest, shape (integrated,)."""
        return np.zeros(self.integrated) if self._reference is None else self._reference

    def free_directions(self, p: Array) -> Array:
        """Directions that constraints leave about a configuration, shape (integrated, dof)."""
        return np.eye(self.dof)

    def by_coordinates(self) -> Array:
        """Change of p at rest by each coordinate of `operators()`, shape (integrated, dof)."""
        return self.free_directions(self.resting())

    def onto_constraints(self, p: Array, rates: Array) -> tuple[Array, Array]:
        """What meets constraints close to p and its rates, (integrated, ...); NaN if nothing."""
        return p, rates

    def free_states(self, y: Array) -> Array:
        """Changes of [p, p'] that constraints leave, shape (2 integrated, 2 dof)."""
        return np.eye(2 * self.dof)

    def largest_angle(self, p: NDArray[Any]) -> float:
        """Largest angle of the pipe displaced by p, (integrated,), maybe complex; to first order.

        Coordinates are angles where a model says nothing else.
        """
        return float(np.abs(p).max())

    def motion_rates(
        self, y: Array, u: float | Array, drive: Array | None = None, t: float = 0.0
    ) -> Array:
        """Rates of [p, p'] or, with the work W done on them, of [p, p', W]; (rows,) or (rows, k).

        NaN where the model resolves none. drive: what drives them, see `pipedyn.models.drive`,
        (ROWS,) or (ROWS, k).
        """
        if len(y) > 2 * self.integrated:
            return np.asarray(self.motion.rhs_and_power(t, y, u, drive))
        if self.motion is self.core:  # which advances these, and needs no work for it
            return np.asarray(self.core.rhs(t, y, u, drive, refuses=False))
        work = np.zeros((1, *y.shape[1:]))
        rates: Array = self.motion.rhs_and_power(t, np.concatenate([y, work]), u, drive)
        return rates[:-1]

    def motion_jacobian(self, y: Array, u: float | Array, drive: Array | None = None) -> Array:
        """Derivative of the rates of [p, p'], (2 integrated, 2 integrated), or of k columns."""
        self._check_dense()
        return self.motion.jacobian(0.0, y, u, drive, refuses=False)

    def motion_linearised(self, y: Array, u: float | Array, drive: Array | None = None) -> Array:
        """Rates of [p, p'] of k columns, their derivatives by the speed and by [p, p'].

        One after the other, (k, 2 + 2 integrated, 2 integrated).
        """
        if self.motion is self.core:
            self._check_dense()
            return np.asarray(self.core.linearised(0.0, y, u, drive))
        step = np.where(np.asarray(u) > 0.0, 0.5 * np.asarray(u), 1.0)
        rates, faster, fastest = (self.motion_rates(y, u + k * step, drive) for k in range(3))
        by_speed = (4.0 * faster - fastest - 3.0 * rates) / (2.0 * step)  # of second degree
        slopes = self.motion_jacobian(y, u, drive)
        return np.concatenate([rates.T[:, None], by_speed.T[:, None], slopes], axis=1)

    def energy(self, y: ArrayLike, *, base: ArrayLike | None = None) -> float | Array:
        """Kinetic, elastic and gravity's energy in EI / L, 0 at rest on the straight pipe.

        A number for a state y, shape (2 coordinates,), or shape (k,) for k, (2 coordinates, k). It
        is counted in the frame of the base, but for what springs on the ground store. base: as for
        `rhs`, and as there raises NotResolved.

        Example:
            >>> chain = pp.Chain(pp.Pipe(0.2), n=2)
            >>> round(float(chain.energy([0.1, 0.0, 0.0, 0.0])), 12)  # of springs 4 and 2
            0.03
        """
        return self.motion.energy(y, drive=self._drive(y, None, base))

    def power(
        self,
        y: ArrayLike,
        u: float | ArrayLike,
        *,
        u_dot: float | ArrayLike | None = None,
        base: ArrayLike | None = None,
    ) -> Power:
        """What feeds and drains the energy, in EI / (L T): its total is dE/dt along the motion.

        By what does the work, each a number or shape (k,); states y as for `energy`, flow speed u,
        u_dot and base as for `rhs`, and as there raises NotResolved.

        Example:
            >>> chain = pp.Chain(pp.Pipe(0.2), n=2)
            >>> chain.power([0.1, 0.1, 1.0, 1.0], 4.0)
            Power(flow=-1.788854, joints=0, drag=0, others=0)
        """
        return Power(*self.equations.power(y, u, drive=self._drive(y, u_dot, base)))

    def shape(self, q: ArrayLike, s: ArrayLike) -> Array:
        """Centreline, inextensible at any amplitude: x transverse and y downward.

        Args:
            q: coordinates, shape (coordinates,).
            s: arc lengths from the clamp in L, each in [0, 1], shape (p,), or one, a number.

        Returns:
            Shape (p, 2), or (2,) for one arc length.

        Example:
            >>> chain = pp.Chain(pp.Pipe(0.2), n=2)
            >>> chain.shape([0.0, np.pi / 2.0], [0.0, 0.5, 1.0]).round(3)
            array([[0. , 0. ],
                   [0. , 0.5],
                   [0.5, 0.5]])
        """
        at, asked = arc_lengths(s)
        return self._centreline(q, at).reshape((*asked, 2))

    @abstractmethod
    def _centreline(self, q: ArrayLike, s: Array) -> Array:
        """What `shape` answers for arc lengths (p,), shape (p, 2)."""

    def deflection(self, q: ArrayLike, s: ArrayLike, derivative: int = 0) -> NDArray[Any]:
        """Transverse displacement to first order in q, from where the model is linearised.

        Args:
            q: displacement, real or complex, in the degrees of freedom of `operators`, shape (dof,)
                or (dof, k), or in the coordinates of a configuration, shape (coordinates,) or
                (coordinates, k), as those that `equilibria` and `simulate` give; of a scene also
                in the angles of its segments.
            s: arc lengths from the clamp in L, each in [0, 1], shape (p,), or one, a number.
            derivative: 0, or 1 for the angle by which the pipe turns there, the slope of a straight
                one; of a chain that of its segments in their middles, and between these in
                proportion to the compliance passed, that is linear if the pipe is uniform.

        Returns:
            Shape (p,) or (p, k); for one arc length () or (k,).

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
        if columns.shape[1] * at.size > LARGEST_RESULT:
            raise ValueError(
                f"q and s must ask for at most {LARGEST_RESULT} numbers, got {columns.shape[1]} "
                f"columns of q at {at.size} points"
            )
        return self._deflected(self._moved(columns), at, order).reshape((*asked, *given.shape[1:]))

    @abstractmethod
    def _deflected(self, p: NDArray[Any], s: Array, derivative: int) -> NDArray[Any]:
        """What `deflection` answers for changes of p, (integrated, k), and arc lengths (p,)."""

    def _moved(self, columns: NDArray[Any]) -> NDArray[Any]:
        """Changes of p, (integrated, k), for columns in any coordinates `deflection` takes."""
        return columns

    def tips(self, q: ArrayLike) -> Array:
        """Positions (x, y) of the free end, (k, 2), for k configurations, (coordinates, k).

        Of a pipe whose end is held across, of its place `Pipe.watched`.

        Example:
            >>> chain = pp.Chain(pp.Pipe(0.2), n=2)
            >>> chain.tips([[0.0, 0.1], [0.0, 0.1]]).round(3)
            array([[0.   , 1.   ],
                   [0.1  , 0.995]])
        """
        columns = self._configurations("q", q)
        return resolved("tips", lambda: self._tips(columns).T, batch=True).T

    def tip_velocities(self, q: ArrayLike, qdot: ArrayLike) -> Array:
        """Velocities (x', y') of what `tips` gives, in L / T, exact, (k, 2), for k states.

        Coordinates q and their rates have shape (coordinates, k) each.
        """
        columns, rates = self._configurations("q", q), self._configurations("qdot", qdot)
        if columns.shape != rates.shape:
            raise ValueError(f"qdot must have the shape of q, {columns.shape}, got {rates.shape}")
        moving = resolved("tip_velocities", lambda: self._tip_velocities(columns, rates).T, True)
        return moving.T

    def _tip_velocities(self, q: Array, qdot: Array) -> Array:
        step = COMPLEX_STEP / max(1.0, float(np.abs(qdot).max(initial=0.0)))
        return self._tips(q + 1j * step * qdot).imag / step

    @abstractmethod
    def _tips(self, q: NDArray[Any]) -> NDArray[Any]:
        """The positions, an analytic function of q, real or complex, (coordinates, k)."""

    @property
    def kinks_known(self) -> bool:
        """Whether `kinks` has all; not of drag that acts at many points, each with little of it."""
        return self.pipe.drag == 0.0

    def kinks(self, p: Array, pdot: Array, drive: Array | None = None) -> Array:
        """What changes sign where derivatives of forces jump, (how many, k), at p (integrated, k).

        How far the places of terms are from where they meet stops. drive: rows of what drives the
        states, (ROWS, k), where the base moves.
        """
        met = [(term.place or 0.0, x) for term in self.pipe.terms for x in term.kinks]
        if not met:
            return np.empty((0, p.shape[1]))
        places, where = np.array(met).T
        moved = 0.0 if drive is None else drive[1]
        return self._across(p, places) + moved - where[:, None]

    def _across(self, p: Array, s: Array) -> Array:
        """Transverse displacements at points on the pipe, (points, k), at p (integrated, k)."""
        configurations, _ = self.to_user(p.T, np.zeros_like(p.T))
        return np.stack([self.shape(q, s)[:, 0] for q in configurations], axis=1)

    @abstractmethod
    def bent(self, angle: Callable[[Array], ArrayLike]) -> Array:
        """Coordinates q, shape (dof,), of a bent pipe, so that all models may start the same.

        `angle` gives theta(s), rad from the straight pipe, of arc lengths s, shape (p,) to (p,).
        """

    @abstractmethod
    def sampled(self, angle: Callable[[Array], ArrayLike]) -> Array:
        """What integrators advance, shape (integrated,), of angles or rates theta(s) as for `bent`.

        Whether or not these meet supports.
        """

    @staticmethod
    def _angles(angle: Callable[[Array], ArrayLike], s: Array) -> Array:
        if not callable(angle):
            raise TypeError(f"angle must be a function of arc length, got {check.shown(angle)}")
        return check.array(
            "angle(s)",
            values_along("angle", angle, s),
            size=s.size,
            low=-LARGEST_ANGLE,
            high=LARGEST_ANGLE,
        )

    def tip(self, q: ArrayLike) -> Array:
        """Position (x, y) of the free end, shape (2,), or of `Pipe.watched` as for `tips`.

        Example:
            >>> chain = pp.Chain(pp.Pipe(0.2), n=2)
            >>> chain.tip([0.0, np.pi / 2.0]).round(3)
            array([0.5, 0.5])
        """
        return self.shape(q, [self.pipe.watched])[0]

    def _check_dense(self) -> None:
        if self.dof > DENSE_LIMIT:
            raise ValueError(
                f"dense operators need at most {DENSE_LIMIT} degrees of freedom, got {self.dof}; "
                "eigenvalues, modes and root_loci take larger chains with count="
            )

    def _coordinates(self, q: ArrayLike) -> Array:
        return check.array("q", q, size=self.coordinates, low=-LARGEST_ANGLE, high=LARGEST_ANGLE)

    def _columns(self, name: str, given: ArrayLike, *sizes: int) -> NDArray[Any]:
        """Numbers of one or several columns, real or complex, each of one of some sizes or dof."""
        sizes = tuple(dict.fromkeys(sizes or (self.dof,)))
        columns = check.numbers(
            *(name, given, "an array of real or complex numbers"),
            kinds="iufc",
            longest=LARGEST_RESULT,
        )
        if columns.ndim == 0 or columns.shape[0] not in sizes or columns.size == 0:
            listed = " or ".join(f"({size}, ...)" for size in sizes)
            raise ValueError(f"{name} must have shape {listed}, got {columns.shape}")
        check.entries(name, columns, np.isfinite(columns), "be finite")
        with np.errstate(over="ignore"):  # of numbers that are wider than a double
            largest = np.maximum(np.abs(columns.real), np.abs(columns.imag)).astype(np.float64)
        rule = f"be at most {LARGEST_DISPLACEMENT:g} in size"
        check.entries(name, columns, largest <= LARGEST_DISPLACEMENT, rule)
        return columns

    def _configurations(self, name: str, given: ArrayLike) -> Array:
        """Coordinates of k configurations, (coordinates, k)."""
        columns = self._columns(name, given, self.coordinates)
        if columns.ndim != 2:
            raise ValueError(f"{name} must have shape ({self.coordinates}, k), got {columns.shape}")
        if columns.dtype.kind == "c":
            raise TypeError(f"{name} must be real, got complex numbers")
        return columns


def arc_lengths(s: ArrayLike) -> tuple[Array, tuple[int, ...]]:
    """Points on the pipe, 0 <= s <= 1, (p,), and the shape of s: (p,), or () of a number."""
    one = isinstance(s, Real) or (isinstance(s, np.ndarray) and s.ndim == 0)
    at = check.array("s", [s] if one else s, low=0.0, high=1.0)
    return at, () if one else at.shape


def stored(name: str, doc: str) -> Any:
    """A property that hands out what the model stores under a private name."""
    return property(attrgetter(name), doc=doc)
