"""Messages that are right in most places: so the wrong field is met deep inside, not at the door."""

from __future__ import annotations

from random import Random

from fuzz.mutate import INTERESTING, WIDE
from msbot_xrce.messages import (
    COOKIE,
    OBJECT_AGENT,
    VERSION,
    Acknack,
    Create,
    CreateClient,
    Data,
    Delete,
    DeliveryControl,
    Fragment,
    GetInfo,
    Header,
    Heartbeat,
    Info,
    Locator,
    LocatorFormat,
    ObjectKind,
    ObjectVariant,
    ReadData,
    Reset,
    StatusAgent,
    StatusReply,
    Submessage,
    Timestamp,
    TimestampReply,
    WriteData,
    make_object_id,
)
from msbot_xrce.messages.ids import OBJECT_CLIENT
from msbot_xrce.objects import (
    EndpointQos,
    participant_variant,
    publisher_variant,
    reader_variant,
    replier_variant,
    requester_variant,
    subscriber_variant,
    topic_variant,
    writer_variant,
)

TOPICS = ("light", "light", "sound", "HelloWorldTopic", "ä" * 20, "x" * 255)
TYPES = ("T", "T", "T", "HelloWorld", "")
SERVICES = ("add", "add", "service_name", "")
KINDS = tuple(range(1, 9))
STREAMS = (0x80, 0x80, 0x80, 0x80, 0x01, 0x01, 0x00, 0x81, 0x02, 0x7F, 0xFF)
STATUSES = (0, 0, 0, 1, 0x80, 0x81, 0x82, 0x83, 0x84, 0x85, 0x87, 0xFF, 7)

_NUMBERS = (1,) * 47 + (0, 2, 3)

_XML = {
    1: "<dds><participant><rtps><name>{n}</name></rtps></participant></dds>",
    2: "<dds><topic><name>{t}</name><dataType>{d}</dataType></topic></dds>",
    3: "<dds><publisher/></dds>",
    4: "",
    5: "<dds><data_writer><topic><kind>NO_KEY</kind><name>{t}</name><dataType>{d}</dataType><historyQos><kind>KEEP_LAST"
    "</kind><depth>{n}</depth></historyQos></topic><qos><reliability><kind>RELIABLE</kind></reliability></qos>"
    "</data_writer></dds>",
    6: "<dds><data_reader><topic><name>{t}</name><dataType>{d}</dataType></topic><qos><durability><kind>TRANSIENT_LOCAL"
    "</kind></durability></qos></data_reader></dds>",
    7: '<dds><requester profile_name="r"service_name="{s}"request_type="Q"reply_type="A"></requester></dds>',
    8: '<dds><replier service_name="{s}" request_type="Q" reply_type="A"><request_topic_name>{t}</request_topic_name>'
    "</replier></dds>",
}
"""By kind, as clients send them."""

_BAD_XML = (
    "<dds>",
    "<a" * 500,
    "<x>" * 40 + "</x>" * 40,
    '<!DOCTYPE l [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;">]><dds>&b;</dds>',
    '<?xml version="1.0" encoding="utf-16"?><dds/>',
    '<?xml version="1.0" encoding="nonsense"?><dds/>',
    "<dds>" + "<t/>" * 3000 + "</dds>",
    "&#0;",
    "\ufeff<dds/>",
)


def any_id(random: Random, *kinds: int) -> int:
    """An object id, mostly of a kind that fits."""
    if random.random() < 0.03:
        return random.choice((0, OBJECT_AGENT, OBJECT_CLIENT, 0xFFFF, random.randrange(0x10000)))
    return make_object_id(random.choice(_NUMBERS), random.choice(kinds or KINDS))


def request_id(random: Random) -> int:
    """A request id."""
    return random.choice((0, 1, 2, 9, 10, 11, 300, 0xFFFF, random.randrange(0x10000)))


def payload(random: Random) -> bytes:
    """A sample."""
    if random.random() < 0.05:
        return random.randbytes(random.choice((500, 4000, 20_000)))
    return random.randbytes(random.choice((0, 1, 4, 8, 12, 24, 28, 60, 96, 200)))


