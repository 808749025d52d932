"""What a bridge costs: from plug-in to active, until a loss is noticed, STOP, processor time at 10 Hz.

python -m bench.bridges [--write]

For each world on CAN a device that reports 10 times a second, in a process of its own, first at a bridge with its
master, then at the world's own library doing what its own tools do; not at both at once, because a CANopen node answers
one of them only. The simulated bus, and a node that acknowledges, are in other processes, so that they are not counted.
The library of CANopen finds nodes by its scanner, and then has their identity read. That of DroneCAN has its node
monitor and the allocator of node ids that gui_tool runs; that of Cyphal its node tracker, on which `yakut monitor` is
built, and its allocator: they also notice a loss. All take in what the device reports. Nodes without an id, which ask
the one or the other for it, are the libraries' own; they do not wait between their questions.
"""

from __future__ import annotations

import argparse
import asyncio
import os
import subprocess
import sys
import threading
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any, NoReturn
from uuid import uuid4

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

TIMES = 3
"""A device is plugged in so often; each time another one."""
REST_S = 4.0
LONGEST_S = 12
"""So long a process may take until it has loaded what it needs; on a busy computer it never seems to have."""
LOOK_S = 0.005
FIRST_NODE = 10
NATIVE_LOSS = "lost"
LISTENER = "listener"
READY = "ready"
ASKED, GIVEN = "asked", "given"
ASK = "ask-"
"""Before the name of a world: a process with a node that has no id."""
PIECE = 6
"""Octets of its unique id that a node of DroneCAN says at a time."""


@dataclass(frozen=True)
class Case:
    """One world."""

    world: str
    device: str
    """What is simulated."""
    words: str
    number: str
    """Its part number."""
    library: str
    first_frame: Callable[[int, int], bool]
    """Whether a frame, by identifier and node, is the first that such a device sends."""
    native: Callable[[str], None]
    """The library alone, until it is killed; tells by lines."""
    notices_loss: bool
    """The library does."""
    ask: Callable[[str], None] | None = None
    """A node without an id asks for one, and tells when."""


@dataclass
class Figures:
    """What was measured, seconds."""

    active: list[float] = field(default_factory=list)
    native_found: list[float] = field(default_factory=list)
    lost: list[float] = field(default_factory=list)
    native_lost: list[float] = field(default_factory=list)
    stop: list[float] = field(default_factory=list)
    idle: float = 0.0
    native_idle: float = 0.0
    given: list[float] = field(default_factory=list)
    native_given: list[float] = field(default_factory=list)
    busy: list[float] = field(default_factory=list)
    native_busy: list[float] = field(default_factory=list)


# The libraries alone


def native_canopen(bus: str) -> None:
    """Scan, read who a node is, take in what it reports."""
    import canopen

    network = canopen.Network(open_bus(bus))
    network.connect()
    known = set[int]()
    told(READY, 0)
    while True:
        for node in list(network.scanner.nodes):
            if node not in known and node < 127:
                known.add(node)
                remote = network.add_node(node, canopen.ObjectDictionary())
                for index, subindex in ((0x1000, 0), (0x1018, 1), (0x1018, 2), (0x1018, 4)):
                    remote.sdo.upload(index, subindex)
                for pdo in (0x180, 0x280):
                    network.subscribe(pdo + node, lambda _id, data, _at: int.from_bytes(data, "little"))
                told("found", node)
        time.sleep(LOOK_S)


