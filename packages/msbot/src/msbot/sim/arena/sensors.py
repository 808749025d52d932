"""What sensors see of a world, by their place on the chassis. Units are those of docs/howto/arena.md.

Noise is not added here: each part type's simulator has its own.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping

import pymunk

from msbot.sim.arena.arena_robot import BUMPER_DEPTH_M, ArenaPose, ArenaRobot, MountedPart
from msbot.sim.arena.floor import Floor
from msbot.sim.arena.gripper import Grippers
from msbot.sim.arena.world_plan import Colour, Looks, Point, WorldPlan

Sensed = float | bool

FARTHEST_M = 10.0
RAYS = 5
NEAR_M = 0.10
COLOUR_REACH_M = 0.08
EYES = 8
"""Of a line follower."""
EAR_M = 0.15
"""A noise is half as loud at this distance from its source."""
LAMP_LUX = 25.0
"""What a lamp on a robot gives at one metre at full brightness."""
NOTHING: Colour = (12, 12, 12)
"""What a colour sensor sees when nothing is in front of it."""


class SensorModel:
    """Eyes, ears and feelers of the robots in a world."""

    def __init__(
        self,
        *,
        plan: WorldPlan,
        space: pymunk.Space,
        floor: Floor,
        colours: Mapping[pymunk.Shape, Colour],
        robots: Mapping[str, ArenaRobot],
        gripper: Grippers,
    ) -> None:
        self._plan = plan
        self._space = space
        self._floor = floor
        self._colours = colours
        self._robots = robots
        self._gripper = gripper

    def sense(self, robot: ArenaRobot, seat: MountedPart, quantities: Collection[str]) -> dict[str, Sensed]:
        """What a part senses; quantities that it only does are left out."""
        found: dict[str, Sensed] = {}
        for quantity in quantities:
            if quantity not in found:
                found |= self._one(robot, seat, quantity)
        return {name: value for name, value in found.items() if name in quantities}

    def note_motion(self, robot: ArenaRobot, passed_s: float) -> None:
        """Note how a robot was accelerated since the last call, for those who feel it."""
        if not any("push.ahead" in seat.quantities for seat in robot.seats.values()):
            return
        vx, vy = (float(part) for part in robot.body.velocity)
        ax, ay = (vx - robot.velocity_before[0]) / passed_s, (vy - robot.velocity_before[1]) / passed_s
        c, s = math.cos(robot.body.angle), math.sin(robot.body.angle)
        robot.pushed = (c * ax + s * ay, c * ay - s * ax)
        robot.velocity_before = (vx, vy)

    def ray(self, robot: ArenaRobot, begin: ArenaPose, turn: float, length: float) -> tuple[float, pymunk.Shape | None]:
        """How far it is to the next thing in that direction, and what it is."""
        angle = begin.angle + turn
        end = begin.x + length * math.cos(angle), begin.y + length * math.sin(angle)
        info = self._space.segment_query_first((begin.x, begin.y), end, 0.0, robot.filter)
        return (length, None) if info is None else (float(info.alpha) * length, info.shape)

    def distance(self, robot: ArenaRobot, seat: MountedPart) -> float:
        """The shortest way in the cone of a distance sensor, in m."""
        pose, half = robot.looking(seat), math.radians(seat.place.cone_deg) / 2
        turns = [half * (2 * ray / (RAYS - 1) - 1) for ray in range(RAYS)] if half else [0.0]
        return min(self.ray(robot, pose, turn, FARTHEST_M)[0] for turn in turns)

    def _one(self, robot: ArenaRobot, seat: MountedPart, quantity: str) -> dict[str, Sensed]:
        match quantity.partition(".")[0]:
            case "distance":
                return {"distance": self.distance(robot, seat)}
            case "near":
                pose = robot.looking(seat)
                return {"near": any(self.ray(robot, pose, turn, NEAR_M)[1] is not None for turn in (-0.3, 0.0, 0.3))}
            case "touch":
                return {"touch": self._touches(robot, seat)}
            case "line":
                return self._line(robot, seat)
            case "colour":
                red, green, blue = self._colour(robot, seat)
                return {"colour.red": float(red), "colour.green": float(green), "colour.blue": float(blue)}
            case "light":
                return {"light": self._light(robot, seat)}
            case "sound":
                return {"sound": self._sound(robot, seat)}
            case "magnet":
                at = robot.looking(seat)
                return {"magnet": any(_between(magnet.at, at) <= magnet.reach_m for magnet in self._plan.magnets)}
            case "heading":
                return {"heading": (self._plan.north_deg - math.degrees(robot.looking(seat).angle)) % 360.0}
            case "pitch" | "roll":
                return self._tilt(robot)
            case "spin":
                return {"spin": math.degrees(robot.body.angular_velocity)}
            case "push":
                return {"push.ahead": robot.pushed[0], "push.left": robot.pushed[1]}
            case "wheel":
                return {"wheel": self._wheel(robot, seat)}
            case "grip" if quantity == "grip.thing":
                return {"grip.thing": self._gripper.thing_mm(robot, seat)}
        return {}

    def _touches(self, robot: ArenaRobot, seat: MountedPart) -> bool:
        """Whether something is at a bumper: a row of feelers along its width."""
        pose, half = robot.looking(seat), seat.place.width_m / 2
        begin, end = pose.to_world((BUMPER_DEPTH_M / 2, -half)), pose.to_world((BUMPER_DEPTH_M / 2, half))
        return self._space.segment_query_first(begin, end, BUMPER_DEPTH_M / 2, robot.filter) is not None

    def _line(self, robot: ArenaRobot, seat: MountedPart) -> dict[str, Sensed]:
        """The mean place of the eyes that see a line; -1 is the left end of the row."""
        pose, width = robot.looking(seat), seat.place.width_m
        places = [2 * eye / (EYES - 1) - 1 for eye in range(EYES)]
        seen = [place for place in places if self._floor.is_dark(pose.to_world((0.0, -place * width / 2)))]
        if not seen:
            return {"line.seen": False}  # where it was last: a real one cannot know better
        return {"line.seen": True, "line.place": sum(seen) / len(seen)}

    def _colour(self, robot: ArenaRobot, seat: MountedPart) -> Colour:
        pose = robot.looking(seat)
        if seat.place.looks is Looks.DOWN:
            return self._floor.colour((pose.x, pose.y))
        _, shape = self.ray(robot, pose, 0.0, COLOUR_REACH_M)
        return NOTHING if shape is None else self._colours.get(shape, NOTHING)

    def _light(self, robot: ArenaRobot, seat: MountedPart) -> float:
        """The light that falls on a sensor, in lx."""
        pose = robot.looking(seat)
        sources = [(lamp.at, lamp.lux) for lamp in self._plan.lamps]
        for other in self._robots.values():
            if other is not robot and (lux := LAMP_LUX * shining(other)):
                sources.append(((other.pose.x, other.pose.y), lux))
        total = self._plan.ambient_lx
        for at, lux in sources:
            distance = max(0.05, _between(at, pose))
            share = 1.0
            if seat.place.looks is Looks.AHEAD:
                share = max(0.0, math.cos(math.atan2(at[1] - pose.y, at[0] - pose.x) - pose.angle))
            if share and not self._is_shadowed(robot, pose, at):
                total += share * lux / distance**2
        return total

    def _is_shadowed(self, robot: ArenaRobot, pose: ArenaPose, at: Point) -> bool:
        info = self._space.segment_query_first((pose.x, pose.y), at, 0.0, robot.filter)
        if info is None:
            return False
        owner = next((other for other in self._robots.values() if other.shape is info.shape), None)
        return owner is None or _between(at, owner.pose) > 1e-6  # a lamp does not stand in its own way

    def _sound(self, robot: ArenaRobot, seat: MountedPart) -> float:
        """How loud it is, in percent of what the ear can hear."""
        pose = robot.looking(seat)
        sources = [(noise.at, noise.percent) for noise in self._plan.noises]
        sources += [((other.pose.x, other.pose.y), other.does("loudness")) for other in self._robots.values()]
        total = self._plan.quiet_percent
        for at, percent in sources:
            total += percent * EAR_M / (EAR_M + _between(at, pose))
        return min(100.0, total)

    def _tilt(self, robot: ArenaRobot) -> dict[str, Sensed]:
        """Degrees; pitch is positive with the nose down, roll with the left side up."""
        pose = robot.pose
        down_x, down_y = self._floor.slope((pose.x, pose.y))
        c, s = math.cos(pose.angle), math.sin(pose.angle)
        ahead, left = c * down_x + s * down_y, c * down_y - s * down_x
        return {"pitch": math.degrees(math.asin(ahead)), "roll": 0.0 - math.degrees(math.asin(left))}

    def _wheel(self, robot: ArenaRobot, seat: MountedPart) -> float:
        """Turns of the axle per minute."""
        name = f"{seat.place.axle or 'front'} {seat.place.side}"
        wheel = next(wheel for wheel in robot.wheels if wheel.name in (name, seat.place.side))
        return 60 * wheel.speed / (math.pi * robot.plan.chassis.wheel_m)


def shining(robot: ArenaRobot) -> float:
    """How brightly the lamps of a robot shine, 0 to 1."""
    coloured = max(robot.does(f"lamp.{colour}") for colour in ("red", "green", "blue")) / 255
    return max(robot.does("lamp") / 100, coloured)


def _between(at: Point, pose: ArenaPose) -> float:
    return math.hypot(at[0] - pose.x, at[1] - pose.y)
