"""The student's part, in a small robot, in virtual time: joins, publishes, loses its master and comes back."""

import asyncio
import logging
from collections.abc import Awaitable, Callable
from random import Random

import pytest

from msbot.part.join import pnp_messages
from msbot.part.join.joining import ExpectedRobot, JoinState
from msbot.part.join.refusal import Refusal
from msbot.part.messages.message import Message
from msbot.part.messages.standard import HelloWorld
from msbot.part.messages.wire_types import float32
from msbot.part.part import Part
from msbot.process.virtual_time import run_virtual
from msbot_agent.link import LossyLink, Signal
from msbot_xrce.errors import ConfigError, LinkDown, LocalProtocolError
from msbot_xrce.messages import SubmessageId, decode_header, iter_submessages
from tests.part.wire import HandLink, QuietLink, SmallMaster, publishes, subscribes

RING = {
    "ABCD": [publishes("out", "1_to_2"), subscribes("in", "3_to_1")],
    "EFGH": [publishes("out", "2_to_3"), subscribes("in", "1_to_2")],
}


class Light(Message):
    """Another type than the ring's."""

    lux: float32


class Room:
    """A small master and parts that can be plugged in."""

    def __init__(self, bindings: dict[str, list[pnp_messages.PortBinding]]) -> None:
        self.master = SmallMaster(bindings)
        self.master.start()
        self.tasks: list[asyncio.Task[None]] = []

    def plug(self, part: Part, **lossy: float) -> QuietLink:
        link = self.master.link()
        way = LossyLink(link, random=Random(len(self.tasks)), **lossy) if lossy else link
        self.tasks.append(asyncio.get_running_loop().create_task(part.run_async(way)))
        return link

    async def close(self) -> None:
        for task in self.tasks:
            task.cancel()
        await asyncio.gather(*self.tasks, return_exceptions=True)
        await self.master.kill()


def play(
    scenario: Callable[[Room], Awaitable[None]], bindings: dict[str, list[pnp_messages.PortBinding]] | None = None
) -> None:
    async def main() -> None:
        room = Room(RING if bindings is None else bindings)
        try:
            await scenario(room)
        finally:
            await room.close()

    run_virtual(main())


def make_part(number: str = "ABCD", seed: int = 1, robot: str | ExpectedRobot = "*") -> Part:
    return Part(number, robot=robot, random=Random(seed))


def test_a_part_joins_and_its_messages_arrive() -> None:
    async def scenario(room: Room) -> None:
        a, b = make_part("ABCD", 1, "MSBOT_MASTER"), make_part("EFGH", 2)
        got: list[str] = []
        joined: list[str] = []

        @a.every(1.0)
        def tick() -> None:
            assert a.publish("out", HelloWorld(index=1, message="hello"))

        @b.on("in", HelloWorld)
        def receive(message: HelloWorld) -> None:
            got.append(message.message)

        @b.on_join
        def welcome() -> None:
            joined.append(b.slot)

        room.plug(a)
        room.plug(b)
        await asyncio.sleep(3.5)
        assert a.state is b.state is JoinState.ACTIVE
        assert joined == ["slot of EFGH"]
        assert got == ["hello"] * 4
        assert (a.counters.messages_out, b.counters.messages_in) == (4, 4)
        assert (b.counters.beats, b.counters.missed_beats) == (3, 0)
        assert b.reason == "in slot slot of EFGH"
        assert b.bound("in")
        assert not b.bound("other")

    play(scenario)


