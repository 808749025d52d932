"""How long it takes to find a slot for a part, with a library of 100,000 part types and a robot of 10,000 slots.

Claims of all kinds, drawn at random, run through the matcher on top of the registry in an SQLite file: known numbers
with free slots, numbers that are compatible with others, numbers of no slot, unknown numbers, versions, parts that
were there before. Besides: how long the robot takes to start.

    python -m bench.matching [--types 100000] [--slots 10000] [--claims 20000]
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import TypeVar

from bench.machine import describe_machine
from msbot.config import Blueprint, Library, Parameter, ParameterKind, PartType, RobotProfile, Slot
from msbot.pnp import Claim, Matcher, PartState
from msbot.registry import RobotStore, open_registry

T = TypeVar("T")
NUMBERS_WITH_SLOTS = 2_000
"""The slots are for so many different part numbers."""


def main() -> None:
    """Build the robot, match, print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--types", type=int, default=100_000)
    parser.add_argument("--slots", type=int, default=10_000)
    parser.add_argument("--claims", type=int, default=20_000)
    arguments = parser.parse_args()
    print(describe_machine())
    with tempfile.TemporaryDirectory(prefix="msbot-bench-") as folder:
        _run(Path(folder) / "robot.db", arguments.types, arguments.slots, arguments.claims)


def _run(path: Path, types: int, slots: int, claims: int) -> None:
    dice = Random(5)
    library, blueprint = _library(types), _blueprint(slots)
    with open_registry(path) as registry:
        _timed("first start: the blueprint is applied", lambda: registry.robots.apply_blueprint(blueprint, library))
        _timed(
            "next start: the blueprint is applied again", lambda: registry.robots.apply_blueprint(blueprint, library)
        )
        (robot,) = registry.robots.all()
        store = _timed("the master opens the robot", lambda: registry.runs.begin(robot))
        matcher = _timed("the matcher reads the slots", lambda: Matcher(store))
        _remember(store, dice, slots)
        registry.storage.flush()
        for slot in dice.sample(range(slots), slots // 2):
            matcher.take(f"slot{slot}")
        rows = [_match(matcher, claim) for claim in (_claim(dice, types, slots) for _ in range(claims))]
        print(f"{claims:,} claims, {types:,} part types, {slots:,} slots, half of them taken:")
        print("| outcome | claims | median ms | p99 ms | most ms | p99 ms of CPU |")
        print("|---|---|---|---|---|---|")
        for outcome in ("all", *(state.value for state in (PartState.ACTIVE, PartState.STANDBY, PartState.REFUSED))):
            _print(outcome, [row for row in rows if outcome in ("all", row[0])])


def _timed(what: str, deed: Callable[[], T]) -> T:
    began = time.perf_counter()
    result = deed()
    print(f"{what}: {time.perf_counter() - began:.2f} s")
    return result


def _match(matcher: Matcher, claim: Claim) -> tuple[str, float, float]:
    began, cpu_began = time.perf_counter_ns(), time.thread_time_ns()
    match = matcher.match(claim)
    cpu, wall = time.thread_time_ns() - cpu_began, time.perf_counter_ns() - began
    return match.outcome.value, wall / 1e6, cpu / 1e6


def _print(outcome: str, rows: list[tuple[str, float, float]]) -> None:
    if not rows:
        return
    wall, cpu = sorted(row[1] for row in rows), sorted(row[2] for row in rows)
    at = int(len(rows) * 0.99)
    figures = f"{statistics.median(wall):.3f} | {wall[at]:.3f} | {wall[-1]:.2f} | {cpu[at]:.3f}"
    print(f"| {outcome} | {len(rows):,} | {figures} |")


def _library(count: int) -> Library:
    period = Parameter("period_s", ParameterKind.FLOAT, 1.0, "s", 0.1, 10.0)
    return Library(
        PartType(
            f"N{number:06}",
            f"Thing {number}",
            parameters=(period,) if number % 3 else (),
            compatible_with=(f"N{number - 1:06}", f"N{number - 2:06}") if number % 5 == 4 else (),
        )
        for number in range(count)
    )


def _blueprint(slots: int) -> Blueprint:
    profile = RobotProfile("BENCH", "V1", "1", "today", "us")
    return Blueprint(
        profile, tuple(Slot(f"slot{number}", f"N{number % NUMBERS_WITH_SLOTS:06}") for number in range(slots))
    )


def _remember(store: RobotStore, dice: Random, slots: int) -> None:
    for slot in dice.sample(range(slots), slots // 2):
        claim = Claim(f"N{slot % NUMBERS_WITH_SLOTS:06}", "", _uid(slot))
        store.remember(claim.uid, f"slot{slot}", claim)


def _uid(number: int) -> bytes:
    return (number + 1).to_bytes(8, "big")


def _claim(dice: Random, types: int, slots: int) -> Claim:
    """A claim of any kind."""
    slot = dice.randrange(slots)
    match dice.randrange(4):
        case 0:
            return Claim(f"N{slot % NUMBERS_WITH_SLOTS:06}", f"slot{slot}", _uid(slot))
        case 1:
            return Claim(f"N{slot % NUMBERS_WITH_SLOTS:06}", "", dice.randbytes(8))
        case 2:
            return Claim(f"N{dice.randrange(types):06}", "", dice.randbytes(8))
        case _:
            return Claim(f"X{dice.randrange(types):06}@1.2", "", dice.randbytes(8))


if __name__ == "__main__":
    main()
