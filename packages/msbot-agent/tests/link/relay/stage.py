"""A CAN bus with a button and a lamp, a relay, and a master on the far side of a cable that can be cut."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from random import Random

from msbot import CallError, Number
from msbot.config import Blueprint, PartType, RobotProfile, Slot
from msbot.master import Master
from msbot.part import HelloWorld, Part
from msbot.pnp import Configuration, MemoryStore, PartEvent, SlotBinding
from msbot.process.virtual_time import run_virtual
from msbot_agent.link import InprocHub, LossyLink
from msbot_agent.link.can import CanMasterLink, CanPartLink
from msbot_agent.link.can.sim import SimBus, SimBusDriver
from msbot_agent.link.relay import PartsRelay

TOPIC = SlotBinding("say", "topic", "HelloWorld", publishes=True)
HEARS = SlotBinding("hear", "topic", "HelloWorld", publishes=False)
SERVES = SlotBinding("halve", "half", "Number -> Number", publishes=True)
CALLS = SlotBinding("ask", "half", "Number -> Number", publishes=False)


@dataclass
class Stage:
    """What a test has in its hands."""

    master: Master
    cable: LossyLink
    relay: PartsRelay
    bus: CanMasterLink
    mouth: Part
    ear: Part
    said: list[str] = field(default_factory=list)
    """What the relay said to people."""
    events: list[PartEvent] = field(default_factory=list)
    heard: list[int] = field(default_factory=list)
    answers: list[object] = field(default_factory=list)
    """How the calls of `ask` have ended: a number, or a sentence."""
    end_relay: Callable[[], object] = lambda: None

    def cut(self) -> None:
        """Cut the cable between relay and master."""
        self.cable.disturbance.drop = 1.0

    def heal(self) -> None:
        """Mend it."""
        self.cable.disturbance.drop = 0.0

    def ask(self, value: float, timeout_s: float = 1.0) -> None:
        """Have the ear call the mouth's service."""

        def replied(reply: Number | None, error: str) -> None:
            self.answers.append(error if reply is None else reply.value)

        self.ear.call("ask", Number(value=value), timeout=timeout_s, on_reply=replied)

    def states(self) -> dict[str, str]:
        """Part number -> state, as the master has it."""
        now = asyncio.get_running_loop().time()
        return {info.part_number: info.state.value for info in self.master.inventory.view(now) if info.part_number}


def play(scene: Callable[[Stage], Awaitable[None]], *, drop: float = 0.0, services: bool = False) -> Stage:
    """Run a scene that begins when both parts are active; perhaps the mouth serves what the ear calls."""
    of_mouth, of_ear = ((SERVES,), (CALLS,)) if services else ((), ())

    async def main() -> Stage:
        slots = (Slot("mouth", "MOUTH"), Slot("ear", "EAR"))
        store = MemoryStore(
            types=(PartType("MOUTH", "Mouth"), PartType("EAR", "Ear")),
            slots=slots,
            configurations=(Configuration(1, "mouth", (TOPIC, *of_mouth)), Configuration(1, "ear", (HEARS, *of_ear))),
        )
        blueprint = Blueprint(RobotProfile("R", "1", "2", "3", "4"), slots)
        master = Master(blueprint, store, random=Random(3), epoch_ns=lambda: 0)
        far = InprocHub()
        master.add_link(far.server)
        driver = SimBusDriver(SimBus(500_000))
        controller = driver.attach("relay")
        buses: list[CanMasterLink] = []

        def open_parts(profile_hash: int) -> CanMasterLink:
            buses.append(CanMasterLink(controller, profile_hash=profile_hash, random=Random(4)))
            return buses[-1]

        said: list[str] = []
        cable = LossyLink(far.connect(), random=Random(5), drop=drop)
        relay = PartsRelay(open_parts, cable, name="pi", say=said.append)
        mouth, ear = Part("MOUTH", uid=b"a mouth.", random=Random(6)), Part("EAR", uid=b"the ear.", random=Random(7))
        stage = Stage(master, cable, relay, buses[0], mouth, ear, said)
        master.inventory.on_event(stage.events.append)

        @ear.on("hear", HelloWorld)
        def heard(message: HelloWorld) -> None:
            stage.heard.append(message.index)

        ear.calls("ask", Number, Number)

        @mouth.serves("halve", Number, Number)
        def halve(request: Number) -> Number:
            if request.value < 0:
                raise CallError("nothing below zero")
            return Number(value=request.value / 2)

        async with asyncio.TaskGroup() as tasks:
            running = [tasks.create_task(master.run())]
            relaying = tasks.create_task(relay.run())
            stage.end_relay = relaying.cancel
            running.append(relaying)
            for part in (mouth, ear):
                link = CanPartLink(driver.attach(part.part_number), uid=part.uid or b"", random=Random(8))
                running.append(tasks.create_task(part.run_async(link, epoch_ns=lambda: 0)))
            await asyncio.sleep(6 if drop else 3)
            stage.bus = buses[-1]
            await scene(stage)
            for task in running:
                task.cancel()
        return stage

    return run_virtual(main())