def test_nothing_is_written_but_claims_before_the_part_is_active() -> None:
    async def scenario(room: Room) -> None:
        part = make_part()

        @part.every(0.1)
        def tick() -> None:
            part.publish("out", HelloWorld(index=1, message="secret"))

        written: list[tuple[float, JoinState, bytes]] = []
        link = room.plug(part)
        loop = asyncio.get_running_loop()

        def tap(now: float, way: str, _peer: object, packet: bytes) -> None:
            header = decode_header(packet)
            if way == "out":
                written.extend(
                    (loop.time(), part.state, submessage.payload)  # type: ignore[union-attr]  # only WRITE_DATA has one
                    for submessage in iter_submessages(packet, header.size)
                    if submessage.ID == SubmessageId.WRITE_DATA
                )

        link.tap = tap
        room.master.profile = ("OTHER", *room.master.profile[1:])
        part.robot = ExpectedRobot("MSBOT_MASTER")
        await asyncio.sleep(3.0)
        assert part.state is JoinState.WRONG_ROBOT
        assert written == []
        with pytest.raises(LocalProtocolError, match="the part is wrong robot, not active"):
            part.publish("out", HelloWorld(index=0, message=""))

    play(scenario)


def test_on_the_wire_the_first_sample_follows_both_steps_and_the_configuration() -> None:
    async def scenario(room: Room) -> None:
        part = make_part()

        @part.every(0.1)
        def tick() -> None:
            part.publish("out", HelloWorld(index=7, message="sample"))

        kinds: list[str] = []

        def tap(_now: float, way: str, _peer: object, packet: bytes) -> None:
            if way == "in":
                kinds.extend(
                    word for word, sign in (("profile", b"MSBOT_MASTER"), ("slot", b"slot of")) if sign in packet
                )
            elif b"sample" in packet:
                kinds.append("sample")
            elif b"\x05\x00\x00\x00ABCD\x00" in packet:
                kinds.append("claim")

        room.plug(part).tap = tap
        await asyncio.sleep(0.35)
        assert kinds == ["profile", "claim", "slot", "sample", "sample", "sample", "sample"]

    play(scenario)


def test_a_part_of_another_robot_never_claims() -> None:
    async def scenario(room: Room) -> None:
        part = make_part(robot=ExpectedRobot("MSBOT_MASTER", version="MSBOT_V9"))
        room.plug(part)
        await asyncio.sleep(10.0)
        assert part.state is JoinState.WRONG_ROBOT
        assert part.reason == "this robot's version is 'MSBOT_V1', the part expects 'MSBOT_V9'"
        assert room.master.requests == []
        room.master.profile = ("MSBOT_MASTER", "MSBOT_V9", *room.master.profile[2:])
        room.master.publish_profile()
        await asyncio.sleep(0.1)
        assert part.state.value == "active"

    play(scenario)


def test_an_unknown_part_hears_nothing_and_asks_again_every_half_second() -> None:
    async def scenario(room: Room) -> None:
        part = make_part("NOPE")
        room.plug(part)
        await asyncio.sleep(2.2)
        assert part.state is JoinState.CLAIMING
        assert room.master.requests == [("claim", "NOPE")] * 5

    play(scenario)


def test_a_refusal_is_told_in_words() -> None:
    async def scenario(room: Room) -> None:
        room.master.refuse = Refusal.BLOCKED
        part = make_part()
        room.plug(part)
        await asyncio.sleep(0.1)
        assert part.state is JoinState.REFUSED
        assert part.reason == Refusal.BLOCKED.describe
        room.master.refuse = None
        await asyncio.sleep(2.1)
        assert part.state.value == "active"

    play(scenario)


def test_after_the_master_was_restarted_the_part_is_back_within_3_s() -> None:
    async def scenario(room: Room) -> None:
        a, b = make_part("ABCD", 1), make_part("EFGH", 2)
        got: list[float] = []
        loop = asyncio.get_running_loop()
        story: list[str] = []
        a.every(0.25)(lambda: a.publish("out", HelloWorld(index=0, message="x")))
        b.on("in", HelloWorld)(lambda message: got.append(loop.time()))
        b.on_join(lambda: story.append("join"))
        b.on_lost(lambda: story.append(f"lost: {b.reason}"))
        b.safe_state(lambda: story.append("safe"))
        room.plug(a)
        room.plug(b)
        await asyncio.sleep(5.1)
        await room.master.kill()
        await asyncio.sleep(0.4)
        room.master.start()
        restarted_at = loop.time()
        await asyncio.sleep(3.0)
        assert a.state is b.state is JoinState.ACTIVE
        back_at = next(at for at in got if at > restarted_at)
        assert back_at - restarted_at < 3.0
        assert story == ["join", "safe", "lost: the agent does not know this session any more", "join"]

    play(scenario)


