"""The modules of one Jacdac bus, without I/O: frames and the time go in, frames and events come out.

Theory of operation. Every module announces itself twice a second with the classes of its services. A new one is asked
for the registers that describe it, a few times; then it is found, with what it has answered. It is lost when it has
sent nothing for two seconds, or when its restart counter has gone down, and is then asked anew. Until somebody drives
a module it gets nothing but these questions. A module that is listened to is asked for a stream of readings, which a
sensor ends by itself when nobody asks again. Registers that somebody wants are written when they change, and again
twice a second, because a frame may be lost.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping
from math import inf

from msbot_bridges.jacdac.frames import ANNOUNCE, EVENT, GET, SET, BadFrame, Packet, decode_frame, encode_commands
from msbot_bridges.jacdac.services import (
    DESCRIPTION,
    FIRMWARE,
    PRODUCT,
    SERVICES,
    STREAMING_SAMPLES,
    Actuator,
    Sensor,
)
from msbot_xrce.lazy import dataclass

LOST_S = 2.0
ASK_S = 0.2
ASK_TIMES = 5
AGAIN_S = 0.5
STREAM_S = 1.0
LEAST_GAP_S = 0.02
"""At the most so often one module gets new values."""
MOST_MODULES = 120
"""Modules that are known at a time; others are not heard until one is lost."""
MOST_EVENTS = 4096
MOST_REGISTERS = 512
"""Registers of one module that are remembered: more than it is asked for."""
_MOST_SERVICES = 32

Register = tuple[int, int]
"""A service of a module and one of its registers."""


class Module:
    """One device of the bus.

    Args:
        device: its 8 bytes.
        classes: the classes of its services, from 1.
        now: when it has announced itself.
    """

    def __init__(self, device: bytes, classes: tuple[int, ...], restarts: int, now: float) -> None:
        self.device, self.classes, self.restarts = device, classes, restarts
        self.seen = now
        self.known: dict[Register, bytes] = {}
        """What it has answered."""
        self.is_found = self.is_reset = False
        """It was described; it has started anew, and no longer does what it was told."""
        self.is_streaming = False
        """Somebody wants its readings."""
        self.kept: dict[Register, bytes] = {}
        """Registers that are kept at a value."""
        self._questions = [(0, DESCRIPTION), (0, PRODUCT), (0, FIRMWARE)]
        for index, service in self.services():
            self._questions += [(index, register) for register in service.asked]
        self._asked = 0
        self._orders: list[Packet] = []
        self._is_changed = False
        self._ask_at, self._write_at, self._again_at, self._stream_at = now, -inf, inf, inf
        self._events: dict[int, int] = {}

    def services(self) -> Iterable[tuple[int, Sensor | Actuator]]:
        """Its services that become ports, by index."""
        for index, number in enumerate(self.classes, 1):
            if isinstance(service := SERVICES.get(number), Sensor | Actuator):
                yield index, service

    def registers(self, service: int) -> Mapping[int, bytes]:
        """What is known of one of its services."""
        return {register: data for (one, register), data in self.known.items() if one == service}

    def text(self, register: int) -> str:
        """A text of its service control, whatever bytes it has sent."""
        return self.known.get((0, register), b"").rstrip(b"\0").decode(errors="replace")

    def keep(self, service: int, registers: Mapping[int, bytes]) -> None:
        """Keep registers at a value, as long as it is there."""
        for register, data in registers.items():
            if self.kept.get((service, register)) != data:
                self.kept[(service, register)] = data
                self._is_changed = True

    def send_once(self, *packets: Packet) -> None:
        """Give commands once, with the next frame; bounded by what comes in between two frames."""
        self._orders += packets
        del self._orders[:-64]

    def write_at_once(self) -> None:
        """Write all that is kept with the next poll, and do not wait for the gap."""
        self._is_changed, self._write_at = True, -inf

    def start_streaming(self, now: float) -> None:
        """Ask for its readings from now on."""
        self.is_streaming, self._stream_at, self._again_at = True, now, now

    def release(self) -> None:
        """Leave it alone, once what was decided is written: a safe value may be among it."""
        if self._is_changed:
            self.send_once(*self._writes())
            self._is_changed = False
        self.is_streaming, self._stream_at, self._again_at = False, inf, inf
        self.kept.clear()

    def answered(self, register: Register, data: bytes) -> None:
        """A register has been reported."""
        if register not in self.known and len(self.known) >= MOST_REGISTERS:
            return  # nobody has asked for so many
        self.known[register] = data
        if register in self._questions:
            self._questions.remove(register)

    def is_news(self, service: int, command: int) -> bool:
        """Whether an event is none of the repetitions that follow each."""
        counter = command >> 8 & 0x7F
        if self._events.get(service) == counter:
            return False
        self._events[service] = counter
        return True

    def poll(self, now: float) -> list[Packet]:
        """What is to be sent to it."""
        packets: list[Packet] = []
        if not self.is_found and now >= self._ask_at:
            if not self._questions or self._asked == ASK_TIMES:
                self.is_found = True
            else:
                packets += [Packet(service, GET | register) for service, register in self._questions]
                self._asked += 1
                self._ask_at = now + ASK_S
        if (self._is_changed and now >= self._write_at) or now >= self._again_at:
            packets += self._writes()
            self._is_changed = False
            self._write_at = now + LEAST_GAP_S
            self._again_at = now + AGAIN_S if self.is_streaming else inf
        packets += self._orders
        self._orders.clear()
        if now >= self._stream_at:
            packets += [
                Packet(index, SET | STREAMING_SAMPLES, b"\xff")
                for index, service in self.services()
                if isinstance(service, Sensor)
            ]
            self._stream_at = now + STREAM_S
        return packets

    def _writes(self) -> list[Packet]:
        return [Packet(service, SET | register, data) for (service, register), data in self.kept.items()]

    @property
    def deadline(self) -> float:
        """When to poll it next, at the latest."""
        due = [self.seen + LOST_S, self._again_at, self._stream_at]
        if not self.is_found:
            due.append(self._ask_at if self._questions else -inf)
        if self._is_changed:
            due.append(self._write_at)
        if self._orders:
            due.append(-inf)
        return min(due)


@dataclass(frozen=True, slots=True)
class ModuleFound:
    """All that a module has to say about itself is known."""

    module: Module


@dataclass(frozen=True, slots=True)
class ModuleLost:
    """A module that was found is gone."""

    module: Module
    why: str


@dataclass(frozen=True, slots=True)
class Reported:
    """A module has reported a register, or an event."""

    module: Module
    service: int
    register: int | None
    """None: an event."""
    event: int
    data: bytes


BusEvent = ModuleFound | ModuleLost | Reported


class JacdacBus:
    """One bus."""

    def __init__(self) -> None:
        self.modules: dict[bytes, Module] = {}
        self.events = deque[BusEvent](maxlen=MOST_EVENTS)
        """What has happened; the reader takes it out."""
        self.bad_frames = 0
        self.left_out = 0
        """Announcements of modules for which there was no room."""

    def receive(self, data: bytes, now: float) -> None:
        """A frame has come; what is none is counted."""
        try:
            frame = decode_frame(data)
        except BadFrame:
            self.bad_frames += 1
            return
        if frame.is_command or frame.to_class:
            return
        for packet in frame.packets:
            if packet.service == 0 and packet.command == ANNOUNCE:
                self._announced(frame.device, packet.data, now)
        if (module := self.modules.get(frame.device)) is None:
            return
        module.seen = now
        for packet in frame.packets:
            self._reported(module, packet)

    def _announced(self, device: bytes, data: bytes, now: float) -> None:
        restarts = data[0] & 0x0F if data else 0
        classes = tuple(
            int.from_bytes(data[at : at + 4], "little") for at in range(4, min(len(data), 4 * _MOST_SERVICES), 4)
        )
        if (known := self.modules.get(device)) is not None:
            if known.classes == classes and known.restarts <= restarts:
                known.restarts = restarts
                return
            known.is_reset = True
            self._lose(known, "it has started anew")
        if len(self.modules) >= MOST_MODULES:
            self.left_out += 1
            return
        self.modules[device] = Module(device, classes, restarts, now)

    def _reported(self, module: Module, packet: Packet) -> None:
        if packet.command & EVENT:
            if module.is_news(packet.service, packet.command):
                self.events.append(Reported(module, packet.service, None, packet.command & 0xFF, packet.data))
        elif packet.command & 0xF000 == GET:
            register = packet.command & 0x0FFF
            module.answered((packet.service, register), packet.data)
            self.events.append(Reported(module, packet.service, register, 0, packet.data))

    def poll(self, now: float) -> list[bytes]:
        """Frames to send now."""
        frames: list[bytes] = []
        for module in list(self.modules.values()):
            if now >= module.seen + LOST_S:
                self._lose(module, f"it has sent nothing for {LOST_S:g} s")
                continue
            was_found = module.is_found
            frames += encode_commands(module.device, module.poll(now))
            if module.is_found and not was_found:
                self.events.append(ModuleFound(module))
        return frames

    def clear(self, why: str) -> None:
        """The way to the bus is gone, and with it all modules."""
        for module in list(self.modules.values()):
            self._lose(module, why)

    def _lose(self, module: Module, why: str) -> None:
        del self.modules[module.device]
        if module.is_found:
            self.events.append(ModuleLost(module, why))

    @property
    def deadline(self) -> float:
        """When to poll next, at the latest."""
        return min((module.deadline for module in self.modules.values()), default=inf)
