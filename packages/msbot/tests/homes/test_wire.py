"""The MicroPython home's octets against those of MsBOT's own code, and against recorded ones."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from random import Random
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from msbot.carried.carried_files import OF_GENERIC_BOARDS
from msbot.part.calls import LONGEST_SENTENCE, decode_reply
from msbot.part.join.home import Home, home_text
from msbot.part.join.part_log import LogSender, VersionOf
from msbot.part.messages.standard import PixelFormat
from msbot.part.messages.type_hash import described_types, type_hash
from msbot_xrce.errors import CallError, RemoteProtocolError
from tests import ROOT
from tests.damage import damaged
from tests.homes import micro
from tests.homes.world import (
    DICTIONARY,
    FIXED,
    STANDARD_MESSAGES,
    Refusal,
    Seal,
    SerialReceiver,
    compress,
    decompress,
    encode_serial,
    prove,
    prove_sealed,
    split,
)
from tools.board_package import PACKAGES

VECTORS = ROOT / "tests" / "vectors"
MTU = 512


def recorded() -> Iterator[bytes]:
    """Every message of the genuine peers that fits the home's links."""
    for path in VECTORS.glob("*.jsonl"):
        for line in path.read_text().splitlines():
            octets = bytes.fromhex(json.loads(line).get("hex", ""))
            if 0 < len(octets) <= MTU:
                yield octets


def test_what_it_knows_beforehand_is_what_everybody_knows() -> None:
    compact = micro.load("compact")
    assert micro.load("squeeze").DICTIONARY == DICTIONARY
    assert compact.FIXED == FIXED
    assert tuple(refusal.describe for refusal in Refusal) == micro.load("words").REFUSALS


@pytest.mark.parametrize(("software", "hardware"), [("", ""), ("1.4", ""), ("a version with ä long name", "rev. B")])
def test_a_board_says_of_itself_what_a_computer_says(software: str, hardware: str) -> None:
    home = micro.load().Part("X")
    if software or hardware:
        home.software, home.hardware = software, hardware
    assert home.home == Home.MICROPYTHON.value
    has_room, told = [False, True, True], []

    def ask(octets: bytes, _stream: int) -> bool:
        room = not has_room or has_room.pop(0)
        told.extend([octets] * room)
        return room

    micro.load("versions").tell(SimpleNamespace(part=home, _lease=7, _ask=ask), 1000)
    assert told == []
    ((due, again),) = home._pending
    home._pending.clear()
    again()
    assert (due, home._pending) == (1100, [])
    ours = LogSender()
    for of, text in {
        VersionOf.HOME: home_text(Home.MICROPYTHON),
        **({VersionOf.HARDWARE: hardware, VersionOf.SOFTWARE: software} if software or hardware else {}),
    }.items():
        ours.add_version(of, text)
    sent = []
    for piece in ours.pieces(7):
        sent.append(piece)
        ours.sent()
    assert told == sent


@pytest.mark.parametrize("status", [1, 2, 3, 4, 5, 6, 7, 8, 200])
@pytest.mark.parametrize("said", ["", "the lid is öffen", "ü" * 200, "a\nb\x7f"])
def test_a_board_says_of_a_reply_what_a_computer_says(status: int, said: str) -> None:
    octets = bytes([status]) + said.encode()[:LONGEST_SENTENCE]
    with pytest.raises((CallError, RemoteProtocolError)) as caught:
        decode_reply(octets)
    assert micro.load("service_words").refusal(octets) == str(caught.value)


def test_recorded_messages_come_out_as_they_went_in_whoever_shortened_them() -> None:
    compact = micro.load("compact")
    messages = set(recorded())
    assert len(messages) > 1000
    for message in messages:
        short = compact.compress(message)
        assert decompress(short) == message
        assert compact.decompress(short) == message
        assert compact.decompress(compress(message)) == message


@pytest.mark.parametrize("session", [0x81, 0x82])
def test_a_parts_first_message_is_as_short_as_from_a_pc(session: int) -> None:
    compact = micro.load("compact")
    first = bytes((session, 0x80)) + micro.load("squeeze").FIRST
    assert compact.compress(first) == compress(first)
    assert len(compact.compress(first)) == 17