def test_a_master_that_stays_away_leaves_the_part_in_its_safe_state() -> None:
    async def scenario(room: Room) -> None:
        part = make_part()
        story: list[tuple[float, str]] = []
        loop = asyncio.get_running_loop()
        calls: list[float] = []
        part.every(0.5)(lambda: calls.append(loop.time()))
        part.safe_state(lambda: story.append((loop.time(), "safe")))
        room.plug(part)
        await asyncio.sleep(2.2)
        await room.master.kill()
        await asyncio.sleep(30.0)
        assert part.state is JoinState.LOST
        assert len(story) == 1
        assert 2.2 < story[0][0] < 4.5
        assert max(calls) <= story[0][0]
        room.master.start()
        await asyncio.sleep(1.0)
        assert part.state.value == "active"
        assert max(calls) > 32.0

    play(scenario)


def test_a_forgotten_lease_is_claimed_anew_through_the_same_session() -> None:
    async def scenario(room: Room) -> None:
        part = make_part()
        room.plug(part)
        await asyncio.sleep(2.5)
        room.master.parts.clear()
        await asyncio.sleep(1.0)
        assert part.state is JoinState.ACTIVE
        assert [request for request in room.master.requests if request[0] == "claim"] == [("claim", "ABCD")] * 2

    play(scenario)


def test_a_silent_inventory_is_a_lost_master() -> None:
    async def scenario(room: Room) -> None:
        part = make_part()
        lost: list[float] = []
        loop = asyncio.get_running_loop()
        part.on_lost(lambda: lost.append(loop.time()))
        room.plug(part)
        await asyncio.sleep(2.1)
        room.master.answers_beats = False
        await asyncio.sleep(5.0)
        assert len(lost) == 1
        assert 5.0 <= lost[0] <= 6.6

    play(scenario)


def test_beats_go_best_effort_and_are_answered_so() -> None:
    async def scenario(room: Room) -> None:
        part = make_part()
        link = room.plug(part)
        await asyncio.sleep(0.5)
        packets: list[tuple[str, int, int]] = []
        link.tap = lambda _now, way, _peer, packet: packets.append((way, packet[1], len(packet)))
        await asyncio.sleep(1.0)
        assert packets == [("out", 0x01, 16), ("in", 0x01, 20)]

    play(scenario)


def test_a_new_configuration_rebinds_ports_while_the_part_runs() -> None:
    async def scenario(room: Room) -> None:
        a, b = make_part("ABCD", 1), make_part("EFGH", 2)
        got: list[str] = []
        a.every(0.1)(lambda: a.publish("out", HelloWorld(index=0, message=a.settings.get("text", ""))))
        b.on("in", HelloWorld)(lambda message: got.append(message.message))
        room.plug(a)
        room.plug(b)
        await asyncio.sleep(0.55)
        assert got == [""] * 6
        room.master.bindings = {"ABCD": [publishes("out", "new")], "EFGH": [subscribes("in", "new", reliable=False)]}
        room.master.settings = [pnp_messages.Setting(name="text", value="anew")]
        room.master.version = 2
        await asyncio.sleep(1.0)
        assert a.state is b.state is JoinState.ACTIVE
        assert got[-1] == "anew"
        assert not a.bound("in")
        assert a.settings == {"text": "anew"}
        with pytest.raises(TypeError):
            a.settings["text"] = "no"  # type: ignore[index]  # that is the point

    play(scenario)


