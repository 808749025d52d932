"""What a world costs, in CPU time: its steps and its sensors, for 1 to 20 robots that drive and push.

python -m bench.arena [--seconds S] [--repeats N]
"""

from __future__ import annotations

import argparse
import statistics
import time

from bench.machine import describe_machine
from msbot.sim.arena.arena import Arena
from msbot.sim.arena.wheels import SENSE_STEPS, STEP_S
from msbot.sim.arena.world_reader import open_world, parse_world, shipped_worlds

WHEELS = ("motor.left", "motor.right")
PARTS: dict[str, tuple[str, ...]] = {
    "eyes": ("distance",),
    "line": ("line.place", "line.seen"),
    "floor": ("colour.red", "colour.green", "colour.blue", "light"),
    "bumper": ("touch",),
    "imu": ("pitch", "roll", "spin", "push.ahead", "push.left"),
    "left_encoder": ("wheel",),
    "right_encoder": ("wheel",),
    "compass": ("heading",),
    "ear": ("sound",),
    "reed": ("magnet",),
}
"""What each robot senses with, 50 times a second."""


def crowd(count: int) -> Arena:
    """A hall with lines, lamps, magnets, noise and boxes, and so many robots in it."""
    text = '[world]\nname = "hall"\nwidth_m = 5\nheight_m = 4\n'
    text += "".join(f"[[line]]\npoints = [[0.2, {0.4 + row * 0.8}], [4.8, {0.4 + row * 0.8}]]\n" for row in range(5))
    text += "[[lamp]]\nat = [1, 1]\n[[lamp]]\nat = [4, 3]\n[[magnet]]\nat = [2, 2]\n[[noise]]\nat = [3, 2]\n"
    text += "".join(f"[[box]]\nat = [{0.5 + number * 0.45}, 2.0]\n" for number in range(10))
    for number in range(count):
        x, y = 0.5 + (number % 5) * 1.0, 0.4 + (number // 5) * 0.8
        text += f'[[robot]]\nname = "robot {number}"\nstart = [{x}, {y}]\nheading_deg = {number * 40 % 360}\n'
        text += '[[robot.part]]\nslot = "bumper"\n'
    arena = Arena(parse_world(text))
    for robot in arena.robots:
        arena.mount(robot, "wheels", WHEELS)
        for slot, quantities in PARTS.items():
            arena.mount(robot, slot, quantities)
    return arena


def run(arena: Arena, seconds: float, *, senses: bool) -> float:
    """CPU seconds of so many seconds in which all robots drive about."""
    began = time.process_time()
    for look in range(round(seconds / STEP_S / SENSE_STEPS)):
        for number, robot in enumerate(arena.robots):
            if look % 25 == 0:
                turn = 30 if (look // 25 + number) % 3 else -60
                arena.drive(robot, "wheels", {"motor.left": 60.0 + turn, "motor.right": 60.0 - turn})
            if senses:
                for slot, quantities in PARTS.items():
                    arena.sense(robot, slot, quantities)
        arena.step(SENSE_STEPS)
    return time.process_time() - began


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--repeats", type=int, default=3)
    wishes = parser.parse_args()
    print(f"{describe_machine()}; CPU time of {wishes.seconds:g} s in the world, median of {wishes.repeats}")
    for count in (1, 5, 10, 20):
        shares = {}
        for senses in (False, True):
            times = [run(crowd(count), wishes.seconds, senses=senses) for _ in range(wishes.repeats)]
            shares[senses] = statistics.median(times) / wishes.seconds
        step = 1e6 * shares[False] * STEP_S
        print(
            f"{count:2} robots: a step of {1000 * STEP_S:g} ms takes {step:.0f} us "
            f"({100 * shares[False]:.1f} % of a core); "
            f"with {len(PARTS)} sensors each, 50 times a second, {100 * shares[True]:.1f} %"
        )
    began = time.process_time()
    for name in shipped_worlds():
        open_world(name)
    print(f"reading all {len(shipped_worlds())} worlds: {1000 * (time.process_time() - began):.0f} ms")


if __name__ == "__main__":
    main()
