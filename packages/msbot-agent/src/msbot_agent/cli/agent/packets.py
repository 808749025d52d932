"""Packets on the terminal: octets and their meaning (`msbot agent -v 6`)."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime

from msbot_agent.link import Link, Peer, Tap
from msbot_xrce import explain
from msbot_xrce.common.amount import amount

OCTETS_A_LINE = 32


def packet_tap(link: Link, say: Callable[[str], None]) -> Tap:
    """A tap that prints every packet of a link."""

    def tap(now: float, way: str, peer: Peer, packet: bytes) -> None:  # noqa: ARG001 - prints the time of day
        say(packet_text(datetime.now(), way, link.describe(peer), packet))

    return tap


def packet_text(at: datetime, way: str, address: str, packet: bytes) -> str:
    """One packet: when, from or to whom, its octets, its meaning."""
    arrow = "from" if way == "in" else "to"
    lines = [f"{at:%H:%M:%S.%f} {arrow} {address}: {amount(len(packet), 'octet')}"]
    for start in range(0, len(packet), OCTETS_A_LINE):
        lines.append(f"    {packet[start : start + OCTETS_A_LINE].hex(' ')}")
    lines += [f"    {line}" for line in explain(packet)]
    return "\n".join(lines)
