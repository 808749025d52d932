"""Message classes as ROS 2 interface definitions, which readers of MCAP files understand without MsBOT."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping, Sequence
from enum import IntEnum
from struct import Struct
from typing import Annotated, ClassVar, Final, get_args, get_origin, get_type_hints

from msbot.config import Blueprint, InDds, Scalar
from msbot.part import Message
from msbot.part.messages.ros_names import ros_field_names, ros_name
from msbot.part.messages.wire_types import AtMost, Exactly, Number, Octets
from msbot.pnp import PartEvent
from msbot.recording.recorder.batch import HEAD_FORMAT
from msbot.service_types import service_type
from msbot_agent.link.can.protocol import Frame
from msbot_agent.ros.node_names import topic_of
from msbot_agent.text.sentence import to_json

ENCODING: Final = "ros2msg"
_RULE: Final = "=" * 80
_FOREIGN: Final = re.compile(r"[^A-Za-z0-9]+")


def ros_topic(topic: str) -> str:
    """The name of a topic as ROS 2 allows it: words of letters, digits and single underscores, `/` between them."""
    words = (_FOREIGN.sub("_", word) for word in topic.split("/") if word)
    return "".join(f"/{'_' if word[0].isdigit() else ''}{word}" for word in words) or "/_"


def ros_definition(cls: type[Message]) -> str:
    """The fields of a class, and those of all classes inside it, as one text."""
    inside: dict[type[Message], None] = {}
    parts = [_lines(cls, inside)]
    done: set[type[Message]] = set()
    while waiting := [other for other in inside if other not in done]:
        for other in waiting:
            done.add(other)
            parts.append(f"{_RULE}\nMSG: {_short(other)}\n{_lines(other, inside)}")
    return "\n".join(parts)


def _short(cls: type[Message]) -> str:
    package, _, name = ros_name(cls.type_name).split("/")
    return f"{package}/{name}"


def _lines(cls: type[Message], inside: dict[type[Message], None]) -> str:
    hints = get_type_hints(cls, include_extras=True)
    fields = {name: kind for name, kind in hints.items() if get_origin(kind) is not ClassVar}
    names = ros_field_names(list(fields))
    return "\n".join(f"{_word(kind, inside)} {name}" for name, kind in zip(names, fields.values(), strict=True))


def _word(annotation: object, inside: dict[type[Message], None]) -> str:
    base: object = annotation
    marks: list[object] = []
    if get_origin(annotation) is Annotated:
        base, *marks = get_args(annotation)
    match next((mark for mark in marks if isinstance(mark, Number | Octets | AtMost | Exactly)), None):
        case Number(word):
            return word
        case Octets(length):
            return f"uint8[{length}]"
        case Exactly(length):
            return f"{_word(get_args(base)[0], inside)}[{length}]"
        case AtMost(length) if base is str:
            return f"string<={length}"
        case AtMost(length):
            element = "uint8" if base is bytes else _word(get_args(base)[0], inside)
            return f"{element}[<={length}]"
    return _plain(base, inside)


def _plain(base: object, inside: dict[type[Message], None]) -> str:
    if get_origin(base) is list:
        return f"{_word(get_args(base)[0], inside)}[]"
    if isinstance(base, type) and issubclass(base, Message):
        inside.setdefault(base)
        return _short(base)
    if isinstance(base, type) and issubclass(base, IntEnum):
        return "uint32"  # an enum of IDL has 32 bits in CDR; ROS 2 has none
    return {bool: "bool", str: "string", bytes: "uint8[]"}[base]  # type: ignore[index]  # no other has a form on the wire


# What a recording tells of a topic that ROS 2 has, too: its name and type there, and which field is which.
#
# So a program that has neither the robot's blueprint nor its library can write the messages as ROS 2 has them.


ROS_TOPIC: Final = "ros_topic"
"""`/ROVER/power`"""
ROS_TYPE: Final = "ros_type"
"""`std_msgs/msg/Float32`"""
ROS_FIELDS: Final = "ros_fields"
"""`[[0, "data", 1.0]]`: position of our field, their field, theirs is ours times."""
NO_FIELDS: Final = "[]"
"""The same for a type that has the fields of ours."""


def topics_in_ros(blueprint: Blueprint) -> dict[str, tuple[str, InDds]]:
    """The topics of a robot that ROS 2 has: their names there, and what the blueprint says about them."""
    robot = blueprint.robot.name
    return {
        one.topic: (topic_of(robot, one.in_dds.ros_topic or one.topic).removeprefix("rt"), one.in_dds)
        for one in blueprint.bindings
        if one.in_dds.ros and service_type(one.type_name) is None
    }


def ros_metadata(shared: tuple[str, InDds], cls: type[Message]) -> dict[str, str]:
    """What a channel of such a topic says.

    Args:
        shared: as `topics_in_ros` has it.
        cls: the class of the topic's messages.

    Raises:
        ConfigError: ROS 2 has no form for it; a robot with such a blueprint does not start.
    """
    from msbot.ros2.forms import form_of  # with all messages of ROS 2, which few robots need

    name, wish = shared
    form = form_of(cls, wish.ros_type, dict(wish.ros_fields))
    return {ROS_TOPIC: name, ROS_TYPE: ros_name(form.theirs.type_name), ROS_FIELDS: json.dumps(form.fields)}


# How a CAN frame is recorded.


FRAME: Final = Struct("<IBBBBBBBBI")
FRAME_OCTETS: Final = FRAME.size
"""Octets of a recorded frame without its data."""
PLAIN_FRAMES: Final = tuple(Struct(f"{HEAD_FORMAT}IQI{size}s").pack for size in range(9))
"""By number of octets of data: `(what the head takes ..., identifier, 0 or SENT, octets of data, data)` as the whole
record of a classic data frame with 11 bits of identifier and no flag. It has the same octets as `frame_octets` gives,
in half the time: the eight small fields between identifier and data are one number here."""
SENT: Final = 1 << 48
FRAME_TYPE: Final = "msbot_msgs/msg/CanFrame"
FRAME_DEFINITION: Final = """\
uint32 can_id
bool extended
bool fd
bool brs
bool esi
bool remote
bool error
bool sent
uint8 dlc
uint8[] data"""
"""`sent`: by the master itself. `dlc`: of a remote frame the length asked for, of a classic frame with a data length
code over 8 that code, else 0."""


def frame_octets(frame: Frame, *, is_sent: bool) -> bytes:
    """A frame as a sample of `FRAME_TYPE`."""
    data = frame.data
    fixed = FRAME.pack(
        frame.can_id,
        frame.extended,
        frame.fd,
        frame.brs,
        frame.esi,
        frame.remote,
        frame.error,
        is_sent,
        frame.remote_length or frame.long_dlc,
        len(data),
    )
    return fixed + data


# How a recording tells what a robot is: its blueprint, the changes of its parts, and what people do to it by hand.


def blueprint_words(blueprint: Blueprint, links: Sequence[str]) -> dict[str, object]:
    """Slots and wires, as `/msbot/blueprint` has them."""
    timing = blueprint.timing
    return {
        "beat_s": timing.beat_period_s,
        "tick_s": timing.tick_period_s,
        "life": timing.life,
        "links": [*links],
        "slots": [
            {"slot": one.name, "part_number": one.part_number, "description": one.description}
            for one in blueprint.slots
        ],
        "wires": [
            {
                "topic": one.topic,
                "type": one.type_name,
                "reliable": one.reliable,
                "from": [one.source.slot, one.source.port],
                "to": [[end.slot, end.port] for end in one.targets],
            }
            for one in blueprint.bindings
        ],
    }


def event_words(event: PartEvent) -> dict[str, object]:
    """A change of a part's state, as `/msbot/events` has it."""
    return {
        "part": event.part,
        "slot": event.slot,
        "part_number": event.part_number,
        "from": None if event.from_state is None else event.from_state.value,
        "to": event.to_state.value,
        "reason": event.reason,
        "evidence": [list(pair) for pair in event.evidence],
        "uid": event.uid.hex(),
        "client_key": event.client_key,
        "words": event.sentences()[0],
        "identity": event.identity.hex(),
        "said": to_json(event.reason),
    }


def shown_words(
    by_hand: Mapping[tuple[str, str], Mapping[str, Scalar]],
    faults: Callable[[str], Sequence[str]],
    blueprint: Blueprint,
) -> dict[str, object]:
    """What pages show besides, as `/msbot/shown` has it: values driven by hand, and faults as far as they are told."""
    told = {name: [to_json(words) for words in faults(name)] for name in ("", *(one.name for one in blueprint.slots))}
    return {
        "by_hand": [[slot, port, dict(fields)] for (slot, port), fields in by_hand.items()],
        "faults": {name: words for name, words in told.items() if words},
    }
