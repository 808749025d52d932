"""What happens to each program of `programs/`: its robot, and the story around it. Examples have theirs as well."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, replace

from msbot import (
    CallError,
    Colour,
    Count,
    HelloWorld,
    Level,
    Message,
    Number,
    Switch,
    Text,
    Trigger,
    float32,
    int16,
    uint64,
)
from msbot.config import Options
from msbot.part.calls import ReplyStatus, encode_reply
from tests.homes.world import PARTNER_UID, SLOT, SPARE_SLOT, Part, Robot, World

KEY = bytes.fromhex("00112233445566778899aabbccddeeff")
JOINED_AT_S = 1.0
"""The program starts when the partner has been there for that long."""


class Mood(Message):
    """The partner's class for the program's own message."""

    level: int16
    name: str
    happy: bool
    count: uint64
    raw: bytes
    warmth: float32


class Light(Message):
    """The partner's class for that of an example."""

    lux: float32


class Dim(Message):
    """Another one."""

    percent: float32


GIVEN: dict[str, tuple[Message, ...]] = {
    "HelloWorld": tuple(HelloWorld(index=pin, message=f"Publisher A(1) turn-on {pin}") for pin in (2, 3)),
    "Level": (Level(percent=8.0), Level(percent=80.0)),
    "Dim": (Dim(percent=8.0), Dim(percent=80.0)),
}
"""What the partner says to an example, by the type of the port."""


@dataclass(frozen=True)
class Scene:
    """One program's robot and story; the story begins when the master is there."""

    robot: Robot
    story: Callable[[World], Awaitable[None]]


def hears(world: World, port: str, message_class: type[Message]) -> Callable[[Part], None]:
    """A partner that notes what comes."""

    def tell(part: Part) -> None:
        part.on(port, message_class)(lambda message: world.note(f"partner heard {message}"))

    return tell


async def begin(world: World, *partner: Callable[[Part], None]) -> Part:
    """Partner first, then the program, until it is active."""
    part = world.plug_partner(*partner)
    await asyncio.sleep(JOINED_AT_S)
    world.plug()
    await world.until_state("active")
    await asyncio.sleep(0.2)
    return part


async def publish(world: World) -> None:
    await begin(world, hears(world, "out", HelloWorld))
    await asyncio.sleep(1.0)


async def listen(world: World) -> None:
    partner = await begin(world)
    for index, text in enumerate(("hello", "", "Grüße")):
        partner.publish("in", HelloWorld(index=index, message=text))
        await asyncio.sleep(0.1)


async def blocks(world: World) -> None:
    """What the page Program makes of blocks (`tests.web.browser.test_blocks`): waits, loops, STOP and GO."""
    kinds = {"out": Count, "colour": Colour, "word": Text}
    partner = await begin(world, *(hears(world, port, kind) for port, kind in kinds.items()))
    partner.publish("in", HelloWorld(index=4, message="hello"))
    await asyncio.sleep(2.0)
    partner.publish("level", Level(percent=80.0))
    await asyncio.sleep(2.0)
    world.note("STOP")
    world.master.say_stop("ann")
    await asyncio.sleep(1.0)
    world.note("GO")
    world.master.say_go("ann")
    await asyncio.sleep(3.0)
    world.note(world.home.state())


async def messages(world: World) -> None:
    partner = await begin(world, hears(world, "mood", Mood))
    partner.publish("other", Mood(name="cheerful", level=3, warmth=0.25, happy=False, count=0, raw=b""))
    await asyncio.sleep(0.2)


async def refusals(world: World) -> None:
    await begin(world)


