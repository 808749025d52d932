"""What was seen of a computer and its robot. Plain values: tests write them down as they like."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field

from msbot.config import Blueprint, Library
from msbot.doctor.finding import Unavailable
from msbot_agent.link.can.adapters import CanInterface, Wanted
from msbot_xrce.lazy import dataclass


@dataclass(frozen=True, slots=True)
class PythonFacts:
    """The interpreter that runs MsBOT."""

    version: tuple[int, int, int]
    is_64_bit: bool
    executable: str
    oldest: tuple[int, int]
    """Oldest version that MsBOT runs with."""
    newest: tuple[int, int]
    """Newest version that MsBOT was tried with."""


@dataclass(frozen=True, slots=True)
class PackageNeed:
    """One package that MsBOT needs for what is wanted."""

    name: str
    wanted: str
    """Versions, as packagers write them: `>=4.4`."""
    extra: str
    """The extra that brings it, with its distribution (`msbot-agent[serial]`); empty: MsBOT always needs it."""
    installed: str | None
    fits: bool
    """Whether the installed version is one of those."""


@dataclass(frozen=True, slots=True)
class Device:
    """A device file of this computer that a robot may use."""

    path: str
    group: str
    """Who may use it, besides root."""
    is_usable: bool


@dataclass(frozen=True, slots=True)
class AccessFacts:
    """Who runs this, and which devices they may use."""

    user: str
    groups: frozenset[str]
    """Of this process."""
    member_of: frozenset[str]
    """As the computer's files say: hold from the next login on."""
    devices: tuple[Device, ...]


@dataclass(frozen=True, slots=True)
class CanFacts:
    """The CAN interfaces."""

    has_socketcan: bool
    interfaces: tuple[CanInterface, ...]
    wanted: tuple[Wanted, ...]
    """What the links name."""


@dataclass(frozen=True, slots=True)
class SerialFacts:
    """Serial ports."""

    there: tuple[str, ...]
    wanted: tuple[str, ...]
    """What the links name."""
    held: Mapping[str, str]
    """Ports that another program has open, and that program."""
    meddlers: tuple[str, ...]
    """Programs that run and write to ports of others."""


@dataclass(frozen=True, slots=True)
class I2cFacts:
    """I2C buses."""

    board: str
    """What the computer says it is; empty: it does not say."""
    buses: tuple[int, ...]
    stuck: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class DdsFacts:
    """The DDS library and its settings."""

    library: str
    """Its path; empty: it cannot be loaded."""
    fault: str
    """Why it cannot be loaded."""
    domain: str
    """ROS_DOMAIN_ID; empty: not set."""
    missing_files: tuple[str, ...]
    """Files that CYCLONEDDS_URI names and that are not there."""


@dataclass(frozen=True, slots=True)
class ZenohFacts:
    """The Zenoh library and the routers."""

    missing: str = ""
    """Why the library cannot be used; empty: it can."""
    certificates: str = ""
    """What is wrong with the files of the certificates."""
    routers: Mapping[str, str] = field(default_factory=dict)
    """Each router, and why no session with it can be opened; empty: one was."""


@dataclass(frozen=True, slots=True)
class NetInterface:
    """A network interface."""

    name: str
    is_up: bool
    multicast: bool
    is_loopback: bool


@dataclass(frozen=True, slots=True)
class FirewallFacts:
    """What a firewall lets in."""

    tool: str
    """`nft`, `iptables`, `ufw`."""
    drops: bool
    """Whether it drops what no rule allows."""
    open_ports: frozenset[tuple[str, int]]
    """`(udp or tcp, port)` that a rule allows."""
    wanted: tuple[tuple[str, int], ...]
    """`(udp or tcp, port)` at which others are to reach the robot."""


