"""The values of plug-and-play: what a part, a slot, a claim and a change are, and what the inventory asks its store.

A *part* is a thing that is plugged in. A *slot* is a role in the robot; settings, wiring and history belong to it.
The *inventory* knows which part sits in which slot. A `PartStore` keeps types, slots and the journal: the registry in a
master, `MemoryStore` in tests and robots without a database.
"""

from __future__ import annotations

from typing import Protocol

from msbot.config import Described, PartType, Slot
from msbot.part.join.part_log import LogLevel
from msbot.part.join.pnp_messages import Nature
from msbot.part.join.refusal import Refusal
from msbot.pnp.emergency_stop import StopRecord
from msbot.pnp.part_events import PartEvent, PartState
from msbot.service_types import reply_topic, request_topic, service_type
from msbot_agent.text.sentence import said
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

MAX_TEXT = 254
"""Longest part number or local name in characters: the thesis' `char[255]` with its NUL."""


@dataclass(frozen=True, slots=True)
class LifeTiming:
    """The four numbers of thesis 3.12.1.2; the defaults are the thesis' own.

    Raises:
        ConfigError: a value is out of range, or a healthy part would be delisted.
    """

    beat_s: float = 1.0
    """Period of a part's beats, 0.02 to 65 s."""
    tick_s: float = 2.0
    """Period in which every life status is decremented."""
    life: int = 3
    """Life status after registration and after each beat, at least 1."""
    late_after_beats: float = 1.5
    """A part is late, and a contest is decided, after this many beat periods of silence."""

    def __post_init__(self) -> None:
        if not 0.02 <= self.beat_s <= 65.0:
            raise ConfigError(said("beat period {beat_s} s: must be 0.02 to 65 s", beat_s=self.beat_s))
        if not 1 <= self.life <= 255:
            raise ConfigError(said("life status {life}: must be 1 to 255", life=self.life))
        if self.late_after_beats <= 1.0:
            raise ConfigError(
                said(
                    "late after {late_after_beats} beat periods: must be more than 1",
                    late_after_beats=self.late_after_beats,
                )
            )
        if self.shortest_detection_s < self.late_s:
            raise ConfigError(
                said(
                    "life {life} x tick {tick_s} s: a part could be delisted {shortest_detection_s} s after "
                    "a beat, but its next beat may take {late_s} s; use a longer tick or a higher life",
                    life=self.life,
                    tick_s=self.tick_s,
                    shortest_detection_s=self.shortest_detection_s,
                    late_s=self.late_s,
                )
            )

    @property
    def late_s(self) -> float:
        """Silence in seconds after which a part is late."""
        return self.beat_s * self.late_after_beats

    @property
    def shortest_detection_s(self) -> float:
        """Shortest time in seconds from the last beat of a silent part to its delisting."""
        return (self.life - 1) * self.tick_s

    @property
    def longest_detection_s(self) -> float:
        """Longest time in seconds from the last beat of a silent part to its delisting."""
        return self.life * self.tick_s

    @property
    def beat_ms(self) -> int:
        """The beat period in milliseconds, as a verdict carries it."""
        return round(self.beat_s * 1000)


THESIS_TIMING = LifeTiming()
"""Beat 1 s, tick 2 s, life 3: a silent part is delisted after 4 to 6 s."""
FAST_TIMING = LifeTiming(beat_s=0.25, tick_s=0.5, life=3)
"""The `fast` preset: a silent part is delisted after 1.0 to 1.5 s."""


@dataclass(frozen=True, slots=True)
class SlotBinding:
    """One port of a slot and the topic that it is bound to."""

    port: str
    topic: str
    type_name: str
    publishes: bool
    """True: the part writes the topic, or serves there; False: it reads it, or calls."""
    reliable: bool = True

    @property
    def is_service(self) -> bool:
        """Whether it carries requests and replies."""
        return service_type(self.type_name) is not None

    @property
    def messages(self) -> tuple[str, ...]:
        """The types of the messages that it carries: one, or those of request and reply."""
        return service_type(self.type_name) or (self.type_name,)

    def calls_on(self, topic: str) -> bool:
        """Whether the port calls, and its requests go to that topic of the data space."""
        return self.is_service and not self.publishes and request_topic(self.topic) == topic

    def opened(self) -> tuple[tuple[str, bool], ...]:
        """The topics of the data space that `opens` is true of, each with whether the part writes there."""
        if not self.is_service:
            return ((self.topic, self.publishes),)
        requests = (request_topic(self.topic), not self.publishes)
        return (requests, (reply_topic(self.topic), True)) if self.publishes else (requests,)

    def opens(self, topic: str, *, publishes: bool) -> bool:
        """Whether the port makes the part write (or read) a topic of the data space.

        A part that serves reads requests and writes replies. One that calls writes requests; the agent hands it the
        replies to its own, so that it needs no right to read all of them.
        """
        if not self.is_service:
            return topic == self.topic and publishes is self.publishes
        if topic == request_topic(self.topic):
            return publishes is not self.publishes
        return topic == reply_topic(self.topic) and publishes and self.publishes


