"""A link over UDP on a socket that the test makes up: what is taken by which call, and what is left when it ends."""

from __future__ import annotations

import asyncio
import errno
import os
import select
import socket
from collections import deque
from collections.abc import Callable
from random import Random
from typing import Any

import pytest

from msbot_agent.link.net.batched_receive import BATCH
from msbot_agent.link.net.udp import ALONE, DRAIN_PACKETS, NOBODY_LISTENS, STAY_S, UdpClientLink, UdpServerLink, _looker
from msbot_agent.process.gathering import Gathering
from msbot_xrce.errors import LinkDown

PEER = ("10.0.0.1", 7)


class Kernel:
    """What waits in a socket: datagrams and errors; and a clock that each look at it moves on."""

    def __init__(self, step_s: float = 0.0) -> None:
        self.waiting: deque[bytes | int] = deque()
        self.calls: list[str] = []
        self.now, self.step_s = 0.0, step_s

    def recvfrom(self, _octets: int) -> tuple[bytes, tuple[str, int]]:
        self.calls.append("one")
        if not self.waiting:
            raise BlockingIOError
        return self._taken(), PEER

    def receive(self) -> list[tuple[bytes, tuple[str, int]]]:
        self.calls.append("many")
        found: list[tuple[bytes, tuple[str, int]]] = []
        while self.waiting and len(found) < BATCH and not (found and isinstance(self.waiting[0], int)):
            found.append((self._taken(), PEER))
        return found

    def _taken(self) -> bytes:
        first = self.waiting.popleft()
        if isinstance(first, int):
            raise OSError(first, os.strerror(first))
        return first

    def time(self) -> float:
        now = self.now
        self.now += self.step_s
        return now


class Linger:
    """Keeps what it is asked."""

    def __init__(self) -> None:
        self.calls: list[str] = []

    def woken(self, at: float) -> None:
        self.calls.append(f"woken at {at}")

    def watch(self, look: Callable[[], object], clock: Callable[[], float]) -> bool:
        self.calls.append("watch")
        return False


class Desk:
    """A link on such a socket."""

    def __init__(self, kernel: Kernel, *, in_batches: bool = True) -> None:
        self.kernel = kernel
        self.link = UdpServerLink("127.0.0.1", 0)
        self.got: list[bytes] = []
        self.bursts: list[int] = []
        self.linger = Linger()
        made: Any = self.link
        made._look = lambda: bool(kernel.waiting)
        made._batches = kernel if in_batches else None
        made._lingering = self.linger
        made._ended = asyncio.get_running_loop().create_future()
        self.refill: list[list[bytes | int]] = []
        self.link.attach(packet=lambda packet, peer, now: self.got.append(packet))
        self.link.attach(burst_end=self._burst_ended)

    def _burst_ended(self) -> None:
        self.bursts.append(len(self.got))
        if self.refill:
            self.kernel.waiting.extend(self.refill.pop(0))

    def drain(self, *waiting: bytes | int) -> list[str]:
        """Something has come; the calls by which it was taken."""
        self.kernel.waiting.extend(waiting)
        made: Any = self.kernel
        self.link._drain(made, made)
        calls, self.kernel.calls = self.kernel.calls, []
        return calls

    def ended(self) -> str:
        """Why the link has ended; empty: it has not."""
        future = self.link._ended
        assert future is not None
        return str(future.exception()) if future.done() else ""


def numbered(count: int) -> list[bytes]:
    return [number.to_bytes(4, "big") for number in range(count)]


async def test_which_call_takes_how_many() -> None:
    desk = Desk(Kernel())
    x = b"x"
    assert [desk.drain(*[x] * count) for count in (1, 1, 2, 1, 1)] == [
        ["one"],
        ["one"],
        ["one", "many"],
        ["many"],
        ["one"],
    ]
    assert desk.drain(*[x] * BATCH) == ["one", "many"]
    assert desk.drain(*[x] * BATCH) == ["many", "many"], "a full one may not be the last"
    assert desk.drain(x) == ["one"]
    assert desk.drain(*[x] * (BATCH + 1)) == ["one", "many", "many"]
    assert desk.drain(x, x) == ["many"]
    assert desk.drain(x, x) == ["many"], "two came together"
    assert desk.drain(x) == ["many"]
    assert desk.drain(x) == ["one"]
    assert desk.drain() == ["one"], "woken for nothing"
    alone = Desk(Kernel(), in_batches=False)
    assert alone.drain(x, x, x) == ["one"] * 3
    assert alone.linger.calls == ["woken at 0.0", "watch"]


