"""What a writer and a reader in the library have in common: a name in DDS, and a list of the endpoints that should
match them and cannot."""

from __future__ import annotations

import ctypes
from ctypes import byref

from msbot_agent.space.contract import THIS_PROGRAM, OwnEndpoint, Owner, Qos
from msbot_agent.space.dds.libddsc import DdsLibrary, Incompatible
from msbot_agent.space.dds.native_qos import COMPARED, POLICIES
from msbot_agent.space.dds.raw_type import Serialiser
from msbot_agent.space.dds.remote_endpoints import RemoteEndpoints, obstacle
from msbot_agent.space.memory import MAX_TROUBLES
from msbot_xrce.lazy import dataclass

# What did not get through between this process and DDS.


@dataclass(slots=True)
class Counts:
    """Samples of one endpoint."""

    lost: int = 0
    """Samples pushed out before there was room for them."""
    refused: int = 0
    """Samples whose octets made no sense."""


class LibraryEndpoint:
    """A writer or reader of the library, under one of its names; base of `LibraryWriter` and `LibraryReader`."""

    __slots__ = (
        "_library",
        "_neighbours",
        "_others",
        "_serialiser",
        "counts",
        "domain",
        "entity",
        "guid",
        "name",
        "owner",
        "qos",
        "type_name",
    )

    WRITES: bool
    """Whether samples go out here."""
    DIFFERS: str
    """What is reported of a peer with another policy."""
    LOST: str
    """What is reported of lost samples, after their number."""
    REFUSED: str
    """What is reported of samples that made no sense, after their number."""

    def __init__(  # noqa: PLR0917 - made by DdsSpace only
        self,
        library: DdsLibrary,
        serialiser: Serialiser,
        entity: int,
        name: str,
        type_name: str,
        qos: Qos,
        neighbours: RemoteEndpoints,
        domain: int,
    ) -> None:
        self.entity = entity
        self.name = name
        self.type_name = type_name
        self.qos = qos
        """Quality of service, with the partitions it has in DDS."""
        self.domain = domain
        self.counts = Counts()
        self.owner: Owner = THIS_PROGRAM
        """Set by the space once it is open."""
        guid = ctypes.create_string_buffer(16)
        library.calls.dds_get_guid(entity, guid)
        self.guid = guid.raw
        """By which peers know it."""
        self._library = library
        self._serialiser = serialiser
        self._neighbours = neighbours
        self._others: dict[str, int] = {}
        """Policies that kept a peer away and are not compared here -> how often."""

    def as_endpoint(self) -> OwnEndpoint:
        """It as the peers discover it."""
        return OwnEndpoint(self.owner, self.domain, self.name, self.type_name, self.guid, self.WRITES)

    def troubles(self) -> tuple[str, ...]:
        """Which endpoints in other programs should match it and cannot, and what was lost."""
        found: dict[str, None] = {}
        for other in self._neighbours.on_topic(self.name):
            reason = obstacle(self.type_name, self.qos, other, writes=self.WRITES)
            if reason is not None:
                found[f"{self.name}: {reason}"] = None
        for policy in self._others:
            found[f"{self.name}: {policy}: {self.DIFFERS}"] = None
        if self.counts.lost:
            found[f"{self.name}: {self.counts.lost} {self.LOST}"] = None
        if self.counts.refused:
            found[f"{self.name}: {self.counts.refused} {self.REFUSED}"] = None
        return tuple(found)[:MAX_TROUBLES]

    def _look_for_incompatible(self) -> None:
        """Find out which policies kept a peer away, where the comparison with the neighbours does not tell."""
        calls, incompatible = self._library.calls, Incompatible()
        ask = (
            calls.dds_get_offered_incompatible_qos_status
            if self.WRITES
            else (calls.dds_get_requested_incompatible_qos_status)
        )
        if ask(self.entity, byref(incompatible)) >= 0:
            policy = POLICIES.get(incompatible.policy)
            if incompatible.total and policy is not None and policy not in COMPARED:
                self._others[policy] = incompatible.total
