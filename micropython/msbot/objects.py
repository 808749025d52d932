"""The descriptions of DDS-XRCE objects, and those that every part has; imported for a moment, and forgotten again."""

import struct

from micropython import const

from .cdr import put, put_text
from .xrce import ENDLESS, RELIABLE

PARTICIPANT = const(0x0011)
SUBSCRIBER = const(0x0014)
PUBLISHER = const(0x0013)
_PROFILE_TOPIC = const(0x0012)
_PROFILE_READER = const(0x0016)
_REQUESTER = const(0x0017)


def claim(part, nonce):
    """What a part says about itself when it asks for its place."""
    said = bytearray()
    put_text(said, part.part_number)
    put_text(said, part.local_name)
    said += part.uid
    put(said, "I", nonce)
    return bytes(said)


def create(client, shared):
    """Have what a part needs to join: it reads the robot's profile, and asks the inventory."""
    client.create(PARTICIPANT)  # without a name: nothing reveals the part before it knows its robot
    client.create(SUBSCRIBER, b"\0\0", PARTICIPANT)
    client.create(_PROFILE_TOPIC, topic_blob("msbot_masterTopic", "msbot_master"), PARTICIPANT)
    client.create(_PROFILE_READER, endpoint_blob(_PROFILE_TOPIC, True, b"\0\0"), SUBSCRIBER)
    client.create(_REQUESTER, service_blob("msbot_inventory"), PARTICIPANT)
    client.read(_PROFILE_READER, RELIABLE, None if shared else ENDLESS)
    client.read(_REQUESTER)


def topic_blob(name, type_name):
    """What describes a topic."""
    out = bytearray()
    put_text(out, name)
    out += b"\0\1" if type_name else b"\0\0"
    if type_name:
        put_text(out, type_name)
    return bytes(out)


def endpoint_blob(topic_id, reliable, end):
    """What describes a data writer (`end` is one zero octet) or data reader (two)."""
    return struct.pack(">HBBBBBBBB", topic_id, 1, 0, 3 if reliable else 2, 0, 0, 0, 0, 0) + end


def service_blob(name, request="", reply=""):
    """What describes a requester or replier of a service; its topics, and types without a name, are named after it."""
    out = bytearray()
    for text in (name, request or name + "_request", reply or name + "_reply"):
        put_text(out, text)
    for ending in ("_Request", "_Reply"):
        out.append(1)
        put_text(out, name + ending)
    return bytes(out)
