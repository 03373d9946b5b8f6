# SPDX-License-Identifier: MIT
"""Common base of results with curves in the plane of two numbers of a pipe."""

from __future__ import annotations

from typing import Any, ClassVar

from pipedyn.models.pipe_numbers import unit_of_number
from pipedyn.models.scales import scales_at
from pipedyn.util.result import Result, TableResult, Unit, join_tables


class InPlane(TableResult):
    """Curves in the plane of two numbers x and y, with a table of all their points.

    A subclass has `curves` and a `model`.

    Attributes:
        names: names of x and y.
        ranges: ranges of x and y, ((low, high), (low, high)).
    """

    _along: ClassVar[tuple[str, ...]] = ()  # attributes of curves that are columns, besides x and y

    names: tuple[str, str]
    ranges: tuple[tuple[float, float], tuple[float, float]]

    def _unit(self, name: str) -> Unit | None:
        own: Any = self
        known = unit_of_number(name, own.model.pipe) if name in own.names else None
        return known or super()._unit(name)

    def _units_within(self, name: str) -> dict[str, Unit | None]:
        first, second = map(self._unit, self.names)
        return {"x": first, "y": second}

    def _scales_within(self, one: Result, scales: Any) -> Any:
        """Scales of a part of the result, such as a curve, at its values of beta.

        The scale of the flow speed depends on beta, which may be one of the two numbers.
        """
        if "beta" not in self.names or not hasattr(one, "x"):
            return super()._scales_within(one, scales)
        return scales_at(getattr(one, "xy"[self.names.index("beta")]), scales)

    def _scales_of_rows(self, scales: Any) -> Any:
        return scales_at(self._columns()["beta"], scales) if "beta" in self.names else scales

    def _columns(self) -> dict[str, Any]:
        own: Any = self
        first, second = own.names
        tables = [
            {first: one.x, second: one.y, **{name: getattr(one, name) for name in self._along}}
            for one in own.curves
        ]
        kinds = [one.kind for one in own.curves]
        return join_tables(tables, curve=range(len(kinds)), kind=kinds)
