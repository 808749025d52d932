"""Interfaces, the tools of can-utils, and our own ends on a bus of the kernel."""

from __future__ import annotations

import asyncio
import os
import subprocess
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path

from msbot_agent.link import Link, Peer, Signal
from msbot_agent.link.can import BusState, CanSettings, Codec, open_can_bus
from msbot_agent.link.can.adapters.can_driver import CanDriver
from msbot_agent.link.can.protocol import Frame
from msbot_agent.link.can.protocol.notation import parse_log_line
from msbot_xrce import compress, decompress, is_whole

PATIENCE_S = 400.0
"""How long a test waits before it fails; nothing here is this slow, also in an emulated machine on a busy computer."""
LOOK_S = 0.1 if os.environ.get("MSBOT_VM") == "qemu" else 0.005
"""How often a test looks whether something has come; where Python is emulated, looking takes time from who is looked
at."""
HASH = 0x00C0FFEE
SETTINGS = CanSettings(codec=Codec(compress, decompress), is_whole=is_whole, profile_hash=HASH)


def ip(words: str) -> None:
    """Change an interface, as a user does with `ip link`."""
    subprocess.run(["ip", "link", *words.split()], check=True)


def add_vcan(name: str = "vcan0") -> None:
    """A virtual bus that bears CAN FD, up."""
    ip(f"add {name} type vcan")
    ip(f"set {name} mtu 72 up")


def interfaces() -> str:
    """What the kernel says of all interfaces, and how often their controllers have interrupted."""
    seen = subprocess.run(["ip", "-details", "-statistics", "link"], capture_output=True, text=True, check=True).stdout
    return f"the interfaces:\n{seen}\n{Path('/proc/interrupts').read_text()}"


async def until(condition: Callable[[], bool]) -> None:
    """Wait for something that comes from outside of the event loop's view; what never comes fails with the state of
    all interfaces, because a controller that stands still looks like a master that says nothing."""
    try:
        async with asyncio.timeout(PATIENCE_S):
            while not condition():  # noqa: ASYNC110 - of the kernel and other processes no event tells
                await asyncio.sleep(LOOK_S)
    except TimeoutError as error:
        raise AssertionError(f"not within {PATIENCE_S:.0f} s; {interfaces()}") from error


class Ear:
    """A controller of our own without a protocol: what it hears, and a mouth."""

    def __init__(self, bus: CanDriver) -> None:
        self.bus = bus
        self.frames: list[Frame] = []
        self.states: list[tuple[BusState, str]] = []
        bus.attach(frame=lambda frame, now: self.frames.append(frame))
        bus.attach(state=lambda state, words, now: self.states.append((state, words)))

    async def heard(self, frames: int) -> list[Frame]:
        """Everything heard, once it is that many frames."""
        await until(lambda: len(self.frames) >= frames)
        return self.frames

    async def send(self, frame: Frame) -> None:
        """Send one frame as soon as there is room."""
        await until(self.bus.has_room)
        self.bus.send(frame)


@asynccontextmanager
async def listening(address: str, *, error_frames: bool = False) -> AsyncIterator[Ear]:
    """A controller that hears everything."""
    ear = Ear(open_can_bus(address, error_frames=error_frames))
    task = asyncio.create_task(ear.bus.run())
    try:
        await until(lambda: ear.bus.has_room() or task.done())
        if task.done():
            task.result()
        yield ear
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


class Candump:
    """candump, and the frames it shows."""

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        self._process = process

    async def next(self) -> Frame:
        """The next frame it shows."""
        assert self._process.stdout is not None
        async with asyncio.timeout(PATIENCE_S):
            return parse_log_line((await self._process.stdout.readline()).decode()).frame


@asynccontextmanager
async def candump(*arguments: str) -> AsyncIterator[Candump]:
    """candump of an interface, once it listens."""
    before = _subscriptions()
    process = await asyncio.create_subprocess_exec("candump", "-L", *arguments, stdout=asyncio.subprocess.PIPE)
    try:
        await until(lambda: _subscriptions() > before)
        yield Candump(process)
    finally:
        process.terminate()
        await process.communicate()


def _subscriptions() -> int:
    """Filters of all sockets, as the kernel lists them."""
    return sum(
        "raw" in line
        for kind in ("all", "fil", "inv", "sff", "eff")
        for line in Path(f"/proc/net/can/rcvlist_{kind}").read_text().splitlines()
    )


async def cansend(interface: str, *frames: str) -> None:
    """Send frames with can-utils' cansend."""
    for frame in frames:
        process = await asyncio.create_subprocess_exec("cansend", interface, frame)
        assert await process.wait() == 0, frame


class End:
    """One link on the bus with all it told."""

    def __init__(self, link: Link) -> None:
        self.link = link
        self.packets: list[tuple[bytes, Peer]] = []
        self.signals: list[tuple[Signal, Peer | None, str]] = []
        link.attach(packet=lambda packet, peer, now: self.packets.append((packet, peer)))
        link.attach(signal=lambda signal, peer, words, now: self.signals.append((signal, peer, words)))

    def told(self, signal: Signal) -> list[str]:
        """The words of all signals of that kind."""
        return [words for kind, _, words in self.signals if kind is signal]

    async def until_told(self, signal: Signal, times: int = 1) -> str:
        """The words of the signal, once it has come that often."""
        await until(lambda: len(self.told(signal)) >= times)
        return self.told(signal)[times - 1]

    async def until_packets(self, packets: int) -> None:
        """Wait until that many packets have come."""
        await until(lambda: len(self.packets) >= packets)

    async def send_all(self, packets: list[bytes], peer: Peer) -> None:
        """Send packets one after the other, as fast as the link takes them."""
        for packet in packets:
            await until(lambda: self.link.has_room(peer))
            self.link.send(packet, peer)


@asynccontextmanager
async def running(*links: Link) -> AsyncIterator[list[End]]:
    """Run links until the block ends; each is up when it begins. What fails there is told with all that they told."""
    ends = [End(link) for link in links]
    tasks = [asyncio.create_task(link.run()) for link in links]
    try:
        await until(lambda: all(end.told(Signal.LINK_UP) for end in ends) or any(task.done() for task in tasks))
        for task in tasks:
            if task.done():
                task.result()
        yield ends
    except AssertionError as error:
        for end in ends:
            error.add_note(f"{end.link.info.name}: {len(end.packets)} packets, {end.link.counters}, {end.signals}")
        raise
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
