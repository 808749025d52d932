"""A served simulated bus with programs on it that say anything, do not read, come and go."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable
from random import Random

from fuzz.bounds import REASONS, hold
from fuzz.case import Case, Step, Violation, plain
from fuzz.mutate import mutate_octets
from fuzz.virtual import play, read_logs, the_loop
from msbot_agent.link.can.controller import BusState
from msbot_agent.link.can.protocol.frames import FD_LENGTHS, Frame
from msbot_agent.link.can.sim.model.sim_bus import MAILBOXES, SimBus
from msbot_agent.link.can.sim.model.sim_bus_messages import (
    MAX_MESSAGE,
    BusFrame,
    FrameSent,
    Hello,
    Message,
    Restart,
    Splitter,
    StateTold,
    Welcome,
    encode,
)
from msbot_agent.link.can.sim.sim_bus_driver import SimBusDriver
from msbot_agent.link.can.sim.sim_bus_server import MAX_PROGRAMS, SimBusConnection, SimBusServer
from msbot_xrce.errors import RemoteProtocolError

PROGRAMS = 4
KEY = bytes(16)


class Wire(asyncio.Transport):
    """The connection of one program; it keeps what it is told."""

    def __init__(self) -> None:
        super().__init__()
        self.told = bytearray()
        self.is_open = True

    def write(self, data: bytes | bytearray | memoryview) -> None:
        """Keep it, unless the connection is closed."""
        if self.is_open:
            self.told += data

    def set_write_buffer_limits(self, high: int | None = None, low: int | None = None) -> None:
        """Everything fits."""

    def pause_reading(self) -> None:
        """Nothing is read unless the case says so."""

    def resume_reading(self) -> None:
        """See above."""

    def is_closing(self) -> bool:
        """Whether it was closed."""
        return not self.is_open

    def close(self) -> None:
        """Carry nothing any more."""
        self.is_open = False

    def abort(self) -> None:
        """The same."""
        self.is_open = False


class SimBusWorld:
    """A server and the programs that come and go."""

    def __init__(self) -> None:
        self.driver = SimBusDriver(SimBus(500_000, 2_000_000, fd=True))
        self.server = SimBusServer(self.driver, "fuzz")
        self.server.key = KEY
        self.programs: dict[int, tuple[SimBusConnection, Wire]] = {}
        self.seen: set[str] = set()

    def program(self, number: int) -> tuple[SimBusConnection, Wire]:
        """The program of that number; connected if it is not."""
        if number not in self.programs or not self.programs[number][1].is_open:
            program, wire = SimBusConnection(self.server), Wire()
            program.connection_made(wire)
            self.programs[number] = program, wire
        return self.programs[number]

    def do(self, step: Step) -> None:
        """One step."""
        program, wire = self.program(abs(step.whole(0)) % PROGRAMS)
        match step.verb:
            case "in" if wire.is_open:
                program.data_received(step.data)
            case "leave":
                program.connection_lost(None)
            case "full":
                program.pause_writing()
            case "reads":
                program.resume_writing()
            case "short":
                self.driver.short_circuit()
            case "repair":
                self.driver.repair()

    def check(self) -> None:
        """Nothing was raised, nothing grows, and what programs are told makes sense."""
        the_loop().check()
        hold("programs", self.server.programs, MAX_PROGRAMS)
        hold("reasons", len(self.server.counters.dropped), REASONS)
        hold("listeners", len(self.driver.listeners), PROGRAMS)
        hold("controllers", len(self.driver._ports), PROGRAMS)
        for program, wire in self.programs.values():
            hold("octets of a message", len(program._splitter._buffer), MAX_MESSAGE + 2)
            hold("frames of a controller", len(program._outstanding), MAILBOXES)
            try:
                self.seen.update(type(message).__name__ for message in Splitter().receive(bytes(wire.told)))
            except RemoteProtocolError as error:
                raise Violation(f"a program is told nonsense: {error}") from error
            wire.told.clear()

    async def heal(self) -> None:
        """Two honest programs meet.

        Raises:
            Violation: a frame does not come, or is not acknowledged.
        """
        self.driver.repair()
        for program, _ in self.programs.values():
            program.connection_lost(None)
        self.programs.clear()
        if self.server.programs or self.driver.listeners or self.driver._ports:
            raise Violation("who has gone is still there")
        (_, ear), (mouth, wire) = (self.program(number) for number in (0, 1))
        for program, _ in list(self.programs.values()):
            program.data_received(encode(Hello(KEY, "honest")))
        mouth.data_received(encode(BusFrame(Frame(0x123, b"well"), 7)))
        await asyncio.sleep(0.1)
        heard, told = (Splitter().receive(bytes(it.told)) for it in (ear, wire))
        frames = [message.frame for message in heard if isinstance(message, BusFrame)]
        if frames != [Frame(0x123, b"well")] or not isinstance(heard[0], Welcome):
            raise Violation(f"a frame did not come: {heard}")
        if [message.tag for message in told if isinstance(message, FrameSent)] != [7]:
            raise Violation(f"a frame was not acknowledged: {told}")


class SimBusTarget:
    """See the module's docstring."""

    name = "simbus"
    about = (
        "a simulated bus served to programs: nothing raises, memory is bounded, honest programs meet after the noise"
    )

    def make(self, random: Random) -> Case:
        """Programs that do what they like."""
        return tuple(_step(random) for _ in range(random.randrange(1, 60)))

    def run(self, case: Case) -> Iterable[str]:
        """Serve them."""
        reader = read_logs()
        reader.take()

        async def main() -> set[str]:
            world = SimBusWorld()
            for step in case:
                if step.verb == "wait":
                    await asyncio.sleep(min(abs(step.number(0)), 3.0))
                else:
                    world.do(step)
                    await asyncio.sleep(0)
                world.check()
            await world.heal()
            world.check()
            world.seen.update(plain(reason) for reason in world.server.counters.dropped)
            return world.seen

        return play(main()) | {plain(line) for line in reader.take()}


def _step(random: Random) -> Step:
    number = random.randrange(PROGRAMS)
    match random.randrange(12):
        case 0 | 1 | 2:
            key = random.choice((KEY, KEY, KEY, bytes(15) + b"x"))
            hello = Hello(key, "A", random.random() < 0.2, random.random() < 0.2)
            return Step("in", encode(hello), (number,))
        case 3 | 4 | 5:
            octets = b"".join(encode(_message(random)) for _ in range(random.choice((1, 1, 2, 4))))
            return Step("in", octets, (number,))
        case 6:
            return Step("in", mutate_octets(random, encode(_message(random))), (number,))
        case 7:
            return Step(random.choice(("leave", "full", "reads")), b"", (number,))
        case 8:
            return Step(random.choice(("short", "repair", "repair")), b"", (number,))
    return Step("wait", b"", (random.choice((0.0, 0.0005, 0.01, 0.2, 3.0)),))


def _message(random: Random) -> Message:
    if random.random() < 0.1:
        return Restart()
    if random.random() < 0.03:
        return StateTold(BusState.PASSIVE, 0.0, 0, 0, "")
    fd, extended = random.random() < 0.3, random.random() < 0.3
    size = random.choice(FD_LENGTHS if fd else FD_LENGTHS[:9])
    can_id = random.getrandbits(29 if extended else 3)
    frame = Frame(can_id, random.randbytes(size), extended, fd, fd and random.random() < 0.5)
    return BusFrame(frame, random.getrandbits(8), random.random())
