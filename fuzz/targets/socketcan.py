"""SocketCAN against any kernel: frames, reports of the controller, errors of the socket, answers about the interface.

The socket is one end of a local pair; it fails when the case says so.
"""

from __future__ import annotations

import asyncio
import errno
import os
import socket
from collections.abc import Iterable, Sequence
from random import Random

from fuzz.bounds import REASONS, hold
from fuzz.case import Case, Step, Violation, plain
from fuzz.virtual import play, read_logs, the_loop
from msbot_agent.link.can.adapters.can_driver import CanDriver
from msbot_agent.link.can.adapters.error_frames import (
    CLASSIC_SIZE,
    ERROR,
    FD_SIZE,
    pack_frame,
    read_report,
    unpack_frame,
)
from msbot_agent.link.can.adapters.interface import CanInterface, parse_interface
from msbot_agent.link.can.adapters.remedies import Wanted, why_not
from msbot_agent.link.can.adapters.socketcan import SocketCanAdapter
from msbot_agent.link.can.controller import BusState, CanBusInfo
from msbot_agent.link.can.filters import IdFilter
from msbot_agent.link.can.protocol.frames import Frame
from msbot_xrce.errors import LinkDown, LinkFull

CAN0 = CanInterface("can0", 3, is_can=True, is_up=True, mtu=72, kind="can", bitrate=500_000)
RING = 64
"""Small, so that it is met."""
ERRORS = (errno.ENETDOWN, errno.ENODEV, errno.ENXIO, errno.ENOBUFS, errno.EIO, errno.ENOMEM, errno.EBADMSG)
SWITCHES = ("there", "up", "off", "passive", "kernel restarts", "may restart")
LOOK_S = 3.0
"""Longer than the longest pause between two looks for the interface."""


class ShakySocket(socket.socket):
    """A socket that fails when it is told to."""

    receive_error = 0
    send_error = 0

    def recv(self, size: int, flags: int = 0, /) -> bytes:
        """As the kernel, or the error."""
        self._fail()
        return super().recv(size, flags)

    def recvmsg(self, size: int, room: int = 0, /) -> tuple[bytes, list[tuple[int, int, bytes]], int, object]:  # type: ignore[override]  # fewer arguments
        """As the kernel, or the error."""
        self._fail()
        return super().recvmsg(size, room)

    def send(self, data: bytes, /) -> int:  # type: ignore[override]  # octets only
        """As the kernel, or the error."""
        if self.send_error:
            raise OSError(self.send_error, os.strerror(self.send_error))
        return super().send(data)

    def _fail(self) -> None:
        number, self.receive_error = self.receive_error, 0
        if number:
            raise OSError(number, os.strerror(number))


class Kernel:
    """One interface, with everything that can happen to it."""

    def __init__(self) -> None:
        self.switches = dict.fromkeys(SWITCHES, True) | {"off": False, "passive": False, "kernel restarts": False}
        self.sock: ShakySocket | None = None
        self.wire: socket.socket | None = None
        self.opened = 0

    def find(self, _: str) -> CanInterface | None:
        """What the kernel says of the interface."""
        if not self.switches["there"]:
            return None
        state = BusState.OFF if self.switches["off"] else BusState.ACTIVE
        if self.switches["passive"] and state is BusState.ACTIVE:
            state = BusState.PASSIVE
        restart_ms = 100 if self.switches["kernel restarts"] else 0
        return CanInterface(
            "can0", 3, is_can=True, is_up=self.switches["up"], mtu=72, kind="can", state=state, restart_ms=restart_ms
        )

    def connect(self, _: Wanted, __: Sequence[IdFilter] | None) -> socket.socket:
        """A socket on it."""
        self.close()
        ours, self.wire = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.sock = ShakySocket(fileno=ours.detach())
        for end in (self.sock, self.wire):
            end.setblocking(False)
        self.sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1)
        self.opened += 1
        return self.sock

    def restart(self, _: int) -> None:
        """Restart the controller, if that is allowed."""
        if not self.switches["may restart"]:
            raise OSError(errno.EPERM, os.strerror(errno.EPERM))
        self.switches["off"] = False

    def close(self) -> None:
        """Let go of the bus."""
        if self.wire is not None:
            self.wire.close()
            self.wire = None

    def put(self, octets: bytes) -> None:
        """Something comes in from the bus."""
        if self.wire is not None:
            try:
                self.wire.send(octets)
            except OSError:
                return  # the driver does not read, or has let go: the bus does not wait

    def take(self) -> list[Frame | None]:
        """What went out to the bus."""
        frames: list[Frame | None] = []
        try:
            while self.wire is not None:
                octets = self.wire.recv(FD_SIZE)
                if not octets:
                    break
                frames.append(unpack_frame(octets))
        except OSError:
            return frames
        return frames


