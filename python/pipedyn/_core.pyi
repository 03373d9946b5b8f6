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
    "AxisCrossing",
    "Chain",
    "Complement",
    "Eigenproblem",
    "Forms",
    "Galerkin",
    "Integrator",
    "LinearisedOrbit",
    "Member",
    "NearestPoint",
    "Operators",
    "Pairs",
    "PanelPencil",
    "Pipe",
    "Profile",
    "RootLoci",
    "SHIFT",
    "Scene",
    "Segments",
    "SpanRelation",
    "SpatialChain",
    "SpatialGalerkin",
    "Spectrum",
    "Structured",
    "Supply",
    "Sweep",
    "Truncated",
    "assignment",
    "crossings",
    "dense_limit",
    "ends",
    "exponentials",
    "gauss_nodes",
    "general_values",
    "in_first_chart",
    "interval_maps",
    "is_felt_by_small_motions",
    "orbit_states",
    "rounding",
    "set_vector_level",
    "stage_states",
    "vector_level",
    "vector_levels",
]

class Profile:
    def __call__(
        self, s: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, 1]"]
    ) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, 1]"]: ...
    @typing.overload
    def __init__(self) -> None: ...
    @typing.overload
    def __init__(
        self,
        ends: collections.abc.Sequence[typing.SupportsFloat | typing.SupportsIndex],
        series: collections.abc.Sequence[
            collections.abc.Sequence[typing.SupportsFloat | typing.SupportsIndex]
        ],
    ) -> None: ...

class Pipe:
    def __init__(
        self,
        numbers: collections.abc.Sequence[typing.SupportsFloat | typing.SupportsIndex],
        aspirating: bool,
        terms: collections.abc.Sequence[
            tuple[
                str,
                typing.SupportsFloat | typing.SupportsIndex,
                collections.abc.Sequence[typing.SupportsFloat | typing.SupportsIndex],
            ]
        ],
        root: typing.SupportsFloat | typing.SupportsIndex,
        end: str,
        supports: collections.abc.Sequence[typing.SupportsFloat | typing.SupportsIndex],
        stiffness: Profile,
        mass: Profile,
        root_across: typing.SupportsFloat | typing.SupportsIndex,
    ) -> None: ...
    @property
    def added_stiffness(self) -> tuple[float, float]: ...
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
    @property
    def unsteady(self) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, n]"]: ...

class Segments:
    def __init__(
        self,
        length: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, 1]"],
        center: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, 1]"],
        gyration_radius: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, 1]"],
        spring: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, 1]"],
        drag_point: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, 1]"],
        base: typing.SupportsFloat | typing.SupportsIndex,
        damping: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, 1]"] = ...,
        rest_moment: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, 1]"] = ...,
        mass: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, 1]"] = ...,
    ) -> None: ...

class Chain:
    def __init__(self, pipe: Pipe, segments: Segments) -> None: ...
    def bodies(self) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, n]"]: ...
    def guided(self, held: collections.abc.Sequence[bool]) -> Chain: ...
    def joint_times(
        self,
        x: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, n]"],
        stiffness: typing.SupportsFloat | typing.SupportsIndex = 0.0,
        damping: typing.SupportsFloat | typing.SupportsIndex = 0.0,
        mass: typing.SupportsFloat | typing.SupportsIndex = 0.0,
        velocity: typing.SupportsFloat | typing.SupportsIndex = 0.0,
        flux: typing.SupportsFloat | typing.SupportsIndex = 0.0,
        gravity: typing.SupportsFloat | typing.SupportsIndex = 0.0,
        by_damping: typing.SupportsFloat | typing.SupportsIndex = 0.0,
        unsteady: typing.SupportsFloat | typing.SupportsIndex = 0.0,
    ) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, n]"]: ...
    @property
    def elastic_scale(self) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, 1]"]: ...
    @property
    def joints(self) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, n]"]: ...
    @property
    def turns_freely(self) -> bool: ...