@dataclass(frozen=True, slots=True)
class PortUse:
    """A port that the robot wants, and who has it."""

    protocol: str
    host: str
    port: int
    holder: str
    """The program that has it; empty: nobody, `?`: somebody whose name may not be read."""
    pid: int | None
    is_ours: bool
    """Whether a master or agent of this user has it."""


@dataclass(frozen=True, slots=True)
class DatabaseFacts:
    """A robot's database."""

    name: str
    schema: int
    newest_schema: int
    size_mb: float = 0.0
    log_mb: float = 0.0
    """Size of SQLite's log that waits to be taken over."""
    is_locked: bool = False
    """Whether another program keeps everybody from writing."""
    others_may_read: bool = False
    network_drive: str = ""
    """Type of the file system, when it is on another computer."""
    faults: tuple[str, ...] = ()
    """Damage and contradictions in sentences."""
    backups: str = ""
    """Folder in which backups are expected; empty: it is not a file."""
    backup_age_s: float | None = None
    """Age of the newest backup; None: there is none."""
    age_s: float = 0.0
    """How long the robot has been in it."""
    unopened: str = ""
    """Why it cannot be read at all, in a sentence; the rest is unknown then."""


@dataclass(frozen=True, slots=True)
class OddFolder:
    """Something that has the name of the folder for STOP's sockets, and is none that counts."""

    path: str
    is_folder: bool
    owner: str
    """In words; empty: this user."""
    mode: int


@dataclass(frozen=True, slots=True)
class StopFacts:
    """The way of `msbot stop` to the masters of this user."""

    trouble: str
    """Why no folder for the sockets can be had; empty: there is one."""
    odd: tuple[OddFolder, ...]
    own_group: str
    """The STOP group of this program; empty: none, and every master is reached."""
    groups: Mapping[str, str]
    """Robots whose masters run here, and their STOP groups."""


@dataclass(frozen=True, slots=True)
class ClockFacts:
    """The computer's clock."""

    now_s: float
    """Seconds since 1970."""
    built_s: float
    """When this MsBOT was put here: it cannot be earlier than that."""
    is_synchronised: bool | Unavailable
    """Whether a time server sets it."""
    newest_record_s: float | None
    """The newest line of the journal."""


@dataclass(frozen=True, slots=True)
class WrittenFolder:
    """A folder that a robot writes to."""

    what: str
    """`database` or `recordings`."""
    path: str
    free_mb: float
    size_mb: float
    free_files: float
    """Share of the file system's entries that are free, 1 = all."""
    is_writable: bool
    read_only: bool
    """Whether the whole file system is mounted read-only."""


@dataclass(frozen=True, slots=True)
class PartSeen:
    """A part, as the database has it."""

    name: str
    slot: str
    state: str
    reason: str
    uid: str


@dataclass(frozen=True, slots=True)
class RobotFacts:
    """The robot itself."""

    name: str
    is_run: bool
    masters: int
    """Masters of this user that run a robot with this name and serial number."""
    up_s: float
    """How long its master has been running."""
    stopped_by: str
    blueprint: Blueprint
    library: Library
    parts: tuple[PartSeen, ...]
    late: Mapping[str, int]
    """How often each part was late in the last hour, by name."""
    refused: Mapping[str, tuple[str, ...]]
    """Why each part was refused in the last hour, by name: each time, the newest last."""
    blocked: frozenset[str]
    """UIDs of parts that are blocked."""
    keys: frozenset[str]
    """UIDs that have a key."""
    wire_faults: Mapping[str, str]
    """Topics whose wires no longer fit, and why."""
    bus_bitrate: int
    """Bit rate of its CAN bus; 0: it has none, or it is not known."""
    bus_load: float
    """Share of the time that the bus will be busy."""
    not_stored: str
    """Why its changes are not stored; empty: they are."""
    type_differences: tuple[str, ...] = ()
    """Parts whose programs have other messages than the library: a part and what differs, in words."""
    lost_packets: Mapping[str, int] = field(default_factory=dict)
    """Packets that its links had to drop, by reason in words."""
