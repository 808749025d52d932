"""What the robot's process hands to the recorder's: records, packed one after the other. Pure."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from enum import IntEnum
from pathlib import Path
from struct import Struct
from typing import Final

from msbot_xrce.errors import ConfigError, RemoteProtocolError
from msbot_xrce.lazy import dataclass

HEAD_FORMAT: Final = "<BHdI"
_HEAD: Final = Struct(HEAD_FORMAT)
head: Final = _HEAD.pack
"""`(kind, channel, seconds of the robot's clock, octets of the content)` as octets; the content follows."""
_BEGAN: Final = Struct("<q")
LARGEST_CONTENT: Final = 1 << 24
"""Octets of one record; more is a mistake of ours."""

Item = tuple[int, int, int, bytes]
"""`(kind, channel, nanoseconds since 1970, content)`."""


class Kind(IntEnum):
    """What a record is."""

    BEGAN = 0
    """The first: the nanoseconds since 1970 at which the robot's clock was 0."""
    CHANNEL = 1
    """A channel is declared: the content is a `RecordedChannel`."""
    SAMPLE = 2
    """Octets of a sample, CDR without an encapsulation header."""
    OBJECT = 3
    """A JSON object."""
    STATE = 4
    """A JSON object that holds until the next one with the same key: one octet with the key's length, the key, then the
    object. Every file of a ring begins with the latest ones."""
    START = 5
    """Record in one more file, whose path is the content."""
    STOP = 6
    """End the file that START or START_BAG began."""
    START_BAG = 7
    """Record in one more file what ROS 2 can read; the content is the path."""


@dataclass(frozen=True, slots=True)
class RecordedChannel:
    """Where records belong: what MCAP calls a channel, with its schema."""

    topic: str
    encoding: str
    """`cdr` or `json`."""
    schema_name: str = ""
    """Empty: what the octets mean is not known."""
    schema_encoding: str = ""
    """`ros2msg` or `jsonschema`."""
    schema: str = ""
    metadata: tuple[tuple[str, str], ...] = ()

    def encode(self) -> bytes:
        """The channel as octets."""
        fields = [self.topic, self.encoding, self.schema_name, self.schema_encoding, self.schema, list(self.metadata)]
        return json.dumps(fields).encode()

    @classmethod
    def decode(cls, content: bytes) -> RecordedChannel:
        """The channel in the octets."""
        topic, encoding, name, schema_encoding, schema, metadata = json.loads(content)
        return cls(topic, encoding, name, schema_encoding, schema, tuple((key, value) for key, value in metadata))


def encode_state(key: str, value: object) -> bytes:
    """The content of a STATE record."""
    octets = key.encode()[:255]
    return bytes((len(octets),)) + octets + encode_object(value)


def split_state(content: bytes) -> tuple[bytes, bytes]:
    """Key and object of a STATE record."""
    size = content[0]
    return content[1 : 1 + size], content[1 + size :]


def encode_object(value: object) -> bytes:
    """A JSON object as octets."""
    return json.dumps(value, ensure_ascii=False).encode("utf-8", "replace")


def encode_began(began_ns: int) -> bytes:
    """The content of a BEGAN record."""
    return _BEGAN.pack(began_ns)


class Unpacker:
    """Takes octets in pieces of any size, and gives the whole records among them."""

    def __init__(self) -> None:
        self._rest = b""
        self._began_ns = 0

    def feed(self, octets: bytes) -> Iterator[Item]:
        """The records that are complete now.

        Raises:
            RemoteProtocolError: these are not records.
        """
        data = self._rest + octets if self._rest else octets
        at, size, end = 0, _HEAD.size, len(data)
        while at + size <= end:
            kind, channel, at_s, length = _HEAD.unpack_from(data, at)
            if length > LARGEST_CONTENT:
                raise RemoteProtocolError(f"a record of {length} bytes")
            if at + size + length > end:
                break
            at += size + length
            content = data[at - length : at]
            if kind == Kind.BEGAN:
                (self._began_ns,) = _BEGAN.unpack(content)
            else:
                yield kind, channel, self._began_ns + round(at_s * 1e9), content
        self._rest = data[at:]