class Galerkin:
    def __init__(
        self,
        pipe: Pipe,
        legendre: bool,
        size: typing.SupportsInt | typing.SupportsIndex,
        joints: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, 1]"] = ...,
        more: typing.SupportsInt | typing.SupportsIndex = 0,
        least_nodes: typing.SupportsInt | typing.SupportsIndex = 0,
    ) -> None: ...
    def axial(
        self, y: typing.Any, drive: typing.Any = None
    ) -> numpy.typing.NDArray[numpy.float64]: ...
    def basis(
        self,
        s: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, 1]"],
        derivative: typing.SupportsInt | typing.SupportsIndex,
    ) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, n]"]: ...
    def elastic(self) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, n]"]: ...
    def elastic_stiffness(
        self,
    ) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, 1]"]: ...
    def energy(
        self, y: typing.Any, drive: typing.Any = None, refuses: bool = True
    ) -> float | numpy.typing.NDArray[numpy.float64]: ...
    def functions_by_panel(self) -> list[list[int]]: ...
    def held(self, y: typing.Any) -> numpy.typing.NDArray[numpy.float64]: ...
    def jacobian(
        self,
        t: typing.Any,
        y: typing.Any,
        u: typing.Any,
        drive: typing.Any = None,
        refuses: bool = True,
    ) -> numpy.typing.NDArray[numpy.float64]: ...
    def linearised(
        self, y: typing.Any, u: typing.Any, drive: typing.Any = None
    ) -> numpy.typing.NDArray[numpy.float64]: ...
    def most_on_a_panel(self) -> int: ...
    def nodes(
        self, q: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, 1]"]
    ) -> int: ...
    def operators(
        self, q: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, 1]"] = ...
    ) -> Operators: ...
    def power(
        self, y: typing.Any, u: typing.Any, drive: typing.Any = None
    ) -> tuple[
        float | numpy.typing.NDArray[numpy.float64],
        float | numpy.typing.NDArray[numpy.float64],
        float | numpy.typing.NDArray[numpy.float64],
        float | numpy.typing.NDArray[numpy.float64],
        float | numpy.typing.NDArray[numpy.float64],
    ]: ...
    def rhs(
        self,
        t: typing.Any,
        y: typing.Any,
        u: typing.Any,
        drive: typing.Any = None,
        refuses: bool = True,
        works: bool = False,
    ) -> numpy.typing.NDArray[numpy.float64]: ...
    def tips(self, y: typing.Any) -> numpy.typing.NDArray[numpy.float64]: ...
    @property
    def supports(self) -> int: ...

class SpatialGalerkin:
    def __init__(
        self,
        pipe: Pipe,
        legendre: bool,
        size: typing.SupportsInt | typing.SupportsIndex,
        joints: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, 1]"] = ...,
        more: typing.SupportsInt | typing.SupportsIndex = 0,
        least_nodes: typing.SupportsInt | typing.SupportsIndex = 0,
    ) -> None: ...
    def energy(
        self, y: typing.Any, drive: typing.Any = None, refuses: bool = True
    ) -> float | numpy.typing.NDArray[numpy.float64]: ...
    def jacobian(
        self,
        t: typing.Any,
        y: typing.Any,
        u: typing.Any,
        drive: typing.Any = None,
        refuses: bool = True,
    ) -> numpy.typing.NDArray[numpy.float64]: ...
    def linearised(
        self, y: typing.Any, u: typing.Any, drive: typing.Any = None
    ) -> numpy.typing.NDArray[numpy.float64]: ...
    def power(
        self, y: typing.Any, u: typing.Any, drive: typing.Any = None
    ) -> tuple[
        float | numpy.typing.NDArray[numpy.float64],
        float | numpy.typing.NDArray[numpy.float64],
        float | numpy.typing.NDArray[numpy.float64],
        float | numpy.typing.NDArray[numpy.float64],
        float | numpy.typing.NDArray[numpy.float64],
    ]: ...
    def rhs(
        self,
        t: typing.Any,
        y: typing.Any,
        u: typing.Any,
        drive: typing.Any = None,
        refuses: bool = True,
        works: bool = False,
    ) -> numpy.typing.NDArray[numpy.float64]: ...
    def tips(self, y: typing.Any) -> numpy.typing.NDArray[numpy.float64]: ...

