"""Reads a world file; every mistake becomes a problem with file, line and what would be right."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cache
from itertools import pairwise
from pathlib import Path

from msbot.sim.arena.world_plan import (
    COLOURS,
    Area,
    Box,
    Chassis,
    ChassisKind,
    Colour,
    Lamp,
    Looks,
    Magnet,
    Noise,
    Outline,
    PartPlace,
    Point,
    Post,
    RobotPlan,
    Stripe,
    Wall,
    WorldPlan,
)
from msbot_agent.startup.extensions import extensions
from msbot_agent.text.similar_names import did_you_mean, nearest
from msbot_agent.toml.document import Document, parse_document, read_document
from msbot_agent.toml.problems import Problems, suggestion, toml_value_in_words
from msbot_agent.toml.table import Table
from msbot_xrce.counting import amount
from msbot_xrce.errors import ConfigError

# Values that only world files have: colours, angles, points; a mistake becomes a problem.


def colour(table: Table, key: str, default: Colour) -> Colour:
    """A colour by name, or red, green and blue."""
    value = table.item(key)
    if value is None:
        return default
    if isinstance(value, list):
        red, green, blue = numbers(table, value, 3, "[255, 128, 0]", key)
        if not all(0 <= part <= 255 for part in (red, green, blue)):
            table.report("red, green and blue are 0 to 255", key)
        return round(red), round(green), round(blue)
    if isinstance(value, str) and value in COLOURS:
        return COLOURS[value]
    right = suggestion(str(value), list(COLOURS), none_known="")
    table.report(
        f"must be a colour, by name or as [red, green, blue]; it is {toml_value_in_words(value)}; {right}", key
    )
    return default


def degrees(table: Table, key: str, default: float) -> float:
    """An angle."""
    return table.number(key, default=default, least=-360.0, most=360.0, unit="degrees")


def pair(table: Table, value: object, example: str, *steps: str | int) -> Point:
    """Two numbers."""
    x, y = numbers(table, value, 2, example, *steps)
    return x, y


def numbers(table: Table, value: object, count: int, example: str, *steps: str | int) -> list[float]:
    """A list of so many numbers."""
    if isinstance(value, list) and len(value) == count and all(_is_number(item) for item in value):
        return [float(item) for item in value]
    what = f"a list of {len(value)}" if isinstance(value, list) else toml_value_in_words(value)
    table.report(f"must be {count} numbers, for example {example}; it is {what}", *steps)
    return [0.0] * count


def _is_number(item: object) -> bool:
    return isinstance(item, int | float) and not isinstance(item, bool) and abs(item) <= 1e6


# Reads what a world file says of a robot: its chassis, and where its parts sit.


def read_mount(table: Table) -> PartPlace:
    """One table [[robot.part]]."""
    mount = PartPlace(
        slot=table.name("slot", "eyes"),
        at=pair(table, table.item("at"), "[0.1, 0.0]", "at") if "at" in table else None,
        turn_deg=degrees(table, "turn_deg", 0.0) if "turn_deg" in table else None,
        looks=Looks(table.choice("looks", [look.value for look in Looks])) if "looks" in table else None,
        side=table.choice("side", ("left", "right")) if "side" in table else "",
        axle=table.choice("axle", ("front", "rear")) if "axle" in table else "",
        on=table.name("on", "neck", default=""),
        width_m=table.number("width_m", default=0.07, least=0.005, most=1.0, unit="m") if "width_m" in table else None,
        cone_deg=table.number("cone_deg", default=20.0, least=0.0, most=120.0, unit="degrees")
        if "cone_deg" in table
        else None,
    )
    if mount.at is not None and not all(-1.0 <= coordinate <= 1.0 for coordinate in mount.at):
        table.report("must be on the robot: x ahead and y to the left, in metres, -1 to 1", "at")
    table.finish()
    return mount


def read_chassis(table: Table) -> Chassis:
    """The table [robot.chassis]."""
    usual = Chassis()

    def metres(key: str, default: float, least: float = 0.02, most: float = 2.0) -> float:
        return table.number(key, default=default, least=least, most=most, unit="m")

    length, width = metres("length_m", usual.length_m), metres("width_m", usual.width_m)
    chassis = Chassis(
        kind=ChassisKind(table.choice("kind", [kind.value for kind in ChassisKind], default="differential")),
        shape=Outline(table.choice("shape", [shape.value for shape in Outline], default="rectangle")),
        length_m=length,
        width_m=width,
        mass_kg=table.number("mass_kg", default=usual.mass_kg, least=0.05, most=100.0, unit="kg"),
        track_m=metres("track_m", min(usual.track_m, width)),
        base_m=metres("base_m", min(usual.base_m, length)),
        wheel_m=metres("wheel_m", usual.wheel_m, 0.01, 1.0),
        speed_m_s=table.number("speed_m_s", default=usual.speed_m_s, least=0.01, most=5.0, unit="m/s"),
        force_n=table.number("force_n", default=usual.force_n, least=0.05, most=500.0, unit="N"),
        grip=table.number("grip", default=usual.grip, least=0.05, most=2.0),
    )
    if chassis.track_m > width:
        table.report(f"is {chassis.track_m:g}; the wheels must be on the chassis, at most {width:g} m", "track_m")
    if chassis.base_m > length:
        table.report(f"is {chassis.base_m:g}; the axles must be on the chassis, at most {length:g} m", "base_m")
    table.finish()
    return chassis


SHIPPED = Path(__file__).parent / "worlds"
"""The worlds that MsBOT brings."""
MOST_M = 50.0
MOST_THINGS = 500
MOST_POINTS = 500
MOST_ROBOTS = 40
MOST_BROUGHT = 50
"""Worlds of one extension that are read."""
CIRCLE_CORNERS = 48
SMOOTH_STEPS = 10
"""Straight pieces between two points of a smooth line."""


def shipped_worlds() -> tuple[str, ...]:
    """The names of the worlds that MsBOT brings."""
    return tuple(sorted(path.stem for path in SHIPPED.glob("*.toml")))


@cache
def brought_worlds() -> Mapping[str, Path]:
    """The files of the worlds that extensions bring, by name; an extension with a mistake in a file brings none."""
    found = dict[str, Path]()
    for name, folder in extensions().folders("worlds").items():
        files = {path.stem: path for path in sorted(folder.glob("*.toml"))[:MOST_BROUGHT]}
        try:
            for path in files.values():
                _read_file(path)
        except ConfigError as error:
            extensions().leave_out_named("worlds", name, str(error))
            continue
        if taken := sorted(set(files) & {*shipped_worlds(), *found}):
            extensions().leave_out_named("worlds", name, f"there is a world {taken[0]!r} already")
            continue
        found.update(files)
    return found


def known_worlds() -> tuple[str, ...]:
    """The names of all worlds: those that MsBOT brings, and then those of extensions."""
    return (*shipped_worlds(), *brought_worlds())


def open_world(name: str) -> WorldPlan:
    """The world of that name, or of that file.

    Raises:
        ConfigError: there is neither, or the file has mistakes: all of them, with their lines.
    """
    if name in shipped_worlds():
        return _read_file(SHIPPED / f"{name}.toml")
    return _read_file(brought_worlds().get(name, Path(name)))


def _read_file(path: Path) -> WorldPlan:
    names = shipped_worlds()
    problems = Problems()
    near = nearest(str(path), names)
    right = did_you_mean(near) if near else f"write a file, or one of {', '.join(names)}"
    document = read_document(path, problems, if_missing=right)
    return _read(document, problems)


def parse_world(text: str, file: str = "world.toml") -> WorldPlan:
    """The world of a text.

    Raises:
        ConfigError: the text has mistakes.
    """
    problems = Problems()
    return _read(parse_document(text, file, problems), problems)


def _read(document: Document | None, problems: Problems) -> WorldPlan:
    if document is None:
        problems.raise_if_any()
        raise AssertionError("a document that cannot be read is a problem")
    table = Table(document, problems, document.values)
    plan = _WorldReader(table).read(document.file)
    problems.raise_if_any()
    return plan


class _WorldReader:
    def __init__(self, table: Table) -> None:
        self._table = table
        self._width = self._height = 1.0

    def read(self, file: str) -> WorldPlan:
        world = self._table.table("world", required=True)
        self._width = world.number("width_m", default=2.0, least=0.3, most=MOST_M, unit="m")
        self._height = world.number("height_m", default=1.5, least=0.3, most=MOST_M, unit="m")
        plan = WorldPlan(
            name=world.name("name", "My world"),
            width_m=self._width,
            height_m=self._height,
            description=world.text("description", "A track with two curves"),
            age=world.whole("age", default=0, least=0, most=99),
            minutes=world.whole("minutes", default=0, least=0, most=1000),
            floor=colour(world, "floor", COLOURS["white"]),
            ambient_lx=world.number("ambient_lx", default=300.0, least=0.0, most=100_000.0, unit="lx"),
            quiet_percent=world.number("quiet_percent", default=8.0, least=0.0, most=100.0, unit="%"),
            north_deg=degrees(world, "north_deg", 90.0),
            seed=world.whole("seed", default=1, least=0, most=2**31 - 1),
            border=world.flag("border", default=True),
            walls=tuple(self._wall(table) for table in self._tables("wall")),
            posts=tuple(self._post(table) for table in self._tables("post")),
            lines=tuple(self._line(table) for table in self._tables("line")),
            areas=tuple(self._area(table) for table in self._tables("area")),
            lamps=tuple(self._lamp(table) for table in self._tables("lamp")),
            magnets=tuple(self._magnet(table) for table in self._tables("magnet")),
            noises=tuple(self._noise(table) for table in self._tables("noise")),
            boxes=tuple(self._box(number, table) for number, table in enumerate(self._tables("box"), 1)),
            robots=self._robots(),
            source=file,
        )
        world.finish()
        self._table.finish()
        return plan

    def _tables(self, key: str, most: int = MOST_THINGS) -> list[Table]:
        tables = self._table.tables(key)
        if len(tables) > most:
            self._table.report(f"there are {len(tables)}; at most {most} fit into a world", key)
        return tables[:most]

    def _wall(self, table: Table) -> Wall:
        wall = Wall(
            self._points(table, least=2),
            table.number("thickness_m", default=0.02, least=0.005, most=1.0, unit="m"),
            colour(table, "colour", COLOURS["brown"]),
        )
        table.finish()
        return wall

    def _post(self, table: Table) -> Post:
        radius = table.number("radius_m", default=0.05, least=0.005, most=5.0, unit="m")
        post = Post(self._point(table, "at"), radius, colour(table, "colour", COLOURS["brown"]))
        table.finish()
        return post

    def _line(self, table: Table) -> Stripe:
        closed = table.flag("closed", default=False)
        smooth = table.flag("smooth", default=False)
        points = self._points(table, least=3 if closed else 2)
        if smooth:
            points = _smooth(points, closed=closed)
        elif closed:
            points = (*points, points[0])
        width = table.number("width_m", default=0.019, least=0.002, most=1.0, unit="m")
        line = Stripe(points, width, colour(table, "colour", COLOURS["black"]))
        table.finish()
        return line

    def _area(self, table: Table) -> Area:
        slope = table.number("slope_deg", default=0.0, least=0.0, most=30.0, unit="degrees")
        area = Area(
            self._corners(table),
            colour(table, "colour", COLOURS["grey"]) if "colour" in table else None,
            table.number("grip", default=0.8, least=0.0, most=2.0) if "grip" in table else None,
            slope,
            degrees(table, "downhill_deg", 0.0),
            table.text("name", "the garage"),
        )
        table.finish()
        return area

    def _corners(self, table: Table) -> tuple[Point, ...]:
        if "rectangle" in table:
            if "points" in table:
                table.report("a rectangle has no points; remove one of them", "points")
            x, y, width, height = numbers(table, table.item("rectangle"), 4, "[x, y, width, height]", "rectangle")
            if width <= 0 or height <= 0:
                table.report("width and height must be more than 0: [x, y, width, height] in metres", "rectangle")
            corners: tuple[Point, ...] = ((x, y), (x + width, y), (x + width, y + height), (x, y + height))
            for corner in corners:
                self._check_inside(table, corner, "rectangle")
            return corners
        if "circle" in table:
            x, y, radius = numbers(table, table.item("circle"), 3, "[x, y, radius]", "circle")
            self._check_inside(table, (x, y), "circle")
            turns = [math.tau * corner / CIRCLE_CORNERS for corner in range(CIRCLE_CORNERS)]
            return tuple((round(x + radius * math.cos(t), 6), round(y + radius * math.sin(t), 6)) for t in turns)
        corners = self._points(table, least=3)
        if not _is_convex(corners):
            table.report("the corners must go round without a dent; make two areas of it", "points")
        return corners

    def _lamp(self, table: Table) -> Lamp:
        lamp = Lamp(self._point(table, "at"), table.number("lux", default=800.0, least=0.0, most=100_000.0, unit="lx"))
        table.finish()
        return lamp

    def _magnet(self, table: Table) -> Magnet:
        reach = table.number("reach_m", default=0.03, least=0.005, most=1.0, unit="m")
        magnet = Magnet(self._point(table, "at"), reach)
        table.finish()
        return magnet

    def _noise(self, table: Table) -> Noise:
        percent = table.number("percent", default=60.0, least=0.0, most=100.0, unit="%")
        noise = Noise(self._point(table, "at"), percent)
        table.finish()
        return noise

    def _box(self, number: int, table: Table) -> Box:
        size = (0.04, 0.04)
        if "size" in table:
            size = pair(table, table.item("size"), "[0.04, 0.04]", "size")
            if not all(0.01 <= side <= 5.0 for side in size):
                table.report("length and width must be 0.01 to 5 m", "size")
        box = Box(
            table.name("name", "red box", default=f"box {number}"),
            self._point(table, "at"),
            size,
            degrees(table, "heading_deg", 0.0),
            colour(table, "colour", COLOURS["orange"]),
            table.number("mass_kg", default=0.05, least=0.005, most=100.0, unit="kg"),
            table.number("scatter_m", default=0.0, least=0.0, most=5.0, unit="m"),
        )
        table.finish()
        return box

    def _robots(self) -> tuple[RobotPlan, ...]:
        tables = self._tables("robot", MOST_ROBOTS)
        if not tables:
            self._table.report('a world needs a place for a robot; add [[robot]] with name = "robot"', "robot")
        robots: list[RobotPlan] = []
        for table in tables:
            robot = self._robot(table)
            if robot.name in [other.name for other in robots]:
                table.report(f'there is another robot "{robot.name}" already; choose another name', "name")
            robots.append(robot)
        return tuple(robots)

    def _robot(self, table: Table) -> RobotPlan:
        mounts: list[PartPlace] = []
        for part in table.tables("part"):
            mount = read_mount(part)
            if mount.slot in [other.slot for other in mounts]:
                part.report(f'slot "{mount.slot}" has a place already; remove one of them', "slot")
            mounts.append(mount)
        for number, mount in enumerate(mounts):
            if mount.on and (mount.on == mount.slot or mount.on not in [other.slot for other in mounts]):
                right = suggestion(mount.on, [other.slot for other in mounts if other is not mount], none_known="")
                table.report(f'"{mount.on}" is no other part of this robot; {right}', "part", number, "on")
        robot = RobotPlan(
            table.name("name", "robot"),
            self._point(table, "start"),
            degrees(table, "heading_deg", 0.0),
            read_chassis(table.table("chassis")),
            colour(table, "colour", COLOURS["blue"]),
            tuple(mounts),
        )
        table.finish()
        return robot

    def _points(self, table: Table, *, least: int) -> tuple[Point, ...]:
        value = table.item("points")
        example = "points = [[0.2, 0.3], [0.8, 0.3]]"
        if not isinstance(value, list) or not least <= len(value) <= MOST_POINTS:
            what = "is missing" if value is None else f"is {toml_value_in_words(value)}"
            if isinstance(value, list):
                what = f"has {amount(len(value), 'point')}"
            table.report(f"{what}; write {least} to {MOST_POINTS} points in metres, for example {example}", "points")
            return ((0.0, 0.0), (0.1, 0.0), (0.0, 0.1))
        points = []
        for place, item in enumerate(value):
            point = pair(table, item, "[0.2, 0.3]", "points", place)
            self._check_inside(table, point, "points", place)
            points.append(point)
        for place, (one, other) in enumerate(pairwise(points), 1):
            if one == other:
                table.report("is the same point as the one before; remove it", "points", place)
        return tuple(points)

    def _point(self, table: Table, key: str) -> Point:
        value = table.item(key)
        if value is None:
            table.report(f"is missing; add a line such as {key} = [0.5, 0.4], in metres", key)
            return (0.0, 0.0)
        point = pair(table, value, "[0.5, 0.4]", key)
        self._check_inside(table, point, key)
        return point

    def _check_inside(self, table: Table, point: Point, *steps: str | int) -> None:
        if not (0 <= point[0] <= self._width and 0 <= point[1] <= self._height):
            table.report(
                f"[{point[0]:g}, {point[1]:g}] is outside the world, which goes from [0, 0] to "
                f"[{self._width:g}, {self._height:g}]",
                *steps,
            )


def _is_convex(points: tuple[Point, ...]) -> bool:
    turns = []
    for place, (x, y) in enumerate(points):
        (ax, ay), (bx, by) = points[place - 1], points[(place + 1) % len(points)]
        turns.append((x - ax) * (by - y) - (y - ay) * (bx - x))
    return all(turn > 0 for turn in turns) or all(turn < 0 for turn in turns)


def _smooth(points: tuple[Point, ...], *, closed: bool) -> tuple[Point, ...]:
    """A Catmull-Rom spline through the points (Catmull, Rom: A Class of Local Interpolating Splines, 1974)."""
    count = len(points)
    found: list[Point] = []
    for place in range(count if closed else count - 1):
        if closed:
            a, b, c, d = (points[(place + step) % count] for step in (-1, 0, 1, 2))
        else:
            a, b, c, d = (points[min(max(place + step, 0), count - 1)] for step in (-1, 0, 1, 2))
        for step in range(SMOOTH_STEPS):
            t = step / SMOOTH_STEPS
            found.append((_spline(t, a[0], b[0], c[0], d[0]), _spline(t, a[1], b[1], c[1], d[1])))
    found.append(points[0] if closed else points[-1])
    return tuple(found)


def _spline(t: float, a: float, b: float, c: float, d: float) -> float:
    value = 0.5 * (2 * b + (c - a) * t + (2 * a - 5 * b + 4 * c - d) * t**2 + (3 * b - a - 3 * c + d) * t**3)
    return round(value, 6) if math.isfinite(value) else 0.0
