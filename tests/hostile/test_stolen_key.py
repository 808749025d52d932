"""Somebody who knows the client key of an active part, over UDP: the part notices nothing, and its restart is quick."""

from __future__ import annotations

import asyncio
import signal
import subprocess
import sys
from collections.abc import AsyncIterator, Callable
from contextlib import ExitStack, asynccontextmanager
from random import Random
from socket import AF_INET, SOCK_DGRAM, socket

import pytest

from msbot.config import Blueprint, PartType, RobotProfile, Slot, Timing
from msbot.master import Master
from msbot.pnp import Configuration, MemoryStore, PartEvent, PartState, SlotBinding
from msbot_agent.agent import ClientView
from msbot_agent.link.net import UdpServerLink
from msbot_xrce.messages import SESSION_NONE, CreateClient, Header, encode_message

PATIENCE_S = 60.0
KNOCKS = 57
NEVER = Timing("test", beat_period_s=60.0, tick_period_s=100.0, life=3, profile_period_s=5.0)
"""Nobody is late or lost by silence alone before the test's patience has ended: a probe alone finds out who is dead."""
PART = """\
import random, sys
from msbot.part import HelloWorld, Part
part = Part("T0", uid=bytes(range(1, 9)), random=random.Random(7))  # the same client key again
@part.every(0.02)
def speak():
    part.publish("out", HelloWorld(index=1, message="x"))
part.run(["--link", sys.argv[1]])
"""


class Robot:
    """A master in this process, its part in another one."""

    def __init__(self, master: Master, link: UdpServerLink, stack: ExitStack) -> None:
        self.master, self.link, self._stack = master, link, stack
        self.states: list[PartState] = []
        master.inventory.on_event(self._changed)

    def _changed(self, event: PartEvent) -> None:
        if event.slot:
            self.states.append(event.to_state)

    def start_part(self) -> subprocess.Popen[bytes]:
        words = [sys.executable, "-c", PART, f"udp:127.0.0.1:{self.link.port}"]
        process = self._stack.enter_context(subprocess.Popen(words))
        self._stack.callback(process.kill)
        return process

    def holder(self) -> ClientView | None:
        """The session of the part that is active in the slot."""
        info = self.master.inventory.holder("S0", asyncio.get_running_loop().time())
        if info is None or info.state is not PartState.ACTIVE:
            return None
        return next((view for view in self.master.agent.clients() if view.address == info.address), None)

    def samples(self) -> int:
        return sum(published for name, published, _ in self.master.agent.topics() if name == "said")

    async def until(self, condition: Callable[[], bool]) -> None:
        async with asyncio.timeout(PATIENCE_S):
            while not condition():  # noqa: ASYNC110 - nobody tells
                await asyncio.sleep(0.005)


@asynccontextmanager
async def robot() -> AsyncIterator[Robot]:
    store = MemoryStore(
        types=(PartType("T0", "a test's"),),
        slots=(Slot("S0", "T0"),),
        configurations=(
            Configuration(1, "S0", (SlotBinding("out", "said", "HelloWorld", publishes=True, reliable=False),), ()),
        ),
    )
    link = UdpServerLink("127.0.0.1", 0)
    blueprint = Blueprint(RobotProfile("R", "1", "1", "today", "us"), (), timing=NEVER)
    master = Master(blueprint, store, random=Random(1))
    master.add_link(link)
    running = asyncio.create_task(master.run())
    async with asyncio.timeout(PATIENCE_S):
        await master.ready.wait()
    with ExitStack() as stack:
        yield Robot(master, link, stack)
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)


def knock(attacker: socket, part: ClientView, dice: Random) -> int:
    """Log in with the part's key, under its session id and another one, and send garbage; gives packets."""
    packets = [
        encode_message(Header(SESSION_NONE), [CreateClient(part.key, session_id, 512)], pad_end=False)
        for session_id in (part.session_id, part.session_id ^ 1)
    ]
    packets += [bytes([part.session_id]) + dice.randbytes(size) for size in (3, 11, 200)]
    for packet in packets:
        attacker.send(packet)
    return len(packets)


@pytest.mark.promise("A stranger with a part's client key does not take its session")
async def test_57_logins_with_its_key_move_nothing_and_after_kill_9_the_part_is_back_from_another_address() -> None:
    dice = Random(57)
    async with robot() as it:
        process = it.start_part()
        await it.until(lambda: it.holder() is not None and it.samples() > 0)
        part = it.holder()
        assert part is not None
        it.states.clear()
        for number in range(KNOCKS):
            with socket(AF_INET, SOCK_DGRAM) as attacker:
                attacker.bind((f"127.0.0.{2 + number % 5}", 0))
                attacker.connect(("127.0.0.1", it.link.port))
                said, taken = it.samples(), it.link.counters.packets_in
                sent = knock(attacker, part, dice)
                await it.until(lambda: it.link.counters.packets_in >= taken + sent and it.samples() > said)  # noqa: B023
            now = it.holder()
            assert now is not None
            assert (now.key, now.address) == (part.key, part.address)
        assert it.states == []
        assert process.poll() is None
        process.send_signal(signal.SIGKILL)
        process.wait()
        said = it.samples()
        it.start_part()
        await it.until(lambda: (again := it.holder()) is not None and again.address != part.address)
        await it.until(lambda: it.samples() > said + 3)
        assert PartState.LOST in it.states
