"""A robot for the programs of the conformance suite, in virtual time: a master, a partner, and one program in a home.

The only file of this folder that knows where MsBOT's own modules are.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from dataclasses import dataclass, field, replace
from random import Random
from typing import Protocol

from msbot.config import Blueprint, Options, PartType, RobotProfile, Slot
from msbot.master import Master
from msbot.part import Part
from msbot.part.join.part_keys import prove, prove_sealed
from msbot.part.join.refusal import Refusal
from msbot.part.join.seal import Seal
from msbot.part.join.uid import uid_on_board
from msbot.part.messages.standard import STANDARD_MESSAGES
from msbot.pnp import Configuration, Freeze, MemoryStore, SlotBinding
from msbot.process.virtual_time import run_virtual
from msbot_agent.link import ConnectionUser
from msbot_agent.link.byte_frames import SerialReceiver, encode_serial
from msbot_agent.link.can import CanMasterLink, CanPartLink, Codec
from msbot_agent.link.can.protocol.frames import Frame, FrameJoiner, split
from msbot_agent.link.can.sim import SimBus, SimBusDriver
from msbot_agent.link.can.sim.sim_bus_driver import SimCanBus
from msbot_agent.link.contract import Signal
from msbot_agent.link.net import SocketPeer, WebSocketServerLink
from msbot_agent.link.net.udp import UdpServerLink
from msbot_agent.link.serial.serial_line import SerialLine, SerialLineServer
from msbot_xrce import compress, decompress
from msbot_xrce.compression import DICTIONARY, FIXED
from msbot_xrce.errors import LinkDown

CODEC = Codec(compress, decompress)
GIVING = ("out", "serve")
"""Directions of ports whose partner's end reads or calls."""
SLOT = "mine"
PARTNER_SLOT = "partner"
SPARE_SLOT = "spare"
UID = bytes.fromhex("00112233445566aa")
PARTNER_UID = bytes.fromhex("00112233445566bb")


@dataclass(frozen=True)
class Robot:
    """What the robot is for one program."""

    name: str = "CLASSROOM"
    number: str = "TEST-1"
    """The part number of the slot that the program's part takes."""
    bindings: tuple[tuple[str, str, str], ...] = ()
    """Ports of the program's part: name, direction, message type. The partner has the other ends."""
    settings: tuple[tuple[str, str], ...] = ()
    options: Options = field(default_factory=Options)
    keys: tuple[tuple[bytes, bytes], ...] = ()
    """UID and key."""
    spare_settings: tuple[tuple[str, str], ...] = ()
    """Settings of a second slot, into which only a person puts the program's part."""


class Home(Protocol):
    """Where a program runs."""

    def start(self, world: World, program: str, name: str) -> None:
        """Run it, plugged into the world."""

    def state(self) -> str:
        """State and reason of its part."""

    def pull(self) -> None:
        """Unplug it, in the middle of whatever it does."""

    def close(self) -> None:
        """It is over."""


