"""What plug-and-play costs on a CAN bus, in virtual time: exact, the same on every machine.

Prints two tables: from plugging a part in to `active` with the bus time of the same frames beside it, and the thesis'
418-byte message, which took it "over a minute" (thesis 4.2.5).

    python bench/can.py
"""

from __future__ import annotations

import asyncio
import tempfile
from dataclasses import dataclass
from pathlib import Path
from random import Random

from msbot.config import load_blueprint, load_library, write_sample
from msbot.demo import DemoRobot, Wire
from msbot.link import CanMasterLink, CanPartLink, Frame, Peer, SimBus, SimBusDriver, frame_bits, run_virtual
from msbot.registry import open_registry


@dataclass(frozen=True)
class Rates:
    """One kind of bus."""

    nominal: int
    data: int | None = None

    @property
    def name(self) -> str:
        """In a table's words."""
        if self.data is None:
            return f"classic {self.nominal // 1000}k"
        return f"FD {self.nominal // 1000}k/{self.data // 1_000_000}M"

    def seconds(self, frame: Frame) -> float:
        """Time the frame occupies the bus."""
        return frame_bits(frame).seconds(self.nominal, self.data)

    def bus(self) -> SimBus:
        """A simulated bus."""
        return SimBus(self.nominal, data_bitrate=self.data, fd=self.data is not None)


BUSES = (
    *(Rates(bitrate) for bitrate in (125_000, 250_000, 500_000, 1_000_000)),
    Rates(500_000, 2_000_000),
    Rates(1_000_000, 5_000_000),
)

THESIS_BYTES = 418


@dataclass(frozen=True)
class PlugIn:
    """One part's way from the plug to `active`."""

    active_ms: float
    bus_ms: float
    frames: int
    bits: int


async def plug_in(rates: Rates, folder: Path) -> PlugIn:
    """Plug one part into a running robot."""
    library = load_library()
    blueprint = load_blueprint(folder / "robot.toml", library)
    registry = open_registry(folder / f"{rates.name.replace('/', '-')}.db")
    robot = DemoRobot(
        blueprint,
        registry.store_for(registry.apply_blueprint(blueprint, library)),
        wire=Wire.CAN if rates.data is None else Wire.FD,
        bitrate=rates.nominal,
        data_bitrate=rates.data or 0,
        names=("AA",),
        random=Random(1),
        epoch_ns=lambda: 0,
    )
    loop = asyncio.get_running_loop()
    frames: list[tuple[float, Frame]] = []
    active = loop.create_future()
    robot.on_event = lambda event: (
        active.set_result(loop.time()) if event.to_state == "active" and not active.done() else None
    )
    async with asyncio.TaskGroup() as tasks:
        running = tasks.create_task(robot.run())
        await robot.master.ready.wait()
        robot.on_frame(lambda at, _name, frame: frames.append((at, frame)))
        until = await active
        snapshot = robot.snapshot()
        robot.finish()
        await running
    registry.close()
    sent = [frame for at, frame in frames if at <= until]
    milliseconds = snapshot.parts[0].plug_in_to_active_ms
    assert milliseconds is not None
    bits = sum(frame_bits(frame).nominal_bits + frame_bits(frame).data_bits for frame in sent)
    return PlugIn(milliseconds, sum(map(rates.seconds, sent)) * 1000, len(sent), bits)


async def one_message(rates: Rates, size: int) -> tuple[float, int]:
    """Milliseconds and frames of one message from a part to its master."""
    loop = asyncio.get_running_loop()
    driver = SimBusDriver(rates.bus())
    fd = rates.data is not None
    master = CanMasterLink(driver.attach("master"), profile_hash=1, random=Random(1), fd=fd)
    part = CanPartLink(driver.attach("part"), uid=bytes(range(1, 9)), random=Random(2))
    joined, arrived = asyncio.Event(), loop.create_future()
    part.on_signal(lambda *_: joined.set())
    frames: list[Frame] = []

    def received(packet: bytes, _peer: Peer, now: float) -> None:
        assert len(packet) == size
        arrived.set_result(now)

    master.on_packet(received)
    async with asyncio.TaskGroup() as tasks:
        running = [tasks.create_task(link.run()) for link in (master, part)]
        await joined.wait()
        await asyncio.sleep(0.5)
        driver.tap = lambda _at, name, frame: frames.append(frame) if name == "part" else None
        start = loop.time()
        part.send(Random(3).randbytes(size), 0)
        took = await arrived - start
        for task in running:
            task.cancel()
    return took * 1000, len(frames)


def main() -> None:
    """Print both tables."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_sample(folder / "robot.toml")
        print("From plug to active, one part, both steps, no compression (virtual time)\n")
        print("| bus | plug-in to active ms | bus time of its frames ms | ratio | frames | bits |")
        print("|---|---|---|---|---|---|")
        for rates in BUSES:
            result = run_virtual(plug_in(rates, folder))
            ratio = result.active_ms / result.bus_ms
            print(
                f"| {rates.name} | {result.active_ms:.1f} | {result.bus_ms:.1f} | {ratio:.2f} "
                f"| {result.frames} | {result.bits} |"
            )
    print(f"\nOne message of {THESIS_BYTES} bytes (thesis: over a minute; its published code: 30,000 ms of delays)\n")
    print("| bus | ms | frames | times quicker than a minute |")
    print("|---|---|---|---|")
    for rates in BUSES:
        took_ms, frames = run_virtual(one_message(rates, THESIS_BYTES))
        print(f"| {rates.name} | {took_ms:.2f} | {frames} | {60_000 / took_ms:,.0f} |")


if __name__ == "__main__":
    main()
