"""The firmware's DDS-XRCE session, packet by packet: this side plays the agent."""

from __future__ import annotations

import struct

import pytest

from tests.firmware.c_part import Described, PartState
from tests.firmware.msbot_side import FrameJoiner, ProfileMessage
from tests.firmware.pipe import Firmware, frame_of

UID = bytes(range(1, 9))
S = 1_000_000
OK = bytes.fromhex("04010b00 00005852 43450100 010f00")
NOT_KNOWN = bytes.fromhex("06011c00 000afffd 0000010d 58524345 0100010f 00010d00 01000000 00000000")
BEACON = (0x700).to_bytes(4, "little") + b"\0" + bytes.fromhex("0100000000000000")
PROFILE_READER = bytes.fromhex("c0160016")


class Agent:
    """Talks with one part whose link has an address, without header compression."""

    def __init__(self, firmware: Firmware) -> None:
        self.firmware = firmware
        self.joiner = FrameJoiner(300)
        described = Described(uid=UID, codec=False, robot=("ROBOT", "", "", ""))
        joined = (0x0200_0000 | 5).to_bytes(4, "little") + b"\1" + UID
        firmware.ask(b"A" + described.octets(0), b"B", b"N\0" + bytes(4), b"F" + bytes(4) + joined)

    def hear(self, at_us: int = 0) -> list[bytes]:
        """All packets that the part says now."""
        packets = []
        stamp = at_us.to_bytes(4, "little")
        self.firmware.ask(b"F" + stamp + BEACON, b"T" + stamp)
        while (frame := self.firmware.ask(b"N\0" + stamp)[0]) != b"":
            packet = self.joiner.receive(frame_of(frame).data, at_us / 1e6)
            if packet is not None:
                packets.append(packet)
        return packets

    def say(self, stream: int, number: int, body: bytes, at_us: int = 0, session: int = 0x81) -> list[bytes]:
        """A message for the part; returns what it says to it."""
        packet = bytes((session, stream)) + number.to_bytes(2, "little") + body
        self.firmware.ask(b"V" + at_us.to_bytes(4, "little") + packet)
        return self.hear(at_us)

    def log_in(self) -> list[bytes]:
        """Answer the login; returns what follows it."""
        (login,) = self.hear()
        assert login.hex(" ", 4).startswith("80000000 00011000 58524345 0100010f")
        return self.say(0, 0, OK)

    def state(self) -> PartState:
        """Where the part stands."""
        return PartState(self.firmware.ask(b"I")[0][0])


def profile(name: str) -> bytes:
    """The payload of a profile."""
    return ProfileMessage(index=1, message=name, name="1", id="1", dof="today", make="us").encode()


def submessage(kind: int, contents: bytes, flags: int = 1) -> bytes:
    return bytes((kind, flags)) + len(contents).to_bytes(2, "little") + contents + bytes(-len(contents) & 3)


def data(name: str) -> bytes:
    return submessage(9, PROFILE_READER + profile(name))


def acknack(first: int, bitmap: int) -> bytes:
    return b"\x81\0\0\0" + submessage(10, struct.pack("<H", first) + bitmap.to_bytes(2, "big") + b"\x80")[:9]


def heartbeat(first: int, last: int) -> bytes:
    return submessage(11, struct.pack("<HHB", first, last, 0x80))


def test_a_login_is_repeated_each_second_until_it_is_answered(firmware: Firmware) -> None:
    agent = Agent(firmware)
    (login,) = agent.hear()
    assert agent.hear(S - 1) == []
    assert agent.hear(S) == [login]
    assert agent.hear(2 * S) == [login]
    assert len(agent.say(0, 0, OK, 2 * S)) == 2, "two messages set the session up"
    assert agent.hear(3 * S - 1) == []


def test_messages_that_were_not_acknowledged_are_asked_about_and_sent_again(firmware: Firmware) -> None:
    agent = Agent(firmware)
    first, second = agent.log_in()
    assert (first[:4].hex(), second[:4].hex()) == ("81800000", "81800100")
    assert agent.hear(S - 1) == []
    assert agent.hear(S) == [b"\x81\0\0\0" + heartbeat(0, 1)[:9]]
    assert agent.say(0, 0, acknack(0, 0b10)[4:], S) == [second]
    assert agent.say(0, 0, acknack(0, 0b11)[4:], S) == [first, second]
    assert agent.say(0, 0, acknack(2, 0)[4:], S) == []
    assert agent.hear(4 * S) == [], "nothing is left to be asked about"
    assert agent.say(0, 0, acknack(0, 0b11)[4:], 4 * S) == [], "an old report changes nothing"