async def sealed(world: World) -> None:
    def with_key(part: Part) -> None:
        part.key = KEY

    partner = await begin(world, with_key, hears(world, "out", HelloWorld))
    for index in (3, 5):
        partner.publish("in", HelloWorld(index=index, message="signed"))
        await asyncio.sleep(0.2)
    world.note("STOP")
    world.master.say_stop("ann")
    await asyncio.sleep(0.5)
    world.note(world.confirmed())
    world.note("GO")
    world.master.say_go("ann")
    await asyncio.sleep(3.0)
    world.note(world.part_states())
    partner.publish("in", HelloWorld(index=7, message="signed"))
    await asyncio.sleep(0.2)


async def describes(world: World) -> None:
    world.plug()
    await asyncio.sleep(8.0)
    for line in world.said_of_itself().splitlines():
        world.note(line)
    world.adopt("VANE-1")
    await world.until_state("active")
    await asyncio.sleep(0.2)
    world.note(world.home.state())


async def calls(world: World) -> None:
    """Replies, refusals, and every way in which a call ends without either."""
    world.plug()
    await world.until_state("active")
    await asyncio.sleep(0.5)
    world.note("the partner comes, and has no function yet")
    partner = world.plug_partner()
    await asyncio.sleep(2.0)
    world.note("it has one")

    @partner.serves("name", Number, Text)
    def name(request: Number) -> Text:
        if request.value < 0:
            raise CallError("negative numbers have no name hére")
        return Text(text=f"it is {request.value:g}")

    await asyncio.sleep(3.0)
    world.note("STOP and GO")
    world.master.say_stop("ann")
    await asyncio.sleep(1.0)
    world.master.say_go("ann")
    await asyncio.sleep(1.0)
    world.note("replies come while STOP holds")
    clock = asyncio.get_running_loop().time
    began_at = clock()
    later: list[Callable[[bytes], None]] = []
    asked = asyncio.Event()

    def serve_later(_binding: object, _request: bytes, *, stopped: bool, reply: Callable[[bytes], None]) -> bool:
        later.append(reply)
        asked.set()
        return not stopped

    services = partner._runner._services
    serve, services.serve = services.serve, serve_later  # type: ignore[assignment]
    await asked.wait()
    world.master.say_stop("ann")
    await asyncio.sleep(0.5)
    for reply in later:
        reply(encode_reply(ReplyStatus.DONE, Text(text="late").encode()))
    await asyncio.sleep(0.5)
    services.serve = serve  # type: ignore[method-assign]
    world.master.say_go("ann")
    await asyncio.sleep(began_at + 4.0 - clock())
    world.note("frozen")
    world.hold("look at me")
    await asyncio.sleep(1.0)
    world.hold("")
    await asyncio.sleep(1.0)
    world.note("it does not reply any more")
    membership = partner._runner._membership
    assert membership is not None
    membership.client._on_request = lambda *_: None
    await asyncio.sleep(1.5)
    world.note("its wire is taken away")
    world.rewire("name", wired=False)
    await asyncio.sleep(1.0)
    world.rewire("name", wired=True)
    await asyncio.sleep(1.2)
    world.note("it is pulled out")
    await world.pull_partner()
    await asyncio.sleep(8.0)
    world.note("the master dies")
    await world.kill_master()
    await asyncio.sleep(20.0)


async def calls_then_ends(world: World) -> None:
    def mute(part: Part) -> None:
        part.serves("name", Number, Text)(lambda request: Text(text=f"it is {request.value:g}"))

    partner = world.plug_partner(mute)
    await asyncio.sleep(JOINED_AT_S)
    membership = partner._runner._membership
    assert membership is not None
    membership.client._on_request = lambda *_: None
    world.plug()
    await world.until_state("ended")
    world.note(world.home.state().partition(":")[0])


async def calls_sealed(world: World) -> None:
    def serve(part: Part) -> None:
        part.key = KEY
        part.serves("name", Number, Text)(lambda request: Text(text=f"it is {request.value:g}"))

    await begin(world, serve)
    await asyncio.sleep(1.0)


