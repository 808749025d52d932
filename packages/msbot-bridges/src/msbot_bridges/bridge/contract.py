"""What a world gives to a bridge: devices with ports, settings and an identity of their own.

Everything here is called in the event loop and returns at once. A library that waits for its bus runs in a
`WorldThread`. A device is asked who it is and listened to for that; it is told something only by the methods of
`ForeignDevice`, which the bridge calls once the robot's inventory has registered it.
"""

from __future__ import annotations

import hashlib
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractAsyncContextManager, nullcontext
from dataclasses import field
from typing import Any, Protocol

from msbot.part import Message
from msbot.part.join.pnp_messages import TEXT_OCTETS, UID_OCTETS
from msbot_agent.startup.extensions import extensions
from msbot_bridges.bridge.can_claim import CanClaim
from msbot_xrce.errors import CallError, ConfigError
from msbot_xrce.lazy import dataclass

GROUP = "bridges"
"""The group of entry points: `msbot.bridges`."""
MOST_DEVICES = 120
"""Devices that one bridge makes parts of; further ones are named in the log."""
Value = bool | int | float | str
Report = Callable[[str, Message], None]
"""Called by a device with a port and a message that goes out of it."""

_NO_NAME = re.compile(r"[^\w.+ -]+")


@dataclass(frozen=True, slots=True)
class DeviceIdentity:
    """Who a device says it is."""

    maker: str
    product: str
    unique: bytes
    """What no other device of this maker and product has: a serial number, a chip's number."""
    words: str
    """What it is, for people: `servo of ACME`."""
    where: str = ""
    """Where it is on its bus: `node 12`."""
    hardware: str = ""
    """Version of the hardware; empty: it does not say."""
    software: str = ""
    """Version of the software."""

    @property
    def part_number(self) -> str:
        """`maker:product`, from characters that a part number may have everywhere."""
        number = f"{_clean(self.maker)}:{_clean(self.product)}"
        return number.encode()[:TEXT_OCTETS].decode(errors="ignore")

    @property
    def uid(self) -> bytes:
        """The UID of the part: the same for this device at every bridge, and another one for every other device."""
        text = f"{self.part_number}\0".encode() + self.unique
        return hashlib.sha256(text).digest()[:UID_OCTETS]

    @property
    def description(self) -> str:
        """For the log: what it is, with its versions."""
        versions = [
            f"{what} {version}"
            for what, version in (("hardware", self.hardware), ("software", self.software))
            if version
        ]
        return f"{self.words} ({', '.join(versions)})" if versions else self.words


def _clean(name: str) -> str:
    return _NO_NAME.sub("_", name).strip(" ._") or "unknown"


@dataclass(frozen=True, slots=True)
class DeviceOutput:
    """A port at which the device's reports go into the robot."""

    name: str
    message: type[Message]


@dataclass(frozen=True, slots=True)
class Input:
    """A port at which the robot drives the device."""

    name: str
    message: type[Message]
    safe: Message | None = None
    """The value when nobody is in command; None: it keeps what it has."""
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """The least and the greatest value of fields."""
    stops_by: str = ""
    """What STOP does there instead of the safe value, as that world's manuals name it; empty: nothing else."""


@dataclass(frozen=True, slots=True)
class DeviceSetting:
    """A value that the device keeps, and that its slot sets."""

    name: str
    kind: type[Value]
    default: Value
    least: float | None = None
    most: float | None = None
    unit: str = ""
    choices: Sequence[str] = ()
    """Of a text: the values that there are; none: any."""


@dataclass(frozen=True, slots=True)
class DeviceService:
    """Something that the device can be asked for, at a port that serves."""

    name: str
    request: type[Message]
    reply: type[Message]


