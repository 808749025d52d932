"""`msbot arena`: check and show the worlds that simulated robots drive in."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import click

from msbot.cli.change.robot_access import perform, say
from msbot.cli.robot_options import mistakes_told, robot_and_json_options, robot_options
from msbot.sim.arena.world_plan import PartPlace, RobotPlan, WorldPlan
from msbot_agent.cli.options import FiniteRange, WholeRange, json_option
from msbot_agent.cli.table import print_table
from msbot_xrce.errors import ConfigError


@click.group("arena")
def command() -> None:
    """Worlds for simulated robots: list, check and show them; control that of the robot that runs here."""


@command.command("list")
@json_option
def list_worlds(*, as_json: bool) -> None:
    """List the worlds of MsBOT and of extensions."""
    from msbot.sim.arena.world_reader import known_worlds, open_world

    worlds = [(name, open_world(name)) for name in known_worlds()]
    if as_json:
        click.echo(json.dumps([{"name": name, **world_json(world)} for name, world in worlds]))
        return
    print_table(("world", "title", "description"), [(name, world.name, world.description) for name, world in worlds])


@command.command("check")
@click.argument("world", metavar="FILE")
@json_option
def check(world: str, *, as_json: bool) -> None:
    """Check a world file; mistakes are reported with file, line and remedy (exit status 2)."""
    from msbot.sim.arena.world_reader import open_world

    with mistakes_told(as_json=as_json):
        plan = open_world(world)
    if as_json:
        click.echo(json.dumps({"problems": []}))
        return
    click.echo(f"No mistake: {plan.name}, {plan.width_m:g} x {plan.height_m:g} m.")


@command.command("show")
@click.argument("world", metavar="FILE|NAME")
@click.option("--svg", metavar="FILE", type=click.Path(path_type=Path), help="Write its picture to an SVG file.")
@json_option
def show(world: str, svg: Path | None, *, as_json: bool) -> None:
    """Show what is in a world: its size, things, and robots."""
    from msbot.sim.arena.world_drawing import world_svg
    from msbot.sim.arena.world_reader import open_world

    plan = open_world(world)
    if svg is not None:
        try:
            svg.write_text(world_svg(plan), encoding="utf-8")
        except OSError as error:
            raise ConfigError(f"cannot write {svg}: {error.strerror}") from None
    click.echo(json.dumps(world_json(plan)) if as_json else world_page(plan))


@command.command("status")
@json_option
@robot_options
def status(db: str | None, robot: str | None, *, as_json: bool) -> None:
    """Show the time and all positions in the world of the robot that runs here."""

    found = perform(db, robot, "world", {})
    click.echo(json.dumps(found) if as_json else status_page(found))


@command.command("pause")
@click.option("--off", is_flag=True, help="Continue.")
@robot_and_json_options
def pause(db: str | None, robot: str | None, *, off: bool) -> None:
    """Pause the world of the robot that runs here, not its programs; --off continues."""
    say(db, robot, "pause_world", {"off": off})


@command.command("step")
@click.option("--steps", type=WholeRange(1, 500), default=1, help="Number of steps, 1/50 s each.")
@robot_and_json_options
def step(db: str | None, robot: str | None, steps: int) -> None:
    """Run the world for one step of 1/50 s, or --steps of them, then pause it."""
    say(db, robot, "step_world", {"steps": steps})


@command.command("reset")
@robot_and_json_options
def reset(db: str | None, robot: str | None) -> None:
    """Put everything in the world back to its start."""
    say(db, robot, "reset_world", {})


@command.command("speed")
@click.argument("speed", type=FiniteRange())
@robot_and_json_options
def speed(speed: float, db: str | None, robot: str | None) -> None:
    """Set the speed of the world: 0.25, 0.5, 1, 2 or 4 times real time."""
    say(db, robot, "world_speed", {"speed": speed})


@command.command("put")
@click.argument("name", metavar="ROBOT")
@click.argument("at", nargs=2, type=FiniteRange(), metavar="X Y")
@click.option(
    "--heading",
    type=FiniteRange(),
    metavar="DEGREES",
    help="Its heading, counter-clockwise from east; default: unchanged.",
)
@robot_and_json_options
def put(name: str, at: tuple[float, float], heading: float | None, db: str | None, robot: str | None) -> None:
    """Move a robot of the world; X and Y in metres from the left and from below."""
    turned = {} if heading is None else {"heading": heading}
    say(db, robot, "put_robot", {"robot": name, "x": at[0], "y": at[1], **turned})


# A world in words.


def _counts(plan: WorldPlan) -> dict[str, int]:
    return {
        "walls": len(plan.walls),
        "posts": len(plan.posts),
        "lines": len(plan.lines),
        "areas": len(plan.areas),
        "lamps": len(plan.lamps),
        "magnets": len(plan.magnets),
        "noises": len(plan.noises),
        "boxes": len(plan.boxes),
    }


def world_json(plan: WorldPlan) -> dict[str, object]:
    """The world for programs; metres and degrees."""
    return {
        "title": plan.name,
        "description": plan.description,
        "width_m": plan.width_m,
        "height_m": plan.height_m,
        "seed": plan.seed,
        "things": _counts(plan),
        "robots": [
            {
                "name": robot.name,
                "start": list(robot.start),
                "heading_deg": robot.heading_deg,
                "chassis": robot.chassis.kind.value,
                "parts": [mount.slot for mount in robot.mounts],
            }
            for robot in plan.robots
        ],
    }


def world_page(plan: WorldPlan) -> str:
    """The world for people."""
    things = ", ".join(f"{count} {name}" for name, count in _counts(plan).items() if count)
    lines = [f"{plan.name}, {plan.width_m:g} x {plan.height_m:g} m, seed {plan.seed}"]
    if plan.description:
        lines.append(plan.description)
    if things:
        lines.append(things)
    for robot in plan.robots:
        lines += ["", *_robot(robot)]
    return "\n".join(lines)


def _robot(robot: RobotPlan) -> list[str]:
    chassis = robot.chassis
    return [
        f"robot {robot.name}: {chassis.kind.value}, {100 * chassis.length_m:g} x {100 * chassis.width_m:g} cm, "
        f"{chassis.mass_kg:g} kg, {chassis.speed_m_s:g} m/s; starts at [{robot.start[0]:g}, {robot.start[1]:g}], "
        f"heading {robot.heading_deg:g} degrees",
        *(f"  {mount.slot}: {_mount(mount)}" for mount in robot.mounts),
    ]


def _mount(mount: PartPlace) -> str:
    words = []
    if mount.at is not None:
        words.append(f"at [{mount.at[0]:g}, {mount.at[1]:g}]")
    if mount.turn_deg is not None:
        words.append(f"turned {mount.turn_deg:g} degrees")
    if mount.looks is not None:
        words.append(f"looks {mount.looks.value}")
    if mount.side:
        words.append(f"at the {mount.side} wheel")
    if mount.axle:
        words.append(f"{mount.axle} axle")
    if mount.on:
        words.append(f"on {mount.on}")
    return ", ".join(words) or "where it fits"


def status_page(found: Mapping[str, object]) -> str:
    """Where everything is in a running world, for people."""
    state = "stands still" if found["paused"] else f"speed {found['speed']:g}"
    lines = [f"{found['world']}: {found['seconds']:.1f} s, {state}"]
    for kind in ("robots", "boxes"):
        things = found[kind]
        assert isinstance(things, Mapping)
        for name, at in things.items():
            parts = f"; parts: {', '.join(at['parts'])}" if at.get("parts") else ""
            lines.append(f"  {name:<16} {at['x']:.2f}, {at['y']:.2f} m, {at['heading']:.0f} degrees{parts}")
    return "\n".join(lines)
