# SPDX-License-Identifier: MIT
"""
C++ core of pipedyn: operators, motion, eigenpairs of chains, reduced models, scenes.
"""

from __future__ import annotations
import collections.abc
import numpy
import numpy.typing
import typing

__all__: list[str] = [
    "Chain",
    "ChainSpectrum",
    "DenseOperator",
    "Galerkin",
    "GalerkinMotion",
    "LongOperator",
    "Operator",
    "Operators",
    "Pipe",
    "Scan",
    "Scene",
    "match",
    "most_on_a_panel",
    "scan",
    "set_vector_level",
    "sincos",
    "unstable",
    "vector_level",
    "vector_levels",
]

class Pipe:
    def __init__(
        self,
        beta: typing.SupportsFloat | typing.SupportsIndex,
        gamma: typing.SupportsFloat | typing.SupportsIndex,
        centrifugal: typing.SupportsFloat | typing.SupportsIndex,
        drag: typing.SupportsFloat | typing.SupportsIndex,
        damping: typing.SupportsFloat | typing.SupportsIndex,
        aspirating: bool,
        terms: collections.abc.Sequence[
            tuple[
                str,
                typing.SupportsFloat | typing.SupportsIndex,
                collections.abc.Sequence[typing.SupportsFloat | typing.SupportsIndex],
            ]
        ] = [],
    ) -> None: ...
    @property
    def direction(self) -> float: ...
    @property
    def resisted(self) -> bool: ...

class Operators:
    @property
    def damping(self) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, n]"]: ...
    @property
    def end_flux(self) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, n]"]: ...
    @property
    def flux(self) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, n]"]: ...
    @property
    def gyroscopic(self) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, n]"]: ...
    @property
    def mass(self) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, n]"]: ...
    @property
    def stiffness(self) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, n]"]: ...

class Chain:
    band_width: typing.ClassVar[int] = 4
    def __init__(
        self,
        pipe: Pipe,
        length: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, 1]"],
        center: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, 1]"],
        gyration_radius: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, 1]"],
        spring: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, 1]"],
        drag_point: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, 1]"],
        base: typing.SupportsFloat | typing.SupportsIndex,
    ) -> None: ...
    def band(
        self,
        lambda_: complex | typing.SupportsComplex | typing.SupportsFloat | typing.SupportsIndex,
        u: typing.SupportsFloat | typing.SupportsIndex,
    ) -> typing.Annotated[numpy.typing.NDArray[numpy.complex128], "[m, n]"]: ...
    def bodies(self) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, n]"]: ...
    def energy(self, y: typing.Any) -> float | numpy.typing.NDArray[numpy.float64]: ...
    def flux_times(
        self, x: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, n]"]
    ) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, n]"]: ...
    def gravity_times(
        self, x: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, n]"]
    ) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, n]"]: ...
    def jacobian(
        self, t: typing.Any, y: typing.Any, u: typing.Any
    ) -> numpy.typing.NDArray[numpy.float64]: ...
    def joint_operators(
        self, scale: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, 1]"]
    ) -> Operators: ...
    def mass_times(
        self, x: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, n]"]
    ) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, n]"]: ...
    def operators(
        self, angles: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, 1]"] = ...
    ) -> Operators: ...
    def power(
        self, y: typing.Any, u: typing.Any
    ) -> tuple[
        float | numpy.typing.NDArray[numpy.float64],
        float | numpy.typing.NDArray[numpy.float64],
        float | numpy.typing.NDArray[numpy.float64],
        float | numpy.typing.NDArray[numpy.float64],
    ]: ...
    def resistances(self) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, n]"]: ...
    def rhs(
        self, t: typing.Any, y: typing.Any, u: typing.Any
    ) -> numpy.typing.NDArray[numpy.float64]: ...
    def rhs_and_power(
        self, t: typing.Any, y: typing.Any, u: typing.Any
    ) -> numpy.typing.NDArray[numpy.float64]: ...
    def terms_damping_times(
        self, x: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, n]"]
    ) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, n]"]: ...
    def terms_stiffness_times(
        self, x: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, n]"]
    ) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, n]"]: ...
    def velocity_times(
        self, x: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, n]"]
    ) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, n]"]: ...

