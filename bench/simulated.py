"""What a simulated robot costs while it lives: processor time for each second of its own time, in virtual time.

    python -m bench.simulated [--seconds S] [--repeats N] [--profile]

The samples as `msbot demo` runs them, without pages: nobody looks, nobody acts. The registry is a new one.
"""

from __future__ import annotations

import argparse
import asyncio
import cProfile
import pstats
import statistics
import tempfile
import time
from pathlib import Path
from random import Random

from bench.machine import describe_machine
from msbot.config import load_blueprint, load_library, write_sample
from msbot.process.virtual_time import run_virtual
from msbot.registry import open_registry
from msbot.sim.arena.arena import Arena
from msbot.sim.arena.running_arena import RunningArena
from msbot.sim.arena.world_connection import LocalWorldConnection
from msbot.sim.arena.world_reader import open_world
from msbot_school.demo import DemoRobot

ROBOTS = (("thesis", ""), ("rover", ""), ("rover", "line"), ("buggy", "line"))
"""Samples, each with its world."""


def life(folder: Path, sample: str, world: str, seconds: float, profile: cProfile.Profile | None = None) -> float:
    """Processor seconds of so many seconds of a robot that is complete."""
    spent = 0.0

    async def main() -> None:
        nonlocal spent
        path = folder / "robot.toml"
        write_sample(path, sample)
        library = load_library()
        blueprint = load_blueprint(path, library)
        with open_registry(folder / "robot.db") as registry:
            record = registry.robots.apply_blueprint(blueprint, library)
            store = registry.runs.begin(record)
            living = RunningArena(Arena(open_world(world))) if world else None
            door = None if living is None else LocalWorldConnection(living, "robot")
            robot = DemoRobot(blueprint, store, random=Random(1), library=library, door=door)
            task = asyncio.create_task(robot.run())
            await robot.master.ready.wait()
            await asyncio.sleep(3)
            began = time.process_time()
            if profile is not None:
                profile.enable()
            await asyncio.sleep(seconds)
            if profile is not None:
                profile.disable()
            spent = time.process_time() - began
            robot.finish()
            await task

    run_virtual(main())
    return spent


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--profile", action="store_true", help="print where the time goes instead")
    wishes = parser.parse_args()
    print(f"{describe_machine()}; processor time per second of life, least and median of {wishes.repeats}")
    for sample, world in ROBOTS:
        name = f"{sample}, world {world}" if world else sample
        profile = cProfile.Profile() if wishes.profile else None
        times = []
        for _ in range(1 if wishes.profile else wishes.repeats):
            with tempfile.TemporaryDirectory() as folder:
                times.append(1000 * life(Path(folder), sample, world, wishes.seconds, profile) / wishes.seconds)
        print(f"{name:<20} {min(times):6.1f} ms  {statistics.median(times):6.1f} ms")
        if profile is not None:
            pstats.Stats(profile).sort_stats("tottime").print_stats(40)


if __name__ == "__main__":
    main()
