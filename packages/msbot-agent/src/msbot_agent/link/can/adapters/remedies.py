"""Why a CAN interface of Linux cannot be used, and the commands that change it."""

from __future__ import annotations

import errno
from typing import Final

from msbot_agent.link.can.adapters.interface import CanInterface
from msbot_xrce.lazy import dataclass

ELSEWHERE: Final = (
    "SocketCAN is a part of Linux: on this system use an adapter through python-can, "
    "for example `can:slcan:COM3?bitrate=500000` or `can:pcan:PCAN_USBBUS1?bitrate=500000`"
)
NO_KERNEL_SUPPORT: Final = (
    "this kernel has no SocketCAN (or the module is not loaded: `sudo modprobe can_raw`); "
    "an adapter can be used through python-can all the same, for example `can:slcan:/dev/ttyACM0?bitrate=500000`"
)
USUAL_BITRATE: Final = 500_000
USUAL_DATA_BITRATE: Final = 2_000_000


@dataclass(frozen=True, slots=True)
class Wanted:
    """How an interface is to be used."""

    name: str
    fd: bool = False
    bitrate: int | None = None
    data_bitrate: int | None = None
    """Bits per second as the user gave them; None = accept any."""


def why_not(wanted: Wanted, found: CanInterface | None, others: list[CanInterface]) -> str:
    """Why an interface cannot be used as wanted, with the remedy; empty if it can.

    Args:
        wanted: what the user asked for.
        found: what the kernel says about it; None = there is no such interface.
        others: all CAN interfaces of this machine.
    """
    name = wanted.name
    if found is None:
        return f"there is no interface {name}{_others(others)}: {_how_to_get(wanted)}"
    if not found.is_can:
        return f"{name} is no CAN interface{_others(others)}"
    if not found.is_up:
        return f"the interface {name} is down: {_quoted(up_commands(wanted, found))} brings it up"
    again = _quoted(f"sudo ip link set {name} down && {up_commands(wanted, found)}")
    if wanted.fd and not found.fd:
        words = f"CAN FD is asked for, but the interface {name} takes classic frames only (mtu {found.mtu})"
        return f"{words}: {again} changes that"
    for word, has, wants in (
        ("", found.bitrate, wanted.bitrate),
        ("data ", found.data_bitrate, wanted.data_bitrate),
    ):
        if has is not None and wants is not None and has != wants:
            return f"the interface {name} runs at a {word}bit rate of {has}, the address says {wants}: {again} sets it"
    if found.listen_only:
        return (
            f"the interface {name} only listens: "
            f"`sudo ip link set {name} down && sudo ip link set {name} up type can listen-only off` lets it send"
        )
    return ""


def up_commands(wanted: Wanted, found: CanInterface | None = None) -> str:
    """The commands that bring an interface up as wanted."""
    name = wanted.name
    if _is_virtual(name, found):
        return f"sudo ip link set {name} mtu 72 up"
    rates = f"bitrate {wanted.bitrate or (found and found.bitrate) or USUAL_BITRATE}"
    if wanted.fd:
        rates += f" dbitrate {wanted.data_bitrate or (found and found.data_bitrate) or USUAL_DATA_BITRATE} fd on"
    return f"sudo ip link set {name} up type can {rates}"


def open_error(wanted: Wanted, error: OSError) -> str:
    """Why the socket could not be opened."""
    if error.errno in (errno.EAFNOSUPPORT, errno.EPROTONOSUPPORT, errno.EPERM, errno.EACCES):
        return NO_KERNEL_SUPPORT
    if error.errno == errno.ENODEV:
        return why_not(wanted, None, [])
    return f"cannot use the interface {wanted.name}: {error.strerror or error}"


def restart_advice(name: str, error: OSError) -> str:
    """What to do when the controller could not be restarted after bus-off."""
    if error.errno == errno.EPERM:
        return (
            f"this program may not restart it: `sudo ip link set {name} type can restart` does; `sudo ip link set "
            f"{name} down && sudo ip link set {name} up type can restart-ms 100` lets the kernel do it from now on"
        )
    return f"its driver cannot restart: `sudo ip link set {name} down && sudo ip link set {name} up` does"


def _how_to_get(wanted: Wanted) -> str:
    name = wanted.name
    if _is_virtual(name, None):
        return f"{_quoted(f'sudo ip link add dev {name} type vcan && sudo ip link set {name} mtu 72 up')} makes it"
    return f"plug the adapter in, then {_quoted(up_commands(wanted))} brings it up"


def _is_virtual(name: str, found: CanInterface | None) -> bool:
    return found.kind in ("vcan", "vxcan") if found is not None else name.startswith(("vcan", "vxcan"))


def _others(others: list[CanInterface]) -> str:
    return f" (there are: {', '.join(other.name for other in others)})" if others else ""


def _quoted(commands: str) -> str:
    return f"`{commands}`"
