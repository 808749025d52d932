"""Participants in virtual time on a network that loses, doubles and reorders datagrams."""

from __future__ import annotations

import heapq
from collections.abc import Callable
from random import Random

from msbot_agent.space.contract import Guid, Qos
from msbot_agent.space.rtps import rtps_messages
from msbot_agent.space.rtps.descriptions import Address
from msbot_agent.space.rtps.participant import RtpsParticipant
from msbot_agent.space.rtps.reliable_writer import RtpsEndpoint, RtpsSample
from msbot_agent.space.rtps.rtps_messages import Inline, RtpsData

GROUP = ("239.255.0.1", 7400)


class Network:
    """A network, and its time."""

    def __init__(self, seed: int = 1, *, loss: float = 0.0, disorder: float = 0.0) -> None:
        self.now = 0.0
        self.sent = 0
        self.loss, self.disorder = loss, disorder
        self._random = Random(seed)
        self._members: dict[Address, RtpsParticipant] = {}
        self._under_way: list[tuple[float, int, bytes, Address, Address]] = []

    def join(self, number: int, vendor: bytes = rtps_messages.VENDOR) -> RtpsParticipant:
        """A participant more."""
        address = (f"10.0.0.{number}", 7410)
        prefix = vendor + bytes((number,)) * 10
        self._members[address] = made = RtpsParticipant(prefix, addresses=(address,), group=GROUP, now=self.now)
        return made

    def cut(self, participant: RtpsParticipant) -> None:
        """It is gone without a word."""
        self._members = {address: one for address, one in self._members.items() if one is not participant}

    def inject(self, datagram: bytes, to: RtpsParticipant, source: Address = ("10.0.0.99", 7410)) -> None:
        """A datagram of a stranger."""
        to.receive(datagram, source, self.now)

    def run_until(self, condition: Callable[[], object], most_s: float = 60.0) -> None:
        """Let time go on until it is so."""
        end = self.now + most_s
        while not condition():
            assert self.now < end, "it never came to that"
            self._step()

    def run_for(self, seconds: float) -> None:
        """Let so much time go by."""
        end = self.now + seconds
        self.run_until(lambda: self.now >= end, seconds + 1)

    def _step(self) -> None:
        for address, one in self._members.items():
            self._post(one, address)
        dues = [one.deadline() for one in self._members.values()]
        arrival = self._under_way[0][0] if self._under_way else self.now + 1.0
        self.now = max(self.now, min(arrival, *dues)) if dues else arrival
        while self._under_way and self._under_way[0][0] <= self.now:
            _, _, datagram, source, target = heapq.heappop(self._under_way)
            for address, one in list(self._members.items()):
                if address == target or (target == GROUP and address != source):
                    one.receive(datagram, source, self.now)
        for one in list(self._members.values()):
            if one.deadline() <= self.now:
                one.tick(self.now)

    def _post(self, one: RtpsParticipant, source: Address) -> None:
        for datagram, target in one.outbox:
            self.sent += 1
            assert len(datagram) < 65_000
            if self._random.random() >= self.loss:
                delay = 0.001 * (20 if self._random.random() < self.disorder else 1)
                heapq.heappush(self._under_way, (self.now + delay, self.sent, datagram, source, target))
        one.outbox.clear()


class Inbox:
    """What a reader has taken."""

    def __init__(self) -> None:
        self.samples: list[tuple[Guid, RtpsData]] = []

    def __call__(self, writer: Guid, data: RtpsData) -> None:
        self.samples.append((writer, data))

    @property
    def payloads(self) -> list[bytes]:
        """The payloads."""
        return [data.payload for _, data in self.samples]


def reader(participant: RtpsParticipant, topic: str = "rq/xRequest") -> tuple[RtpsEndpoint, Inbox]:
    """A reader on a topic of services."""
    inbox = Inbox()
    return participant.open_reader(topic, "X", Qos(depth=64), inbox), inbox


def writer(
    participant: RtpsParticipant, topic: str = "rq/xRequest", *, depth: int = 512, replies: str = ""
) -> RtpsEndpoint:
    """A writer on it."""
    return participant.open_writer(topic, "X", Qos(depth=depth), replies=replies)


def write(
    network: Network,
    participant: RtpsParticipant,
    endpoint: RtpsEndpoint,
    payload: bytes,
    *,
    readers: frozenset[Guid] | None = None,
    related: tuple[Guid, int] | None = None,
    plain: bytes | None = None,
) -> None:
    """Send a sample."""
    assert endpoint.writer is not None
    change = RtpsSample(payload, Inline(related), readers, plain)
    participant.write(endpoint, endpoint.writer.last + 1, change, network.now)
