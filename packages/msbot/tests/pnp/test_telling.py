"""What the inventory says to parts that did not ask: new configurations, slots, partners, STOP (design PNP 4, 6, 7)."""

from __future__ import annotations

import asyncio
from dataclasses import replace

import pytest

from msbot.part.join import pnp_messages, thesis_messages
from msbot.part.join.refusal import Refusal
from msbot.pnp import Configuration, PartState, SlotBinding
from msbot.process.virtual_time import run_virtual
from tests.pnp.robot import configuration, sample_store, uid
from tests.pnp.scene import ORIGINAL, Robot, Visitor, with_robot

SOON_S = 0.05


async def told(visitor: Visitor) -> list[pnp_messages.Reply]:
    """What the part is told in the next moment."""
    visitor.replies.clear()
    await asyncio.sleep(SOON_S)
    return [pnp_messages.decode_reply(payload) for payload in visitor.replies]


def test_a_changed_configuration_is_pushed_at_once() -> None:
    async def scene() -> None:
        store = sample_store()
        robot = Robot(store)
        part, other = Visitor(robot, 0xA1), Visitor(robot, 0xB1)

        async def play() -> None:
            await part.claim("ABCD", 1)
            await other.claim("EFGH", 2)
            store.configurations["AA"] = configuration("AA", version=2)
            other.replies.clear()
            robot.inventory.configuration_changed("AA")
            assert await told(part) == [pnp_messages.BeatReply(configuration_version=2)]
            assert other.replies == []
            assert robot.service.told_unasked == 1

        await with_robot(robot, part, other, play=play)

    run_virtual(scene())


def test_a_spare_is_told_its_new_lease_at_once_and_its_beats_are_answered() -> None:
    async def scene() -> None:
        robot = Robot(sample_store(), explain=True)
        first, spare = Visitor(robot, 0xA1), Visitor(robot, 0xA2)

        async def play() -> None:
            await first.claim("ABCD", 1)
            refused = await spare.claim("ABCD", 2)
            assert refused is not None
            assert (refused.lease, refused.reason) == (0, Refusal.NO_SLOT)
            helps = pnp_messages.decode_reply(spare.replies[-1])
            assert isinstance(helps, pnp_messages.ConfigurationMessage)
            assert (helps.version, helps.slot, helps.settings[0].name) == (0, "", pnp_messages.HELP_SETTING)
            spare.replies.clear()
            await first.client.close()
            await asyncio.sleep(SOON_S)
            (verdict,) = [pnp_messages.decode_reply(payload) for payload in spare.replies]
            assert isinstance(verdict, pnp_messages.VerdictMessage)
            assert verdict.lease
            assert verdict.beat_period_ms == 1000
            answer = await spare.ask(pnp_messages.Beat(lease=verdict.lease).encode())
            assert answer == pnp_messages.BeatReply(configuration_version=1).encode()
            assert robot.state(0xA2) is PartState.ACTIVE

        await with_robot(robot, first, spare, play=play)

    run_virtual(scene())


def test_a_part_that_is_put_out_is_told_to_claim_again() -> None:
    async def scene() -> None:
        store = sample_store()
        robot = Robot(store)
        part = Visitor(robot, 0xA1)

        async def play() -> None:
            await part.claim("ABCD", 1)
            store.blocks[uid(1)] = "broken"
            robot.inventory.blocks_changed(asyncio.get_running_loop().time())
            assert await told(part) == [pnp_messages.BeatReply(configuration_version=0)]
            del store.blocks[uid(1)]
            assert await part.claim("ABCD", 1) is not None

        await with_robot(robot, part, play=play)

    run_virtual(scene())


