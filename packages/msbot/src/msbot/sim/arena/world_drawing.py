"""A world as a picture (SVG): the page moves robots and boxes in it, `msbot arena show --svg` writes it to a file.

One unit is one millimetre; y points down, as SVG has it, so the world is mirrored and angles change their sign.
"""

from __future__ import annotations

from html import escape

from msbot.sim.arena.world_plan import Area, Box, ChassisKind, Colour, Outline, Point, RobotPlan, WorldPlan

BORDER_MM = 25
"""Width of the walls around a world."""


def world_svg(plan: WorldPlan) -> str:
    """The picture of a world at its beginning. Its texts are escaped."""
    width, height = 1000 * plan.width_m, 1000 * plan.height_m
    edge = BORDER_MM if plan.border else 4
    inside = [
        f'<rect class="arena-floor" x="0" y="0" width="{width:g}" height="{height:g}" fill="{_paint(plan.floor)}"/>',
        *(_area(plan, area) for area in plan.areas),
        *(
            f'<polyline class="arena-line" points="{_points(plan, line.points)}" fill="none" '
            f'stroke="{_paint(line.colour)}" stroke-width="{1000 * line.width_m:g}" stroke-linejoin="round" '
            'stroke-linecap="round"/>'
            for line in plan.lines
        ),
        *(_magnet(plan, magnet.at, magnet.reach_m) for magnet in plan.magnets),
        f'<svg x="0" y="0" width="{width:g}" height="{height:g}">',  # light ends at the walls around
        *(_lamp(plan, lamp.at, lamp.lux) for lamp in plan.lamps),
        "</svg>",
        *(_noise(plan, noise.at) for noise in plan.noises),
        *(
            f'<polyline class="arena-wall" points="{_points(plan, wall.points)}" fill="none" '
            f'stroke="{_paint(wall.colour)}" stroke-width="{1000 * wall.thickness_m:g}" stroke-linejoin="round" '
            'stroke-linecap="round"/>'
            for wall in plan.walls
        ),
        *(
            f'<circle class="arena-wall" {_centre(plan, post.at)} r="{1000 * post.radius_m:g}" '
            f'fill="{_paint(post.colour)}"/>'
            for post in plan.posts
        ),
        '<g class="arena-trails"></g><g class="arena-rays"></g>',
        *(_box(plan, box) for box in plan.boxes),
        *(_robot(plan, robot) for robot in plan.robots),
    ]
    frame = ""
    if plan.border:
        frame = (
            f'<rect class="arena-border" x="{-edge / 2:g}" y="{-edge / 2:g}" width="{width + edge:g}" '
            f'height="{height + edge:g}" fill="none" stroke="#785032" stroke-width="{edge}"/>'
        )
    box = f"{-edge:g} {-edge:g} {width + 2 * edge:g} {height + 2 * edge:g}"
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" class="arena" viewBox="{box}" role="group" '
        f'aria-label="{escape(plan.name)}" data-height="{height:g}">{"".join(inside)}{frame}</svg>'
    )


def _paint(colour: Colour) -> str:
    return "#{:02x}{:02x}{:02x}".format(*colour)


def _at(plan: WorldPlan, point: Point) -> Point:
    return 1000 * point[0], 1000 * (plan.height_m - point[1])


def _points(plan: WorldPlan, points: tuple[Point, ...]) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in (_at(plan, point) for point in points))


def _centre(plan: WorldPlan, point: Point) -> str:
    x, y = _at(plan, point)
    return f'cx="{x:.1f}" cy="{y:.1f}"'


def _area(plan: WorldPlan, area: Area) -> str:
    points = _points(plan, area.corners)
    fill = "none" if area.colour is None else _paint(area.colour)
    found = f'<polygon class="arena-area" points="{points}" fill="{fill}"/>'
    if area.slope_deg:
        x = sum(corner[0] for corner in area.corners) / len(area.corners)
        y = sum(corner[1] for corner in area.corners) / len(area.corners)
        cx, cy = _at(plan, (x, y))
        found += (
            f'<path class="arena-slope" d="M-70,0 L60,0 M30,-25 L62,0 L30,25" fill="none" stroke="#555" '
            f'stroke-width="8" transform="translate({cx:.1f} {cy:.1f}) rotate({-area.downhill_deg:g})"/>'
        )
    if area.grip is not None:
        found += f'<polygon points="{points}" fill="none" stroke="#555" stroke-width="4" stroke-dasharray="6 12"/>'
    return found


