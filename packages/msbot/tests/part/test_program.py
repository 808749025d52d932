"""What a program hears while its part runs: settings, new bindings, STOP, partners, "which one are you?"."""

from __future__ import annotations

import asyncio
import logging

import pytest

from msbot.part.join import pnp_messages
from msbot.part.join.joining import JoinState
from msbot.part.join.part_keys import prove
from msbot.part.messages.standard import HelloWorld
from msbot.part.part import Part
from msbot_xrce.errors import ConfigError
from tests.part.test_part import RING, Room, make_part, play
from tests.part.wire import publishes, subscribes

KEY = bytes(range(16))


def setting(name: str, value: str) -> pnp_messages.Setting:
    return pnp_messages.Setting(name=name, value=value)


def notice(
    kind: pnp_messages.NoticeKind, binding: int = pnp_messages.NO_BINDING, version: int = 1
) -> pnp_messages.Notice:
    return pnp_messages.Notice(number=version, binding=binding, kind=kind)


async def change(room: Room, number: str) -> None:
    """Have the master's next configuration fetched at once."""
    room.master.version += 1
    room.master.say(number, pnp_messages.BeatReply(configuration_version=room.master.version))
    await asyncio.sleep(0.05)


def test_settings_are_heard_before_joining_and_at_once_when_they_change() -> None:
    async def scenario(room: Room) -> None:
        part = make_part()
        story: list[object] = []
        part.on_setting("gain", float)(story.append)
        part.on_setting("title")(story.append)
        part.on_join(lambda: story.append(("join", part.setting("gain", float), part.setting("missing", int, 5))))
        room.master.settings = [setting("gain", "0.5"), setting("title", "one")]
        room.plug(part)
        await asyncio.sleep(0.3)
        assert story == [0.5, "one", ("join", 0.5, 5)]
        room.master.settings = [setting("gain", "0.25"), setting("title", "one")]
        await change(room, "ABCD")
        assert story[3:] == [0.25]
        assert part.setting("gain", float) == 0.25

    play(scenario)


def test_a_period_that_is_a_setting_counts_at_once() -> None:
    async def scenario(room: Room) -> None:
        part = make_part()
        calls: list[float] = []
        loop = asyncio.get_running_loop()
        part.every("period_s")(lambda: calls.append(loop.time()))
        room.master.settings = [setting("period_s", "0.5")]
        room.plug(part)
        await asyncio.sleep(0.3)
        began_at = calls[0]
        room.master.settings = [setting("period_s", "0.1")]
        await change(room, "ABCD")
        await asyncio.sleep(1.0)
        changed_at = calls[1]
        assert began_at < changed_at < began_at + 0.4
        assert [round(at - changed_at, 3) for at in calls[1:11]] == [round(0.1 * n, 3) for n in range(10)]

    play(scenario)


def test_a_period_that_makes_no_sense_leaves_the_one_before(caplog: pytest.LogCaptureFixture) -> None:
    async def scenario(room: Room) -> None:
        part = make_part()
        calls: list[int] = []
        part.every("period_s")(lambda: calls.append(1))
        room.master.settings = [setting("period_s", "0")]
        room.plug(part)
        await asyncio.sleep(2.3)
        assert len(calls) == 3

    with caplog.at_level(logging.ERROR):
        play(scenario)
    assert [record.getMessage() for record in caplog.records] == [
        "setting 'period_s': 0.0 s is not a period; 1.0 s stays"
    ]


def test_a_binding_that_changes_is_tied_anew_at_once_and_the_other_port_loses_nothing() -> None:
    async def scenario(room: Room) -> None:
        a, b = make_part("ABCD", 1), make_part("EFGH", 2)
        heard: list[str] = []
        count = iter(range(1000))
        a.every(0.01)(lambda: a.publish("out", HelloWorld(index=next(count), message="a")))
        b.on("in", HelloWorld)(lambda message: heard.append(f"{message.message}{message.index}"))
        room.plug(a)
        room.plug(b)
        await asyncio.sleep(1.0)
        room.master.bindings["EFGH"] = [publishes("out", "elsewhere"), subscribes("in", "1_to_2")]
        await change(room, "EFGH")
        await asyncio.sleep(0.5)
        first = int(heard[0][1:])
        assert heard == [f"a{number}" for number in range(first, first + len(heard))]
        room.master.bindings["EFGH"] = [publishes("out", "elsewhere"), subscribes("in", "nobody's")]
        await change(room, "EFGH")
        silent_from = len(heard)
        await asyncio.sleep(0.5)
        assert len(heard) == silent_from
        room.master.bindings["ABCD"] = [publishes("out", "nobody's"), subscribes("in", "3_to_1")]
        await change(room, "ABCD")
        await asyncio.sleep(0.5)
        assert len(heard) > silent_from + 40
        assert b.state is JoinState.ACTIVE
        assert b.counters.handler_errors == a.counters.handler_errors == 0

    play(scenario, {number: list(bindings) for number, bindings in RING.items()})


