"""Any type that a library can declare: the same octets here, on boards and for a foreign reader of recordings."""

from __future__ import annotations

import json
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory

from msbot.config import EnumType, FieldType, ListType, MessageType, load_library, read_description, type_from_words
from msbot.config.library.field_types import BoundedText, FieldKind, fault_of
from msbot.part import Message, Part
from msbot.part.description import describe
from msbot.part.messages.leaves import leaves_of, set_leaf, with_leaves
from msbot.part.messages.message import fields_of
from msbot.part.messages.standard import Picture, PixelFormat, Pose, Scan, Strip
from msbot.part.messages.type_hash import described_types, type_hash
from msbot.recording.recorder.recording_file import ENCAPSULATION
from msbot.recording.recorder.schemas import ENCODING, ros_definition
from msbot.sim.model_part import message_class
from msbot_agent.toml.document import parse_document
from msbot_agent.toml.problems import Problems
from msbot_agent.toml.table import Table
from msbot_xrce.errors import ConfigError, LocalProtocolError
from tests.homes import micro

PART = 'number = "ARM"\nname = "Arm"\n[[port]]\nname = "arm"\ndirection = "subscribe"\ntype = "Arm"\n'
TYPES = """
[[type]]
name = "Mode"
enum = ["off", "slow", "fast"]
[[type]]
name = "Joint"
fields = { degrees = "float32", mode = "Mode" }
units = { degrees = "°" }
[[type]]
name = "Arm"
fields = { base = "Joint", three = "int16[3]", joints = "Joint[<=4]", log = "string<=8", places = "Colour[<=2]" }
"""


def simple() -> st.SearchStrategy[FieldType]:
    kinds = [kind for kind in FieldKind if kind is not FieldKind.TEXT]
    names = ("off", "on", "both")
    others = st.builds(BoundedText, st.integers(1, 12)) | st.just(EnumType("Mode", names))
    return st.sampled_from(kinds) | st.just(FieldKind.TEXT) | others


@st.composite
def any_type(draw: st.DrawFn, depth: int = 2, name: str = "Any") -> MessageType:
    fields: dict[str, FieldType] = {}
    for place in range(draw(st.integers(1, 4))):
        kind: Any = draw(simple())
        if depth and draw(st.booleans()):
            kind = draw(any_type(depth=depth - 1, name=f"{name}{place}"))
        if draw(st.booleans()):
            kind = ListType(kind, draw(st.integers(1, 5)), is_fixed=draw(st.booleans()))
        fields[f"f{place}"] = kind
    return MessageType(name, fields)


def value(draw: st.DrawFn, kind: FieldType) -> Any:
    """A value as JSON has it."""
    match kind:
        case MessageType():
            return [value(draw, one) for one in kind.fields.values()]
        case ListType():
            size = kind.most if kind.is_fixed else draw(st.integers(0, kind.most))
            return [value(draw, kind.element) for _ in range(size)]
        case EnumType():
            return draw(st.sampled_from(kind.names))
        case BoundedText():
            return draw(st.text(st.characters(min_codepoint=32, max_codepoint=126), max_size=kind.most))
        case FieldKind.TEXT:
            return draw(st.text(st.characters(min_codepoint=32, max_codepoint=0x2FF), max_size=9))
        case FieldKind.BOOL:
            return draw(st.booleans())
        case FieldKind.FLOAT32 | FieldKind.FLOAT64:
            return draw(st.floats(width=32, allow_nan=False, allow_infinity=False))
        case _:
            return draw(st.integers(*kind.limits))


def made(kind: MessageType, values: list[Any]) -> Message:
    """The message with these values, set by its leaves."""
    message = message_class(kind)()
    for name, one, inside in zip(kind.fields, values, kind.fields.values(), strict=True):
        if isinstance(inside, MessageType):
            setattr(message, name, made(inside, one))
        else:
            set_leaf(message, name, json.dumps(one) if isinstance(one, list) else one)
    return message


def on_a_board(kind: FieldType) -> Any:
    """The same type as a board's program has it."""
    lists = micro.load("lists")
    match kind:
        case MessageType():
            fields = tuple((name, on_a_board(one)) for name, one in kind.fields.items())
            return type(kind.name, (micro.load("message").Message,), {"_fields": fields})
        case ListType():
            return lists.ListKind(on_a_board(kind.element), "=" if kind.is_fixed else "<=", kind.most)
        case EnumType():
            numbers = {name.upper(): place for place, name in enumerate(kind.names)}
            return lists.EnumKind(type(kind.name, (lists.IntEnum,), numbers))
        case BoundedText():
            return lists.TextKind(kind.most)
        case _:
            from msbot.config.library.board_document import CODES

            return {"s": str, "?": bool}.get(CODES[kind], CODES[kind])


def foreign(told: object) -> Any:
    """A message that a reader of MCAP files has decoded, as JSON has it."""
    if hasattr(told, "__slots__") and not isinstance(told, str | bytes | int | float):
        return [foreign(getattr(told, name)) for name in told.__slots__]
    return [foreign(one) for one in told] if isinstance(told, list | tuple | bytes) else told


def numbered(kind: FieldType, one: Any) -> Any:
    """With the numbers of enums, which ROS 2 does not have."""
    match kind:
        case MessageType():
            return [numbered(inner, part) for inner, part in zip(kind.fields.values(), one, strict=True)]
        case ListType():
            return [numbered(kind.element, part) for part in one]
        case EnumType():
            return kind.names.index(one)
        case _:
            return one


