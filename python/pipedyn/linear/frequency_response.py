# SPDX-License-Identifier: MIT
"""Response of a pipe at rest to a harmonic force, moment or motion of its base.

With q = Re(x exp(i omega tau)) small motions obey P(i omega) x = f(omega), where P is the pencil of
the eigenvalue problem. The response is therefore a rational function of the frequency whose poles
are the eigenvalues, so that the eigenvalues show where it changes fast.

Small models are solved at each frequency. For larger models the solutions at a few frequencies span
a basis, in which the equations are solved at all other frequencies if their residual is small.
"""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import field, replace
from functools import cached_property, partial
from typing import Any, Literal, TypeAlias

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from pipedyn.linear.modes import largest_speed, roots_and_shapes
from pipedyn.linear.neutral import grows, growth
from pipedyn.linear.rest import at_rest
from pipedyn.models.base import BASE_ROWS, DENSE_LIMIT, ROWS, Model
from pipedyn.models.continuum import (
    SMALLEST,
    AnyModel,
    Continuum,
    Converged,
    checked_model,
    converged_answer,
    relative,
)
from pipedyn.models.drive import LETTERS, Letter, steady_speed
from pipedyn.models.terms import PointMass
from pipedyn.util import check
from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array, Complex
from pipedyn.util.counters import count_factorisations
from pipedyn.util.errors import NotConverged
from pipedyn.util.newton import zero_between
from pipedyn.util.parallel import one_thread
from pipedyn.util.result import FREQUENCY, Result, TableResult

Input: TypeAlias = "str | tuple[str, float]"
"""An input, the load or motion that drives the pipe: "base", ("force", s) or ("moment", s)."""

LARGEST_DIRECT = 64
"""Largest dof at which equations are solved at each frequency: 0.1 s for 1,000 frequencies."""

HIGHEST = 1e5
"""Largest frequency that is accepted: about that of the hundredth mode."""

RESONANCES = 4
"""Number of lowest resonances in the default range of frequencies."""

CLOSEST = 1e-9
"""Least distance of two chosen frequencies, relative to the highest frequency."""

MOST_FREQUENCIES = 50_000
"""Largest number of frequencies that are chosen: 200 modes with some 200 each."""

AXES: Array = np.eye(3)
"""Unit vectors along x, y and z."""

RESIDUAL = 1e-10
"""Residual, relative to the load or the solution, at which a basis has enough vectors."""


@saved_as("Resonance")
class Resonance(Result, units={"width": FREQUENCY}):
    """A peak of the frequency response.

    Attributes:
        frequency: angular frequency at which |response| is largest.
        height: |response| at that frequency; infinite without damping.
        width: half-power width, the distance of the two frequencies, one on each side, at which
            |response| is height / sqrt(2); NaN if it does not fall to that within the range.
    """

    frequency: float
    height: float
    width: float


@saved_as("FrequencyResponse", added=("direction",))
class FrequencyResponse(TableResult):
    """Complex amplitude of a displacement per unit amplitude of the input.

    Attributes:
        frequencies: angular frequencies omega, shape (F,); increasing if they were chosen.
        response: complex, shape (F,): an input Re(a exp(i omega tau)) moves the place of the output
            by Re(a * response * exp(i omega tau)). It is infinite at the frequency of an undamped
            mode.
        resonances: peaks between the lowest and the highest frequency, in rising order.
        poles: eigenvalues in the upper half plane up to 1.5 times the highest frequency, complex.
        stable: whether no eigenvalue has a positive real part; if one has, motions do not tend to
            this response.
        input: "base", ("force", s) or ("moment", s).
        output: arc length of the place whose displacement is the response.
        u: flow speed.
        model: the model, as given.
        size: number of degrees of freedom of the model that was solved.
        error: for `Continuum`, the largest change of the response from the basis before the last,
            relative to the response, less the change explained by a shift of the poles by 1e-11 of
            their size; 0 for other models.
        direction: direction of the load or motion, "x", "y" or "z", and of the response, which is
            along x for "y".

    Example:
        >>> found = pp.frequency_response(pp.Galerkin(pp.Pipe(0.2), 6), 4.0)
        >>> [round(peak.frequency, 3) for peak in found.resonances]
        [16.985, 56.157, 114.485]
    """

    frequencies: Array = field(repr=False)
    response: Complex = field(repr=False)
    resonances: tuple[Resonance, ...]
    poles: Complex = field(repr=False)
    stable: bool
    input: Input
    output: float
    u: float
    model: AnyModel
    size: int
    error: float
    direction: Letter = "x"

    def _columns(self) -> dict[str, Any]:
        return {
            "frequency": self.frequencies,
            "gain": np.abs(self.response),
            "phase": np.angle(self.response),
        }