class Galerkin:
    def __init__(
        self,
        pipe: Pipe,
        legendre: bool,
        size: typing.SupportsInt | typing.SupportsIndex,
        joints: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, 1]"],
        more: typing.SupportsInt | typing.SupportsIndex,
        nodes: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, 1]"],
        weights: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, 1]"],
    ) -> None: ...
    def basis(
        self,
        s: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, 1]"],
        derivative: typing.SupportsInt | typing.SupportsIndex,
    ) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, n]"]: ...
    def elastic_stiffness(
        self,
    ) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, 1]"]: ...
    def operators(self) -> Operators: ...
    def term_stiffness(self) -> float: ...

class GalerkinMotion:
    def __init__(
        self,
        pipe: Pipe,
        legendre: bool,
        size: typing.SupportsInt | typing.SupportsIndex,
        joints: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, 1]"] = ...,
        more: typing.SupportsInt | typing.SupportsIndex = 0,
        least_nodes: typing.SupportsInt | typing.SupportsIndex = 0,
    ) -> None: ...
    def energy(self, y: typing.Any) -> float | numpy.typing.NDArray[numpy.float64]: ...
    def jacobian(
        self, t: typing.Any, y: typing.Any, u: typing.Any
    ) -> numpy.typing.NDArray[numpy.float64]: ...
    def nodes(
        self, q: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, 1]"]
    ) -> int: ...
    def operators(
        self, q: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, 1]"]
    ) -> Operators: ...
    def power(
        self, y: typing.Any, u: typing.Any
    ) -> tuple[
        float | numpy.typing.NDArray[numpy.float64],
        float | numpy.typing.NDArray[numpy.float64],
        float | numpy.typing.NDArray[numpy.float64],
        float | numpy.typing.NDArray[numpy.float64],
    ]: ...
    def rhs(
        self, t: typing.Any, y: typing.Any, u: typing.Any
    ) -> numpy.typing.NDArray[numpy.float64]: ...
    def rhs_and_power(
        self, t: typing.Any, y: typing.Any, u: typing.Any
    ) -> numpy.typing.NDArray[numpy.float64]: ...

class Operator:
    def assess(
        self,
        values: typing.Annotated[numpy.typing.ArrayLike, numpy.complex128],
        right: typing.Annotated[numpy.typing.ArrayLike, numpy.complex128],
        left: typing.Annotated[numpy.typing.ArrayLike, numpy.complex128] | None = None,
        residual: typing.Annotated[numpy.typing.ArrayLike, numpy.float64] | None = None,
        by_speed: typing.Annotated[numpy.typing.ArrayLike, numpy.complex128] | None = None,
    ) -> tuple[
        numpy.typing.NDArray[numpy.float64],
        numpy.typing.NDArray[numpy.float64],
        numpy.typing.NDArray[numpy.complex128],
        numpy.typing.NDArray[numpy.complex128],
        numpy.typing.NDArray[numpy.complex128],
    ]: ...
    def growth(
        self,
        values: typing.Annotated[numpy.typing.ArrayLike, numpy.complex128],
        right: typing.Annotated[numpy.typing.ArrayLike, numpy.complex128],
        left: typing.Annotated[numpy.typing.ArrayLike, numpy.complex128],
    ) -> tuple[numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.float64]]: ...
    def refine(
        self,
        value: complex | typing.SupportsComplex | typing.SupportsFloat | typing.SupportsIndex,
        right: typing.Annotated[numpy.typing.ArrayLike, numpy.complex128],
        left: typing.Annotated[numpy.typing.ArrayLike, numpy.complex128],
        steps: typing.SupportsInt | typing.SupportsIndex,
    ) -> tuple[
        complex,
        numpy.typing.NDArray[numpy.complex128],
        numpy.typing.NDArray[numpy.complex128],
        float,
        int,
    ]: ...