async def serves(world: World) -> None:
    partner = world.plug_partner(lambda part: part.calls("double", Number, Text))
    await asyncio.sleep(JOINED_AT_S)
    world.plug()
    await world.until_state("active")
    await asyncio.sleep(0.5)

    async def ask(*values: float) -> None:
        for value in values:
            partner.call(
                "double", Number(value=value), on_reply=lambda reply, error: world.note(f"partner: {error or reply}")
            )
            await asyncio.sleep(0.5)

    await ask(2.0, -1.0, 0.0, 1000.0, 1e9)
    await ask(*range(5))
    world.note("STOP")
    world.master.say_stop("ann")
    await asyncio.sleep(1.0)
    await ask(4.0)
    world.master.say_go("ann")
    await asyncio.sleep(1.0)
    world.note("GO")
    await ask(5.0)
    world.home.pull()
    await asyncio.sleep(8.0)
    await ask(6.0)


async def describes_services(world: World) -> None:
    types = {"Angle": [("degrees", "float32")], "Number": [("value", "float32")], "Picture": [("width", "uint16")]}
    world.master.inventory.types.library_fields = types.get
    world.plug()
    await asyncio.sleep(8.0)
    for line in world.said_of_itself().splitlines():
        world.note(line)
    world.adopt("CAM-1")
    await world.until_state("active")
    await asyncio.sleep(3.0)
    for line in world.master.troubles("eye"):
        world.note(line)


LIBRARY = {
    "Raw": [("value", "float32")],
    "Pair": [("x", "float32"), ("z", "float32")],
    "Level": [("percent", "float32")],
    "Count": [("value", "int32")],
}
"""The robot's message types, as `other_types` finds them."""


async def other_types(world: World) -> None:
    world.master.inventory.types.library_fields = LIBRARY.get
    said: list[str] = []
    world.master.inventory.on_event(lambda event: said.append(event.reason))
    world.plug()
    await world.until_state("active")
    await asyncio.sleep(3.0)
    for line in world.master.troubles("roof"):
        world.note(line)
    world.note(f"lines in the journal: {sum('is not that of' in one for one in said)}")
    world.note("the library learns, and the configuration changes")
    world.master.inventory.types.library_fields = {**LIBRARY, "Raw": [("value", "uint16")]}.get
    world.configure((("gain", "1"),))
    await asyncio.sleep(2.0)
    world.note(f"still told: {len(world.master.troubles('roof'))}")


async def settings(world: World) -> None:
    await begin(world, hears(world, "out", Count))
    await asyncio.sleep(0.7)
    before = dict(world.robot.settings)
    for change in ({"gain": "3"}, {"step": "8", "period_s": "0.25"}, {"gain": "much"}, {"gain": "4", "on": "true"}):
        before.update(change)
        world.note(f"set {change}")
        world.configure(tuple(before.items()))
        await asyncio.sleep(0.6)
    del before["gain"]
    world.note("gain is gone")
    world.configure(tuple(before.items()))
    await asyncio.sleep(0.3)


async def moved(world: World) -> None:
    await begin(world)
    for here, there in ((SLOT, SPARE_SLOT), (SPARE_SLOT, SLOT)):
        world.note(f"from slot {here} to slot {there}")
        world.move(here, there)
        await asyncio.sleep(5.0)
        world.note(world.part_states())


async def safe_values(world: World) -> None:
    partner = await begin(world)
    partner.publish("power", Level(percent=50.0))
    await asyncio.sleep(0.2)
    world.note("the master dies")
    await world.kill_master()
    await asyncio.sleep(20.0)
    world.note("a new master")
    world.new_master()
    await world.until_state("active")
    await asyncio.sleep(0.2)


async def partner_lost(world: World) -> None:
    partner = await begin(world)
    partner.publish("power", Level(percent=50.0))
    await asyncio.sleep(0.2)
    world.note("the partner is pulled out")
    await world.pull_partner()
    await asyncio.sleep(8.0)
    world.note("it is back")
    partner = world.plug_partner()
    await asyncio.sleep(2.0)
    partner.publish("power", Level(percent=20.0))
    await asyncio.sleep(0.2)