class World:
    """The robot. `log` is what the program printed and what the world saw of it, in order."""

    def __init__(self, robot: Robot, home: Home, program: str, name: str, *, seed: int = 0) -> None:
        self.robot = robot
        self._program = program, name
        self.home = home
        self.log: list[str] = []
        self.random = Random(1)
        self.driver = SimBusDriver(SimBus(500_000, random=Random(seed)))
        self.driver.attach("monitor")
        self.lines = MemoryLines()
        self.page = WebSocketServerLink("ws:page")
        mine = [
            SlotBinding(port, port, kind, publishes=way in GIVING, reliable=True) for port, way, kind in robot.bindings
        ]
        self.wires = tuple(mine)
        others = [replace(binding, publishes=not binding.publishes) for binding in mine]
        spare = Slot(SPARE_SLOT, "SPARE")  # no number that a part says: it would not be clear which slot is meant
        self.store = MemoryStore(
            types=(PartType(robot.number, "the program's"), PartType("PARTNER", "partner")),
            slots=(Slot(SLOT, robot.number), Slot(PARTNER_SLOT, "PARTNER"), spare),
            configurations=(
                Configuration(1, SLOT, tuple(mine), robot.settings),
                Configuration(1, PARTNER_SLOT, tuple(others), ()),
                Configuration(1, SPARE_SLOT, (), robot.spare_settings),
            ),
        )
        self.store.keys.update(robot.keys)
        self.partner: Part | None = None
        self._tasks: dict[str, asyncio.Task[None]] = {}
        self.master = self._make_master()

    # What a scene does.

    def start_master(self) -> None:
        self._tasks["master"] = self.spawn(self.master.run())

    async def kill_master(self) -> None:
        """It falls silent in the middle of whatever it does."""
        await self._end("master")

    def new_master(self) -> None:
        """Another start of it: it remembers nothing but what its store has."""
        self.master = self._make_master()
        self.start_master()

    def plug(self) -> None:
        """The program starts."""
        self.home.start(self, *self._program)

    def plug_partner(self, *program: Callable[[Part], None]) -> Part:
        """A part at the other ends of the program's ports."""
        part = Part("PARTNER", uid=PARTNER_UID, random=Random(2))
        for tell in program:
            tell(part)
        link = CanPartLink(self.driver.attach("partner"), uid=PARTNER_UID, random=Random(3), codec=CODEC)
        self._tasks["partner"] = self.spawn(part.run_async(link, epoch_ns=lambda: 0))
        self.partner = part
        return part

    async def pull_partner(self) -> None:
        self.driver.detach("partner")
        await self._end("partner")

    def page_peer(self, came: Callable[[bytes], None]) -> PagePeer:
        """The program's end of a connection with the page's server."""
        return PagePeer(self.page, came)

    def configure(self, settings: tuple[tuple[str, str], ...]) -> None:
        """Somebody changes the settings of the program's slot."""
        old = self.store.configurations[SLOT]
        self.store.configurations[SLOT] = replace(old, version=old.version + 1, settings=settings)
        self.master.inventory.configuration_changed(SLOT)

    def rewire(self, port: str, *, wired: bool) -> None:
        """Somebody takes the wire of a port of the program's slot away, or puts it back."""
        old = self.store.configurations[SLOT]
        kept = tuple(one for one in old.bindings if one.port != port)
        if wired:
            kept += tuple(one for one in self.wires if one.port == port)
        self.store.configurations[SLOT] = replace(old, version=old.version + 1, bindings=kept)
        self.master.inventory.configuration_changed(SLOT)

    def hold(self, reason: str) -> None:
        """A teacher freezes the class: the program is a pupil's."""
        inventory, now = self.master.inventory, asyncio.get_running_loop().time()
        key = next(info.client_key for info in inventory.view(0.0) if info.slot == SLOT)
        inventory._index.sessions[key].pupil = "ben"
        inventory.pupil_parts.pupils.freeze = Freeze("ann", reason, now) if reason else None
        inventory.pupil_parts.follow(now)
        self.master.agent.recheck(key)

    def move(self, slot: str, to: str) -> None:
        """Somebody puts the part of a slot into another one."""
        now = asyncio.get_running_loop().time()
        key = next(info.client_key for info in self.master.inventory.view(now) if info.slot == slot)
        self.master.inventory.rearrange({key: to}, now, "moved by ann")

    def said_of_itself(self) -> str:
        """What the program's part has said of itself; empty: nothing."""
        infos = self.master.inventory.view(0.0)
        return next((info.says.text.rstrip() for info in infos if info.says is not None), "")

    def adopt(self, number: str) -> None:
        """Somebody gives the program's slot to parts of that number, which the library knows from now on."""
        self.store.types[number] = PartType(number, "adopted")
        self.store.slot_list[0] = Slot(SLOT, number)
        self.master.inventory.reload(asyncio.get_running_loop().time())

    def identify(self) -> None:
        """Somebody asks which part the program's is."""
        key = next(info.client_key for info in self.master.inventory.view(0.0) if info.slot == SLOT)
        assert self.master.inventory_service.identify(key)

    def part_states(self) -> str:
        """How the master sees the program's part."""
        infos = [info for info in self.master.inventory.view(0.0) if info.part_number == self.robot.number]
        return "the master says: " + (", ".join(info.state.value for info in infos) or "nobody")

    def confirmed(self) -> str:
        """Who obeys STOP, as the master knows."""
        status = self.master.inventory_service.stop.status()
        names = sorted(one.part for one in status.confirmed)
        return f"STOP confirmed by {', '.join(names) or 'nobody'}; not by {', '.join(status.silent) or 'nobody'}"

    def note(self, text: str) -> None:
        """Something that the world saw."""
        self.log.append(f"> {text}")

    async def until_state(self, *words: str, seconds: float = 20.0, look_s: float = 0.01) -> None:
        """Wait until the program's part is in one of these states; looks again and again after so many seconds."""
        loop = asyncio.get_running_loop()
        end_at = loop.time() + seconds
        while not self.home.state().startswith(words):
            assert loop.time() < end_at, f"it is {self.home.state()}, not {words}; {self.log}"
            await asyncio.sleep(look_s)

    def spawn(self, work: Coroutine[object, object, None]) -> asyncio.Task[None]:
        return asyncio.get_running_loop().create_task(work)

    async def close(self) -> None:
        self.home.close()
        for name in list(self._tasks):
            await self._end(name)

    async def _end(self, name: str) -> None:
        task = self._tasks.pop(name)
        task.cancel()
        (result,) = await asyncio.gather(task, return_exceptions=True)
        if isinstance(result, Exception):
            raise result

    def _make_master(self) -> Master:
        blueprint = Blueprint(RobotProfile(self.robot.name, "1", "7", "today", "us"), (), options=self.robot.options)
        master = Master(blueprint, self.store, random=self.random, epoch_ns=lambda: 0)
        self._add_links(master)
        return master

    def _add_links(self, master: Master) -> None:
        """Where parts come in."""
        self.driver.detach("master")
        end = self.driver.attach("master")
        profile_hash = master.profile.profile_hash()
        master.add_link(CanMasterLink(end, profile_hash=profile_hash, random=self.random, codec=CODEC))
        master.add_link(self.lines)
        master.add_link(self.page)


