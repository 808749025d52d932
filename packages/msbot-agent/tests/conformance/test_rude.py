"""What rude, broken and hostile peers send: the agent lives on, counts it by reason, and its memory is bounded."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from random import Random

import pytest

from msbot_agent.agent import AgentSettings
from tests.agent.replay import load
from tests.conformance.agent_rig import (
    DELETED,
    PING_INSIDE,
    AgentRig,
    acknack,
    data,
    info,
    octets,
    packets,
    participant,
    read,
    reliable,
    status,
    write,
)

RECORDINGS = [
    "udp_xml_loop_dds",
    "udp_bin_loop_ced",
    "udp_reqrep_req",
    "udp_reqrep_rep",
    "udp_timesync",
    "udp_raw_reset",
]


def from_clients(name: str) -> Iterator[bytes]:
    """The packets that clients sent in a recording."""
    return (line.packet for line in load(name) if line.from_client)


# Octets.


@pytest.mark.parametrize("name", RECORDINGS)
def test_recorded_packets_cut_short_at_every_octet(agent: AgentRig, name: str) -> None:
    for packet in from_clients(name):
        agent.say_at_once([packet[:size] for size in range(len(packet) + 1)])
    agent.serve_somebody()


@pytest.mark.parametrize("name", RECORDINGS)
def test_recorded_packets_in_the_wrong_byte_order(agent: AgentRig, name: str) -> None:
    agent.log_in()
    for packet in from_clients(name):
        start = 4 if packet[0] >= 0x80 else 8
        agent.say(packet[: start + 1] + bytes([packet[start + 1] ^ 1]) + packet[start + 2 :])
    agent.serve_somebody()


@pytest.mark.parametrize("name", RECORDINGS)
def test_recorded_packets_with_each_octet_7(agent: AgentRig, name: str) -> None:
    for packet in from_clients(name):
        agent.say_at_once([packet[:at] + b"\7" + packet[at + 1 :] for at in range(len(packet))])
    agent.serve_somebody()


def test_every_submessage_id_with_every_flag(agent: AgentRig) -> None:
    agent.log_in()
    random = Random(1)
    for kind in range(256):
        for flags in (0x00, 0x01, 0x02, 0x07, 0x0E, 0x80, 0xFF):
            contents = [b"", b"\0" * 4, b"\xff" * 9, random.randbytes(32)]
            bodies = [bytes((kind, flags)) + struct.pack("<H", len(one)) + one for one in contents]
            agent.say_at_once([b"\x81\0\0\0" + body for body in bodies])
    agent.serve_somebody()


@pytest.mark.parametrize(
    "body",
    [
        bytes(65_500),
        b"\xff" * 65_500,
        octets("0c 01 00 00") * 16_000,
        octets("0b 01 05 00 00 00 05 00 80 00 00 00") * 5_000,
        octets("02 01 08 00 00 0a ff fd 02 00 00 00") * 5_000,
        octets("20 01 00 00") * 16_000,
        octets("0b 01 05 00 00 00 05 00 80 00 00 00 0c 01 00 00 02 01 08 00 00 0a ff fd 02 00 00 00") * 2_300,
        octets("0a 01 05 00 00 00 ff ff 80 00 00 00") * 5_000,
        octets("07 01 ff ff 00 0a 00 15") + bytes(65_531),
    ],
    ids=[
        "zeros",
        "ones",
        "resets",
        "heartbeats",
        "questions",
        "unknown",
        "everything anew",
        "acknowledgements",
        "a sample",
    ],
)
def test_the_largest_packets(agent: AgentRig, body: bytes) -> None:
    agent.log_in()
    answers = agent.say(octets("81 00 00 00") + body)
    assert sum(len(answer) // 2 for answer in answers) <= 4 * len(body)
    agent.serve_somebody()


NOT_DATA = "WRITE_DATA without ids, or in another format than DATA"
SESSION_PACKETS = [
    ("81 80", "packet shorter than a header", "agent"),
    ("01 80 00 00 aa", "packet that cannot be read", "agent"),
    ("80 00 00 00 07 01 04 00 00 0a 00 15", "packet without a session", "agent"),
    ("81 00 00 00 01 01 10 00 00 0a 00 11 01 03", "broken CREATE", "client"),
    ("81 00 00 00 08 01 08 00 00 21 00 16 80 00 00 07", "broken READ_DATA", "client"),
    ("81 00 00 00 07 01 ff 00 00 10 00 15 01 02", "broken WRITE_DATA", "client"),
    ("81 00 00 00 07 01 03 00 00 10 00", NOT_DATA, "client"),
    ("81 00 00 00 07 03 08 00 00 10 00 15 00 00 00 00", NOT_DATA, "client"),
    ("81 00 00 00 07 01 08 00 00 10 09 95 00 00 00 00", "WRITE_DATA for an unknown object", "client"),
    ("81 00 00 00 07 01 08 00 00 10 00 16 00 00 00 00", "WRITE_DATA for an object that cannot write", "client"),
    ("81 00 00 00 02 01 02 00 00 0a", "broken GET_INFO", "client"),
    ("81 00 00 00 03 01 02 00 00 0a", "broken DELETE", "client"),
    ("81 00 00 00 0a 01 03 00 00 00 00", "broken ACKNACK", "client"),
    ("81 00 00 00 0b 01 03 00 00 00 00", "broken HEARTBEAT", "client"),
    ("81 00 00 00 0e 01 08 00 00 00 00 00 00 ca 9a 3b", "broken TIMESTAMP", "client"),
    ("81 00 00 00 0d 01 04 00 07 01 00 00", "FRAGMENT outside of a reliable stream", "client"),
    ("81 00 00 00 66 01 ff ff", "broken submessage of an unknown kind", "client"),
    ("81 00 00 00 00 01 10 00 58 52 43 45 01 00 01 0f aa bb cc dd 81 00 fc 01",
     "CREATE_CLIENT inside of a session", "client"),
    ("81 00 00 00 01 01 10 00 00 0a 00 21 01 03 00 00 02 00 00 00 01 00 00 00",
     "CREATE with a representation that cannot be used", "client"),
    ("81 80 06 00 0b 01 05 00 00 00 05 00 80", "HEARTBEAT inside of a reliable stream", "client"),
    (acknack(100), "ACKNACK outside of what was sent", "client"),
    (reliable(100, "0c 01 00 00"), "message beyond the window", "client"),
]  # fmt: skip


@pytest.mark.parametrize(("packet", "reason", "where"), SESSION_PACKETS, ids=lambda value: str(value)[:60])
def test_what_makes_no_sense_is_counted_by_reason_and_shown(
    agent: AgentRig, packet: str, reason: str, where: str
) -> None:
    agent.log_in()
    agent.set_up()
    agent.say(packet, peer="client" if where == "client" else "stranger")
    assert (agent.view().dropped if where == "client" else agent.agent.dropped()) == {reason: 1}
    assert agent.say(PING_INSIDE) == packets(info("81 00 00 00", known=True))


# Descriptions.

LONG = {
    1: octets("01 00 00 00 02 00 00 00 64 00 01 00 03 00 00 00 70 70 00"),
    2: octets("02 00 00 00 74 00 01 00 02 00 00 00 78 00 01 00 02 00 00 00 54 00"),
    3: octets("01 00 00 00 02 00 00 00 70 00 00"),
    4: octets("01 00 00 00 02 00 00 00 73 00 00"),
    5: octets("00 12 01 00 0b 00 01 00 0a 00 01 00 e8 03 00 00 01 00 00 00 e8 03 00 00 01 00 00 00 01 00 00 00 ff"
              "01 00 00 05 00 00 00"),
    6: octets("00 12 01 00 03 00 01 00 0a 00 01 00 e8 03 00 00 01 00 00 00 e8 03 00 00 01 00 00 00 01 00 00 00 ff"
              "01 00 00 05 00 00 00 01 00 00 00 02 00 00 00 78 00"),
    7: octets("02 00 00 00 73 00 00 00 02 00 00 00 51 00 00 00 02 00 00 00 41 00 01 00 02 00 00 00 71 00 01 00"
              "02 00 00 00 61 00"),
    8: octets("02 00 00 00 73 00 00 00 02 00 00 00 51 00 00 00 02 00 00 00 41 00 01 00 02 00 00 00 71 00 01 00"
              "02 00 00 00 61 00"),
}  # fmt: skip
"""A binary description of each kind with everything that is optional."""
PARENTS = {1: "", 2: "00 11", 3: "00 11", 4: "00 11", 5: "00 13", 6: "00 14", 7: "00 11", 8: "00 11"}


def create(kind: int, form: int, contents: bytes, *, number: int = 0x40) -> bytes:
    """A CREATE outside of streams of an object with that description."""
    body = struct.pack(">HHBBxx", 0x77, number << 4 | kind, kind, form) + struct.pack("<I", len(contents)) + contents
    body += octets(PARENTS[kind]) if kind > 1 else bytes(len(body) & 1) + b"\0\0"
    return octets("81 00 00 00 01 05") + struct.pack("<H", len(body)) + body


def code(answers: list[str]) -> int:
    """The status in the one answer."""
    (answer,) = answers
    return octets(answer)[12]


@pytest.mark.parametrize("kind", LONG)
def test_binary_descriptions_cut_short_at_every_octet(agent: AgentRig, kind: int) -> None:
    agent.log_in()
    agent.set_up()
    whole = LONG[kind]
    assert code(agent.say(create(kind, 3, whole))) == 0
    codes = [code(agent.say(create(kind, 3, whole[:size]))) for size in range(len(whole))]
    # The end of a publisher's and subscriber's is not read.
    assert [size for size, one in enumerate(codes) if one != 0x80] == ([10] if kind in (3, 4) else [])
    assert code(agent.say(create(kind, 3, whole + bytes(40)))) == 0


@pytest.mark.parametrize("kind", LONG)
def test_binary_descriptions_with_each_octet_changed(agent: AgentRig, kind: int) -> None:
    agent.log_in()
    agent.set_up()
    whole = LONG[kind]
    for at in range(len(whole)):
        for octet in (0x00, 0x02, 0x07, 0x7F, 0xFF):
            answers = agent.say(create(kind, 3, whole[:at] + bytes([octet]) + whole[at + 1 :]))
            assert code(answers) in (0x00, 0x80)
    agent.serve_somebody()


LAUGHS = "".join(f'<!ENTITY l{n} "{f"&l{n - 1};" * 10 if n else "lol"}">' for n in range(10))
BOMBS = {
    "laughs": f"<!DOCTYPE dds [{LAUGHS}]><dds><topic><name>&l9;</name></topic></dds>",
    "outside": '<!DOCTYPE dds [<!ENTITY x SYSTEM "file:///etc/passwd">]><dds><topic><name>&x;</name></topic></dds>',
    "deep": "<dds>" * 5000,
    "wide": "<dds>" + "<topic/>" * 5000 + "</dds>",
    "attributes": "<dds " + " ".join(f'a{n}="1"' for n in range(3000)) + "/>",
    "joined attributes": "<dds " + "".join(f'a{n}="1"' for n in range(3000)) + "/>",
    "quotes": "<dds " + '="' * 20_000,
    "text": "<dds>" + "x" * 60_000,
    "entities": "<dds>" + "&lt;" * 12_000 + "</dds>",
    "comment": "<dds><!--" + "-" * 30_000,
    "instruction": "<?xml version='1.0' encoding='utf-16'?><dds/>",
    "no name": "<dds><topic><name></name></topic></dds>",
    "another kind": "<dds><participant/></dds>",
    "junk": "\x01\x02<<>>&&",
    "text only": "hello",
    "nothing": "",
}


@pytest.mark.parametrize("name", BOMBS)
def test_xml_bombs_and_junk_are_an_error(agent: AgentRig, name: str) -> None:
    agent.log_in()
    agent.set_up()
    contents = BOMBS[name].encode() + b"\0"
    assert code(agent.say(create(2, 2, contents))) == 0x80
    assert agent.view().dropped == {"CREATE with a representation that cannot be used": 1}


@pytest.mark.parametrize("contents", [b"no end", b"\xff\xfe\0", b"two\0parts\0", b"\xed\xa0\x80\0"])
def test_text_that_is_no_text_is_not_answered(agent: AgentRig, contents: bytes) -> None:
    agent.log_in()
    agent.set_up()
    assert agent.say(create(2, 2, contents)) == []
    assert agent.view().dropped == {"broken CREATE": 1}


# Objects.


@pytest.mark.parametrize("object_id", ["00 11", "00 12", "00 13", "00 14", "00 16", "00 1f", "00 00", "ff fd", "ff ff"])
def test_samples_for_what_cannot_write_go_nowhere(agent: AgentRig, object_id: str) -> None:
    agent.log_in()
    agent.set_up()
    agent.say(reliable(6, read(stream="01")))
    agent.say(reliable(7, write("00 00 00 00", object_id=object_id)))
    assert agent.say(reliable(8, write("01"))) == packets("81 01 00 00" + data("01"), acknack(9))


@pytest.mark.parametrize(
    ("object_id", "expected"), [("00 00", "84"), ("00 1f", "84"), ("ff ff", "84"), ("ff fd", "84"), ("00 22", "84")]
)
def test_deleting_what_is_not_there(agent: AgentRig, object_id: str, expected: str) -> None:
    agent.log_in()
    agent.set_up()
    assert agent.say(f"81 01 00 00 03 01 04 00 00 77 {object_id}") == packets(
        status("81 01 00 00", "00 77", object_id, expected)
    )


def test_every_id_of_a_client_deletes_the_session(agent: AgentRig) -> None:
    # The number does not count, only the kind (seen in the genuine agent).
    agent.log_in()
    assert agent.say("81 01 00 00 03 01 04 00 00 02 00 1e") == packets(DELETED[:-11] + "00 1e 00 00")
    assert agent.agent.clients() == []


def test_a_writer_on_a_subscriber_and_a_reader_of_no_topic(agent: AgentRig) -> None:
    agent.log_in()
    agent.set_up()
    # The kind of the parent is forced: subscriber 0024 does not stand for publisher 0023.
    assert agent.say("81 01 00 00 01 01 10 00 00 77 00 24 04 03 00 00 02 00 00 00 00 00 00 11")
    writer = "01 01 11 00 00 78 00 25 05 03 00 00 03 00 00 00 00 12 00 00 24 00 00 00"
    assert agent.say(f"81 01 01 00 {writer}") == packets(status("81 01 01 00", "00 78", "00 25", "84"))
    reader = "01 01 11 00 00 79 00 26 06 03 00 00 03 00 00 00 00 25 00 00 14 00 00 00"
    assert agent.say(f"81 01 02 00 {reader}") == packets(status("81 01 02 00", "00 79", "00 26", "80"))


def test_more_objects_than_allowed_are_refused_with_err_resources() -> None:
    agent = AgentRig(settings=AgentSettings(max_objects=256))
    agent.log_in()
    codes = [
        code(agent.say(participant("81 00 00 00", object_id=f"{number >> 4:02x} {number & 15:x}1")))
        for number in range(300)
    ]
    assert codes == [0] * 256 + [0x87] * 44
    assert agent.say("81 01 00 00 03 01 04 00 00 77 00 11")
    assert code(agent.say(participant("81 00 00 00", object_id="ff 01"))) == 0
    agent.close()