class SpatialChain:
    def __init__(
        self,
        pipe: Pipe,
        segments: Segments,
        held: collections.abc.Sequence[typing.SupportsInt | typing.SupportsIndex] = [],
    ) -> None: ...
    def energy(
        self, y: typing.Any, drive: typing.Any = None, refuses: bool = True
    ) -> float | numpy.typing.NDArray[numpy.float64]: ...
    def jacobian(
        self,
        t: typing.Any,
        y: typing.Any,
        u: typing.Any,
        drive: typing.Any = None,
        refuses: bool = True,
    ) -> numpy.typing.NDArray[numpy.float64]: ...
    def linearised(
        self, y: typing.Any, u: typing.Any, drive: typing.Any = None
    ) -> numpy.typing.NDArray[numpy.float64]: ...
    def power(
        self, y: typing.Any, u: typing.Any, drive: typing.Any = None
    ) -> tuple[
        float | numpy.typing.NDArray[numpy.float64],
        float | numpy.typing.NDArray[numpy.float64],
        float | numpy.typing.NDArray[numpy.float64],
        float | numpy.typing.NDArray[numpy.float64],
        float | numpy.typing.NDArray[numpy.float64],
    ]: ...
    def rhs(
        self,
        t: typing.Any,
        y: typing.Any,
        u: typing.Any,
        drive: typing.Any = None,
        refuses: bool = True,
        works: bool = False,
    ) -> numpy.typing.NDArray[numpy.float64]: ...

class Pairs:
    def __init__(
        self,
        values: typing.Annotated[numpy.typing.ArrayLike, numpy.complex128, "[m, 1]"],
        right: typing.Annotated[numpy.typing.ArrayLike, numpy.complex128, "[m, n]"],
        left: typing.Annotated[numpy.typing.ArrayLike, numpy.complex128, "[m, n]"] = ...,
        residuals: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, 1]"] = ...,
    ) -> None: ...
    @property
    def converged(self) -> typing.Annotated[numpy.typing.NDArray[numpy.bool], "[m, 1]"]: ...
    @property
    def left(self) -> typing.Annotated[numpy.typing.NDArray[numpy.complex128], "[m, n]"]: ...
    @property
    def residuals(self) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, 1]"]: ...
    @property
    def right(self) -> typing.Annotated[numpy.typing.NDArray[numpy.complex128], "[m, n]"]: ...
    @property
    def slopes(self) -> typing.Annotated[numpy.typing.NDArray[numpy.complex128], "[m, 1]"]: ...
    @property
    def uncertain(self) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, 1]"]: ...
    @property
    def values(self) -> typing.Annotated[numpy.typing.NDArray[numpy.complex128], "[m, 1]"]: ...

class Forms:
    def __init__(
        self,
        mass: complex | typing.SupportsComplex | typing.SupportsFloat | typing.SupportsIndex,
        velocity: complex | typing.SupportsComplex | typing.SupportsFloat | typing.SupportsIndex,
        damping: complex | typing.SupportsComplex | typing.SupportsFloat | typing.SupportsIndex,
        flux: complex | typing.SupportsComplex | typing.SupportsFloat | typing.SupportsIndex,
        gravity: complex | typing.SupportsComplex | typing.SupportsFloat | typing.SupportsIndex,
        by_damping: complex | typing.SupportsComplex | typing.SupportsFloat | typing.SupportsIndex,
        springs: typing.Annotated[numpy.typing.ArrayLike, numpy.complex128, "[m, 1]"] = ...,
    ) -> None: ...
    @property
    def by_damping(self) -> complex: ...
    @property
    def damping(self) -> complex: ...
    @property
    def flux(self) -> complex: ...
    @property
    def gravity(self) -> complex: ...
    @property
    def mass(self) -> complex: ...
    @property
    def springs(self) -> typing.Annotated[numpy.typing.NDArray[numpy.complex128], "[m, 1]"]: ...
    @property
    def velocity(self) -> complex: ...

class AxisCrossing:
    @property
    def before(self) -> int: ...
    @property
    def change(self) -> int: ...
    @property
    def error(self) -> float: ...
    @property
    def frequency(self) -> float: ...
    @property
    def gyroscopic(self) -> bool: ...
    @property
    def mode(self) -> int: ...
    @property
    def slope(self) -> complex: ...
    @property
    def speed(self) -> float: ...
    @property
    def value(self) -> complex: ...
    @property
    def vectors(
        self,
    ) -> (
        tuple[
            typing.Annotated[numpy.typing.NDArray[numpy.complex128], "[m, n]"],
            typing.Annotated[numpy.typing.NDArray[numpy.complex128], "[m, n]"],
        ]
        | None
    ): ...