class ForeignDevice(ABC):
    """One device of a world; each method returns at once.

    While it lives, its world calls `WorldHost.news` whenever `not_stopped` or `fault` may have changed.
    """

    identity: DeviceIdentity
    is_reset: bool = False
    """It is lost because it has started anew: it no longer does what it was told. Its world sets it."""
    outputs: Sequence[DeviceOutput] = ()
    inputs: Sequence[Input] = ()
    settings: Sequence[DeviceSetting] = ()
    services: Sequence[DeviceService] = ()

    @abstractmethod
    def begin(self, report: Report) -> None:
        """The robot has taken the device in: from now on it may be heard and told.

        Args:
            report: takes what goes out of its ports, in the event loop.
        """

    @abstractmethod
    def end(self) -> None:
        """It is no longer in the robot; it was made safe before, see `leave`."""

    @abstractmethod
    def act(self, port: str, message: Message) -> None:
        """A message has come in at a port."""

    @abstractmethod
    def set(self, name: str, value: Value) -> None:
        """Its slot has this value for a setting; also before `begin`, once for each."""

    def safe_is(self, port: str, message: Message) -> None:
        """STOP comes: this is the safe value that the robot has for a port, by its library or the slot. Obeyed like
        `act`, unless the device's own `stop` makes use of it."""
        self.act(port, message)

    def rests_at(self, port: str, message: Message) -> None:
        """Nobody is in command of a port, and no STOP holds: this is its safe value, as with `safe_is`. Obeyed like
        `act`, unless the device's own `rest` makes use of it."""
        self.act(port, message)

    @abstractmethod
    def stop(self) -> None:
        """Do what is safest for this device. Called again while `not_stopped` says that it is not done."""

    def rest(self) -> None:
        """Nobody is in command, and no STOP holds: a port's partner is gone. Obey the next `act` again.

        The safe values of the ports concerned have come by `rests_at` before. Does what `stop` does, unless told
        otherwise.
        """
        self.stop()

    def leave(self) -> None:
        """The part leaves its robot, or the master is gone: `end` follows, and nobody corrects the device later.

        The safe values of all ports have come by `rests_at` before. Called again while `not_stopped` says that it is
        not done, for a bounded time. It comes without `begin` when a device is found again that was out of reach while
        it was driven. Does what `rest` does, unless told otherwise.
        """
        self.rest()

    @abstractmethod
    def go(self) -> None:
        """STOP is over: obey `act` again."""

    @property
    @abstractmethod
    def not_stopped(self) -> str:
        """Why it is not known to have stopped, as a sentence; empty: the device itself has reported that it has.

        Only what the device has reported since `stop` or `leave` counts. A device that cannot report it never is.
        """

    def serve(self, name: str, request: Message) -> Message:  # noqa: ARG002
        """Somebody asks for one of its services.

        Raises:
            CallError: it is refused; the text says why.
        """
        raise CallError(f"it has no service {name}")

    @property
    def fault(self) -> str:
        """What it says is wrong with it, as a sentence; empty: nothing. With a fault it is no part of its robot."""
        return ""

    @property
    def remark(self) -> str:
        """What the robot's log is to say when it joins, besides its versions; empty: nothing."""
        return ""

    def identify(self) -> None:  # noqa: B027 - few devices can
        """Show a person which one it is, where it can."""


class WorldHost(Protocol):
    """What a world tells its bridge, in the event loop."""

    def found(self, device: ForeignDevice) -> None:
        """A device is there, and everything about it is known. One with the UID of another takes its place."""

    def lost(self, device: ForeignDevice, why: str) -> None:
        """It is gone; `why` is a sentence for people."""

    def explain(self, device: ForeignDevice, why: str) -> None:
        """It was lost, and stays away for another reason than was known then: its robot is told."""

    def news(self, device: ForeignDevice) -> None:
        """It has reported something: whether it has stopped, or a fault."""

    def warn(self, device: ForeignDevice, words: str) -> None:
        """It is in the robot, and something is wrong with it that does not take it out: for the robot's log."""

    def say(self, words: str) -> None:
        """One line for the person who runs the bridge."""


class World(ABC):
    """One network of devices."""

    @abstractmethod
    async def run(self, host: WorldHost) -> None:
        """Find devices until cancelled.

        Raises:
            ConfigError: the network cannot be used; the text says what would be right.
            LinkDown: it cannot be opened, or has ended.
        """

    def left(self, device: ForeignDevice) -> None:  # noqa: B027 - few worlds keep anything
        """The bridge has ended the part of a device: forget what was kept for it unless it was in the inventory."""


