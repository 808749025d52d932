"""A world in words."""

from __future__ import annotations

from collections.abc import Mapping

from msbot.sim.arena.world import PartPlace, RobotPlan, WorldPlan


def _counts(plan: WorldPlan) -> dict[str, int]:
    return {
        "walls": len(plan.walls), "posts": len(plan.posts), "lines": len(plan.lines), "areas": len(plan.areas),
        "lamps": len(plan.lamps), "magnets": len(plan.magnets), "noises": len(plan.noises), "boxes": len(plan.boxes),
    }  # fmt: skip


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
