"""Packets to begin with: what eProsima's clients and agents really sent (tests/vectors)."""

from __future__ import annotations

import json
import re
from functools import cache
from pathlib import Path

from msbot_agent.link.byte_frames import SerialReceiver, TcpReceiver

VECTORS = Path(__file__).parent.parent / "tests/vectors"
LONGEST = 2_000
"""Octets; longer packets are pieces of one another and teach nothing."""
EACH_KIND = 12
"""Packets of one length and one kind that are kept."""

_HEX_LINE = re.compile(r"^\s*(->|<-|C>A|A>C)?\s*((?:[0-9a-fA-F]{2} ){7,}[0-9a-fA-F]{2})")


@cache
def packets(*, of_clients: bool) -> tuple[bytes, ...]:
    """The packets that clients sent, or those that agents sent; many of a kind are one too many."""
    kept: dict[bytes, list[bytes]] = {}
    for packet in _all(of_clients=of_clients):
        alike = kept.setdefault(bytes((len(packet) & 0xFF,)) + packet[4:6], [])
        if len(packet) <= LONGEST and packet not in alike and len(alike) < EACH_KIND:
            alike.append(packet)
    return tuple(packet for alike in kept.values() for packet in alike)


def _all(*, of_clients: bool) -> list[bytes]:
    direction = "client>agent" if of_clients else "agent>client"
    found = []
    for path in sorted(VECTORS.glob("*.jsonl")):
        for line in path.read_text().splitlines():
            entry = json.loads(line)
            if entry.get("dir") == direction and "hex" in entry:
                found += _unframed(path.name, bytes.fromhex(entry["hex"]), of_clients=of_clients)
    arrows = ("->", "C>A") if of_clients else ("<-", "A>C")
    for path in sorted(VECTORS.glob("*.txt")):
        for line in path.read_text().splitlines():
            match = _HEX_LINE.match(line)
            if match and match[1] in arrows:
                found.append(bytes.fromhex(match[2]))
    return found


def _unframed(name: str, octets: bytes, *, of_clients: bool) -> list[bytes]:
    if name.startswith("tcp"):
        return TcpReceiver().receive(octets)
    if name.startswith("serial"):
        address = 0 if of_clients else octets[2] if len(octets) > 2 else 1
        return [packet for _, packet in SerialReceiver(address).receive(octets)]
    return [octets]