def frequency_response(
    model: AnyModel,
    u: float,
    frequencies: ArrayLike | tuple[float, float] | None = None,
    *,
    input: Input = "base",
    output: Literal["tip"] | float = "tip",
    direction: Letter = "x",
    tolerance: float = 1e-3,
) -> FrequencyResponse:
    """Displacement of a place per unit harmonic force, moment or motion of the base.

    The pipe is at rest, straight or bent, as for `eigenvalues`.

    Args:
        model: chain, reduced model or scene up to 4000 degrees of freedom, or `Continuum`.
        u: flow speed >= 0, in sqrt(EI / mu_f) / L.
        frequencies: angular frequencies in 1 / T, each >= 0, in an array or list; or a range as a
            tuple (low, high), in which frequencies are chosen, including each peak, such that
            straight lines between neighbours meet the tolerance. Default: the range from 0 to a
            fifth above the fourth lowest resonance.
        input: "base", whose transverse displacement in L has unit amplitude; ("force", s), a
            transverse force in EI / L^2 at the arc length s; or ("moment", s), in EI / L. A moment
            on a chain is shared by the two segments whose middles are next to s, with more on the
            nearer one; its error is of second order in 1 / n, but of first order at a free end, as
            the jet leaves along the last segment, which does not bend further under it.
        output: arc length in L of the place whose transverse displacement is computed; "tip" is the
            free end, or `Pipe.tip_place` if that is held. If the base moves, the displacement is
            relative to the base.
        direction: direction of the load or of the base's motion, and of the displacement: "x", or
            for a model in three dimensions "z". If its pipe rests bent, that is across the plane of
            rest; a small load in one of the two directions causes no displacement in the other. A
            base may also move along "y", the straight pipe; the displacement is then along x, and
            a pipe that rests straight does not respond.
        tolerance: error of the lines between chosen frequencies, relative to |response| at the
            larger of their ends, in [1e-6, 0.1].

    Returns:
        FrequencyResponse, also if the pipe is unstable at u, as `stable` says.

    Raises:
        NotConverged: if the continuous pipe's response does not converge as the basis grows, or too
            many frequencies are needed.
        ValueError, TypeError: for arguments out of range or of a wrong type.

    Example:
        >>> import pipedyn as pp
        >>> pipe = pp.Continuum(pp.Pipe(beta=0.2))
        >>> found = pp.frequency_response(pipe, 4.0, [4.0])
        >>> complex(found.response[0].round(6))
        (0.435537-0.580465j)
    """
    checked = checked_model(model)
    if check.choice("direction", direction, LETTERS) == "z" and model.dimensions == 2:
        raise ValueError(
            f"direction must be 'x' or 'y' for a model that moves in a plane, got {direction!r}; "
            "take dimensions=3"
        )
    model = checked
    u = steady_speed("u", u, high=largest_speed(model))
    tolerance = check.real("tolerance", tolerance, low=1e-6, high=0.1)
    driven, place = checked_input(input), checked_output(output, model.pipe.tip_place)
    if direction == "y" and not isinstance(driven, str):
        raise ValueError("direction must be 'x' or 'z' for a force or a moment, got 'y'")
    if isinstance(model, Model) and model.dof > DENSE_LIMIT:
        raise ValueError(
            f"model must have at most {DENSE_LIMIT} degrees of freedom for frequency_response, "
            f"got {model.dof}"
        )
    given: Array | None = None
    low, high = 0.0, math.inf
    if isinstance(frequencies, tuple):
        if len(frequencies) != 2:
            raise ValueError(
                f"frequencies must be a tuple (low, high), got {check.shown(frequencies)}"
            )
        low, high = checked_range(frequencies)
    elif frequencies is not None:
        given = check.array("frequencies", frequencies, low=0.0, high=HIGHEST, longest=100_000)
        low, high = float(given.min()), float(given.max())
    asked = at_rest(_with_joint(model, driven), u)
    across = direction == "z" and model.dimensions == 3
    along = AXES[2 * across + (direction == "y")]
    poles, one, stable = _poles(asked, u, high, across)
    if high == math.inf:
        turning = np.sort(poles.imag[poles.imag > 0.0])
        if turning.size == 0:
            raise ValueError(f"frequencies must be given: at u = {u:g} no mode oscillates")
        high = 1.2 * float(turning[:RESONANCES][-1])

    def ask(one: Model) -> _Response:
        return _Response(at_rest(one, u), u, driven, place, across, along)

    first = ask(one)
    with one_thread(first.rows):
        grid = _grid(first, poles, low, high, tolerance)
    # Bases are compared at frequencies that resolve the response, whose slope shows shifts of
    # poles.
    at = np.unique(np.concatenate([grid, [] if given is None else given]))

    def question(one: Model) -> tuple[_Response, Complex]:
        response = ask(one)
        with one_thread(response.rows):
            return response, response(at)

    answer: Converged[tuple[_Response, Complex]] = converged_answer(
        asked,
        (u,),
        question,
        lambda a, b: _response_change(at, poles, a[1], b[1]),
        tolerance=1e-8,
        smallest=one.dof // (one.dimensions - 1),
    )
    response, values = answer.value
    with one_thread(response.rows):
        peaks = _resonances(response, poles, at, values)
        if given is None:
            at = np.unique(np.concatenate([at, [peak.frequency for peak in peaks]]))
        else:
            at = given
        values = response(at)
    for peak in peaks:
        if peak.height == math.inf:
            values[at == peak.frequency] = complex(math.inf, 0.0)
    return FrequencyResponse(
        frequencies=at,
        response=values,
        resonances=peaks,
        poles=poles[np.abs(poles) <= 1.5 * high],
        stable=stable,
        input=driven,
        output=place,
        u=u,
        model=model,
        size=answer.size,
        error=answer.error,
        direction=direction,
    )


