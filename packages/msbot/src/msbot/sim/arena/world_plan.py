"""What a world is made of. Metres; degrees counter-clockwise from the x axis (east); kilograms; lux.

A robot's own frame: x ahead, y to its left, the origin in the middle of its chassis.
"""

from __future__ import annotations

from dataclasses import field
from enum import Enum

from msbot_xrce.lazy import dataclass

Point = tuple[float, float]

Colour = tuple[int, int, int]
"""Red, green, blue, 0 to 255."""

COLOURS: dict[str, Colour] = {
    "white": (245, 245, 242),
    "light grey": (200, 200, 198),
    "grey": (128, 128, 128),
    "black": (20, 20, 20),
    "red": (204, 44, 36),
    "green": (40, 140, 60),
    "blue": (30, 90, 190),
    "yellow": (240, 200, 40),
    "orange": (230, 120, 20),
    "purple": (120, 60, 160),
    "brown": (120, 80, 50),
}
"""Colours by name, as paint looks."""


@dataclass(frozen=True, slots=True)
class Wall:
    """Something that nobody can push: a row of straight pieces."""

    points: tuple[Point, ...]
    thickness_m: float
    colour: Colour


@dataclass(frozen=True, slots=True)
class Post:
    """A round thing that nobody can push."""

    at: Point
    radius_m: float
    colour: Colour


@dataclass(frozen=True, slots=True)
class Stripe:
    """A stripe on the floor."""

    points: tuple[Point, ...]
    """Already rounded where the file wanted a smooth one; the first one again at the end of a closed one."""
    width_m: float
    colour: Colour


@dataclass(frozen=True, slots=True)
class Area:
    """A part of the floor: another colour, another grip, a slope. Later ones lie on earlier ones."""

    corners: tuple[Point, ...]
    """Convex."""
    colour: Colour | None
    """None: that of what is below."""
    grip: float | None
    """Coefficient of friction of a tyre; None: that of what is below."""
    slope_deg: float
    downhill_deg: float
    """Direction in which it goes down."""
    name: str = ""


@dataclass(frozen=True, slots=True)
class Lamp:
    """A light; what it gives falls with the square of the distance, and walls and boxes cast shadows."""

    at: Point
    lux: float
    """At a distance of one metre."""


@dataclass(frozen=True, slots=True)
class Magnet:
    """A magnet in the floor."""

    at: Point
    reach_m: float
    """A door contact nearer than this closes."""


@dataclass(frozen=True, slots=True)
class Noise:
    """A source of sound that never stops."""

    at: Point
    percent: float
    """How loud it is next to it."""


@dataclass(frozen=True, slots=True)
class Box:
    """A thing that can be pushed, and held by a gripper if it is narrow enough."""

    name: str
    at: Point
    size: Point
    """Length and width."""
    heading_deg: float
    colour: Colour
    mass_kg: float
    scatter_m: float
    """It begins up to this far from `at`, drawn from the seed."""


class ChassisKind(Enum):
    """How a chassis drives."""

    DIFFERENTIAL = "differential"
    """Two wheels at the sides and a castor."""
    OMNI = "omni"
    """Four Mecanum wheels: it can drive sideways as well."""


class Outline(Enum):
    """What a chassis looks like from above."""

    RECTANGLE = "rectangle"
    ROUND = "round"


@dataclass(frozen=True, slots=True)
class Chassis:
    """What a robot stands on."""

    kind: ChassisKind = ChassisKind.DIFFERENTIAL
    shape: Outline = Outline.RECTANGLE
    length_m: float = 0.20
    width_m: float = 0.16
    mass_kg: float = 0.9
    track_m: float = 0.14
    """Distance between the left and the right wheels."""
    base_m: float = 0.12
    """Distance between the front and the rear wheels of an omnidirectional chassis."""
    wheel_m: float = 0.065
    """Diameter of a wheel."""
    speed_m_s: float = 0.5
    """At full power, without load."""
    force_n: float = 1.6
    """What a wheel pushes with at full power when it is held."""
    grip: float = 0.8
    """Coefficient of friction of its tyres on the ordinary floor."""


class Looks(Enum):
    """Where a sensor of colour or light looks."""

    DOWN = "down"
    AHEAD = "ahead"
    UP = "up"


@dataclass(frozen=True, slots=True)
class PartPlace:
    """Where a part sits on the chassis."""

    slot: str
    at: Point | None = None
    """In the robot's frame; None: a place that fits its type, see `places`."""
    turn_deg: float | None = None
    """Where it faces, counter-clockwise from ahead."""
    looks: Looks | None = None
    side: str = ""
    """`left` or `right`: the wheel of an encoder."""
    axle: str = ""
    """`front` or `rear`: the wheels of a motor driver or an encoder of an omnidirectional chassis; "" = both."""
    on: str = ""
    """The slot of a servo that it sits on and turns with."""
    width_m: float | None = None
    """Of a line follower, a gripper or a bumper."""
    cone_deg: float | None = None
    """Opening of what a distance sensor sees."""


@dataclass(frozen=True, slots=True)
class RobotPlan:
    """A place for a robot: its chassis, where it starts, and where its parts sit."""

    name: str
    start: Point
    heading_deg: float
    chassis: Chassis
    colour: Colour
    mounts: tuple[PartPlace, ...] = ()


@dataclass(frozen=True, slots=True)
class WorldPlan:
    """A world before anything has happened in it."""

    name: str
    width_m: float
    height_m: float
    description: str = ""
    age: int = 0
    """From which age on its task suits; 0: not said."""
    minutes: int = 0
    """How long its task takes; 0: not said."""
    floor: Colour = COLOURS["white"]
    ambient_lx: float = 300.0
    quiet_percent: float = 8.0
    """How loud it is when nobody makes a noise."""
    north_deg: float = 90.0
    """Where a compass points to."""
    seed: int = 1
    border: bool = True
    """Whether walls stand around it; without them a robot can leave it."""
    walls: tuple[Wall, ...] = ()
    posts: tuple[Post, ...] = ()
    lines: tuple[Stripe, ...] = ()
    areas: tuple[Area, ...] = ()
    lamps: tuple[Lamp, ...] = ()
    magnets: tuple[Magnet, ...] = ()
    noises: tuple[Noise, ...] = ()
    boxes: tuple[Box, ...] = ()
    robots: tuple[RobotPlan, ...] = ()
    source: str = field(default="", compare=False)
    """The file that it was read from."""

    def robot(self, name: str) -> RobotPlan | None:
        """The place of that name."""
        return next((robot for robot in self.robots if robot.name == name), None)
