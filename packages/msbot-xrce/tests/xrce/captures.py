"""The recorded traffic of tests/vectors as packets, whatever the transport was."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

from msbot_agent.link.byte_frames import SerialReceiver, TcpReceiver
from tests import ROOT

VECTORS = ROOT / "tests" / "vectors"

CAPTURES = sorted(path.stem for path in VECTORS.glob("*.jsonl"))

HEADERLESS_ANSWER = bytes.fromhex("810000000000000000000000")
"""A C client's answer to the agent's GET_INFO: it has no submessage header."""


@dataclass(frozen=True)
class Recorded:
    """One packet of a capture."""

    packet: bytes
    from_client: bool
    client: int
    """Which client socket it belongs to."""
    line: int


@cache
def recorded(name: str) -> tuple[Recorded, ...]:
    """All packets of one capture, de-framed."""
    return tuple(_read(name))


def _read(name: str) -> Iterator[Recorded]:
    for number, line in enumerate((VECTORS / f"{name}.jsonl").read_text().splitlines(), 1):
        entry = json.loads(line)
        packets = _deframe(name.partition("_")[0], bytes.fromhex(entry["hex"]))
        assert len(packets) == 1, f"{name} line {number}: {len(packets)} packets in one record"
        yield Recorded(packets[0], entry["dir"].startswith("client"), entry.get("client", 0), number)


def _deframe(transport: str, octets: bytes) -> list[bytes]:
    if transport == "tcp":
        return TcpReceiver().receive(octets)
    if transport == "serial":
        return [packet for _, packet in SerialReceiver(address=octets[2]).receive(octets)]
    return [octets]