class PagePeer:
    """A WebSocket at the page's server without a network; made again while the master is there, as the page does."""

    def __init__(self, link: WebSocketServerLink, came: Callable[[bytes], None]) -> None:
        self._link = link
        self._came = came
        self._peer: SocketPeer | None = None
        self._task = asyncio.get_running_loop().create_task(self._carry())

    def bring(self, packet: bytes) -> None:
        """A packet for the master; nobody hears it while it is dead."""
        if self._peer is not None and self._link.has_room(self._peer):
            self._peer.receive(packet, asyncio.get_running_loop().time())

    def pull(self) -> None:
        """The connection is torn off."""
        self._task.cancel()
        if self._peer is not None:
            self._peer.connection_ended("torn off")

    def close(self) -> None:
        """It is over."""
        self._task.cancel()

    async def _carry(self) -> None:
        while True:
            try:
                peer = self._link.join(ConnectionUser("ann", "10.0.0.7"))
            except LinkDown:
                await asyncio.sleep(0.1)
                continue
            self._peer = peer
            while self._link.has_room(peer):
                try:
                    async with asyncio.timeout(0.1):
                        self._came(await peer.next_packet())
                except TimeoutError:
                    continue


class MemoryLines(SerialLineServer):
    """The master's end of a serial line whose other end is a program of ours; no terminal, so virtual time holds."""

    def __init__(self) -> None:
        super().__init__("line")
        self.line: SerialLine | None = None
        self.written: Callable[[bytes], None] = lambda _: None

    async def run(self) -> None:
        self.line = SerialLine(self, "wire")
        # Not `self.written` itself: the program's end is put in its place later.
        self.line.connection_made(_Wire(self.line, lambda octets: self.written(octets)))  # noqa: PLW0108
        self._tell(Signal.LINK_UP, None, "open")
        try:
            await asyncio.get_running_loop().create_future()
        finally:
            self.line = None
            await self._close_lines()

    def feed(self, octets: bytes) -> None:
        """Octets for the master; nobody hears them while it is dead."""
        if self.line is not None:
            self.line.data_received(octets)


class _Wire(asyncio.Transport):
    def __init__(self, line: SerialLine, written: Callable[[bytes], None]) -> None:
        super().__init__()
        self._line = line
        self._written = written

    def write(self, data: bytes | bytearray | memoryview) -> None:
        self._written(bytes(data))

    def is_closing(self) -> bool:
        return False

    def abort(self) -> None:
        """Nothing is kept."""
        asyncio.get_running_loop().call_soon(self._line.connection_lost, None)

    def set_write_buffer_limits(self, high: int | None = None, low: int | None = None) -> None:
        """Nothing waits."""


__all__ = [
    "CODEC",
    "DICTIONARY",
    "FIXED",
    "STANDARD_MESSAGES",
    "UID",
    "CanPartLink",
    "Frame",
    "FrameJoiner",
    "Home",
    "MemoryLines",
    "PagePeer",
    "Part",
    "Refusal",
    "Robot",
    "Seal",
    "SerialReceiver",
    "SimCanBus",
    "UdpServerLink",
    "World",
    "compress",
    "decompress",
    "encode_serial",
    "prove",
    "prove_sealed",
    "run_virtual",
    "split",
    "uid_on_board",
]  # fmt: skip
