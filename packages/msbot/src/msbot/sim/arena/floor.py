"""The floor: colour, grip and slope of every point. A flat engine of its own, because nothing collides with paint."""

from __future__ import annotations

import math

import pymunk

from msbot.sim.arena.world_plan import Area, Colour, Point, Stripe, WorldPlan

ORDINARY_GRIP = 0.8
"""Grip of a tyre on the floor where no area says something else."""
DARK = 0.35
"""A line follower sees what reflects less than this share of the light."""


def brightness(colour: Colour) -> float:
    """What a colour reflects, 0 to 1 (weights of ITU-R BT.601)."""
    return (0.299 * colour[0] + 0.587 * colour[1] + 0.114 * colour[2]) / 255


class Floor:
    """What lies on the floor of a world."""

    def __init__(self, plan: WorldPlan) -> None:
        self._space = pymunk.Space()
        self._base = plan.floor
        self._layers: dict[pymunk.Shape, tuple[int, Area | Stripe]] = {}
        self._has_grip = any(area.grip is not None for area in plan.areas)
        self._has_slope = any(area.slope_deg for area in plan.areas)
        layer = 0
        for area in plan.areas:
            self._add(pymunk.Poly(self._space.static_body, list(area.corners)), layer, area)
            layer += 1
        for line in plan.lines:
            for begin, end in zip(line.points, line.points[1:], strict=False):
                self._add(pymunk.Segment(self._space.static_body, begin, end, line.width_m / 2), layer, line)
            layer += 1

    def _add(self, shape: pymunk.Shape, layer: int, what: Area | Stripe) -> None:
        self._space.add(shape)
        self._layers[shape] = (layer, what)

    def colour(self, at: Point) -> Colour:
        """The colour there."""
        top, found = -1, self._base
        for info in self._space.point_query(at, 0.0, pymunk.ShapeFilter()):
            layer, what = self._layers[info.shape]
            if layer > top and what.colour is not None:
                top, found = layer, what.colour
        return found

    def is_dark(self, at: Point) -> bool:
        """Whether a line follower sees a line there."""
        return brightness(self.colour(at)) < DARK

    def grip(self, at: Point) -> float:
        """How well a tyre holds there, in comparison with the ordinary floor; 1 = as well."""
        if not self._has_grip:
            return 1.0
        top, found = -1, ORDINARY_GRIP
        for layer, area in self._areas(at):
            if layer > top and area.grip is not None:
                top, found = layer, area.grip
        return found / ORDINARY_GRIP

    def slope(self, at: Point) -> tuple[float, float]:
        """Sine of the slope along x and y; positive goes down."""
        if not self._has_slope:
            return 0.0, 0.0
        top, found = -1, (0.0, 0.0)
        for layer, area in self._areas(at):
            if layer > top and area.slope_deg:
                down, steep = math.radians(area.downhill_deg), math.sin(math.radians(area.slope_deg))
                top, found = layer, (steep * math.cos(down), steep * math.sin(down))
        return found

    def _areas(self, at: Point) -> list[tuple[int, Area]]:
        found = []
        for info in self._space.point_query(at, 0.0, pymunk.ShapeFilter()):
            layer, what = self._layers[info.shape]
            if isinstance(what, Area):
                found.append((layer, what))
        return found