def test_an_error_in_a_handler_is_reported_once_and_the_part_lives(caplog: pytest.LogCaptureFixture) -> None:
    async def scenario(room: Room) -> None:
        part = make_part()

        @part.every(0.1)
        def broken() -> None:
            raise KeyError("oops")

        room.plug(part)
        await asyncio.sleep(1.05)
        assert part.state is JoinState.ACTIVE
        assert part.counters.handler_errors == 11

    with caplog.at_level(logging.ERROR, "msbot.part"):
        play(scenario)
    said = [record.getMessage() for record in caplog.records if record.name == "msbot.part"]
    assert len(said) == 1
    assert said[0].startswith("test_part.py:")
    assert "in broken: KeyError: 'oops'" in said[0]


@pytest.mark.parametrize(
    ("port", "message", "words"),
    [
        (
            "outt",
            HelloWorld(index=0, message=""),
            "there is no port 'outt' to publish on; bound in this robot: out (publish HelloWorld)",
        ),
        (
            "in",
            HelloWorld(index=0, message=""),
            "there is no port 'in' to publish on; bound in this robot: out (publish HelloWorld)",
        ),
        ("out", Light(lux=0.0), "port 'out' carries HelloWorld, not Light"),
        ("out", "hello", "port 'out' publishes messages, not str"),
        (HelloWorld(index=0, message=""), "out", 'the port comes first, and is a text: publish("out", message)'),
        ("out", HelloWorld, "port 'out' publishes messages, not the type HelloWorld: write HelloWorld(...)"),
    ],
)
def test_a_wrong_port_or_type_ends_the_program_with_one_sentence(port: str, message: Message, words: str) -> None:
    async def scenario(room: Room) -> None:
        part = make_part()

        @part.every(1.0)
        def tick() -> None:
            part.publish(port, message)

        room.plug(part)
        with pytest.raises(ConfigError) as caught:
            await asyncio.wait_for(room.tasks[0], 5.0)
        assert str(caught.value).startswith("test_part.py:")
        assert words in str(caught.value)
        assert part.state is JoinState.ENDED

    play(scenario)


def test_a_port_that_a_later_configuration_takes_away_does_not_end_the_part(caplog: pytest.LogCaptureFixture) -> None:
    async def scenario(room: Room) -> None:
        part = make_part()

        @part.every(0.1)
        def tick() -> None:
            part.publish("out", HelloWorld(index=0, message=""))

        room.plug(part)
        await asyncio.sleep(0.5)
        room.master.bindings = {"ABCD": []}
        room.master.version = 2
        await asyncio.sleep(3.0)
        assert part.state is JoinState.ACTIVE
        assert part.counters.handler_errors > 10

    play(scenario)
    said = [record.getMessage() for record in caplog.records if record.name == "msbot.part"]
    assert len(said) == 1
    assert "this robot binds no port of the part: since the configuration has changed" in said[0]


def test_a_port_that_nobody_feeds_or_that_carries_another_type_is_named(caplog: pytest.LogCaptureFixture) -> None:
    async def scenario(room: Room) -> None:
        a, b = make_part("ABCD", 1), make_part("EFGH", 2)
        got: list[Message] = []
        a.every(0.1)(lambda: a.publish("out", HelloWorld(index=0, message="x")))
        b.on("in", Light)(got.append)
        b.on("inn", HelloWorld)(got.append)
        b.on("spare", HelloWorld, optional=True)(got.append)  # and nothing is said of this one
        room.plug(a)
        room.plug(b)
        await asyncio.sleep(0.5)
        assert got == []
        assert b.counters.dropped > 3

    play(scenario)
    said = [record.getMessage() for record in caplog.records if record.name == "msbot.part"]
    assert said == [
        "port 'in': carries HelloWorld, but its function expects Light",
        "port 'inn': nothing will come in; bound in this robot: out (publish HelloWorld), in (subscribe HelloWorld)",
    ]