async def test_after_many_lone_datagrams_the_next_is_answered_at_once_until_two_come_together() -> None:
    desk = Desk(Kernel())
    x = b"x"
    for _ in range(ALONE):
        desk.drain(x)
    desk.bursts.clear()
    desk.got.clear()
    assert desk.drain(x, x, x) == ["one", "one", "many"]
    assert desk.bursts == [1, 3]
    assert desk.drain(x, x) == ["many"]
    assert desk.bursts == [1, 3, 5]


async def test_where_the_loop_pauses_all_that_waits_is_taken_and_nobody_watches() -> None:
    desk = Desk(Kernel())
    x = b"x"
    for _ in range(ALONE):
        desk.drain(x)
    made: Any = desk.link
    made._gathering = gathering = Gathering()
    gathering.delay_s = 0.0001
    desk.linger.calls.clear()
    assert desk.drain(x, x, x) == ["one", "many"]
    assert "watch" not in desk.linger.calls


@pytest.mark.parametrize("in_batches", [True, False])
async def test_one_burst_has_so_many_and_the_next_follows_in_the_same_turn(in_batches: bool) -> None:
    desk = Desk(Kernel(), in_batches=in_batches)
    desk.refill = [[b"late"], []]
    desk.drain(*numbered(3 * DRAIN_PACKETS))
    assert desk.got == [*numbered(3 * DRAIN_PACKETS), b"late"]
    most = DRAIN_PACKETS + 1 if in_batches else DRAIN_PACKETS  # the first one comes before its batches
    assert desk.bursts[0] == most
    assert max(later - at for at, later in zip(desk.bursts, desk.bursts[1:], strict=False)) == DRAIN_PACKETS


@pytest.mark.parametrize("seed", range(12))
async def test_whatever_waits_is_taken_once_and_in_order_up_to_an_error_of_the_socket_itself(seed: int) -> None:
    random = Random(seed)
    desk = Desk(Kernel(), in_batches=seed % 3 != 0)
    passing = {errno.ECONNREFUSED: 0, errno.EHOSTUNREACH: 0, errno.ENOBUFS: 0}
    expected: list[bytes] = []
    for _ in range(12):
        waiting: list[bytes | int] = []
        for octets in numbered(random.choice((0, 1, 2, 5, BATCH, BATCH + 1, 3 * BATCH))):
            if random.random() < 0.05:
                error = random.choice(list(passing))
                passing[error] += 1
                waiting.append(error)
            waiting.append(octets)
            expected.append(octets)
        desk.drain(*waiting)
        assert desk.got == expected
        assert not desk.kernel.waiting
    assert desk.ended() == ""
    assert sum(desk.link.counters.dropped.values()) == sum(passing.values())
    desk.drain(b"last", errno.EBADF, b"never")
    assert desk.got == [*expected, b"last"]
    assert desk.ended() == f"udp:127.0.0.1:0 failed: {os.strerror(errno.EBADF)}: start it again"
    assert desk.kernel.waiting == deque([b"never"])


@pytest.mark.parametrize(("step_s", "bursts"), [(0.0, 10), (STAY_S / 2, 3), (STAY_S, 2), (2 * STAY_S, 1)])
async def test_others_have_their_turn_after_a_while_however_much_comes(step_s: float, bursts: int) -> None:
    kernel = Kernel()
    desk = Desk(kernel)
    one: list[bytes | int] = [b"x"]
    desk.refill = [one] * 9

    def burst_ended() -> None:
        desk._burst_ended()
        kernel.now += step_s

    desk.link.attach(burst_end=burst_ended)
    desk.drain(b"x")
    assert len(desk.bursts) == bursts


