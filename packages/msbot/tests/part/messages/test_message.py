from __future__ import annotations

from typing import Annotated, ClassVar

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot.part.messages.message import Message, fields_of
from msbot.part.messages.standard import HelloWorld
from msbot.part.messages.wire_types import AtMost, Octets, float32, int64, uint8, uint16, uint32
from msbot_xrce.errors import LocalProtocolError, RemoteProtocolError
from tests.damage import damaged, read_or_refused

HELLO = bytes.fromhex("01000000 11000000") + b"Hello DDS world!\0"  # DDS-XRCE user data, seen on the wire


class Point(Message):
    x: float32
    y: float32


class Track(Message):
    type_name = "geometry_msgs::msg::dds_::Track_"
    unit: ClassVar[str] = "m"

    ready: bool
    stamp: int64
    name: str = "track"
    tags: list[str] = ["a"]  # noqa: RUF012 - a default, copied for each message
    points: list[Point]
    origin: Point
    raw: bytes
    code: Annotated[bytes, Octets(3)]
    label: Annotated[str, AtMost(4)]


class LongTrack(Track):
    type_name = "LongTrack"
    length: uint16


def track(**changes: object) -> Track:
    values: dict[str, object] = {"ready": True, "stamp": -2, "points": [Point(x=1.0, y=2.0)], "code": b"abc"}
    return Track(**{**values, **changes})  # type: ignore[arg-type]  # tests of wrong values need any value


def test_hello_world_is_what_the_c_client_sends() -> None:
    message = HelloWorld(index=1, message="Hello DDS world!")
    assert message.encode() == HELLO
    assert HelloWorld.decode(HELLO) == message


def test_fields_nobody_sets_are_zero_or_the_default_of_the_class() -> None:
    message = Track()  # type: ignore[call-arg]  # at run time every field has a zero
    assert repr(message) == (
        "Track(ready=False, stamp=0, name='track', tags=['a'], points=[], origin=Point(x=0.0, y=0.0), "
        "raw=b'', code=b'\\x00\\x00\\x00', label='')"
    )


def test_defaults_that_can_change_are_not_shared() -> None:
    first, second = track(), track()
    first.tags.append("b")
    first.origin.x = 5.0
    assert second.tags == ["a"]
    assert second.origin.x == 0.0
    assert track().tags == ["a"]


def test_every_number_is_aligned_to_its_own_size() -> None:
    data = track(name="", tags=[], points=[], raw=b"\1\2", label="xyz").encode()
    assert data == bytes.fromhex(
        "01 00000000000000"  # ready, padding before an 8-octet number
        "feffffffffffffff"
        "01000000 00 000000"  # name
        "00000000 00000000"  # tags, points
        "00000000 00000000"  # origin
        "02000000 0102"
        "616263 000000"
        "04000000 78797a00"
    )


def test_a_base_class_comes_first() -> None:
    assert [field.name for field in fields_of(LongTrack)][-2:] == ["label", "length"]
    assert fields_of(LongTrack)[-1].codec.word == "uint16"


def test_the_type_name_is_the_class_name_unless_given() -> None:
    assert Point.type_name == "Point"
    assert Track.type_name == "geometry_msgs::msg::dds_::Track_"
    assert LongTrack.type_name == "LongTrack"

    class Short(LongTrack): ...

    assert Short.type_name == "Short"


def test_messages_are_equal_by_class_and_fields() -> None:
    assert track() == track()
    assert track() != track(stamp=1)
    assert track() != HelloWorld(index=1, message="")
    assert track() != 5
    with pytest.raises(TypeError, match="unhashable"):
        hash(track())


@pytest.mark.parametrize(
    ("field", "value", "words"),
    [
        ("ready", 1, "Track.ready cannot be 1: bool needs True or False"),
        ("stamp", 1 << 63, "Track.stamp cannot be 9223372036854775808: int64 needs a whole number from -9223372036"),
        ("stamp", True, "Track.stamp cannot be True"),
        ("name", "a\0b", "without NUL"),
        ("name", "\ud800", "Track.name cannot be"),
        ("name", b"bytes", "str needs a text"),
        ("name", None, "Track.name cannot be None"),
        ("points", [1], r"Track.points\[0\] cannot be 1: Point needs a Point"),
        ("points", "p", "Track.points cannot be 'p'"),
        ("origin", track(), "Track.origin cannot be Track"),
        ("raw", "text", "bytes needs bytes"),
        ("code", b"abcd", "exactly 3 bytes"),
        ("label", "Größe", "at most 4 bytes"),
        ("raw", list(range(100)), r"\.\.\.: bytes needs bytes"),
    ],
)
def test_a_wrong_value_is_named_with_class_field_and_limits(field: str, value: object, words: str) -> None:
    with pytest.raises(LocalProtocolError, match=words):
        track(**{field: value})
    message = track()
    with pytest.raises(LocalProtocolError, match=words):
        setattr(message, field, value)