class DenseOperator(Operator):
    def __init__(
        self,
        mass: typing.Annotated[numpy.typing.ArrayLike, numpy.float64],
        velocity: typing.Annotated[numpy.typing.ArrayLike, numpy.float64],
        stiffness: typing.Annotated[numpy.typing.ArrayLike, numpy.float64],
        size: typing.SupportsFloat | typing.SupportsIndex,
    ) -> None: ...
    def inverse(
        self, shift: typing.SupportsFloat | typing.SupportsIndex, velocity_free: bool, left: bool
    ) -> tuple[
        numpy.typing.NDArray[numpy.complex128],
        numpy.typing.NDArray[numpy.complex128],
        numpy.typing.NDArray[numpy.complex128],
    ]: ...

class LongOperator(Operator):
    def __init__(
        self,
        multiply: typing.Any,
        solve: typing.Any,
        dof: typing.SupportsInt | typing.SupportsIndex,
        size: typing.SupportsFloat | typing.SupportsIndex,
    ) -> None: ...

class ChainSpectrum:
    def __init__(
        self, chain: Chain, scale: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, 1]"]
    ) -> None: ...
    def lowest(
        self,
        u: typing.SupportsFloat | typing.SupportsIndex,
        count: typing.SupportsInt | typing.SupportsIndex,
        vectors: bool,
    ) -> typing.Any: ...
    def near(
        self,
        u: typing.SupportsFloat | typing.SupportsIndex,
        guess: complex | typing.SupportsComplex | typing.SupportsFloat | typing.SupportsIndex,
        steps: typing.SupportsInt | typing.SupportsIndex,
    ) -> tuple: ...

class Scan:
    @property
    def after(self) -> numpy.typing.NDArray[numpy.bool]: ...
    @property
    def clear(self) -> bool: ...
    @property
    def crossings(self) -> list[tuple[int, float, bool]]: ...
    @property
    def leaving(self) -> numpy.typing.NDArray[numpy.bool]: ...
    @property
    def roots(self) -> numpy.typing.NDArray[numpy.int64]: ...

