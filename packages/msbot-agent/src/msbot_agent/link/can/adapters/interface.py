"""What Linux knows about a CAN interface, and how to restart its controller.

One question to the kernel (rtnetlink, RTM_GETLINK) tells whether the interface exists and is up, its bit rates, its
state and whether it supports CAN FD. That needs no privileges; a restart after bus-off needs CAP_NET_ADMIN.
"""

from __future__ import annotations

import contextlib
import errno
import os
import socket
from collections.abc import Iterator
from struct import Struct
from struct import error as StructError
from typing import Final

from msbot_agent.link.can.adapters.error_frames import FD_SIZE
from msbot_agent.link.can.controller import BusState
from msbot_xrce.lazy import dataclass

_HEADER: Final = Struct("=IHHII")
_LINK: Final = Struct("=BxHiII")
_ATTRIBUTE: Final = Struct("=HH")
_WORD: Final = Struct("=I")
_CONTROL: Final = Struct("=II")
_ERRNO: Final = Struct("=i")
_COUNTERS: Final = Struct("=HH")
_TOTALS: Final = Struct("=6I")

_NEWLINK, _GETLINK, _ERROR_MESSAGE = 16, 18, 2
_REQUEST, _ACKNOWLEDGE = 0x01, 0x04
_NAME, _MTU, _LINKINFO, _KIND, _DATA, _STATISTICS = 3, 4, 18, 1, 2, 3
_BITTIMING, _STATE, _CONTROL_MODE, _RESTART_MS, _RESTART, _ERROR_COUNTERS, _DATA_BITTIMING = 1, 4, 5, 6, 7, 8, 9
_NESTED: Final = 0x3FFF
_CAN_TYPE: Final = 280
_UP: Final = 1
_LISTEN_ONLY: Final = 0x02
_STATES: Final = (BusState.ACTIVE, BusState.ACTIVE, BusState.PASSIVE, BusState.OFF)
_ANSWER_SIZE: Final = 32_768
_ANSWER_S: Final = 2.0


@dataclass(frozen=True, slots=True)
class CanTotals:
    """How often something happened since the interface was made (`struct can_device_stats`, linux/can/netlink.h)."""

    bus_errors: int = 0
    """Frames that went wrong; only drivers that report every bus error count them."""
    warnings: int = 0
    """Changes to error-warning."""
    passives: int = 0
    """Changes to error-passive."""
    bus_offs: int = 0
    lost_arbitrations: int = 0
    restarts: int = 0


@dataclass(frozen=True, slots=True)
class CanInterface:
    """A network interface, as far as CAN is concerned."""

    name: str
    index: int
    is_can: bool
    is_up: bool
    mtu: int
    """16: classic frames only; 72 (or more): CAN FD, too."""
    kind: str = ""
    """`can` for hardware (slcan, too), `vcan` and `vxcan` for virtual ones."""
    bitrate: int | None = None
    data_bitrate: int | None = None
    """Bits per second; None = not set, or virtual."""
    state: BusState | None = None
    """None: the driver does not report it."""
    restart_ms: int = 0
    """The kernel's pause before a restart from bus-off; 0 = it never restarts by itself."""
    listen_only: bool = False
    transmit_errors: int | None = None
    receive_errors: int | None = None
    """Error counters of the controller, 0 to 255 (ISO 11898-1 12.1.4); None: the driver does not report them."""
    totals: CanTotals | None = None
    """None: the interface has no controller."""

    @property
    def fd(self) -> bool:
        """Whether CAN FD frames can be sent."""
        return self.mtu >= FD_SIZE


def find_interface(name: str) -> CanInterface | None:
    """What the kernel says about an interface; None when there is none of that name.

    Raises:
        OSError: this is not Linux, or the kernel refuses the question.
    """
    try:
        answer = _ask(_GETLINK, _REQUEST, 0, _attribute(_NAME, name.encode() + b"\0"))
    except OSError as error:
        if error.errno in (errno.ENODEV, errno.EINVAL, errno.ERANGE):
            return None
        raise
    return parse_interface(answer)


def can_interfaces() -> list[CanInterface]:
    """All CAN interfaces of this machine; none where the kernel does not tell."""
    found = []
    with contextlib.suppress(OSError):
        for _, name in socket.if_nameindex():
            interface = find_interface(name)
            if interface is not None and interface.is_can:
                found.append(interface)
    return found