@given(st.binary(min_size=1, max_size=MTU))
@example(b"\x81\x80\0\0\x07\x01\x04\0\xa0\0\0\x15")
@example(b"\x81\0\0\0\x0a\x01\x05\0\0\0\0\0\x81")
@example(b"\x80\0\0\0\0\x01\x10\0XRCE\x01\0\x01\x0f\0\0\0\x01\x83\0\0\0")
def test_any_octets_come_out_as_they_went_in(octets: bytes) -> None:
    compact = micro.load("compact")
    assert decompress(compact.compress(octets)) == octets
    assert compact.decompress(compact.compress(octets)) == octets


@given(damaged(st.sampled_from([compress(packet) for packet in recorded()])) | st.binary(max_size=80))
@example(b"\x5f\x03\x00")
@example(b"\x5f\x5f")
def test_octets_are_read_as_everybody_reads_them_or_refused(octets: bytes) -> None:
    compact = micro.load("compact")
    mine, theirs = outcome(compact.decompress, octets), outcome(decompress, octets)
    if isinstance(theirs, bytes):
        assert mine == theirs
    elif isinstance(mine, bytes):
        # MicroPython's DEFLATE does not say where it ends, so a board overlooks what stands behind.
        assert octets[:1] == b"\x5f"
        assert "does not end where DEFLATE ends" in theirs
    else:
        assert mine, "the board's own words"


def outcome(read: Callable[[bytes], bytes], octets: bytes) -> bytes | str:
    """What was read, or the words of the refusal."""
    try:
        return read(octets)
    except (RemoteProtocolError, micro.load("errors").RemoteProtocolError) as error:
        return str(error)


