"""Frames of Jacdac: what is written is read, what is none is refused with the reason."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot_bridges.jacdac.frames import (
    GET,
    MOST_DATA,
    SET,
    BadFrame,
    Packet,
    checksum,
    decode_frame,
    encode_commands,
)
from msbot_bridges.jacdac.jacdac_bus import (
    AGAIN_S,
    ASK_S,
    ASK_TIMES,
    LOST_S,
    MOST_MODULES,
    MOST_REGISTERS,
    JacdacBus,
    ModuleFound,
    ModuleLost,
    Reported,
)
from msbot_bridges.jacdac.services import INTENSITY, PRODUCT, READING, STREAMING_SAMPLES, VALUE, FixedPoint

SERVO, BUTTON = 0x12FC9103, 0x1473A263
ONE = bytes(range(8))
packets = st.builds(Packet, st.integers(0, 0x3F), st.integers(0, 0xFFFF), st.binary(max_size=MOST_DATA))


@given(st.binary(min_size=8, max_size=8), st.lists(packets, max_size=20))
def test_what_is_written_is_read(device: bytes, written: list[Packet]) -> None:
    frames = [decode_frame(frame) for frame in encode_commands(device, written)]
    assert [packet for frame in frames for packet in frame.packets] == written
    assert all(frame.device == device and frame.is_command for frame in frames)


@given(st.binary(max_size=300))
def test_whatever_comes_is_a_frame_or_counted(data: bytes) -> None:
    bus = JacdacBus()
    bus.receive(data, 0.0)
    assert bus.bad_frames == 1 or decode_frame(data)


def test_the_checksum_is_that_of_the_specification() -> None:
    assert checksum(b"123456789") == 0x29B1


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (lambda frame: frame[:11], "11 bytes, fewer than the 12 of a header"),
        (lambda frame: frame[:-1], "packets of 8 bytes are announced, and 7 have come"),
        (lambda frame: frame[:-1] + b"\1", "the checksum is wrong"),
    ],
)
def test_what_is_wrong_is_said(damage: object, said: str) -> None:
    (frame,) = encode_commands(ONE, [Packet(1, SET | VALUE, b"abcd")])
    with pytest.raises(BadFrame, match=said):
        decode_frame(damage(frame))  # type: ignore[operator]


@given(st.floats(-40000, 40000))
def test_a_number_that_does_not_fit_becomes_the_nearest(number: float) -> None:
    form = FixedPoint(4, 16, signed=True)
    assert form.read(form.write(number)) == pytest.approx(max(-32768, min(32768, number)), abs=1e-4)


def report(device: bytes, *packets: Packet) -> bytes:
    """A frame as a module sends it."""
    (frame,) = encode_commands(device, packets)
    rest = frame[2:3] + b"\0" + frame[4:]
    return checksum(rest).to_bytes(2, "little") + rest


def announce(device: bytes, *classes: int, restarts: int = 1) -> bytes:
    data = bytes((restarts, 0, 0, 0)) + b"".join(number.to_bytes(4, "little") for number in classes)
    return report(device, Packet(0, 0, data))


def sent(frames: list[bytes]) -> list[Packet]:
    return [packet for frame in frames for packet in decode_frame(frame).packets]


def found(bus: JacdacBus, *classes: int) -> ModuleFound:
    """A module that has answered nothing."""
    bus.receive(announce(ONE, *classes), 0.0)
    for number in range(ASK_TIMES + 1):
        assert all(packet.command & 0xF000 == GET for packet in sent(bus.poll(number * ASK_S)))
    event = bus.events.popleft()
    assert isinstance(event, ModuleFound)
    return event


def test_a_module_is_only_asked_until_it_is_driven_and_then_kept_at_its_values() -> None:
    bus = JacdacBus()
    module = found(bus, SERVO).module
    now = ASK_TIMES * ASK_S
    module.start_streaming(now)
    module.keep(1, {INTENSITY: b"\1"})
    assert Packet(1, SET | INTENSITY, b"\1") in sent(bus.poll(now))
    assert sent(bus.poll(now + AGAIN_S / 2)) == []
    assert Packet(1, SET | INTENSITY, b"\1") in sent(bus.poll(now + AGAIN_S)), "a frame may have been lost"
    module.release()
    bus.receive(announce(ONE, SERVO), now + AGAIN_S)
    assert sent(bus.poll(now + 3 * AGAIN_S)) == []


def test_a_safe_value_goes_out_though_the_module_is_released_at_once() -> None:
    bus = JacdacBus()
    module = found(bus, SERVO).module
    module.start_streaming(1.0)
    module.keep(1, {INTENSITY: b"\0"})
    module.release()
    assert sent(bus.poll(1.0)) == [Packet(1, SET | INTENSITY, b"\0")]


def test_what_it_answers_is_asked_no_more_and_known() -> None:
    bus = JacdacBus()
    bus.receive(announce(ONE, BUTTON), 0.0)
    assert Packet(0, GET | PRODUCT) in sent(bus.poll(0.0))
    bus.receive(report(ONE, Packet(0, GET | PRODUCT, b"\1\2\3\x30")), 0.1)
    again = sent(bus.poll(ASK_S))
    assert again
    assert Packet(0, GET | PRODUCT) not in again
    assert bus.modules[ONE].registers(0)[PRODUCT] == b"\1\2\3\x30"


def test_readings_are_streamed_on_demand_and_events_count_once() -> None:
    bus = JacdacBus()
    module = found(bus, BUTTON).module
    module.start_streaming(1.0)
    assert Packet(1, SET | STREAMING_SAMPLES, b"\xff") in sent(bus.poll(1.0))
    for _ in range(3):
        bus.receive(report(ONE, Packet(1, 0x8501)), 1.1)
    bus.receive(report(ONE, Packet(1, GET | READING, b"\xff\xff")), 1.2)
    assert list(bus.events) == [
        Reported(module, 1, None, 1, b""),
        Reported(module, 1, READING, 0, b"\xff\xff"),
    ]


@pytest.mark.parametrize(("restarts", "classes"), [(0, (SERVO,)), (1, (BUTTON,))])
def test_one_that_has_started_anew_is_lost_and_asked_again(restarts: int, classes: tuple[int, ...]) -> None:
    bus = JacdacBus()
    module = found(bus, SERVO).module
    bus.receive(announce(ONE, *classes, restarts=restarts), 1.0)
    assert list(bus.events) == [ModuleLost(module, "it has started anew")]
    assert sent(bus.poll(1.0))


def test_one_that_is_silent_is_lost() -> None:
    bus = JacdacBus()
    module = found(bus, SERVO).module
    bus.poll(LOST_S)
    assert list(bus.events) == [ModuleLost(module, "it has sent nothing for 2 s")]
    assert not bus.modules


def test_more_modules_than_there_is_room_for_are_counted() -> None:
    bus = JacdacBus()
    for number in range(MOST_MODULES + 5):
        bus.receive(announce(number.to_bytes(8, "little"), SERVO), 0.0)
    assert len(bus.modules) == MOST_MODULES
    assert bus.left_out == 5


def test_registers_that_nobody_has_asked_for_have_a_bound() -> None:
    module = found(JacdacBus(), SERVO).module
    for number in range(2 * MOST_REGISTERS):
        module.answered((number >> 12, number & 0xFFF), b"x")
    assert len(module.known) == MOST_REGISTERS
    module.answered((0, 1), b"y")
    assert module.known[0, 1] == b"y", "what is known is still kept up to date"