def test_a_part_hears_when_its_partner_is_lost_and_when_one_is_back() -> None:
    async def scene() -> None:
        robot = Robot(sample_store())
        sender, receiver = Visitor(robot, 0xA1), Visitor(robot, 0xB1)

        async def play() -> None:
            await sender.claim("ABCD", 1)
            await receiver.claim("EFGH", 2)
            receiver.replies.clear()
            assert robot.agent.disconnect(0xA1, "pulled out")
            assert await told(receiver) == [
                pnp_messages.Notice(number=1, binding=1, kind=pnp_messages.NoticeKind.PARTNER_LOST)
            ]
            await asyncio.sleep(4.0)
            await receiver.claim("EFGH", 2)
            receiver.replies.clear()
            assert await sender.claim("ABCD", 1) is not None
            assert [pnp_messages.decode_reply(payload) for payload in receiver.replies] == [
                pnp_messages.Notice(number=1, binding=1, kind=pnp_messages.NoticeKind.PARTNER_BACK)
            ]

        await with_robot(robot, sender, receiver, play=play)

    run_virtual(scene())


def test_a_part_hears_only_of_the_port_whose_partner_is_lost() -> None:
    async def scene() -> None:
        store = sample_store()
        ports = (
            SlotBinding("other", "HelloWorldTopic_3_to_1", "HelloWorld", publishes=False),
            SlotBinding("echo", "HelloWorldTopic_1_to_2", "HelloWorld", publishes=True),
            SlotBinding("light", "HelloWorldTopic_1_to_2", "HelloWorld", publishes=False),
        )
        store.configurations["BB"] = Configuration(7, "BB", ports)
        robot = Robot(store)
        part = Visitor(robot, 0xB1)

        async def play() -> None:
            await part.claim("EFGH", 2)
            part.replies.clear()
            robot.service._partner_changed(0xB1, "HelloWorldTopic_1_to_2", is_there=False)
            assert await told(part) == [
                pnp_messages.Notice(number=7, binding=2, kind=pnp_messages.NoticeKind.PARTNER_LOST)
            ]

        await with_robot(robot, part, play=play)

    run_virtual(scene())


class Elsewhere:
    """An agent elsewhere, with one of the parts: keeps what it is told."""

    def __init__(self, key: int) -> None:
        self.key = key
        self.told: list[str] = []

    def has(self, key: int) -> bool:
        return key == self.key

    def answer(self, key: int, *, in_compat: bool, identity: bytes, body: bytes) -> bool:
        if key == self.key:
            self.told.append("answer")
        return key == self.key

    def tell_stop(self) -> None:
        self.told.append("stop")


def test_parts_at_an_agent_elsewhere_hear_of_stop_by_that_agent_and_the_rest_by_that_way() -> None:
    async def scene() -> None:
        robot = Robot(sample_store())
        there, here = Visitor(robot, 0xA1), Visitor(robot, 0xB1)

        async def play() -> None:
            await there.claim("ABCD", 1)
            await here.claim("EFGH", 2)
            elsewhere = Elsewhere(0xA1)
            robot.service.use_elsewhere(elsewhere)
            robot.service.stop_all("ada", "", 0)
            (stop,) = await told(here)
            assert isinstance(stop, pnp_messages.Notice)
            assert stop.kind == pnp_messages.NoticeKind.STOP
            assert await told(there) == []
            assert elsewhere.told == ["stop"]
            assert robot.service.identify(0xA1)
            assert elsewhere.told == ["stop", "answer"]
            assert await told(there) == []
            assert robot.service.identify(0xB1)
            assert len(await told(here)) == 1
            assert robot.service.go_all("ada") == 2
            assert elsewhere.told == ["stop", "answer", "stop"]
            assert await told(there) == []

        await with_robot(robot, there, here, play=play)

    run_virtual(scene())