def _magnet(plan: WorldPlan, at: Point, reach_m: float) -> str:
    x, y = _at(plan, at)
    return (
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{1000 * reach_m:g}" fill="none" stroke="#a11" stroke-width="3" '
        f'stroke-dasharray="4 8"/><path d="M-14,-14 v14 a14,14 0 0 0 28,0 v-14" fill="none" stroke="#a11" '
        f'stroke-width="9" transform="translate({x:.1f} {y:.1f})"/>'
    )


def _lamp(plan: WorldPlan, at: Point, lux: float) -> str:
    x, y = _at(plan, at)
    reach = min(700.0, 250 * lux**0.5 / 15)
    return (
        f'<circle class="arena-light" cx="{x:.1f}" cy="{y:.1f}" r="{reach:.0f}" fill="#ffd34d" opacity=".18"/>'
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="16" fill="#ffc400" stroke="#7a5c00" stroke-width="4"/>'
    )


def _noise(plan: WorldPlan, at: Point) -> str:
    x, y = _at(plan, at)
    return (
        '<path d="M-18,-8 h10 l12,-12 v40 l-12,-12 h-10 z M12,-14 a20,20 0 0 1 0,28 M22,-24 a34,34 0 0 1 0,48" '
        f'fill="none" stroke="#446" stroke-width="5" transform="translate({x:.1f} {y:.1f})"/>'
    )


def _turned(plan: WorldPlan, at: Point, degrees: float) -> str:
    x, y = _at(plan, at)
    return f'transform="translate({x:.2f} {y:.2f}) rotate({-degrees:.2f})"'


def _box(plan: WorldPlan, box: Box) -> str:
    length, width = 1000 * box.size[0], 1000 * box.size[1]
    return (
        f'<g class="arena-box" data-name="{escape(box.name)}" {_turned(plan, box.at, box.heading_deg)}>'
        f'<title>{escape(box.name)}</title><rect x="{-length / 2:g}" y="{-width / 2:g}" width="{length:g}" '
        f'height="{width:g}" rx="3" fill="{_paint(box.colour)}" stroke="#222" stroke-width="3"/></g>'
    )


def _robot(plan: WorldPlan, robot: RobotPlan) -> str:
    """A robot as seen from above: chassis, wheels, an arrow ahead, its lamp; parts are added where they sit."""
    chassis = robot.chassis
    length, width = 1000 * chassis.length_m, 1000 * chassis.width_m
    wheel, y = 1000 * chassis.wheel_m, 1000 * chassis.track_m / 2
    axles = (0.0,) if chassis.kind is ChassisKind.DIFFERENTIAL else (500 * chassis.base_m, -500 * chassis.base_m)
    wheels = "".join(
        f'<rect x="{x - wheel / 2:g}" y="{side * y - 11:g}" width="{wheel:g}" height="22" rx="5" fill="#222"/>'
        for x in axles
        for side in (-1, 1)
    )
    paint = f'fill="{_paint(robot.colour)}" stroke="#111" stroke-width="4"'
    body = (
        f'<circle r="{length / 2:g}" {paint}/>'
        if chassis.shape is Outline.ROUND
        else f'<rect x="{-length / 2:g}" y="{-width / 2:g}" width="{length:g}" height="{width:g}" rx="14" {paint}/>'
    )
    return (
        f'<g class="arena-robot" data-name="{escape(robot.name)}" {_turned(plan, robot.start, robot.heading_deg)}>'
        f"<title>{escape(robot.name)}</title>{body}{wheels}"
        f'<path d="M{length / 2 - 46:g},-24 l32,24 l-32,24 z" fill="#fff" opacity=".9"/>'
        '<circle class="arena-lamp" r="17" fill="#ddd" stroke="#111" stroke-width="3"/><g class="arena-parts"></g></g>'
    )
