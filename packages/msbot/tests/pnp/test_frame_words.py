"""What each frame of a bus says: a beacon, a piece of something longer, and the one that completes it."""

from __future__ import annotations

import pytest

from msbot.part.messages.standard import Level
from msbot.pnp import FrameListener, FrameWords, KnownObject, SessionListener
from msbot_agent.link.can.protocol import DOWN, UP, CanIds, Frame, frame_sentence
from msbot_agent.link.can.protocol.frames import split
from msbot_agent.link.can.protocol.ids import Assign, Beacon, assign_frame, beacon_frame
from msbot_xrce.messages import STREAM_BEST_EFFORT, Data, Header, Submessage, WriteData, encode_message

HALF = Level(percent=50.0).encode()
OTHER_IDS = CanIds(up=0x400, down=0x480, beacon=0x600)


def packet(submessage: Submessage) -> bytes:
    return encode_message(Header(0x81, STREAM_BEST_EFFORT, 1), [submessage], pad_end=False)


def overhearer() -> SessionListener:
    """A listener who knows the dial of node 7."""
    return SessionListener(
        (Level,),
        know=lambda peer, object_id: KnownObject("dial", Level.type_name, "knob") if object_id == 0x15 else None,
        units=lambda _: {"percent": "%"},
    )


@pytest.mark.parametrize("ids", [None, OTHER_IDS])
@pytest.mark.parametrize("up", [True, False])
def test_a_packet_in_pieces_is_told_by_its_last_frame(ids: CanIds | None, up: bool) -> None:
    listener = FrameListener(overhearer(), ids=ids)
    used = ids or CanIds()
    can_id = (used.up if up else used.down) + 7
    sample = WriteData(7, 0x15, HALF) if up else Data(7, 0x15, HALF)
    unknown = WriteData(7, 0x25, HALF) if up else Data(7, 0x25, HALF)
    *before, last = (Frame(can_id, octets) for octets in split(packet(sample), 0, False))
    assert before
    piece = "a piece of what node 7 sends" if up else "a piece of what the master sends to node 7"
    for frame in before:
        told = listener.explain_frame(frame, 1.0)
        assert (told.plain, told.about, len(told.protocol)) == ((), (piece,), 1)
    told = listener.explain_frame(last, 1.0)
    assert (told.plain, told.about) == ((f"knob {'says' if up else 'hears'} 50 %",), ())
    assert any("dial: " in line for line in told.protocol[1:])
    assert listener.unknown == 0
    frames = [Frame(can_id, octets) for octets in split(packet(unknown), len(before) + 1, False)]
    about = [listener.explain_frame(frame, 1.0).about for frame in frames]
    of_knob = "a piece of what knob sends" if up else "a piece of what the master sends to knob"
    assert about[:-1] == [(of_knob,)] * (len(frames) - 1), "now it is known who that is"
    assert about[-1] == (f"knob {'says' if up else 'hears'} something on a topic that is not known here",)
    assert listener.unknown == 1


def test_frames_of_the_bus_itself_are_told_by_their_kind() -> None:
    for ids in (CanIds(), OTHER_IDS):
        listener = FrameListener(ids=ids)
        for frame in (beacon_frame(Beacon(0, 5, 7), ids), assign_frame(Assign(b"uid.0001", 7, 5, 0), ids)):
            told = listener.explain_frame(frame, 1.0)
            assert (told.plain, told.about) == ((), (frame_sentence(frame, ids),))
            assert len(told.protocol) == 1


@pytest.mark.parametrize("can_id", [UP, DOWN, UP + 0x40])
@pytest.mark.parametrize("extended", [False, True])
def test_on_a_bus_of_the_thesis_two_identifiers_carry_packets(can_id: int, extended: bool) -> None:
    frame = Frame(can_id, b"\x81\x01", extended=extended)
    told: FrameWords = FrameListener(overhearer(), legacy=True).explain_frame(frame, 1.0)
    pieces = {UP: "a piece of what a part sends", DOWN: "a piece of what the master sends to a part"}
    expected = frame_sentence(frame, CanIds()) if extended else pieces.get(can_id, frame_sentence(frame, CanIds()))
    assert (told.plain, told.about) == ((), (expected,))