class Sweep:
    @property
    def crossings(self) -> list[AxisCrossing]: ...
    @property
    def failure(self) -> str: ...
    @property
    def untracked(self) -> bool: ...

class RootLoci:
    @property
    def converged(self) -> typing.Annotated[numpy.typing.NDArray[numpy.bool], "[m, n]"]: ...
    @property
    def errors(self) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, n]"]: ...
    @property
    def partners(self) -> typing.Annotated[numpy.typing.NDArray[numpy.complex128], "[m, n]"]: ...
    @property
    def values(self) -> typing.Annotated[numpy.typing.NDArray[numpy.complex128], "[m, n]"]: ...

class Spectrum:
    def factorisations(self) -> int: ...
    def forms(self, crossing: AxisCrossing) -> Forms | None: ...
    def root_loci(
        self,
        speeds: collections.abc.Sequence[typing.SupportsFloat | typing.SupportsIndex],
        count: typing.SupportsInt | typing.SupportsIndex,
        roots: typing.SupportsInt | typing.SupportsIndex,
        count_work: typing.Any,
        row_done: typing.Any = None,
    ) -> RootLoci | None: ...
    def set_without_loss(self, other: Spectrum) -> None: ...

class PanelPencil:
    @staticmethod
    def fits(model: Galerkin) -> bool: ...
    def __init__(self, model: Galerkin) -> None: ...
    def on_panels(
        self, q: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, n]"]
    ) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, n]"]: ...
    def times(
        self,
        x: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, n]"],
        stiffness: typing.SupportsFloat | typing.SupportsIndex = 0.0,
        damping: typing.SupportsFloat | typing.SupportsIndex = 0.0,
        mass: typing.SupportsFloat | typing.SupportsIndex = 0.0,
        velocity: typing.SupportsFloat | typing.SupportsIndex = 0.0,
        flux: typing.SupportsFloat | typing.SupportsIndex = 0.0,
        gravity: typing.SupportsFloat | typing.SupportsIndex = 0.0,
        by_damping: typing.SupportsFloat | typing.SupportsIndex = 0.0,
    ) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, n]"]: ...

class Eigenproblem(Spectrum):
    def __init__(
        self,
        traits: tuple[
            typing.SupportsInt | typing.SupportsIndex,
            typing.SupportsFloat | typing.SupportsIndex,
            typing.SupportsFloat | typing.SupportsIndex,
            bool,
            bool,
            bool,
            bool,
            typing.SupportsFloat | typing.SupportsIndex,
        ],
        matrices: typing.Annotated[
            collections.abc.Sequence[
                typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, n]"]
            ],
            "FixedSize(6)",
        ],
        end_coefficient: typing.SupportsFloat | typing.SupportsIndex,
        size: typing.SupportsFloat | typing.SupportsIndex,
        rounding: typing.SupportsFloat | typing.SupportsIndex = 0.0,
    ) -> None: ...
    def assess(self, u: typing.SupportsFloat | typing.SupportsIndex, pairs: Pairs) -> None: ...
    def by_recursion(
        self,
        u: typing.SupportsFloat | typing.SupportsIndex,
        count: typing.SupportsInt | typing.SupportsIndex,
        vectors: bool,
    ) -> Pairs | None: ...
    def lowest(
        self,
        u: typing.SupportsFloat | typing.SupportsIndex,
        count: typing.SupportsInt | typing.SupportsIndex,
        left: bool,
        high: bool,
    ) -> Pairs: ...
    def modes_at_rest(
        self,
    ) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, n]"] | None: ...

class Complement:
    def __init__(
        self, columns: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, n]"]
    ) -> None: ...
    def lifted(
        self, z: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, n]"]
    ) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, n]"]: ...
    def projected(
        self, x: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, n]"]
    ) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, n]"]: ...
    @property
    def dof(self) -> int: ...

