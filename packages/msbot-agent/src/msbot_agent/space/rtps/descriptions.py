"""What participants tell each other of themselves and of their writers and readers (DDSI-RTPS 2.3 §9.6). Pure."""

from __future__ import annotations

from struct import Struct
from struct import error as StructError

from msbot_agent.space.contract import Guid, Qos
from msbot_agent.space.rtps.rtps_message_reader import parameters
from msbot_agent.space.rtps.rtps_messages import END_OF_PARAMETERS, PROTOCOL, SENTINEL, VENDOR, Prefix, parameter
from msbot_xrce.errors import RemoteProtocolError
from msbot_xrce.lazy import dataclass

Address = tuple[str, int]

LITTLE = b"\x00\x03\x00\x00"
"""Encapsulation header of a list of parameters, little endian."""
_BIG = b"\x00\x02"

MOST_LOCATORS = 4
"""Addresses of one participant that are tried."""
LONGEST_NAME = 1024

USER_DATA, PROTOCOL_VERSION, VENDOR_ID = 0x002C, 0x0015, 0x0016
LEASE, NAME, TOPIC, TYPE = 0x0002, 0x0062, 0x0005, 0x0007
DURABILITY, RELIABILITY, DEADLINE, OWNERSHIP, PARTITION = 0x001D, 0x001A, 0x0023, 0x001F, 0x0029
UNICAST, DEFAULT_UNICAST, META_UNICAST = 0x002F, 0x0031, 0x0032
PARTICIPANT_GUID, ENDPOINT_GUID, BUILTIN_ENDPOINTS, HISTORY = 0x0050, 0x005A, 0x0058, 0x0040

BUILTIN = 0x3F
"""Announces and hears participants, writers and readers."""
FOR_EVER = b"\xff\xff\xff\x7f\xff\xff\xff\xff"
_UDP4 = 1

_U32 = Struct("<I")
_LOCATOR = Struct("<iI12x4s")
_PAIR = Struct("<II")
_DURATION = Struct("<iI")
_RELIABILITY = Struct("<IiI")


@dataclass(frozen=True, slots=True)
class ParticipantDescription:
    """A participant as it tells of itself."""

    prefix: Prefix
    vendor: bytes
    meta: tuple[Address, ...]
    """Where it hears discovery."""
    default: tuple[Address, ...]
    """Where it hears samples."""
    lease_s: float
    name: str = ""
    user_data: bytes = b""


@dataclass(frozen=True, slots=True)
class EndpointDescription:
    """A writer or reader as its participant tells of it."""

    guid: Guid
    topic: str
    type_name: str
    qos: Qos
    locators: tuple[Address, ...] = ()
    """Where it hears, if not where its participant does."""
    user_data: bytes = b""


def write_participant(of: ParticipantDescription) -> bytes:
    """A description as its payload."""
    return LITTLE + b"".join(
        (
            parameter(PROTOCOL_VERSION, PROTOCOL),
            parameter(VENDOR_ID, VENDOR),
            parameter(PARTICIPANT_GUID, of.prefix + b"\x00\x00\x01\xc1"),
            parameter(BUILTIN_ENDPOINTS, _U32.pack(BUILTIN)),
            parameter(LEASE, _DURATION.pack(int(of.lease_s), 0)),
            *(parameter(META_UNICAST, _locator(address)) for address in of.meta),
            *(parameter(DEFAULT_UNICAST, _locator(address)) for address in of.default),
            parameter(NAME, _string(of.name)),
            parameter(USER_DATA, _octets(of.user_data)),
            END_OF_PARAMETERS,
        )
    )


def write_participant_key(prefix: Prefix) -> bytes:
    """What tells which participant is gone."""
    return LITTLE + parameter(PARTICIPANT_GUID, prefix + b"\x00\x00\x01\xc1") + END_OF_PARAMETERS


def write_endpoint(of: EndpointDescription) -> bytes:
    """A description as its payload."""
    qos = of.qos
    found = [
        parameter(ENDPOINT_GUID, of.guid),
        parameter(PARTICIPANT_GUID, of.guid[:12] + b"\x00\x00\x01\xc1"),
        parameter(PROTOCOL_VERSION, PROTOCOL),
        parameter(VENDOR_ID, VENDOR),
        parameter(TOPIC, _string(of.topic)),
        parameter(TYPE, _string(of.type_name)),
        parameter(RELIABILITY, _RELIABILITY.pack(2 if qos.reliable else 1, 0, 429496729)),
        parameter(DURABILITY, _U32.pack(1 if qos.transient_local else 0)),
        parameter(HISTORY, _PAIR.pack(0, max(1, qos.depth))),
    ]
    if qos.partitions:
        names = b"".join(_aligned(_string(name)) for name in qos.partitions)
        found.append(parameter(PARTITION, _U32.pack(len(qos.partitions)) + names))
    if of.user_data:
        found.append(parameter(USER_DATA, _octets(of.user_data)))
    return LITTLE + b"".join(found) + END_OF_PARAMETERS


def write_endpoint_key(guid: Guid) -> bytes:
    """What tells which endpoint is gone."""
    return LITTLE + parameter(ENDPOINT_GUID, guid) + END_OF_PARAMETERS


