"""Settings of the agent and the limits that keep its memory bounded."""

from __future__ import annotations

from dataclasses import dataclass, fields

from msbot.errors import ConfigError

_MAY_BE_ZERO = ("domain_255", "any_text_is_a_name")

MIN_MTU = 24
"""Smallest message size a client may announce: header 8, submessage header 4 and 12 for the answer inside."""


@dataclass(frozen=True, slots=True)
class AgentSettings:
    """What may be tuned on an agent; the defaults are those of the genuine one where it has any.

    Raises:
        ConfigError: a number is not positive (`domain_255`: negative).
    """

    heartbeat_s: float = 0.2
    """Period of HEARTBEAT while reliable messages are unacknowledged."""
    heartbeat_min_s: float = 0.005
    """The same at least where messages get lost: there the period follows the round trip. Not on shared buses."""
    window: int = 16
    """Unacknowledged messages a reliable stream may have (the bitmap of ACKNACK has 16 bits)."""
    dead_after_s: float = 30.0
    """Silence after which a client is probed, and how long one that the link saw go keeps its objects; `uxr_hl` of the
    client overrides it for that client. Infinite: silent clients stay, those that the link saw go are kept for
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
    """Sessions of clients that the gate does not call settled; beyond, the oldest of them goes."""
    max_unsettled_of_address: int = 2048
    """The same for those of one address: a computer, a serial port, a node of a bus."""
    max_joining: int = 64
    """Clients that may be on their way from their login to being settled at a time; the others are told when to ask
    again, or left to ask again by themselves. Not on links whose rate is bounded by their medium."""
    max_packets_per_s: float = 10_000.0
    """Packets a second of one client, where the gate limits it; what is beyond is not read."""
    max_packets_in_all_per_s: float = 30_000.0
    """The same of all clients together, before those that send most are cut further."""
    max_outside_per_s: float = 4_000.0
    """Packets a second outside of sessions (logins, questions, garbage) that are read, where the gate limits them;
    those of clients with a place in the robot may be as many besides."""
    max_objects: int = 256
    """Objects of one client; more are answered ERR_RESOURCES."""
    max_objects_unsettled: int = 64
    """Objects of one client that the gate does not call settled."""
    max_objects_in_all: int = 200_000
    """Objects of all clients together, the last half for settled ones alone; more are answered ERR_RESOURCES."""
    max_message: int = 262_144
    """Largest submessage in octets that is joined from fragments."""
    max_held_in_all: int = 67_108_864
    """Octets of incomplete messages (pieces, and what came early) that are held for all clients together."""
    max_unacked_in_all: int = 268_435_456
    """Octets of reliable messages that all clients together have not acknowledged; beyond, one message at a time goes
    on each stream."""
    max_burst: int = 1024
    """Best-effort messages of one stream that one turn of the loop may book; the oldest are dropped beyond."""
    max_requests: int = 64
    """Requests of one requester that wait for their reply; the oldest gives way."""
    max_topics: int = 4096
    """Topics that are counted by name; the traffic of more is counted together."""
    default_depth: int = 16
    """Samples kept by a writer or reader that names no depth."""
    max_depth: int = 256
    """Samples kept by a writer or reader that wants all or names a larger depth."""
    any_text_is_a_name: bool = False
    """Whether a reference or XML that is not understood names a topic (the genuine agent's `-m ced`)."""
    domain_255: int = 0
    """Domain of a participant that asks for 255, "the agent's own choice"."""

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if value < 0 or (value == 0 and item.name not in _MAY_BE_ZERO):
                raise ConfigError(f"agent setting {item.name} is {value}: it must be greater than 0")
        if self.window > 16:
            raise ConfigError(f"agent setting window is {self.window}: at most 16, the bits of an ACKNACK")
