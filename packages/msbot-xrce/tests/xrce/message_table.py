"""Messages as values and as the octets that the genuine client and agent send; `__` is padding (stale octets there).

Every row was seen on the wire between eProsima's client and agent.
"""

from __future__ import annotations

from dataclasses import dataclass

from msbot_xrce.messages import (
    Acknack,
    Create,
    CreateClient,
    Data,
    Delete,
    DeliveryControl,
    Format,
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
)
from msbot_xrce.objects import (
    EndpointQos,
    participant_variant,
    publisher_variant,
    reader_variant,
    requester_variant,
    subscriber_variant,
    topic_variant,
    writer_variant,
)


@dataclass(frozen=True)
class Row:
    """One message in both forms."""

    name: str
    octets: str
    header: Header
    submessages: list[Submessage]
    pad_end: bool = False

    def packet(self, padding: int = 0) -> bytes:
        """The octets, with that value in the padding."""
        return bytes.fromhex(self.octets.replace("__", f"{padding:02x}"))


_PADDED = True
_SESSION = Header(0x81)
_OUTSIDE = Header(0x80)
_KEYED = Header(0x01, client_key=0xAABBCC07)
_EIGHT = bytes(range(8))
_SAMPLE = bytes(range(128))


def _reliable(sequence_nr: int) -> Header:
    return Header(0x81, 0x80, sequence_nr)