def variant(random: Random, kind: int | None = None) -> ObjectVariant:
    """The description of an object, in any of the three forms."""
    kind = random.choice(KINDS) if kind is None else kind
    parent = any_id(random, 1) if kind in (2, 3, 4, 7, 8) else any_id(random, 3 if kind == 5 else 4)
    words = {"t": random.choice(TOPICS), "d": random.choice(TYPES), "s": random.choice(SERVICES)}
    number = random.choice(("1", "5", "-1", "99999999999", ""))
    match random.randrange(24):
        case 0 | 1 | 5:
            text = _XML[kind].format(n=number, **words)
            return ObjectVariant(kind, 2, text=text, parent_id=parent, domain_id=random.choice((0, 0, 255, -1)))
        case 2:
            return ObjectVariant(kind, 2, text=random.choice(_BAD_XML), parent_id=parent)
        case 3:
            suffix = random.choice(("", "__t", "__dw", "__dr"))
            return ObjectVariant(kind, 1, text=words["t"] + suffix, parent_id=parent)
        case 4:
            return ObjectVariant(kind, 3, blob=random.randbytes(random.randrange(40)), parent_id=parent)
    return _binary(random, kind, parent, words)


def _binary(random: Random, kind: int, parent: int, words: dict[str, str]) -> ObjectVariant:
    qos = EndpointQos(
        reliable=random.random() < 0.7,
        transient_local=random.random() < 0.3,
        keep_all=random.random() < 0.2,
        depth=random.choice((None, 1, 2, 10, 0xFFFF)),
    )
    service = (words["s"], "Q", "A", f"{words['s']}_Request", f"{words['s']}_Reply")
    topic_id = any_id(random, 2)
    match kind:
        case ObjectKind.PARTICIPANT:
            return participant_variant(random.choice(("", "p")), random.choice((0, 0, 0, 1, 255)))
        case ObjectKind.TOPIC:
            return topic_variant(words["t"], words["d"], parent)
        case ObjectKind.PUBLISHER:
            return publisher_variant(parent)
        case ObjectKind.SUBSCRIBER:
            return subscriber_variant(parent)
        case ObjectKind.DATAWRITER:
            return writer_variant(topic_id, parent, qos)
        case ObjectKind.DATAREADER:
            return reader_variant(topic_id, parent, qos)
        case ObjectKind.REQUESTER:
            return requester_variant(*service, parent)
    return replier_variant(*service, parent)


def control(random: Random) -> DeliveryControl | None:
    """A delivery control."""
    if random.random() < 0.2:
        return None
    return DeliveryControl(
        random.choice((0xFFFF, 0xFFFF, 0, 1, 3, 1000)),
        random.choice((0, 0, 1, 0xFFFF)),
        random.choice((0, 0, 1, 100, 0xFFFF)),
        random.choice((0, 0, 1, 50, 0xFFFF)),
    )


def login(random: Random, key: int, session_id: int, mtu: int) -> bytes:
    """A CREATE_CLIENT message, mostly right."""
    properties: tuple[tuple[str, str], ...] | None = None
    if random.random() < 0.2:
        period = random.choice(("000100", "010000", "x", "", "999999999", "-1", "\u0664"))
        properties = (("uxr_hl", period), ("uxr_sm", random.choice("01")))
    cookie = COOKIE if random.random() < 0.97 else b"XRCF"
    version = VERSION if random.random() < 0.97 else b"\x02\x00"
    client = CreateClient(key, session_id, mtu, properties, cookie, version)
    outside = Header(0x80 if session_id >= 0x80 else 0, client_key=key)
    return outside.encode() + client.encode()


def from_client(random: Random) -> Submessage:
    """Something a client may say."""
    match random.randrange(16):
        case 0 | 1 | 2:
            described = variant(random)
            object_id = any_id(random, described.kind)
            reuse, replace = random.random() < 0.5, random.random() < 0.5
            return Create(request_id(random), object_id, described, reuse, replace)
        case 3 | 4 | 5:
            return WriteData(request_id(random), any_id(random, 5, 5, 7, 8), payload(random))
        case 6 | 7:
            stream = random.choice(STREAMS)
            return ReadData(request_id(random), any_id(random, 6, 6, 7, 8), stream, control(random))
        case 8:
            return Delete(request_id(random), OBJECT_CLIENT if random.random() < 0.1 else any_id(random))
        case 9:
            return GetInfo(request_id(random), random.choice((OBJECT_AGENT, OBJECT_CLIENT)), random.randrange(4))
        case 10:
            return Timestamp(random.choice((0, 1, 10**18, 0xFFFFFFFF * 10**9 + 999_999_999)))
        case 11:
            return Fragment(random.randbytes(random.choice((0, 1, 8, 50, 500))), last=random.random() < 0.3)
        case 12:
            return Reset() if random.random() < 0.2 else Info(0, OBJECT_CLIENT, has_agent=False, availability=None)
        case 13:
            return CreateClient(random.choice((0, 1, 2, 0xAABBCCDD)), random.choice((0x81, 1)), 512)
    return report(random)


