"""The firmware's part as a node of a simulated bus, in the bus' own time."""

from __future__ import annotations

import asyncio
import struct
from dataclasses import dataclass, field
from enum import IntEnum

from tests.firmware.msbot_side import Frame, SimCanBus
from tests.firmware.pipe import Firmware, frame_octets, frame_of

_STATE = struct.Struct("<BB?IIHHH?I")


class PartState(IntEnum):
    """As in `msbot_part.h`."""

    LOOKING = 0
    RECOGNISING = 1
    CLAIMING = 2
    CONFIGURING = 3
    ACTIVE = 4
    LOST = 5
    REFUSED = 6
    WRONG_ROBOT = 7


@dataclass(frozen=True)
class Described:
    """What a part says about itself."""

    uid: bytes
    part_number: str = "PIN-BOARD"
    local_name: str = "board"
    robot: tuple[str, str, str, str] = ("", "", "", "")
    """Name, version, serial number and manufacturer that it is made for; "" = any."""
    key: bytes = b""
    random: int = 77
    codec: bool = True
    fd: bool = False
    ports: tuple[tuple[int, str, str], ...] = ((0, "drive", "Switch"), (1, "level", "Switch"))
    """What it does (0 subscribes, 1 publishes, 2 serves, 3 calls), name, type of its messages."""

    def octets(self, bitrate: int) -> bytes:
        """As the pipe takes it."""
        link = self.uid + struct.pack("<????III", self.codec, self.fd, self.fd, False, 0, bitrate, 5)
        words = (self.part_number, self.local_name, *self.robot)
        ports = b"".join(bytes((does,)) + _text(name) + _text(kind) for does, name, kind in self.ports)
        head = link + struct.pack("<I", self.random) + b"".join(map(_text, words))
        return head + bytes((len(self.key),)) + self.key + bytes((len(self.ports),)) + ports