async def stop_go(world: World) -> None:
    partner = await begin(world)
    partner.publish("power", Level(percent=50.0))
    await asyncio.sleep(0.2)
    for percent in (60.0, 70.0):
        world.note("STOP")
        world.master.say_stop("ann")
        await asyncio.sleep(0.5)
        world.note(world.confirmed())
        partner.publish("power", Level(percent=percent))
        await asyncio.sleep(1.5)
        world.note("GO")
        world.master.say_go("ann")
        await asyncio.sleep(0.2)
        partner.publish("power", Level(percent=percent))
        await asyncio.sleep(0.2)
    world.identify()
    await asyncio.sleep(0.2)


async def stopped_join(world: World) -> None:
    partner = world.plug_partner()
    await asyncio.sleep(JOINED_AT_S)
    world.note("STOP")
    world.master.say_stop("ann")
    await asyncio.sleep(0.2)
    world.plug()
    await world.until_state("active")
    await asyncio.sleep(0.5)
    world.note(world.confirmed())
    partner.publish("power", Level(percent=50.0))
    await asyncio.sleep(0.5)
    world.note("GO")
    world.master.say_go("ann")
    await asyncio.sleep(0.2)


async def unheard_go(world: World) -> None:
    """On a bus everybody hears STOP; GO is told to the parts of the robot alone, and this one is not among them yet."""
    partner = world.plug_partner()
    await asyncio.sleep(JOINED_AT_S)
    world.plug()
    await world.until_state("recognising", "active", look_s=0.0001)  # the latter where it takes no time
    world.note("STOP")
    world.master.say_stop("ann")
    world.note("GO")
    world.master.say_go("ann")
    await world.until_state("active")
    await asyncio.sleep(0.5)
    partner.publish("power", Level(percent=50.0))
    await asyncio.sleep(0.2)


async def unsafe(world: World) -> None:
    await begin(world)
    world.note("STOP")
    world.master.say_stop("ann")
    await asyncio.sleep(3.0)
    world.note(world.confirmed())
    world.note("the motor is mended")
    world.configure((("power.safe.percent", "0"), ("broken", "false")))
    await asyncio.sleep(3.0)
    world.note(world.confirmed())


async def timers(world: World) -> None:
    await begin(world, hears(world, "out", Trigger))
    await asyncio.sleep(5.0)
    world.note(world.home.state())
    world.note(world.part_states())


async def delays(world: World) -> None:
    await begin(world)
    await asyncio.sleep(2.0)
    world.note("the master dies")
    await world.kill_master()
    await asyncio.sleep(30.0)
    world.note("a new master")
    world.new_master()
    await world.until_state("active")
    await asyncio.sleep(2.0)


async def logs(world: World) -> None:
    world.master.inventory.log.on_line(lambda line: world.note(f"the robot's log, {line.level.word}: {line.words}"))
    await begin(world)
    await asyncio.sleep(6.0)


async def ranges(world: World) -> None:
    world.master.inventory.log.on_line(lambda line: world.note(f"the robot's log, {line.level.word}: {line.words}"))
    await begin(world, hears(world, "out", Number))
    await asyncio.sleep(1.0)


async def waits(world: World) -> None:
    partner = await begin(world, hears(world, "out", Count))
    for index in (1, 2):  # the second comes while the function waits
        partner.publish("in", HelloWorld(index=index, message=""))
        await asyncio.sleep(0.1)
    await asyncio.sleep(2.0)
    partner.publish("in", HelloWorld(index=3, message=""))
    partner.publish("power", Level(percent=50.0))
    await asyncio.sleep(0.1)
    world.note("STOP")
    world.master.say_stop("ann")
    await asyncio.sleep(2.0)
    world.note("GO")
    world.master.say_go("ann")
    await asyncio.sleep(1.0)
    world.note("silence")
    await world.kill_master()
    await asyncio.sleep(10.0)