TABLE = [
    Row(
        "CREATE_CLIENT",
        "80000000 00011000 58524345 0100 010f aabbccdd 81 00 fc01",
        _OUTSIDE,
        [CreateClient(0xAABBCCDD, 0x81, 508)],
    ),
    Row(
        "CREATE_CLIENT with a property, which its length leaves out",
        "80000000 00011000 58524345 0100 010f 11223344 81 01 0000 01000000"
        "07000000 7578725f686c00 00 07000000 30313030303000 __ fc01",
        _OUTSIDE,
        [CreateClient(0x11223344, 0x81, 508, (("uxr_hl", "010000"),))],
    ),
    Row(
        "CREATE_CLIENT with the key in the header",
        "00000000 aabbcc07 00011000 58524345 0100 010f aabbcc07 01 00 fc01",
        Header(0x00, client_key=0xAABBCC07),
        [CreateClient(0xAABBCC07, 0x01, 508)],
    ),
    Row(
        "participant by reference",
        "81800000 01052800 000a 0011 01 01 0000 1900000064656661756c745f787263655f7061727469636970616e7400 00 0000",
        _reliable(0),
        [Create(10, 0x0011, ObjectVariant(1, Format.REFERENCE, "default_xrce_participant"), replace=True)],
    ),
    Row(
        "participant in binary form",
        "81800400 01071c00 000e 0011 01 03 0000 0d000000 00 01 0000 05000000 7061727400 __ 0500",
        _reliable(4),
        [Create(14, 0x0011, participant_variant("part", 5), reuse=True, replace=True)],
    ),
    Row(
        "topic in binary form",
        "81800500 01053200 000f 0012 02 03 0000 24000000 0d000000 4578616d706c65546f70696300"
        "00 01 00 0c000000 4578616d706c655479706500 0011 0000",
        _reliable(5),
        [Create(15, 0x0012, topic_variant("ExampleTopic", "ExampleType", 0x0011), replace=True)],
        _PADDED,
    ),
    Row(
        "publisher in binary form",
        "81800600 01051000 0010 0013 03 03 0000 02000000 0000 0011",
        _reliable(6),
        [Create(16, 0x0013, publisher_variant(0x0011), replace=True)],
    ),
    Row(
        "subscriber in binary form",
        "81800800 01051000 0012 0014 04 03 0000 02000000 0000 0011",
        _reliable(8),
        [Create(18, 0x0014, subscriber_variant(0x0011), replace=True)],
    ),
    Row(
        "data writer in binary form",
        "81800700 01051c00 0011 0015 05 03 0000 0e000000 0012 01 00 0b00 01 __ 0a00 00000000 0013",
        _reliable(7),
        [Create(17, 0x0015, writer_variant(0x0012, 0x0013, EndpointQos(transient_local=True, depth=10)), replace=True)],
    ),
    Row(
        "data reader in binary form",
        "81800900 01051a00 0013 0016 06 03 0000 0c000000 0012 01 00 0200 000000000000 0014 ____",
        _reliable(9),
        [Create(19, 0x0016, reader_variant(0x0012, 0x0014, EndpointQos(reliable=False)), replace=True)],
        _PADDED,
    ),
    Row(
        "requester in binary form",
        "81800e00 01054500 0018 0017 07 03 0000 37000000 04000000 73766300 05000000 5265715400 000000"
        "05000000 5265705400 01 0000 07000000 72712f73766300 01 07000000 72722f73766300 0011 000000",
        _reliable(14),
        [Create(24, 0x0017, requester_variant("svc", "ReqT", "RepT", "rq/svc", "rr/svc", 0x0011), replace=True)],
        _PADDED,
    ),
    Row("ping", "80000000 02010800 000a fffd 02000000", _OUTSIDE, [GetInfo(10, 0xFFFD, 2)]),
    Row("ping in a session", "81000000 02010800 000a fffd 02000000", _SESSION, [GetInfo(10, 0xFFFD, 2)]),
    Row("discovery", "80000000 02010800 0009 fffd 03000000", _OUTSIDE, [GetInfo(9, 0xFFFD, 3)]),
    Row("probe of a silent client", "81000000 02010800 0000 fffe 01000000", _SESSION, [GetInfo(0, 0xFFFE, 1)]),
    Row("DELETE topic", "81800200 03010400 000c 0012", _reliable(2), [Delete(12, 0x0012)]),
    Row("DELETE session", "81000000 03010400 0002 fffe", _SESSION, [Delete(2, 0xFFFE)]),
    Row("STATUS_AGENT OK", "81000000 04010b00 00 00 58524345 0100 010f 00", _SESSION, [StatusAgent(0)]),
    Row("STATUS_AGENT refusal", "81000000 04010b00 85 00 58524345 0100 010f 00", _SESSION, [StatusAgent(0x85)]),
    Row("STATUS_AGENT keyed", "01000000 aabbcc07 04010b00 00 00 58524345 0100 010f 00", _KEYED, [StatusAgent(0)]),
    Row("STATUS OK", "81800000 05010600 000a 0011 00 00", _reliable(0), [StatusReply(10, 0x0011, 0)]),
    Row("STATUS on best effort", "81010000 05010600 001c 0033 00 00", Header(0x81, 1), [StatusReply(28, 0x0033, 0)]),
    Row("STATUS exists", "81800a00 05010600 0014 0016 82 00", _reliable(10), [StatusReply(20, 0x0016, 0x82)]),
    Row("STATUS session deleted", "81000000 05010600 0002 fffe 00 00", _SESSION, [StatusReply(2, 0xFFFE, 0)]),
    Row(
        "INFO outside a session",
        "80000000 06011c00 000a fffd 00 00 01 0d 58524345 0100 010f 00 01 0d 00 0100 0000 00000000",
        _OUTSIDE,
        [Info(10, 0xFFFD)],
    ),
    Row(
        "INFO in a session",
        "81000000 06011c00 000a fffd 00 01 01 0d 58524345 0100 010f 00 01 0d 00 0100 0000 00000000",
        _SESSION,
        [Info(10, 0xFFFD, implementation_status=1)],
    ),
    Row(
        "INFO with locators",
        "80000000 06012c00 0009 fffd 00 00 01 0d 58524345 0100 010f 00 01 0d 00 0100 0000 02000000"
        "01 7f000001 00 d970 01 c0000202 00 d970",
        _OUTSIDE,
        [
            Info(
                9,
                0xFFFD,
                locators=(
                    Locator(LocatorFormat.MEDIUM, bytes((127, 0, 0, 1)), 28889),
                    Locator(LocatorFormat.MEDIUM, bytes((192, 0, 2, 2)), 28889),
                ),
            )
        ],
    ),
    Row("WRITE_DATA", "81801200 07010c00 001e 0015 0001020304050607", _reliable(18), [WriteData(30, 0x0015, _EIGHT)]),
    Row(
        "two WRITE_DATA in one message",
        "81010100 07010900 001f 0015 0001020304 000000 07010c00 0020 0015 0001020304050607",
        Header(0x81, 1, 1),
        [WriteData(31, 0x0015, _EIGHT[:5]), WriteData(32, 0x0015, _EIGHT)],
    ),
    Row(
        "READ_DATA without end",
        "81801100 08011000 001d 0016 80 00 00 01 ffff 0000 0000 0000",
        _reliable(17),
        [ReadData(29, 0x0016, 0x80, DeliveryControl())],
    ),
    Row("READ_DATA once", "81801700 08010800 0024 0016 01 00 00 00", _reliable(23), [ReadData(36, 0x0016, 0x01)]),
    Row(
        "READ_DATA cancel",
        "81801900 08011000 0026 0016 00 00 00 01 0000 0000 0000 0000",
        _reliable(25),
        [ReadData(38, 0x0016, 0x00, DeliveryControl(0))],
    ),
    Row("DATA", "81801200 09010c00 001d 0016 0001020304050607", _reliable(18), [Data(29, 0x0016, _EIGHT)]),
    Row("DATA on best effort", "81010100 09010800 0024 0016 00010203", Header(0x81, 1, 1), [Data(36, 22, _EIGHT[:4])]),
    Row("DATA on no stream", "81000000 09010800 0025 0016 02020202", _SESSION, [Data(37, 0x0016, b"\2\2\2\2")]),
    Row("ACKNACK all here", "81000000 0a010500 0100 0000 80", _SESSION, [Acknack(1, 0, 0x80)]),
    Row("ACKNACK one missing", "81000000 0a010500 0000 0001 80", _SESSION, [Acknack(0, 1, 0x80)]),
    Row("ACKNACK many missing", "81000000 0a010500 0200 7fff 80", _SESSION, [Acknack(2, 0x7FFF, 0x80)]),
    Row("ACKNACK keyed", "01000000 aabbcc07 0a010500 0100 0000 80", _KEYED, [Acknack(1, 0, 0x80)]),
    Row("HEARTBEAT", "81000000 0b010500 0600 0800 80", _SESSION, [Heartbeat(6, 8, 0x80)]),
    Row("RESET", "81000000 0c010000", _SESSION, [Reset()]),
    Row(
        "FRAGMENT, first",
        "81800600 0d013800 09018400 0038 0016" + _SAMPLE[:48].hex(),
        _reliable(6),
        [Fragment(bytes.fromhex("0901840000380016") + _SAMPLE[:48])],
    ),
    Row("FRAGMENT", "81800700 0d013800" + _SAMPLE[48:104].hex(), _reliable(7), [Fragment(_SAMPLE[48:104])]),
    Row("FRAGMENT, last", "81800800 0d031800" + _SAMPLE[104:].hex(), _reliable(8), [Fragment(_SAMPLE[104:], True)]),
    Row("TIMESTAMP", "81000000 0e010800 163e016b a3948a32", _SESSION, [Timestamp(1795243542_847942819)]),
    Row(
        "TIMESTAMP_REPLY",
        "81000000 0f011800 163e016b ee558b32 163e016b fa538b32 163e016b a3948a32",
        _SESSION,
        [TimestampReply(1795243542_847992302, 1795243542_847991802, 1795243542_847942819)],
    ),
]

