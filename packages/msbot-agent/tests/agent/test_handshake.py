"""Messages outside of a session, octet by octet (conformance cases 1 to 22 of the reference)."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

import pytest

from msbot.process.virtual_time import run_virtual
from msbot_agent.agent import Agent, AgentSettings, ClientInfo, Gate, OpenGate
from msbot_agent.agent.handshake import LATE_LOGIN, LONGEST_NUMBER, RECENT_LOGINS, dead_after_s, wants_echo
from msbot_agent.space import MemorySpace
from msbot_xrce import Status
from msbot_xrce.messages import CreateClient, Header, LoginProperty, encode_message
from tests.agent.wiring import FakeLink, serving

PING = "80 00 00 00 02 01 08 00 00 0a ff fd 02 00 00 00"
PONG = (
    "80 00 00 00 06 01 1c 00 00 0a ff fd 00 {known:02x} 01 0d 58 52 43 45 01 00 01 0f 00"
    "01 0d 00 01 00 00 00 00 00 00 00"
)
OK = "81 00 00 00 04 01 0b 00 00 00 58 52 43 45 01 00 01 0f 00"
PARTICIPANT = "{session:02x} 80 {number:02x} 00 01 {flags:02x} 10 00 00 0a 00 11 01 03 00 00 02 00 00 00 00 00 00 00"


def login(key: str = "aa bb cc dd", *, session: str = "81", mtu: str = "fc 01", header: str = "80 00 00 00") -> bytes:
    return octets(f"{header} 00 01 10 00 58 52 43 45 01 00 01 0f {key} {session} 00 {mtu}")


def octets(text: str) -> bytes:
    return bytes.fromhex(text)


class Dialogue:
    """An agent on a fake link; what is said is answered in the same turn."""

    def __init__(self, link: FakeLink, agent: Agent) -> None:
        self.link = link
        self.agent = agent

    async def say(self, packet: bytes | str, peer: str = "client") -> list[str]:
        """The agent's answers in hex."""
        self.link.inject(octets(packet) if isinstance(packet, str) else packet, peer)
        await turn()
        return [answer.hex(" ") for answer in self.link.take_sent(peer)]


async def turn() -> None:
    for _ in range(3):
        await asyncio.sleep(0)


def run(
    scenario: Callable[[Dialogue], Awaitable[None]], *, gate: Gate | None = None, settings: AgentSettings | None = None
) -> None:
    """Run `scenario(dialogue)` in virtual time."""

    async def main() -> None:
        agent = Agent(MemorySpace(), gate=gate, settings=settings)
        async with serving(agent) as link:
            await scenario(Dialogue(link, agent))

    run_virtual(main())


def plain(text: str) -> str:
    """Hex with single blanks."""
    return octets(text).hex(" ")


@pytest.mark.parametrize(
    ("request_packet", "status"),
    [
        (login(), 0x00),
        ("80 00 00 00 00 01 10 00 58 52 43 46 01 00 01 0f aa bb cc 01 81 00 fc 01", 0x85),
        ("80 00 00 00 00 01 10 00 58 52 43 45 02 00 01 0f aa bb cc 02 81 00 fc 01", 0x86),
        ("80 00 00 00 00 01 10 00 58 52 43 45 01 09 01 0f aa bb cc 03 81 00 fc 01", 0x00),
        (login("00 00 00 00"), 0x85),
        ("80 00 00 00 00 01 10 00 58 52 43 45 01 00 de ad aa bb cc 05 81 00 fc 01", 0x00),
        ("80 00 00 00 00 00 00 10 58 52 43 45 01 00 01 0f aa bb cc 06 81 00 01 fc", 0x00),
        (login(mtu="08 00"), 0x85),
        (login(mtu="17 00"), 0x85),
        (login(mtu="18 00"), 0x00),
    ],
    ids=["plain", "cookie", "major", "minor", "key 0", "vendor", "big endian", "mtu 8", "mtu 23", "mtu 24"],
)
def test_login_is_answered_with_a_status(request_packet: bytes | str, status: int) -> None:
    async def scenario(dialogue: Dialogue) -> None:
        answer = plain(f"81 00 00 00 04 01 0b 00 {status:02x} 00 58 52 43 45 01 00 01 0f 00")
        assert await dialogue.say(request_packet) == [answer]
        assert len(dialogue.agent.clients()) == (status == 0)

    run(scenario)


