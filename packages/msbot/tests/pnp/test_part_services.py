"""Requests and replies between the parts of a robot, in virtual time: what is served, and how each call ends."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import replace
from random import Random

import pytest

from msbot import CallError, HelloWorld, Message, Number, Part, Text
from msbot.config import Slot
from msbot.part.calls import MOST_OPEN_CALLS, MOST_SERVED, ReplyStatus, encode_reply
from msbot.part.join.pnp_messages import PortBinding
from msbot.pnp import Configuration, Freeze, Keys, MemoryStore, SlotBinding
from msbot.pnp.type_agreement import difference_sentence
from msbot.process.virtual_time import run_virtual
from msbot_agent.link import InprocEnd
from tests.pnp.robot import ABCD, EFGH, WXYZ, uid
from tests.pnp.scene import Robot, epoch_ns
from tests.pnp.test_sealed_robot import KEY, Spy

HALVE = "Number -> Number"
NAMES = "Number -> Text"


def slot(name: str, *bindings: SlotBinding) -> Configuration:
    return Configuration(1, name, bindings)


def store(*of: Configuration, keys: int = 0) -> MemoryStore:
    numbers = {"AA": "ABCD", "BB": "EFGH", "CC": "WXYZ"}
    slots = tuple(Slot(one.slot, numbers[one.slot]) for one in of)
    found = MemoryStore(types=(ABCD, EFGH, WXYZ), slots=slots, configurations=of)
    found.keys = {uid(number): KEY for number in range(1, keys + 1)}
    return found


def usual(keys: int = 0) -> MemoryStore:
    """AA asks, BB halves numbers and names them; CC has another topic."""
    return store(
        slot(
            "AA",
            SlotBinding("ask", "half", HALVE, publishes=False),
            SlotBinding("name", "name", NAMES, publishes=False),
        ),
        slot(
            "BB",
            SlotBinding("halve", "half", HALVE, publishes=True),
            SlotBinding("says", "name", NAMES, publishes=True),
            SlotBinding("wait", "nobody", HALVE, publishes=False),
        ),
        slot("CC", SlotBinding("ask", "half", HALVE, publishes=False)),
        keys=keys,
    )


class Scene:
    """A robot, and parts that come in when the story wants them."""

    def __init__(self, parts: MemoryStore, *, sealed: bool) -> None:
        keys = Keys(parts, Random(3), sealed=True) if sealed else None
        self.parts = parts
        self.robot = Robot(parts, explain=True, keys=keys)
        self.sealed = sealed
        self.aa, self.bb, self.cc = (self.make(number) for number in ("ABCD", "EFGH", "WXYZ"))
        self.log: list[object] = []
        self.running: dict[Part, asyncio.Task[None]] = {}
        self.links: dict[Part, InprocEnd] = {}
        self._declare(self.aa)

    def make(self, number: str) -> Part:
        serial = {"ABCD": 1, "EFGH": 2, "WXYZ": 3}[number]
        key = KEY if self.sealed else None
        return Part(number, uid=uid(serial), random=Random(serial), key=key)

    def _declare(self, part: Part) -> None:
        part.calls("ask", Number, Number)
        part.calls("name", Number, Text)

    async def plug(self, *parts: Part, through: Callable[[InprocEnd], InprocEnd] = lambda link: link) -> None:
        for part in parts:
            self.links[part] = link = through(self.robot.outside.connect())
            self.running[part] = asyncio.get_running_loop().create_task(part.run_async(link, epoch_ns=epoch_ns))
        for _ in range(6):  # whoever comes when the robot's profile has just been said waits for the next one
            await asyncio.sleep(2.0)
            if all(part.state.value == "active" for part in parts):
                break
        assert [part.state.value for part in parts] == ["active"] * len(parts)

    def pull(self, part: Part) -> None:
        """It vanishes without a word."""
        self.running.pop(part).cancel()

    def set(self, configuration: Configuration, version: int) -> None:
        """A person has changed the wires of a slot."""
        self.parts.configurations[configuration.slot] = replace(configuration, version=version)
        self.robot.inventory.configuration_changed(configuration.slot)

    def asks(self, port: str, request: Number, timeout: float = 1.0) -> None:
        """AA asks once, from now on."""

        @self.aa.every(1000.0)
        def ask() -> None:
            try:
                self.log.append(self.aa.call(port, request, timeout=timeout))
            except CallError as error:
                self.log.append(str(error))


def tell(story: Callable[[Scene], Awaitable[None]], parts: MemoryStore | None = None, *, sealed: bool = False) -> None:
    async def main() -> None:
        scene = Scene(parts or usual(keys=3 if sealed else 0), sealed=sealed)
        async with asyncio.TaskGroup() as tasks:
            robot = scene.robot
            running = [tasks.create_task(run()) for run in (robot.agent.run, robot.service.run, robot.master.run)]
            await robot.service.until_ready()
            await story(scene)
            for task in [*running, *scene.running.values()]:
                task.cancel()
            await asyncio.gather(*scene.running.values(), return_exceptions=True)

    run_virtual(main())


def halve_with(part: Part) -> None:
    @part.serves("halve", Number, Number)
    def half(request: Number) -> Number:
        return Number(value=request.value / 2)


def halve(scene: Scene) -> None:
    halve_with(scene.bb)

    @scene.bb.serves("says", Number, Text)
    def says(request: Number) -> Text:
        if request.value < 0:
            raise CallError("negative numbers have no name here")
        return Text(text=f"it is {request.value:g}")


@pytest.mark.promise("A call ends with its reply, or with one sentence, never without an end")
@pytest.mark.parametrize("sealed", [False, True])
def test_a_function_waits_for_its_reply_and_the_part_goes_on_meanwhile(sealed: bool) -> None:
    async def story(scene: Scene) -> None:
        halve(scene)
        beats: list[float] = []
        scene.aa.every(0.1)(lambda: beats.append(asyncio.get_running_loop().time()))
        scene.asks("ask", Number(value=9.0))
        await scene.plug(scene.bb, scene.aa)
        assert scene.log == [Number(value=4.5)]
        assert scene.aa.counters.refused == scene.bb.counters.refused == 0
        assert len(beats) > 10
        assert scene.aa.busy_with is None

    tell(story, sealed=sealed)


@pytest.mark.parametrize("sealed", [False, True])
def test_the_callback_form_waits_for_nothing(sealed: bool) -> None:
    async def story(scene: Scene) -> None:
        halve(scene)

        @scene.aa.every(1000.0)
        def ask() -> None:
            for value in (3.0, -1.0):
                scene.aa.call(
                    "name", Number(value=value), on_reply=lambda reply, error: scene.log.append((reply, error))
                )
            scene.log.append("asked")

        await scene.plug(scene.bb, scene.aa)
        assert scene.log == [
            "asked",
            (Text(text="it is 3"), ""),
            (None, "call of name: refused: negative numbers have no name here"),
        ]

    tell(story, sealed=sealed)


def test_nobody_serves() -> None:
    """Who asks learns at once where nobody is, and when its function was not there in time."""

    async def story(scene: Scene) -> None:
        scene.bb.calls("wait", Number, Number)

        @scene.bb.every(1000.0)
        def ask() -> None:
            try:
                scene.bb.call("wait", Number(value=1.0), timeout=500.0)
            except CallError as error:
                scene.log.append(str(error))

        scene.asks("ask", Number(value=1.0), timeout=500.0)
        await scene.plug(scene.aa)
        assert scene.log == ["call of ask: the robot does not pass it on: slot BB is empty"]
        await scene.plug(scene.bb)
        assert scene.log[1:] == ["call of wait: the robot does not pass it on: no slot serves nobody any more"]

    tell(story)


def test_a_part_that_never_replies() -> None:
    async def story(scene: Scene) -> None:
        scene.asks("ask", Number(value=1.0), timeout=0.5)
        await plug_mute(scene)
        assert len(scene.log) == 1
        assert str(scene.log[0]).startswith("call of ask: no reply within 0.5 s: is the part there that serves it")

    tell(story)


async def plug_mute(scene: Scene) -> None:
    """BB comes in, and does not reply; then AA does, and asks."""
    halve(scene)
    await scene.plug(scene.bb)
    membership = scene.bb._runner._membership
    assert membership is not None
    membership.client._on_request = lambda *_: None
    await scene.plug(scene.aa)


def test_the_part_that_serves_ends_while_a_call_is_open() -> None:
    async def story(scene: Scene) -> None:
        scene.asks("ask", Number(value=1.0), timeout=600.0)
        await plug_mute(scene)
        assert scene.log == []
        scene.bb.end()
        await asyncio.sleep(1.0)
        assert scene.log == [
            "call of ask: the part that served it has left, or is held: `msbot parts` shows who is there"
        ]

    tell(story)


def test_the_part_that_serves_vanishes_and_another_takes_its_slot() -> None:
    async def story(scene: Scene) -> None:
        scene.asks("ask", Number(value=8.0), timeout=600.0)
        await plug_mute(scene)
        scene.pull(scene.bb)
        await asyncio.sleep(10.0)
        assert scene.log == [
            "call of ask: the part that served it has left, or is held: `msbot parts` shows who is there"
        ]
        other = Part("EFGH", uid=uid(9), random=Random(9))
        other.serves("halve", Number, Number)(lambda request: Number(value=request.value / 2))
        await scene.plug(other)
        scene.aa.call("ask", Number(value=8.0), on_reply=lambda reply, _: scene.log.append(reply))
        await asyncio.sleep(0.5)
        assert scene.log[1:] == [Number(value=4.0)]

    tell(story)


def test_the_program_that_serves_starts_anew_while_a_call_is_open() -> None:
    async def story(scene: Scene) -> None:
        scene.asks("ask", Number(value=8.0), timeout=20.0)
        await plug_mute(scene)
        scene.pull(scene.bb)
        again = scene.make("EFGH")
        halve_with(again)
        await scene.plug(again)
        await asyncio.sleep(20.0)
        assert len(scene.log) == 1
        assert str(scene.log[0]).startswith(("call of ask: the part that served", "call of ask: no reply within 20 s"))
        scene.aa.call("ask", Number(value=8.0), on_reply=lambda reply, _: scene.log.append(reply))
        await asyncio.sleep(0.5)
        assert scene.log[1:] == [Number(value=4.0)]

    tell(story)


def serve_later(scene: Scene) -> list[Callable[[], None]]:
    """BB takes requests, and replies when the test says so."""
    later: list[Callable[[], None]] = []
    halve(scene)

    def serve(binding: PortBinding, _request: bytes, *, stopped: bool, reply: Callable[[bytes], None]) -> bool:
        message = Number(value=4.5) if binding.port == "halve" else Text(text="it is 9")
        later.append(lambda: reply(encode_reply(ReplyStatus.DONE, message.encode())))
        return not stopped

    scene.bb._runner._services.serve = serve  # type: ignore[assignment]
    return later


@pytest.mark.promise("No reply moves a part while STOP holds")
@pytest.mark.parametrize("end", ["reply", "timeout", "lost partner", "part ended"])
def test_a_function_that_waits_for_a_reply_when_stop_is_said_stands_still_until_go(end: str) -> None:
    async def story(scene: Scene) -> None:
        later = serve_later(scene)
        scene.asks("ask", Number(value=9.0), timeout=5.0 if end == "timeout" else 60.0)
        await scene.plug(scene.bb, scene.aa)
        scene.robot.service.stop_all("ann", "", 0)
        await asyncio.sleep(0.5)
        assert scene.aa.stopped
        if end == "reply":
            later[0]()
        elif end == "lost partner":
            scene.bb.end()
        await asyncio.sleep(8.0)
        assert scene.log == []
        if end == "part ended":
            scene.aa.safe_state(lambda: scene.log.append("safe"))
            scene.aa.end()
        else:
            scene.robot.service.go_all("ann")
        await asyncio.sleep(0.5)
        why = (
            "the part is ended, not active any more (ended)"
            if end == "part ended"
            else "STOP was said meanwhile: call again"
        )
        assert scene.log[:1] == [f"call of ask: {why}"]
        assert scene.log[1:] == (["safe"] if end == "part ended" else []), "the safe state has the last word"
        assert scene.aa.counters.handler_errors == 0

    tell(story)


def test_a_reply_that_comes_while_stop_holds_reaches_no_function() -> None:
    async def story(scene: Scene) -> None:
        later = serve_later(scene)

        def told(reply: Text | None, error: str) -> None:
            scene.log.append((reply, error))

        scene.aa.every(1000.0)(lambda: scene.aa.call("name", Number(value=9.0), timeout=60.0, on_reply=told))

        @scene.aa.on_stop
        def stopped() -> None:
            scene.aa.call("name", Number(value=1.0), timeout=60.0, on_reply=told)

        await scene.plug(scene.bb, scene.aa)
        scene.robot.service.stop_all("ann", "", 0)
        await asyncio.sleep(0.5)
        for reply in later:
            reply()
        await asyncio.sleep(0.5)
        assert scene.log == [(None, "call of name: STOP is in force: call again after GO")] * 2
        scene.robot.service.go_all("ann")
        await asyncio.sleep(0.5)
        assert len(scene.log) == 2

    tell(story)


def test_while_stop_holds_no_function_serves() -> None:
    async def story(scene: Scene) -> None:
        halve(scene)
        await scene.plug(scene.bb)
        scene.robot.service.stop_all("ann", "", 0)
        await asyncio.sleep(1.5)
        scene.asks("ask", Number(value=1.0))
        await scene.plug(scene.aa)
        assert scene.log == ["call of ask: STOP is in force: call again after GO"]
        assert scene.bb.counters.held == 1

    tell(story)


def test_what_a_serving_function_does_wrong_the_caller_learns_and_the_part_goes_on() -> None:
    async def story(scene: Scene) -> None:
        answers = iter((1 // 1, "text"))

        @scene.bb.serves("halve", Number, Number)
        def half(request: Number) -> Number:
            return next(answers)  # type: ignore[return-value]  # that is the mistake

        @scene.aa.every(0.2)
        def ask() -> None:
            if len(scene.log) < 4:
                try:
                    scene.log.append(scene.aa.call("ask", Number(value=1.0)))
                except CallError as error:
                    scene.log.append(str(error))

        await scene.plug(scene.bb, scene.aa)
        assert scene.log[:2] == [
            "call of ask: the function that serves it failed: it returned 1, not a Number",
            "call of ask: the function that serves it failed: it returned 'text', not a Number",
        ]
        assert str(scene.log[2]).startswith("call of ask: the function that serves it failed: ")
        assert scene.bb.state.value == "active"

    tell(story)


def test_a_reply_or_request_that_no_agent_takes_is_told_where_it_was_made() -> None:
    async def story(scene: Scene) -> None:
        @scene.bb.serves("says", Number, Text)
        def says(request: Number) -> Text:
            return Text(text="x" * 300_000)

        @scene.aa.every(1000.0)
        def ask() -> None:
            try:
                scene.aa.call("name", Number(value=1.0))
            except CallError as error:
                scene.log.append(str(error))

        await scene.plug(scene.bb, scene.aa)
        assert scene.log == [
            "call of name: the function that serves it failed: LocalProtocolError: the reply has 300,006 bytes, "
            "and may have 261,976: send less"
        ]

    tell(story)


def test_a_program_without_the_function_says_so() -> None:
    async def story(scene: Scene) -> None:
        scene.asks("ask", Number(value=1.0))
        await scene.plug(scene.bb, scene.aa)
        assert scene.log == ["call of ask: the program of the part has no function for it: write @part.serves(...)"]

    tell(story)


FIELDS = {"Number": [("value", "float32")], "Text": [("text", "text")]}


def told_to_people(scene: Scene) -> list[str]:
    """What the robot shows of BB's program, and what its journal says."""
    (bb,) = [one for one in scene.robot.inventory.view(0.0) if one.part_number == "EFGH"]
    return [str(difference_sentence(one)) for one in scene.robot.inventory.type_differences(bb.client_key)]


