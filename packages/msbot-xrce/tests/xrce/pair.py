"""A client and an agent back to back, in virtual time, over a network that loses, repeats and reorders on request."""

from __future__ import annotations

import heapq
import random
from collections.abc import Callable

from msbot_xrce import AgentSession, AgentSessionSettings, ClientSession, ClientSessionSettings, Status
from msbot_xrce.messages import CreateClient, Header, StatusAgent, encode_message
from msbot_xrce.sessions import (
    AgentEvent,
    ClientEvent,
    CreateRequested,
    DeleteRequested,
    InfoRequested,
    SessionDeleteRequested,
)

KEY = 0xAABBCCDD
CLOCK_AHEAD_NS = 5_000_000_000
"""How much the agent's wall clock is ahead of the client's."""


class Pair:
    """Both ends and the network between them; logging in is answered here, as an agent's server does.

    Packets of stream NONE that log in are lost at times, but neither repeated nor overtaken: XRCE has no defence
    against an old CREATE_CLIENT that comes late.
    """

    def __init__(
        self,
        *,
        loss: float = 0.0,
        duplicate: float = 0.0,
        reorder: float = 0.0,
        seed: int = 0,
        latency_s: float = 0.001,
        mtu: int = 512,
        session_id: int = 0x81,
        agent_settings: AgentSessionSettings | None = None,
        client_settings: ClientSessionSettings | None = None,
        connected: bool = True,
    ) -> None:
        self.loss, self.duplicate, self.reorder = loss, duplicate, reorder
        self.latency_s = latency_s
        self.now = 0.0
        self.client = ClientSession(
            KEY,
            session_id=session_id,
            mtu=mtu,
            settings=client_settings,
            epoch_ns=lambda: round(self.now * 1e9),
        )
        self.agent = AgentSession(
            KEY,
            session_id,
            mtu - 4,
            settings=agent_settings,
            epoch_ns=lambda: round(self.now * 1e9) + CLOCK_AHEAD_NS,
        )
        self.agent_is_there = True
        self.client_events: list[ClientEvent] = []
        self.agent_events: list[AgentEvent] = []
        self.on_agent_event: Callable[[AgentEvent], None] = lambda _event: None
        self.carried: list[tuple[str, bytes]] = []
        """Every packet that was put on the network, also those that were lost."""
        self._random = random.Random(seed)
        self._network: list[tuple[float, int, bool, bytes]] = []
        self._order = 0
        if connected:
            self.client.connect(self.now)
            self.run(0.1)

    def heal(self) -> None:
        """From now on the network is perfect."""
        self.loss = self.duplicate = self.reorder = 0.0

    def cut(self) -> None:
        """Everything on its way is lost."""
        self._network.clear()

    def run(self, seconds: float) -> None:
        """Let time pass."""
        end = self.now + seconds
        while self._step(end):
            pass
        self.now = end

    def settle(self, seconds: float = 60.0) -> None:
        """Let time pass until nothing is on its way and no timer runs; fails when that takes too long."""
        end = self.now + seconds
        while self._step(end):
            pass
        assert not self._network, "packets are still on their way"
        assert self._next_timer() is None, "a timer still runs"

    def take_client_events(self) -> list[ClientEvent]:
        """What the client was told since the last call."""
        events, self.client_events = self.client_events, []
        return events

    def take_agent_events(self) -> list[AgentEvent]:
        """What the agent was told since the last call."""
        events, self.agent_events = self.agent_events, []
        return events

    def _step(self, end: float) -> bool:
        """Do the next thing that happens until `end`; False when nothing does."""
        self._pull()
        arrival = self._network[0][0] if self._network else None
        timer = self._next_timer()
        times = [at for at in (arrival, timer) if at is not None]
        if not times or min(times) > end:
            return False
        self.now = max(self.now, min(times))
        if arrival is not None and arrival <= self.now:
            _, _, to_agent, packet = heapq.heappop(self._network)
            self._deliver(packet, to_agent=to_agent)
        else:
            self.client.handle_timer(self.now)
            self.agent.handle_timer(self.now)
            self._take_events()
        return True

    def _next_timer(self) -> float | None:
        times = [at for at in (self.client.timer(), self.agent.timer()) if at is not None]
        return min(times) if times else None

    def _pull(self) -> None:
        for packet in self.client.packets_to_send(self.now):
            self.carry(packet, to_agent=True)
        for packet in self.agent.packets_to_send(self.now):
            self.carry(packet, to_agent=False)

    def carry(self, packet: bytes, *, to_agent: bool) -> None:
        """Put a packet on the network."""
        self.carried.append((">" if to_agent else "<", packet))
        if self._random.random() < self.loss:
            return
        is_login = packet[0] == 0x80 or packet[4:5] == b"\x04"
        copies = 2 if not is_login and self._random.random() < self.duplicate else 1
        for _ in range(copies):
            delay = self.latency_s
            if not is_login and self._random.random() < self.reorder:
                delay += self._random.random() * 20 * self.latency_s
            self._order += 1
            heapq.heappush(self._network, (self.now + delay, self._order, to_agent, packet))

    def _deliver(self, packet: bytes, *, to_agent: bool) -> None:
        if not to_agent:
            self.client.receive_packet(packet, self.now)
        elif not self.agent_is_there:
            return
        elif packet[0] in (0x00, 0x80) and packet[4 if packet[0] else 8] == CreateClient.ID:
            # What was on its way in the old session is gone: a new login means that the link was new, too.
            self.agent.relogin()
            session_id = self.agent.session_id
            answer = encode_message(Header(session_id, client_key=KEY), [StatusAgent(Status.OK)], pad_end=False)
            self.carry(answer, to_agent=False)
        else:
            self.agent.receive_packet(packet, self.now)
        self._take_events()

    def _take_events(self) -> None:
        while (event := self.client.next_event()) is not None:
            self.client_events.append(event)
        while (request := self.agent.next_event()) is not None:
            self.agent_events.append(request)
            self._answer(request)
            self.on_agent_event(request)

    def _answer(self, request: AgentEvent) -> None:
        match request:
            case CreateRequested() | DeleteRequested() | SessionDeleteRequested():
                self.agent.send_status(request.request_id, request.object_id, Status.OK, request.stream_id)
            case InfoRequested():
                self.agent.send_info(request.request_id, request.object_id)


def only(events: list[ClientEvent], kind: type[ClientEvent]) -> list[ClientEvent]:
    """The events of one kind."""
    return [event for event in events if isinstance(event, kind)]