@given(st.binary(min_size=1, max_size=MTU + 1), st.integers(0, 63))
def test_frames_are_cut_and_joined_as_everybody_does(packet: bytes, counter: int) -> None:
    can = micro.load("can")
    frames = split(packet, counter, False)
    body = can.body_of(packet)
    assert [can.frame_of(body, at, counter + at // 7) for at in range(0, len(body), 7)] == frames
    joiner = can.Joiner(MTU + 1)
    assert [joiner.receive(frame, 0) for frame in frames] == [None] * (len(frames) - 1) + [packet]


@given(st.lists(st.binary(min_size=1, max_size=40), min_size=1, max_size=12), st.randoms(use_true_random=False))
def test_a_joiner_gives_sent_messages_or_none(packets: list[bytes], random: Random) -> None:
    """Frames are lost, repeated at once, or cut off; what is given was sent, in order."""
    can = micro.load("can")
    joiner, counter, heard = can.Joiner(MTU + 1), 0, []
    for packet in packets:
        frames = split(packet, counter, False)
        counter += len(frames)
        for frame in frames:
            for _ in range(random.choice((0, 1, 1, 1, 1, 2))):
                heard.append(joiner.receive(frame, 0))
    given = [message for message in heard if message is not None]
    position = 0
    for message in given:
        position = packets.index(message, position)


@given(st.lists(st.binary(min_size=1, max_size=8), max_size=40))
def test_arbitrary_frames_do_a_joiner_no_harm(frames: list[bytes]) -> None:
    joiner = micro.load("can").Joiner(20)
    for frame in frames:
        message = joiner.receive(frame, 0)
        assert message is None or 0 < len(message) <= 21


class Stream:
    """A byte stream that gives what it has in pieces."""

    def __init__(self, octets: bytes, random: Random) -> None:
        self.octets, self._random = octets, random

    def read(self) -> bytes:
        size = self._random.randrange(1, 20)
        piece, self.octets = self.octets[:size], self.octets[size:]
        return piece


class Heard:
    """A client that only listens."""

    def __init__(self) -> None:
        self.packets: list[bytes] = []

    def packet(self, packet: bytes, _now: int) -> None:
        self.packets.append(packet)


def read_all(octets: bytes, random: Random) -> list[bytes]:
    stream, heard = Stream(octets, random), Heard()
    link = micro.load("links").SerialLink(stream)
    link.begin(None, heard, 0)
    while stream.octets:
        link.poll(0)
    return heard.packets


@given(st.lists(st.binary(min_size=1, max_size=60), max_size=4), st.randoms(use_true_random=False))
@example([b"\x7e\x7d\x7d\x7e" * 10], Random(1))
def test_serial_frames_both_ways(packets: list[bytes], random: Random) -> None:
    links = micro.load("links")
    sent = b"".join(links.encode_frame(packet, 1) for packet in packets)
    assert sent == b"".join(encode_serial(packet, 1, 0) for packet in packets)
    assert SerialReceiver(0).receive(sent) == [(1, packet) for packet in packets]
    assert read_all(b"\x7enoise" + b"".join(encode_serial(p, 0, 1) for p in packets), random) == packets


@given(st.binary(max_size=200), st.randoms(use_true_random=False))
@example(b"\x7e\x7d\x7d\x7d", Random(1))
def test_noise_on_a_line_is_no_packet_unless_its_check_sum_agrees(octets: bytes, random: Random) -> None:
    read_all(octets, random)
    packet = b"a whole packet"
    spoiled = bytearray(encode_serial(packet, 0, 1))
    spoiled[random.randrange(5, len(spoiled))] ^= 0x04
    assert packet not in read_all(bytes(spoiled), random)
    assert read_all(octets.replace(b"\x7d", b"") + encode_serial(packet, 0, 1), random)[-1:] == [packet]


@given(st.binary(min_size=16, max_size=64), st.binary(min_size=16, max_size=16), st.text(max_size=20))
def test_a_proof_is_that_of_a_pc(key: bytes, nonce: bytes, name: str) -> None:
    name = name.encode("utf-8", "ignore").decode()
    uid = bytes(range(8))
    mine = micro.load("keys").prove(key, nonce, uid, "ABCD", name, 0xAABBCCDD)
    assert mine == prove(key, nonce, uid, part_number="ABCD", local_name=name, session_key=0xAABBCCDD)


class Names:
    """The names of the board's package."""

    def __getitem__(self, name: str) -> Any:
        return getattr(micro.load(), name)


LISTS: dict[str, Callable[[Any], dict[str, Any]]] = {
    "Scan": lambda _: {"angle_min": -90.0, "angle_step": 1.0, "reach": 4.0, "metres": [0.5, 2.0, 9.0]},
    "Strip": lambda names: {"colours": [names["Colour"](red=1, green=2, blue=place) for place in range(5)]},
    "Picture": lambda _: {"width": 3, "height": 1, "format": PixelFormat.MONO8, "pixels": b"\x00\x80\xff"},
}
"""Values for the messages that have lists."""


def plain_repr(message: object) -> str:
    """As a board shows it, where an enum is a number."""
    return re.sub(r"<\w+\.\w+: (\d+)>", r"\1", repr(message))


@pytest.mark.parametrize("name", STANDARD_MESSAGES)
def test_a_standard_message_is_that_of_a_pc(name: str) -> None:
    theirs: Any = STANDARD_MESSAGES[name]
    mine = micro.load("standards").standard(name)
    values = {field: {str: "words", bool: True}.get(type(value), 3) for field, value in vars(theirs()).items()}
    if name in LISTS:
        theirs_values, my_values = LISTS[name](STANDARD_MESSAGES), LISTS[name](Names())
    else:
        theirs_values = my_values = values
    message = theirs(**theirs_values)
    assert mine(**my_values).encode() == message.encode()
    assert repr(mine.decode(message.encode())) == plain_repr(theirs.decode(message.encode()))


@given(st.binary(max_size=40), st.sampled_from(sorted(STANDARD_MESSAGES)))
def test_octets_are_a_message_for_both_or_for_none(octets: bytes, name: str) -> None:
    theirs: Any = STANDARD_MESSAGES[name]
    mine = micro.load("standards").standard(name)
    try:
        expected = plain_repr(theirs.decode(octets))
    except Exception as error:
        expected = type(error).__name__
    try:
        found = repr(mine.decode(octets))
    except Exception as error:
        found = type(error).__name__
    assert found == expected


class Pipe:
    """A packet pipe to nobody."""

    def __init__(self) -> None:
        self.incoming: list[bytes] = []

    def read(self) -> bytes | None:
        return self.incoming.pop(0) if self.incoming else None

    def write(self, _packet: bytes) -> bool:
        return True


LOGIN_ANSWER = bytes.fromhex("8100000004010b0000005852434501 00010f00")


@pytest.mark.parametrize("was_restarted", [False, True])
def test_a_further_answer_to_the_login_may_be_a_copy_so_the_agent_is_asked(was_restarted: bool) -> None:
    class Heard(Pipe):
        def write(self, packet: bytes) -> bool:
            sent.append(packet.hex())
            return True

    sent: list[str] = []
    part = micro.load("part").Part("TEST-1")
    micro.load("errors").listen(lambda *_: None)
    pipe, now = Heard(), 0
    part.begin(micro.load("links").PacketLink(pipe), now)
    part.step(now)
    for packet in (LOGIN_ANSWER, bytes.fromhex("810000000a0105000100000080")):
        pipe.incoming.append(packet)
        part.step(now)
    assert any(packet.startswith("81800000") for packet in sent)
    sent.clear()
    pipe.incoming.append(LOGIN_ANSWER)
    part.step(now)
    part.step(now + 1)
    assert any(packet.startswith("810000000b0105000000") for packet in sent), "which message does the agent expect?"
    sent.clear()
    pipe.incoming.append(bytes.fromhex("810000000a010500" + ("0000ffff80" if was_restarted else "0100000080")))
    part.step(now + 2)
    part.step(now + 3)
    assert any(packet[8:10] == "00" and "58524345" in packet for packet in sent) is was_restarted, "logs in again"


submessages = st.builds(
    lambda kind, flags, body, more: bytes((kind, flags, len(body) & 0xFF, more)) + body + bytes(-len(body) & 3),
    st.integers(0, 16),
    st.integers(0, 3),
    st.binary(max_size=40),
    st.sampled_from((0, 0, 0, 1)),
)
packets = st.builds(
    lambda session, stream, number, bodies: bytes((session, stream, number, 0)) + b"".join(bodies),
    st.sampled_from((0x80, 0x81, 0x82, 1)),
    st.sampled_from((0, 1, 0x80, 0x80, 0x81)),
    st.integers(0, 20),
    st.lists(submessages, max_size=4),
)
replies = st.builds(
    lambda number, body: (
        bytes((0x81, 0x80, number, 0)) + b"\x09\x01" + bytes((len(body) + 8, 0)) + b"\xc0\x17\0\x17\x80\0\0\x17" + body
    ),
    st.integers(0, 20),
    st.binary(max_size=60),
)


@given(st.lists(packets | replies | st.binary(max_size=40), max_size=12), st.lists(st.integers(0, 3000), max_size=12))
def test_whatever_comes_from_the_wire_a_part_goes_on(came: list[bytes], pauses: list[int]) -> None:
    """No exception, nothing that grows, and whatever happened: once it is let alone it asks for a session again."""
    part = micro.load("part").Part("TEST-1")
    micro.load("errors").listen(lambda *_: None)
    pipe, now = Pipe(), 0
    part.begin(micro.load("links").PacketLink(pipe), now)
    part.step(now)
    pipe.incoming.append(LOGIN_ANSWER)
    for packet, pause in zip(came, [*pauses, *[1] * len(came)], strict=False):
        pipe.incoming.append(packet)
        due = part.step(now)
        assert due is not None
        assert due > now
        now += pause
    client = part._client
    assert len(client._out) <= 64
    assert client._kept <= 8192
    for _ in range(400):
        now = part.step(now)
    assert client._login_at is not None or client._creating


def proved(seals: Any, nonce: bytes = bytes(16)) -> Seal:
    """The master's end after a proof."""
    who = bytes(range(16)), nonce, bytes(8)
    proof, secret = prove_sealed(*who, part_number="TEST-1", local_name="", session_key=7, session_nonce=9)
    assert seals.prove(*who, "TEST-1", "", 7, 9) == proof
    return Seal(secret, is_part=False)


@given(st.lists(st.binary(max_size=40), min_size=1, max_size=8), st.data())
def test_its_seals_open_at_the_master_and_nothing_else_opens_here(said: list[bytes], data: st.DataObject) -> None:
    seals = micro.load("seal").Seals()
    master = proved(seals)
    lease = bytes((1, 0, 0, 0)) + bytes(8)
    assert seals.open_reply(lease) is None
    assert seals.open_reply(master.seal(0, lease)) == lease
    assert [master.open(0x15, seals.seal(0x15, sample)) for sample in said] == said
    sealed = [master.seal(0x16, sample) for sample in said]
    newest = -1
    for number in data.draw(st.lists(st.integers(0, len(said) - 1), max_size=16)):
        spoiled = bytearray(sealed[number])
        bit = data.draw(st.integers(0, 8 * len(spoiled) - 1))
        spoiled[bit // 8] ^= 1 << bit % 8
        assert seals.open(0x16, bytes(spoiled)) is None
        assert seals.open(0x26, sealed[number]) is None
        assert seals.open(0x16, sealed[number]) == (said[number] if number > newest else None)
        newest = max(newest, number)


def test_a_board_that_was_in_a_sealed_robot_joins_no_unsealed_one_and_a_new_proof_takes_over() -> None:
    seals = micro.load("seal").Seals()
    reply, challenge = bytes((1, 0, 0, 0)), bytes(16)
    master = proved(seals)
    assert seals.open_reply(challenge) == challenge  # nothing was agreed yet: whoever spoke of seals was not the robot
    assert seals.open_reply(reply) == reply
    master = proved(seals)
    assert seals.open_reply(master.seal(0, reply)) == reply
    later = proved(seals, b"n" * 16)
    assert seals.open_reply(master.seal(0, reply)) == reply
    assert seals.open_reply(later.seal(0, reply)) == reply
    assert seals.open_reply(master.seal(0, reply)) is None
    seals.session_lost()
    assert seals.open_reply(reply) is None
    assert seals.open_reply(challenge) is None
    assert seals.open_reply(bytes(12)) == bytes(12)
    assert seals.seal_request(reply) == reply


def test_the_packages_name_every_file_once() -> None:
    listed = {name: json.loads((micro.FOLDER.parent / name).read_text())["urls"] for name in PACKAGES}
    assert all(place == source for urls in listed.values() for place, source in urls)
    named = [source for urls in listed.values() for _, source in urls]
    assert sorted(named) == sorted(f"msbot/{path.name}" for path in micro.FOLDER.glob("*.py"))
    generic = {f"msbot/{name}.py" for name in OF_GENERIC_BOARDS}
    assert {source for _, source in listed["generic.json"]} == generic


@pytest.mark.parametrize("name", STANDARD_MESSAGES)
def test_a_standard_message_has_the_same_hash_in_every_home(name: str) -> None:
    theirs = micro.load("type_hash").type_hash(micro.load("standards").standard(name))
    types = described_types(STANDARD_MESSAGES[name]) or {}
    assert theirs == type_hash(name, types[name], types.get)


@pytest.mark.parametrize("name", ["std_msgs::msg::dds_::Float32_", "Raw", "a::b"])
@given(st.lists(st.sampled_from([*"BHIQbhiqfd", bool, str]), min_size=1, max_size=5))
def test_any_message_has_the_same_hash_in_every_home(name: str, kinds: list[Any]) -> None:
    home = micro.load("type_hash")
    fields = [(f"field_{place}", kind) for place, kind in enumerate(kinds)]
    cls = type("Any", (micro.load("message").Message,), {"_fields": tuple(fields), "type_name": name})
    assert home.type_hash(cls) == type_hash(
        name, [(field, micro.load("kind_words").WORDS[kind]) for field, kind in fields]
    )