class Structured(Eigenproblem):
    @typing.overload
    def __init__(
        self,
        traits: tuple[
            typing.SupportsInt | typing.SupportsIndex,
            typing.SupportsFloat | typing.SupportsIndex,
            typing.SupportsFloat | typing.SupportsIndex,
            bool,
            bool,
            bool,
            bool,
            typing.SupportsFloat | typing.SupportsIndex,
        ],
        chain: Chain,
        complement: Complement | None,
        size: typing.SupportsFloat | typing.SupportsIndex,
    ) -> None: ...
    @typing.overload
    def __init__(
        self,
        traits: tuple[
            typing.SupportsInt | typing.SupportsIndex,
            typing.SupportsFloat | typing.SupportsIndex,
            typing.SupportsFloat | typing.SupportsIndex,
            bool,
            bool,
            bool,
            bool,
            typing.SupportsFloat | typing.SupportsIndex,
        ],
        pencil: PanelPencil,
        lift: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, n]"],
        projection: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, n]"],
        size: typing.SupportsFloat | typing.SupportsIndex,
    ) -> None: ...
    def log_derivatives(
        self,
        u: typing.SupportsFloat | typing.SupportsIndex,
        values: typing.Annotated[numpy.typing.ArrayLike, numpy.complex128, "[m, 1]"],
    ) -> typing.Annotated[numpy.typing.NDArray[numpy.complex128], "[m, 1]"]: ...

class Truncated(Spectrum):
    def __init__(
        self,
        fewer: Structured,
        more: Structured,
        resolved: typing.SupportsInt | typing.SupportsIndex,
    ) -> None: ...
    def of_larger(
        self,
        sweep: Sweep,
        end: typing.SupportsFloat | typing.SupportsIndex,
        resolved: typing.SupportsInt | typing.SupportsIndex,
    ) -> Sweep | None: ...

class Scene:
    met: typing.ClassVar[float] = 1e-13
    return_rate: typing.ClassVar[float] = 60.0
    def __init__(
        self,
        pipe: Pipe,
        segments: Segments,
        held: collections.abc.Sequence[typing.SupportsInt | typing.SupportsIndex] = [],
        value: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, 1]"] = ...,
        inertia: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, n]"] = ...,
        customs: typing.Any = None,
    ) -> None: ...
    def angles(self, y: typing.Any) -> numpy.typing.NDArray[numpy.float64]: ...
    def axial(
        self, y: typing.Any, drive: typing.Any = None
    ) -> numpy.typing.NDArray[numpy.float64]: ...
    def derivative(
        self, y: typing.Any, u: typing.Any, drive: typing.Any = None
    ) -> numpy.typing.NDArray[numpy.float64]: ...
    def energy(
        self, y: typing.Any, drive: typing.Any = None, refuses: bool = True
    ) -> float | numpy.typing.NDArray[numpy.float64]: ...
    def free_accelerations(
        self, theta: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, 1]"]
    ) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, 1]"]: ...
    def jacobian(
        self,
        t: typing.Any,
        y: typing.Any,
        u: typing.Any,
        drive: typing.Any = None,
        refuses: bool = True,
    ) -> numpy.typing.NDArray[numpy.float64]: ...
    def linearised(
        self, y: typing.Any, u: typing.Any, drive: typing.Any = None
    ) -> numpy.typing.NDArray[numpy.float64]: ...
    def operators(
        self,
        angles: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, 1]"] = ...,
        joints: bool = True,
    ) -> Operators: ...
    def power(
        self, y: typing.Any, u: typing.Any, drive: typing.Any = None
    ) -> tuple[
        float | numpy.typing.NDArray[numpy.float64],
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
    def redundant(self, y: typing.Any) -> numpy.typing.NDArray[numpy.float64]: ...
    def redundant_rhs(
        self,
        t: typing.Any,
        y: typing.Any,
        u: typing.Any,
        drive: typing.Any = None,
        refuses: bool = True,
    ) -> numpy.typing.NDArray[numpy.float64]: ...
    def rhs(
        self,
        t: typing.Any,
        y: typing.Any,
        u: typing.Any,
        drive: typing.Any = None,
        refuses: bool = True,
        works: bool = False,
    ) -> numpy.typing.NDArray[numpy.float64]: ...
    @property
    def chain(self) -> Chain: ...
    @property
    def coordinates(self) -> int: ...

class Member:
    @property
    def evaluations(self) -> int: ...
    @property
    def progress(self) -> str: ...
    @property
    def samples(self) -> int: ...
    @property
    def time(self) -> float: ...

class Supply:
    def __init__(
        self,
        core: typing.Any,
        head: typing.SupportsFloat | typing.SupportsIndex,
        friction: typing.SupportsFloat | typing.SupportsIndex,
        weight: typing.SupportsFloat | typing.SupportsIndex,
        root_of_beta: typing.SupportsFloat | typing.SupportsIndex,
        direction: typing.SupportsFloat | typing.SupportsIndex,
    ) -> None: ...
    def rates(
        self,
        y: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, n]"],
        base: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, n]"] = ...,
    ) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, n]"]: ...

