"""What a part says to the inventory, octet by octet, and when it reads on which stream."""

import asyncio
from functools import partial

from msbot.part.client.client import Client
from msbot.part.join import pnp_messages
from msbot.part.join.joining import Changed, ExpectedRobot, Joining, JoinState
from msbot.part.join.membership import Membership
from msbot.process.virtual_time import run_virtual
from msbot_xrce.messages import (
    STREAM_BEST_EFFORT,
    STREAM_RELIABLE,
    DeliveryControl,
    ObjectKind,
    ReadData,
    WriteData,
    iter_submessages,
)
from tests.part.wire import STATUS_AGENT_OK, HandLink

CLAIM = pnp_messages.ClaimMessage(part_number="ABCD", local_name="ABCD-local", uid=bytes(range(8)), session_nonce=1)
PROFILE = pnp_messages.ProfileMessage(index=1, message="ROBOT", name="V1", id="S1", dof="today", make="us")


def data(object_id: int, number: int, payload: bytes, request_id: int = 10) -> bytes:
    """A DATA submessage of the agent on the reliable stream."""
    length = (4 + len(payload)).to_bytes(2, "little")
    ids = request_id.to_bytes(2, "big") + object_id.to_bytes(2, "big")
    return b"\x81\x80" + number.to_bytes(2, "little") + b"\x09\x01" + length + ids + payload


def reply(
    number: int, message: pnp_messages.VerdictMessage | pnp_messages.BeatReply | pnp_messages.ConfigurationMessage
) -> bytes:
    """A reply of the inventory to whatever request."""
    return data(0x0017, number, b"\0\x11\0\x17" + message.encode())


def test_the_whole_way_to_active_and_the_beats() -> None:
    async def main() -> None:
        link = HandLink()
        changes: list[Changed] = []
        configurations: list[pnp_messages.ConfigurationMessage] = []
        membership = Membership(
            partial(Client, link, key=1),
            Joining(ExpectedRobot()),
            CLAIM,
            changed=changes.append,
            configure=configurations.append,
        )
        client = membership.client
        assert [ObjectKind(entity.variant.kind).name for entity in client.entities] == [
            "PARTICIPANT",
            "SUBSCRIBER",
            "TOPIC",
            "DATAREADER",
            "REQUESTER",
        ]
        requester = client.entities[-1]
        membership.start()
        running = asyncio.create_task(client.run())
        await asyncio.sleep(0.01)

        def written() -> list[bytes]:
            sent, link.sent = link.sent, []
            return [
                submessage.payload
                for packet in sent
                for submessage in iter_submessages(packet, 4)
                if isinstance(submessage, WriteData)
            ]

        def stream() -> int:
            assert requester.reading is not None
            return requester.reading.stream_id

        link.receive(STATUS_AGENT_OK)
        await asyncio.sleep(0)
        assert written() == []
        link.receive(data(0x0016, 0, PROFILE.encode()))
        await asyncio.sleep(0)
        assert written() == [CLAIM.encode()]
        assert stream() == STREAM_RELIABLE
        link.receive(reply(1, pnp_messages.VerdictMessage(lease=7, configuration_version=3, beat_period_ms=250)))
        await asyncio.sleep(0)
        assert written() == [pnp_messages.ConfigurationRequest(lease=7, have_version=0).encode()]
        configuration = pnp_messages.ConfigurationMessage(version=3, slot="A", bindings=[], settings=[])
        link.receive(reply(2, configuration))
        await asyncio.sleep(0.26)
        assert configurations == [configuration]
        assert stream() == STREAM_BEST_EFFORT
        assert membership.joining.state is JoinState.ACTIVE
        assert written() == [pnp_messages.Beat(lease=7).encode()]
        link.receive(reply(3, pnp_messages.BeatReply(configuration_version=4)))
        await asyncio.sleep(0)
        assert written() == [pnp_messages.ConfigurationRequest(lease=7, have_version=3).encode()]
        assert stream() == STREAM_RELIABLE
        link.receive(reply(4, pnp_messages.ConfigurationMessage(version=4, slot="A", bindings=[], settings=[])))
        assert stream() == STREAM_BEST_EFFORT
        membership.end("done")
        assert [change.after.value for change in changes] == [
            "recognising",
            "claiming",
            "configuring",
            "active",
            "ended",
        ]
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)

    run_virtual(main())


