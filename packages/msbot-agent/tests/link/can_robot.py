"""A master and parts on a simulated bus in virtual time, for the tests of the CAN link."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from random import Random

from msbot.process.virtual_time import run_virtual
from msbot_agent.link import Peer, Signal
from msbot_agent.link.can.legacy_link import Codec
from msbot_agent.link.can.native_link import CanMasterLink, CanPartLink, NativeEnd
from msbot_agent.link.can.protocol.ids import CanIds, NodeIds
from msbot_agent.link.can.sim.model.sim_bus import SimBus
from msbot_agent.link.can.sim.sim_bus_driver import SimBusDriver
from msbot_xrce.errors import LinkDown

HASH = 0x00C0FFEE


@dataclass
class End:
    """One end of the link with all it told."""

    link: NativeEnd
    packets: list[tuple[bytes, Peer]] = field(default_factory=list)
    arrived_at: list[float] = field(default_factory=list)
    signals: list[tuple[float, Signal, Peer | None, str]] = field(default_factory=list)
    rooms: list[Peer | None] = field(default_factory=list)
    task: asyncio.Task[None] | None = None
    error: LinkDown | None = None

    def __post_init__(self) -> None:
        self.link.attach(packet=self._packet)
        self.link.attach(signal=lambda signal, peer, words, now: self.signals.append((now, signal, peer, words)))
        self.link.attach(room=self.rooms.append)

    def _packet(self, packet: bytes, peer: Peer, now: float) -> None:
        self.packets.append((packet, peer))
        self.arrived_at.append(now)

    def told(self, signal: Signal) -> list[str]:
        """The words of all signals of a kind."""
        return [words for _, kind, _, words in self.signals if kind is signal]

    def told_at(self, signal: Signal) -> list[float]:
        return [at for at, kind, _, _ in self.signals if kind is signal]

    async def serve(self) -> None:
        try:
            await self.link.run()
        except LinkDown as error:
            self.error = error


class Robot:
    """The bus, its master and its parts."""

    def __init__(self, bus: SimBus | None = None, *, fd: bool = False) -> None:
        self.bus = bus or SimBus(500_000, 2_000_000 if fd else None, fd=fd)
        self.driver = SimBusDriver(self.bus)
        self.fd = fd
        self._ends: list[End] = []
        self._names = 0

    def master(
        self,
        *,
        seed: int = 1,
        node_ids: NodeIds | None = None,
        profile_hash: int = HASH,
        codec: Codec | None = None,
        ids: CanIds | None = None,
        queue_frames: int = 32,
        name: str = "",
    ) -> End:
        link = CanMasterLink(
            self.driver.attach(name or self._name("master")),
            profile_hash=profile_hash,
            random=Random(seed),
            node_ids=node_ids,
            fd=self.fd,
            codec=codec,
            ids=ids,
            queue_frames=queue_frames,
        )
        return self._start(End(link))

    def part(
        self,
        number: int = 1,
        *,
        profile_hash: int | None = None,
        codec: Codec | None = None,
        ids: CanIds | None = None,
        name: str = "",
    ) -> End:
        bus = self.driver.attach(name or self._name("part"))
        uid = b"uid." + number.to_bytes(4, "big")
        link = CanPartLink(bus, uid=uid, random=Random(number), profile_hash=profile_hash, codec=codec, ids=ids)
        return self._start(End(link))

    async def stop(self, end: End) -> None:
        """Switch one end off."""
        assert end.task is not None
        end.task.cancel()
        await asyncio.gather(end.task, return_exceptions=True)

    async def stop_all(self) -> None:
        for end in self._ends:
            await self.stop(end)

    def _start(self, end: End) -> End:
        end.task = asyncio.get_running_loop().create_task(end.serve())
        self._ends.append(end)
        return end

    def _name(self, kind: str) -> str:
        self._names += 1
        return f"{kind} {self._names}"


def node_of(part: End) -> int:
    """The part's address."""
    assert isinstance(part.link, CanPartLink)
    return part.link.node_id


def play(scene: Callable[[Robot], Awaitable[None]], bus: SimBus | None = None, *, fd: bool = False) -> Robot:
    """Run a scene with a robot in virtual time; everything is switched off afterwards."""

    async def main() -> Robot:
        robot = Robot(bus, fd=fd)
        try:
            await scene(robot)
        finally:
            await robot.stop_all()
        return robot

    return run_virtual(main())