def native_dronecan(bus: str) -> None:
    """Monitor nodes, give them ids, take in what they report."""
    import dronecan
    from dronecan.app.dynamic_node_id import CentralizedServer
    from dronecan.app.node_monitor import NodeMonitor

    from msbot_bridges.dronecan.can_driver import PythonCanDriver

    node = dronecan.node.Node(PythonCanDriver(open_bus(bus)), 120)
    monitor = NodeMonitor(node)

    def update(event: Any) -> None:  # noqa: ANN401 - the library has no types
        if event.entry.node_id < 100:
            if event.event_id == event.EVENT_ID_INFO_UPDATE:
                told("found", event.entry.node_id)
            elif event.event_id == event.EVENT_ID_OFFLINE:
                told(NATIVE_LOSS, event.entry.node_id)

    monitor.add_update_handler(update)
    CentralizedServer(node, monitor)
    node.add_handler(dronecan.uavcan.equipment.actuator.Status, lambda _event: None)  # it was decoded by then
    told(READY, 0)
    while True:
        node.spin(1.0)


def native_cyphal(bus: str) -> None:
    """Track nodes, as `yakut monitor` does, and give them ids."""
    asyncio.run(track_cyphal(bus))


async def track_cyphal(bus: str) -> None:
    """The library's node tracker."""
    from msbot_bridges.cyphal.data_types import load_types

    await load_types()
    import pycyphal.application
    from pycyphal.application.node_tracker import NodeTracker
    from pycyphal.application.plug_and_play import CentralizedAllocator
    from pycyphal.transport.can import CANTransport

    from msbot_bridges.cyphal.can_media import PythonCanMedia

    def failed(error: Exception) -> None:
        raise SystemExit(str(error))

    transport = CANTransport(PythonCanMedia(open_bus(bus), failed), 120)
    registry = pycyphal.application.make_registry(None, {})
    node = pycyphal.application.make_node(
        pycyphal.application.NodeInfo(name="org.msbot.bench"), registry, transport=transport
    )
    node.start()

    def update(node_id: int, before: Any, now: Any) -> None:  # noqa: ANN401
        if node_id < 100:
            if now is None:
                told(NATIVE_LOSS, node_id)
            elif now.info is not None and before is not None:
                told("found", node_id)

    tracker = NodeTracker(node)
    tracker.add_update_handler(update)
    allocator = CentralizedAllocator(node)
    tracker.add_update_handler(
        lambda number, _before, now: allocator.register_node(
            number, None if now is None or now.info is None else bytes(now.info.unique_id)
        )
    )
    told(READY, 0)
    await asyncio.Event().wait()


def ask_dronecan(bus: str) -> None:
    """A node asks for an id, by the three messages of the protocol."""
    import dronecan

    from msbot_bridges.dronecan.can_driver import PythonCanDriver

    driver, unique = PythonCanDriver(open_bus(bus)), os.urandom(16)
    node = dronecan.node.Node(driver, None)

    def say(octets: bytes, *, is_first: bool) -> None:
        question = dronecan.uavcan.protocol.dynamic_node_id.Allocation(first_part_of_unique_id=is_first)
        question.unique_id.from_bytes(octets)
        transfer = dronecan.transport.Transfer(payload=question, source_node_id=0, discriminator=os.getpid() & 0x3FFF)
        for frame in transfer.to_frames():
            driver.send(frame.message_id, frame.bytes, extended=True)

    given: list[int] = []

    def answered(event: Any) -> None:  # noqa: ANN401
        known = bytes(event.message.unique_id.to_bytes())
        if event.transfer.source_node_id and unique.startswith(known):
            if len(known) < len(unique):
                say(unique[len(known) :][:PIECE], is_first=False)
            else:
                given.append(event.message.node_id)

    node.add_handler(dronecan.uavcan.protocol.dynamic_node_id.Allocation, answered)
    told(ASKED, 0)
    say(unique[:PIECE], is_first=True)
    node.periodic(1.0, lambda: say(unique[:PIECE], is_first=True))
    while not given:
        node.spin(0.005)
    told(GIVEN, 0)


def ask_cyphal(bus: str) -> None:
    """The same of Cyphal, with the library's own."""
    asyncio.run(ask_for_id_of_cyphal(bus))


