"""Conformance cases 1 to 22: logging in, asking who is there, messages of unknown clients (XRCE 1.0 §8.3.5, §8.4)."""

from __future__ import annotations

import asyncio

import pytest

from msbot_agent.link.net import UdpServerLink
from tests.conformance.agent_rig import (
    DELETE_CLIENT,
    DELETED,
    ENTITIES,
    PING,
    PING_INSIDE,
    WELCOME,
    AgentRig,
    acknack,
    create_client,
    data,
    heartbeat,
    info,
    octets,
    packets,
    participant,
    read,
    reliable,
    status,
    write,
)
from tests.conformance.servers import serving

STATUS_AGENT = "81 00 00 00 04 01 0b 00 {} 00 58 52 43 45 01 00 01 0f 00"


def test_case_01_create_client_is_answered_with_19_octets(agent: AgentRig) -> None:
    login = "80 00 00 00 | 00 01 10 00 | 58 52 43 45 01 00 01 0f aa bb cc dd 81 00 fc 01"
    (answer,) = agent.say(login)
    assert answer == octets("81 00 00 00 04 01 0b 00 00 00 58 52 43 45 01 00 01 0f 00").hex()
    assert len(octets(answer)) == 19


def test_case_02_wrong_cookie_is_invalid_data(agent: AgentRig) -> None:
    assert agent.say(create_client(cookie="58 52 43 46")) == packets(STATUS_AGENT.format("85"))


def test_case_03_only_the_major_version_must_be_ours(agent: AgentRig) -> None:
    assert agent.say(create_client(version="02 00")) == packets(STATUS_AGENT.format("86"))
    assert agent.say(create_client(version="01 09")) == packets(STATUS_AGENT.format("00"))


def test_case_04_key_0_is_invalid_data_said_with_a_proper_representation(agent: AgentRig) -> None:
    assert agent.say(create_client("00 00 00 00")) == packets(STATUS_AGENT.format("85"))


def test_case_05_any_vendor_is_welcome(agent: AgentRig) -> None:
    assert agent.say(create_client(vendor="de ad")) == packets(WELCOME)


@pytest.mark.parametrize("length", ["00 10", "10 00"], ids=["length as the flag", "length little endian"])
def test_case_06_big_endian_login_is_understood_with_its_mtu(agent: AgentRig, length: str) -> None:
    login = f"80 00 00 00 00 00 {length} 58 52 43 45 01 00 01 0f aa bb cc 06 81 00 01 fc"
    assert agent.say(login) == packets(WELCOME)
    (view,) = agent.agent.clients()
    assert view.mtu == 508


def test_case_07_session_with_the_key_in_every_header(agent: AgentRig) -> None:
    login = "00 00 00 00 aa bb cc 07 00 01 10 00 58 52 43 45 01 00 01 0f aa bb cc 07 01 00 fc 01"
    (answer,) = agent.say(login)
    assert answer == octets("01 00 00 00 aa bb cc 07 04 01 0b 00 00 00 58 52 43 45 01 00 01 0f 00").hex()
    assert len(octets(answer)) == 23
    assert agent.say(participant("01 80 00 00 aa bb cc 07")) == packets(
        status("01 80 00 00 aa bb cc 07"),
        "01 00 00 00 aa bb cc 07 0a 01 05 00 01 00 00 00 80",
    )


def test_case_08_truncated_login_is_met_with_silence(agent: AgentRig) -> None:
    login = create_client()
    for size in range(len(octets(login))):
        assert agent.say(octets(login)[:size]) == []
    assert agent.say(login) == packets(WELCOME)


def test_case_09_login_inside_of_a_session_is_ignored(agent: AgentRig) -> None:
    assert agent.say(create_client(header="81 00 00 00")) == []
    agent.log_in()
    agent.say(participant("81 80 00 00"))
    assert agent.say(create_client(header="81 00 00 00")) == []
    assert agent.say(participant("81 80 01 00"))[0] == octets(status("81 80 01 00", code="82")).hex()


def test_case_10_the_answer_copies_stream_and_number_of_the_login(agent: AgentRig) -> None:
    answer = "81 01 05 00 04 01 0b 00 00 00 58 52 43 45 01 00 01 0f 00"
    assert agent.say(create_client(header="80 01 05 00")) == packets(answer)