def test_where_many_share_a_bus_the_profile_is_read_once_and_after_another_robots_until_it_agrees() -> None:
    async def main() -> None:
        link = HandLink()
        joining = Joining(ExpectedRobot(name="ROBOT"))
        membership = Membership(
            partial(Client, link, key=1),
            joining,
            CLAIM,
            profile_once=True,
            changed=lambda _: None,
            configure=lambda _: None,
        )
        client = membership.client
        membership.start()
        running = asyncio.create_task(client.run())

        async def reads() -> list[DeliveryControl | None]:
            await asyncio.sleep(0.01)
            sent, link.sent = link.sent, []
            return [
                submessage.delivery
                for packet in sent
                for submessage in iter_submessages(packet, 4)
                if isinstance(submessage, ReadData) and submessage.object_id == 0x0016
            ]

        def state() -> JoinState:
            return joining.state

        def profile_of(name: str) -> bytes:
            return pnp_messages.ProfileMessage(
                index=1, message=name, name="V1", id="S1", dof="today", make="us"
            ).encode()

        await reads()
        link.receive(STATUS_AGENT_OK)
        assert await reads() == [None], "one sample"
        link.receive(data(0x0016, 0, profile_of("OTHER")))
        assert state() is JoinState.WRONG_ROBOT
        assert await reads() == [DeliveryControl()], "until it agrees"
        link.receive(data(0x0016, 1, profile_of("ANOTHER")))
        assert await reads() == []
        link.receive(data(0x0016, 2, profile_of("ROBOT")))
        assert state() is JoinState.CLAIMING
        assert await reads() == [DeliveryControl(max_samples=0)], "no more"
        client.reconnect("for the test")
        await asyncio.sleep(0.01)
        link.receive(b"\x82" + STATUS_AGENT_OK[1:])
        assert state() is JoinState.RECOGNISING
        assert await reads() == [None], "a new session, both steps anew"
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)

    run_virtual(main())


def test_a_refusal_with_a_code_of_the_future_still_has_words() -> None:
    async def main() -> None:
        link = HandLink()
        joining = Joining(ExpectedRobot())
        others: list[tuple[int, int, bytes]] = []
        membership = Membership(
            partial(Client, link, key=1),
            joining,
            CLAIM,
            changed=lambda _: None,
            configure=lambda _: None,
            on_topic=lambda *sample: others.append(sample),
        )
        client = membership.client
        membership.start()
        running = asyncio.create_task(client.run())
        await asyncio.sleep(0.01)
        link.receive(STATUS_AGENT_OK)
        link.receive(data(0x0016, 0, PROFILE.encode()))
        link.receive(
            reply(1, pnp_messages.VerdictMessage(lease=0, configuration_version=0, beat_period_ms=0, reason=99))
        )
        assert joining.state is JoinState.REFUSED
        assert joining.reason == "refused for reason 99, which this version does not know"
        assert others == []
        topic = client.create_topic(membership.participant, "T", "Text")
        reader = client.create_reader(membership.subscriber, topic)
        link.receive(data(reader.object_id, 2, b"not the profile"))
        assert others == [(reader.object_id, 10, b"not the profile")]
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)

    run_virtual(main())


def test_a_master_cannot_make_a_part_beat_without_a_pause() -> None:
    async def main() -> None:
        link = HandLink()
        joining = Joining(ExpectedRobot())
        membership = Membership(
            partial(Client, link, key=1), joining, CLAIM, changed=lambda _: None, configure=lambda _: None
        )
        client = membership.client
        membership.start()
        running = asyncio.create_task(client.run())
        await asyncio.sleep(0.01)
        link.receive(STATUS_AGENT_OK)
        link.receive(data(0x0016, 0, PROFILE.encode()))
        link.receive(reply(1, pnp_messages.VerdictMessage(lease=7, configuration_version=3, beat_period_ms=0)))
        await asyncio.sleep(0)
        link.sent.clear()
        await asyncio.sleep(0.2)
        beats = [
            submessage
            for packet in link.sent
            for submessage in iter_submessages(packet, 4)
            if isinstance(submessage, WriteData) and len(submessage.payload) == 4
        ]
        assert 8 <= len(beats) <= 10
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)

    run_virtual(main())
