"""What a writer and a reader in Zenoh have in common: a key, the endpoints of others at it, and what was lost."""

from __future__ import annotations

import asyncio
import logging
from dataclasses import replace
from types import ModuleType
from typing import TYPE_CHECKING, Any

from msbot_agent.space.contract import Guid, Qos
from msbot_agent.space.memory import MAX_TROUBLES
from msbot_agent.space.qos_matching import mismatch
from msbot_agent.space.zenoh.key_expressions import PeerEndpoint, data_key, endpoint_of, graph_key, token_key
from msbot_agent.space.zenoh.sample_envelope import LoopQueue

if TYPE_CHECKING:
    import zenoh

MAX_NEIGHBOURS = 1024
"""Endpoints of others that are remembered for one of ours."""
MAX_NEWS = 4096
"""Comings and goings of endpoints that may wait for the loop."""

logger = logging.getLogger(__name__)


class LibraryEndpoint:
    """One writer or reader in Zenoh, under one of the topic's names; base of `LibraryWriter` and `LibraryReader`."""

    __slots__ = (
        "_declared",
        "_guid",
        "_loop",
        "_neighbours",
        "_news",
        "_next_warning",
        "is_open",
        "key",
        "lost",
        "name",
        "partition",
        "qos",
        "refused",
        "topic_domain",
        "type_name",
    )

    WRITES: bool
    """Whether samples go out here."""
    LOST: str
    """What is reported of lost samples, after their number."""
    REFUSED: str
    """What is reported of samples that made no sense, after their number."""

    def __init__(  # noqa: PLR0917 - made by ZenohSpace only
        self,
        loop: asyncio.AbstractEventLoop,
        partition: str,
        domain: int,
        name: str,
        type_name: str,
        qos: Qos,
        guid: Guid,
    ) -> None:
        """`guid` is the one by which others know it."""
        self.key = data_key(partition, domain, name, type_name)
        self.partition = partition
        self.topic_domain = domain
        self.name = name
        self.type_name = type_name
        self.qos = replace(qos, partitions=())  # those are in the key
        self.lost = 0
        self.refused = 0
        self.is_open = True
        self._next_warning = 1
        self._loop = loop
        self._guid = guid
        self._declared: list[Any] = []
        self._neighbours: dict[str, PeerEndpoint] = {}
        self._news: LoopQueue[tuple[bool, str]] = LoopQueue(loop, self._heard, MAX_NEWS)

    def declare(self, library: ModuleType, session: zenoh.Session) -> None:
        """Make it known; in the connection's thread."""
        if not self.is_open:
            return
        self._declare_data(library, session)
        token = token_key(self.key, self._guid, self.qos, writes=self.WRITES)
        self._declared.append(session.liveliness().declare_token(token))
        watched = graph_key(self.partition, self.topic_domain, self.name)
        callback = library.handlers.Callback(
            lambda sample: self._news.put((sample.kind == library.SampleKind.PUT, str(sample.key_expr))), indirect=False
        )
        self._declared.append(session.liveliness().declare_subscriber(watched, callback, history=True))

    def undeclare(self, _session: zenoh.Session) -> None:
        """Take it out; in the connection's thread."""
        for declared in reversed(self._declared):
            declared.undeclare()
        self._declared.clear()

    def troubles(self) -> tuple[str, ...]:
        """Which endpoints in other programs should match it and cannot, and what was lost."""
        found: dict[str, None] = {}
        for other in self._neighbours.values():
            reason = self._obstacle(other)
            if reason is not None:
                found[f"{self.name}: {reason}"] = None
        if self.lost:
            found[f"{self.name}: {self.lost} {self.LOST}"] = None
        if self.refused:
            found[f"{self.name}: {self.refused} {self.REFUSED}"] = None
        return tuple(found)[:MAX_TROUBLES]

    def _declare_data(self, library: ModuleType, session: zenoh.Session) -> None:
        raise NotImplementedError

    def _appeared(self, other: PeerEndpoint) -> None:
        """One that it may match has come."""

    def _gone(self, other: PeerEndpoint) -> None:
        """One has gone."""

    def _count_lost(self, number: int) -> None:
        self.lost += number
        if self.lost >= self._next_warning:
            self._next_warning = 2 * self.lost
            logger.warning("%s: %s %s", self.name, self.lost, self.LOST)

    def _heard(self, news: tuple[bool, str]) -> None:
        is_there, token = news
        if not is_there:
            gone = self._neighbours.pop(token, None)
            if gone is not None:
                self._gone(gone)
            return
        other = endpoint_of(token)
        if other is None or other.is_writer is self.WRITES or len(self._neighbours) >= MAX_NEIGHBOURS:
            return
        if token in self._neighbours or not self.is_open:
            return
        self._neighbours[token] = other
        reason = self._obstacle(other)
        if reason is None:
            self._appeared(other)
        else:
            logger.warning("%s: %s", self.name, reason)

    def _obstacle(self, other: PeerEndpoint) -> str | None:
        if other.type_name != self.type_name:
            verb = "read" if self.WRITES else "written"
            return f"TYPE: it is {verb} as {other.type_name} by a Zenoh peer, here it is {self.type_name}"
        offered, requested = (self.qos, other.qos) if self.WRITES else (other.qos, self.qos)
        reason = mismatch(offered, requested)
        return None if reason is None else f"{reason} (a Zenoh peer)"