# What a person wants to be recorded: the value of `--rec`.


RING_S: Final = 600.0
RING_OCTETS: Final = 256 << 20
LEAST_S: Final = 10.0
LEAST_OCTETS: Final = 1 << 20
MOST_S: Final = 30 * 24 * 3600.0
MOST_OCTETS: Final = 1 << 40
SUFFIX: Final = ".mcap"
BAG: Final = "ros2"
_SECONDS: Final = {"s": 1, "min": 60, "h": 3600}
_OCTETS: Final = {"MB": 1 << 20, "GB": 1 << 30}
_AMOUNT: Final = re.compile(r"(\d+(?:\.\d+)?)\s*(s|min|h|MB|GB)", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class RecordingRequest:
    """How much is recorded, and where."""

    on: bool = True
    seconds: float = RING_S
    octets: int = RING_OCTETS
    """The ring keeps at most so much."""
    file: Path | None = None
    """A file that gets everything from the start as well."""
    is_bag: bool = False
    """The file is a bag of ROS 2: it gets what ROS 2 can read."""


def bag_wish(text: str) -> tuple[str, bool]:
    """The file that is wished for, and whether as a bag of ROS 2: `bag.mcap,ros2`."""
    name, comma, rest = text.rpartition(",")
    return (name, True) if comma and rest.strip().lower() == BAG else (text, False)


def read_wish(text: str) -> RecordingRequest:
    """The wish in the text.

    Raises:
        ConfigError: it is none; the text says what would be.
    """
    if text.strip().lower() == "off":
        return RecordingRequest(on=False)
    name, is_bag = bag_wish(text)
    if name.lower().endswith(SUFFIX):
        return RecordingRequest(file=Path(name), is_bag=is_bag)
    seconds: float | None = None
    octets: int | None = None
    for word in text.split(","):
        match = _AMOUNT.fullmatch(word.strip())
        unit = "" if match is None else match[2].upper() if match[2].upper() in _OCTETS else match[2].lower()
        if match is None or (unit in _OCTETS and octets is not None) or (unit in _SECONDS and seconds is not None):
            raise ConfigError(
                f'{text!r}: say how much to keep ("10min", "2h", "500MB", "30min,500MB"), '
                f'a file ("lesson{SUFFIX}", "bag{SUFFIX},ros2"), or "off"'
            )
        if unit in _OCTETS:
            octets = round(float(match[1]) * _OCTETS[unit])
        else:
            seconds = float(match[1]) * _SECONDS[unit]
    wish = RecordingRequest(
        seconds=RING_S if seconds is None else seconds, octets=RING_OCTETS if octets is None else octets
    )
    if not LEAST_S <= wish.seconds <= MOST_S or not LEAST_OCTETS <= wish.octets <= MOST_OCTETS:
        raise ConfigError(f"{text!r}: at least 10s and 1MB, at most 720h and 1024GB")
    return wish


# Names in recordings that both writers and readers use.


INVENTORY_TOPICS: Final = "/msbot_inventory_"
"""How topics begin on which parts and the inventory talk."""
OWN_TOPICS: Final = ("/msbot/", INVENTORY_TOPICS)
"""How topics of MsBOT itself begin."""
MEASURED: Final = "/msbot/measured"
"""What was measured at the robot itself: how late the master is, and the beats of each slot."""
BLUEPRINT: Final = "/msbot/blueprint"
"""The robot's slots and wires."""
SHOWN: Final = "/msbot/shown"
"""What people do by hand, and planted faults."""
SLOTS: Final = "/msbot/slots"
"""What holds a slot."""
BITRATE: Final = "bits_per_second"
"""In the metadata of a bus' channel."""
DATA_BITRATE: Final = "data_bits_per_second"
"""Likewise, where CAN FD frames have a faster part."""
