"""A session that keeps itself open: byte for byte, second for second, with the test as the agent."""

import asyncio
from collections.abc import Awaitable, Callable

import pytest

from msbot.part.client.client_settings import ClientSettings, ConnectionState
from msbot.process.virtual_time import run_virtual
from msbot_agent.link import Signal
from msbot_xrce.errors import ConfigError, LinkDown, LinkFull, LocalProtocolError, RequestError
from tests.hearing_client import HearingClient
from tests.part.wire import STATUS_AGENT_OK, HandLink

LOGIN_81 = "8000000000011000585243450100010faabbccdd8100fc01"
LOGIN_82 = "8000000000011000585243450100010faabbccdd8200fc01"
STATUS_AGENT_OK_82 = bytes.fromhex("8200000004010b000000585243450100010f00")
PING = "8100000002010800000afffd02000000"
PONG = "8100000006011c00000afffd0001010d585243450100010f00010d00010000000000000000"[:-2]
PONG_UNKNOWN = PONG[:24] + "0000" + PONG[28:]
DELETE_SESSION = "81000000030104000002fffe"
SESSION_DELETED = "81000000050106000002fffe0000"

Scenario = Callable[[HearingClient, HandLink, list[tuple[float, str, str]]], Awaitable[None]]


def play(scenario: Scenario, settings: ClientSettings | None = None) -> list[tuple[float, str, str]]:
    """Run a client on a hand-held link; returns (time, state, reason) of every change."""
    changes: list[tuple[float, str, str]] = []

    async def main() -> None:
        link = HandLink()
        client = HearingClient(link, key=0xAABBCCDD, settings=settings)
        loop = asyncio.get_running_loop()
        client.on_state = lambda state, reason: changes.append((round(loop.time(), 3), state.value, reason))
        running = loop.create_task(client.run())
        await asyncio.sleep(0)
        await asyncio.sleep(0)
        try:
            await scenario(client, link, changes)
        finally:
            running.cancel()
            await asyncio.gather(running, return_exceptions=True)

    run_virtual(main())
    return changes


async def open_session(link: HandLink) -> None:
    link.receive(STATUS_AGENT_OK)
    await asyncio.sleep(0.01)
    link.take()


def acknack(first: int, missing: int = 0) -> bytes:
    """The agent has everything before `first`; of what follows, the bits of `missing` are missing."""
    return b"\x81\0\0\0\x0a\x01\x05\0" + first.to_bytes(2, "little") + missing.to_bytes(2, "big") + b"\x80"


def test_the_login_is_what_a_c_client_sends_and_is_repeated() -> None:
    async def scenario(client: HearingClient, link: HandLink, changes: list[tuple[float, str, str]]) -> None:
        assert link.take() == [LOGIN_81]
        await asyncio.sleep(1.1)
        assert link.take() == [LOGIN_81, LOGIN_81]
        assert client.state.value == "connecting"
        link.receive(STATUS_AGENT_OK)
        assert client.state.value == "connected"
        assert client.counters.logins == 1
        await client.connect(0.1)

    assert play(scenario)[0] == (1.1, "connected", "session open on hand")


def test_without_an_answer_it_is_lost_and_goes_on_trying() -> None:
    async def scenario(client: HearingClient, link: HandLink, changes: list[tuple[float, str, str]]) -> None:
        with pytest.raises(RequestError, match=r"no session on hand within 5\.2 s"):
            await client.connect(5.2)
        assert len(link.take()) == 11
        link.receive(STATUS_AGENT_OK)
        assert client.state is ConnectionState.CONNECTED

    assert [(at, state) for at, state, _ in play(scenario)] == [(2.0, "lost"), (5.2, "connected"), (5.2, "closed")]


def test_a_refusal_is_told_in_words_and_tried_again_later() -> None:
    async def scenario(client: HearingClient, link: HandLink, changes: list[tuple[float, str, str]]) -> None:
        link.take()
        link.receive("8100000004010b008600585243450100010f00")
        await asyncio.sleep(0.7)
        assert link.take() == []
        await asyncio.sleep(0.6)
        assert link.take()[0] == LOGIN_81

    assert play(scenario)[0] == (0.0, "lost", "the agent refused the session: another major version of the protocol")


def test_a_silent_agent_is_pinged_and_an_answer_keeps_the_session() -> None:
    async def scenario(client: HearingClient, link: HandLink, changes: list[tuple[float, str, str]]) -> None:
        await open_session(link)
        await asyncio.sleep(2.0)
        assert link.take() == [PING]
        link.receive(PONG)
        await asyncio.sleep(1.9)
        assert link.take() == []
        assert client.state is ConnectionState.CONNECTED

    play(scenario)