def test_what_a_program_says_of_a_port_counts_until_the_wire_of_the_port_changes() -> None:
    only = f"serve {HALVE}"

    async def story(scene: Scene) -> None:
        inventory, lines = scene.robot.inventory, list[str]()
        inventory.log.on_line(lambda line: lines.append(line.words))
        halve_with(scene.bb)
        scene.bb.serves("says", Number, Text)(lambda request: Text(text="seven"))
        await scene.plug(scene.bb, scene.aa)
        await asyncio.sleep(1.0)
        command = "`msbot bind halve --type 'Number -> Number' --from BB.halve`"
        words = f"port 'halve': nobody can call it before {command}; bound in "
        mine = "port 'says': carries Number -> Number, but the program says Number -> Text"
        assert [line.words for line in inventory.lines_of("BB")] == lines == [f"{words}this robot: says ({only})", mine]
        says = SlotBinding("says", "name", HALVE, publishes=True)
        scene.set(slot("BB", SlotBinding("halve", "half", HALVE, publishes=True), says), version=2)
        await asyncio.sleep(3.0)
        assert scene.bb.bound("halve")
        assert [line.words for line in inventory.lines_of("BB")] == [mine], "the wire of says is the same one"
        scene.set(slot("BB", replace(says, topic="other")), version=3)
        await asyncio.sleep(3.0)
        assert [line.words for line in inventory.lines_of("BB")] == [f"{words}this robot: says ({only})", mine]
        assert len(lines) == 4, "each is told once for each wire"

    begun = slot("BB", SlotBinding("says", "name", HALVE, publishes=True))
    tell(story, store(slot("AA"), begun))


