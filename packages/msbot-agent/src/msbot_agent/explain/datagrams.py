"""Captures of networks (pcap, pcapng): the UDP datagrams and CAN frames in them, by `dpkt`."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from msbot_agent.link.can.protocol import Frame
from msbot_agent.text.untrusted_input import open_input_file
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

REMEDY: Final = "pip install 'msbot-agent[pcap]'"
ENDINGS: Final = (".pcap", ".pcapng", ".cap")
_CAN: Final = struct.Struct(">IBB2x")
_EXTENDED, _REMOTE, _ERROR = 0x80000000, 0x40000000, 0x20000000
_CLASSIC_SIZE: Final = 16
_BRS, _ESI = 0x01, 0x02


@dataclass(frozen=True, slots=True)
class Datagram:
    """One UDP datagram."""

    at: float
    """Seconds since 1970."""
    source: str
    source_port: int
    target: str
    target_port: int
    octets: bytes


@dataclass(frozen=True, slots=True)
class CapturedFrame:
    """One CAN frame (link type LINKTYPE_CAN_SOCKETCAN)."""

    at: float
    frame: Frame


def read_capture(path: Path) -> Iterator[Datagram | CapturedFrame]:
    """Everything in a capture that can be explained, in its order; other packets are left out.

    Raises:
        ConfigError: it cannot be read, is no capture, or a package is missing.
    """
    try:
        import dpkt
    except ImportError:
        raise ConfigError(f"captures of networks need the package dpkt: {REMEDY}") from None
    try:
        with open_input_file(path) as stream:
            reader = dpkt.pcap.UniversalReader(stream)
            kind = reader.datalink()
            for at, octets in reader:
                found = _can(octets, at) if kind == CAN_SOCKETCAN else _datagram(dpkt, kind, octets, at)
                if found is not None:
                    yield found
    except OSError as error:
        raise ConfigError(f"cannot read {path}: {error.strerror or error}") from None
    except (ValueError, dpkt.Error, struct.error) as error:
        reason = str(error) or "it breaks off"
        raise ConfigError(f"{path} is no capture that can be read ({reason}): pcap or pcapng") from None


_OTHER_PORTS: Final = {
    53: "DNS", 67: "DHCP", 68: "DHCP", 123: "NTP", 1900: "SSDP", 5353: "mDNS", 5355: "LLMNR",
}  # fmt: skip
"""Ports that other protocols have for themselves (IANA)."""


def other_protocol(found: Datagram) -> str:
    """What a datagram is that is no message of DDS-XRCE, in words; empty: it may be one.

    RTPS is told by the octets that every one of its messages begins with (RTPS 2.5, 8.3.3), others by their ports.
    """
    if found.octets[:4] in (b"RTPS", b"RTPX"):
        version = f" {found.octets[4]}.{found.octets[5]}" if len(found.octets) >= 6 else ""
        return f"RTPS{version}, what DDS programs speak among each other: no DDS-XRCE"
    name = _OTHER_PORTS.get(found.target_port) or _OTHER_PORTS.get(found.source_port)
    return f"{name}, by its port: no DDS-XRCE" if name else ""


CAN_SOCKETCAN: Final = 227
"""Link types, https://www.tcpdump.org/linktypes.html."""
_NULL, _ETHERNET, _RAW, _SLL, _SLL2 = 0, 1, (12, 14, 101), 113, 276


def _datagram(dpkt: Any, kind: int, octets: bytes, at: float) -> Datagram | None:  # noqa: ANN401 - dpkt has no types
    try:
        if kind == _ETHERNET:
            packet = dpkt.ethernet.Ethernet(octets).data
        elif kind in _RAW:
            packet = (dpkt.ip6.IP6 if octets[0] >> 4 == 6 else dpkt.ip.IP)(octets)
        elif kind == _SLL:
            packet = dpkt.sll.SLL(octets).data
        elif kind == _SLL2:
            packet = dpkt.sll2.SLL2(octets).data
        elif kind == _NULL:
            packet = dpkt.loopback.Loopback(octets).data
        else:
            return None
    except (dpkt.UnpackError, IndexError):
        return None  # cut short, or none of ours
    if not isinstance(packet, dpkt.ip.IP | dpkt.ip6.IP6) or not isinstance(packet.data, dpkt.udp.UDP):
        return None
    udp = packet.data
    source, target = (dpkt.utils.inet_to_str(address) for address in (packet.src, packet.dst))
    return Datagram(float(at), source, udp.sport, target, udp.dport, bytes(udp.data))


def _can(octets: bytes, at: float) -> CapturedFrame | None:
    if len(octets) < _CAN.size:
        return None
    word, size, flags = _CAN.unpack_from(octets)
    data = octets[_CAN.size : _CAN.size + size]
    if word & _ERROR or (len(data) < size and not word & _REMOTE):
        return None
    is_fd = len(octets) > _CLASSIC_SIZE
    can_id = word & (0x1FFFFFFF if word & _EXTENDED else 0x7FF)
    frame = Frame(can_id, data, bool(word & _EXTENDED), is_fd, bool(flags & _BRS) and is_fd)
    return CapturedFrame(float(at), frame)