def from_agent(random: Random) -> Submessage:
    """Something an agent may say."""
    match random.randrange(14):
        case 0 | 1:
            return StatusReply(request_id(random), any_id(random), random.choice(STATUSES))
        case 2 | 3 | 4:
            return Data(request_id(random), any_id(random, 6, 6, 7, 8), payload(random))
        case 5:
            return StatusAgent(random.choice(STATUSES))
        case 6:
            return GetInfo(request_id(random), OBJECT_CLIENT, 1)
        case 7:
            locators = tuple(_locator(random) for _ in range(random.randrange(3)))
            number = random.choice((10, 10, request_id(random)))
            return Info(
                number,
                OBJECT_AGENT,
                0,
                random.randrange(2),
                random.random() < 0.8,
                random.choice((None, 1, 0, -1)),
                locators,
            )
        case 8:
            at = random.choice((0, 10**18, 2**31 * 10**9))
            return TimestampReply(at, random.choice((at, 0)), random.choice((0, at)))
        case 9:
            return Fragment(random.randbytes(random.choice((0, 1, 8, 50, 500))), last=random.random() < 0.3)
        case 10:
            return from_client(random)
    return report(random)


def report(random: Random) -> Submessage:
    """An ACKNACK or HEARTBEAT about some numbers."""
    first = random.choice((0, 0, 1, 2, 5, 16, 17, 0x7FFF, 0x8000, 0xFFFF, random.randrange(0x10000)))
    stream = random.choice(STREAMS)
    if random.random() < 0.5:
        return Acknack(first, random.choice((0, 1, 0x8000, 0xFFFF, 0x00FF)), stream)
    return Heartbeat(first, (first + random.choice((0, 1, 15, 16, 40, -1, 0x7FFF))) & 0xFFFF, stream)


def message(random: Random, header: Header, submessages: list[Submessage], *, wrong: float = 0.3) -> bytes:
    """The octets of a message; with probability `wrong` each submessage has one wrong field in front or inside."""
    packet = bytearray(header.encode())
    for submessage in submessages:
        body = bytearray(submessage.encode())
        if random.random() < wrong:
            _spoil(random, body)
        packet += body
        packet += random.randbytes(-len(packet) & 3)
    if random.random() < wrong / 2:
        del packet[len(packet) - random.randrange(4) :]
    return bytes(packet)


def _spoil(random: Random, body: bytearray) -> None:
    match random.randrange(7):
        case 0:
            body[0] = random.choice((*range(18), 0xFF))
        case 1:
            body[1] ^= random.choice((1, 2, 4, 6, 8, 0x0E, 0x80))
        case 2:
            body[2:4] = random.choice((0, 1, 3, 4, 5, len(body), len(body) - 3, 0xFFFF)).to_bytes(2, "little")
        case 3:
            body[random.randrange(len(body))] = random.choice(INTERESTING)
        case 4 if len(body) > 12:
            at = random.randrange(4, len(body) - 3)
            body[at : at + 4] = random.choice(WIDE).to_bytes(4, random.choice(("little", "big")))
        case 5:
            del body[random.randrange(4, len(body) + 1) :]
        case _:
            body += random.randbytes(random.choice((1, 4, 30)))


def _locator(random: Random) -> Locator:
    match random.randrange(4):
        case 0:
            return Locator(LocatorFormat.SMALL, b"ab", 7)
        case 1:
            return Locator(LocatorFormat.MEDIUM, bytes(4), 2018)
        case 2:
            return Locator(LocatorFormat.LARGE, bytes(16), 2018)
    return Locator(LocatorFormat.STRING, b"somewhere")
