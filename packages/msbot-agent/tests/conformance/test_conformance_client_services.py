"""Conformance case 93 (and 79, 81, 87 once more) against the `Client` that parts use: what its callbacks are told."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

from msbot.part.client.client import ServiceNames
from msbot.part.client.client_settings import ConnectionState
from msbot.process.virtual_time import run_virtual
from tests.conformance.agent_rig import WELCOME, acknack, octets, packets
from tests.hearing_client import HearingClient
from tests.part.wire import HandLink

SERVICE = ServiceNames("svc", "ReqT", "RepT")
IDENTITY = "01 02 03 04 05 06 07 08 09 0a 0b 0c 00 00 01 03 00 00 00 00 07 00 00 00"

Scenario = Callable[[HearingClient, HandLink], Awaitable[None]]


def play(scenario: Scenario) -> None:
    """Run a scenario with a client in an open session, in virtual time."""

    async def main() -> None:
        link = HandLink()
        client = HearingClient(link, key=0xAABBCCDD)
        running = asyncio.create_task(client.run())
        await asyncio.sleep(0.01)
        link.receive(octets(WELCOME))
        await asyncio.sleep(0)
        link.take()
        assert client.state is ConnectionState.CONNECTED
        try:
            await scenario(client, link)
        finally:
            running.cancel()
            await asyncio.gather(running, return_exceptions=True)

    run_virtual(main())


async def turn() -> None:
    for _ in range(3):
        await asyncio.sleep(0)


def test_case_93_reply_for_a_requester_carries_its_request_id() -> None:
    async def scenario(client: HearingClient, link: HandLink) -> None:
        told: list[tuple[int, int, bytes]] = []
        client.on_reply = lambda *reply: told.append(reply)
        requester = client.create_requester(client.create_participant("p"), SERVICE)
        client.read(requester)
        request_id = client.write(requester, b"1+2?")
        await turn()
        link.receive(
            octets(
                f"81 80 00 00 09 01 0c 00 00 0c {requester.object_id:04x} {request_id:04x}"
                f"{requester.object_id:04x} 33 00 00 00"
            )
        )
        assert told == [(requester.object_id, request_id, b"3\0\0\0")]

    play(scenario)


def test_case_93_identity_of_a_request_is_returned_unchanged_in_the_reply() -> None:
    async def scenario(client: HearingClient, link: HandLink) -> None:
        told: list[tuple[int, int, bytes, bytes]] = []
        client.on_request = lambda *request: told.append(request)
        replier = client.create_replier(client.create_participant("p"), SERVICE)
        client.read(replier)
        await turn()
        link.receive(octets(f"81 80 00 00 09 01 20 00 00 24 00 18 {IDENTITY} 31 2b 32 3f"))
        assert told == [(0x0018, 0x24, octets(IDENTITY), b"1+2?")]
        await turn()
        link.take()
        request_id = client.reply(replier, told[0][2], b"3")
        await turn()
        (packet,) = link.take()
        assert packet[8:] == octets(f"07 01 1d 00 {request_id:04x} 00 18 {IDENTITY} 33 00 00 00").hex()

    play(scenario)


def test_case_93_reply_without_its_prefix_is_dropped() -> None:
    async def scenario(client: HearingClient, link: HandLink) -> None:
        participant = client.create_participant("p")
        client.read(client.create_requester(participant, SERVICE))
        client.read(client.create_replier(participant, SERVICE))
        await turn()
        link.receive(octets("81 01 00 00 09 01 06 00 00 24 00 17 00 00"))
        link.receive(octets("81 01 01 00 09 01 08 00 00 24 00 18 00 00 00 00"))
        assert client.counters.dropped == 2

    play(scenario)


def test_case_79_statuses_of_creations_are_told_to_who_waits() -> None:
    async def scenario(client: HearingClient, link: HandLink) -> None:
        told: list[tuple[int, int, int]] = []
        client.on_status = lambda *status: told.append(status)
        client.create_participant("p")
        await turn()
        link.take()
        link.receive(octets("81 80 00 00 05 01 06 00 00 0a 00 11 00 00"))
        await client.until_all_statuses()
        await turn()
        assert told == [(0x000A, 0x0011, 0)]
        assert link.take() == packets(acknack(1))

    play(scenario)


def test_case_87_the_agents_question_is_answered_within_100_ms() -> None:
    async def scenario(client: HearingClient, link: HandLink) -> None:
        link.receive(octets("81 00 00 00 02 01 08 00 00 00 ff fe 01 00 00 00"))
        await asyncio.sleep(0.1)
        assert packets("81 00 00 00 06 01 08 00 00 00 ff fe 00 00 00 00") == link.take()
        assert client.state is ConnectionState.CONNECTED

    play(scenario)
