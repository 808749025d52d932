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
from collections.abc import Callable

from msbot_agent.agent.client_table import ServedLink
from msbot_agent.agent.latency import Transit
from msbot_agent.agent.proxy import Proxy
from msbot_agent.agent.timers import TimerHeap
from msbot_agent.link import Peer
from msbot_agent.text.sentence import said
from msbot_xrce.errors import LinkDown, LinkFull

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
        self._compare_at = 0.0
        self._marked: list[Proxy] = []
        self._timers: TimerHeap[Proxy] = TimerHeap()
        self._lives: TimerHeap[Proxy] = TimerHeap()
        self._alarm: asyncio.TimerHandle | None = None
        self._alarm_at = math.inf

    def mark(self, proxy: Proxy) -> None:
        """Serve the client at the end of the burst or turn."""
        if proxy.is_marked:
            return
        proxy.is_marked = True
        self._marked.append(proxy)
        if len(self._marked) == 1 and not self.in_burst:
            asyncio.get_running_loop().call_soon(self.flush)

    def flush(self) -> None:
        """Serve all marked clients now."""
        self.in_burst = False
        if not self._marked:
            return
        now = self._clock()
        if now >= self._compare_at:
            self._compare_at = self._compare(now)
        marked, self._marked = self._marked, []
        for proxy in marked:
            proxy.is_marked = False
            if not proxy.is_over:
                self._serve(proxy, now)
        if self._transit.booked:
            self._transit.settle()

    def room_gained(self, port: ServedLink, peer: Peer | None) -> None:
        """The link has room for that peer again, or for all."""
        now = self._clock()
        for proxy in list(port.blocked):
            if peer is None or port.members[proxy] == peer:
                self._serve(proxy, now)
        if self._transit.booked:
            self._transit.settle()

    def watch_life(self, proxy: Proxy, when: float) -> None:
        """Check at that time whether the client is still alive."""
        if when < math.inf:
            self._lives.schedule(proxy, when)
            self._set_alarm(when)

    def forget(self, proxy: Proxy) -> None:
        """Forget a client that is gone."""
        self._timers.forget(proxy)
        self._lives.forget(proxy)

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
        for packet in packets:
            try:
                port.link.send(packet, peer)
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
        if proxy.is_at_rest():
            self._timers.rest(proxy)
            return
        self.send(proxy, now)
        when = proxy.timer()
        if when is None:
            self._timers.rest(proxy)
        else:
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
            outbox.popleft()
        proxy.is_blocked = True
        port.blocked[proxy] = None

    def _set_alarm(self, when: float) -> None:
        if when < self._alarm_at:
            if self._alarm is not None:
                self._alarm.cancel()
            self._alarm_at = when
            self._alarm = asyncio.get_running_loop().call_at(when, self._ring)

    def _ring(self) -> None:
        self._alarm, self._alarm_at = None, math.inf
        now = self._clock()
        self.in_burst = True
        try:
            for proxy in self._timers.pop_due(now):
                when = proxy.timer()
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