def test_stop_reaches_all_parts_and_those_that_come_in_until_go() -> None:
    async def scene() -> None:
        robot = Robot(sample_store())
        early, late = Visitor(robot, 0xA1), Visitor(robot, 0xB1)
        stop = pnp_messages.Notice(number=1, binding=pnp_messages.NO_BINDING, kind=pnp_messages.NoticeKind.STOP)

        async def play() -> None:
            await early.claim("ABCD", 1)
            robot.service.stop_all("ann", "", 0)
            assert robot.service.stop.status().silent == ("AA",)
            assert await told(early) == [stop]
            verdict = await late.claim("EFGH", 2)
            assert verdict is not None
            late.client.write(
                late.requester, pnp_messages.ConfigurationRequest(lease=verdict.lease, have_version=0).encode()
            )
            assert stop in await told(late)
            early.replies.clear()
            assert robot.service.go_all("ann") == 2
            go = replace_kind(stop, pnp_messages.NoticeKind.GO)
            assert await told(late) == [go]
            assert [pnp_messages.decode_reply(payload) for payload in early.replies] == [go]
            assert not robot.service.stop.holds

        await with_robot(robot, early, late, play=play)

    run_virtual(scene())


def test_a_part_that_restarts_while_stop_holds_has_to_confirm_again() -> None:
    async def scene() -> None:
        robot = Robot(sample_store())
        part = Visitor(robot, 0xA1)

        async def play() -> None:
            verdict = await part.claim("ABCD", 1)
            assert verdict is not None
            robot.service.stop_all("ann", "", 0)
            await part.ask(pnp_messages.StoppedBeat(lease=verdict.lease, number=1).encode())

            def confirmed_and_silent() -> tuple[list[str], tuple[str, ...]]:
                status = robot.service.stop.status()
                return [one.part for one in status.confirmed], status.silent

            assert confirmed_and_silent() == (["AA"], ())
            again = await part.claim("ABCD", 1)
            assert again is not None
            assert again.lease == verdict.lease, "it only says again who it is"
            assert confirmed_and_silent() == (["AA"], ())
            claim = pnp_messages.ClaimMessage(part_number="ABCD", local_name="", uid=uid(1), session_nonce=2)
            reply = await part.ask(claim.encode())
            assert reply is not None
            assert confirmed_and_silent() == ([], ("AA",))

        await with_robot(robot, part, play=play)

    run_virtual(scene())


def test_stop_is_repeated_with_every_beat_and_go_with_the_next_three() -> None:
    async def scene() -> None:
        robot = Robot(sample_store())
        part = Visitor(robot, 0xA1)

        async def play() -> None:
            verdict = await part.claim("ABCD", 1)
            assert verdict is not None
            beat = pnp_messages.Beat(lease=verdict.lease).encode()

            async def kinds() -> list[int]:
                await part.ask(beat)
                replies = [pnp_messages.decode_reply(payload) for payload in part.replies]
                return [reply.kind for reply in replies if isinstance(reply, pnp_messages.Notice)]

            assert await kinds() == []
            robot.service.stop_all("ann", "", 0)
            assert pnp_messages.NoticeKind.STOP in await kinds()
            assert await kinds() == await kinds() == [pnp_messages.NoticeKind.STOP], (
                "a beat without its number confirms nothing"
            )
            assert robot.service.stop.status().silent == ("AA",)
            beat = pnp_messages.StoppedBeat(lease=verdict.lease, number=2).encode()
            assert await kinds() == [pnp_messages.NoticeKind.STOP], "another STOP"
            beat = pnp_messages.StoppedBeat(lease=verdict.lease, number=1).encode()
            assert await kinds() == []
            assert [one.part for one in robot.service.stop.status().confirmed] == ["AA"]
            robot.service.go_all("ann")
            assert pnp_messages.NoticeKind.GO in await kinds()
            assert await kinds() == [pnp_messages.NoticeKind.GO], "it has not heard of GO, as its beats say"
            beat = pnp_messages.Beat(lease=verdict.lease).encode()
            assert [await kinds() for _ in range(4)] == [[pnp_messages.NoticeKind.GO]] * 3 + [[]]

        await with_robot(robot, part, play=play)

    run_virtual(scene())


