"""A robot whose parts come in by two agents with a bus each, beside one at the master itself; cables can be cut."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from random import Random

from msbot.config import Blueprint, Options, PartType, RobotProfile, Slot
from msbot.master import Master
from msbot.master.remote_agent import RemoteAgent
from msbot.part import HelloWorld, Part
from msbot.part.messages.standard import Number
from msbot.pnp import Configuration, MemoryStore, PartEvent, SlotBinding
from msbot.process.virtual_time import run_virtual
from msbot_agent.link import InprocHub, Link, LinkInfo, LossyLink
from msbot_agent.link.can import CanMasterLink, CanPartLink
from msbot_agent.link.can.sim import SimBus, SimBusDriver

SAYS = SlotBinding("say", "topic", "HelloWorld", publishes=True)
HEARS = SlotBinding("hear", "topic", "HelloWorld", publishes=False)
ASKS = SlotBinding("ask", "double", "Number -> Number", publishes=False)
ASKS_FAR = SlotBinding("ask_far", "treble", "Number -> Number", publishes=False)
SERVES = SlotBinding("double", "double", "Number -> Number", publishes=True)
SERVES_FAR = SlotBinding("treble", "treble", "Number -> Number", publishes=True)


@dataclass
class FarAgent:
    """An agent, its bus, and its cable to the master."""

    agent: RemoteAgent
    cable: LossyLink
    bus: SimBusDriver
    desk: InprocHub
    """Where its parts are without a bus."""
    said: list[str]
    end: Callable[[], object] = lambda: None

    def cut(self) -> None:
        """Cut its cable."""
        self.cable.disturbance.drop = 1.0

    def heal(self) -> None:
        """Mend it."""
        self.cable.disturbance.drop = 0.0


@dataclass
class Stage:
    """What a test has in its hands."""

    master: Master
    left: FarAgent
    right: FarAgent
    parts: dict[str, Part]
    heard: dict[str, list[int]] = field(default_factory=dict)
    events: list[PartEvent] = field(default_factory=list)
    served: list[float] = field(default_factory=list)
    """What parts were asked."""
    start: Callable[[str, FarAgent], object] = lambda *_: None
    """Plug one more part in at an agent."""

    def states(self) -> dict[str, str]:
        """Part number -> state, as the master has it."""
        now = asyncio.get_running_loop().time()
        return {info.part_number: info.state.value for info in self.master.inventory.view(now) if info.part_number}

    async def ask(self, number: str, port: str, value: float, seconds: float = 2.0) -> object:
        """What a part gets for a call: a number, or a sentence."""
        found: asyncio.Future[object] = asyncio.get_running_loop().create_future()

        def done(reply: Number | None, error: str) -> None:
            found.set_result(error if reply is None else reply.value)

        self.parts[number].call(port, Number(value=value), timeout=seconds, on_reply=done)
        return await found

    def speak(self, number: int) -> None:
        """The mouth says a number."""
        self.parts["MOUTH"].publish("say", HelloWorld(index=number, message="hi"))


def declare_services(part: Part, stage: Stage) -> None:
    """What each part asks and serves."""

    def times(factor: float) -> Callable[[Number], Number]:
        def serve(request: Number) -> Number:
            stage.served.append(request.value)
            return Number(value=factor * request.value)

        return serve

    match part.part_number:
        case "MOUTH":
            part.calls("ask", Number, Number)
            part.calls("ask_far", Number, Number)
        case "NEAR":
            part.serves("double", Number, Number)(times(2.0))
        case "FAR":
            part.serves("treble", Number, Number)(times(3.0))
            part.calls("ask", Number, Number)


def play(
    scene: Callable[[Stage], Awaitable[None]],
    *,
    drop: float = 0.0,
    authentication: str = "open",
    settle_s: float = 4.0,
    can: bool = False,
) -> Stage:
    """Run a scene: the mouth and one ear are at the left agent, another ear at the right one, on quick links or CAN."""

    async def main() -> Stage:
        slots = (Slot("mouth", "MOUTH"), Slot("near", "NEAR"), Slot("far", "FAR"))
        store = MemoryStore(
            types=tuple(PartType(slot.part_number, slot.name) for slot in slots),
            slots=slots,
            configurations=(
                Configuration(1, "mouth", (SAYS, ASKS, ASKS_FAR)),
                Configuration(1, "near", (HEARS, SERVES)),
                Configuration(1, "far", (HEARS, SERVES_FAR, ASKS)),
            ),
        )
        options = Options(authentication=authentication)
        blueprint = Blueprint(RobotProfile("R", "1", "2", "3", "4"), slots, options=options)
        master = Master(blueprint, store, random=Random(3), epoch_ns=lambda: 0)
        hub = InprocHub()
        hub.server.info = LinkInfo("cable", 1400)
        master.add_link(hub.server)
        tasks: list[asyncio.Task[None]] = []
        running = asyncio.create_task(master.run())
        tasks.append(running)

        def far_agent(name: str, seed: int) -> FarAgent:
            driver = SimBusDriver(SimBus(500_000))
            controller = driver.attach(name)
            parts = InprocHub()
            parts.server.info = LinkInfo("desk", 1400)
            said: list[str] = []
            cable = LossyLink(hub.connect(), random=Random(seed), drop=drop)

            def open_parts(profile_hash: int) -> Link:
                if not can:
                    return parts.server
                return CanMasterLink(controller, profile_hash=profile_hash, random=Random(seed + 1))

            made = FarAgent(RemoteAgent(open_parts, cable, name=name, say=said.append), cable, driver, parts, said)
            serving = asyncio.create_task(made.agent.run())
            made.end = serving.cancel
            tasks.append(serving)
            return made

        stage = Stage(master, far_agent("left", 10), far_agent("right", 20), {})
        master.inventory.on_event(stage.events.append)

        def start(number: str, at: FarAgent) -> None:
            part = Part(number, uid=number.encode().rjust(8, b"."), random=Random(len(tasks)))
            stage.parts[number] = part
            heard = stage.heard.setdefault(number, [])
            if number != "MOUTH":
                part.on("hear", HelloWorld)(lambda message: heard.append(message.index))
            declare_services(part, stage)
            link: Link = at.desk.connect()
            if can:
                link = CanPartLink(at.bus.attach(number), uid=part.uid or b"", random=Random(8))
            tasks.append(asyncio.create_task(part.run_async(link, epoch_ns=lambda: 0)))

        stage.start = start
        start("MOUTH", stage.left)
        start("NEAR", stage.left)
        start("FAR", stage.right)
        await asyncio.sleep(settle_s)
        try:
            await scene(stage)
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
        return stage

    return run_virtual(main())