class Integrator:
    def __init__(
        self,
        of: typing.Any,
        u: typing.Any,
        start: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, n]"],
        t0: typing.SupportsFloat | typing.SupportsIndex,
        rtol: typing.Annotated[numpy.typing.ArrayLike, numpy.float64],
        atol: typing.Annotated[numpy.typing.ArrayLike, numpy.float64],
        most: typing.SupportsFloat | typing.SupportsIndex,
        max_step: typing.SupportsFloat | typing.SupportsIndex = ...,
        jacobian: typing.Any = None,
        supply: Supply | None = None,
        stops: tuple[
            typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, n]"],
            typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, n]"],
            typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, 1]"],
        ]
        | None = None,
    ) -> None: ...
    def advance(
        self,
        times: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, 1]"],
        out: numpy.typing.NDArray[numpy.float64],
        evaluations: typing.SupportsInt | typing.SupportsIndex,
        follow: bool = False,
    ) -> tuple[
        bool, list[float], list[typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, n]"]]
    ]: ...
    def state(
        self, member: typing.SupportsInt | typing.SupportsIndex
    ) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, 1]"]: ...
    def stop(self, member: typing.SupportsInt | typing.SupportsIndex) -> None: ...
    @property
    def members(self) -> list[Member]: ...

class SpanRelation:
    def __init__(
        self,
        maps: typing.Annotated[numpy.typing.ArrayLike, numpy.float64],
        most: typing.SupportsFloat | typing.SupportsIndex,
    ) -> None: ...
    def states(
        self,
        ends: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, n]"],
        loads: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, n]"],
    ) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, n]"]: ...
    @property
    def begins(self) -> list[int]: ...
    @property
    def first(self) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, n]"]: ...
    @property
    def known(self) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, n]"]: ...
    @property
    def last(self) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, n]"]: ...
    @property
    def products(self) -> numpy.typing.NDArray[numpy.float64]: ...

class LinearisedOrbit:
    def __init__(
        self,
        model: typing.Any,
        durations: typing.Annotated[numpy.typing.ArrayLike, numpy.float64],
        starts: typing.Annotated[numpy.typing.ArrayLike, numpy.float64],
        rates: typing.Annotated[numpy.typing.ArrayLike, numpy.float64],
        method: tuple[
            typing.Annotated[numpy.typing.ArrayLike, numpy.float64],
            typing.Annotated[numpy.typing.ArrayLike, numpy.float64],
            typing.Annotated[numpy.typing.ArrayLike, numpy.float64],
        ],
        frequency: typing.SupportsFloat | typing.SupportsIndex,
        mirror_sign: typing.SupportsFloat | typing.SupportsIndex,
        speeds: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, 1]"],
        drive: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, n]"] | None,
        by_frequency: typing.Annotated[numpy.typing.ArrayLike, numpy.float64] | None,
        speed_varies: bool,
        of_states: bool,
        forced: bool,
        most: typing.SupportsFloat | typing.SupportsIndex,
    ) -> None: ...
    def change(
        self,
        phase: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, 1]"],
        shift: typing.SupportsFloat | typing.SupportsIndex,
        row: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, 1]"],
        gap: typing.SupportsFloat | typing.SupportsIndex,
        share: typing.SupportsFloat | typing.SupportsIndex,
        turn: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, 1]"] = ...,
    ) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, 1]"]: ...
    def restored(
        self,
        ends: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, n]"],
        loads: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, n]"],
    ) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, n]"]: ...
    @property
    def by_rates(self) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, n]"]: ...
    @property
    def maps(self) -> numpy.typing.NDArray[numpy.float64]: ...
    @property
    def span(self) -> SpanRelation: ...
    @property
    def unit(self) -> float: ...

