"""CAN buses as people write them: `can:can0?bitrate=500000&fd=1`, `can:slcan:/dev/ttyACM0?bitrate=500000`.

What follows `can:` is an interface of Linux (SocketCAN), or an interface of python-can and its channel. `canfd:` and
`can-legacy:` take the same, and use the framing of eProsima's CAN FD and of the thesis' firmware.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from dataclasses import field
from random import Random, SystemRandom
from typing import Final
from zlib import crc32

from msbot_agent.link.can.adapters.can_driver import CanDriver
from msbot_agent.link.can.adapters.interface import CanInterface, find_interface
from msbot_agent.link.can.adapters.python_can import PythonCanAdapter, Value
from msbot_agent.link.can.adapters.remedies import Wanted
from msbot_agent.link.can.adapters.socketcan import SocketCanAdapter
from msbot_agent.link.can.controller import CanBusInfo
from msbot_agent.link.can.eprosima_fd import IDENTIFIERS, CanFdEprosimaLink
from msbot_agent.link.can.filters import IdFilter, eprosima_filters, legacy_filters, master_filters, part_filters
from msbot_agent.link.can.legacy_link import CanLegacyLink, Codec
from msbot_agent.link.can.native_link import CanMasterLink, CanPartLink
from msbot_agent.link.can.protocol.ids import UID_SIZE, CanIds, NodeIds
from msbot_agent.link.can.protocol.legacy_frames import DOWN, UP
from msbot_agent.link.contract import Link
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

CAN_EXAMPLE: Final = "can:can0?bitrate=500000"
CANFD_EXAMPLE: Final = "canfd:can0"
LEGACY_EXAMPLE: Final = "can-legacy:can0?bitrate=500000"

_SOCKETCAN: Final = "socketcan"
_OURS: Final = ("bitrate", "dbitrate", "fd")
_TRUE_WORDS: Final = {"true": True, "false": False}


@dataclass(frozen=True, slots=True)
class CanSettings:
    """What a link on a CAN bus needs from the rooms above; other kinds of link need none of it."""

    codec: Codec | None = None
    """Header compression, used unless the address says `compression=0`; None = none."""
    is_whole: Callable[[bytes], bool] | None = None
    """Whether octets are one whole message; the legacy framing cannot tell."""
    uid: bytes | None = None
    """Identity of a part, 8 bytes; None = a new one each time."""
    profile_hash: int = 0
    """CRC-32 of the robot's name, version and serial number, for the beacon of a master."""
    node_ids: Callable[[str], NodeIds] | None = None
    """Where a master remembers the addresses on the link of that name; None = in memory."""
    random: Random = field(default_factory=SystemRandom)
    """Source of the epoch, and of the jitter between attempts to join."""


@dataclass(frozen=True, slots=True)
class CanTarget:
    """A bus that an address names."""

    interface: str
    """`socketcan`, or an interface of python-can."""
    channel: str
    bitrate: int | None = None
    data_bitrate: int | None = None
    fd: bool | None = None
    """None: the address does not say."""
    others: dict[str, str] = field(default_factory=dict)
    """Further options, as written in the address."""


def open_can_bus(address: str, *, filters: Sequence[IdFilter] | None = None, error_frames: bool = False) -> CanDriver:
    """The controller of an address such as `can:can0?bitrate=500000`, for tools that work with frames.

    Args:
        address: as for `open_link`.
        filters: which frames to receive; None = all.
        error_frames: hand the controller's reports over as frames, too.

    Raises:
        ConfigError: the address makes no sense; the text shows a right one.
    """
    scheme, _, rest = address.strip().partition(":")
    if scheme.lower() != "can":
        raise ConfigError(f"{address!r} is no CAN bus: write it like `{CAN_EXAMPLE}`")
    try:
        target = parse_target(rest)
        return _driver(target, "can", filters, others=target.others, fd_by_interface=True, error_frames=error_frames)
    except ConfigError as error:
        raise ConfigError(f"{address!r}: {error}; write it like `{CAN_EXAMPLE}`") from error


def open_can(rest: str, serve: bool, settings: CanSettings) -> Link:
    """The native CAN link (`can:`).

    Raises:
        ConfigError: the address makes no sense.
    """
    target = parse_target(rest)
    others = dict(target.others)
    codec = settings.codec if flag(others, "compression", default=True) else None
    ids = CanIds()
    filters = master_filters(ids) if serve else part_filters(ids)
    bus = _driver(target, "can", filters, others=others, fd_by_interface=not serve)
    return native_link(bus, serve, settings, codec, ids)


def native_link(
    bus: CanDriver, serve: bool, settings: CanSettings, codec: Codec | None, ids: CanIds
) -> CanMasterLink | CanPartLink:
    """The link of a master (`serve`) or a part on a controller."""
    if serve:
        node_ids = None if settings.node_ids is None else settings.node_ids(bus.info.name)
        link: CanMasterLink | CanPartLink = CanMasterLink(
            bus,
            profile_hash=settings.profile_hash,
            random=settings.random,
            node_ids=node_ids,
            fd=bus.info.fd,
            codec=codec,
            ids=ids,
        )
    else:
        uid = settings.uid or settings.random.randbytes(UID_SIZE)
        link = CanPartLink(bus, uid=uid, random=settings.random, codec=codec, ids=ids)
    bus.dropped = link.counters.dropped
    return link


