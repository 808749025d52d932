"""The values a blueprint consists of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from msbot.config.reader import Scalar


@dataclass(frozen=True, slots=True)
class RobotProfile:
    """Who the robot is; what its master publishes in step 1 (thesis 3.12.1)."""

    name: str
    version: str
    serial_number: str
    released: str
    """Release date, as text."""
    manufacturer: str


@dataclass(frozen=True, slots=True)
class Timing:
    """How quickly things are noticed (thesis 3.12.1.2)."""

    preset: str
    """`thesis` or `fast`: where the values come from that the file does not name."""
    beat_period_s: float
    """A part beats that often."""
    tick_period_s: float
    """Every life status is decremented that often."""
    life: int
    """Life status after registration and after each beat; at 0 the part is delisted."""
    profile_period_s: float
    """The profile is repeated that often."""


PRESETS = {
    "thesis": Timing("thesis", beat_period_s=1.0, tick_period_s=2.0, life=3, profile_period_s=5.0),
    "fast": Timing("fast", beat_period_s=0.25, tick_period_s=0.5, life=3, profile_period_s=5.0),
}
"""`thesis`: a silent part is delisted after 4 to 6 s; `fast`: after 1.0 to 1.5 s."""


@dataclass(frozen=True, slots=True)
class Slot:
    """A role in the robot that one part can fill."""

    name: str
    part: str
    """Part number of what fits."""
    local_name: str = ""
    """The part that shows this local name is meant for this slot; empty: the slot's own name counts."""
    description: str = ""
    settings: Mapping[str, Scalar] = field(default_factory=dict)
    """Values for parameters of the part type."""


@dataclass(frozen=True, slots=True)
class Endpoint:
    """A port of a slot."""

    slot: str
    port: str

    def __str__(self) -> str:
        """`SLOT.port`."""
        return f"{self.slot}.{self.port}" if self.port else self.slot


@dataclass(frozen=True, slots=True)
class Binding:
    """A topic: who publishes it and who subscribes to it."""

    topic: str
    type_name: str
    source: Endpoint
    targets: tuple[Endpoint, ...]
    reliable: bool = True
    """False: best effort, the newest sample matters more than each sample."""


@dataclass(frozen=True, slots=True)
class Options:
    """What the robot does otherwise than usual."""

    explain: bool = False
    """Tell a refused part why; off: silence towards strangers (thesis 3.12.1.1)."""
    free_topics: tuple[str, ...] = ()
    """Topics that every client may use without being a part."""
    authentication: str = "open"
    """`open`: a part is let in by what it says (as in the thesis); `key`: it must prove that it knows its key."""


AUTHENTICATIONS = ("open", "key")
"""How a robot may make sure that a part is the one it says it is."""
