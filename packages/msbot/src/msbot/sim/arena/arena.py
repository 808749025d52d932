"""A world in which time passes: robots drive, boxes are pushed, sensors see. Pure and deterministic.

The engine for bodies and contacts is Chipmunk (pymunk): what it cannot know, wheels, floor, light, sound and sensors,
is in the modules beside this one. Whatever is random comes from the seed; the order of robots and boxes is that of the
world file. So the same build of the engine gives the same run, to the last bit.
"""

from __future__ import annotations

import hashlib
import math
import struct
from collections.abc import Collection, Iterable, Mapping
from enum import Enum
from random import Random
from typing import Final

from msbot.sim.arena.arena_robot import ArenaPose, ArenaRobot, MountedPart
from msbot.sim.arena.floor import Floor
from msbot.sim.arena.gripper import Grippers
from msbot.sim.arena.sensors import SensorModel
from msbot.sim.arena.wheels import GRAVITY, SENSE_STEPS, STEP_S, step_wheels
from msbot.sim.arena.world_plan import Box, Colour, Point, RobotPlan, WorldPlan
from msbot_agent.text.similar_names import instead_of
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

try:
    import pymunk
except ModuleNotFoundError:
    raise ConfigError("a world needs the package pymunk: pip install 'msbot[arena]'") from None


BOX_GRIP = 0.35
"""Coefficient of friction of a box on the floor."""
WALL_FRICTION = 0.4


@dataclass(frozen=True, slots=True)
class Thing:
    """A box in the world."""

    plan: Box
    body: pymunk.Body
    shape: pymunk.Shape


