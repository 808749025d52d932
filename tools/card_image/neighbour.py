"""Another computer at the virtual one's second Ethernet port: Ethernet frames as datagrams at 127.0.0.1, as qemu's
`socket` network has them. It asks for a name by multicast DNS (RFC 6762) over IPv6, as a notebook at a cable does."""

from __future__ import annotations

import ipaddress
import socket
import struct
import time

MAC = bytes.fromhex("525400000002")
MACHINE_MAC = "52:54:00:00:00:01"
"""Of the machine's port."""
OWN = ipaddress.IPv6Address("fe80::2")
GROUP, PORT = ipaddress.IPv6Address("ff02::fb"), 5353
AAAA, IN = 28, 1
_IPV6, _UDP = 0x86DD, 17


def frame(payload: bytes) -> bytes:
    """A datagram to all who speak multicast DNS (RFC 2464, RFC 8200)."""
    source, target = OWN.packed, GROUP.packed
    head = struct.pack(">HHHH", PORT, PORT, len(payload) + 8, 0)
    pseudo = source + target + struct.pack(">II", len(payload) + 8, _UDP)
    checked = head[:6] + struct.pack(">H", checksum(pseudo + head + payload) or 0xFFFF)
    packet = struct.pack(">IHBB", 6 << 28, len(payload) + 8, _UDP, 255) + source + target + checked + payload
    return b"\x33\x33" + target[-4:] + MAC + struct.pack(">H", _IPV6) + packet


def checksum(octets: bytes) -> int:
    """RFC 1071."""
    total: int = sum(struct.unpack(f">{(len(octets) + 1) // 2}H", octets + b"\0" * (len(octets) % 2)))
    while total >> 16:
        total = (total & 0xFFFF) + (total >> 16)
    return ~total & 0xFFFF


def question(name: str) -> bytes:
    """Who has this name, by IPv6?"""
    return struct.pack(">HHHHHH", 0, 0, 1, 0, 0, 0) + _labels(name) + struct.pack(">HH", AAAA, IN)


def _labels(name: str) -> bytes:
    return b"".join(bytes([len(label)]) + label.encode() for label in name.split(".")) + b"\0"


def answers(received: bytes, name: str) -> set[ipaddress.IPv6Address]:
    """The addresses that a frame from the network gives for a name; none: it is about something else."""
    if len(received) < 74 or received[12:14] != b"\x86\xdd" or received[20] != _UDP:
        return set()
    source_port, _, length, _ = struct.unpack_from(">HHHH", received, 54)
    message = received[62 : 54 + length]
    if source_port != PORT or len(message) < 12:
        return set()
    _, flags, questions, count, *_ = struct.unpack_from(">HHHHHH", message)
    if not flags & 0x8000 or questions:
        return set()
    found, place = set(), 12
    try:
        for _ in range(count):
            owner, place = _name(message, place)
            kind, _, _, size = struct.unpack_from(">HHIH", message, place)
            place += 10
            if owner.lower() == name.lower() and kind == AAAA and size == 16:
                found.add(ipaddress.IPv6Address(message[place : place + 16]))
            place += size
    except (struct.error, IndexError, ValueError):
        return set()
    return found


def _name(message: bytes, place: int) -> tuple[str, int]:
    """A name (RFC 1035, 4.1.4), and what is behind it."""
    labels: list[str] = []
    after = 0
    for _ in range(64):
        length = message[place]
        if length & 0xC0:
            after = after or place + 2
            place = struct.unpack_from(">H", message, place)[0] & 0x3FFF
        elif length:
            labels.append(message[place + 1 : place + 1 + length].decode("utf-8", "replace"))
            place += 1 + length
        else:
            return ".".join(labels), after or place + 1
    raise ValueError("a name without an end")


class Neighbour:
    """The other computer."""

    def __init__(self) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
            one.bind(("127.0.0.1", 0))
            self._machine = one.getsockname()

    def cable(self) -> list[str]:
        """What qemu has to be told."""
        own, machine = self._socket.getsockname()[1], self._machine[1]
        return [
            "-netdev",
            f"socket,id=cable,udp=127.0.0.1:{own},localaddr=127.0.0.1:{machine}",
            "-device",
            f"virtio-net-pci,netdev=cable,mac={MACHINE_MAC},romfile=",
        ]

    def resolve(self, name: str, within_s: float) -> set[ipaddress.IPv6Address]:
        """The addresses of a name; none: nobody answers in time."""
        until, asked = time.monotonic() + within_s, 0.0
        while (now := time.monotonic()) < until:
            if now - asked >= 1.0:
                self._socket.sendto(frame(question(name)), self._machine)
                asked = now
            self._socket.settimeout(0.2)
            try:
                if found := answers(self._socket.recv(65_536), name):
                    return found
            except (TimeoutError, ConnectionError):
                continue
        return set()

    def close(self) -> None:
        """Unplug it."""
        self._socket.close()
