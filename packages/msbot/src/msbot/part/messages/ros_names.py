"""Names of types and fields as ROS 2 writes and allows them. Pure."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

from msbot.part.messages.type_hash import PACKAGE

__all__ = ["PACKAGE", "ros_field_names", "ros_name", "ros_stem", "service_stem"]

_FOREIGN: Final = re.compile(r"[^A-Za-z0-9]+")
_CAPITAL: Final = re.compile(r"(?<=[a-z0-9])([A-Z])")


def ros_name(type_name: str) -> str:
    """The name of a type as ROS 2 writes it: `std_msgs::msg::dds_::Float32_` is `std_msgs/msg/Float32`."""
    words = [word for word in type_name.split("::") if word]
    if len(words) == 4 and words[2] == "dds_":
        return f"{words[0]}/{words[1]}/{words[3].removesuffix('_')}"
    pieces = [piece for word in words for piece in _FOREIGN.split(word) if piece]
    name = "".join(piece[:1].upper() + piece[1:] for piece in pieces)
    return f"{PACKAGE}/msg/{name if name[:1].isalpha() else f'Type{name}'}"


def ros_stem(type_name: str) -> str:
    """The last word of that name: `ArmPose`."""
    return ros_name(type_name).rpartition("/")[2]


def service_stem(request: str, reply: str) -> str:
    """The last word of the name of a service in ROS 2, made of its messages: `SwitchToText`."""
    return f"{ros_stem(request)}To{ros_stem(reply)}"


def ros_field_names(names: Sequence[str]) -> list[str]:
    """The names as ROS 2 allows them: small letters, digits and single underscores between them."""
    allowed: list[str] = []
    for name in names:
        pieces = [piece for piece in _FOREIGN.split(_CAPITAL.sub(r"_\1", name).lower()) if piece]
        shown = "_".join(pieces)
        shown = shown if shown[:1].isalpha() else f"field_{shown}".rstrip("_")
        while shown in allowed:
            shown += "x"
        allowed.append(shown)
    return allowed
