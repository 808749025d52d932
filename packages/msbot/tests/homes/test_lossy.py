"""The MicroPython home on wires that lose, repeat and garble: what is reliable arrives once and in order, all of it."""

from __future__ import annotations

import asyncio
from random import Random

import pytest

from msbot import Count, Number, Text
from tests.homes.runners import DoubleEngine, MicroPython, as_micropython
from tests.homes.world import Part, Robot, World, run_virtual

PROGRAM = """
from msbot import Count, Part

part = Part("TEST-1")
count = 0


@part.every(0.05)
def tick():
    global count
    if count < 60 and part.publish("out", Count(value=count + 1)):
        count += 1


@part.on("in", Count)
def hear(message):
    print(message.value)


@part.on_lost
def lost():
    print("lost", part.reason)


part.run()
"""
ROBOT = Robot(bindings=(("out", "out", "Count"), ("in", "in", "Count")))
NUMBERS = list(range(1, 61))


class Spoiler:
    """Loses, repeats and garbles the octets between a board and its master."""

    def __init__(self, seed: int, lost: float) -> None:
        self._random = Random(seed)
        self._lost = lost
        self.is_on = False

    def spoil(self, octets: bytes) -> bytes:
        """What arrives."""
        if not self.is_on:
            return octets
        dice = self._random.random()
        if dice < self._lost:
            return b""
        if dice < self._lost + 0.03:
            place = self._random.randrange(len(octets))
            return octets[:place] + bytes((octets[place] ^ 0x10,)) + octets[place + 1 :]
        return octets * 2 if dice < self._lost + 0.06 else octets


def counts(world: World, heard: list[int]) -> Part:
    """A partner that counts to sixty and hears the program count."""

    def tell(part: Part) -> None:
        sent = [0]

        def tick() -> None:
            if sent[0] < 60 and part.publish("in", Count(value=sent[0] + 1)):
                sent[0] += 1

        part.every(0.05)(tick)
        part.on("out", Count)(lambda message: heard.append(message.value))

    return world.plug_partner(tell)


@pytest.mark.parametrize("seed", range(6))
def test_a_bad_serial_line(seed: int) -> None:
    """Nothing is lost or doubled, and the part does not start over."""

    async def main() -> None:
        world = World(ROBOT, MicroPython(DoubleEngine(), "serial"), PROGRAM, "program.py")
        spoiler, heard = Spoiler(seed, 0.1), list[int]()
        feed = world.lines.feed
        world.lines.feed = lambda octets: feed(spoiler.spoil(octets))  # type: ignore[method-assign]
        world.start_master()
        await world.master.ready.wait()
        world.plug()
        written = world.lines.written
        world.lines.written = lambda octets: written(spoiler.spoil(octets))
        await world.until_state("active")
        spoiler.is_on = True
        counts(world, heard)
        await asyncio.sleep(30.0)
        assert world.log == [str(number) for number in NUMBERS]
        assert heard == NUMBERS[len(NUMBERS) - len(heard) :]
        assert len(heard) > 30
        await world.close()

    with as_micropython():
        run_virtual(main())


@pytest.mark.parametrize("seed", range(4))
def test_a_bad_can_bus(seed: int) -> None:
    async def main() -> None:
        world = World(ROBOT, MicroPython(DoubleEngine()), PROGRAM, "program.py", seed=seed)
        heard: list[int] = []
        world.start_master()
        await world.master.ready.wait()
        world.plug()
        await world.until_state("active")
        for node in list(world.driver.bus._nodes):
            world.driver.bus.deafen(node, probability=0.02)
        world.driver.bus.set_bit_error_rate(1e-5)
        counts(world, heard)
        await asyncio.sleep(60.0)
        assert world.log == [str(number) for number in NUMBERS]
        assert heard == NUMBERS[len(NUMBERS) - len(heard) :]
        assert len(heard) > 30
        await world.close()

    with as_micropython():
        run_virtual(main())


CALLER = """
from msbot import CallError, Number, Part, Text

part = Part("TEST-1")
part.calls("name", Number, Text)
count = 0


@part.every(0.1)
def ask():
    global count
    if count < 40:
        try:
            part.call("name", Number(value=count + 1), timeout=25.0, on_reply=told)
            count += 1
        except CallError:
            pass


def told(reply, error):
    print(error or reply.text)


part.run()
"""


@pytest.mark.parametrize("seed", range(4))
def test_calls_over_a_bad_serial_line_are_served_once_and_end_once(seed: int) -> None:
    async def main() -> None:
        robot = Robot(bindings=(("name", "call", "Number -> Text"),))
        world = World(robot, MicroPython(DoubleEngine(), "serial"), CALLER, "program.py")
        spoiler, served = Spoiler(seed, 0.1), list[float]()
        feed = world.lines.feed
        world.lines.feed = lambda octets: feed(spoiler.spoil(octets))  # type: ignore[method-assign]

        def serve(part: Part) -> None:
            def name(request: Number) -> Text:
                served.append(request.value)
                return Text(text=f"{request.value:g}")

            part.serves("name", Number, Text)(name)

        world.start_master()
        await world.master.ready.wait()
        world.plug_partner(serve)
        await asyncio.sleep(1.0)
        world.plug()
        written = world.lines.written
        world.lines.written = lambda octets: written(spoiler.spoil(octets))
        await world.until_state("active")
        spoiler.is_on = True
        await asyncio.sleep(40.0)
        assert served == list(range(1, 41))
        assert world.log == [str(number) for number in range(1, 41)]
        await world.close()

    with as_micropython():
        run_virtual(main())