@given(any_type(), st.data())
@settings(max_examples=40, deadline=None)
def test_any_type_is_the_same_in_every_home_and_for_a_foreign_reader(kind: MessageType, data: st.DataObject) -> None:
    values = value(data.draw, kind)  # type: ignore[arg-type]  # a function that draws
    assert fault_of(kind, values) is None
    message = made(kind, values)
    octets = message.encode()
    cls = message_class(kind)
    assert cls.decode(octets) == message
    assert with_leaves(cls, leaves_of(message)) == message
    if kind.size_bytes is not None:
        assert len(octets) == kind.size_bytes == kind.most_bytes
    board = on_a_board(kind)
    assert board.decode(octets).encode() == octets
    types = described_types(cls)
    assert types == {name: list(fields) for name, fields in kind.described().items()}
    assert micro.load("type_hash").type_hash(board) == type_hash(kind.name, types[kind.name], types.get)
    again = type_from_words(kind.name, {name: dict(fields) for name, fields in kind.described().items()}, {})
    assert again.same_as(kind)
    schema = Schema(id=1, name=f"msbot_msgs/msg/{kind.name}", encoding=ENCODING, data=ros_definition(cls).encode())
    decode = DecoderFactory().decoder_for("cdr", schema)
    assert decode is not None
    assert foreign(decode(ENCAPSULATION + octets)) == numbered(kind, values)


def arm() -> MessageType:
    problems = Problems()
    document = parse_document(PART + TYPES, "arm.toml", problems)
    assert document is not None
    from msbot.config.library.message_types import read_message_types

    found = read_message_types(Table(document, problems, document.values), "arm.toml")
    problems.raise_if_any()
    return found[-1][1]


def test_a_part_describes_types_with_others_inside_and_the_robot_reads_them() -> None:
    cls = message_class(arm())
    part = Part("ARM", local_name="Arm", describes=True)

    @part.on("arm", cls, safe=cls(three=[1, 2, 3]))
    def move(_message: Message) -> None: ...

    text = describe("ARM", "Arm", part.program)
    described = read_description(text, "ARM", load_library())
    (port,) = described.part_type.ports
    assert port.message is not None
    assert port.message.same_as(arm())
    assert port.safe is not None
    assert port.safe["three"] == "[1, 2, 3]"
    assert port.safe["base.mode"] == "off"
    again = read_description(described.toml, "ARM", load_library()).part_type.ports[0].message
    assert again is not None
    assert again.same_as(port.message)


WRONG = [
    (
        '"int16[3]"',
        '"int16[]"',
        'how many can there be? Write "int16[<=64]" for at most 64, "int16[64]" for exactly 64',
    ),
    ('"int16[3]"', '"int16<=3"', 'only a text has a length: write "int16[<=3]" for a list'),
    ('"int16[3]"', '"int16[<=9999]"', "a list may have at most 4,096 elements"),
    ('"int16[3]"', '"float64[600]"', "a message can have 4,"),
    ('"int16[3]"', '"int16[3"', '"int16[3" is no kind of field; write for example float32, text<=32'),
    ('"int16[3]"', '"Arm"', 'there is no kind of field "Arm"'),
    ('"slow"', '"OFF"', "must be 1 to 64 names, each different"),
]


@pytest.mark.parametrize(("right", "wrong", "sentence"), WRONG)
def test_what_is_wrong_is_one_sentence(right: str, wrong: str, sentence: str) -> None:
    with pytest.raises(ConfigError) as caught:
        read_description((PART + TYPES).replace(right, wrong), "ARM", load_library())
    assert sentence in str(caught.value)


def test_types_that_multiply_cost_no_time() -> None:
    """Each is small, all together are not: nothing is counted out that is refused anyway."""
    rows = "".join(
        f'[[type]]\nname = "T{at}"\nfields = {{ a = "{f"T{at - 1}[4096]" if at else "uint8[4096]"}" }}\n'
        for at in range(20)
    )
    with pytest.raises(ConfigError, match=r"a message can have .* bytes, and may have 4,096"):
        read_description(PART.replace('"Arm"', '"T19"', 2) + rows, "ARM", load_library())


def zero(cls: type[Message]) -> Message:
    return cls()


def test_a_leaf_that_does_not_exist_or_fit_is_said() -> None:
    with pytest.raises(LocalProtocolError, match="Pose has no field 'z'; it has x, y, degrees"):
        set_leaf(zero(Pose), "z", 1.0)
    with pytest.raises(LocalProtocolError, match=r"Scan\.metres cannot be 'near': write a list such as"):
        set_leaf(zero(Scan), "metres", "near")
    with pytest.raises(
        LocalProtocolError, match=r"Strip\.colours\[0\] cannot be \[1, 2\]: Colour needs a Colour with red"
    ):
        set_leaf(zero(Strip), "colours", "[[1, 2]]")
    with pytest.raises(LocalProtocolError, match=r"\{'red': 1\} has no green, blue; a Colour has red, green, blue"):
        set_leaf(zero(Strip), "colours", '[{"red": 1}]')
    with pytest.raises(LocalProtocolError, match="has an unknown field rot; a Colour has red, green, blue"):
        set_leaf(zero(Strip), "colours", '[{"red": 1, "green": 2, "blue": 3, "rot": 4}]')
    picture = with_leaves(Picture, {"width": 2, "height": 1, "format": "mono8", "pixels": "[0, 255]"})
    assert picture == Picture(width=2, height=1, format=PixelFormat.MONO8, pixels=b"\x00\xff")
    assert [field.codec.kind for field in fields_of(Picture)][-1] == "uint8[<=3072]"