def test_an_agent_that_acknowledges_is_not_pinged() -> None:
    async def scenario(client: HearingClient, link: HandLink, changes: list[tuple[float, str, str]]) -> None:
        await open_session(link)
        for _ in range(5):
            await asyncio.sleep(1.9)
            link.receive("810000000a0105000000000080")
        assert link.take() == []
        # What belongs to another session is no sign of life.
        await asyncio.sleep(1.0)
        link.receive("820000000a0105000000000080")
        await asyncio.sleep(1.0)
        assert link.take() == [PING]

    play(scenario)


def test_a_dead_agent_is_noticed_and_the_next_session_has_another_id() -> None:
    async def scenario(client: HearingClient, link: HandLink, changes: list[tuple[float, str, str]]) -> None:
        await open_session(link)
        await asyncio.sleep(2.7)
        assert link.take() == [PING, PING, PING, LOGIN_82]
        link.receive(STATUS_AGENT_OK)
        assert client.state.value == "lost"
        link.receive(STATUS_AGENT_OK_82)
        assert client.state.value == "connected"
        link.receive("8201000009010800000a001600000000")
        link.receive("8101000009010800000a001600000000")
        assert client.counters.dropped == 1

    changes = play(scenario)
    assert (2.6, "lost", "the agent does not answer any more") in changes


def test_an_agent_that_has_forgotten_us_is_logged_in_to_at_once() -> None:
    async def scenario(client: HearingClient, link: HandLink, changes: list[tuple[float, str, str]]) -> None:
        await open_session(link)
        client.check_agent()
        await asyncio.sleep(0.001)
        assert link.take() == [PING]
        link.receive(PONG_UNKNOWN)
        await asyncio.sleep(0.001)
        assert link.take() == [LOGIN_82]

    assert play(scenario)[1] == (0.011, "lost", "the agent does not know this session any more")


def test_an_agent_that_begins_the_session_anew_for_a_late_login_is_logged_in_to_at_once() -> None:
    async def scenario(client: HearingClient, link: HandLink, changes: list[tuple[float, str, str]]) -> None:
        link.receive(STATUS_AGENT_OK)
        link.receive(STATUS_AGENT_OK)
        assert client.state is ConnectionState.CONNECTED, "a mere copy: nothing was sent yet"
        client.create_participant("p")
        await asyncio.sleep(0.01)
        link.take()
        link.receive("810000000a0105000100000080")
        link.receive(STATUS_AGENT_OK)
        await asyncio.sleep(0)
        assert link.take() == ["810000000b0105000000000080"], "is it a copy? Which message does the agent expect?"
        link.receive("810000000a0105000000010080")
        await asyncio.sleep(0)
        assert link.take() == [LOGIN_82]
        link.receive(STATUS_AGENT_OK_82)
        assert client.state is ConnectionState.CONNECTED

    reason = "the agent has started the session over: a late login has reached it"
    assert play(scenario)[1] == (0.01, "lost", reason)


def test_ping_measures_and_tells_whether_we_are_known() -> None:
    async def scenario(client: HearingClient, link: HandLink, changes: list[tuple[float, str, str]]) -> None:
        await open_session(link)
        asking = asyncio.create_task(client.ping())
        await asyncio.sleep(0.05)
        link.receive(PONG)
        answer = await asking
        assert answer.agent_knows_us
        assert answer.round_trip_s == pytest.approx(0.05)
        with pytest.raises(RequestError, match=r"no answer to a ping within 0\.1 s"):
            await client.ping(0.1)

    play(scenario)


def test_time_synchronisation_follows_the_formula() -> None:
    async def scenario(client: HearingClient, link: HandLink, changes: list[tuple[float, str, str]]) -> None:
        await open_session(link)
        asking = asyncio.create_task(client.sync_time())
        await asyncio.sleep(0.05)
        (question,) = link.take()
        transmit = question[16:32]
        ahead = (int.from_bytes(bytes.fromhex(transmit[:8]), "little") + 5).to_bytes(4, "little").hex() + transmit[8:]
        link.receive("810000000f011800" + ahead + ahead + transmit)
        measured = await asking
        assert measured.offset_ns == pytest.approx(-5e9, abs=measured.round_trip_ns / 2 + 1)
        with pytest.raises(RequestError, match="no answer to a time request"):
            await client.sync_time(0.1)

    play(scenario)