@dataclass
class CPart:
    """The part of one firmware; `plug` it into a controller inside a running loop."""

    firmware: Firmware
    described: Described
    clock_us: int = 2**32 - 3_000_000
    """What the firmware's clock shows when the loop's shows 0: it comes round soon."""
    state: PartState = PartState.LOOKING
    node_id: int = 0
    stopped: bool = False
    beats: int = 0
    missed_beats: int = 0
    dropped: tuple[int, int, int] = (0, 0, 0)
    """By the part, refused by the agent, by the session."""
    story: list[str] = field(default_factory=list)
    """States, settings and safe values in their order."""
    heard: list[tuple[int, bytes]] = field(default_factory=list)
    """(port, message) as they came in."""
    asked: list[tuple[int, bytes]] = field(default_factory=list)
    """(port, request) as they came to the functions that serve."""
    ended: list[tuple[int, bytes | str]] = field(default_factory=list)
    """(number of the call, its reply or a sentence)."""
    serves: bool = True
    """Whether the program has functions that serve."""
    _bus: SimCanBus | None = None
    _timer: asyncio.TimerHandle | None = None

    def plug(self, bus: SimCanBus) -> None:
        """Power up on this controller."""
        self._bus = bus
        bus.attach(frame=self._frame)
        bus.attach(room=self._room)
        self._ask(b"E" + bytes((self.serves,)), b"A" + self.described.octets(bus.info.bits_per_second or 0), b"B")

    def pull(self) -> None:
        """Without power from now on."""
        self._bus = None
        if self._timer is not None:
            self._timer.cancel()

    def publish(self, port: int, message: bytes) -> bool:
        """Send a message out of a port."""
        return self._ask(b"U" + bytes((port,)) + message)[0] == b"\1"

    def log(self, text: bytes, level: int = 1) -> bool:
        """Write a line into the robot's log; whether it is taken."""
        return self._ask(b"G" + bytes((level,)) + self._stamp() + text + b"\0")[0] == b"\1"

    def watch(self, port: int, fields: str) -> bool:
        """Look at the ranges of what it publishes at a port; whether port and fields are such."""
        return self._ask(b"a" + bytes((port,)) + _text(fields))[0][:1] == b"\1"

    @property
    def out_of_range(self) -> int:
        """Messages with a value outside of its range."""
        return int.from_bytes(self._ask(b"a\xff\0")[0][1:], "little")

    def call(self, port: int, number: int, request: bytes, timeout_s: float = 1.0) -> str:
        """Send a request out of a port; returns why it is not sent."""
        head = struct.pack("<BBI", port, number, round(timeout_s * 1e6))
        return self._ask(b"L" + head + self._stamp() + request)[0].decode()

    def say_stop(self) -> None:
        """STOP for everybody."""
        self._ask(b"K\1", b"T" + self._stamp())

    def hold_stop(self, is_pressed: bool) -> None:
        """How its STOP button stands."""
        self._ask(b"P" + bytes((is_pressed,)) + self._stamp(), b"T" + self._stamp())

    def _stamp(self) -> bytes:
        now = round(asyncio.get_running_loop().time() * 1e6) + self.clock_us
        return (now & 0xFFFFFFFF).to_bytes(4, "little")

    def _frame(self, frame: Frame, now: float) -> None:
        stamp = (round(now * 1e6) + self.clock_us & 0xFFFFFFFF).to_bytes(4, "little")
        self._ask(b"F" + stamp + frame_octets(frame))

    def _room(self, now: float) -> None:
        stamp = (round(now * 1e6) + self.clock_us & 0xFFFFFFFF).to_bytes(4, "little")
        drained = (b"Q" + stamp,) if self._bus is not None and self._bus.pending() == 0 else ()
        self._ask(*drained)

    def _wake(self) -> None:
        self._timer = None
        self._ask(b"T" + self._stamp())

    def _ask(self, *requests: bytes) -> list[bytes]:
        """The answers; then hands over all frames that the controller takes, and looks how the part stands."""
        answers: list[bytes] = []
        asked = requests
        while True:
            bus = self._bus
            room = bus is not None and bus.has_room()
            pending = 0 if bus is None else bus.pending()
            next_frame = b"N" + bytes((pending,)) + self._stamp() if room else b"I"
            *given, frame, state = self.firmware.ask(*asked, next_frame, b"I")
            answers = answers or given
            self._look(state) if room else self._look(frame)
            if bus is None or not room or not frame:
                return answers
            bus.send(frame_of(frame))
            asked = ()

    def _look(self, answer: bytes) -> None:
        state, self.node_id, self.stopped, self.beats, self.missed_beats, *dropped, has_due, due = _STATE.unpack_from(
            answer
        )
        self.state = PartState(state)
        self.dropped = (dropped[0], dropped[1], dropped[2])
        self._take_story(answer[_STATE.size :])
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if has_due and self._bus is not None:
            loop = asyncio.get_running_loop()
            # From the distance, because the firmware's clock comes round.
            now = round(loop.time() * 1e6) + self.clock_us
            wait_us = max(1, (due - now + 2**31) % 2**32 - 2**31)
            self._timer = loop.call_later(wait_us / 1e6, self._wake)

    def _take_story(self, octets: bytes) -> None:
        while octets:
            end = 2 + int.from_bytes(octets[:2], "little")
            letter, rest = octets[2:3], octets[3:end]
            octets = octets[end:]
            match letter:
                case b"r":
                    self.heard.append((rest[0], rest[1:]))
                case b"q":
                    self.asked.append((rest[0], rest[1:]))
                case b"y":
                    self.ended.append((rest[0], rest[2:].decode() if rest[1] else rest[2:]))
                case b"s":
                    self.story.append(rest.decode())
                case b"z":
                    self.story.append("safe" if rest == b"\xff" else f"safe {rest[0]}")
                case b"c":
                    self.story.append(PartState(rest[0]).name)
                case b"i":
                    self.story.append("identify")


def _text(text: str) -> bytes:
    return text.encode() + b"\0"