class Arena:
    """A running world.

    Args:
        plan: what it is made of.
        seed: where everything random comes from; the world's own if absent.
    """

    def __init__(self, plan: WorldPlan, seed: int | None = None) -> None:
        self.plan = plan
        self.seed = plan.seed if seed is None else seed
        self.steps = 0
        self.robots: dict[str, ArenaRobot] = {}
        self.boxes: list[Thing] = []
        self.colours: dict[pymunk.Shape, Colour] = {}
        """What a colour sensor sees of a thing."""
        self.floor = Floor(plan)
        self._begin()

    def _begin(self) -> None:
        random = Random(self.seed)
        self.space = pymunk.Space()
        self.colours.clear()
        self._build_walls()
        self.boxes = [self._build_box(box, random) for box in self.plan.boxes]
        self.robots = {}
        for number, place in enumerate(self.plan.robots, 1):
            robot = ArenaRobot(place, number, random)
            self.space.add(robot.body, robot.shape)
            self.colours[robot.shape] = place.colour
            self.robots[place.name] = robot
        self.gripper = Grippers(self.space, {thing.shape: thing.plan.size for thing in self.boxes})
        self.senses = SensorModel(
            plan=self.plan,
            space=self.space,
            floor=self.floor,
            colours=self.colours,
            robots=self.robots,
            gripper=self.gripper,
        )
        self.steps = 0

    @property
    def now(self) -> float:
        """Seconds since the world began."""
        return self.steps * STEP_S

    def robot(self, name: str) -> ArenaRobot:
        """The robot of that name.

        Raises:
            ConfigError: the world has no such place.
        """
        robot = self.robots.get(name)
        if robot is None:
            raise ConfigError(f'the world has no robot "{name}"; {instead_of(name, self.robots)}')
        return robot

    def reset(self) -> None:
        """Begin anew: everything as at the start, the same parts on the robots."""
        seats = {name: robot.seats for name, robot in self.robots.items()}
        self._begin()
        for name, robot in self.robots.items():
            robot.seats = seats[name]
            robot.take_powers()

    def put(self, name: str, at: Point, heading_deg: float | None = None) -> None:
        """Take a robot by hand and put it somewhere else, inside the world.

        Raises:
            ConfigError: the world has no such robot.
        """
        robot = self.robot(name)
        self.gripper.let_go(robot)
        x, y = (
            max(0.0, min(most, value)) for value, most in zip(at, (self.plan.width_m, self.plan.height_m), strict=True)
        )
        robot.put((x, y), math.degrees(robot.pose.angle) if heading_deg is None else heading_deg)
        self.space.reindex_shapes_for_body(robot.body)

    def step(self, count: int = 1) -> None:
        """Let `count` times `STEP_S` pass."""
        for _ in range(count):
            for robot in self.robots.values():
                self._push(robot)
            self.space.step(STEP_S)
            self.steps += 1
            if self.steps % SENSE_STEPS == 0:
                for robot in self.robots.values():
                    self.gripper.update(robot)
                    self.senses.note_motion(robot, STEP_S * SENSE_STEPS)

    def mount(self, robot: str, slot: str, quantities: Iterable[str]) -> MountedPart:
        """Put a part on a robot."""
        return self.robot(robot).mount(slot, quantities)

    def drive(self, robot: str, slot: str, does: Mapping[str, float]) -> None:
        """Say what a part does now."""
        self.robot(robot).drive(slot, does)

    def sense(self, robot: str, slot: str, quantities: Collection[str]) -> dict[str, float | bool]:
        """What a part senses now."""
        found = self.robot(robot)
        seat = found.seats.get(slot)
        return {} if seat is None else self.senses.sense(found, seat, quantities)

    def poses(self) -> dict[str, ArenaPose]:
        """Where robots and boxes are."""
        found = {name: robot.pose for name, robot in self.robots.items()}
        for thing in self.boxes:
            x, y = thing.body.position
            found[thing.plan.name] = ArenaPose(float(x), float(y), float(thing.body.angle))
        return found

    def digest(self) -> str:
        """A hash of where everything is and how it moves, to the last bit: the same run has the same one."""
        state = hashlib.sha256(struct.pack("<q", self.steps))
        for body in [robot.body for robot in self.robots.values()] + [thing.body for thing in self.boxes]:
            state.update(struct.pack("<6d", *body.position, *body.velocity, body.angle, body.angular_velocity))
        for robot in self.robots.values():
            state.update(struct.pack(f"<{len(robot.wheels)}d", *(wheel.speed for wheel in robot.wheels)))
        return state.hexdigest()

    def _push(self, robot: ArenaRobot) -> None:
        """Let the wheels of a robot push, and the slope below it pull."""
        body, pose = robot.body, robot.pose
        c, s = math.cos(pose.angle), math.sin(pose.angle)
        vx, vy = body.velocity
        chassis = robot.plan.chassis
        grips = [chassis.grip * self.floor.grip(pose.to_world(wheel.at)) for wheel in robot.wheels]
        ahead, left, torque = step_wheels(
            chassis, robot.wheels, (c * vx + s * vy, c * vy - s * vx), body.angular_velocity, grips
        )
        down_x, down_y = self.floor.slope((pose.x, pose.y))
        weight = chassis.mass_kg * GRAVITY
        body.force = (c * ahead - s * left + weight * down_x, s * ahead + c * left + weight * down_y)
        body.torque = torque

    def _build_walls(self) -> None:
        width, height = self.plan.width_m, self.plan.height_m
        if self.plan.border:
            thick = 0.5
            for begin, end in (
                ((-thick, -thick), (width + thick, -thick)),
                ((width + thick, -thick), (width + thick, height + thick)),
                ((width + thick, height + thick), (-thick, height + thick)),
                ((-thick, height + thick), (-thick, -thick)),
            ):
                self._fix(pymunk.Segment(self.space.static_body, begin, end, thick), (120, 80, 50))
        for wall in self.plan.walls:
            for begin, end in zip(wall.points, wall.points[1:], strict=False):
                self._fix(pymunk.Segment(self.space.static_body, begin, end, wall.thickness_m / 2), wall.colour)
        for post in self.plan.posts:
            self._fix(pymunk.Circle(self.space.static_body, post.radius_m, post.at), post.colour)

    def _fix(self, shape: pymunk.Shape, colour: Colour) -> None:
        shape.friction, shape.elasticity = WALL_FRICTION, 0.1
        self.space.add(shape)
        self.colours[shape] = colour

    def _build_box(self, box: Box, random: Random) -> Thing:
        body = pymunk.Body(box.mass_kg, pymunk.moment_for_box(box.mass_kg, box.size))
        angle, distance = random.uniform(0, math.tau), box.scatter_m * math.sqrt(random.random())
        body.position = box.at[0] + distance * math.cos(angle), box.at[1] + distance * math.sin(angle)
        body.angle = math.radians(box.heading_deg)
        shape = pymunk.Poly.create_box(body, box.size)
        shape.friction, shape.elasticity = 0.5, 0.05
        # Friction on the floor: joints that do not hold it in place, but resist up to a force.
        slide = pymunk.PivotJoint(self.space.static_body, body, (0, 0), (0, 0))
        slide.max_bias, slide.max_force = 0.0, BOX_GRIP * box.mass_kg * GRAVITY
        turn = pymunk.GearJoint(self.space.static_body, body, 0.0, 1.0)
        turn.max_bias, turn.max_force = 0.0, slide.max_force * math.hypot(*box.size) / 3
        self.space.add(body, shape, slide, turn)
        self.colours[shape] = box.colour
        return Thing(box, body, shape)