def restart_controller(index: int) -> None:
    """Return to the bus after bus-off, as `ip link set can0 type can restart` does.

    Raises:
        OSError: no permission (EPERM), the driver cannot do it (EOPNOTSUPP), or the controller is not bus-off (EBUSY).
    """
    data = _attribute(_DATA, _attribute(_RESTART, _WORD.pack(1)))
    _ask(_NEWLINK, _REQUEST | _ACKNOWLEDGE, index, _attribute(_LINKINFO, _attribute(_KIND, b"can") + data))


def parse_interface(answer: bytes) -> CanInterface | None:
    """The interface in an RTM_NEWLINK message; None when it is not one."""
    try:
        _, kind, _, _, _ = _HEADER.unpack_from(answer)
        if kind != _NEWLINK:
            return None
        _, link_type, index, flags, _ = _LINK.unpack_from(answer, _HEADER.size)
        attributes = dict(_attributes(answer[_HEADER.size + _LINK.size :]))
        about = dict(_attributes(attributes.get(_LINKINFO, b"")))
        can = dict(_attributes(about.get(_DATA, b""))) if link_type == _CAN_TYPE else {}
        counters = _COUNTERS.unpack_from(can[_ERROR_COUNTERS]) if _ERROR_COUNTERS in can else None
        return CanInterface(
            name=_text(attributes.get(_NAME, b"")),
            index=index,
            is_can=link_type == _CAN_TYPE,
            is_up=bool(flags & _UP),
            mtu=_number(attributes.get(_MTU)) or 0,
            kind=_text(about.get(_KIND, b"")),
            bitrate=_number(can.get(_BITTIMING)) or None,
            data_bitrate=_number(can.get(_DATA_BITTIMING)) or None,
            state=_state(_number(can.get(_STATE))),
            restart_ms=_number(can.get(_RESTART_MS)) or 0,
            listen_only=bool(_CONTROL.unpack_from(can[_CONTROL_MODE])[1] & _LISTEN_ONLY)
            if _CONTROL_MODE in can
            else False,
            transmit_errors=counters[0] if counters else None,
            receive_errors=counters[1] if counters else None,
            totals=_totals(about.get(_STATISTICS)) if link_type == _CAN_TYPE else None,
        )
    except StructError:
        return None


def _ask(kind: int, flags: int, index: int, attributes: bytes) -> bytes:
    if not hasattr(socket, "AF_NETLINK"):
        raise OSError(errno.EAFNOSUPPORT, os.strerror(errno.EAFNOSUPPORT))
    size = _HEADER.size + _LINK.size + len(attributes)
    message = _HEADER.pack(size, kind, flags, 1, 0) + _LINK.pack(0, 0, index, 0, 0) + attributes
    with socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, socket.NETLINK_ROUTE) as route:
        route.settimeout(_ANSWER_S)
        route.send(message)
        answer = route.recv(_ANSWER_SIZE)
    if len(answer) >= _HEADER.size + _ERRNO.size and _HEADER.unpack_from(answer)[1] == _ERROR_MESSAGE:
        number = -_ERRNO.unpack_from(answer, _HEADER.size)[0]
        if number:
            raise OSError(number, os.strerror(number))
    return answer


def _attribute(kind: int, content: bytes) -> bytes:
    padding = -len(content) % 4
    return _ATTRIBUTE.pack(_ATTRIBUTE.size + len(content), kind) + content + bytes(padding)


def _attributes(octets: bytes) -> Iterator[tuple[int, bytes]]:
    at = 0
    while at + _ATTRIBUTE.size <= len(octets):
        size, kind = _ATTRIBUTE.unpack_from(octets, at)
        if size < _ATTRIBUTE.size:
            return
        yield kind & _NESTED, octets[at + _ATTRIBUTE.size : at + size]
        at += size + 3 & ~3


def _number(content: bytes | None) -> int | None:
    if content is None or len(content) < _WORD.size:
        return None
    number: int = _WORD.unpack_from(content)[0]
    return number


def _text(content: bytes) -> str:
    return content.rstrip(b"\0").decode(errors="replace")


def _totals(content: bytes | None) -> CanTotals | None:
    return None if content is None else CanTotals(*_TOTALS.unpack_from(content))


def _state(number: int | None) -> BusState | None:
    return _STATES[number] if number is not None and number < len(_STATES) else None