def test_case_11_properties_are_read_although_the_length_omits_them(agent: AgentRig) -> None:
    login = (
        "80 00 00 00 00 01 10 00 58 52 43 45 01 00 01 0f 11 22 33 44 81 01 00 00 01 00 00 00 07 00 00 00"
        "75 78 72 5f 68 6c 00 00 07 00 00 00 30 31 30 30 30 30 00 7a fc 01"
    )
    assert agent.say(login) == packets(WELCOME)
    (view,) = agent.agent.clients()
    assert (view.key, view.mtu) == (0x11223344, 508)


def test_case_12_hard_liveliness_that_is_no_number_is_ignored(agent: AgentRig) -> None:
    # The genuine agent aborts.
    login = create_client(properties="01 00 00 01 00 00 00 07 00 00 00 75 78 72 5f 68 6c 00 00 02 00 00 00 78 00")
    assert agent.say(login) == packets(WELCOME)
    assert agent.wait(29.0) == []
    assert agent.say(PING_INSIDE) == packets(info("81 00 00 00", known=True))


@pytest.mark.parametrize("value", ["02", "07", "ff"])
def test_case_13_boolean_that_is_neither_0_nor_1(agent: AgentRig, value: str) -> None:
    # The genuine agent aborts.
    assert agent.say(create_client(properties=value)) == []
    agent.log_in()
    agent.set_up()
    assert agent.say(reliable(6, f"08 01 08 00 00 21 00 16 80 00 {value} 00")) == packets(acknack(7))
    assert agent.say(reliable(7, f"08 01 08 00 00 21 00 16 80 00 00 {value}")) == packets(acknack(8))
    assert agent.say(reliable(8, f"01 01 10 00 00 22 00 21 01 03 00 00 02 00 00 00 {value} 00 00 00")) == packets(
        status("81 80 06 00", "00 22", "00 21", "80"), acknack(9)
    )
    assert agent.say(PING_INSIDE) == packets(info("81 00 00 00", known=True))


@pytest.mark.parametrize("mtu", [*range(9), 23])
def test_case_14_mtu_too_small_for_an_answer_is_refused(agent: AgentRig, mtu: int) -> None:
    # With 8 and less the genuine agent loops for ever.
    assert agent.say(create_client(mtu=f"{mtu:02x} 00")) == packets(STATUS_AGENT.format("85"))
    assert agent.say(participant("81 80 00 00")) == []
    agent.log_in(mtu="18 00")
    assert agent.say(participant("81 80 00 00")) == packets(status("81 80 00 00"), acknack(1))


def test_case_15_login_again_with_the_same_session_keeps_the_objects_and_restarts_the_streams(agent: AgentRig) -> None:
    agent.log_in()
    assert agent.say(participant("81 80 00 00")) == packets(status("81 80 00 00"), acknack(1))
    agent.log_in()
    assert agent.say(participant("81 80 00 00")) == packets(status("81 80 00 00", code="82"), acknack(1))
    assert agent.say(participant("81 80 01 00", flags="03")) == packets(status("81 80 01 00", code="01"), acknack(2))


def test_case_16_login_again_with_another_session_begins_with_nothing(agent: AgentRig) -> None:
    agent.log_in()
    agent.say(participant("81 80 00 00"))
    agent.log_in(session="82")
    assert agent.say(participant("82 80 00 00")) == packets(status("82 80 00 00"), acknack(1, session="82"))
    # A late packet of the old session does not count in the new one (eProsima takes it).
    assert agent.say(participant("81 80 01 00", request="00 0e", object_id="00 21")) == []
    assert agent.say(participant("82 80 01 00", object_id="00 21")) == packets(
        status("82 80 01 00", object_id="00 21"), acknack(2, session="82")
    )
    assert agent.say(PING_INSIDE) == packets(info("81 00 00 00", known=False))


def test_case_17_same_key_from_a_second_port_moves_the_session_there(agent: AgentRig) -> None:
    agent.set_up_two()
    agent.say(reliable(6, read()))
    agent.log_in(peer="second port")
    assert agent.say(PING_INSIDE) == packets(info("81 00 00 00", known=False))
    assert agent.say(PING_INSIDE, peer="second port") == packets(info("81 00 00 00", known=True))
    agent.say(reliable(6, write("01 02 03 04")), peer="writer")
    assert agent.take() == []
    assert agent.take("second port") == packets(reliable(0, data("01 02 03 04")))
    assert agent.wait(0.25, "second port") == [(0.2, octets(heartbeat(0, 0)).hex())]