def test_login_with_key_in_the_header_is_answered_with_it() -> None:
    async def scenario(dialogue: Dialogue) -> None:
        packet = login("aa bb cc 07", session="01", header="00 00 00 00 aa bb cc 07")
        answer = plain("01 00 00 00 aa bb cc 07 04 01 0b 00 00 00 58 52 43 45 01 00 01 0f 00")
        assert await dialogue.say(packet) == [answer]

    run(scenario)


def test_answer_to_login_copies_stream_and_number() -> None:
    async def scenario(dialogue: Dialogue) -> None:
        assert (await dialogue.say(login(header="80 01 05 00")))[0].startswith("81 01 05 00 04 01 0b 00 00")

    run(scenario)


def numbered(number: str, key: int = 0xAABBCCDD, session: int = 0x81) -> bytes:
    """A login with a number, as parts of MsBOT send it."""
    request = CreateClient(key, session, 512, (("uxr_sm", "1"), (LoginProperty.NUMBER, number)))
    return encode_message(Header(0x80), [request], pad_end=False)


def answered(status: Status, session: int = 0x81) -> str:
    return plain(f"{session:02x} 00 00 00 04 01 0b 00 {status:02x} 00 58 52 43 45 01 00 01 0f 00")


async def is_started_over(dialogue: Dialogue, peer: str = "client") -> bool:
    """Whether the agent expects the first message of the reliable stream (again)."""
    (acknack,) = await dialogue.say("81 00 00 00 0b 01 05 00 00 00 ff ff 80", peer)
    assert acknack.startswith("81 00 00 00 0a 01 05 00")
    return acknack[24:29] == "00 00"


def test_a_copy_of_a_login_with_a_number_is_answered_and_starts_nothing_over() -> None:
    async def scenario(dialogue: Dialogue) -> None:
        assert await dialogue.say(numbered("7")) == [answered(Status.OK)]
        await dialogue.say(PARTICIPANT.format(session=0x81, number=0, flags=1))
        for _ in range(2):
            assert await dialogue.say(numbered("7")) == [answered(Status.OK_MATCHED)]
            assert not await is_started_over(dialogue)
        # A program that starts again draws another number; a C client has none, so each of its logins is a new one.
        assert await dialogue.say(numbered("8")) == [answered(Status.OK)]
        assert await is_started_over(dialogue)
        for _ in range(2):
            await dialogue.say(PARTICIPANT.format(session=0x81, number=0, flags=1))
            assert not await is_started_over(dialogue)
            assert await dialogue.say(login()) == [plain(OK)]
            assert await is_started_over(dialogue)

    run(scenario)


@pytest.mark.parametrize("again", ["81", "82"], ids=["same session id", "the other session id"])
def test_an_older_login_that_comes_after_a_newer_one_is_not_obeyed(again: str) -> None:
    async def scenario(dialogue: Dialogue) -> None:
        session = int(again, 16)
        await dialogue.say(numbered("7"))
        assert await dialogue.say(numbered("8", session=session)) == [answered(Status.OK, session)]
        packet = PARTICIPANT.format(session=session, number=0, flags=1)
        assert (await dialogue.say(packet))[0].startswith(f"{again} 80 00 00 05 01 06 00")
        assert await dialogue.say(numbered("7")) == []
        (client,) = dialogue.agent.clients()
        assert client.session_id == session
        assert len(client.objects) == 1
        assert dialogue.agent.dropped() == {LATE_LOGIN: 1}
        # It is known as long as the session knows it; then it is a login like any other.
        for number in range(9, 9 + RECENT_LOGINS):
            await dialogue.say(numbered(str(number), session=session))
        assert await dialogue.say(numbered("7")) == [answered(Status.OK)]

    run(scenario)


def test_a_number_that_is_too_long_is_none() -> None:
    async def scenario(dialogue: Dialogue) -> None:
        for number, second in (("7" * LONGEST_NUMBER, Status.OK_MATCHED), ("7" * (LONGEST_NUMBER + 1), Status.OK)):
            assert await dialogue.say(numbered(number)) == [answered(Status.OK)]
            assert await dialogue.say(numbered(number)) == [answered(second)]

    run(scenario)


def test_a_login_is_a_copy_only_from_its_own_address_and_key() -> None:
    async def scenario(dialogue: Dialogue) -> None:
        await dialogue.say(numbered("7"))
        await dialogue.say(PARTICIPANT.format(session=0x81, number=0, flags=1))
        assert await dialogue.say(numbered("7"), "elsewhere") == [answered(Status.OK)]
        assert await is_started_over(dialogue, "elsewhere")
        other = numbered("7", key=0xAABBCCDE)
        assert await dialogue.say(other, "elsewhere") == [answered(Status.OK)]
        assert [client.key for client in dialogue.agent.clients()] == [0xAABBCCDE]

    run(scenario)


