"""The framings of byte streams: serial and TCP, in chunks of any size."""

from __future__ import annotations

from collections.abc import Iterable
from random import Random

from fuzz.bounds import hold
from fuzz.case import Case, Step, Violation
from fuzz.corpus import packets
from fuzz.mutate import mutate_octets
from msbot_agent.link.byte_frames import MAX_PACKET, SerialReceiver, TcpReceiver, encode_serial, encode_tcp

MOST_PACKET = 1500
SPECIAL = bytes.fromhex("7e7d5e5d7e7e7d7d7e0000")


class SerialTarget:
    """See the module's docstring."""

    name = "serial"
    about = "serial and TCP framing: chunks do not matter, memory is bounded, the next right frame is received"

    def make(self, random: Random) -> Case:
        """A few chunks, mostly of frames."""
        steps = []
        for _ in range(random.choice((1, 2, 3, 8))):
            packet = random.choice(packets(of_clients=True))
            if random.random() < 0.3:
                packet += SPECIAL * random.choice((1, 20))
            octets = encode_serial(packet, random.choice((1, 1, 0, 0x7E)), random.choice((0, 0, 0, 1, 0x7D)))
            verb = random.choice(("serial", "serial", "tcp"))
            octets = encode_tcp(packet) if verb == "tcp" else octets
            if random.random() < 0.6:
                octets = mutate_octets(random, octets, (SPECIAL, octets))
            steps.append(Step(verb, octets))
        return tuple(steps)

    def run(self, case: Case) -> Iterable[str]:
        """Receive the same octets in three ways."""
        seen: set[str] = set()
        serial = b"".join(step.data for step in case if step.verb == "serial")
        tcp = b"".join(step.data for step in case if step.verb == "tcp")
        sizes = [len(step.data) for step in case] or [1]
        whole, wholly = _serial(serial, [len(serial) or 1])
        for chunks in ([1], [max(1, size) for size in sizes], [7, 1, 30]):
            pieces, piecewise = _serial(serial, chunks)
            if pieces != whole:
                raise Violation(f"serial: {len(whole)} frames at once are {len(pieces)} in chunks of {chunks}")
            if piecewise.dropped != wholly.dropped:
                raise Violation(f"serial: {wholly.dropped} at once, {piecewise.dropped} in chunks of {chunks}")
            if _tcp(tcp, chunks) != _tcp(tcp, [len(tcp) or 1]):
                raise Violation(f"TCP: other packets in chunks of {chunks}")
        # A flag ends whatever was going on, so the next right frame always comes.
        if wholly.receive(encode_serial(b"next", 5, 0)) != [(5, b"next")]:
            raise Violation("serial: the next right frame did not come")
        seen.update(wholly.dropped, (f"{min(len(whole), 4)} frames",))
        return seen


def _serial(octets: bytes, chunks: list[int]) -> tuple[list[tuple[int, bytes]], SerialReceiver]:
    receiver = SerialReceiver(0, max_packet=MOST_PACKET)
    packets = []
    for chunk in _cut(octets, chunks):
        packets += receiver.receive(chunk)
        hold("octets of a serial frame", len(receiver._frame or b""), MOST_PACKET + 6 + len(chunk))
    return packets, receiver


def _tcp(octets: bytes, chunks: list[int]) -> list[bytes]:
    receiver = TcpReceiver()
    packets = []
    for chunk in _cut(octets, chunks):
        packets += receiver.receive(chunk)
        hold("octets of a TCP frame", len(receiver._buffer), MAX_PACKET + 2)
    return packets


def _cut(octets: bytes, chunks: list[int]) -> Iterable[bytes]:
    at = number = 0
    while at < len(octets):
        size = chunks[number % len(chunks)]
        yield octets[at : at + size]
        at += size
        number += 1
