"""What every link has."""

from __future__ import annotations

from msbot_agent.link import BaseLink, LinkInfo, Peer


class Plain(BaseLink):
    """A link that does nothing of its own."""

    def has_room(self, peer: Peer) -> bool:
        return True

    def send(self, packet: bytes, peer: Peer) -> None:
        self._sent(packet, peer, 1.0)

    def describe(self, peer: Peer) -> str:
        return str(peer)

    async def run(self) -> None:
        raise NotImplementedError


def test_handlers_are_given_one_by_one_and_stay() -> None:
    link, told = Plain(LinkInfo("x", 10)), list[tuple[object, ...]]()
    link._packet_handler(b"", 1, 0.0)  # before any is given, nothing happens
    link._burst_end_handler()
    link._room_handler(1)
    for name in ("packet", "signal", "room", "burst_end"):
        link.attach(**{name: lambda *what, name=name: told.append((name, *what))})
    link.attach()
    link._received(b"in", "peer", 2.0)
    link._burst_end_handler()
    link._room_handler("peer")
    assert told == [("packet", b"in", "peer", 2.0), ("burst_end",), ("room", "peer")]


def test_packets_are_counted_and_tapped_both_ways() -> None:
    link, tapped = Plain(LinkInfo("x", 10), remote="master"), list[tuple[object, ...]]()
    link.send(b"abc", "peer")
    link.tap = lambda *what: tapped.append(what)
    link.send(b"out", "peer")
    link._received(b"in", "peer", 2.0)
    assert tapped == [(1.0, "out", "peer", b"out"), (2.0, "in", "peer", b"in")]
    counters = link.counters
    assert (counters.packets_out, counters.bytes_out, counters.packets_in, counters.bytes_in) == (2, 6, 1, 2)
    assert (link.remote, link.origin("peer"), link.origin(7)) == ("master", "peer", 7)