def test_a_program_that_serves_at_a_wrong_port_is_told_at_once(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("INFO", "msbot.part")

    async def story(scene: Scene) -> None:
        scene.robot.inventory.types.library_fields = FIELDS.get
        lines: list[str] = []
        scene.robot.inventory.log.on_line(lambda line: lines.append(line.words))
        scene.bb.serves("halv", Number, Number)(lambda request: request)
        scene.bb.serves("spare", Number, Number, optional=True)(lambda request: request)
        await scene.plug(scene.bb)
        await asyncio.sleep(1.0)
        words = (
            "port 'halv': nobody can call it before `msbot bind halv --type 'Number -> Number' --from BB.halv`; "
            "bound in this robot: "
            "halve (serve Number -> Number), says (serve Number -> Text), wait (call Number -> Number)"
        )
        said = [one for one in caplog.records if "port '" in one.getMessage()][:1]
        assert [(one.levelname, one.getMessage()) for one in said] == [("INFO", words)]
        assert lines == [f"{words[:177]}…"]
        assert told_to_people(scene) == [
            'port halve: the part\'s program has no function that serves it: @part.serves("halve", ...) names one',
            'port says: the part\'s program has no function that serves it: @part.serves("says", ...) names one',
        ]

    tell(story)


def test_a_program_with_swapped_types_is_told_at_once(caplog: pytest.LogCaptureFixture) -> None:
    async def story(scene: Scene) -> None:
        scene.robot.inventory.types.library_fields = FIELDS.get
        halve_with(scene.bb)
        scene.bb.serves("says", Text, Number)(lambda _: Number(value=1.0))
        await scene.plug(scene.bb)
        await asyncio.sleep(1.0)
        at_part = [one.getMessage() for one in caplog.records if "port '" in one.getMessage()]
        assert at_part == ["port 'says': carries Number -> Text, but the program says Text -> Number"]
        assert told_to_people(scene) == [
            "port says: the part's program has Text there, the library Number",
            "port says: the part's program has Number there, the library Text",
        ]

    tell(story)


def test_a_refusal_that_is_passed_on_names_who_refused() -> None:
    async def story(scene: Scene) -> None:
        @scene.bb.serves("halve", Number, Number)
        def halve(request: Number) -> Number:
            raise CallError("out of paper")

        @scene.bb.serves("says", Number, Text)
        def says(request: Number) -> Text:
            reply: Text = scene.bb.call("wait", request)
            return reply

        scene.bb.calls("wait", Number, Number)
        scene.asks("name", Number(value=1.0))
        await scene.plug(scene.bb, scene.aa)
        await asyncio.sleep(3.0)
        assert scene.log == ["call of name: refused: wait: out of paper"]

    halves, says = SlotBinding("halve", "half", HALVE, publishes=True), SlotBinding("says", "name", NAMES, True)
    asks = (SlotBinding("ask", "half", HALVE, False), SlotBinding("name", "name", NAMES, False))
    waits = SlotBinding("wait", "half", HALVE, publishes=False)
    tell(story, store(slot("AA", *asks), slot("BB", halves, says, waits)))


def test_a_call_for_a_part_that_has_just_come_ends_at_once() -> None:
    async def story(scene: Scene) -> None:
        halve(scene)
        await scene.plug(scene.bb, scene.aa)
        (aa,) = [one for one in scene.robot.inventory.view(0.0) if one.part_number == "ABCD"]
        why = scene.robot.inventory.why_not_passed
        assert why(aa.client_key, "half_Request", 0) == "the part in slot BB does not serve it yet: call again"
        assert why(aa.client_key, "half_Request", 1) == why(aa.client_key, "half_Request", None) == ""
        ports, membership = scene.bb._runner._ports, scene.bb._runner._membership
        assert ports is not None
        assert membership is not None
        membership.client.delete(ports._bound["halve"].endpoint)
        await asyncio.sleep(1.0)
        replies: list[str] = []
        scene.aa.call("ask", Number(value=1.0), timeout=600.0, on_reply=lambda _, error: replies.append(error))
        await asyncio.sleep(1.0)
        words = "call of ask: the robot does not pass it on: the part in slot BB does not serve it yet: call again"
        assert replies == [words]

    tell(story)


class Said(Message):
    """What a program that was written for another library replies."""

    type_name = "Text"
    text: str
    loud: bool


def test_who_replies_with_another_class_than_the_librarys_is_told(caplog: pytest.LogCaptureFixture) -> None:
    async def story(scene: Scene) -> None:
        types = scene.robot.inventory.types
        types.library_fields = {"Number": [("value", "float32")], "Text": [("text", "text")]}.get
        halve_with(scene.bb)
        scene.bb.serves("says", Number, Said)(lambda _: Said(text="yes", loud=True))
        await scene.plug(scene.bb, scene.aa)
        keys = [part.client_key for part in scene.robot.inventory.view(0.0)]
        (found,) = [one for key in keys for one in scene.robot.inventory.type_differences(key)]
        assert (found.port, found.type_name, found.detail, found.their_field) == ("says", "Text", 2, "bool loud")
        assert not types._dropped
        (told,) = [one.getMessage() for one in caplog.records if "is not that of the robot's library" in one.message]
        assert "Text of this program" in told
        assert "number 2, here bool loud" in told

    tell(story)


def test_open_calls_and_served_requests_are_bounded() -> None:
    async def story(scene: Scene) -> None:
        scene.bb.calls("wait", Number, Number)

        @scene.bb.serves("halve", Number, Number)
        def half(request: Number) -> Number:
            scene.bb.call("wait", request, timeout=3.0)
            return request

        @scene.aa.every(1000.0)
        def ask() -> None:
            for number in range(MOST_OPEN_CALLS + 4):
                try:
                    scene.aa.call(
                        "ask", Number(value=number), timeout=2.0, on_reply=lambda _, error: scene.log.append(error)
                    )
                except CallError as error:
                    scene.log.append(str(error))

        await scene.plug(scene.bb)
        await scene.plug(scene.aa)
        await asyncio.sleep(5.0)
        assert len(scene.log) == MOST_OPEN_CALLS + 4
        assert sum("16 calls wait" in str(words) for words in scene.log) == 4
        assert (
            sum(f"has {MOST_SERVED} requests already" in str(words) for words in scene.log)
            == MOST_OPEN_CALLS - MOST_SERVED
        )

    tell(story)


def test_a_lost_way_to_the_robot_ends_the_calls_that_wait() -> None:
    async def story(scene: Scene) -> None:
        scene.asks("ask", Number(value=1.0), timeout=3000.0)
        await plug_mute(scene)
        for info in scene.robot.inventory.view(0.0):
            scene.robot.agent.disconnect(info.client_key, reason="gone")
        await asyncio.sleep(30.0)
        assert len(scene.log) >= 1
        assert "the part is lost, not active any more" in str(scene.log[0])

    tell(story)


def test_only_those_who_are_wired_may_ask_and_answer() -> None:
    """A part that is in the robot sends requests, and replies to those of others, without a right to either."""

    async def story(scene: Scene) -> None:
        halve(scene)
        heard: list[float] = []

        @scene.cc.on("in", HelloWorld, optional=True)
        def listen(message: HelloWorld) -> None:
            heard.append(message.index)

        await scene.plug(scene.bb, scene.cc)
        client = scene.cc._runner._membership.client  # type: ignore[union-attr]
        from msbot.part import ServiceNames

        participant = client.create_participant()
        requester = client.create_requester(participant, ServiceNames("name", "Number", "Text"))
        replier = client.create_replier(participant, ServiceNames("half", "Number", "Number"))
        for entity in (requester, replier):
            client.read(entity)
        await asyncio.sleep(0.5)
        served = scene.bb.counters.messages_in
        client.write(requester, Number(value=1.0).encode())
        scene.asks("ask", Number(value=6.0))
        await scene.plug(scene.aa)
        client.reply(replier, bytes(24), b"\0" + Number(value=13.0).encode())
        await asyncio.sleep(1.0)
        assert scene.log == [Number(value=3.0)]
        assert scene.bb.counters.messages_in == served + 1

    tell(story)


@pytest.mark.promise("A call ends with its reply, or with one sentence, never without an end")
@pytest.mark.parametrize("sealed", [False, True])
@pytest.mark.parametrize("held", ["ABCD", "EFGH"])
def test_who_calls_a_held_part_or_is_held_learns_it_at_once(held: str, sealed: bool) -> None:
    """A teacher has frozen the class, or taken the pupil's program over; its calls that wait end as well."""

    async def story(scene: Scene) -> None:
        halve(scene)

        @scene.aa.every(1.0)
        def ask() -> None:
            try:
                scene.log.append(scene.aa.call("ask", Number(value=9.0), timeout=500.0))
            except CallError as error:
                scene.log.append(str(error))

        await scene.plug(scene.bb, scene.aa)
        assert scene.log[-1] == Number(value=4.5)
        inventory, now = scene.robot.inventory, asyncio.get_running_loop().time()
        key = next(part.client_key for part in inventory.view(0.0) if part.part_number == held)
        inventory._index.sessions[key].pupil = "ben"
        inventory.pupil_parts.pupils.freeze = Freeze("ann", "look at me", now)
        inventory.pupil_parts.follow(now)
        scene.robot.agent.recheck(key)
        await asyncio.sleep(2.0)
        served = scene.bb.counters.messages_in
        await asyncio.sleep(5.0)
        assert scene.bb.counters.messages_in == served
        where = "" if held == "ABCD" else "slot BB is held: "
        assert (
            scene.log[-3:]
            == [f"call of ask: the robot does not pass it on: {where}the class is frozen by ann: look at me"] * 3
        )
        inventory.pupil_parts.pupils.freeze = None
        inventory.pupil_parts.follow(now)
        scene.robot.agent.recheck(key)
        await asyncio.sleep(3.0)
        assert scene.log[-1] == Number(value=4.5)

    tell(story, sealed=sealed)


@pytest.mark.parametrize("sealed", [False, True])
def test_a_recorded_request_played_back_is_served_only_in_an_open_robot(sealed: bool) -> None:
    async def story(scene: Scene) -> None:
        halve(scene)
        scene.asks("ask", Number(value=9.0))
        await scene.plug(scene.bb)
        spies: list[Spy] = []

        def spy(link: InprocEnd) -> InprocEnd:
            spies.append(Spy(link))
            return spies[0]  # type: ignore[return-value]  # a link like any other

        await scene.plug(scene.aa, through=spy)
        recorded = [(object_id, octets) for object_id, octets in spies[0].recorded(up=True) if object_id & 0xF == 7]
        object_id, octets = [one for one in recorded if one[0] != recorded[0][0]][-1]
        before = scene.bb.counters.messages_in
        spies[0].spoof(object_id, octets, up=True)
        await asyncio.sleep(0.5)
        assert scene.bb.counters.messages_in - before == (0 if sealed else 1)
        assert scene.log == [Number(value=4.5)]

    tell(story, sealed=sealed)
