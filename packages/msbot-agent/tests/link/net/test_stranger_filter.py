"""The filter of strangers, in the kernel that is there: who comes through, and what is counted."""

from __future__ import annotations

import random
import socket
import sys
from collections.abc import Hashable, Iterable, Iterator
from contextlib import closing, contextmanager
from itertools import islice

import pytest

from msbot_agent.link import Peer
from msbot_agent.link.net.stranger_filter import (
    CHANCES,
    FEW_KNOWN,
    LOOK_S,
    MOST_KNOWN,
    NOT_ANSWERED,
    NOT_READ,
    StrangerFilter,
    StrangersHeard,
    attach,
    strangers_program,
)
from msbot_xrce.counting import Tally

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the filter is one of Linux")


class Known:
    """An owner who knows these peers."""

    def __init__(self, *peers: Peer) -> None:
        self.peers = peers
        self.stranger_count = 0

    def knows(self, peer: Peer) -> bool:
        return peer in self.peers

    def has_a_part(self, origin: Hashable) -> bool:
        return any(isinstance(peer, tuple) and peer[0] == origin for peer in self.peers)

    def preferred_peers(self, most: int) -> Iterable[Peer]:
        return islice(self.peers, most)


@contextmanager
def listening(*, is_ipv6: bool = False) -> Iterator[socket.socket]:
    with closing(socket.socket(socket.AF_INET6 if is_ipv6 else socket.AF_INET, socket.SOCK_DGRAM)) as opened:
        if is_ipv6:
            opened.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 0)
        opened.bind(("::" if is_ipv6 else "127.0.0.1", 0))
        opened.setblocking(False)
        yield opened


def sent(opened: socket.socket, host: str, count: int = 1, port: int = 0) -> tuple[str, int]:
    """Send from that address; gives the address."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with closing(socket.socket(family, socket.SOCK_DGRAM)) as one:
        one.bind((host, port))
        for _ in range(count):
            one.sendto(b"hello", ("::1" if ":" in host else "127.0.0.1", opened.getsockname()[1]))
        name = one.getsockname()
        return name[0], name[1]


def heard(opened: socket.socket) -> list[tuple[str, int]]:
    """From where what came through was sent."""
    found = []
    while True:
        try:
            found.append(opened.recvfrom(100)[1][:2])
        except BlockingIOError:
            return found


def strangers(count: int) -> list[str]:
    chance = random.Random(1)
    return [f"127.{chance.randrange(1, 255)}.{chance.randrange(256)}.{chance.randrange(1, 255)}" for _ in range(count)]


def test_known_peers_come_through_by_address_and_port_and_of_strangers_one_group() -> None:
    with listening() as opened:
        known = [sent(opened, f"127.0.0.{number}") for number in (1, 2, 2, 3)]
        heard(opened)
        through: list[set[str]] = []
        for turn in range(4):
            attach(opened, strangers_program(StrangersHeard(4, turn, CHANCES), tuple(known)))
            for host, port in known:
                sent(opened, host, port=port)
            assert heard(opened) == known
            for host in strangers(100):
                sent(opened, host)
            through.append({host for host, _ in heard(opened)})
        assert set.union(*through) == set(strangers(100)), "everybody has a turn"
        assert sum(map(len, through)) == 100, "and only one"
        assert min(map(len, through)) > 5


def test_another_port_of_a_known_address_is_a_stranger() -> None:
    with listening() as opened:
        known = sent(opened, "127.0.0.2")
        heard(opened)
        shut = 0
        for turn in range(2):
            attach(opened, strangers_program(StrangersHeard(2, turn, CHANCES), (known,)))
            sent(opened, "127.0.0.2")
            shut += not heard(opened)
        assert shut == 1


def test_of_a_group_that_sends_too_much_a_part_comes_through_by_chance() -> None:
    with listening() as opened:
        attach(opened, strangers_program(StrangersHeard(1, 0, CHANCES // 4), ()))
        sent(opened, "127.0.0.2", 200)
        assert 20 < len(heard(opened)) < 90


@pytest.mark.parametrize(("count", "by_port"), [(1, True), (100, True), (FEW_KNOWN, True), (MOST_KNOWN, False)])
def test_so_many_peers_have_room_in_the_filter(count: int, by_port: bool) -> None:
    with listening() as opened:
        known = [(f"127.0.{number // 200}.{1 + number % 200}", 40_000 + number) for number in range(count)]
        attach(opened, strangers_program(StrangersHeard(1 << 20, 0, CHANCES), tuple(known), by_port=by_port))
        for host, port in (known[0], known[count // 2], known[-1]):
            sent(opened, host, port=port)
            assert heard(opened) == [(host, port)]
        sent(opened, "127.0.200.1")
        assert heard(opened) == []


def test_a_socket_of_both_kinds_hears_known_peers_of_both() -> None:
    with listening(is_ipv6=True) as opened:
        try:
            six = sent(opened, "::1")
        except OSError:
            pytest.skip("this computer has no IPv6")
        four = sent(opened, "127.0.0.2")
        heard(opened)
        program = strangers_program(
            StrangersHeard(1 << 20, 0, CHANCES),
            (("::1", six[1], 0, 0), (f"::ffff:{four[0]}", four[1], 0, 0)),
            is_ipv6=True,
        )
        attach(opened, program)
        for host, port in (six, four):
            sent(opened, host, port=port)
            assert len(heard(opened)) == 1
            sent(opened, host)
            assert heard(opened) == []


def test_a_flood_is_filtered_counted_and_let_in_again_when_it_is_over() -> None:
    from msbot.process.virtual_time import run_virtual

    async def scene() -> None:
        with listening() as opened:
            part = sent(opened, "127.0.0.2")
            heard(opened)
            owner, dropped = Known(part), Tally()
            one = StrangerFilter(opened, "udp:test", owner, dropped)
            now = 100.0
            one.update(now)
            owner.stranger_count += 2000
            one.update(now := now + LOOK_S)
            assert one.is_on
            for host in strangers(200):
                sent(opened, host)
            sent(opened, "127.0.0.2", port=part[1])
            came = heard(opened)
            assert part in came
            assert len(came) < 150
            assert [peer for peer in came if one.takes(peer, now)] == [part]
            assert dropped[NOT_ANSWERED] == len(came) - 1
            one.update(now := now + LOOK_S)
            assert dropped[NOT_READ] == 200 - (len(came) - 1)
            for _ in range(20):
                one.update(now := now + LOOK_S)
            assert not one.is_on
            for host in strangers(200):
                sent(opened, host)
            assert len(heard(opened)) == 200
            one.stop()

    run_virtual(scene())