BIG_ENDIAN = [
    Row(
        "CREATE_CLIENT",
        "80000000 00001000 58524345 0100 010f aabbcc06 81 00 01fc",
        _OUTSIDE,
        [CreateClient(0xAABBCC06, 0x81, 508)],
    ),
    Row(
        "CREATE_CLIENT with its length in big endian too",
        "80000000 00000010 58524345 0100 010f aabbcc06 81 00 01fc",
        _OUTSIDE,
        [CreateClient(0xAABBCC06, 0x81, 508)],
    ),
    Row(
        "CREATE participant",
        "81800000 01001c00 000a 0011 01 03 0000 0000000d 00 01 0000 00000005 7061727400 00 0005",
        _reliable(0),
        [
            Create(
                10,
                0x0011,
                ObjectVariant(
                    ObjectKind.PARTICIPANT,
                    Format.BINARY,
                    blob=bytes.fromhex("00010000000000057061727400"),
                    domain_id=5,
                ),
                little_endian=False,
            )
        ],
    ),
    Row("GET_INFO", "80000000 02000800 000a fffd 00000002", _OUTSIDE, [GetInfo(10, 0xFFFD, 2)]),
    Row("DELETE", "81800200 03000400 000c 0012", _reliable(2), [Delete(12, 0x0012)]),
    Row("STATUS_AGENT", "81000000 04000b00 00 00 58524345 0100 010f 00", _SESSION, [StatusAgent(0)]),
    Row("STATUS", "81800000 05000600 000a 0011 00 00", _reliable(0), [StatusReply(10, 0x0011, 0)]),
    Row(
        "INFO",
        "80000000 06002400 0009 fffd 00 00 01 0d 58524345 0100 010f 00 01 0d 00 0001 0000 00000001 01 7f000001 00 70d9",
        _OUTSIDE,
        [Info(9, 0xFFFD, locators=(Locator(LocatorFormat.MEDIUM, bytes((127, 0, 0, 1)), 28889),))],
    ),
    Row("WRITE_DATA", "81801200 07000c00 001e 0015 0001020304050607", _reliable(18), [WriteData(30, 0x0015, _EIGHT)]),
    Row(
        "READ_DATA",
        "81801100 08001000 001d 0016 80 00 00 01 ffff 0002 0300 0004",
        _reliable(17),
        [ReadData(29, 0x0016, 0x80, DeliveryControl(0xFFFF, 2, 0x300, 4))],
    ),
    Row("DATA", "81800200 09000800 000a 0016 22222222", _reliable(2), [Data(10, 0x0016, b"\x22" * 4)]),
    Row("ACKNACK", "81000000 0a000500 0002 7fff 80", _SESSION, [Acknack(2, 0x7FFF, 0x80)]),
    Row("HEARTBEAT", "81000000 0b000500 0000 0007 80", _SESSION, [Heartbeat(0, 7, 0x80)]),
    Row("RESET", "81000000 0c000000", _SESSION, [Reset()]),
    Row("FRAGMENT", "81800800 0d020200 6869", _reliable(8), [Fragment(b"hi", True)]),
    Row("TIMESTAMP", "81000000 0e000800 6b013e16 328a94a3", _SESSION, [Timestamp(1795243542_847942819)]),
    Row(
        "TIMESTAMP_REPLY",
        "81000000 0f001800 6b013e16 328b55ee 6b013e16 328b53fa 6b013e16 328a94a3",
        _SESSION,
        [TimestampReply(1795243542_847992302, 1795243542_847991802, 1795243542_847942819)],
    ),
]
"""The same with the flag for big-endian payloads; the length in front stays little endian."""