async def errors(world: World) -> None:
    partner = await begin(world)
    for index in range(5):
        partner.publish("in", HelloWorld(index=index, message=""))
        await asyncio.sleep(0.1)
    await asyncio.sleep(1.0)


async def mistake(world: World) -> None:
    world.plug()
    await asyncio.sleep(3.0)
    world.note(world.home.state())


async def lost_and_back(world: World) -> None:
    await begin(world)
    for story in ("the master dies", "it dies again"):
        world.note(story)
        await world.kill_master()
        await asyncio.sleep(30.0)
        world.note("a new master")
        world.new_master()
        await world.until_state("active")
        await asyncio.sleep(2.5)


async def wrong_robot(world: World) -> None:
    world.plug()
    await asyncio.sleep(10.0)
    world.note(world.home.state())
    world.note(world.part_states())


async def refused(world: World) -> None:
    world.plug()
    await asyncio.sleep(10.0)
    world.note(world.home.state().partition(": give it its key")[0])  # how to is said differently in each home


async def key(world: World) -> None:
    world.plug()
    await world.until_state("active")
    await asyncio.sleep(5.0)
    world.note(world.home.state())


async def gpio(world: World) -> None:
    partner = await begin(world)
    partner.publish("in", HelloWorld(index=0, message=""))
    await asyncio.sleep(0.2)
    world.master.say_stop("ann")
    await asyncio.sleep(0.2)


async def large(world: World) -> None:
    def measure(part: Part) -> None:
        part.on("out", Text)(lambda message: world.note(f"partner heard {len(message.text)}"))

    partner = await begin(world, measure)
    partner.publish("in", Text(text="ab" * 1000))
    await asyncio.sleep(2.0)


async def example(world: World) -> None:
    """Any example: the partner says what its ports take, and notes what they give."""

    def tell(part: Part) -> None:
        for port, way, kind in world.robot.bindings:
            if way == "out":
                hears(world, port, {"HelloWorld": HelloWorld, "Light": Light, "Switch": Switch}[kind])(part)

    partner = await begin(world, tell)
    for port, way, kind in world.robot.bindings:
        if way == "in":
            for message in GIVEN[kind]:
                partner.publish(port, message)
                await asyncio.sleep(0.1)
    world.note("the master dies")
    await world.kill_master()
    await asyncio.sleep(20.0)
    world.note(world.home.state().partition(":")[0])


def wired(*ports: str, settings: tuple[tuple[str, str], ...] = ()) -> Robot:
    """A robot whose slot has these ports, `name way type`."""
    return Robot(
        bindings=tuple((name, way, kind) for name, way, kind in (port.split(" ", 2) for port in ports)),
        settings=settings,
    )


KEYED = Robot(options=Options(authentication="key", explain=True), keys=((bytes(range(8)), KEY),))
SEALED = replace(
    wired("in in HelloWorld", "out out HelloWorld"),
    options=Options(authentication="key+data", explain=True),
    keys=((bytes(range(8)), KEY), (PARTNER_UID, KEY)),
)
SAFE = wired("power in Level", settings=(("power.safe.percent", "0"),))

RING = replace(wired("out out HelloWorld", "in in HelloWorld"), name="MSBOT_MASTER")
EXAMPLES = {
    "00_blink": replace(wired("light out Switch", settings=(("period_s", "0.5"),)), number="BLINK-1"),
    "01_hello": replace(RING, number="ABCD"),
    "02_listen": replace(RING, number="EFGH"),
    "03_ring_member": replace(RING, number="WXYZ"),
    "04_gpio_board": replace(RING, number="EFGH"),
    "05_own_part": replace(wired("light out Light", settings=(("gain", "2"),)), number="LUX-1"),
    "06_fan": replace(
        wired("power in Level", settings=(("power.safe.percent", "0"), ("start_at", "15"))), number="FAN-5V"
    ),
    "07_lamp": replace(wired("dim in Dim", settings=(("dim.safe.percent", "0"), ("most", "50"))), number="LAMP-1"),
}
"""The robot for each of the examples that a student begins with."""