def test_samples_that_cannot_be_read_are_counted_and_named_once(caplog: pytest.LogCaptureFixture) -> None:
    class Short(Message):
        """Calls itself HelloWorld and is something else."""

        type_name = "HelloWorld"
        lux: float32

    async def scenario(room: Room) -> None:
        a, b = make_part("ABCD", 1), make_part("EFGH", 2)
        a.every(0.1)(lambda: a.publish("out", Short(lux=0.0)))
        b.on("in", HelloWorld)(lambda message: None)
        room.plug(a)
        room.plug(b)
        await asyncio.sleep(0.55)
        assert b.counters.dropped == 6
        assert b.counters.messages_in == 0

    play(scenario)
    said = [record.getMessage() for record in caplog.records if record.name == "msbot.part"]
    assert len(said) == 1
    assert said[0].startswith("port 'in': a message that cannot be read")


def test_rubbish_profiles_and_replies_are_ignored() -> None:
    async def scenario(room: Room) -> None:
        part = make_part()
        room.plug(part)
        await asyncio.sleep(0.5)
        client = room.master.client
        client.write(room.master._writer, b"rubbish")

        def mumble(_object_id: int, _request_id: int, identity: bytes, _body: bytes) -> None:
            client.reply(room.master._replier, identity, b"12345")

        client.on_request = mumble
        await asyncio.sleep(1.0)
        assert part.state is JoinState.ACTIVE
        assert part._runner._membership is not None
        assert part._runner._membership.dropped >= 2

    play(scenario)


def test_a_polite_end_tells_the_master_and_calls_everything_once() -> None:
    async def scenario(room: Room) -> None:
        part = make_part()
        story: list[str] = []
        part.safe_state(lambda: story.append("safe"))
        part.on_end(lambda: story.append("end"))
        part.on_lost(lambda: story.append("lost"))
        room.plug(part)
        await asyncio.sleep(1.5)
        assert len(room.master.agent.clients()) == 2
        part.end()
        await room.tasks[0]
        assert part.state is JoinState.ENDED
        assert story == ["safe", "end"]
        assert len(room.master.agent.clients()) == 1
        part.end()

    play(scenario)


def test_a_part_that_is_cut_off_reaches_its_safe_state_too() -> None:
    async def scenario(room: Room) -> None:
        part = make_part()
        story: list[str] = []
        part.safe_state(lambda: story.append("safe"))
        part.on_lost(lambda: story.append("lost"))
        part.on_end(lambda: story.append("end"))
        room.plug(part)
        await asyncio.sleep(0.5)
        room.tasks[0].cancel()
        await asyncio.gather(room.tasks[0], return_exceptions=True)
        assert story == ["safe", "end"]

    play(scenario)


def test_a_part_can_run_again_and_keeps_its_uid_but_not_its_key() -> None:
    async def scenario(room: Room) -> None:
        part = make_part()
        keys = set()
        for _ in range(2):
            room.plug(part)
            await asyncio.sleep(0.5)
            assert part.state is JoinState.ACTIVE
            with pytest.raises(LocalProtocolError, match="runs already"):
                await part.run_async(room.master.link())
            keys |= {view.key for view in room.master.agent.clients()}
            part.end()
            await room.tasks[-1]
        assert len(keys) == 3
        assert part.uid is not None
        assert len(part.uid) == 8

    play(scenario)


def test_stop_on_the_bus_is_the_safe_state() -> None:
    async def main() -> None:
        link = HandLink()
        part = make_part()
        story: list[str] = []
        part.safe_state(lambda: story.append("safe"))
        running = asyncio.create_task(part.run_async(link))
        await asyncio.sleep(0.1)
        link.signal(Signal.STOP, "button")
        assert story == ["safe"]
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)

    run_virtual(main())


