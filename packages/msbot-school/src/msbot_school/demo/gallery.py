"""The gallery: the sample robots and worlds that a demo can be, and what each of them teaches."""

from __future__ import annotations

from msbot.sim.arena.world_reader import brought_worlds, open_world
from msbot_agent.text.sentence import said
from msbot_xrce.lazy import dataclass


@dataclass(frozen=True, slots=True)
class DemoChoice:
    """What a demo runs."""

    robot: str
    """A sample of `msbot init`."""
    world: str = ""
    """A world of `msbot arena list`; empty: none."""

    @property
    def command(self) -> str:
        """The command that starts it."""
        return f"msbot demo --robot {self.robot}" if not self.world else f"msbot demo --world {self.world}"


@dataclass(frozen=True, slots=True)
class GalleryEntry:
    """One robot, in a world or in none."""

    choice: DemoChoice
    title: str
    teaches: str
    """What can be learned with it, in a sentence."""
    age: int
    """From which age on; 0: not said."""
    minutes: int
    """How long the first task takes; 0: not said."""
    example: str = ""
    """The program that does the task of the world; empty: there is none."""


ROVER = DemoChoice("rover")
"""What a demo is unless somebody wishes otherwise."""

GALLERY = (
    GalleryEntry(
        ROVER,
        said("Rover of ten parts"),
        said("Turn a knob and the fan follows. Pull parts out, plug them in, and see how the robot reacts."),
        10,
        20,
    ),
    GalleryEntry(
        DemoChoice("thesis"),
        said("Ring of three"),
        said("Three parts pass a message round. See who talks to whom, and what is missing when one is gone."),
        12,
        20,
    ),
    GalleryEntry(
        DemoChoice("buggy", "line"),
        said("Line track"),
        said("Write a program that follows a line: it reads a sensor, decides, and drives the motors."),
        11,
        45,
        "line_follower.py",
    ),
    GalleryEntry(
        DemoChoice("buggy", "maze"),
        said("Maze"),
        said("Find the way out with a hand at the wall: distances, turns by compass, one cell after the other."),
        13,
        90,
        "maze.py",
    ),
    GalleryEntry(
        DemoChoice("buggy", "sumo"),
        said("Sumo ring"),
        said("Look for the rival, push it out, and stay inside the white edge: decide what goes before what."),
        11,
        45,
        "sumo.py",
    ),
    GalleryEntry(
        DemoChoice("buggy", "parking"),
        said("Parking"),
        said("Measure gaps while driving past, then slide in sideways: plan in steps, and remember."),
        13,
        90,
        "parking.py",
    ),
    GalleryEntry(
        DemoChoice("buggy", "sorting"),
        said("Sorting"),
        said("Tell colours apart and bring each box home: gripper, compass, and counting turns of the wheels."),
        14,
        90,
        "sorting.py",
    ),
    GalleryEntry(
        DemoChoice("buggy", "warehouse"),
        said("Warehouse"),
        said("Fetch a crate and put it down at the right place: put small programs together to a big one."),
        14,
        90,
        "warehouse.py",
    ),
)
"""In the order in which a class would take them."""


def brought_entries() -> tuple[GalleryEntry, ...]:
    """The worlds that extensions bring, for the robot that every world is made for."""
    found = [(name, open_world(name)) for name in brought_worlds()]
    return tuple(
        GalleryEntry(DemoChoice("buggy", name), world.name, world.description, world.age, world.minutes)
        for name, world in found
    )