def open_canfd(rest: str, serve: bool, settings: CanSettings) -> Link:
    """eProsima's CAN FD (`canfd:`); the client's side takes the option `id`.

    Raises:
        ConfigError: the address makes no sense.
    """
    target = parse_target(rest)
    others = dict(target.others)
    if target.fd is False:
        raise ConfigError("this framing needs CAN FD, so fd=0 cannot be")
    can_id = None if serve else _identifier(others.pop("id", None), settings)
    bus = _driver(target, "canfd", eprosima_filters(CanIds(), can_id), others=others, fd=True)
    link = CanFdEprosimaLink(bus, can_id=can_id)
    bus.dropped = link.counters.dropped
    return link


def open_can_legacy(rest: str, serve: bool, settings: CanSettings) -> Link:
    """The framing of the thesis' firmware (`can-legacy:`).

    Raises:
        ConfigError: the address makes no sense, or there is no way to tell where a message ends.
    """
    if settings.is_whole is None:
        raise ConfigError("this framing does not tell where a message ends: give `is_whole` in CanSettings")
    target = parse_target(rest)
    if target.fd:
        raise ConfigError("this framing is one of classic CAN, so fd=1 cannot be")
    filters = legacy_filters(CanIds(), UP if serve else DOWN)
    bus = _driver(target, "can-legacy", filters, others=target.others, fd=False)
    link = CanLegacyLink(bus, is_whole=settings.is_whole, component=not serve)
    bus.dropped = link.counters.dropped
    return link


def parse_target(rest: str) -> CanTarget:
    """What follows the scheme: `can0?bitrate=500000&fd=1` or `slcan:/dev/ttyACM0?bitrate=500000`.

    Raises:
        ConfigError: it names no bus, or an option makes no sense.
    """
    path, _, query = rest.partition("?")
    interface, colon, channel = path.partition(":")
    if not colon:
        interface, channel = _SOCKETCAN, path
    if not interface or not channel:
        raise ConfigError("it needs an interface of Linux, or an interface of python-can and its channel")
    options: dict[str, str] = {}
    for item in filter(None, query.split("&")):
        name, equals, value = item.partition("=")
        if not equals or not name or not value:
            raise ConfigError(f"option {item!r} is not of the form name=value")
        options[name] = value
    others = {name: value for name, value in options.items() if name not in _OURS}
    return CanTarget(
        interface.lower(),
        channel,
        bitrate=rate(options, "bitrate", 1_000_000),
        data_bitrate=rate(options, "dbitrate", 8_000_000),
        fd=flag(options, "fd", default=False) if "fd" in options else None,
        others=others,
    )


def _driver(
    target: CanTarget,
    scheme: str,
    filters: Sequence[IdFilter] | None,
    *,
    others: dict[str, str],
    fd: bool | None = None,
    fd_by_interface: bool = False,
    error_frames: bool = False,
) -> CanDriver:
    fd = target.fd if fd is None else fd
    if target.interface != _SOCKETCAN:
        fd = bool(fd)
        fast = target.data_bitrate if fd else None
        info = CanBusInfo(f"{scheme}:{target.interface}:{target.channel}", target.bitrate, fast, fd)
        settings = {name: _value(value) for name, value in others.items()}
        adapter = PythonCanAdapter(target.interface, target.channel, info, settings, error_frames=error_frames)
        return CanDriver(adapter)
    if others:
        raise ConfigError(f"there is no option {next(iter(others))!r}; there are {', '.join(_OURS)}, compression")
    found = _look(target.channel)
    if fd is None:
        fd = fd_by_interface and found is not None and found.fd
    wanted = Wanted(target.channel, fd, target.bitrate, target.data_bitrate if fd else None)
    slow = target.bitrate or (None if found is None else found.bitrate)
    fast = target.data_bitrate or (None if found is None else found.data_bitrate)
    info = CanBusInfo(f"{scheme}:{target.channel}", slow, fast if fd else None, fd)
    return CanDriver(SocketCanAdapter(wanted, info, filters=filters, error_frames=error_frames))


def _look(name: str) -> CanInterface | None:
    with contextlib.suppress(OSError):
        return find_interface(name)
    return None


def flag(options: dict[str, str], name: str, *, default: bool) -> bool:
    """Remove and return an option that is 0 or 1.

    Raises:
        ConfigError: it is something else.
    """
    value = options.pop(name, None)
    if value is None:
        return default
    if value not in ("0", "1"):
        raise ConfigError(f"option {name} is {value!r}: 1 means yes, 0 no")
    return value == "1"


def rate(options: dict[str, str], name: str, most: int) -> int | None:
    """Remove and return a bit rate from the options; None = it is not there.

    Raises:
        ConfigError: it is not a bit rate that CAN allows.
    """
    value = options.get(name)
    if value is None:
        return None
    if not (value.isascii() and value.isdigit() and 5_000 <= int(value) <= most):
        raise ConfigError(f"option {name} is {value!r}: a bit rate from 5000 to {most} is needed, for example 500000")
    return int(value)


def _identifier(value: str | None, settings: CanSettings) -> int:
    if value is None:
        return crc32(settings.uid or settings.random.randbytes(UID_SIZE)) % IDENTIFIERS
    try:
        return int(value, 0)
    except ValueError as error:
        raise ConfigError(f"option id is {value!r}: an identifier such as 0xAB1 is needed") from error


def _value(text: str) -> Value:
    """A value for python-can: numbers and booleans as such, everything else as text."""
    if text.lower() in _TRUE_WORDS:
        return _TRUE_WORDS[text.lower()]
    for kind in (lambda: int(text, 0), lambda: float(text)):
        with contextlib.suppress(ValueError):
            return kind()
    return text