SCENES = {name: Scene(robot, example) for name, robot in EXAMPLES.items()} | {
    "errors": Scene(wired("in in HelloWorld"), errors),
    "gpio": Scene(wired("in in HelloWorld"), gpio),
    "blocks": Scene(
        wired(
            "out out Count",
            "colour out Colour",
            "word out Text",
            "in in HelloWorld",
            "level in Level",
            settings=(("gain", "2.5"),),
        ),
        blocks,
    ),
    "calls": Scene(wired("name call Number -> Text"), calls),
    "calls_then_ends": Scene(wired("name call Number -> Text"), calls_then_ends),
    "calls_sealed": Scene(replace(SEALED, bindings=(("name", "call", "Number -> Text"),)), calls_sealed),
    "delays": Scene(Robot(), delays),
    "logs": Scene(Robot(), logs),
    "serves": Scene(
        wired("double serve Number -> Text", "mistaken serve Number -> Text", "shut serve Number -> Text"), serves
    ),
    "describes": Scene(
        wired("wind out Wind", "brake in Level", settings=(("gain", "5"), ("brake.safe.percent", "100"))), describes
    ),
    "describes_sealed": Scene(
        replace(
            wired("light out Light"),
            options=Options(authentication="key+data", explain=False),
            keys=((bytes(range(8)), KEY),),
        ),
        describes,
    ),
    "describes_services": Scene(wired("photo serve Angle -> Picture", "look call Angle -> Number"), describes_services),
    "other_types": Scene(wired("out out Raw", "in in Pair", "level in Level", "count out Count"), other_types),
    "key": Scene(KEYED, key),
    "large": Scene(wired("in in Text", "out out Text"), large),
    "listen": Scene(wired("in in HelloWorld"), listen),
    "lost_and_back": Scene(wired("out out Count"), lost_and_back),
    "messages": Scene(wired("mood out Mood", "other in Mood"), messages),
    "mistake": Scene(wired("out out HelloWorld"), mistake),
    "moved": Scene(Robot(settings=(("gain", "1"),), spare_settings=(("gain", "2"),)), moved),
    "no_key": Scene(KEYED, refused),
    "partner_lost": Scene(SAFE, partner_lost),
    "publish": Scene(wired("out out HelloWorld"), publish),
    "ranges": Scene(
        wired(
            "out out Number",
            "scan out Scan",
            settings=(("out.range.value", "0 10"), ("scan.range.metres", "0 4"), ("out.range.x", "0 to 1")),
        ),
        ranges,
    ),
    "refusals": Scene(wired("out out HelloWorld", settings=(("name", "Ada"),)), refusals),
    "safe_values": Scene(SAFE, safe_values),
    "sealed": Scene(SEALED, sealed),
    "sealed_no_key": Scene(SEALED, refused),
    "settings": Scene(
        wired("out out Count", settings=(("gain", "1.5"), ("on", "false"), ("label", "left"), ("period_s", "0.5"))),
        settings,
    ),
    "stop_go": Scene(SAFE, stop_go),
    "stopped_join": Scene(SAFE, stopped_join),
    "stranger": Scene(Robot(options=Options(explain=True)), refused),
    "timers": Scene(wired("out out Trigger"), timers),
    "unheard_go": Scene(wired("power in Level"), unheard_go),
    "unsafe": Scene(replace(SAFE, settings=(*SAFE.settings, ("broken", "true"))), unsafe),
    "waits": Scene(
        wired("out out Count", "in in HelloWorld", "power in Level", settings=(("power.safe.percent", "0"),)), waits
    ),
    "wrong_key": Scene(KEYED, refused),
    "wrong_robot": Scene(Robot(), wrong_robot),
}