def test_broken_packets_are_counted_and_harm_nobody() -> None:
    async def scenario(client: HearingClient, link: HandLink, changes: list[tuple[float, str, str]]) -> None:
        await open_session(link)
        for packet in (b"", b"\x81", b"\x81\x00\x00", b"\x00\x00\x00\x00\x01"):
            link.receive(packet)
        assert client.counters.dropped == 4
        assert client.state is ConnectionState.CONNECTED

    play(scenario)


def test_packets_wait_for_room_on_the_link() -> None:
    async def scenario(client: HearingClient, link: HandLink, changes: list[tuple[float, str, str]]) -> None:
        await open_session(link)
        link.room = False
        client.create_participant("x")
        await asyncio.sleep(0.5)
        assert link.take() == []
        link.give_room()
        await asyncio.sleep(0.001)
        assert len(link.take()) == 1

    play(scenario)


@pytest.mark.parametrize("failure", [LinkFull("full"), LinkDown("down")])
def test_a_link_that_refuses_a_packet_gets_it_again(failure: Exception) -> None:
    async def scenario(client: HearingClient, link: HandLink, changes: list[tuple[float, str, str]]) -> None:
        link.take()
        link.failure = failure
        await asyncio.sleep(0.6)
        assert link.take() == []
        link.failure = None
        await asyncio.sleep(0.6)
        assert link.take() == [LOGIN_81]

    play(scenario)


def test_a_link_without_its_peer_waits() -> None:
    async def scenario(client: HearingClient, link: HandLink, changes: list[tuple[float, str, str]]) -> None:
        link.take()
        link.remote = None
        await asyncio.sleep(0.6)
        assert link.take() == []
        link.remote = 0
        await asyncio.sleep(0.5)
        assert link.take() == [LOGIN_81]

    play(scenario)


def test_a_pulled_cable_is_told_and_the_link_opened_again() -> None:
    async def scenario(client: HearingClient, link: HandLink, changes: list[tuple[float, str, str]]) -> None:
        await open_session(link)
        link.breaks.put_nowait(LinkDown("the adapter has gone"))
        await asyncio.sleep(0.5)
        assert client.state is ConnectionState.LOST
        assert link.runs == 1
        await asyncio.sleep(0.6)
        assert link.runs == 2
        link.breaks.put_nowait(None)
        await asyncio.sleep(1.1)
        assert link.runs == 3

    assert (0.01, "lost", "the adapter has gone") in play(scenario)


def test_a_link_that_never_worked_ends_the_client_with_its_reason() -> None:
    async def main() -> None:
        link = HandLink()
        link.breaks.put_nowait(LinkDown("no such host"))
        client = HearingClient(link, key=1)
        with pytest.raises(LinkDown, match="no such host"):
            await client.run()
        assert client.state is ConnectionState.CLOSED
        with pytest.raises(LocalProtocolError):
            client.write(client.create_participant("x"), b"")

    run_virtual(main())


@pytest.mark.parametrize("signal", [Signal.LINK_DOWN, Signal.PEER_GONE])
def test_a_link_that_says_the_peer_is_gone_is_believed(signal: Signal) -> None:
    async def scenario(client: HearingClient, link: HandLink, changes: list[tuple[float, str, str]]) -> None:
        heard: list[Signal] = []
        client.on_signal = lambda signal, *_: heard.append(signal)
        await open_session(link)
        link.signal(signal, "unplugged")
        assert heard == [signal]
        await asyncio.sleep(0)
        assert client.state is ConnectionState.LOST
        assert link.take() == [LOGIN_82]
        link.signal(Signal.PEER_JOINED)
        await asyncio.sleep(0.001)
        assert link.take() == [LOGIN_82]

    assert (0.01, "lost", "unplugged") in play(scenario)


def test_a_stop_signal_is_passed_on_and_changes_nothing() -> None:
    async def scenario(client: HearingClient, link: HandLink, changes: list[tuple[float, str, str]]) -> None:
        heard: list[str] = []
        client.on_signal = lambda _signal, _peer, reason, _now: heard.append(reason)
        await open_session(link)
        link.signal(Signal.STOP, "button")
        assert heard == ["button"]
        assert client.state is ConnectionState.CONNECTED

    play(scenario)


def test_closing_deletes_the_session_and_ends_run() -> None:
    async def scenario(client: HearingClient, link: HandLink, changes: list[tuple[float, str, str]]) -> None:
        await open_session(link)
        closing = asyncio.create_task(client.close())
        await asyncio.sleep(0.001)
        assert link.take() == [DELETE_SESSION]
        assert not client.has_room()
        with pytest.raises(LocalProtocolError):
            client.write(client.create_participant("x"), b"")
        link.receive(SESSION_DELETED)
        await closing
        client.close_soon()

    assert play(scenario)[-1] == (0.011, "closed", "closed")


