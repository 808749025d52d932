"""Where a part sits on its chassis when the world file does not say: a place that fits what it senses or does."""

from __future__ import annotations

import re
from collections.abc import Collection

from msbot.sim.arena.world_plan import Chassis, Looks, PartPlace, Point
from msbot_xrce.lazy import dataclass

LINE_WIDTH_M = 0.07
BUMPER_WIDTH_M = 0.10
JAW_WIDTH_M = 0.055
CONE_DEG = 20.0


@dataclass(frozen=True, slots=True)
class ResolvedMount:
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


def resolve_mount(mount: PartPlace, chassis: Chassis, quantities: Collection[str]) -> ResolvedMount:
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
    return ResolvedMount(
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
