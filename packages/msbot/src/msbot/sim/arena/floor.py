"""The floor: colour, grip and slope of every point. A flat engine of its own, because nothing collides with paint."""

from __future__ import annotations

import math
import re
from collections.abc import Collection

import pymunk

from msbot.sim.arena.world import Area, Chassis, Colour, Looks, PartPlace, Point, Stripe, WorldPlan
from msbot_xrce.lazy import dataclass

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


# Where a part sits on its chassis when the world file does not say: a place that fits what it senses or does.


LINE_WIDTH_M = 0.07
BUMPER_WIDTH_M = 0.10
JAW_WIDTH_M = 0.055
CONE_DEG = 20.0


@dataclass(frozen=True, slots=True)
class Spot:
    """A mount with nothing left open."""

    at: Point
    turn_deg: float
    looks: Looks
    side: str
    axle: str
    on: str
    width_m: float
    cone_deg: float


def is_placed_by_itself(quantities: Collection[str]) -> bool:
    """Whether a part belongs into a world without being named there: a button may as well be one to be pressed."""
    return bool(quantities) and set(quantities) != {"touch"}


def place_of(mount: PartPlace, chassis: Chassis, quantities: Collection[str]) -> Spot:
    """The place of a part that senses or does these."""
    ahead = chassis.length_m / 2
    at: Point = (0.0, 0.0)
    looks, width, turn = Looks.UP, LINE_WIDTH_M, mount.turn_deg or 0.0
    has = {quantity.partition(".")[0] for quantity in quantities}
    if has & {"distance", "near", "servo"}:
        at, looks = (ahead, 0.0), Looks.AHEAD
    elif "line" in has:
        at, looks = (ahead - 0.01, 0.0), Looks.DOWN
    elif "colour" in has:
        at, looks = (ahead - 0.03, 0.0), Looks.DOWN
    elif "touch" in has:
        at, width = _edge(chassis, turn), BUMPER_WIDTH_M
    elif "grip" in has:
        at, looks, width = (ahead, 0.0), Looks.AHEAD, JAW_WIDTH_M
    elif "magnet" in has:
        looks = Looks.DOWN
    elif "lamp" in has:
        at = (ahead - 0.02, 0.0)
    return Spot(
        at=at if mount.at is None else mount.at,
        turn_deg=turn,
        looks=mount.looks or looks,
        side=mount.side or _side(mount.slot),
        axle=mount.axle or _axle(mount.slot),
        on=mount.on,
        width_m=mount.width_m or width,
        cone_deg=CONE_DEG if mount.cone_deg is None else mount.cone_deg,
    )


def _edge(chassis: Chassis, turn_deg: float) -> Point:
    """The edge of the chassis in one of the four directions."""
    x, y = chassis.length_m / 2, chassis.width_m / 2
    return ((x, 0.0), (0.0, y), (-x, 0.0), (0.0, -y))[round(turn_deg / 90) % 4]


def _side(slot: str) -> str:
    """The wheel that a slot's name speaks of."""
    return "right" if "right" in re.split(r"[^a-z]+", slot.lower()) else "left"


def _axle(slot: str) -> str:
    words = re.split(r"[^a-z]+", slot.lower())
    return next((axle for axle in ("front", "rear") if axle in words), "")