async def ask_for_id_of_cyphal(bus: str) -> None:
    """The library asks by itself until it has an id."""
    from msbot_bridges.cyphal.data_types import load_types

    await load_types()
    from pycyphal.application.plug_and_play import Allocatee
    from pycyphal.transport.can import CANTransport

    from msbot_bridges.cyphal.can_media import PythonCanMedia

    media = PythonCanMedia(open_bus(bus))
    send = media.send

    async def sent(*arguments: Any) -> int:  # noqa: ANN401
        told(ASKED, 0)  # the first of them counts: it waits some time before it asks
        return await send(*arguments)

    media.send = sent  # type: ignore[method-assign, assignment]
    asking = Allocatee(CANTransport(media, None), os.urandom(16))
    while asking.get_result() is None:  # noqa: ASYNC110 - it is a measurement
        await asyncio.sleep(LOOK_S)
    told(GIVEN, 0)


def listen(bus: str) -> NoReturn:
    """Acknowledge what others send, as any device on a bus does."""
    with open_bus(bus) as listening:
        while True:
            listening.recv(60)


def told(what: str, node: int) -> None:
    """A line for the process that measures."""
    sys.stdout.write(f"{what} {node} {time.monotonic()}\n")
    sys.stdout.flush()


def is_heartbeat_of_cyphal(can_id: int, node: int) -> bool:
    """Whether a frame of 29 bits is that of a node."""
    return can_id >> 8 & 0x1FFF == 7509 and can_id & 0x7F == node


CASES = (
    Case(
        "canopen",
        "drive",
        "CANopen drive",
        "vendor-0x4d53:SimDrive",
        "canopen",
        lambda can_id, node: can_id == 0x700 + node,
        native_canopen,
        notices_loss=False,
    ),
    Case(
        "dronecan",
        "servo",
        "DroneCAN servo",
        "org.msbot:simservo",
        "dronecan",
        lambda can_id, node: can_id >> 8 & 0xFFFF == 341 and can_id & 0x7F == node,
        native_dronecan,
        notices_loss=True,
        ask=ask_dronecan,
    ),
    Case(
        "cyphal",
        "range",
        "Cyphal range finder",
        "org.msbot:simrange",
        "pycyphal",
        is_heartbeat_of_cyphal,
        native_cyphal,
        notices_loss=True,
        ask=ask_cyphal,
    ),
)


class Native:
    """The library alone, in a process."""

    def __init__(self, world: str, bus: str) -> None:
        words = [sys.executable, "-m", "bench.bridges", "--native", world, "--bus", bus]
        self._process = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
        self._at = dict[tuple[str, int], float]()
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            what, node, at = line.split()
            self._at.setdefault((what, int(node)), float(at))

    async def when(self, what: str, node: int) -> float:
        """When it has told that of a node."""
        while (what, node) not in self._at:
            if self._process.poll() not in (None, 0):
                raise SystemExit("the library alone has ended; what it said is above")
            await asyncio.sleep(LOOK_S)
        return self._at[what, node]

    def processor_s(self) -> float:
        """Processor time that it has had."""
        # Linux: clock_getcpuclockid(3) makes the same number; /proc counts in steps of 10 ms.
        return time.clock_gettime(~self._process.pid << 3 | 2)

    def end(self) -> None:
        """End it."""
        self._process.kill()
        self._process.wait()


@asynccontextmanager
async def served_bus() -> AsyncIterator[str]:
    """A simulated bus in a process of its own; its address for python-can."""
    name = uuid4().hex[:12]
    words = [sys.executable, "-m", "msbot", "bus", "serve", name]
    process = await asyncio.create_subprocess_exec(*words, stdout=subprocess.PIPE)
    try:
        assert process.stdout is not None
        await process.stdout.readline()
        listener = await asyncio.create_subprocess_exec(
            sys.executable, "-m", "bench.bridges", "--native", LISTENER, "--bus", f"msbot:{name}"
        )
        try:
            yield f"msbot:{name}"
        finally:
            listener.kill()
            await listener.wait()
    finally:
        process.terminate()
        await process.wait()