@pytest.mark.parametrize(
    "packet",
    [
        "",
        "80 00 00",
        "80 00 00 00",
        "80 00 00 00 02",
        "00 00 00 00 aa bb",
        "80 00 00 00 00 01 10 00 58 52 43 45 01 00",
        "81 00 00 00 00 01 10 00 58 52 43 45 01 00 01 0f aa bb cc 09 81 00 fc 01",
        "80 00 00 00 00 01 10 00 58 52 43 45 01 00 01 0f dd 00 00 04 81 02 fc 01",
        "80 00 00 00 02 01 08 00 00 0a",
        "80 00 00 00 0b 01 05 00 00 00 00 00 80",
        PARTICIPANT.format(session=0x81, number=0, flags=1),
        "81 80 00 00 08 01 10 00 00 0c 00 16 80 00 00 01 ff ff 00 00 00 00 00 00",
        "80 00 00 00 03 01 04 00 00 02 00 11",
        "01 00 00 00",
    ],
)
def test_anything_else_is_met_with_silence_and_counted(packet: str) -> None:
    async def scenario(dialogue: Dialogue) -> None:
        assert await dialogue.say(packet) == []
        assert sum(dialogue.agent.dropped().values()) == 1
        assert await dialogue.say(PING) == [plain(PONG.format(known=0))]

    run(scenario)


def test_ping_tells_whether_the_address_has_a_session() -> None:
    async def scenario(dialogue: Dialogue) -> None:
        assert await dialogue.say(PING) == [plain(PONG.format(known=0))]
        await dialogue.say(login())
        assert await dialogue.say(PING) == [plain(PONG.format(known=1))]
        in_session = await dialogue.say(PING.replace("80", "81", 1))
        assert in_session == [plain(PONG.format(known=1).replace("80", "81", 1))]
        assert await dialogue.say(PING, "elsewhere") == [plain(PONG.format(known=0))]

    run(scenario)


def test_only_the_first_question_outside_of_a_session_is_answered() -> None:
    async def scenario(dialogue: Dialogue) -> None:
        assert len(await dialogue.say(PING + "02 01 08 00 00 0b ff fd 02 00 00 00")) == 1

    run(scenario)


def test_ping_with_a_key_in_the_header_gets_it_back() -> None:
    async def scenario(dialogue: Dialogue) -> None:
        answer = await dialogue.say("00 00 00 00 01 02 03 04 02 01 08 00 00 0a ff fd 02 00 00 00")
        assert answer[0].startswith("00 00 00 00 01 02 03 04 06 01 1c 00 00 0a ff fd 00 00")

    run(scenario)


@pytest.mark.parametrize("header", ["81 00 00 00", "01 00 00 00 aa aa bb bb", "80 00 00 00"])
def test_deleting_an_unknown_session_succeeds(header: str) -> None:
    async def scenario(dialogue: Dialogue) -> None:
        assert await dialogue.say(f"{header} 03 01 04 00 00 02 ff fe") == [
            plain(f"{header} 05 01 06 00 00 02 ff fe 00 00")
        ]

    run(scenario)


def test_same_key_and_session_id_keep_the_objects_and_restart_the_streams() -> None:
    async def scenario(dialogue: Dialogue) -> None:
        await dialogue.say(login())
        create = PARTICIPANT.format(session=0x81, number=0, flags=1)
        assert (await dialogue.say(create))[0] == plain("81 80 00 00 05 01 06 00 00 0a 00 11 00 00")
        assert await dialogue.say(login()) == [plain(OK)]
        assert (await dialogue.say(create))[0] == plain("81 80 00 00 05 01 06 00 00 0a 00 11 82 00")
        again = PARTICIPANT.format(session=0x81, number=1, flags=3)
        assert (await dialogue.say(again))[0] == plain("81 80 01 00 05 01 06 00 00 0a 00 11 01 00")

    run(scenario)


def test_same_key_and_other_session_id_begin_with_nothing() -> None:
    async def scenario(dialogue: Dialogue) -> None:
        await dialogue.say(login())
        await dialogue.say(PARTICIPANT.format(session=0x81, number=0, flags=1))
        assert (await dialogue.say(login(session="82")))[0].startswith("82 00 00 00 04")
        create = PARTICIPANT.format(session=0x82, number=0, flags=1)
        assert (await dialogue.say(create))[0] == plain("82 80 00 00 05 01 06 00 00 0a 00 11 00 00")
        assert len(dialogue.agent.clients()) == 1

    run(scenario)


