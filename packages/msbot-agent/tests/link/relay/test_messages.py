"""What a relay and a master say, octet by octet: both sides may be of different versions of MsBOT."""

from __future__ import annotations

import pytest

from msbot_agent.link.relay.relay_messages import (
    Bye,
    Down,
    Event,
    Heard,
    Hello,
    Message,
    Refused,
    RelayBeat,
    RelayEventKind,
    Room,
    Up,
    Welcome,
    Who,
    decode,
    encode,
)
from msbot_xrce.errors import RemoteProtocolError

BOOT = b"boot 123"
CARRIED = "02" + b"pi".hex() + "08" + b"can:can0".hex()
HELLO = "00ff52 01 01" + BOOT.hex() + "00001000 0007a120"

WIRE: list[tuple[Message, str]] = [
    (Hello(BOOT, "pi", "can:can0", 4096, 500_000, shared_bus=False, compresses=False), f"{HELLO} 00 {CARRIED}"),
    (Hello(BOOT, "pi", "can:can0", 4096, 500_000, shared_bus=True, compresses=False), f"{HELLO} 01 {CARRIED}"),
    (Hello(BOOT, "pi", "can:can0", 4096, 500_000, shared_bus=False, compresses=True), f"{HELLO} 02 {CARRIED}"),
    (Up(0x0102, "", b"\x80"), "00ff52 02 0102 00 80"),
    (Up(0x0102, "n3", b"up"), "00ff52 02 0102 02 6e33 7570"),
    (RelayBeat(1, 0, ""), "00ff52 03 0001 0000 00 00"),
    (
        RelayBeat(0x0102, 0x0304, "no", (Event(5, RelayEventKind.GONE, "x"), Event(6, RelayEventKind.BACK, ""))),
        "00ff52 03 0102 0304 02 02 6e6f 0005 01 01 78 0006 02 00",
    ),
    (RelayBeat(1, 0, "", (Event(5, RelayEventKind.CAME, "n5"),)), "00ff52 03 0001 0000 00 01 0005 03 02 6e35"),
    (Room(()), "00ff52 04"),
    (Room(((1, 2), (3, 0xFFFF))), "00ff52 04 0001 0002 0003 ffff"),
    (Bye(), "00ff52 05"),
    (Welcome(BOOT, 0x01020304, 5), f"00ff52 11 {BOOT.hex()} 01020304 0005"),
    (Down(0x0102, 0x0304, b"down"), "00ff52 12 0102 0304 646f776e"),
    (Heard(1, 2, 3, 4), "00ff52 13 0001 0002 0003 04"),
    (Who(), "00ff52 14"),
    (Refused("no"), "00ff52 15 02 6e6f"),
]


@pytest.mark.parametrize(("message", "octets"), WIRE)
def test_a_message_on_the_wire(message: Message, octets: str) -> None:
    assert encode(message).hex() == octets.replace(" ", "")
    assert decode(encode(message)) == message


@pytest.mark.parametrize("octets", [octets for message, octets in WIRE if not isinstance(message, Up | Down | Room)])
def test_a_message_that_was_cut_short_is_none(octets: str) -> None:
    whole = bytes.fromhex(octets)
    for size in range(len(whole)):
        with pytest.raises(RemoteProtocolError, match=f"relay message of {size} bytes cannot be read"):
            decode(whole[:size])


@pytest.mark.parametrize(
    ("octets", "words"),
    [
        ("80ff52 05", "it does not begin like one"),
        ("00ff52 06", "6 is not a valid RelayKind"),
        ("00ff52 02 0102 00", "there is no packet in it"),
        (f"00ff52 01 02 {BOOT.hex()} 00001000 0007a120 00 {CARRIED}", "version 2 is not 1"),
        (f"{HELLO} 00 00 08 {b'can:can0'.hex()}", "a relay has a name"),
        (f"{HELLO} 00 02 {b'pi'.hex()} 00", "a relay has a name"),
        ("00ff52 04 0001", "a length that no report has"),
        ("00ff52 04" + "00010002" * 101, "a length that no report has"),
        ("00ff52 03 0001 0000 00 01 0005 04 00", "4 is not a valid RelayEventKind"),
        ("00ff52 15 05 6e6f", "a text is cut off"),
    ],
)
def test_what_no_message_is_like_is_refused_with_the_reason(octets: str, words: str) -> None:
    with pytest.raises(RemoteProtocolError, match=words):
        decode(bytes.fromhex(octets))


def test_long_texts_are_cut_off_and_events_beyond_16_are_not_read() -> None:
    assert decode(encode(Refused("x" * 500))) == Refused("x" * 120)
    assert decode(bytes.fromhex("00ff52 15 ff" + "78" * 255)) == Refused("x" * 120)
    assert decode(encode(Room(((1, 2),) * 100))) == Room(((1, 2),) * 100)
    beat = decode(encode(RelayBeat(1, 0, "", (Event(5, RelayEventKind.GONE, ""),) * 17)))
    assert isinstance(beat, RelayBeat)
    assert len(beat.events) == 16


def test_a_text_from_the_network_has_nothing_that_a_terminal_obeys() -> None:
    (words,) = (decode(bytes.fromhex("00ff52 15 04 1b5b326a")).words,)  # type: ignore[union-attr]
    assert "\x1b" not in words
