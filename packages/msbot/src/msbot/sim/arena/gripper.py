"""Grippers: fingers that close on a box take it along; fingers that open let it go."""

from __future__ import annotations

import math

import pymunk

from msbot.sim.arena.arena_robot import ArenaRobot, MountedPart
from msbot.sim.arena.world_plan import Point

REACH_M = 0.035
"""How far in front of it a gripper holds a box."""
HOLD_N = 6.0
"""Force with which it holds."""
SLACK_M = 0.0015
OPEN_M = 0.0002
"""Fingers are quite open when not more than this is missing."""


class Grippers:
    """The grippers of all robots of a world.

    Args:
        space: where the boxes are.
        sizes: length and width of each box.
    """

    def __init__(self, space: pymunk.Space, sizes: dict[pymunk.Shape, Point]) -> None:
        self._space = space
        self._sizes = sizes

    def thing_mm(self, robot: ArenaRobot, seat: MountedPart) -> float:
        """Width of what is between the fingers in mm; 0 = nothing."""
        shape = self._between(robot, seat)
        return 0.0 if shape is None else 1000 * self._width(robot, seat, shape)

    def update(self, robot: ArenaRobot) -> None:
        """Take what the fingers have closed on, let go what they have opened from."""
        seat = next((seat for seat in robot.seats.values() if "grip.opening" in seat.quantities), None)
        if seat is None or "grip.opening" not in seat.does:
            self.let_go(robot)
            return
        opening_m = seat.does["grip.opening"] / 1000
        shape = self._between(robot, seat)
        if shape is None:
            self.let_go(robot)
            return
        # Fingers that are quite open hold nothing, however wide it is as it lies askew.
        is_open = opening_m >= seat.place.width_m - OPEN_M
        closed = not is_open and opening_m <= self._width(robot, seat, shape) + SLACK_M
        if closed and robot.held is None:
            self._take(robot, seat, shape.body)
        elif not closed:
            self.let_go(robot)

    def let_go(self, robot: ArenaRobot) -> None:
        """Open the fingers, whatever is between them."""
        if robot.hold:
            self._space.remove(*robot.hold)
        robot.hold, robot.held = (), None

    def _between(self, robot: ArenaRobot, seat: MountedPart) -> pymunk.Shape | None:
        """The box between the fingers."""
        pose = robot.looking(seat)
        if robot.held is not None:
            return next(iter(robot.held.shapes))
        info = self._space.segment_query_first((pose.x, pose.y), pose.to_world((REACH_M, 0.0)), 0.0, robot.filter)
        if info is None or info.shape not in self._sizes:
            return None
        return info.shape if self._width(robot, seat, info.shape) <= seat.place.width_m else None

    def _width(self, robot: ArenaRobot, seat: MountedPart, shape: pymunk.Shape) -> float:
        """How wide a box is as the fingers feel it."""
        length, width = self._sizes[shape]
        turned = shape.body.angle - robot.looking(seat).angle
        return abs(length * math.sin(turned)) + abs(width * math.cos(turned))

    def _take(self, robot: ArenaRobot, seat: MountedPart, box: pymunk.Body) -> None:
        pose = robot.looking(seat)
        at = box.position
        joints = (
            pymunk.PivotJoint(robot.body, box, (float(at[0]), float(at[1]))),
            pymunk.GearJoint(robot.body, box, float(box.angle) - float(robot.body.angle), 1.0),
        )
        joints[0].max_force = HOLD_N
        joints[1].max_force = HOLD_N * math.hypot(float(at[0]) - pose.x, float(at[1]) - pose.y)
        for joint in joints:
            joint.collide_bodies = False
        self._space.add(*joints)
        robot.hold, robot.held = joints, box
