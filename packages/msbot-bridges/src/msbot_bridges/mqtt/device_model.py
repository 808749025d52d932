"""What a device on a broker is, whichever convention it follows: ports with topics, and how it shows that it lives."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field

from msbot.part import Message
from msbot_bridges.bridge import DeviceIdentity
from msbot_xrce.lazy import dataclass

MOST_PORTS = 24
"""Ports of a device; a description has no room for many more."""


@dataclass(frozen=True, slots=True)
class Order:
    """A message that tells a device something."""

    topic: str
    payload: str


@dataclass(frozen=True, slots=True)
class StatePort:
    """A port at which the device's state goes into the robot."""

    port: str
    message: type[Message]
    topic: str
    read: Callable[[str], Message | None]
    """A payload as a message; None: it says nothing about this."""


@dataclass(frozen=True, slots=True)
class CommandPort:
    """A port at which the robot drives the device."""

    port: str
    message: type[Message]
    safe: Message | None
    orders: Callable[[Message], Sequence[Order]]
    stop: Sequence[Order]
    """What STOP sends."""
    state_topic: str = ""
    """Where the device reports what it does; empty: nowhere."""
    is_safe: Callable[[str], bool | None] = lambda _: None
    """Whether a payload of the state topic says that it has stopped; None: it says nothing about this."""
    safe_words: str = ""
    """What the device reports when it has stopped: `that it is off`."""
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """The least and the greatest value of fields."""


@dataclass(frozen=True, slots=True)
class LifeTopic:
    """A topic that says whether the device is there."""

    topic: str
    read: Callable[[str], bool | None]
    """Whether a payload says that it is there; None: it says nothing about this."""


@dataclass(frozen=True, slots=True)
class DeviceModel:
    """A device, as far as it has declared itself."""

    key: str
    """What distinguishes it from all others of its broker."""
    identity: DeviceIdentity
    readings: Sequence[StatePort] = ()
    commands: Sequence[CommandPort] = ()
    life: Sequence[LifeTopic] = ()
    life_mode: str = "latest"
    """With several life topics: `all` say so, `any` says so, or the `latest` that said something."""
    left_out: Sequence[str] = ()
    """What became no port, each with the reason."""
    declared: Mapping[str, object] = field(default_factory=dict)
    """What all this was made from: a device that declares something else is another one."""


def chosen(
    readings: Sequence[StatePort], commands: Sequence[CommandPort]
) -> tuple[list[StatePort], list[CommandPort], list[str]]:
    """As many ports as there is room for, commands first; and the names of those for which there is none."""
    kept = list(commands[:MOST_PORTS])
    room = MOST_PORTS - len(kept)
    over = [one.port for one in commands[MOST_PORTS:]] + [one.port for one in readings[room:]]
    return list(readings[:room]), kept, [f"{port}: a part has at most {MOST_PORTS} ports" for port in over]


class PortNames:
    """Names of ports made of names that people gave: lower case, digits, `_`; none twice."""

    def __init__(self) -> None:
        self._taken = set[str]()

    def name(self, wish: str, *, otherwise: str = "value") -> str:
        """A free name like `wish`."""
        letters = [one if one.isascii() and one.isalnum() else "_" for one in wish.lower()]
        clean = "_".join(filter(None, "".join(letters).split("_")))[:24].strip("_") or otherwise
        if not clean[0].isalpha():
            clean = f"{otherwise}_{clean}"[:24]
        name, count = clean, 2
        while name in self._taken:
            name, count = f"{clean}_{count}", count + 1
        self._taken.add(name)
        return name