async def measure_bridge(case: Case, folder: Path, figures: Figures) -> None:
    """A bridge with its master, in this process."""
    write_sample(folder / "robot.toml")
    sample, library = open_blueprint(folder / "robot.toml")
    async with served_bus() as bus:
        blueprint = Blueprint(sample.robot, (Slot("joint", case.number),), bridges=(BridgeTable(case.world, bus),))
        with open_registry(folder / "robot.db") as registry:
            record = registry.robots.apply_blueprint(blueprint, library)
            master = Master(blueprint, registry.runs.begin(record), library=load_library(folder / "adopted"))
            hub = InprocHub()
            master.add_link(hub.server)
            operations = InProcessOperations(master, registry, record, library=library)
            bridging = RUNNER.coroutines(blueprint.bridges, lambda _: hub.connect(), print)
            tasks = [asyncio.create_task(one) for one in (master.run(), *bridging)]
            try:
                await settled(time.process_time)
                figures.idle = await busy(time.process_time)
                figures.given += await asked(case, bus)
                for number in range(TIMES):
                    await plug_in(case, figures, bus, FIRST_NODE + number, master, operations)
            finally:
                for task in reversed(tasks):
                    task.cancel()
                await asyncio.wait(tasks)


async def plug_in(
    case: Case, figures: Figures, bus: str, node: int, master: Master, operations: InProcessOperations
) -> None:
    """A device comes, works, is stopped, and goes."""

    def active() -> int:
        now = asyncio.get_running_loop().time()
        return sum(one.state is PartState.ACTIVE for one in master.inventory.view(now))

    async def until(count: int) -> float:
        while active() != count:  # noqa: ASYNC110 - it is a measurement
            await asyncio.sleep(LOOK_S)
        return time.monotonic()

    async with device(case, bus, node) as begun:
        figures.active.append(await until(1) - await begun)
        await asyncio.sleep(2)
        figures.busy.append(await busy(time.process_time))
        await operations.do("stop", who="bench", reason="")
        while master.stop.silent:  # noqa: ASYNC110
            await asyncio.sleep(LOOK_S)
        figures.stop += [one.ms / 1000 for one in master.stop.confirmed]
        await operations.do("go", who="bench", stop=None)
        await asyncio.sleep(1)
    at = time.monotonic()
    figures.lost.append(await until(0) - at)


async def measure_native(case: Case, figures: Figures) -> None:
    """The library alone, in a process of its own."""
    async with served_bus() as bus:
        native = Native(case.world, bus)
        try:
            await native.when(READY, 0)
            await settled(native.processor_s)
            figures.native_idle = await busy(native.processor_s)
            figures.native_given += await asked(case, bus)
            for number in range(TIMES):
                node = FIRST_NODE + number
                async with device(case, bus, node) as begun:
                    figures.native_found.append(await native.when("found", node) - await begun)
                    await asyncio.sleep(2)
                    figures.native_busy.append(await busy(native.processor_s))
                at = time.monotonic()
                if case.notices_loss:
                    figures.native_lost.append(await native.when(NATIVE_LOSS, node) - at)
        finally:
            native.end()


async def asked(case: Case, bus: str) -> list[float]:
    """How long nodes without an id wait for one."""
    waits: list[float] = []
    for _ in range(TIMES if case.ask is not None else 0):
        node = Native(ASK + case.world, bus)
        try:
            waits.append(await node.when(GIVEN, 0) - await node.when(ASKED, 0))
        finally:
            node.end()
    return waits


@asynccontextmanager
async def device(case: Case, bus: str, node: int) -> AsyncIterator[asyncio.Task[float]]:
    """A simulated device in a process of its own; when its first frame was on the bus. At the end it is killed."""
    hearing = asyncio.create_task(heard(case, bus, node))
    await asyncio.sleep(0.5)
    words = ["bridge", case.world, "--simulate", case.device, "--link", bus, "--option", f"node={node}", "--quiet"]
    process = await asyncio.create_subprocess_exec(sys.executable, "-m", "msbot", *words)
    try:
        yield hearing
    finally:
        process.kill()
        await process.wait()