# ----------------------------------------------------------------------------------- arguments


def checked_range(given: Any) -> tuple[float, float]:
    """The range (low, high) of an increasing sequence or array of frequencies, checked."""
    at = check.array("frequencies", given, low=0.0, high=HIGHEST, longest=100_000)
    if at.size < 2 or (np.diff(at) <= 0.0).any():
        raise ValueError(
            f"frequencies must be a range (low, high), low < high, got {check.shown(given)}"
        )
    return float(at[0]), float(at[-1])


def checked_input(given: Any) -> Input:
    """Checks that the argument `input` names a load or the base, and returns it."""
    if isinstance(given, tuple) and len(given) == 2:
        kind = check.choice("input[0]", given[0], ("force", "moment"))
        return kind, check.real("input[1]", given[1], low=0.0, high=1.0, open_low=True)
    said = "'base', ('force', s) or ('moment', s)"
    if check.instance("input", given, str, said) != "base":
        raise ValueError(f"input must be {said}, got {given!r}")
    return given


def checked_output(given: Any, tip: float) -> float:
    """Checks the argument `output`, and returns its arc length."""
    if isinstance(given, str):
        check.choice("output", given, ("tip",))
        return tip
    return check.real("output", given, low=0.0, high=1.0, open_low=True)


def _with_joint(model: AnyModel, driven: Input) -> AnyModel:
    """The continuous pipe with a joint of panels at the place of the load; other models unchanged.

    The third derivative jumps at a force and the curvature at a moment, so that the response would
    converge slowly without the joint.
    """
    if not isinstance(model, Continuum) or isinstance(driven, str) or driven[1] == 1.0:
        return model
    terms = (*model.pipe.terms, PointMass(driven[1], 0.0))
    return model.with_pipe(replace(model.pipe, terms=terms))


