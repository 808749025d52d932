"""The blueprint of a robot: `robot.toml` as values (thesis 3.12.2).

A blueprint says who the robot is (profile), which roles it has (slots), who talks to whom (bindings) and how quickly
a silent part is noticed (timing). It names no hardware: the registry knows which part is in a slot.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from pathlib import Path

from msbot.config.library.part_types import Port
from msbot_agent.toml.table import Scalar
from msbot_xrce.lazy import dataclass


@dataclass(frozen=True, slots=True)
class RobotProfile:
    """Who the robot is, as its master publishes it in step 1 (thesis 3.12.1)."""

    name: str
    version: str = "1"
    serial_number: str = "1"
    """Together with the name, it identifies the robot."""
    released: str = "-"
    """Release date, as text."""
    manufacturer: str = "-"
    stop_group: str = ""
    """Its STOP group: a STOP for another group does not reach it; empty: none. No part of the profile."""


@dataclass(frozen=True, slots=True)
class Timing:
    """How quickly things are noticed (thesis 3.12.1.2)."""

    preset: str
    """`thesis` or `fast`: the source of values that the file does not give."""
    beat_period_s: float
    """Period of a part's beats."""
    tick_period_s: float
    """Period in which every life status is decremented."""
    life: int
    """Life status after registration and after each beat; at 0 the part is delisted."""
    profile_period_s: float
    """Period in which the profile is repeated."""


PRESETS = {
    "thesis": Timing("thesis", beat_period_s=1.0, tick_period_s=2.0, life=3, profile_period_s=5.0),
    "fast": Timing("fast", beat_period_s=0.25, tick_period_s=0.5, life=3, profile_period_s=5.0),
}
"""`thesis`: a silent part is delisted after 4 to 6 s; `fast`: after 1.0 to 1.5 s."""


@dataclass(frozen=True, slots=True)
class Slot:
    """A role in the robot that one part can fill."""

    name: str
    part_number: str
    """Number of the parts that fit."""
    local_name: str = ""
    """The local name that decides when several slots take the same number; empty: the slot's name."""
    description: str = ""
    settings: Mapping[str, Scalar] = field(default_factory=dict)
    """Values for parameters of the part type."""
    safe: Mapping[str, Mapping[str, Scalar]] = field(default_factory=dict)
    """Port -> fields of its safe value in this slot; the library's holds for other fields and ports."""

    @property
    def wanted_name(self) -> str:
        """The local name that a part shows to ask for exactly this slot."""
        return self.local_name or self.name

    def safe_at(self, port: Port) -> Mapping[str, Scalar]:
        """The safe value of a port of the part in this slot; empty: it has none."""
        return {**(port.safe or {}), **self.safe.get(port.name, {})}


@dataclass(frozen=True, slots=True)
class SlotPort:
    """A port of a slot."""

    slot: str
    port: str

    def __str__(self) -> str:
        """`SLOT.port`."""
        return f"{self.slot}.{self.port}" if self.port else self.slot


NOBODY = SlotPort("", "")
"""No port: the source of a binding to which nobody publishes yet."""


@dataclass(frozen=True, slots=True)
class InDds:
    """How a topic is shared in DDS beyond the robot's own partition; no effect without a DDS data space."""

    export: bool = False
    """The topic is also in the partition without a name, where everybody looks."""
    ros: bool = False
    """ROS 2 nodes see the topic under ROS names and types."""
    ros_type: str = ""
    """For example `std_msgs/msg/Float32`; empty: the usual one for the message type."""
    ros_fields: tuple[tuple[str, str], ...] = ()
    """Pairs of our field and theirs; empty: the usual ones."""
    ros_topic: str = ""
    """Its name in ROS 2, if not its own: in the robot's namespace, or with `/` in front one that robots share."""


@dataclass(frozen=True, slots=True)
class Binding:
    """A topic: who publishes it and who subscribes to it."""

    topic: str
    type_name: str
    source: SlotPort
    """The port that publishes; `NOBODY` as long as there is none."""
    targets: tuple[SlotPort, ...]
    reliable: bool = True
    """False: best effort, the newest sample matters more than each sample."""
    in_dds: InDds = InDds()

    @property
    def ends(self) -> tuple[SlotPort, ...]:
        """Every port that it connects, the publishing one first."""
        return (self.source, *self.targets) if self.source.slot else self.targets


@dataclass(frozen=True, slots=True)
class Options:
    """Options that change the robot's usual behaviour."""

    explain: bool = True
    """Tell a refused part why; off: silence towards strangers (thesis 3.12.1.1), the default of robots with keys."""
    free_topics: tuple[str, ...] = ()
    """Topics that every client may use without being a part."""
    authentication: str = "open"
    """`open`: a part is let in without a proof (as in the thesis); `key`: it must prove that it knows its key;
    `key+data`: also, every sample from it and to it is sealed."""


@dataclass(frozen=True, slots=True)
class RosOptions:
    """How the robot shows itself to ROS 2 beyond its topics; no effect without a DDS data space."""

    urdf: str = ""
    """The file with its description (`robot_description`), relative to the blueprint's folder; empty: none."""
    clock: bool = False
    """Tell the robot's time on the topic `clock`."""
    parameters: str = "set"
    """`set`: ROS 2 nodes may set parameters of slots as a student may; `read`: they may only read them."""
    global_topics: tuple[str, ...] = ()
    """Those of `clock`, `diagnostics` and `robot_description` that have the names that robots share."""


ROS_PARAMETERS = ("set", "read")

AUTHENTICATIONS = ("open", "key", "key+data")
"""The ways in which a robot can authenticate a part."""


@dataclass(frozen=True, slots=True)
class BridgeTable:
    """Devices of another protocol that belong to the robot: what `msbot bridge` is told."""

    world: str
    """The protocol, by the name of its extension."""
    link: str
    """Where the devices are."""
    options: Mapping[str, str] = field(default_factory=dict)
    simulate: tuple[str, ...] = ()
    """Simulated devices that are started there, each in a process of its own; `drive node=7` has options."""


@dataclass(frozen=True, slots=True)
class Blueprint:
    """Everything that `robot.toml` says, checked against the library."""

    robot: RobotProfile
    slots: tuple[Slot, ...]
    bindings: tuple[Binding, ...] = ()
    timing: Timing = field(default_factory=lambda: PRESETS["thesis"])
    options: Options = field(default_factory=Options)
    library: tuple[str, ...] = ()
    """Folders (or single files) with more part types, as they are written; relative to the blueprint's own folder."""
    source: Path | None = None
    """The file it was read from."""
    ros: RosOptions = field(default_factory=RosOptions)
    bridges: tuple[BridgeTable, ...] = ()

    def slot(self, name: str) -> Slot | None:
        """The slot of that name."""
        return next((slot for slot in self.slots if slot.name == name), None)

    def topics(self) -> Mapping[str, str]:
        """Every bound topic and its message type, in the order of the file."""
        return {binding.topic: binding.type_name for binding in self.bindings}