async def test_the_link_says_when_it_could_not_read_all_that_had_come() -> None:
    desk = Desk(Kernel(step_s=0.004))  # a burst ends by its time, after two batches
    desk.drain(b"x", b"x")
    assert desk.link.unread_at < 0
    desk.drain(*numbered(8 * BATCH))
    assert desk.kernel.waiting
    first = desk.link.unread_at
    assert 0 < first < desk.kernel.now
    desk.drain()
    assert desk.kernel.waiting
    assert first < (second := desk.link.unread_at)
    while desk.kernel.waiting:
        desk.drain()
    desk.drain(b"x")
    assert second < desk.link.unread_at < desk.kernel.now - desk.kernel.step_s, "the last burst took all"


async def test_an_error_of_one_packet_is_the_end_of_it_and_not_of_the_link() -> None:
    made: Any = UdpServerLink("127.0.0.1", 0)
    loop = asyncio.get_running_loop()
    made._loop, made._socket, made._ended = loop, object(), loop.create_future()
    sent: list[bytes] = []

    def transmit(packet: bytes, _peer: object) -> None:
        if packet == b"bad":
            raise OSError(errno.EHOSTUNREACH, "no way")
        sent.append(packet)

    made._transmit = transmit
    for packet in (b"one", b"bad", b"two"):
        made.send(packet, PEER)
    assert (sent, list(made._queue), made.counters.packets_out) == ([b"one", b"two"], [], 2)
    assert sum(made.counters.dropped.values()) == 1


async def test_nothing_is_left_with_the_loop_when_the_link_ends() -> None:
    loop: Any = asyncio.get_running_loop()
    before = set(loop._selector.get_map())
    link: Any = UdpServerLink("127.0.0.1", 0)
    running = asyncio.create_task(link.run())
    while not link.port:  # noqa: ASYNC110 - the address is looked up in a thread
        await asyncio.sleep(0)

    def full(_packet: bytes, _peer: object) -> None:
        raise BlockingIOError

    link._transmit = full
    link.send(b"x", ("127.0.0.1", 9))
    assert len(set(loop._selector.get_map()) - before) == 1
    sent: list[bytes] = []
    link._transmit = lambda packet, _peer: sent.extend([packet])
    link._send_queued(link._socket, loop)
    assert sent == [b"x"]
    assert [key.events for fd, key in loop._selector.get_map().items() if fd not in before] == [1], "read only"
    link._transmit = full
    link.send(b"y", ("127.0.0.1", 9))
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)
    assert set(loop._selector.get_map()) == before


async def test_a_refusal_that_concerns_an_earlier_packet_does_not_lose_this_one() -> None:
    client = UdpClientLink("127.0.0.1", 9)
    sent: list[bytes] = []

    class Refused:
        """Says once that nobody listened."""

        def send(self, packet: bytes) -> None:
            sent.append(packet)
            if len(sent) == 1:
                raise ConnectionRefusedError

    made: Any = Refused()
    client._transmitter(made)(b"x", ("127.0.0.1", 9))
    assert sent == [b"x", b"x"]
    assert client.counters.dropped == {NOBODY_LISTENS: 1}


@pytest.mark.parametrize("has_poll", [True, False])
def test_a_look_says_whether_something_is_there_and_waits_for_nothing(
    has_poll: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not has_poll:
        monkeypatch.delattr(select, "poll")
    waited: list[object] = []
    plain = select.select

    def noted(*more: Any) -> Any:
        waited.append(more[3])
        return plain(*more)

    monkeypatch.setattr(select, "select", noted)
    one, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    with one, other:
        look = _looker(one)
        assert not look()
        other.send(b"x")
        assert look()
        one.recv(9)
        assert not look()
    assert waited == ([] if has_poll else [0, 0, 0])


async def test_who_a_peer_is_without_its_port() -> None:
    link = UdpServerLink("127.0.0.1", 0)
    assert [link.origin(peer) for peer in (PEER, ("::1", 7, 0, 0), "somebody")] == ["10.0.0.1", "::1", "somebody"]
    with pytest.raises(LinkDown, match="is not open"):
        link.send(b"x", PEER)
