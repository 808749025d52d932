"""A curve: numbers over time, with what is worth knowing about them. Pure."""

from __future__ import annotations

import math
from collections.abc import Sequence

from msbot_xrce.common.lazy_dataclass import dataclass

Point = tuple[float, float]
"""(seconds, value)."""


@dataclass(frozen=True, slots=True)
class Figures:
    """What a piece of a curve comes to."""

    count: int
    mean: float
    """Of the values, whatever the time between them."""
    least: float
    most: float


@dataclass(frozen=True, slots=True)
class Curve:
    """The numbers of one thing over time."""

    name: str
    points: Sequence[Point]
    """Oldest first."""
    unit: str = ""


def figures_of(values: Sequence[float]) -> Figures | None:
    """Mean, least and greatest; None: there is no value. What is not a number (NaN, infinity) is left out."""
    finite = values if all(map(math.isfinite, values)) else [value for value in values if math.isfinite(value)]
    if not finite:
        return None
    return Figures(len(finite), math.fsum(finite) / len(finite), min(finite), max(finite))


def thinned(points: Sequence[Point], most: int) -> Sequence[Point]:
    """At most this many points that show the same curve: of each step its least and its greatest."""
    if len(points) <= most:
        return points
    step = -(-len(points) // max(most // 2, 1))
    kept: list[Point] = []
    for first in range(0, len(points), step):
        part = points[first : first + step]
        kept += sorted({min(part, key=_value), max(part, key=_value)})
    return kept


def _value(point: Point) -> float:
    return point[1]
