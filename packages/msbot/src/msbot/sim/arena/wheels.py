"""Wheels with motors: inertia, the force of a motor at its speed, and tyres that slip. Pure numbers, no engine.

A tyre pushes in proportion to its slip up to what its load and grip allow (a linear tyre in a circle of friction); a
motor's force falls linearly with its speed, as that of a direct current motor at constant voltage does. A Mecanum
wheel has rollers at 45 degrees: it pushes along their axis only.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from random import Random

from msbot.sim.arena.world_plan import Chassis, ChassisKind, Point
from msbot_xrce.lazy import dataclass

STEP_S = 0.005
SENSE_STEPS = 4
"""Physical steps between two looks of the sensors: 20 ms."""
GRAVITY = 9.81
WHEEL_SHARE = 0.12
"""Mass that a wheel with its motor and gear seems to have at its rim, as a share of the robot's."""
STIFFNESS = 40.0
"""Force of all tyres together per slip, N s/m, for each kilogram of the robot."""
SPREAD = 0.015
"""Standard deviation of what motors of one type differ in strength."""
GEAR_SHARE = 0.1
"""What a gear takes of the full force: below this power a motor does not start."""

_C = math.sqrt(0.5)


@dataclass(slots=True)
class Wheel:
    """One wheel and its motor."""

    name: str
    """`left` or `right`, or with `front ` or `rear ` before it."""
    at: Point
    along: Point
    """Direction in which its tyre pushes, in the robot's frame."""
    holds_sideways: bool
    strength: float
    """Of its motor; 1 = as its data sheet says."""
    power: float = 0.0
    """-1 to 1."""
    speed: float = 0.0
    """Of its rim, m/s."""
    slips: bool = False
    """Whether its tyre slid over the floor in the last step."""


def make_wheels(chassis: Chassis, random: Random) -> list[Wheel]:
    """The wheels of a chassis; each motor is a little stronger or weaker than the others."""
    y = chassis.track_m / 2
    if chassis.kind is ChassisKind.DIFFERENTIAL:
        spots: list[tuple[str, Point, Point]] = [("left", (0.0, y), (1.0, 0.0)), ("right", (0.0, -y), (1.0, 0.0))]
    else:
        x = chassis.base_m / 2
        spots = [
            ("front left", (x, y), (_C, -_C)),
            ("front right", (x, -y), (_C, _C)),
            ("rear left", (-x, y), (_C, _C)),
            ("rear right", (-x, -y), (_C, -_C)),
        ]
    holds = chassis.kind is ChassisKind.DIFFERENTIAL
    return [Wheel(name, at, along, holds, random.gauss(1.0, SPREAD)) for name, at, along in spots]


def step_wheels(
    chassis: Chassis, wheels: Sequence[Wheel], velocity: Point, turning: float, grips: Sequence[float]
) -> tuple[float, float, float]:
    """Let the wheels push for one step of `STEP_S`.

    Args:
        chassis: what they are on.
        wheels: changed: their speed and slip.
        velocity: of the chassis' middle, in its own frame, m/s.
        turning: rad/s.
        grips: the floor's grip below each wheel.

    Returns:
        force ahead and to the left in N, torque in N m.
    """
    ahead = left = torque = 0.0
    stiffness = STIFFNESS * chassis.mass_kg / len(wheels)
    wheel_kg = WHEEL_SHARE * chassis.mass_kg
    load = chassis.mass_kg * GRAVITY / len(wheels)
    for wheel, grip in zip(wheels, grips, strict=True):
        x, y = wheel.at
        over_x, over_y = velocity[0] - turning * y, velocity[1] + turning * x
        slip = (wheel.speed - over_x) * wheel.along[0] - over_y * wheel.along[1]
        along, across = stiffness * slip, -stiffness * over_y if wheel.holds_sideways else 0.0
        most, wanted = grip * load, math.hypot(along, across)
        wheel.slips = wanted > most
        if wheel.slips:
            along, across = along * most / wanted, across * most / wanted
        force_x, force_y = along * wheel.along[0], along * wheel.along[1] + across
        ahead += force_x
        left += force_y
        torque += x * force_y - y * force_x
        full = chassis.force_n * wheel.strength
        motor = max(-full, min(full, full * (wheel.power - (1 - GEAR_SHARE) * wheel.speed / chassis.speed_m_s)))
        free = wheel.speed + (motor - force_x) / wheel_kg * STEP_S
        gear = GEAR_SHARE * full / wheel_kg * STEP_S
        wheel.speed = max(0.0, free - gear) if free > 0 else min(0.0, free + gear)
    return ahead, left, torque