def test_stop_lets_nothing_through_until_go_and_publishing_goes_on() -> None:
    async def scenario(room: Room) -> None:
        a, b = make_part("ABCD", 1), make_part("EFGH", 2)
        heard: list[str] = []
        story: list[str] = []
        b.safe_state(lambda: story.append("safe"))
        b.on_stop(lambda: story.append(f"stop: {b.stopped}"))
        b.on_go(lambda: story.append(f"go: {b.stopped}"))
        a.every(0.1)(lambda: a.publish("out", HelloWorld(index=1, message="go")))
        b.every(0.1)(lambda: b.publish("out", HelloWorld(index=1, message="here")))
        b.on("in", HelloWorld)(lambda message: heard.append(message.message))
        room.master.settings = [setting("in.safe.message", "safe")]
        room.plug(a)
        room.plug(b)
        await asyncio.sleep(1.05)
        room.master.say("EFGH", notice(pnp_messages.NoticeKind.STOP))
        await asyncio.sleep(0.01)
        assert b.stopped
        assert heard[-1] == "safe"
        before, out = len(heard), b.counters.messages_out
        await asyncio.sleep(1.0)
        assert len(heard) == before
        assert b.counters.held == 10
        assert b.counters.messages_out == out + 10
        room.master.say("EFGH", notice(pnp_messages.NoticeKind.GO))
        await asyncio.sleep(0.5)
        assert not b.stopped
        assert heard[before:] == ["go"] * 5
        assert story == ["safe", "stop: True", "go: False"]
        b.end()
        assert story == ["safe", "stop: True", "go: False", "safe"], "the end of a part is no STOP"

    play(scenario)


def test_a_part_that_was_stopped_and_joins_anew_is_stopped_until_go() -> None:
    async def scenario(room: Room) -> None:
        part = make_part()
        room.plug(part)
        await asyncio.sleep(0.3)
        room.master.say("ABCD", notice(pnp_messages.NoticeKind.STOP))
        await asyncio.sleep(0.05)
        assert part.stopped
        room.master.parts.clear()
        await asyncio.sleep(2.0)
        assert part.state is JoinState.ACTIVE
        assert part.stopped
        room.master.say("ABCD", notice(pnp_messages.NoticeKind.GO))
        await asyncio.sleep(0.05)
        assert not part.stopped

    play(scenario)


def test_a_lost_partner_puts_the_ports_it_fed_into_their_safe_state() -> None:
    async def scenario(room: Room) -> None:
        part = make_part("EFGH")
        story: list[object] = []
        part.on("in", HelloWorld)(lambda message: story.append(message.message))
        part.safe_state(lambda: story.append("safe state"))
        part.on_partner_lost(lambda port: story.append(f"{port} lost"))
        room.master.settings = [setting("in.safe.message", "safe")]
        room.plug(part)
        await asyncio.sleep(0.3)
        lost = pnp_messages.NoticeKind.PARTNER_LOST
        room.master.say("EFGH", notice(lost, binding=1, version=99))
        room.master.say("EFGH", notice(lost, binding=7))
        room.master.say("EFGH", notice(pnp_messages.NoticeKind.PARTNER_BACK, binding=1))
        await asyncio.sleep(0.05)
        assert story == []
        room.master.say("EFGH", notice(lost, binding=1))
        await asyncio.sleep(0.05)
        assert story == ["safe", "safe state", "in lost"]
        assert not part.stopped

    play(scenario)


def test_a_lost_master_puts_every_port_into_its_safe_state() -> None:
    async def scenario(room: Room) -> None:
        part = make_part("EFGH")
        story: list[str] = []
        part.on("in", HelloWorld)(lambda message: story.append(message.message))
        room.master.settings = [setting("in.safe.message", "safe")]
        room.plug(part)
        await asyncio.sleep(0.3)
        await room.master.kill()
        await asyncio.sleep(5.0)
        assert part.state is JoinState.LOST
        assert story == ["safe"]

    play(scenario)


def test_a_part_shows_itself_when_asked() -> None:
    async def scenario(room: Room) -> None:
        part = make_part()
        asked: list[int] = []
        part.on_identify(lambda: asked.append(1))
        room.plug(part)
        await asyncio.sleep(0.3)
        room.master.say("ABCD", notice(pnp_messages.NoticeKind.IDENTIFY))
        await asyncio.sleep(0.05)
        assert asked == [1]

    play(scenario)


def test_a_part_with_a_key_proves_it_and_joins() -> None:
    async def scenario(room: Room) -> None:
        part = Part("ABCD", local_name="eye", key=KEY.hex())
        room.master.nonce = bytes(range(50, 66))
        room.plug(part)
        await asyncio.sleep(0.3)
        assert part.state is JoinState.ACTIVE
        assert part.uid is not None
        membership = part._runner._membership
        assert membership is not None
        (proof,) = room.master.proofs
        expected = prove(
            KEY, room.master.nonce, part.uid, part_number="ABCD", local_name="eye", session_key=membership.client.key
        )
        assert proof == expected

    play(scenario)


def test_a_part_without_a_key_says_what_is_missing_and_asks_again_later() -> None:
    async def scenario(room: Room) -> None:
        part = make_part()
        room.master.nonce = bytes(16)
        room.plug(part)
        await asyncio.sleep(0.3)
        assert part.state.value == "refused"
        assert part.reason.endswith("the part proves none: give it its key with --key or $MSBOT_KEY")
        part.key = KEY
        await asyncio.sleep(2.5)
        assert part.state is JoinState.ACTIVE

    play(scenario)


@pytest.mark.parametrize("key", [b"short", "abc", bytes(65)])
def test_a_key_that_makes_no_sense_is_refused_at_once(key: bytes | str) -> None:
    with pytest.raises(ConfigError, match="msbot key new"):
        Part("ABCD", key=key)
