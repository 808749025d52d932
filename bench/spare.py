"""STOP and take-over in the sample robot on simulated CAN buses, in virtual time: exact, the same on every machine.

python -m bench.spare
"""

from __future__ import annotations

import asyncio
import logging
from dataclasses import dataclass
from pathlib import Path
from random import Random
from statistics import mean
from tempfile import TemporaryDirectory

from msbot.config import load_blueprint, load_library, write_sample
from msbot.operations.dispatch import InProcessOperations
from msbot.process.virtual_time import run_virtual
from msbot.registry import open_registry
from msbot_school.demo import DemoLinkKind, DemoRobot

BUSES = ((DemoLinkKind.CAN, 125_000), (DemoLinkKind.CAN, 500_000), (DemoLinkKind.FD, 500_000))
PRESETS = ("thesis", "fast")
REPEATS = 5
LOOK_S = 0.0005


@dataclass(frozen=True, slots=True)
class Figures:
    """What one run took, seconds."""

    stop: float
    """From STOP until the last part had confirmed it."""
    lost: float
    """From pulling BB out until it was lost."""
    taken: float
    """From there until the spare held the slot."""
    works: float
    """From there until the spare had its configuration and was active itself."""


async def _measure(folder: Path, preset: str, wire: DemoLinkKind, bitrate: int, seed: int) -> Figures:
    path = folder / "robot.toml"
    write_sample(path)
    path.write_text(path.read_text().replace('preset = "thesis"', f'preset = "{preset}"'))
    library = load_library()
    blueprint = load_blueprint(path, library)
    with open_registry(folder / "robot.db") as registry:
        record = registry.robots.apply_blueprint(blueprint, library)
        robot = DemoRobot(
            blueprint,
            registry.runs.begin(record),
            wire=wire,
            bitrate=bitrate,
            spares={"DD": "BB"},
            random=Random(seed),
            epoch_ns=lambda: 0,
        )
        operations = InProcessOperations(robot.master, registry, record, library=library)
        clock = asyncio.get_running_loop().time
        async with asyncio.TaskGroup() as tasks:
            running = tasks.create_task(robot.run())
            await robot.master.ready.wait()
            await asyncio.sleep(3 + 2 * Random(seed).random())
            await operations.do("stop", who="bench")
            await asyncio.sleep(1)
            report = operations.stopping.status
            assert report.latency_ms is not None
            await operations.do("go", who="bench")
            await asyncio.sleep(1)
            robot.unplug("BB")
            pulled = clock()
            spare = robot._plugs["DD"].part
            assert spare is not None
            while spare.state.value != "active":  # noqa: ASYNC110 - that is what is measured
                await asyncio.sleep(LOOK_S)
            works = clock()
            at = {(event.part, event.to_state): event.at_s for event in robot.events}
            robot.finish()
            await running
    lost, taken = at["BB", "lost"], at["DD", "active"]
    return Figures(report.latency_ms / 1000, lost - pulled, taken - lost, works - taken)


def main() -> None:
    """Print the table."""
    logging.disable(logging.WARNING)
    print(f"{'bus':<22} {'preset':<8} {'STOP ms':>9} {'lost after s':>16} {'taken over ms':>14} {'works after ms':>15}")
    for preset in PRESETS:
        for wire, bitrate in BUSES:
            runs = []
            for seed in range(REPEATS):
                with TemporaryDirectory() as folder:
                    runs.append(run_virtual(_measure(Path(folder), preset, wire, bitrate, seed)))
            name = f"{'CAN FD' if wire is DemoLinkKind.FD else 'CAN'}, {bitrate // 1000} kbit/s"
            lost = [run.lost for run in runs]
            print(
                f"{name:<22} {preset:<8} {1000 * mean(run.stop for run in runs):>9.1f} "
                f"{f'{min(lost):.2f} to {max(lost):.2f}':>16} {1000 * mean(run.taken for run in runs):>14.1f} "
                f"{1000 * mean(run.works for run in runs):>15.1f}"
            )


if __name__ == "__main__":
    main()
