"""What a device on a broker is, whichever convention it follows: ports with topics, and how it shows that it lives."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field, replace

from msbot.part import Message
from msbot.part.messages.leaves import leaves_of
from msbot_bridges.bridge import DeviceIdentity, DeviceSetting, Value
from msbot_xrce.lazy import dataclass

MOST_PORTS = 24
"""Ports of a device; a description has no room for many more."""
MOST_SETTINGS = 24
_NEAR = 0.005


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

    def stopping_at(self, safe: Message, readings: Sequence[StatePort]) -> CommandPort:
        """The same port, where STOP has another value than the device's own.

        Args:
            safe: that value.
            readings: of its device; one of them says what this port does.
        """
        reading = next(
            (one for one in readings if one.message is self.message and one.port.startswith(f"{self.port}_state")), None
        )

        def is_safe(payload: str) -> bool | None:
            told = None if reading is None else reading.read(payload)
            return None if told is None else self._are_alike(told, safe)

        told = ", ".join(f"{name} {value}" for name, value in leaves_of(safe).items())
        return replace(
            self,
            safe=safe,
            stop=self.orders(safe),
            state_topic="" if reading is None else reading.topic,
            is_safe=is_safe,
            safe_words=f"the value {told}",
        )

    def _are_alike(self, one: Message, other: Message) -> bool:
        """As exactly as devices report: to half a hundredth of the range."""
        right = leaves_of(other)
        for name, value in leaves_of(one).items():
            wanted = right[name]
            if isinstance(value, bool | str) or isinstance(wanted, bool | str):
                if value != wanted:
                    return False
                continue
            least, most = self.ranges.get(name, (0.0, abs(wanted)))
            if not abs(value - wanted) <= max(_NEAR * (most - least), 1e-6):
                return False
        return True


@dataclass(frozen=True, slots=True)
class SettingTopic:
    """A value that the device keeps, and that its slot sets."""

    setting: DeviceSetting
    """Its default is what the device has when it is found."""
    orders: Callable[[Value], Sequence[Order]]
    topic: str
    """Where it reports the value."""
    read: Callable[[str], Value | None]
    """A payload as a value; None: it says nothing about this."""


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
    settings: Sequence[SettingTopic] = ()
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


def chosen_settings(settings: Sequence[SettingTopic]) -> tuple[list[SettingTopic], list[str]]:
    """As many settings as there is room for, and the names of the others."""
    over = [f"{one.setting.name}: a part has at most {MOST_SETTINGS} settings" for one in settings[MOST_SETTINGS:]]
    return list(settings[:MOST_SETTINGS]), over


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