def test_case_18_other_key_from_the_same_port_ends_the_old_session(agent: AgentRig) -> None:
    agent.log_in()
    agent.say(participant("81 80 00 00"))
    agent.log_in("aa bb cc ee")
    assert [view.key for view in agent.agent.clients()] == [0xAABBCCEE]
    assert agent.say(participant("81 80 00 00")) == packets(status("81 80 00 00"), acknack(1))


def test_case_19_get_info_tells_whether_the_address_has_a_session(agent: AgentRig) -> None:
    unknown = (
        "80 00 00 00 06 01 1c 00 00 0a ff fd 00 00 01 0d 58 52 43 45 01 00 01 0f 00 01 0d 00 01 00 00 00 00 00 00 00"
    )
    assert agent.say("80 00 00 00 02 01 08 00 00 0a ff fd 02 00 00 00") == packets(unknown)
    assert len(octets(unknown)) == 36
    agent.log_in()
    assert agent.say(PING) == packets(info("80 00 00 00", known=True))
    assert agent.say(PING, peer="somebody else") == packets(info("80 00 00 00", known=False))
    # Object id and mask do not matter, and big endian is understood.
    assert agent.say("80 00 00 00 02 01 08 00 12 34 00 11 00 00 00 00") == packets(
        info("80 00 00 00", request="12 34", object_id="00 11", known=True)
    )
    assert agent.say("80 00 00 00 02 00 08 00 00 0a ff fd 00 00 00 02") == packets(info("80 00 00 00", known=True))


def test_case_20_only_the_first_question_of_a_message_without_session_is_answered(agent: AgentRig) -> None:
    second = "02 01 08 00 00 0b ff fd 02 00 00 00"
    assert agent.say(PING + second) == packets(info("80 00 00 00", known=False))


def test_case_21_truncated_get_info_is_met_with_silence(agent: AgentRig) -> None:
    # The genuine agent answers with zeros.
    assert agent.say("80 00 00 00 02 01 08 00 00 0a") == []
    agent.log_in()
    assert agent.say("81 00 00 00 02 01 08 00 00 0a") == []


def test_case_22_messages_of_an_unknown_session(agent: AgentRig) -> None:
    assert agent.say(participant("81 80 00 00")) == []
    assert agent.say("80 00 00 00 0b 01 05 00 00 00 00 00 80") == []
    assert agent.say(f"81 00 00 00 {DELETE_CLIENT}") == packets(DELETED)
    assert agent.say(PING_INSIDE) == packets(info("81 00 00 00", known=False))
    assert agent.say("00 00 00 00 01 02 03 04 02 01 08 00 00 0a ff fd 02 00 00 00") == packets(
        info("00 00 00 00 01 02 03 04", known=False)
    )


class Socket(asyncio.DatagramProtocol):
    """A UDP port of a client."""

    def __init__(self) -> None:
        self.came: asyncio.Queue[bytes] = asyncio.Queue()

    def datagram_received(self, data: bytes, addr: object) -> None:
        self.came.put_nowait(data)


async def test_case_17_same_key_from_a_second_port_over_real_udp() -> None:
    link = UdpServerLink("127.0.0.1", 0)
    async with serving(link):
        loop = asyncio.get_running_loop()
        old, new = [
            await loop.create_datagram_endpoint(Socket, remote_addr=("127.0.0.1", link.port)) for _ in ("old", "new")
        ]

        async def ask(end: tuple[asyncio.DatagramTransport, Socket], text: str) -> str:
            end[0].sendto(octets(text))
            return (await end[1].came.get()).hex()

        assert [await ask(old, create_client())] == packets(WELCOME)
        for number, entity in enumerate(ENTITIES):
            length = len(octets(entity))
            answer = await ask(old, f"81 01 {number:02x} 00 01 01 {length:02x} 00 {entity}")
            assert answer.endswith("0000"), answer
        old[0].sendto(octets(f"81 01 06 00 {read()}"))
        assert [await ask(new, create_client())] == packets(WELCOME)
        assert [await ask(old, PING_INSIDE)] == packets(info("81 00 00 00", known=False))
        assert [await ask(new, f"81 01 00 00 {write('01 02 03 04')}")] == packets(reliable(0, data("01 02 03 04")))
        assert old[1].came.empty()
        for transport, _ in (old, new):
            transport.close()