async def heard(case: Case, bus: str, node: int) -> float:
    """When the first frame of a device is on the bus."""

    def wait() -> float:
        with open_bus(bus) as listening:
            while True:
                message = listening.recv(60)
                if message is not None and case.first_frame(message.arbitration_id, node):
                    return time.monotonic()

    return await asyncio.to_thread(wait)


async def settled(processor_s: Callable[[], float]) -> None:
    """Wait until a process has loaded what it needs: no second takes much more than the least so far."""
    seconds: list[float] = []
    while len(seconds) < 5 or (max(seconds[-3:]) > 1.5 * min(seconds) + 0.02 and len(seconds) < LONGEST_S):
        before = processor_s()
        await asyncio.sleep(1)
        seconds.append(processor_s() - before)


async def busy(processor_s: Callable[[], float]) -> float:
    """Processor time in a second."""
    begun, at = processor_s(), time.monotonic()
    await asyncio.sleep(REST_S)
    return (processor_s() - begun) / (time.monotonic() - at)


def table(case: Case, figures: Figures) -> list[str]:
    """What was measured, as a table."""

    def ms(values: list[float]) -> str:
        return f"{1000 * median(values):.0f} ms"

    each = 1000 * (median(figures.busy) - figures.idle)
    alone = 1000 * (median(figures.native_busy) - figures.native_idle)
    given = [
        f"| from the first question of a node without an id to its id | {ms(one)} | {ms(other)} |"
        for one, other in [(figures.given, figures.native_given)]
        if case.ask is not None
    ]
    return [
        f"| {case.words} | bridge and master | library `{case.library}` alone |",
        "|---|---|---|",
        f"| from its first frame to active; alone: to its identity | {ms(figures.active)} "
        f"| {ms(figures.native_found)} |",
        *given,
        f"| from the end of its process to lost | {ms(figures.lost)} "
        f"| {ms(figures.native_lost) if figures.native_lost else 'left to its user'} |",
        f"| STOP, until the device has confirmed it | {ms(figures.stop)} | - |",
        f"| processor time without a device, in a second | {1000 * figures.idle:.1f} ms "
        f"| {1000 * figures.native_idle:.1f} ms |",
        f"| processor time more for the device, in a second | {each:.1f} ms | {alone:.1f} ms |",
        "",
    ]


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="keep the table in bench/results")
    parser.add_argument("--native", help=argparse.SUPPRESS)
    parser.add_argument("--bus", help=argparse.SUPPRESS)
    wishes = parser.parse_args()
    if wishes.native == LISTENER:
        listen(wishes.bus)
    if wishes.native and wishes.native.startswith(ASK):
        ask = next(case for case in CASES if ASK + case.world == wishes.native).ask
        assert ask is not None
        ask(wishes.bus)
        return 0
    if wishes.native:
        next(case for case in CASES if case.world == wishes.native).native(wishes.bus)
        return 0
    lines: list[str] = []
    for case in CASES:
        figures = Figures()
        with TemporaryDirectory() as folder:
            asyncio.run(measure_bridge(case, Path(folder), figures))
        asyncio.run(measure_native(case, figures))
        lines += table(case, figures)
    load = os.getloadavg()[0]
    lines.append(
        f"Medians of {TIMES} devices, each of which reports 10 times a second, all in one run; the load of the machine "
        f"was {load:.1f} at its end. The bridge listens to a node of DroneCAN for 1.5 s before it is a part, because "
        "nodes do not declare what they send. A Cyphal node restarts once when it gets its subjects, and sends the "
        f"library alone only its heartbeat. {describe_machine()}"
    )
    print("\n".join(lines))
    if wishes.write:
        write_result("bridges", "What a bridge costs", lines, made_by="python -m bench.bridges --write")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
