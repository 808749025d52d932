"""Small worlds for tests."""

from __future__ import annotations

from collections.abc import Mapping

from msbot.sim.arena.arena import Arena
from msbot.sim.arena.world_reader import parse_world

WHEELS = ("motor.left", "motor.right")


def arena(
    text: str = "",
    *,
    robot: str = "",
    size: tuple[float, float] = (3.0, 2.0),
    at: str = "[1.0, 1.0]",
    seed: int | None = None,
) -> Arena:
    """A world with one robot that looks east."""
    world = f'[world]\nname = "test"\nwidth_m = {size[0]}\nheight_m = {size[1]}\n'
    return Arena(parse_world(f'{world}{text}\n[[robot]]\nname = "robot"\nstart = {at}\n{robot}'), seed)


def driving(world: Arena, left: float, right: float, seconds: float, **also: Mapping[str, float]) -> None:
    """Drive with these powers, in percent; `also` is what other slots do."""
    if "wheels" not in world.robot("robot").seats:
        world.mount("robot", "wheels", WHEELS)
    world.drive("robot", "wheels", {"motor.left": left, "motor.right": right})
    for slot, does in also.items():
        world.drive("robot", slot, does)
    world.step(round(seconds * 200))


def sensed(world: Arena, slot: str, *quantities: str) -> dict[str, float | bool]:
    """What a part at that slot senses; it is mounted if it is not."""
    if slot not in world.robot("robot").seats:
        world.mount("robot", slot, quantities)
    return world.sense("robot", slot, quantities)