# ----------------------------------------------------------------------------- the equations


class _Response:
    """Response of one model at any frequencies, in elastic coordinates.

    The load is f(omega) = sum over j of (i omega)^j times column j of `loads`, (dof, 3). The
    equations are solved in a basis, which spans all coordinates of a small model. In three
    dimensions they are those of one plane, in which the load acts: of rest, or `across` it.
    along: direction of a moving base, shape (3,).
    """

    def __init__(
        self,
        model: Model,
        u: float,
        input: Input,
        output: float,
        across: bool = False,
        along: Array = AXES[0],
    ) -> None:
        self.model, self.pencil, self.u = model, model.pencil().planes()[across], u
        self.dof = self.pencil.dof
        self.rows = 1 if self.pencil.is_long else self.dof
        own = slice(across * self.dof, (1 + across) * self.dof)  # elastic coordinates of the plane
        self.loads = np.zeros((self.dof, 3))
        if isinstance(input, str):
            self.loads = _base_loads(model, u, along)[own]
        else:
            kind, place = input
            self.loads[:, 0] = _displacement(model, float(place), across, int(kind == "moment"))[
                own
            ]
        self.output = _displacement(model, output, across)[own]
        self._vectors = np.eye(self.dof, self.dof if self.dof <= LARGEST_DIRECT else 0)
        self._products = self.products(self._vectors)

    def __call__(self, at: Array) -> Complex:
        """Complex responses at frequencies `at`, each of shape (F,)."""
        powers = (1j * at) ** np.arange(3)[:, None]
        loads = self.loads @ powers
        while True:
            small = tuple(self._vectors.T @ product for product in self._products)
            x = _solutions(small, self._vectors.T @ self.loads, at)
            if self._vectors.shape[1] == self.dof:
                break
            finite = np.where(np.isinf(x), 0.0, x)
            missed = loads - sum(
                p @ (power * finite) for p, power in zip(self._products, powers, strict=True)
            )
            sizes = np.maximum(np.linalg.norm(loads, axis=0), np.linalg.norm(finite, axis=0))
            share = np.linalg.norm(missed, axis=0) / np.maximum(sizes, 1e-300)
            share[np.isinf(x).any(axis=0)] = 0.0  # frequency of an undamped mode
            worst = int(np.argmax(share))
            if share[worst] <= RESIDUAL:
                break
            if not self._extend_basis(self.solution(float(at[worst]))):
                raise NotConverged(
                    f"the response at a frequency of {at[worst]:g} leaves a residual of "
                    f"{share[worst]:.1e}"
                )
        return _output_displacement(self.output @ self._vectors, x)

    def _extend_basis(self, solution: Complex) -> bool:
        """Adds a solution to the basis; returns False if the solution was in its span already."""
        before = self._vectors.shape[1]
        for part in (solution.real, solution.imag):
            left = part / max(float(np.linalg.norm(part)), 1e-300)
            for _ in range(2):
                left = left - self._vectors @ (self._vectors.T @ left)
            size = float(np.linalg.norm(left))
            if size > 1e-13:
                self._vectors = np.column_stack([self._vectors, left / size])
        new = self.products(np.ascontiguousarray(self._vectors[:, before:]))
        self._products = tuple(map(np.column_stack, zip(self._products, new, strict=True)))
        return self._vectors.shape[1] > before

    @cached_property
    def _matrices(self) -> tuple[Array, ...]:
        return self.products(np.eye(self.dof))

    def products(self, x: NDArray[Any]) -> tuple[NDArray[Any], ...]:
        """Products of K, C and M with the columns of x, (dof, k): three arrays of that shape."""
        of, u = self.pencil, self.u
        stiffness: NDArray[Any] = of.stiffness(x) + of.pipe.alpha * u**2 * of.flux(x)
        if of.pipe.hysteresis:  # the sign is that for omega > 0
            stiffness = stiffness + 1j * of.pipe.hysteresis * of.by_damping(x)
        return stiffness, u * of.velocity(x) + of.damping(x), of.mass(x)

    def solution(self, omega: float) -> Complex:
        """Solution at one frequency, shape (dof,): by factorisation, or by GMRES for long chains.

        In elastic coordinates P is close to a multiple of the identity in all but the lowest modes,
        so that some 30 iterations suffice.
        """
        if not self.pencil.is_long:
            return _solutions(self._matrices, self.loads, np.array([omega]))[:, 0]
        powers = (1j * omega) ** np.arange(3)
        count_factorisations()

        def product(x: Complex) -> Complex:
            return np.asarray(sum(map(np.multiply, powers, self.products(x[:, None]))))[:, 0]

        size = self.pencil.dof
        operator = scipy.sparse.linalg.LinearOperator((size, size), product, dtype=np.complex128)
        answer, _ = scipy.sparse.linalg.gmres(
            *(operator, self.loads @ powers), rtol=0.1 * RESIDUAL, restart=min(size, 400), maxiter=3
        )
        return np.asarray(answer)