def test_messages_of_the_reliable_stream_are_taken_in_order_and_once(firmware: Firmware) -> None:
    agent = Agent(firmware)
    agent.log_in()
    assert agent.say(0x80, 1, data("ROBOT")) == [acknack(0, 0b11)]
    assert agent.state() is PartState.RECOGNISING
    assert agent.say(0x80, 0, data("OTHER"))[0] == acknack(1, 0b1)
    assert agent.state() is PartState.WRONG_ROBOT
    claim = agent.say(0x80, 1, data("ROBOT"))
    assert claim[0] == acknack(2, 0)
    assert agent.state() is PartState.CLAIMING
    assert agent.say(0x80, 0, data("OTHER")) == [acknack(2, 0)]
    assert agent.state() is PartState.CLAIMING


def test_what_the_agent_has_given_up_is_not_waited_for(firmware: Firmware) -> None:
    agent = Agent(firmware)
    agent.log_in()
    assert agent.say(0, 0, heartbeat(0, 2)) == [acknack(0, 0b111)]
    assert agent.say(0, 0, heartbeat(2, 3)) == [acknack(2, 0b11)]
    agent.say(0x80, 2, data("ROBOT"))
    assert agent.state() is PartState.CLAIMING


def test_best_effort_messages_that_are_overtaken_are_dropped(firmware: Firmware) -> None:
    agent = Agent(firmware)
    agent.log_in()
    agent.say(1, 5, data("OTHER"))
    assert agent.state() is PartState.WRONG_ROBOT
    agent.say(1, 5, data("ROBOT"))
    agent.say(1, 4, data("ROBOT"))
    assert agent.state() is PartState.WRONG_ROBOT
    agent.say(1, 6, data("ROBOT"))
    assert agent.state() is PartState.CLAIMING


@pytest.mark.parametrize("size", [5, 17, 40])
def test_pieces_are_put_together(firmware: Firmware, size: int) -> None:
    agent = Agent(firmware)
    agent.log_in()
    whole = data("ROBOT")
    pieces = [whole[at : at + size] for at in range(0, len(whole), size)]
    for number, piece in enumerate(pieces):
        assert agent.state() is PartState.RECOGNISING
        agent.say(0x80, number, submessage(13, piece, 3 if number == len(pieces) - 1 else 1))
    assert agent.state() is PartState.CLAIMING


def test_pieces_with_a_hole_make_nothing(firmware: Firmware) -> None:
    agent = Agent(firmware)
    agent.log_in()
    agent.say(0x80, 0, submessage(13, data("OTHER")[:20]))
    agent.say(0, 0, heartbeat(2, 2))
    # As a piece this is the end of what had a hole; taken for a whole it would be another robot's profile.
    agent.say(0x80, 2, submessage(13, data("OTHER"), 3))
    assert agent.state() is PartState.RECOGNISING
    agent.say(0x80, 3, data("ROBOT"))
    assert agent.state() is PartState.CLAIMING


def test_an_agent_that_does_not_know_the_session_is_logged_in_to_again(firmware: Firmware) -> None:
    agent = Agent(firmware)
    agent.log_in()
    agent.say(0x80, 0, data("ROBOT"))
    (login,) = agent.say(0, 0, NOT_KNOWN)
    assert agent.state() is PartState.LOST
    assert login[20] == 0x82, "another session id: late packets of the old one are not taken for new"
    assert agent.say(0x80, 1, data("ROBOT")) == []
    agent.say(0, 0, OK, session=0x82)
    assert agent.state() is PartState.RECOGNISING


def test_a_silent_agent_is_pinged_three_times_and_given_up(firmware: Firmware) -> None:
    agent = Agent(firmware)
    agent.log_in()
    agent.say(0, 0, acknack(2, 0)[4:])
    ping = bytes.fromhex("81000000 02010800 000afffd 02000000")
    assert agent.hear(5 * S - 1) == []
    assert agent.hear(5 * S) == [ping]
    assert agent.hear(7 * S - 1) == []
    assert agent.hear(7 * S) == [ping]
    assert agent.hear(9 * S) == [ping]
    (login,) = agent.hear(11 * S)
    assert login[:5].hex() == "8000000000"
    assert agent.state() is PartState.LOST


def test_the_agents_probe_is_answered(firmware: Firmware) -> None:
    agent = Agent(firmware)
    agent.log_in()
    answer = agent.say(0, 0, bytes.fromhex("02010800 0000fffe 01000000"))
    assert [packet.hex() for packet in answer] == ["81000000060108000000fffe00000000"]