class NearestPoint:
    def __call__(
        self,
        states: typing.Annotated[numpy.typing.ArrayLike, numpy.float64],
        most: typing.SupportsFloat | typing.SupportsIndex,
    ) -> tuple[numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.int64]]: ...
    def __init__(
        self,
        points: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, n]"],
        once: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, n]"] = ...,
        twice: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, n]"] = ...,
    ) -> None: ...

def assignment(
    cost: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, n]"],
) -> list[int]: ...
def crossings(
    spectra: collections.abc.Sequence[Spectrum],
    ranges: collections.abc.Sequence[
        tuple[
            typing.SupportsFloat | typing.SupportsIndex,
            typing.SupportsFloat | typing.SupportsIndex,
            typing.SupportsInt | typing.SupportsIndex,
            typing.SupportsInt | typing.SupportsIndex,
            typing.SupportsInt | typing.SupportsIndex,
            typing.SupportsInt | typing.SupportsIndex,
            bool,
        ]
    ],
    count_work: typing.Any,
) -> list[Sweep]: ...
def ends(
    angles: typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, n]"],
    rates: typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, n]"],
    lengths: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, 1]"],
) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, n]"]: ...
def exponentials(
    exponents: typing.Annotated[numpy.typing.ArrayLike, numpy.float64],
) -> numpy.typing.NDArray[numpy.float64]: ...
def gauss_nodes(
    count: typing.SupportsInt | typing.SupportsIndex,
) -> tuple[
    typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, 1]"],
    typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, 1]"],
]: ...
def general_values(
    a: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, n]"],
    b: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, n]"],
) -> typing.Annotated[numpy.typing.NDArray[numpy.complex128], "[m, 1]"]: ...
def in_first_chart(
    states: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, n]"],
    signs: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, n]"],
) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, n]"]: ...
def interval_maps(
    rows: typing.Annotated[numpy.typing.ArrayLike, numpy.float64],
    durations: typing.Annotated[numpy.typing.ArrayLike, numpy.float64],
    parts: collections.abc.Sequence[typing.SupportsInt | typing.SupportsIndex],
    begins: collections.abc.Sequence[typing.SupportsInt | typing.SupportsIndex],
    unit: typing.SupportsFloat | typing.SupportsIndex,
    zeroth: typing.Annotated[numpy.typing.ArrayLike, numpy.float64],
    first: typing.Annotated[numpy.typing.ArrayLike, numpy.float64],
) -> numpy.typing.NDArray[numpy.float64]: ...
def is_felt_by_small_motions(law: str) -> bool: ...
def orbit_states(
    edges: typing.Annotated[numpy.typing.ArrayLike, numpy.float64],
    starts: typing.Annotated[numpy.typing.ArrayLike, numpy.float64],
    rates: typing.Annotated[numpy.typing.ArrayLike, numpy.float64],
    frequency: typing.SupportsFloat | typing.SupportsIndex,
    mirror_sign: typing.SupportsFloat | typing.SupportsIndex,
    single: typing.Annotated[numpy.typing.ArrayLike, numpy.float64],
    twofold: typing.Annotated[numpy.typing.ArrayLike, numpy.float64],
    phases: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, 1]"],
) -> numpy.typing.NDArray[numpy.float64]: ...
def rounding(
    values: typing.Annotated[numpy.typing.ArrayLike, numpy.complex128, "[m, 1]"],
) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, 1]"]: ...
def set_vector_level(name: str) -> None: ...
def stage_states(
    durations: typing.Annotated[numpy.typing.ArrayLike, numpy.float64],
    starts: typing.Annotated[numpy.typing.ArrayLike, numpy.float64],
    rates: typing.Annotated[numpy.typing.ArrayLike, numpy.float64],
    method: tuple[
        typing.Annotated[numpy.typing.ArrayLike, numpy.float64],
        typing.Annotated[numpy.typing.ArrayLike, numpy.float64],
        typing.Annotated[numpy.typing.ArrayLike, numpy.float64],
    ],
) -> numpy.typing.NDArray[numpy.float64]: ...
def vector_level() -> str: ...
def vector_levels() -> list[str]: ...

SHIFT: float = 0.97
dense_limit: int = 2000