def replace_kind(notice: pnp_messages.Notice, kind: pnp_messages.NoticeKind) -> pnp_messages.Notice:
    return pnp_messages.Notice(number=notice.number, binding=notice.binding, kind=kind)


def test_one_part_is_asked_to_show_itself_and_a_stranger_cannot_be() -> None:
    async def scene() -> None:
        robot = Robot(sample_store())
        part = Visitor(robot, 0xA1)

        async def play() -> None:
            await part.claim("ABCD", 1)
            assert robot.service.identify(0xA1)
            assert [reply.kind for reply in await told(part) if isinstance(reply, pnp_messages.Notice)] == [
                pnp_messages.NoticeKind.IDENTIFY
            ]
            assert not robot.service.identify(0x77)

        await with_robot(robot, part, play=play)

    run_virtual(scene())


def test_an_original_program_is_told_nothing_that_it_did_not_ask_for() -> None:
    async def scene() -> None:
        store = sample_store()
        robot = Robot(store)
        visitor = Visitor(robot, 0xA1, ORIGINAL)

        async def play() -> None:
            assert await visitor.ask(thesis_messages.encode_request("ABCD", "ABCD-local")) is not None
            visitor.replies.clear()
            store.configurations["AA"] = configuration("AA", version=2)
            robot.inventory.configuration_changed("AA")
            robot.service.stop_all("ann", "", 0)
            assert robot.service.stop.status().silent == ("ABCD-local",), "it cannot confirm, so it is named"
            await asyncio.sleep(SOON_S)
            assert visitor.replies == []

        await with_robot(robot, visitor, play=play)

    run_virtual(scene())


def test_nobody_but_the_part_itself_is_told_and_a_session_opened_anew_asks_first() -> None:
    async def scene() -> None:
        store = sample_store()
        robot = Robot(store)
        first, second = Visitor(robot, 0xA1), Visitor(robot, 0xA2)

        async def play() -> None:
            await first.claim("ABCD", 1)
            await second.claim("WXYZ", 2)
            robot.agent.disconnect(0xA1, "restarted")
            await asyncio.sleep(4.0)
            first.replies.clear()
            second.replies.clear()
            store.configurations["AA"] = replace(configuration("AA"), version=9)
            robot.inventory.configuration_changed("AA")
            await asyncio.sleep(SOON_S)
            assert (first.replies, second.replies) == ([], [])
            assert not robot.service.identify(0xA1)

        await with_robot(robot, first, second, play=play)

    run_virtual(scene())


def test_who_can_be_told_is_bounded_and_the_others_find_out_with_their_beats(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("msbot.pnp.inventory_service.MOST_ASKERS", 1)

    async def scene() -> None:
        store = sample_store()
        robot = Robot(store)
        first, second = Visitor(robot, 0xA1), Visitor(robot, 0xB1)

        async def play() -> None:
            verdict = await first.claim("ABCD", 1)
            assert verdict is not None
            await second.claim("EFGH", 2)
            assert not robot.service.identify(0xA1)
            assert robot.service.identify(0xB1)
            store.configurations["AA"] = configuration("AA", version=2)
            robot.inventory.configuration_changed("AA")
            assert await told(first) == []
            answer = await first.ask(pnp_messages.Beat(lease=verdict.lease).encode())
            assert answer == pnp_messages.BeatReply(configuration_version=2).encode()

        await with_robot(robot, first, second, play=play)

    run_virtual(scene())


def test_a_stranger_is_neither_answered_nor_told_anything() -> None:
    async def scene() -> None:
        robot = Robot(sample_store())
        stranger = Visitor(robot, 0xA1)

        async def play() -> None:
            assert await stranger.claim("NOPE", 1) is None
            stranger.replies.clear()
            robot.service._partner_changed(0xA1, "HelloWorldTopic_3_to_1", is_there=False)
            assert await told(stranger) == []

        await with_robot(robot, stranger, play=play)

    run_virtual(scene())
