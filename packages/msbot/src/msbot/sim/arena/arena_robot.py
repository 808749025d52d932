"""One robot in an arena: its body, its wheels, and the parts that sit on it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import field
from random import Random

import pymunk

from msbot.sim.arena.default_mounts import ResolvedMount, resolve_mount
from msbot.sim.arena.wheels import Wheel, make_wheels
from msbot.sim.arena.world_plan import Outline, PartPlace, Point, RobotPlan
from msbot_xrce.lazy import dataclass

BUMPER_DEPTH_M = 0.006
"""A bumper stands out this far."""


@dataclass(slots=True)
class MountedPart:
    """One part on the chassis."""

    slot: str
    quantities: tuple[str, ...]
    """What it senses and does, names of `SENSES` and `DRIVES`."""
    place: ResolvedMount
    does: dict[str, float] = field(default_factory=dict)
    """What it does now; nothing = it has no power."""


@dataclass(frozen=True, slots=True)
class ArenaPose:
    """Where something is, and how it is turned."""

    x: float
    y: float
    angle: float
    """Radians."""

    def to_world(self, at: Point) -> Point:
        """A point of the own frame in that of the world."""
        c, s = math.cos(self.angle), math.sin(self.angle)
        return self.x + c * at[0] - s * at[1], self.y + s * at[0] + c * at[1]


class ArenaRobot:
    """See the module's docstring. Made by `Arena`."""

    def __init__(self, plan: RobotPlan, group: int, random: Random) -> None:
        chassis = plan.chassis
        self.plan = plan
        self.filter = pymunk.ShapeFilter(group=group)
        """Whoever looks with this does not see the robot itself."""
        self.seats: dict[str, MountedPart] = {}
        self.wheels: list[Wheel] = make_wheels(chassis, random)
        length, width = chassis.length_m, chassis.width_m
        if chassis.shape is Outline.ROUND:
            moment = pymunk.moment_for_circle(chassis.mass_kg, 0, length / 2)
        else:
            moment = pymunk.moment_for_box(chassis.mass_kg, (length, width))
        self.body = pymunk.Body(chassis.mass_kg, moment)
        self.shape: pymunk.Shape = (
            pymunk.Circle(self.body, length / 2)
            if chassis.shape is Outline.ROUND
            else pymunk.Poly.create_box(self.body, (length - 0.01, width - 0.01), 0.005)
        )
        self.shape.friction = 0.4
        self.shape.elasticity = 0.1
        self.shape.filter = self.filter
        self.held: pymunk.Body | None = None
        """The box between the fingers of its gripper."""
        self.hold: tuple[pymunk.Constraint, ...] = ()
        self.pushed = (0.0, 0.0)
        """Acceleration in its own frame, m/s2, over the last reading."""
        self.velocity_before = (0.0, 0.0)
        self.reset()

    def reset(self) -> None:
        """Go back to the start and stand still."""
        self.put(self.plan.start, self.plan.heading_deg)

    def put(self, at: Point, heading_deg: float) -> None:
        """Stand still there."""
        self.body.position = at
        self.body.angle = math.radians(heading_deg)
        self.body.velocity = (0.0, 0.0)
        self.body.angular_velocity = 0.0
        self.velocity_before = (0.0, 0.0)
        for wheel in self.wheels:
            wheel.speed = 0.0

    @property
    def pose(self) -> ArenaPose:
        """Where it is."""
        x, y = self.body.position
        return ArenaPose(float(x), float(y), float(self.body.angle))

    def mount(self, slot: str, quantities: Iterable[str]) -> MountedPart:
        """Put a part on the chassis, where the world file says or where it fits."""
        mount = next((mount for mount in self.plan.mounts if mount.slot == slot), PartPlace(slot))
        names = tuple(quantities)
        seat = MountedPart(slot, names, resolve_mount(mount, self.plan.chassis, names))
        self.seats[slot] = seat
        return seat

    def unmount(self, slot: str) -> None:
        """Take a part off: it does nothing any more."""
        self.seats.pop(slot, None)
        self.take_powers()

    def drive(self, slot: str, does: Mapping[str, float]) -> None:
        """Note what a part does."""
        seat = self.seats.get(slot)
        if seat is not None:
            before, seat.does = seat.does, {name: value for name, value in does.items() if name in seat.quantities}
            if seat.does != before:
                self.take_powers()

    def take_powers(self) -> None:
        """Give each wheel what its motor driver says; a wheel that no driver feeds has no power."""
        for wheel in self.wheels:
            wheel.power = 0.0
        for seat in self.seats.values():
            for side in ("left", "right"):
                power = seat.does.get(f"motor.{side}")
                if power is None:
                    continue
                for wheel in self.wheels:
                    if wheel.name.endswith(side) and _is_at(wheel, seat.place.axle):
                        wheel.power = max(-1.0, min(1.0, power / 100))

    def does(self, quantity: str, otherwise: float = 0.0) -> float:
        """What the first part that does it says."""
        for seat in self.seats.values():
            if quantity in seat.does:
                return seat.does[quantity]
        return otherwise

    def looking(self, seat: MountedPart) -> ArenaPose:
        """Where a part is and where it faces, in the world; one on a servo turns with it."""
        place, pose = seat.place, self.pose
        at, turn = place.at, place.turn_deg
        servo = self.seats.get(place.on)
        if servo is not None:
            turn += servo.place.turn_deg + servo.does.get("servo", 90.0) - 90.0
            at = servo.place.at
        x, y = pose.to_world(at)
        return ArenaPose(x, y, pose.angle + math.radians(turn))


def _is_at(wheel: Wheel, axle: str) -> bool:
    """Whether a driver of that axle feeds a wheel; two wheels at the sides count as a front axle."""
    return not axle or wheel.name.startswith(axle) or (" " not in wheel.name and axle == "front")
