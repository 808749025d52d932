"""Random, seeded questions about messages and frames, with grading. Pure."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from random import Random
from typing import Final

from msbot_agent.link.can.protocol import CanIds, Frame, format_frame, frame_bits, node_of, wire_bits
from msbot_agent.text.sentence import Sentence, said
from msbot_xrce import FoundField, read_fields
from msbot_xrce.lazy import dataclass
from msbot_xrce.messages import (
    SESSION_DEFAULT,
    STREAM_BEST_EFFORT,
    STREAM_NONE,
    STREAM_RELIABLE,
    Acknack,
    Data,
    Delete,
    Header,
    Heartbeat,
    ObjectKind,
    StatusReply,
    Submessage,
    WriteData,
    encode_message,
    make_object_id,
)

MOST_NODES: Final = 120


@dataclass(frozen=True, slots=True)
class Question:
    """One question."""

    shown: str
    """The octets or the frame."""
    text: Sentence
    answer: str
    """What is right, as a person would write it."""
    why: Sentence
    """How one finds it."""

    def is_right(self, given: str) -> bool:
        """Whether an answer is right; numbers in any base that Python writes, words in any case."""
        return _same(given) == _same(self.answer)


def questions(seed: int) -> Iterator[Question]:
    """Questions without end; the same for the same seed."""
    random = Random(seed)
    kinds: tuple[Callable[[Random], Question], ...] = (_which, _field, _field, _stream, _node, _length, _stuffed)
    while True:
        yield random.choice(kinds)(random)


def frame_question(frame: Frame, random: Random) -> Question | None:
    """A question about a frame of a real bus; None: nothing is asked about frames like this (CAN FD, remote, error)."""
    if frame.fd or frame.remote or frame.error or frame.extended:
        return None
    kinds: list[Callable[[Frame, Random], Question]] = [_length_of]
    if node_of(frame, CanIds()) is not None:
        kinds.append(_node_of)
    if len(frame.data) > 1:
        kinds.append(_stuffed_of)
    return random.choice(kinds)(frame, random)


def _message(random: Random) -> tuple[bytes, Submessage]:
    number = random.randrange(1, 300)
    kind = random.choice((ObjectKind.DATAWRITER, ObjectKind.DATAREADER))
    object_id = make_object_id(random.randrange(1, 60), kind)
    request = random.randrange(10, 2000)
    payload = random.randbytes(random.choice((4, 8, 12)))
    submessage: Submessage = random.choice(
        (
            WriteData(request, object_id, payload),
            Data(request, object_id, payload),
            Acknack(number, random.randrange(16), STREAM_RELIABLE),
            Heartbeat(number, number + random.randrange(5), STREAM_RELIABLE),
            StatusReply(request, object_id, random.choice((0, 0x84, 0x87))),
            Delete(request, object_id),
        )
    )
    is_about_streams = isinstance(submessage, Acknack | Heartbeat)
    stream = STREAM_NONE if is_about_streams else random.choice((STREAM_BEST_EFFORT, STREAM_RELIABLE))
    header = Header(SESSION_DEFAULT, stream, 0 if is_about_streams else number)
    return encode_message(header, [submessage], pad_end=False), submessage


def _shown(packet: bytes) -> str:
    return packet.hex(" ")


def _which(random: Random) -> Question:
    packet, _ = _message(random)
    found = _found(packet, "submessage_id")
    kind = found.words.split()[-1]
    return Question(
        _shown(packet),
        said("Which submessage is it?"),
        kind,
        said(
            "byte {number} is {octets}: that is {kind}; the message's header has 4 bytes before it",
            number=found.start,
            octets=found.octets.hex(),
            kind=kind,
        ),
    )


def _field(random: Random) -> Question:
    packet, _ = _message(random)
    fields, _fault = read_fields(packet)
    chosen = random.choice(
        [
            one
            for one in fields
            if one.value is not None and one.part != "header" and one.name not in ("submessage_id", "flags")
        ]
    )
    first, last = chosen.start, chosen.start + len(chosen.octets) - 1
    octets, words = chosen.octets.hex(" "), chosen.words
    where = (
        said("byte {first}, {octets}: {words}", first=first, octets=octets, words=words)
        if last == first
        else said("bytes {first} to {last}, {octets}: {words}", first=first, last=last, octets=octets, words=words)
    )
    return Question(
        _shown(packet),
        said("What is the {field} of {submessage}? (a number)", field=chosen.name, submessage=chosen.part),
        str(chosen.value),
        where,
    )


def _stream(random: Random) -> Question:
    packet, _ = _message(random)
    found = _found(packet, "stream_id", "header")
    assert found.value is not None
    kind = "none" if found.value == 0 else "reliable" if found.value >= STREAM_RELIABLE else "best effort"
    return Question(
        _shown(packet),
        said("On which kind of stream is it sent: none, best effort, reliable?"),
        kind,
        said(
            "byte {number} is {octets}: 00 is none, 01 to 7f are best effort, 80 to ff reliable",
            number=found.start,
            octets=found.octets.hex(),
        ),
    )


def _frame(random: Random) -> Frame:
    node, up = random.randrange(1, MOST_NODES + 1), random.random() < 0.5
    ids = CanIds()
    data = bytes((0xC0 | random.randrange(64),)) + random.randbytes(random.randrange(1, 8))
    return Frame((ids.up if up else ids.down) + node, data)


def _node(random: Random) -> Question:
    return _node_of(_frame(random), random)


def _node_of(frame: Frame, _: Random) -> Question:
    ids = CanIds()
    found = node_of(frame, ids)
    assert found is not None, "only frames of nodes are asked about"
    node, up = found
    base = ids.up if up else ids.down
    why = (
        said(
            "the identifier 0x{identifier:03X} less 0x{base:03X}: from node {node}",
            identifier=frame.can_id,
            base=base,
            node=node,
        )
        if up
        else said(
            "the identifier 0x{identifier:03X} less 0x{base:03X}: to node {node}",
            identifier=frame.can_id,
            base=base,
            node=node,
        )
    )
    return Question(format_frame(frame), said("Which node sends it, or is meant? (a number)"), str(node), why)


def _length(random: Random) -> Question:
    return _length_of(_frame(random), random)


def _length_of(frame: Frame, _: Random) -> Question:
    bits = frame_bits(frame).nominal_bits
    stuff_bits = sum(bit.stuff for bit in wire_bits(frame))
    return Question(
        format_frame(frame),
        said(
            "How many bits is it on the wire, with stuff bits (there are {count}) and the pause of 3 after it?",
            count=stuff_bits,
        ),
        str(bits),
        said(
            "47 bits and 8 for each of its bytes of data ({octets}), and stuff bits ({count}): {bits}",
            octets=len(frame.data),
            count=stuff_bits,
            bits=bits,
        ),
    )


def _stuffed(random: Random) -> Question:
    return _stuffed_of(_frame(random), random)


def _stuffed_of(frame: Frame, _: Random) -> Question:
    run = "".join(str(bit.level) for bit in wire_bits(frame) if bit.field == "DATA" and not bit.stuff)[:16]
    shown = stuffed(run)
    return Question(
        run,
        said("How many stuff bits does a controller put into this run of bits, if it begins here?"),
        str(shown.count("(")),
        said("{run}: after five equal bits the opposite one, which counts for the next five", run=shown),
    )


def stuffed(run: str) -> str:
    """A run of bits with its stuff bits in parentheses (ISO 11898-1 10.5)."""
    shown, last, length = "", "", 0
    for bit in run:
        length = length + 1 if bit == last else 1
        last = bit
        shown += bit
        if length == 5:
            last, length = "1" if bit == "0" else "0", 1
            shown += f"({last})"
    return shown


def _found(packet: bytes, name: str, part: str = "") -> FoundField:
    return next(one for one in read_fields(packet)[0] if one.name == name and part in ("", one.part))


def _same(text: str) -> str:
    words = re.sub(r"[\s_-]+", " ", text.strip().casefold())
    try:
        return str(int(words, 0))
    except ValueError:
        return words
