"""Settings of the agent and the limits that keep its memory bounded."""

from __future__ import annotations

from dataclasses import fields

from msbot_agent.link import LinkInfo
from msbot_xrce import AgentSessionSettings
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

_MAY_BE_ZERO = ("domain_255", "any_text_is_a_name", "packs")

MIN_MTU = 24
"""Smallest message size a client may announce: header 8, submessage header 4 and 12 for the answer inside."""

MOST_OBJECTS = 8 * 4096
"""Objects that a client can name: there are eight kinds, and 12 bits of an id number those of each kind."""


@dataclass(frozen=True, slots=True)
class AgentSettings:
    """The settings of an agent; the defaults are those of the genuine one where it has the same setting.

    Raises:
        ConfigError: a number is not positive (`domain_255`: negative).
    """

    heartbeat_s: float = 0.2
    """Period of HEARTBEAT while reliable messages are unacknowledged."""
    heartbeat_min_s: float = 0.001
    """The shortest such period where messages get lost: there it follows the round trip. Not on shared buses."""
    window: int = 16
    """Unacknowledged messages a reliable stream may have (the bitmap of ACKNACK has 16 bits)."""
    packs: bool = True
    """Whether samples and statuses for one client that are booked in one turn share messages, up to its MTU; only on
    links whose medium does not bound their rate. False: one in each, for clients whose buffers hold less than the MTU
    that they announce."""
    dead_after_s: float = 30.0
    """Silence after which a client is probed; also how long a client keeps its objects after its link has seen it go. A
    client's `uxr_hl` overrides it. Infinite: silent clients stay, and those that the link saw go are kept for
    `gone_after_s`."""
    gone_after_s: float = 30.0
    """How long a client that the link saw go keeps its objects where `dead_after_s` is infinite."""
    unsettled_dead_after_s: float = 30.0
    """The longest silence of a client that the gate does not call settled, whatever its `uxr_hl` says."""
    probe_period_s: float = 0.2
    """Time between two probes of a silent client."""
    probes: int = 3
    """Unanswered probes after which a client is gone."""
    max_clients: int = 10_000
    """Sessions at once; more are answered ERR_RESOURCES."""
    max_unsettled: int = 4096
    """Sessions of clients that the gate does not call settled; beyond, the oldest of them is ended."""
    max_unsettled_of_address: int = 2048
    """The same for the clients of one address: a computer, a serial port, a node of a bus."""
    max_joining: int = 64
    """Clients that may be joining (logged in, but not settled) at a time; the others are told when to ask again, or
    left to ask again by themselves. Does not apply to links whose medium bounds their rate."""
    max_packets_per_s: float = 10_000.0
    """Packets a second from one client, where the gate limits it; any beyond are thrown away."""
    max_packets_in_all_per_s: float = 30_000.0
    """The same for all clients together, before those that send most are limited further."""
    max_outside_per_s: float = 10_000.0
    """Packets a second outside sessions (logins, questions, garbage) that are read, where the gate limits them; clients
    with a place in the robot may send as many in addition."""
    max_objects: int = 4096
    """Objects of one client; more are answered ERR_RESOURCES."""
    max_objects_unsettled: int = 64
    """Objects of one client that the gate does not call settled."""
    max_objects_in_all: int = 200_000
    """Objects of all clients together, the last half for settled ones alone; more are answered ERR_RESOURCES."""
    max_message: int = 262_144
    """Largest submessage in octets that is joined from fragments."""
    max_held_in_all: int = 67_108_864
    """Octets of incomplete messages (pieces, and early messages) held for all clients together."""
    max_unacked_in_all: int = 268_435_456
    """Octets of reliable messages that all clients together have not acknowledged; beyond, each stream sends one
    message at a time."""
    max_burst: int = 1024
    """Best-effort messages of one stream that one turn of the loop may book; beyond, the oldest are dropped."""
    max_requests: int = 64
    """Requests of one requester that may wait for their reply; beyond, the oldest is given up."""
    max_topics: int = 4096
    """Topics whose traffic is counted by name; that of any further ones is counted together."""
    default_depth: int = 16
    """Samples kept by a writer or reader that names no depth."""
    max_depth: int = 256
    """Samples kept by a writer or reader that wants to keep all or names a larger depth."""
    any_text_is_a_name: bool = False
    """Whether a reference or XML that is not understood is taken as the name of a topic (the genuine agent's `-m
    ced`)."""
    domain_255: int = 0
    """Domain of a participant that asks for 255, "the agent's own choice"."""

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if value < 0 or (value == 0 and item.name not in _MAY_BE_ZERO):
                raise ConfigError(f"agent setting {item.name} is {value}: it must be greater than 0")
        if self.window > 16:
            raise ConfigError(f"agent setting window is {self.window}: at most 16, the bits of an ACKNACK")


# What the agent's settings mean for one session.


def session_settings(settings: AgentSettings, link: LinkInfo, *, is_stock: bool) -> AgentSessionSettings:
    """The settings of sessions on such a link.

    `is_stock`: the client may be a stock one, as it has not said at its login that it is one of ours.
    """
    is_fast = link.bits_per_second is None  # all messages leave at once
    return AgentSessionSettings(
        window=settings.window,
        heartbeat_s=settings.heartbeat_s,
        # On a bus, silence means that others go first, hardly ever a loss; asking more often would make it worse.
        heartbeat_min_s=settings.heartbeat_s if link.shared_bus else settings.heartbeat_min_s,
        max_message=settings.max_message,
        queue_limit=settings.max_burst,
        packs=settings.packs and is_fast,
        peer_is_stock=is_stock,
        may_reorder=not link.keeps_order,
        sparse_acknacks=link.sparse_acknacks and not is_stock,
    )
