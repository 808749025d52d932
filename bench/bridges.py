"""What a bridge costs: from plug-in to active, until a loss is noticed, STOP, processor time at 10 Hz.

python -m bench.bridges [--write]

A CANopen drive in a process of its own, on a simulated bus. The robot's master and the bridge are in this process.
Beside it, in the same run, the native way: the library `canopen` alone, whose scanner finds a node, and whose node is
read once. Loss has no native counterpart: the library leaves missing heartbeats to its user.
"""

from __future__ import annotations

import argparse
import asyncio
import subprocess
import sys
import time
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from uuid import uuid4

import canopen

from bench.machine import describe_machine
from bench.result import write_result
from msbot.config import Blueprint, BridgeTable, Slot, load_library, open_blueprint
from msbot.master import Master
from msbot.operations.dispatch import InProcessOperations
from msbot.pnp import PartState
from msbot.registry import open_registry
from msbot_agent.link import InprocHub
from msbot_bridges.canbus import open_bus
from msbot_bridges.cli.bridge_runner import RUNNER
from msbot_bridges.makers import write_sample

NUMBER = "vendor-0x4d53:SimDrive"
TIMES = 3
"""A drive is plugged in so often; each time another one."""
REST_S = 5.0
LOOK_S = 0.005


def start_drive(bus: str, node: int) -> subprocess.Popen[bytes]:
    """A simulated drive in a process of its own."""
    words = ["bridge", "canopen", "--simulate", "drive", "--link", bus, "--option", f"node={node}", "--quiet"]
    return subprocess.Popen([sys.executable, "-m", "msbot", *words])


async def heard(bus: str, node: int) -> float:
    """When the boot-up of a node is on the bus."""
    listening = open_bus(bus)

    def wait() -> float:
        while True:
            message = listening.recv(60)
            if message is not None and message.arbitration_id == 0x700 + node:
                return time.monotonic()

    try:
        return await asyncio.to_thread(wait)
    finally:
        listening.shutdown()


class Figures:
    """What was measured, seconds."""

    def __init__(self) -> None:
        self.active: list[float] = []
        self.native: list[float] = []
        self.lost: list[float] = []
        self.stop: list[float] = []
        self.idle = 0.0
        self.busy: list[float] = []


async def measure(folder: Path) -> Figures:
    """One run."""
    write_sample(folder / "robot.toml")
    sample, library = open_blueprint(folder / "robot.toml")
    bus, figures = f"msbot:{uuid4().hex[:12]}", Figures()
    blueprint = Blueprint(sample.robot, (Slot("joint", NUMBER),), bridges=(BridgeTable("canopen", bus),))
    with open_registry(folder / "robot.db") as registry:
        record = registry.robots.apply_blueprint(blueprint, library)
        master = Master(blueprint, registry.runs.begin(record), library=load_library(folder / "adopted"))
        hub = InprocHub()
        master.add_link(hub.server)
        operations = InProcessOperations(master, registry, record, library=library)
        bridging = RUNNER.coroutines(blueprint.bridges, lambda _: hub.connect(), print)
        tasks = [asyncio.create_task(one) for one in (master.run(), *bridging)]
        native = await asyncio.to_thread(canopen.Network(open_bus(bus)).connect)

        def active() -> int:
            now = asyncio.get_running_loop().time()
            return sum(one.state is PartState.ACTIVE for one in master.inventory.view(now))

        async def until(count: int) -> float:
            while active() != count:  # noqa: ASYNC110 - it is a measurement
                await asyncio.sleep(LOOK_S)
            return time.monotonic()

        await asyncio.sleep(1)
        figures.idle = await busy(REST_S)
        for number in range(TIMES):
            node = 10 + number
            hearing = asyncio.create_task(heard(bus, node))
            finding = asyncio.create_task(asyncio.to_thread(find_natively, native, node))
            drive = start_drive(bus, node)
            at = await until(1)
            begun = await hearing
            figures.active.append(at - begun)
            figures.native.append(await finding - begun)
            await asyncio.sleep(1)
            figures.busy.append(await busy(REST_S))
            await operations.do("stop", who="bench", reason="")
            while master.stop.silent:  # noqa: ASYNC110
                await asyncio.sleep(LOOK_S)
            figures.stop += [one.ms / 1000 for one in master.stop.confirmed]
            await operations.do("go", who="bench", stop=None)
            await asyncio.sleep(1)
            drive.kill()
            begun = time.monotonic()
            figures.lost.append(await until(0) - begun)
            drive.wait()
        await asyncio.to_thread(native.disconnect)
        for task in reversed(tasks):
            task.cancel()
        await asyncio.wait(tasks)
    return figures


def find_natively(network: canopen.Network, node: int) -> float:
    """When the library's scanner has a node, and its identity was read."""
    while node not in network.scanner.nodes:
        time.sleep(LOOK_S)
    remote = network.add_node(node, canopen.ObjectDictionary())
    for index, subindex in ((0x1000, 0), (0x1018, 1), (0x1018, 2), (0x1018, 4)):
        remote.sdo.upload(index, subindex)
    return time.monotonic()


async def busy(seconds: float) -> float:
    """Processor time of this process for a second."""
    begun, at = time.process_time(), time.monotonic()
    await asyncio.sleep(seconds)
    return (time.process_time() - begun) / (time.monotonic() - at)


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="keep the table in bench/results")
    wishes = parser.parse_args()
    with TemporaryDirectory() as folder:
        figures = asyncio.run(measure(Path(folder)))
    each = 1000 * (median(figures.busy) - figures.idle)
    lines = [
        "| A CANopen drive that reports 10 times a second | bridge | library `canopen` alone |",
        "|---|---|---|",
        f"| from the first heartbeat to active; natively: to its identity | {1000 * median(figures.active):.0f} ms "
        f"| {1000 * median(figures.native):.0f} ms |",
        f"| from the end of its process to lost | {1000 * median(figures.lost):.0f} ms | its user's own |",
        f"| STOP, until it is confirmed | {1000 * median(figures.stop):.0f} ms | - |",
        f"| processor time for a device, in a second | {each:.1f} ms | - |",
        "",
        f"Medians of {TIMES}. Processor time is that of master, bridge and simulated bus in one process, above the "
        f"{1000 * figures.idle:.0f} ms without a device. {describe_machine()}",
    ]
    print("\n".join(lines))
    if wishes.write:
        write_result("bridges", "What a bridge costs", lines, made_by="python -m bench.bridges --write")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