@dataclass(frozen=True, slots=True)
class Configuration:
    """What a part in a slot is told: its slot, its bindings and its settings."""

    version: int
    """At least 1; a new number after every change."""
    slot: str
    bindings: tuple[SlotBinding, ...] = ()
    settings: tuple[tuple[str, str], ...] = ()
    """Pairs of (name, value as text)."""


@dataclass(frozen=True, slots=True)
class Claim:
    """A part's request to be registered (thesis 3.12.1.1, step 2)."""

    part_number: str
    local_name: str = ""
    uid: bytes = b""
    """8 octets; empty or all zeros when the part has none (the thesis' own programs)."""
    nonce: int = 0
    """Drawn by the part once per start; the same nonce in the same session is a repeated claim."""
    layout: str = "compact"
    """`compact` (leases and beats) or `compat` (every request of 96 octets registers or beats)."""


def identity_of(uid: bytes, client_key: int) -> bytes:
    """Who a part is: its UID; for a part without one, a name made from its session."""
    return uid or b"session" + client_key.to_bytes(4, "big")


@dataclass(frozen=True, slots=True)
class Verdict:
    """The inventory's answer to a claim."""

    lease: int = 0
    """Not 0: the part is registered, and every beat carries this number."""
    configuration_version: int = 0
    refusal: Refusal | None = None
    """Why there is no lease; None with lease 0: not decided yet, no answer is sent."""


@dataclass(frozen=True, slots=True)
class SessionStatus:
    """The present status of the part behind a session, in a few words for the part itself."""

    state: PartState
    lease: int
    """0 = it has none."""
    configuration_version: int


@dataclass(frozen=True, slots=True)
class SelfDescription:
    """What a part says of itself; until somebody adopts it, it counts for nothing."""

    text: str
    """As it was said, at most `plug.MOST_DESCRIPTION` octets."""
    described: Described | None = None
    """The same, checked; None: not checked yet, or refused."""
    fault: str = ""
    """Why it is refused."""


@dataclass(frozen=True, slots=True)
class TypeDifference:
    """A port where the message class of the part's program is not the type of the library."""

    port: str
    type_name: str
    theirs: bytes
    """The hash that the part tells."""
    ours: bytes
    """That of the library."""
    detail: int = 0
    """Place of the first field that differs, from 1; 0: the part has not told its fields yet; 255: not known."""
    their_field: str = ""
    """`uint16 value`; empty: there is none."""
    our_field: str = ""
    their_type: str = ""
    """The type that the part's program has there, if it has another name; empty: it has the same."""


@dataclass(frozen=True, slots=True)
class PartInfo:
    """A part as the inventory shows it."""

    part: str
    part_number: str
    local_name: str
    uid: bytes
    slot: str | None
    """The slot that it holds; if the part is gone, the slot that it held, unless another part holds it now."""
    state: PartState
    reason: str
    """Why it is in that state, in words."""
    state_age_s: float
    life: int
    """Life status: full while the part is active, counted down while it is late, 0 when it is not counted."""
    beat_age_s: float | None
    """Seconds since the last beat or registration; None before the first."""
    beats: int
    plug_in_to_active_ms: float | None
    """Time from the opening of the session (or from when the link noticed the plug) to `active`; None until then."""
    client_key: int
    address: str
    refused_claims: int
    duplicates: tuple[str, ...]
    """Addresses of refused devices with the same UID."""
    refusal: Refusal | None = None
    """Why it has no lease, if it is refused or stands by."""
    nature: Nature = Nature.UNKNOWN
    """What is behind its ports, as the part itself says."""
    hardware: str = ""
    software: str = ""
    """Versions, as the part itself says; empty: it does not."""
    home: str = ""
    """Where it runs, as it says: `PC`, `MicroPython`, `C`, `browser` or `bridge`; empty: it does not."""
    msbot: str = ""
    """The version of MsBOT there."""
    says: SelfDescription | None = None
    """What it says of itself, while the library does not know its part number."""