class SocketCanWorld:
    """A driver on that kernel, and somebody who restarts it as a port does."""

    def __init__(self) -> None:
        self.kernel = Kernel()
        adapter = SocketCanAdapter(
            Wanted("can0", fd=True),
            CanBusInfo("can:can0", 500_000, None, fd=True),
            filters=(),
            find=self.kernel.find,
            connect=self.kernel.connect,
            restart=self.kernel.restart,
        )
        self.driver = CanDriver(adapter, ring_frames=RING)
        self.frames: list[Frame] = []
        self.seen: set[str] = set()
        self.driver.attach(frame=lambda frame, _: self.frames.append(frame))
        self.driver.attach(state=self._state)
        self.driver.attach(room=lambda _: self.seen.add("room"))

    def _state(self, state: BusState, words: str, _: float) -> None:
        self.seen.add(f"{state.value}: {plain(words)}")
        if state is BusState.OFF:
            the_loop().call_later(1.0, self.driver.restart)

    def do(self, step: Step) -> None:
        """One step."""
        kernel = self.kernel
        match step.verb:
            case "in":
                kernel.put(step.data[:FD_SIZE])
            case "burst":
                for number in range(abs(step.whole(0)) % 200):
                    kernel.put(pack_frame(Frame(number)))
            case "switch":
                name = SWITCHES[abs(step.whole(0)) % len(SWITCHES)]
                kernel.switches[name] = not kernel.switches[name]
            case "fail" if kernel.sock is not None:
                number = ERRORS[abs(step.whole(1)) % len(ERRORS)]
                if step.whole(0) & 1:
                    kernel.sock.send_error = 0 if kernel.sock.send_error else number
                else:
                    kernel.sock.receive_error = number
                    kernel.put(pack_frame(Frame(1)))
            case "out":
                self._send(step)
            case "answer":
                found = parse_interface(step.data)
                why_not(Wanted("can0", fd=True), found, [])
        report = read_report(int.from_bytes(step.data[:4]), step.data[4:])
        if (report.state is None) != (not report.words):
            raise Violation("a state without words")

    def _send(self, step: Step) -> None:
        try:
            self.driver.send(Frame(abs(step.whole(0)) & 0x7FF, step.data[:8]))
        except (LinkDown, LinkFull) as error:
            self.seen.add(f"{type(error).__name__} {plain(str(error))}")
            if self.driver.has_room():
                raise Violation("there is room, and it is refused") from error

    def check(self) -> None:
        """Nothing was raised, nothing grows."""
        the_loop().check()
        hold("frames in the ring", len(self.driver._ring), RING)
        hold("reasons", len(self.driver.dropped), REASONS)
        hold("words", len(self.driver._said), 256)
        self.frames.clear()
        self.kernel.take()

    async def heal(self) -> None:
        """Everything is in order again.

        Raises:
            Violation: frames do not come and go.
        """
        kernel = self.kernel
        kernel.switches = dict.fromkeys(SWITCHES, True) | {"off": False, "passive": False, "kernel restarts": False}
        if kernel.sock is not None:
            kernel.sock.send_error = kernel.sock.receive_error = 0
        await asyncio.sleep(LOOK_S)
        kernel.put(pack_frame(Frame(0x100, error=True)))  # the controller tells of its restart
        kernel.put(pack_frame(Frame(0x004, b"\0\x40", error=True)))
        await asyncio.sleep(LOOK_S)
        kernel.take()
        self.frames.clear()
        if not self.driver.has_room():
            raise Violation(f"no room after the noise: {self.driver._bus_state}, held {self.driver._held}")
        frame = Frame(0x123, b"well")
        self.driver.send(frame)
        kernel.put(pack_frame(frame))
        await asyncio.sleep(LOOK_S)
        if self.frames != [frame] or kernel.take() != [frame]:
            raise Violation("a frame did not come, or did not go")


class SocketCanTarget:
    """See the module's docstring."""

    name = "socketcan"
    about = "the driver of real CAN buses: nothing raises, memory is bounded, frames come and go after the trouble"

    def make(self, random: Random) -> Case:
        """Trouble."""
        return tuple(_step(random) for _ in range(random.randrange(1, 60)))

    def run(self, case: Case) -> Iterable[str]:
        """Live through it."""
        reader = read_logs()
        reader.take()

        async def main() -> set[str]:
            world = SocketCanWorld()
            serving = asyncio.create_task(world.driver.run())
            await asyncio.sleep(0)
            for step in case:
                if step.verb == "wait":
                    await asyncio.sleep(min(abs(step.number(0)), 12.0))
                else:
                    world.do(step)
                    await asyncio.sleep(0)
                world.check()
                if serving.done():
                    raise Violation(f"the driver has ended: {serving.exception()}")
            await world.heal()
            world.check()
            world.seen.update(plain(reason) for reason in world.driver.dropped)
            serving.cancel()
            await asyncio.gather(serving, return_exceptions=True)
            world.kernel.close()
            return world.seen

        return play(main()) | {plain(line) for line in reader.take()}


def _step(random: Random) -> Step:
    match random.randrange(11):
        case 0 | 1:
            size = random.choice((CLASSIC_SIZE, FD_SIZE, CLASSIC_SIZE, random.randrange(80)))
            return Step("in", random.randbytes(size))
        case 2 | 3:
            word = (ERROR | random.choice((0x04, 0x40, 0x100, 0x20, 0x8A, random.getrandbits(10)))).to_bytes(
                4, "little"
            )
            details = bytes((0, random.choice((0, 4, 8, 16, 32, 64, 3)))) + random.randbytes(6)
            return Step("in", word + b"\x08\0\0\0" + details)
        case 4:
            return Step("burst", b"", (random.choice((3, 70, 199)),))
        case 5:
            return Step("switch", b"", (random.randrange(len(SWITCHES)),))
        case 6:
            return Step("fail", b"", (random.randrange(2), random.randrange(len(ERRORS))))
        case 7:
            return Step("answer", random.randbytes(random.choice((0, 16, 32, 100))))
        case 8:
            return Step("wait", b"", (random.choice((0.0, 0.003, 0.1, 1.0, 6.0, 12.0)),))
    return Step("out", random.randbytes(random.randrange(9)), (random.getrandbits(11),))