def test_a_link_that_cannot_be_opened_ends_the_part_with_its_reason() -> None:
    async def main() -> None:
        link = HandLink()
        link.breaks.put_nowait(LinkDown("no such host: check the address"))
        with pytest.raises(LinkDown, match="check the address"):
            await make_part().run_async(link)

    run_virtual(main())


@pytest.mark.parametrize("seed", range(3))
def test_on_a_link_that_loses_a_fifth_of_the_packets_a_part_joins_and_stays(seed: int) -> None:
    async def scenario(room: Room) -> None:
        part = make_part(seed=seed)
        lost: list[str] = []
        part.on_lost(lambda: lost.append(part.reason))
        room.tasks.extend([asyncio.create_task(asyncio.sleep(0))] * seed)
        room.plug(part, drop=0.2)
        await asyncio.sleep(5.0)
        assert part.state is JoinState.ACTIVE
        await asyncio.sleep(55.0)
        assert part.state is JoinState.ACTIVE
        assert lost == []
        assert part.counters.missed_beats > 5

    play(scenario)


def test_a_sample_without_room_is_counted_not_raised() -> None:
    async def scenario(room: Room) -> None:
        part = make_part()
        room.plug(part)
        await asyncio.sleep(0.5)
        results = [part.publish("out", HelloWorld(index=0, message="x" * 1000)) for _ in range(40)]
        assert results[0]
        assert not results[-1]
        assert part.counters.messages_out == results.count(True)
        assert part.counters.not_sent == results.count(False)

    play(scenario)


def deaf() -> None:
    """Takes no message."""


def ranged(ranges: dict[str, tuple[float, float]]) -> object:
    return make_part().on("in", HelloWorld, ranges=ranges)(lambda message: None)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Part(1234), 'the part number is a text, not 1234: write "1234"'),  # type: ignore[arg-type]
        (lambda: Part(""), "the part number '' must have 1 to 254 bytes and no NUL"),
        (lambda: Part("ABCD", local_name="x" * 255), "must have 1 to 254 bytes"),
        (lambda: Part("ABCD", local_name="a\0b"), "no NUL"),
        (lambda: Part("ABCD", uid=b"123"), "a UID has 8 bytes, not 3"),
        (lambda: make_part().every(0), "every(0): the period must be more than 0 seconds"),
        (lambda: make_part().every(float("nan")), "the period must be more than 0"),
        (lambda: make_part().every(1.0)(lambda _: None), "must take no arguments"),  # type: ignore[type-var]
        (lambda: make_part().board, "part ABCD has no board: make it with Part(..., board=SimGpio())"),
        (lambda: make_part().on("in", str), "on('in', ...) needs the class of the message, not <class 'str'>"),  # type: ignore[type-var]
        (lambda: make_part().on("in", HelloWorld)(deaf), "must take one argument, the message"),  # type: ignore[arg-type]
        (lambda: ranged({"index": (9, 1)}), "'index' needs the least and the greatest value, for example (0, 100)"),
        (lambda: ranged({"message": (0, 1)}), "the ranges of port 'in': 'message' is no number in a HelloWorld"),
        (lambda: make_part().on_join(lambda _: None), "must take no arguments"),  # type: ignore[arg-type]
    ],
)
def test_mistakes_are_named_where_they_are_made(make: Callable[[], object], words: str) -> None:
    with pytest.raises(ConfigError) as caught:
        make()
    assert words in str(caught.value)


def test_a_port_has_one_function() -> None:
    part = make_part()
    part.on("in", HelloWorld)(lambda message: None)
    with pytest.raises(ConfigError, match="port 'in' has a function already"):
        part.on("in", HelloWorld)(lambda message: None)


def test_a_part_that_does_not_run_says_so() -> None:
    part = make_part()
    with pytest.raises(LocalProtocolError, match="the part does not run: publish"):
        part.publish("out", HelloWorld(index=0, message=""))
    assert not part.bound("out")
    assert part.slot == ""
    part.end()
