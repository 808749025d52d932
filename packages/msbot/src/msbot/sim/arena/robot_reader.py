"""Reads what a world file says of a robot: its chassis, and where its parts sit."""

from __future__ import annotations

from msbot.sim.arena.world import Chassis, ChassisKind, Looks, Outline, PartPlace
from msbot.sim.arena.world_values import degrees, pair
from msbot_agent.toml.table import Table


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
        table.problem("must be on the robot: x ahead and y to the left, in metres, -1 to 1", "at")
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
        table.problem(f"is {chassis.track_m:g}; the wheels must be on the chassis, at most {width:g} m", "track_m")
    if chassis.base_m > length:
        table.problem(f"is {chassis.base_m:g}; the axles must be on the chassis, at most {length:g} m", "base_m")
    table.finish()
    return chassis
