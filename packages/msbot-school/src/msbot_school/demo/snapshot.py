"""What the demo shows of its robot at one moment: plain values, for tables, lines and JSON."""

from __future__ import annotations

from msbot_xrce.common.lazy_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class DemoEvent:
    """One change of a part's state."""

    at_s: float
    """Seconds since the start of the robot."""
    part: str
    """The part's name in the demo; before it has claimed, its name on the wire."""
    from_state: str
    to_state: str
    reason: str
    slot: str = ""
    """The slot that it holds, or has lost by this change."""


@dataclass(frozen=True, slots=True)
class PartSnapshot:
    """One part as the demo shows it."""

    name: str
    part_number: str
    slot: str
    state: str
    plugged: bool
    life: int
    beat_age_s: float | None
    beats: int
    messages_in: int
    messages_out: int
    plug_in_to_active_ms: float | None
    """Time from when it was last plugged in to `active`; None until then."""
    outputs: tuple[bool, ...]
    """Levels of the part's GPIO board; empty without one."""


@dataclass(frozen=True, slots=True)
class TopicSnapshot:
    """The traffic of one topic since all its parts were active for the first time."""

    name: str
    published: int
    """Samples that a part wrote and the agent accepted."""
    delivered: int
    """Samples that arrived in the parts that read the topic."""


@dataclass(frozen=True, slots=True)
class BusSnapshot:
    """The simulated bus since the start."""

    bitrate: int
    frames: int
    bits: int
    load_percent: float
    """Mean over the whole run."""
    load_now_percent: float
    """Over the last second."""
    errors: int


@dataclass(frozen=True, slots=True)
class DemoSnapshot:
    """The whole robot at one moment."""

    robot: str
    link: str
    at_s: float
    parts: tuple[PartSnapshot, ...]
    topics: tuple[TopicSnapshot, ...]
    bus: BusSnapshot | None