def place_for(plan: WorldPlan, name: str | None) -> RobotPlan:
    """The place of a robot that joins: the one named, or the first.

    Raises:
        ConfigError: the world has no such place.
    """
    found = plan.robots[0] if name is None else plan.robot(name)
    if found is None:
        raise ConfigError(
            f'the world "{plan.name}" has no robot "{name}"; it has {", ".join(robot.name for robot in plan.robots)}'
        )
    return found


# What is near a robot of a world, for people who do not see the picture.


REACH_M: Final = 0.5
"""What is farther away is not near."""


class RelativeSide(Enum):
    """Where something is, as the robot sees it."""

    AHEAD = "ahead"
    LEFT = "left"
    BEHIND = "behind"
    RIGHT = "right"


class ThingKind(Enum):
    """What it is."""

    WALL = "wall"
    BOX = "box"
    ROBOT = "robot"


@dataclass(frozen=True, slots=True)
class Nearby:
    """One thing near a robot."""

    sort: ThingKind
    name: str
    """As the world file calls it; empty for a wall."""
    distance_m: float
    """From the middle of the robot to the nearest point of the thing."""
    side: RelativeSide


def surroundings(arena: Arena, robot: ArenaRobot) -> list[Nearby]:
    """Boxes and robots near a robot, and on each side the nearest wall; the nearest thing first."""
    pose = robot.pose
    boxes = {thing.shape: thing.plan.name for thing in arena.boxes if thing.body is not robot.held}
    robots = {other.shape: other.plan.name for other in arena.robots.values()}
    found: dict[tuple[ThingKind, str], Nearby] = {}
    for info in arena.space.point_query((pose.x, pose.y), REACH_M, robot.filter):
        if info.shape is None or (robot.held is not None and info.shape.body is robot.held):
            continue
        angle = math.degrees(math.atan2(info.point.y - pose.y, info.point.x - pose.x) - pose.angle) % 360.0
        side = (RelativeSide.AHEAD, RelativeSide.LEFT, RelativeSide.BEHIND, RelativeSide.RIGHT)[round(angle / 90.0) % 4]
        if info.shape in boxes:
            sort, name = ThingKind.BOX, boxes[info.shape]
        elif info.shape in robots:
            sort, name = ThingKind.ROBOT, robots[info.shape]
        else:
            sort, name = ThingKind.WALL, ""
        one = Nearby(sort, name, max(0.0, float(info.distance)), side)
        key = (sort, name or side.value)
        if key not in found or one.distance_m < found[key].distance_m:
            found[key] = one
    return sorted(found.values(), key=lambda one: (one.distance_m, one.sort.value, one.name))