def test_what_changed_inside_is_checked_when_encoded() -> None:
    message = track()
    message.tags.append(7)  # type: ignore[arg-type]  # the slip under test
    with pytest.raises(LocalProtocolError, match=r"Track.tags\[1\] cannot be 7"):
        message.encode()


def test_an_unknown_field_is_named_with_the_known_ones() -> None:
    with pytest.raises(TypeError, match="Point has no field 'z'; it has x, y"):
        Point(x=1.0, y=1.0, z=1.0)  # type: ignore[call-arg]  # the slip under test
    point = Point(x=1.0, y=1.0)
    with pytest.raises(AttributeError, match="Point has no field 'z'; it has x, y"):
        point.z = 1.0  # type: ignore[attr-defined]  # the slip under test


@pytest.mark.parametrize(
    ("annotations", "words"),
    [
        ({"lux": complex}, "class Bad: field lux: complex has no form on the wire; use one of uint8"),
        ({"lux": int}, "field lux: int says no size on the wire: write int32"),
        ({"lux": float}, "field lux: float says no size"),
        ({"lux": list[complex]}, "field lux: complex has no form"),
        ({"lux": Annotated[list[float], AtMost(4)]}, "field lux: float says no size on the wire: write float32"),
        ({"lux": list}, "field lux: list has no form"),
        ({"lux": Annotated[uint8, AtMost(3)]}, "field lux"),
        ({"lux": Annotated[bytes, Octets(0)]}, "field lux"),
        ({"encode": bool}, "field encode needs another name"),
        ({"_hidden": bool}, "field _hidden needs another name"),
        ({"lux": "NoSuchType"}, "class Bad: name 'NoSuchType' is not defined"),
    ],
)
def test_a_field_without_a_form_on_the_wire_is_refused_at_once(annotations: dict[str, object], words: str) -> None:
    with pytest.raises(TypeError, match=words):
        type("Bad", (Message,), {"__annotations__": annotations})


def test_a_default_must_fit() -> None:
    with pytest.raises(TypeError, match=r"Bad.lux cannot be 256: uint8 needs a whole number from 0 to 255"):
        type("Bad", (Message,), {"__annotations__": {"lux": uint8}, "lux": 256})


def test_a_list_of_messages_without_fields_is_refused() -> None:
    empty = type("Empty", (Message,), {})
    assert empty().encode() == b""
    with pytest.raises(TypeError, match="has no form on the wire"):
        type("Bad", (Message,), {"__annotations__": {"items": list[empty]}})  # type: ignore[valid-type]  # made above


def test_padding_after_the_message_is_accepted_and_more_is_not() -> None:
    assert HelloWorld.decode(HELLO + b"\0\0\0").index == 1
    with pytest.raises(RemoteProtocolError, match="4 bytes left over after HelloWorld"):
        HelloWorld.decode(HELLO + b"\0\0\0\0")


def test_a_list_longer_than_the_message_is_refused_before_it_is_built() -> None:
    class Numbers(Message):
        values: list[uint32]

    assert Numbers.decode(Numbers(values=[1, 2]).encode()).values == [1, 2]
    with pytest.raises(RemoteProtocolError, match="a list of 4294967295 uint32 in 4 bytes"):
        Numbers.decode(b"\xff\xff\xff\xff\0\0\0\0")


def test_a_text_beyond_its_bound_is_refused() -> None:
    class Short(Message):
        label: Annotated[str, AtMost(2)]

    with pytest.raises(RemoteProtocolError, match="a str of 3 where at most 2 bytes are agreed"):
        Short.decode(b"\4\0\0\0abc\0")


texts = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), max_size=20)
singles = st.floats(width=32, allow_nan=False)
points = st.builds(Point, x=singles, y=singles)
tracks = st.builds(
    Track,
    ready=st.booleans(),
    stamp=st.integers(-(1 << 63), (1 << 63) - 1),
    name=texts,
    tags=st.lists(texts, max_size=5),
    points=st.lists(points, max_size=5),
    origin=points,
    raw=st.binary(max_size=20),
    code=st.binary(min_size=3, max_size=3),
    label=st.text("abcd", max_size=4),
)


@given(tracks)
def test_every_message_comes_back_as_it_went(message: Track) -> None:
    assert Track.decode(message.encode()) == message


@given(damaged(tracks.map(Track.encode)))
def test_a_damaged_message_raises_nothing_but_remote_protocol_error(octets: bytes) -> None:
    message = read_or_refused(Track.decode, octets)
    if message is not None:
        assert repr(Track.decode(message.encode())) == repr(message)


@given(damaged(tracks.map(Track.encode)) | st.just(HELLO) | st.binary(max_size=60))
def test_any_octets_are_a_message_or_a_remote_protocol_error(octets: bytes) -> None:
    classes: tuple[type[Message], ...] = (HelloWorld, Track, Point)
    for message_class in classes:
        message = read_or_refused(message_class.decode, octets)
        if message is not None:
            assert repr(message_class.decode(message.encode())) == repr(message)
