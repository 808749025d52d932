"""A library with services, and what ROS 2 has to make of its types."""

from __future__ import annotations

import re
from pathlib import Path

from msbot.config import Library, MessageType, load_library
from msbot.part.messages.ros_names import PACKAGE, ros_field_names, ros_name
from msbot.part.messages.type_hash import type_hash

LAMP = """
number = "LAMP-1"
name = "Lamp"
[[port]]
name = "light"
direction = "serve"
request = "Switch"
reply = "Text"
[[port]]
name = "reach"
direction = "call"
request = "arm-1"
reply = "Picture"
[[type]]
name = "Mode"
enum = ["off", "half_on"]
[[type]]
name = "Joint"
fields = { degrees = "float32", mode = "Mode" }
units = { degrees = "°" }
[[type]]
name = "arm-1"
description = '''
An arm
of three joints'''
[type.fields]
modeX = "Mode"
more = "Mode[<=3]"
joints = "Joint[3]"
name = "text<=8"
names = "text<=4[2]"
marks = "Colour[<=2]"
bytes = "uint8[<=9]"
"""


def library(folder: Path) -> Library:
    (folder / "library").mkdir()
    (folder / "library" / "lamp.toml").write_text(LAMP)
    return load_library(folder / "library")


def ros_hash(message: MessageType, name: str = "") -> str:
    """The beginning of the hash of a type with the fields of ours, and numbers for enums.

    Args:
        message: ours.
        name: in DDS; empty for the message of that name.
    """
    described = message.described()
    enums = {one for one, fields in described.items() if fields[0][1].isdecimal()}

    def dds_name(type_name: str) -> str:
        return f"{PACKAGE}::msg::dds_::{ros_name(type_name).rpartition('/')[2]}_"

    def kind(word: str) -> str:
        base = re.split(r"[\[<]", word)[0]
        shown = "uint32" if base in enums else dds_name(base) if base in described else base
        return shown + word[len(base) :]

    types = {
        dds_name(one): [
            (shown, kind(word))
            for shown, (_, word) in zip(ros_field_names([field for field, _ in fields]), fields, strict=True)
        ]
        for one, fields in described.items()
        if one not in enums
    }
    return type_hash(name or dds_name(message.name), types[dds_name(message.name)], types.get).hex()


def service_hashes(stem: str, request: MessageType, reply: MessageType) -> dict[str, str]:
    """The hashes of the two halves of a service, by their names in ROS 2."""
    return {
        f"{PACKAGE}/srv/{stem}_{end}": ros_hash(one, f"{PACKAGE}::srv::dds_::{stem}_{end}_")
        for end, one in (("Request", request), ("Response", reply))
    }
