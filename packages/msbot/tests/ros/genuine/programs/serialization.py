"""Reads messages of ROS 2 as octets and writes them again: "package/msg/Type HEX" on each line, in and out."""

import importlib
import sys

from rclpy.serialization import deserialize_message, serialize_message

HEADER = b"\x00\x01\x00\x00"

classes = {}
for line in sys.stdin:
    name, _, octets = line.strip().partition(" ")
    package, kind, type_name = name.split("/")
    if name not in classes:
        try:
            classes[name] = getattr(importlib.import_module(f"{package}.{kind}"), type_name)
        except (ImportError, AttributeError):
            classes[name] = None
    if classes[name] is None:
        print(name, "absent")
        continue
    message = deserialize_message(HEADER + bytes.fromhex(octets), classes[name])
    print(name, serialize_message(message)[4:].hex())