class Scene:
    met: typing.ClassVar[float] = 1e-13
    return_rate: typing.ClassVar[float] = 10.0
    def __init__(
        self,
        pipe: Pipe,
        length: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, 1]"],
        center: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, 1]"],
        gyration_radius: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, 1]"],
        drag_point: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, 1]"],
        base: typing.SupportsFloat | typing.SupportsIndex,
        springs: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, n]"],
        constraints: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, n]"],
        inertia: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, n]"],
        flow: bool,
        drag: bool,
    ) -> None: ...
    def angle_rates(
        self, t: typing.Any, y: typing.Any, u: typing.Any
    ) -> numpy.typing.NDArray[numpy.float64]: ...
    def constraints(
        self, y: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, 1]"]
    ) -> tuple[
        numpy.typing.NDArray[numpy.float64],
        tuple[
            numpy.typing.NDArray[numpy.int64],
            numpy.typing.NDArray[numpy.int64],
            numpy.typing.NDArray[numpy.float64],
        ],
        numpy.typing.NDArray[numpy.float64],
        numpy.typing.NDArray[numpy.int64],
    ]: ...
    def energy(self, y: typing.Any) -> float | numpy.typing.NDArray[numpy.float64]: ...
    def force_derivatives(
        self,
        y: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, 1]"],
        u: typing.SupportsFloat | typing.SupportsIndex,
    ) -> tuple[
        tuple[
            numpy.typing.NDArray[numpy.int64],
            numpy.typing.NDArray[numpy.int64],
            numpy.typing.NDArray[numpy.float64],
        ],
        tuple[
            numpy.typing.NDArray[numpy.int64],
            numpy.typing.NDArray[numpy.int64],
            numpy.typing.NDArray[numpy.float64],
        ],
    ]: ...
    def forces(
        self,
        y: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, 1]"],
        u: typing.SupportsFloat | typing.SupportsIndex,
    ) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, 1]"]: ...
    def from_angles(
        self, theta: typing.Any, omega: typing.Any
    ) -> numpy.typing.NDArray[numpy.float64]: ...
    def hessians(
        self, q: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, 1]"]
    ) -> tuple[
        numpy.typing.NDArray[numpy.int64],
        numpy.typing.NDArray[numpy.int64],
        numpy.typing.NDArray[numpy.int64],
        numpy.typing.NDArray[numpy.float64],
    ]: ...
    def lacking(
        self, q: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, 1]"]
    ) -> int: ...
    def operators(
        self,
    ) -> dict[
        str,
        tuple[
            numpy.typing.NDArray[numpy.int64],
            numpy.typing.NDArray[numpy.int64],
            numpy.typing.NDArray[numpy.float64],
        ],
    ]: ...
    def power(
        self, y: typing.Any, u: typing.Any
    ) -> tuple[
        float | numpy.typing.NDArray[numpy.float64],
        float | numpy.typing.NDArray[numpy.float64],
        float | numpy.typing.NDArray[numpy.float64],
        float | numpy.typing.NDArray[numpy.float64],
    ]: ...
    def project(
        self,
        theta: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, n]"],
        omega: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, n]"],
    ) -> tuple[
        typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, n]"],
        typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, n]"],
        typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, 1]"],
    ]: ...
    def rhs(
        self, t: typing.Any, y: typing.Any, u: typing.Any, force: typing.Any = None
    ) -> numpy.typing.NDArray[numpy.float64]: ...
    def straight(self) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, 1]"]: ...
    @property
    def coordinates(self) -> int: ...

def match(
    left: typing.Any,
    right: typing.Any,
    tracked: typing.Annotated[numpy.typing.ArrayLike, numpy.int64],
    damping: typing.SupportsFloat | typing.SupportsIndex,
    radius: typing.SupportsFloat | typing.SupportsIndex,
    zero: typing.SupportsFloat | typing.SupportsIndex,
) -> tuple[
    numpy.typing.NDArray[numpy.int64],
    numpy.typing.NDArray[numpy.float64],
    numpy.typing.NDArray[numpy.int64],
    numpy.typing.NDArray[numpy.complex128],
    bool,
]: ...
def most_on_a_panel(
    size: typing.SupportsInt | typing.SupportsIndex,
    joints: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, 1]"],
    more: typing.SupportsInt | typing.SupportsIndex,
) -> int: ...
def scan(
    step: typing.Any,
    modes: typing.Annotated[numpy.typing.ArrayLike, numpy.int64],
    unstable: typing.Annotated[numpy.typing.ArrayLike, numpy.bool],
    resolved: typing.SupportsInt | typing.SupportsIndex,
    certain: typing.SupportsInt | typing.SupportsIndex,
    zero: typing.SupportsFloat | typing.SupportsIndex,
    conservative: bool,
) -> Scan: ...
def set_vector_level(name: str) -> None: ...
def sincos(
    x: typing.Annotated[numpy.typing.ArrayLike, numpy.float64],
) -> tuple[numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.float64]]: ...
def unstable(
    at: typing.Any,
    onto: typing.Annotated[numpy.typing.ArrayLike, numpy.int64],
    before: typing.Annotated[numpy.typing.ArrayLike, numpy.bool],
    zero: typing.SupportsFloat | typing.SupportsIndex,
) -> numpy.typing.NDArray[numpy.bool]: ...
def vector_level() -> str: ...
def vector_levels() -> list[str]: ...