def test_closing_does_not_wait_for_ever() -> None:
    async def scenario(client: HearingClient, link: HandLink, changes: list[tuple[float, str, str]]) -> None:
        await open_session(link)
        await client.close()

    assert play(scenario)[-1] == (1.01, "closed", "closed")


async def write_twice(client: HearingClient, link: HandLink) -> None:
    """Have two messages on their way that nobody has acknowledged."""
    await open_session(link)
    entity = client.create_participant("x")
    await asyncio.sleep(0.001)
    client.write(entity, b"last words")
    await asyncio.sleep(0.001)
    assert len(link.take()) == 2


def test_a_goodbye_waits_until_the_agent_has_heard_everything() -> None:
    async def scenario(client: HearingClient, link: HandLink, changes: list[tuple[float, str, str]]) -> None:
        await write_twice(client, link)
        client.close_soon(deliver_s=3.0)
        await asyncio.sleep(0.5)
        sent = link.take()
        assert DELETE_SESSION not in sent
        assert sent, "the agent is asked what it has heard"
        link.receive(acknack(first=1, missing=1))
        await asyncio.sleep(0.001)
        (again,) = link.take()
        assert bytes("last words", "ascii").hex() in again
        link.receive(acknack(first=2))
        await asyncio.sleep(0.001)
        assert link.take() == [DELETE_SESSION]
        assert client.was_heard
        link.receive(SESSION_DELETED)

    assert play(scenario)[-1] == (0.514, "closed", "closed")


def test_a_goodbye_does_not_wait_for_ever_for_an_agent_that_hears_nothing() -> None:
    async def scenario(client: HearingClient, link: HandLink, changes: list[tuple[float, str, str]]) -> None:
        await write_twice(client, link)
        client.close_soon(deliver_s=1.0)
        await asyncio.sleep(0.999)
        assert DELETE_SESSION not in link.take()
        await asyncio.sleep(0.002)
        assert link.take()[0] == DELETE_SESSION
        assert not client.was_heard
        await client.close()

    assert play(scenario)[-1] == (2.012, "closed", "closed")


def test_a_session_that_is_lost_while_its_goodbye_waits_needs_none() -> None:
    async def scenario(client: HearingClient, link: HandLink, changes: list[tuple[float, str, str]]) -> None:
        await write_twice(client, link)
        client.close_soon(deliver_s=3.0)
        link.signal(Signal.LINK_DOWN, "unplugged")
        await client.close()
        assert link.take() == []
        assert not client.was_heard

    assert play(scenario)[-1] == (0.012, "closed", "closed")


def test_closing_without_a_session_is_immediate() -> None:
    async def scenario(client: HearingClient, link: HandLink, changes: list[tuple[float, str, str]]) -> None:
        await client.close()
        await client.close()

    assert play(scenario) == [(0.0, "closed", "closed")]


def test_closing_a_client_that_does_not_run_is_nothing() -> None:
    async def main() -> None:
        await HearingClient(HandLink(), key=1).close()

    run_virtual(main())


def test_session_ids_below_80_carry_the_key() -> None:
    async def scenario(client: HearingClient, link: HandLink, changes: list[tuple[float, str, str]]) -> None:
        assert link.take() == ["00000000aabbccdd00011000585243450100010faabbccdd0100fc01"]
        link.receive("01000000aabbccdd04010b000000585243450100010f00")
        assert client.state is ConnectionState.CONNECTED

    play(scenario, ClientSettings(session_id=1))


@pytest.mark.parametrize("session_id", [0, 0x7F, 0x80, 0xFF])
def test_session_ids_that_cannot_take_turns_are_refused(session_id: int) -> None:
    with pytest.raises(ConfigError, match="choose 0x01 to 0x7E or 0x81 to 0xFE"):
        ClientSettings(session_id=session_id)


@pytest.mark.parametrize("key", [0, -1, 1 << 32])
def test_keys_out_of_range_are_refused(key: int) -> None:
    with pytest.raises(LocalProtocolError, match="choose 1 to 0xFFFFFFFF"):
        HearingClient(HandLink(), key=key)


def test_a_time_limit_of_the_caller_is_not_swallowed() -> None:
    async def main() -> None:
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(0.1):
                await HearingClient(HandLink(), key=1).run()

    run_virtual(main())