@dataclass(frozen=True, slots=True)
class BridgeLink:
    """Where the devices are."""

    address: str
    """As the person wrote it: `socketcan:can0`, `msbot:classroom`."""
    options: Mapping[str, str] = field(default_factory=dict)
    """`--option NAME=VALUE`, by name."""

    def option(self, name: str, otherwise: str = "") -> str:
        """One of the options."""
        return self.options.get(name, otherwise)


class SimulatedDevice(Protocol):
    """A device for those who have none: it runs in a process of its own, with the world's own library."""

    async def run(self) -> None:
        """Run until cancelled."""


class DeviceChange(Protocol):
    """Something that is done to devices once, by a person, while no bridge is there; its methods wait for them."""

    def prepare(self) -> str:
        """Look whether it can be done; returns what the person is to agree to.

        Raises:
            MsbotError: it cannot; nothing has changed.
        """

    def undo(self) -> None:
        """The person does not agree."""

    def carry_out(self, say: Callable[[str], None]) -> None:
        """Do it.

        Raises:
            MsbotError: it was not done; the text says how the devices are now.
        """


@dataclass(frozen=True, slots=True)
class Fit:
    """A standard message, and what of a world fills it."""

    message: str
    reports: Sequence[str]
    """Kinds of devices that send it, in the words of that world."""
    driven: Sequence[str]
    """Kinds of devices that it drives."""


def fits_of(
    reports: Iterable[tuple[type[Message], str]], driven: Iterable[tuple[type[Message], str]]
) -> tuple[Fit, ...]:
    """What a world fills, from its tables of messages and kinds."""
    found: dict[str, tuple[list[str], list[str]]] = {}
    for place, pairs in enumerate((reports, driven)):
        for message, kind in pairs:
            kinds = found.setdefault(message.type_name, ([], []))[place]
            if kind not in kinds:
                kinds.append(kind)
    return tuple(Fit(message, tuple(out), tuple(into)) for message, (out, into) in found.items())


@dataclass(frozen=True, slots=True)
class WorldKind:
    """One kind of world, named by an entry point of the group `msbot.bridges`."""

    words: str
    """One line for `msbot bridge --help`."""
    example: str
    """An address, for help and messages."""
    open: Callable[[BridgeLink], World]
    """Makes a world; raises ConfigError when address or options make no sense. Imports its library here, not before."""
    options: Mapping[str, str] = field(default_factory=dict)
    """The options that it takes, each with what it means."""
    simulated: Mapping[str, Callable[[BridgeLink, Mapping[str, Any]], SimulatedDevice]] = field(default_factory=dict)
    """What can be simulated, by name."""
    fits: Callable[[], Sequence[Fit]] = tuple
    """Which standard messages its devices send, and are driven by; without its library."""
    can: CanClaim | None = None
    """What it takes of a CAN bus; None: its devices are on none."""
    numbers: Mapping[str, str] = field(default_factory=dict)
    """The part number of what can be simulated, by name, where it is always the same: by it a demo knows which slot a
    simulated device is for, so that it can be pulled out and plugged in again."""
    network: Callable[[BridgeLink], AbstractAsyncContextManager[BridgeLink]] | None = None
    """Brings up the network where an address asks for one of MsBOT's own, and gives where it then is."""

    change_bit_rate: Callable[[BridgeLink, int], DeviceChange] | None = None
    """Gives all devices of a bus another bit rate; None: this world cannot."""

    def reached(self, link: BridgeLink) -> AbstractAsyncContextManager[BridgeLink]:
        """Where the network is as long as the block runs; see `network`."""
        return nullcontext(link) if self.network is None else self.network(link)

    def check(self, name: str, link: BridgeLink) -> None:
        """Refuse options that this kind of world does not have.

        Raises:
            ConfigError: one of them is unknown.
        """
        for option in link.options:
            if option not in self.options:
                known = ", ".join(self.options) or "none"
                raise ConfigError(f"--option {option}: a bridge for {name} has no such option; it has {known}")


def worlds() -> dict[str, WorldKind]:
    """All kinds that are installed, by name."""
    return extensions().all(GROUP, WorldKind)
