"""Flushing: sends the packets of the clients' sessions, as many as each link accepts, and wakes sessions when a timer
is due.

Theory of operation. Every client that has something to send is marked; all marked ones are served at the end of the
burst of packets that caused it, or of the turn of the loop. Packets for which a link has no room wait in the client's
outbox. While there is a packet in the outbox, the client takes no more samples: they wait in the bounded histories of
its readers until the link asks for more. One timer serves all clients; it never fires later than the first of them
needs it, and firing early costs only one check.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Hashable, Iterator
from heapq import heappop, heappush
from typing import Any, Generic, TypeVar

from msbot_agent.agent.client_table import ServedLink
from msbot_agent.agent.proxy import Proxy
from msbot_agent.agent.statistics import Transit
from msbot_agent.link import Peer
from msbot_agent.text.sentence import said
from msbot_xrce.errors import LinkDown, LinkFull

# When to look at which client again: a heap without one asyncio timer per client.


BEHIND_S = 0.05
"""For so long after a link could not read all that had come, it may hold answers to what was asked before. To ask
again, or to ask for acknowledgements, would make its queue longer still. So thousands of clients that come back at once
are answered first.
"""

MOST_STALE = 256
"""Stale entries that are never thrown out before their time."""

Owner = TypeVar("Owner", bound=Hashable)

_Entry = list[Any]
"""When, a number of its own, the owner (None: the entry is stale), and whether it fires (no: stale, or at rest)."""
_OWNER, _FIRES = 2, 3


class TimerHeap(Generic[Owner]):
    """The next time of every owner, earliest first.

    Moving an owner's time later costs nothing: the old time fires, the owner finds nothing to do and says when to fire
    next. The same goes for an owner that rests: its time stays, and counts again when it has something to do. So there
    is normally one entry per owner, plus a stale one each time it is moved earlier or forgotten. When more than half of
    the entries are stale, they are thrown out.
    """

    __slots__ = ("_due", "_heap", "_number")

    def __init__(self) -> None:
        self._heap: list[_Entry] = []
        self._due: dict[Owner, _Entry] = {}
        self._number = 0

    def __len__(self) -> int:
        return len(self._heap)

    def schedule(self, owner: Owner, when: float) -> None:
        """Fire for that owner at `when`, unless it fires earlier anyway."""
        due = self._due
        entry = due.get(owner)
        if entry is not None:
            if entry[0] <= when:
                entry[_FIRES] = True
                return
            entry[_FIRES], entry[_OWNER] = False, None
        self._number = number = self._number + 1
        due[owner] = entry = [when, number, owner, True]
        heappush(self._heap, entry)
        if len(self._heap) > 2 * len(due) + MOST_STALE:
            self._heap = sorted(due.values())

    def suspend(self, owner: Owner) -> None:
        """Do not fire for that owner until it is scheduled again; cheap, for owners that soon will be."""
        entry = self._due.get(owner)
        if entry is not None:
            entry[_FIRES] = False

    def forget(self, owner: Owner) -> None:
        """Do not fire for that owner, and do not keep it alive."""
        entry = self._due.pop(owner, None)
        if entry is not None:
            entry[_FIRES], entry[_OWNER] = False, None

    def next_at(self) -> float | None:
        """When the next owner fires."""
        heap = self._heap
        while heap and not heap[0][_FIRES]:
            resting = heappop(heap)[_OWNER]
            if resting is not None:
                del self._due[resting]
        when: float | None = heap[0][0] if heap else None
        return when

    def pop_due(self, now: float) -> Iterator[Owner]:
        """The owners whose time has come, each once; they may be scheduled again during the loop, but later than
        `now`."""
        while (when := self.next_at()) is not None and when <= now:
            owner: Owner = heappop(self._heap)[_OWNER]
            del self._due[owner]
            yield owner


EndSession = Callable[[Proxy, str], None]


class Flusher:
    """Serves the clients of one agent on its event loop."""

    def __init__(
        self,
        clock: Callable[[], float],
        end_session: EndSession,
        compare: Callable[[float], float] = lambda _: math.inf,
        *,
        transit: Transit,
    ) -> None:
        """`compare` is called when it is time to compare how much the clients send; it returns when to call it
        again."""
        self.in_burst = False
        """Whether `flush` will be called at the end of the burst that is being received."""
        self._clock = clock
        self._end_session = end_session
        self._compare = compare
        self._transit = transit
        self.compare_at = 0.0
        """When `compare` is to be called with the next packet, whether it is answered or not."""
        self._marked: list[Proxy] = []
        self._timers: TimerHeap[Proxy] = TimerHeap()
        self._lives: TimerHeap[Proxy] = TimerHeap()
        self._alarm: asyncio.TimerHandle | None = None
        self._alarm_at = math.inf

    def schedule(self, proxy: Proxy) -> None:
        """Serve the client at the end of the burst or turn."""
        if proxy.is_marked:
            return
        proxy.is_marked = True
        self._marked.append(proxy)
        if len(self._marked) == 1 and not self.in_burst:
            asyncio.get_running_loop().call_soon(self.flush)

    def rest(self, proxy: Proxy) -> None:
        """Do not wake the client before it is served again: nothing of it waits for a time.

        So a message that was acknowledged does not wake the loop later: among many clients, each would.
        """
        self._timers.suspend(proxy)
        proxy.is_timed = False

    def flush(self) -> None:
        """Serve all marked clients now."""
        self.in_burst = False
        if not self._marked:
            return
        now = self._clock()
        if now >= self.compare_at:
            self.compare(now)
        marked, self._marked = self._marked, []
        for proxy in marked:
            proxy.is_marked = False
            if not proxy.is_over:
                self._serve(proxy, now)
        if self._transit.booked:
            self._transit.mark_sent()

    def compare(self, now: float) -> None:
        """Compare how much the clients send."""
        self.compare_at = self._compare(now)

    def room_gained(self, port: ServedLink, peer: Peer | None) -> None:
        """The link has room for that peer again, or for all."""
        now = self._clock()
        for proxy in list(port.blocked):
            if peer is None or port.members[proxy] == peer:
                self._serve(proxy, now)
        if self._transit.booked:
            self._transit.mark_sent()

    def watch_life(self, proxy: Proxy, when: float) -> None:
        """Check at that time whether the client is still alive."""
        if when < math.inf:
            self._lives.schedule(proxy, when)
            self._set_alarm(when)

    def forget(self, proxy: Proxy) -> None:
        """Forget a client that is gone."""
        self._timers.forget(proxy)
        self._lives.forget(proxy)

    def begin(self, clock: Callable[[], float]) -> None:
        """Serve on a loop with that clock."""
        self._clock = clock

    def stop(self) -> None:
        """Wake nobody any more."""
        if self._alarm is not None:
            self._alarm.cancel()

    def send(self, proxy: Proxy, now: float) -> None:
        """Send the packets of the client's session, as far as the link accepts them."""
        place = proxy.place
        if place is None:
            return
        port, peer = place
        if proxy.is_blocked or proxy.outbox or port.batch is not None or not port.link.has_room(peer):
            self._send_slowly(proxy, port, peer, now)
            return
        packets = iter(proxy.session.packets_to_send(now))
        send = port.link.send
        for packet in packets:
            try:
                send(packet, peer)
            except (LinkDown, LinkFull):
                proxy.outbox.append(packet)
                proxy.outbox.extend(packets)
                self._send_slowly(proxy, port, peer, now)
                return
            proxy.bytes_out += len(packet)

    def send_one(self, port: ServedLink, packet: bytes, peer: Peer) -> None:
        """Send a packet outside of a session; if it cannot be sent, the other side will repeat its question."""
        try:
            port.link.send(packet, peer)
        except (LinkFull, LinkDown) as error:
            port.dropped.count(f"answer not sent: {type(error).__name__}")

    def _serve(self, proxy: Proxy, now: float) -> None:
        """Send for a client, and work out when to look at it again."""
        self.send(proxy, now)
        when = proxy.timer()
        if when is None:
            self.rest(proxy)
        else:
            proxy.is_timed = True
            self._timers.schedule(proxy, when)
            if when < self._alarm_at:
                self._set_alarm(when)

    def _send_slowly(self, proxy: Proxy, port: ServedLink, peer: Peer, now: float) -> None:
        """Send on a link that is or was full, or that takes packets one by one so that waiting samples stay fresh."""
        link = port.link
        outbox = proxy.outbox
        pulled_all = False
        while link.has_room(peer):
            if not outbox and not pulled_all:
                outbox.extend(proxy.session.packets_to_send(now, port.batch))
                pulled_all = port.batch is None or not outbox
            if not outbox:
                if not proxy.is_blocked:
                    return
                if not proxy.pull(port.batch):
                    proxy.is_blocked = False
                    del port.blocked[proxy]
                pulled_all = False
                continue
            packet = outbox[0]
            try:
                link.send(packet, peer)
            except LinkFull:
                break
            except LinkDown:
                proxy.dropped.count("packet for a link that is down")
            else:
                proxy.bytes_out += len(packet)
            del outbox[0]
        proxy.is_blocked = True
        port.blocked[proxy] = None

    def _set_alarm(self, when: float) -> None:
        if when < self._alarm_at:
            if self._alarm is not None:
                self._alarm.cancel()
            self._alarm_at = when
            # A little early, if the loop rounds its timers: nearly always everything has been acknowledged by then, and
            # the check that finds nothing to do needs no turn of its own.
            self._alarm = asyncio.get_running_loop().call_later(when - self._clock(), self._ring, when)

    def _ring(self, at: float) -> None:
        self._alarm, self._alarm_at = None, math.inf
        now = self._clock()
        self.in_burst = True
        try:
            for proxy in [*self._timers.pop_due(max(now, at))]:
                when = proxy.timer()
                if when is not None and when <= now and _is_behind(proxy, now):
                    when = proxy.put_off_asking(now)
                if when is not None and when <= now:
                    proxy.handle_timer(now)
                elif when is not None:
                    self._timers.schedule(proxy, when)
            for proxy in self._lives.pop_due(now):
                self._check_life(proxy, now)
        finally:
            self.flush()
        for next_at in (self._timers.next_at(), self._lives.next_at()):
            if next_at is not None:
                self._set_alarm(next_at)

    def _check_life(self, proxy: Proxy, now: float) -> None:
        when = proxy.next_life_check(now)
        if when is not None:
            self.watch_life(proxy, when)
            return
        if proxy.gone is None:
            why = said("silent for {seconds:.1f} s, and did not answer", seconds=now - proxy.last_heard)
        else:
            why = said("{gone}, and did not come back", gone=proxy.gone)
        self._end_session(proxy, why)


def _is_behind(proxy: Proxy, now: float) -> bool:
    """Whether the answers of that client may lie unread in a socket."""
    if proxy.place is None or (backlog := proxy.place[0].backlog) is None:
        return False
    return now - backlog.unread_at < BEHIND_S