class PartStore(Protocol):
    """What the inventory needs from the store of types, slots and the journal.

    Every method returns at once: reads are indexed, writes are handed to a writer. Reads may raise `RegistryError`;
    the claim in question is then refused as `NOT_READY`.
    """

    def part_type(self, number: str) -> PartType | None:
        """The library's entry for exactly this part number, or None."""

    def slots(self) -> tuple[Slot, ...]:
        """All slots of the robot; asked at the start and after `Inventory.reload`."""

    def remembered_slot(self, uid: bytes) -> str | None:
        """The name of the slot that this UID was last in, or None."""

    def placed_slot(self, uid: bytes) -> str | None:
        """The name of the slot that a person put this UID into, or None; it overrules the library."""

    def remember(self, uid: bytes, slot: str, claim: Claim) -> None:
        """Note that this UID is now in that slot; an empty UID is not remembered."""

    def configuration(self, slot: str) -> Configuration:
        """The present configuration of a slot; called at registration and after a change, never for a beat."""

    def blocked(self, uid: bytes, number: str) -> str | None:
        """Why this part (or this part number) is blocked, in words, or None."""

    def key_of(self, uid: bytes) -> bytes | None:
        """The key of the part with that UID, or None; called in key mode only."""

    def journal(self, event: PartEvent) -> None:
        """Keep an event; never blocks and never raises."""

    def kept_stop(self) -> StopRecord | None:
        """What was stored about the latest STOP; None: nothing. Called once, when a master starts."""

    def keep_stop(self, record: StopRecord) -> None:
        """Store what must be known about STOP after a restart; never blocks and never raises."""

    def is_kept(self, timeout_s: float) -> bool:
        """Wait until everything handed over so far is stored; False: it could not be. Called in a thread of its own."""


class MemoryStore:
    """A `PartStore` without a database: for tests and robots that need no memory of their parts."""

    def __init__(
        self,
        *,
        types: tuple[PartType, ...] = (),
        slots: tuple[Slot, ...] = (),
        configurations: tuple[Configuration, ...] = (),
    ) -> None:
        self.types = {part_type.number: part_type for part_type in types}
        self.slot_list = list(slots)
        self.configurations = {configuration.slot: configuration for configuration in configurations}
        self.remembered: dict[bytes, str] = {}
        self.placed: dict[bytes, str] = {}
        """UID -> the slot that a person put it into."""
        self.blocks: dict[bytes | str, str] = {}
        """UID or part number -> why it is blocked."""
        self.keys: dict[bytes, bytes] = {}
        """UID -> key."""
        self.events: list[PartEvent] = []
        self.stop: StopRecord | None = None

    def part_type(self, number: str) -> PartType | None:
        """See `PartStore.part_type`."""
        return self.types.get(number)

    def slots(self) -> tuple[Slot, ...]:
        """See `PartStore.slots`."""
        return tuple(self.slot_list)

    def remembered_slot(self, uid: bytes) -> str | None:
        """See `PartStore.remembered_slot`."""
        return self.remembered.get(uid)

    def placed_slot(self, uid: bytes) -> str | None:
        """See `PartStore.placed_slot`."""
        return self.placed.get(uid)

    def remember(self, uid: bytes, slot: str, claim: Claim) -> None:  # noqa: ARG002 - the protocol's signature
        """See `PartStore.remember`."""
        if uid:
            self.remembered[uid] = slot

    def configuration(self, slot: str) -> Configuration:
        """See `PartStore.configuration`; a slot without one gets version 1 with nothing in it."""
        return self.configurations.get(slot) or Configuration(version=1, slot=slot)

    def blocked(self, uid: bytes, number: str) -> str | None:
        """See `PartStore.blocked`."""
        return self.blocks.get(uid) or self.blocks.get(number)

    def key_of(self, uid: bytes) -> bytes | None:
        """See `PartStore.key_of`."""
        return self.keys.get(uid)

    def journal(self, event: PartEvent) -> None:
        """See `PartStore.journal`."""
        self.events.append(event)

    def kept_stop(self) -> StopRecord | None:
        """See `PartStore.kept_stop`."""
        return self.stop

    def keep_stop(self, record: StopRecord) -> None:
        """See `PartStore.keep_stop`."""
        self.stop = record

    def is_kept(self, timeout_s: float) -> bool:  # noqa: ARG002 - the protocol's signature
        """See `PartStore.is_kept`."""
        return True


@dataclass(frozen=True, slots=True)
class ProgramLogLine:
    """A line of a part's program."""

    at: float
    part: str
    """What people call it."""
    slot: str
    level: LogLevel
    words: str