def test_same_key_from_another_address_takes_the_session_there() -> None:
    async def scenario(dialogue: Dialogue) -> None:
        await dialogue.say(login())
        await dialogue.say(PARTICIPANT.format(session=0x81, number=0, flags=1))
        assert await dialogue.say(login(), "other port") == [plain(OK)]
        assert await dialogue.say(PING, "client") == [plain(PONG.format(known=0))]
        again = PARTICIPANT.format(session=0x81, number=0, flags=1)
        assert (await dialogue.say(again, "other port"))[0].endswith("00 0a 00 11 82 00")
        assert await dialogue.say(again, "client") == []

    run(scenario)


def test_other_key_from_the_same_address_ends_the_old_session() -> None:
    async def scenario(dialogue: Dialogue) -> None:
        await dialogue.say(login("00 00 00 01"))
        assert await dialogue.say(login("00 00 00 02")) == [plain(OK)]
        assert [client.key for client in dialogue.agent.clients()] == [2]

    run(scenario)


class Bouncer(OpenGate):
    """Lets one key in, as often as it is told."""

    def __init__(self, key: int) -> None:
        self.key = key

    def may_join(self, client: ClientInfo) -> bool:
        return client.key == self.key


def test_the_gate_may_refuse_a_login() -> None:
    async def scenario(dialogue: Dialogue) -> None:
        assert await dialogue.say(login("00 00 00 01")) == [
            plain("81 00 00 00 04 01 0b 00 83 00 58 52 43 45 01 00 01 0f 00")
        ]
        assert await dialogue.say(login("00 00 00 02"), "other") == [plain(OK)]

    run(scenario, gate=Bouncer(2))


def test_a_refused_login_from_elsewhere_does_not_harm_the_open_session() -> None:
    gate = Bouncer(1)

    async def scenario(dialogue: Dialogue) -> None:
        await dialogue.say(login("00 00 00 01"))
        gate.key = 0
        assert (await dialogue.say(login("00 00 00 01"), "thief"))[0].split()[8] == "83"
        assert await dialogue.say(PING) == [plain(PONG.format(known=1))]

    run(scenario, gate=gate)


def test_more_clients_than_allowed_are_refused_with_a_status() -> None:
    async def scenario(dialogue: Dialogue) -> None:
        for key in (1, 2):
            assert await dialogue.say(login(f"00 00 00 0{key}"), f"peer {key}") == [plain(OK)]
        refused = await dialogue.say(login("00 00 00 03"), "peer 3")
        assert refused[0].split()[8] == f"{Status.ERR_RESOURCES:02x}"
        assert await dialogue.say(login("00 00 00 02", session="82"), "peer 2"), "a place that is one's own stays free"

    run(scenario, settings=AgentSettings(max_clients=2))


def with_properties(*properties: tuple[str, str]) -> CreateClient:
    return CreateClient(1, 0x81, 508, properties)


@pytest.mark.parametrize(
    ("text", "silence_s"),
    [
        ("000400", 0.4),
        ("010000", 10.0),
        ("000000", 0.1),
        ("999999999", 3600.0),
        ("x", 7.0),
        ("", 7.0),
        ("-5", 7.0),
        ("9" * 400, 7.0),
        ("²", 7.0),
    ],
)
def test_hard_liveliness_is_milliseconds_or_ignored(text: str, silence_s: float) -> None:
    assert dead_after_s(with_properties(("uxr_hl", text)), 7.0) == silence_s
    assert dead_after_s(CreateClient(1, 0x81, 508), 7.0) == 7.0


def test_a_client_with_shared_memory_wants_no_echo() -> None:
    assert not wants_echo(with_properties(("uxr_sm", "1")))
    assert wants_echo(with_properties(("uxr_sm", "0")))
    assert wants_echo(CreateClient(1, 0x81, 508))


def test_properties_of_a_genuine_client_are_read_although_its_length_omits_them() -> None:
    async def scenario(dialogue: Dialogue) -> None:
        packet = encode_message(Header(0x80), [with_properties(("uxr_hl", "010000"))], pad_end=False)
        assert packet[6:8] == b"\x10\x00"
        assert await dialogue.say(packet) == [plain(OK)]

    run(scenario)