def read_participant(payload: bytes) -> ParticipantDescription:
    """A payload as the description.

    Raises:
        RemoteProtocolError: it is none.
    """
    guid, vendor, lease, name, user_data = b"", bytes(2), 100.0, "", b""
    meta: list[Address] = []
    default: list[Address] = []
    for number, value, little in _list(payload):
        if number == PARTICIPANT_GUID:
            guid = value[:16]
        elif number == VENDOR_ID:
            vendor = value[:2]
        elif number == LEASE:
            lease = _seconds(value, little)
        elif number == META_UNICAST:
            _add_locator(meta, value, little)
        elif number == DEFAULT_UNICAST:
            _add_locator(default, value, little)
        elif number == NAME:
            name = _read_string(value, little)
        elif number == USER_DATA:
            user_data = _read_octets(value, little)
    if len(guid) != 16:
        raise RemoteProtocolError("a participant without a GUID")
    return ParticipantDescription(guid[:12], vendor, tuple(meta), tuple(default or meta), lease, name, user_data)


def read_endpoint(payload: bytes) -> EndpointDescription:
    """A payload as the description.

    Raises:
        RemoteProtocolError: it is none.
    """
    guid, topic, type_name, user_data = b"", "", "", b""
    # What a reader that says nothing asks for: the defaults of the standard.
    reliable = transient_local = exclusive = False
    deadline: float | None = None
    partitions: tuple[str, ...] = ()
    locators: list[Address] = []
    is_told = False
    for number, value, little in _list(payload):
        if number == ENDPOINT_GUID:
            guid = value[:16]
        elif number == TOPIC:
            topic = _read_string(value, little)
        elif number == TYPE:
            type_name = _read_string(value, little)
        elif number == RELIABILITY:
            is_told, reliable = True, _read_u32(value, little) >= 2
        elif number == DURABILITY:
            transient_local = _read_u32(value, little) >= 1
        elif number == OWNERSHIP:
            exclusive = _read_u32(value, little) == 1
        elif number == DEADLINE:
            deadline = None if value[:4] in (FOR_EVER[:4], b"\x7f\xff\xff\xff") else _seconds(value, little)
        elif number == PARTITION:
            partitions = _read_strings(value, little)
        elif number == UNICAST:
            _add_locator(locators, value, little)
        elif number == USER_DATA:
            user_data = _read_octets(value, little)
    if len(guid) != 16 or not topic:
        raise RemoteProtocolError("an endpoint without a GUID or a topic")
    if not is_told:
        reliable = is_writer(guid)
    qos = Qos(
        reliable=reliable,
        transient_local=transient_local,
        exclusive=exclusive,
        deadline_s=deadline,
        partitions=partitions,
    )
    return EndpointDescription(guid, topic, type_name, qos, tuple(locators), user_data)


def read_key(payload: bytes, parameter_number: int) -> Guid | None:
    """The GUID of what is gone; None where the payload does not tell it."""
    for number, value, _ in _list(payload):
        if number == parameter_number:
            return value[:16]
    return None


def is_writer(guid: Guid) -> bool:
    """Whether an endpoint is a writer, by the kind in its GUID (§9.3.1.2)."""
    return guid[15] & 0x0F in (2, 3)


def _list(payload: bytes) -> list[tuple[int, bytes, bool]]:
    if payload[:2] == LITTLE[:2]:
        little = True
    elif payload[:2] == _BIG:
        little = False
    else:
        raise RemoteProtocolError("no list of parameters")
    try:
        return [(number, value, little) for number, value, _ in parameters(payload, 4, little) if number != SENTINEL]
    except StructError as error:
        raise RemoteProtocolError(f"a list of parameters is too short ({error})") from error


def _read_u32(value: bytes, little: bool) -> int:
    if len(value) < 4:
        raise RemoteProtocolError("a parameter is too short")
    return int.from_bytes(value[:4], "little" if little else "big")


def _seconds(value: bytes, little: bool) -> float:
    return _read_u32(value, little) + _read_u32(value[4:], little) / (1 << 32)


def _read_string(value: bytes, little: bool) -> str:
    size = _read_u32(value, little)
    if size > min(len(value) - 4, LONGEST_NAME):
        raise RemoteProtocolError("a text ends behind its parameter")
    return value[4 : 4 + size].rstrip(b"\0").decode("utf-8", "replace")


def _read_octets(value: bytes, little: bool) -> bytes:
    size = _read_u32(value, little)
    if size > len(value) - 4:
        raise RemoteProtocolError("bytes end behind their parameter")
    return value[4 : 4 + size]


def _read_strings(value: bytes, little: bool) -> tuple[str, ...]:
    found, at = [], 4
    for _ in range(min(_read_u32(value, little), 64)):
        found.append(_read_string(value[at:], little))
        at += 4 + (_read_u32(value[at:], little) + 3 & ~3)
    return tuple(found)


def _add_locator(to: list[Address], value: bytes, little: bool) -> None:
    if len(value) < _LOCATOR.size or len(to) >= MOST_LOCATORS or _read_u32(value, little) != _UDP4:
        return
    address, port = ".".join(map(str, value[20:24])), _read_u32(value[4:], little)
    if 0 < port < 1 << 16 and value[20] not in (0, *range(224, 256)):
        to.append((address, port))


def _locator(address: Address) -> bytes:
    return _LOCATOR.pack(_UDP4, address[1], bytes(map(int, address[0].split("."))))


def _string(text: str) -> bytes:
    octets = text.encode() + b"\0"
    return _U32.pack(len(octets)) + octets


def _octets(octets: bytes) -> bytes:
    return _U32.pack(len(octets)) + octets


def _aligned(octets: bytes) -> bytes:
    return octets + bytes(-len(octets) & 3)