def _solutions(matrices: tuple[Array, ...], loads: Array, at: Array) -> Complex:
    """Solutions P^-1 f of dense K, C and M at frequencies `at`, shape (n, F).

    Solutions are infinite if P is singular, but 0 if the load is 0, as for a base at rest.
    """
    stiffness, damping, mass = matrices
    found = np.full((len(stiffness), at.size), math.inf, dtype=np.complex128)
    piece = max(1, 200_000 // max(len(stiffness) ** 2, 1))
    for begin in range(0, at.size, piece):
        some = slice(begin, begin + piece)
        powers = (1j * at[some, None]) ** np.arange(3)
        left = np.tensordot(powers, np.stack([stiffness, damping, mass]), 1)
        right = (powers @ loads.T)[..., None]
        count_factorisations(len(left))
        try:
            found[:, some] = np.linalg.solve(left, right)[..., 0].T
        except np.linalg.LinAlgError:
            for k in range(len(left)):
                with suppress(np.linalg.LinAlgError):
                    found[:, begin + k] = np.linalg.solve(left[k], right[k])[:, 0]
    found[:, ~(loads.any(axis=0) @ np.abs(1j * at) ** np.arange(3)[:, None] > 0.0)] = 0.0
    return found


def _output_displacement(output: Array, x: Complex) -> Complex:
    """Displacement of the output, (F,), in solutions (n, F): infinite with them unless always 0."""
    infinite = np.isinf(x).any(axis=0)
    found: Complex = np.asarray(output @ np.where(infinite, 0.0, x))
    found[infinite] = complex(math.inf, 0.0) if output.any() else 0.0
    return found


def base_solution(model: Model, u: float, omega: float, vector: Complex) -> Complex:
    """Complex coordinates q for a complex amplitude of the base, (3,), at a frequency, (dof,)."""
    parts = vector.real, vector.imag
    real, imaginary = (
        _solution_for(model, u, omega, _base_loads(model, u, part)) for part in parts
    )
    return np.asarray(model.from_elastic(real + 1j * imaginary), dtype=np.complex128)


def _solution_for(model: Model, u: float, omega: float, loads: Array) -> Complex:
    """Elastic coordinates for loads on all of them, (dof, 3), at a frequency, shape (dof,)."""
    found = []
    for across, own in enumerate(np.split(loads, model.dimensions - 1)):
        response = _Response(model, u, ("force", 1.0), 1.0, bool(across))
        response.loads = own
        found.append(response.solution(omega))
    return np.concatenate(found)


def harmonic_solution(model: Model, u: float, omega: float, numbers: Complex) -> Complex:
    """Complex coordinates q for numbers of applied forces that oscillate, shape (dof,).

    Args:
        model: the model on which forces act, see `Model.with_applied`.
        u: flow speed.
        omega: frequency, 0 for constant forces.
        numbers: complex amplitudes of the forces' numbers in a drive, shape (rows,).
    """
    drives = np.eye(numbers.size, ROWS + numbers.size, ROWS).T
    load = _drive_loads(model, u, drives) @ numbers
    plain = model.with_applied(())
    real, imaginary = (
        _solution_for(plain, u, omega, np.stack([part, 0.0 * part, 0.0 * part], axis=1))
        for part in (load.real, load.imag)
    )
    return np.asarray(model.from_elastic(real + 1j * imaginary), dtype=np.complex128)


def _displacement(model: Model, s: float, across: bool, derivative: int = 0) -> Array:
    """Row of the displacement at s, or of its slope, in elastic coordinates, shape (dof,).

    The displacement is along x, or `across` the plane of rest along z.
    """
    of_elastic = np.asarray(model.from_elastic(np.eye(model.dof)))
    found = model.deflection(of_elastic, [s], derivative)
    return found.reshape(-1, model.dof)[int(across)]


def _base_loads(model: Model, u: float, along: Array) -> Array:
    """Loads by position, velocity and acceleration of the base in a direction (3,), (dof, 3).

    The equations of motion at rest are linear in these. All resistance and stiffness fixed to the
    ground acts on the position and velocity of the base, and all mass on its acceleration.
    """
    model.require_base()
    drives = np.zeros((ROWS, 3))
    for order, rows in enumerate(BASE_ROWS):
        drives[rows, order] = along
    return _drive_loads(model, u, drives)


def _drive_loads(model: Model, u: float, drives: Array) -> Array:
    """Loads on elastic coordinates by k drives of the model at rest, (rows, k), shape (dof, k)."""
    if model.pipe.hysteresis:  # it is in no load, and equations of motion exclude it
        model = model.with_pipe(replace(model.pipe, hysteresis=0.0))
    rest, half = model.resting(), model.integrated
    still = np.concatenate([rest, np.zeros(half)])
    # The straight pipe at rest has no acceleration in which a tiny difference would be lost.
    h = 1e-6 if rest.any() else 1e-30
    states = np.stack([still] * drives.shape[1], axis=1)
    either = (model.motion_rates(states, u, way * h * drives)[half:] for way in (1.0, -1.0))
    accelerations = np.subtract(*either) / (2.0 * h)
    # The coordinates are independent: no singular value is due to rounding, so that none is cut
    # off.
    moved, *_ = np.linalg.lstsq(model.by_coordinates(), accelerations, rcond=0.0)
    forces = model.operators().mass @ moved
    return np.asarray(model.from_elastic(np.eye(model.dof))).T @ forces


# --------------------------------------------------------------------- frequencies that suffice


def _poles(model: AnyModel, u: float, high: float, across: bool) -> tuple[Complex, Model, bool]:
    """Eigenvalues in the upper half plane up to beyond a frequency, their model, and stability.

    In three dimensions they are those of motions in the plane of rest, or `across` it. The last
    value returned says whether no eigenvalue of either has a positive real part.
    """
    one, count, largest = model, 4 * RESONANCES + 4, 0
    if isinstance(model, Continuum):
        # Two thirds of the functions resolve modes; the k-th mode has a frequency near (k pi)^2.
        reached = 4.0 * RESONANCES if high == math.inf else math.sqrt(3.0 * high) / math.pi
        largest = math.ceil(1.5 * reached) + 8
        one = model.frozen(SMALLEST)
    assert isinstance(one, Model)
    while True:
        most = 2 * one.resolved_modes
        found = roots_and_shapes(one, u, min(count, most))
        values = found.eigenvalues[found.converged]
        own = values if found.across is None else values[found.across[found.converged] == across]
        turning = np.unique(np.abs(own[own.imag > 0.0]))
        if turning.size > RESONANCES if high == math.inf else (turning > 1.5 * high).any():
            break
        if count >= most:
            if not isinstance(model, Continuum) or one.dof >= largest * (one.dimensions - 1):
                break
            one = model.frozen(2 * one.dof // (one.dimensions - 1))
        count *= 2
    stable = not grows(values).any()
    return own[own.imag >= 0.0], one, stable


def _grid(response: _Response, poles: Complex, low: float, high: float, most: float) -> Array:
    """Frequencies between which straight lines err by at most the share `most` of the response."""
    if low == high:
        return np.array([low])
    around = np.concatenate([[0.0], np.geomspace(0.25, 64.0, 9)])
    widths = np.maximum(np.abs(poles.real), CLOSEST * 10.0 * high)
    near = np.abs(poles.imag)[:, None] + widths[:, None] * np.concatenate([-around, around])
    near = near[(near > low) & (near < high)]
    undamped = _undamped(poles)
    near = near[(np.abs(near[:, None] - undamped) > 0.5 * CLOSEST * high).all(axis=1)]
    at = np.unique(np.concatenate([np.linspace(low, high, 33), near]))
    values = response(at)
    left, right = np.arange(at.size - 1), np.arange(1, at.size)
    floor = 1e-6 * float(np.median(np.abs(values)))
    while left.size:
        if at.size > MOST_FREQUENCIES:
            raise NotConverged(f"the response needs more than {MOST_FREQUENCIES} frequencies")
        middle = 0.5 * (at[left] + at[right])
        there = response(middle)
        known = np.isfinite(values[left]) & np.isfinite(values[right]) & np.isfinite(there)
        before, after = (np.where(known, values[side], 0.0) for side in (left, right))
        size = np.maximum(np.maximum(np.abs(before), np.abs(after)), floor)
        missed = np.abs(np.where(known, there, math.inf) - 0.5 * (before + after))
        bad = (missed > most * size) & (at[right] - at[left] > 2.0 * CLOSEST * high)
        new = at.size + np.arange(middle.size)
        at, values = np.concatenate([at, middle]), np.concatenate([values, there])
        left, right = (
            np.concatenate([left[bad], new[bad]]),
            np.concatenate([new[bad], right[bad]]),
        )
    return np.sort(at)


def _undamped(poles: Complex) -> Array:
    """Frequencies of the poles that lie on the imaginary axis."""
    return poles.imag[growth(poles) == 0.0]


def _response_change(at: Array, poles: Complex, before: Complex, after: Complex) -> float:
    """Largest relative change of the response, less that by shifts of the poles by 1e-11."""
    size = np.maximum(np.abs(after), 1e-6 * float(np.median(np.abs(after))))
    size[size == 0.0] = 1.0  # the place is held
    shift = 1e-11 * np.abs(poles / (1j * at[:, None] - poles + 1e-300)).max(axis=1, initial=0.0)
    return relative(before / size, after / size, shift)


def _resonances(
    response: _Response, poles: Complex, at: Array, values: Complex
) -> tuple[Resonance, ...]:
    """Peaks of a response whose values are known at frequencies that resolve it."""
    sizes, undamped = np.abs(values), _undamped(poles)

    def above(omega: float, level: float) -> float:
        return float(abs(response(np.array([omega]))[0])) - level

    found = list[Resonance]()
    for omega in undamped[(undamped >= at[0]) & (undamped <= at[-1])].tolist():
        # From 1e-5 to 1e-6 of the frequency of a pole, the response grows tenfold, unless the mode
        # is not excited or does not move the output.
        far, near = np.abs(response(omega * (1.0 + np.array([1e-5, 1e-6]))))
        if near > 5.0 * far:
            found.append(Resonance(omega, math.inf, 0.0))
    for k in range(1, at.size - 1):
        close = np.abs(undamped - at[k]) < 1e-4 * at[k]
        if not sizes[k - 1] < sizes[k] >= sizes[k + 1] or close.any():
            continue
        peak = scipy.optimize.minimize_scalar(
            lambda omega: -above(omega, 0.0),
            bounds=(at[k - 1], at[k + 1]),
            method="bounded",
            options={"xatol": 1e-8 * at[k]},
        ).x
        height = above(peak, 0.0)
        level = math.sqrt(0.5) * height
        below = np.flatnonzero(sizes <= level)
        beside = *below[below < k][-1:], *below[below > k][:1]
        sides = [zero_between(partial(above, level=level), peak, at[j]) for j in beside]
        width = sides[1] - sides[0] if len(sides) == 2 else math.nan
        found.append(Resonance(float(peak), height, width))
    return tuple(sorted(found, key=lambda peak: peak.frequency))
