# SPDX-License-Identifier: MIT
"""
C++ core of pipedyn: operators of the chain and of the reduced model.
"""

from __future__ import annotations
import numpy
import numpy.typing
import typing

__all__: list[str] = ["Chain", "Galerkin", "Operators", "Pipe"]

class Pipe:
    def __init__(
        self,
        beta: typing.SupportsFloat | typing.SupportsIndex,
        gamma: typing.SupportsFloat | typing.SupportsIndex,
        alpha: typing.SupportsFloat | typing.SupportsIndex,
        drag: typing.SupportsFloat | typing.SupportsIndex,
        damping: typing.SupportsFloat | typing.SupportsIndex,
        aspirating: bool,
    ) -> None: ...
    @property
    def centrifugal(self) -> float: ...
    @property
    def direction(self) -> float: ...

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
    def flux_times(
        self,
        x: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, n]"],
        transposed: bool = False,
    ) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, n]"]: ...
    def gravity_times(
        self, x: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, n]"]
    ) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, n]"]: ...
    def joint_operators(
        self, scale: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, 1]"]
    ) -> Operators: ...
    def mass_times(
        self, x: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, n]"]
    ) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, n]"]: ...
    def operators(self) -> Operators: ...
    def springs_times(
        self, joint_angles: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, n]"]
    ) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, n]"]: ...
    def velocity_times(
        self,
        x: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[m, n]"],
        transposed: bool = False,
    ) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, n]"]: ...

class Galerkin:
    def __init__(
        self,
        pipe: Pipe,
        legendre: bool,
        size: typing.SupportsInt | typing.SupportsIndex,
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
