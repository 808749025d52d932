"""Which bridges and parts are on one CAN bus, whether they can be, and how busy it will be."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from itertools import combinations
from typing import Final

from msbot_agent.link.can import parse_target
from msbot_agent.link.can.protocol import NODES, CanIds
from msbot_bridges.bridge.can_claim import CanClaim, Identifiers
from msbot_bridges.canbus.bus import is_fd
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

_JOINING: Final = 0xFFFFFF
"""The bits of an identifier of JOIN and ASSIGN that say who and how."""
_ALL_29_BITS: Final = 0x1FFFFFFF
_LEGACY: Final = 0x120, 0x123


@dataclass(frozen=True, slots=True)
class OnBus:
    """Somebody on a bus."""

    who: str
    """`canopen`, or the robot's own parts."""
    address: str
    """As it was written."""
    claim: CanClaim

    @property
    def bus(self) -> tuple[str, str]:
        """Interface of python-can and channel: the same for all who are on one bus."""
        scheme, _, rest = self.address.strip().partition(":")
        if scheme.lower() == "sim":
            return "msbot", rest.partition("?")[0]
        interface, _, channel = self._target.partition(":")
        # One adapter may have several names: /dev/ttyACM0, /dev/serial/by-id/...
        return interface.lower(), os.path.realpath(channel) if channel.startswith("/dev/") else channel

    @property
    def bitrate(self) -> int | None:
        """What the address says of it."""
        pairs = (pair.partition("=") for pair in self.address.partition("?")[2].split("&"))
        return next((int(value) for name, _, value in pairs if name == "bitrate" and value.isdecimal()), None)

    @property
    def fd(self) -> bool:
        """Whether its frames are those of CAN FD."""
        return self.claim.fd or is_fd(self.address)

    @property
    def _target(self) -> str:
        scheme, _, rest = self.address.strip().partition(":")
        if scheme.lower() not in _ROBOT_SCHEMES:
            return self.address.strip().partition("?")[0]
        target = parse_target(rest)
        return f"{target.interface}:{target.channel}"


def robot_on_bus(address: str) -> OnBus | None:
    """The robot's own parts behind a link; None: it is no CAN bus."""
    scheme, colon, _ = address.strip().partition(":")
    identifiers = _ROBOT_SCHEMES.get(scheme.lower()) if colon else None
    if identifiers is None:
        return None
    fd = scheme.lower() == "canfd" or is_fd(address)
    return OnBus("the robot's own parts", address, CanClaim(identifiers, fd=fd))


def check_one_bus(everybody: Iterable[OnBus]) -> None:
    """Refuse a bus on which two disturb each other.

    Raises:
        ConfigError: the text says why, and what would be right.
    """
    everybody = list(everybody)
    for one in everybody:
        if one.bitrate is not None and one.claim.bitrates and one.bitrate not in one.claim.bitrates:
            rates = ", ".join(str(rate) for rate in one.claim.bitrates)
            raise ConfigError(
                f"{one.who} on {one.address}: its devices have no {one.bitrate} bit/s, but one of {rates}"
            )
    for one, other in combinations(everybody, 2):
        if one.bus == other.bus and (why := _disturbance(one, other)):
            raise ConfigError(f"{one.who} on {one.address} and {other.who} on {other.address} are on one bus: {why}")


def _disturbance(one: OnBus, other: OnBus) -> str:
    """Why two cannot share a bus; empty: they can."""
    if one.who == other.who:
        return "one finds all devices; leave one of them out"
    if one.bitrate and other.bitrate and one.bitrate != other.bitrate:
        return f"it cannot have {one.bitrate} and {other.bitrate} bit/s; give both the same bitrate="
    if one.fd != other.fd:
        with_it, without = (one, other) if one.fd else (other, one)
        return f"{without.who} would destroy the CAN FD frames of {with_it.who}; use a bus for each"
    for mine in one.claim.identifiers:
        for yours in other.claim.identifiers:
            if mine.meets(yours):
                return (
                    f"{mine} of {one.who} and {yours} of {other.who} can have the same identifier; "
                    "use a bus for each, with an adapter of its own"
                )
    return ""


def _native() -> Sequence[Identifiers]:
    ids = CanIds()
    return (
        Identifiers("STOP", ids.stop, ids.stop),
        Identifiers("parts to master", ids.up + 1, ids.up + NODES),
        Identifiers("master to parts", ids.down + 1, ids.down + NODES),
        Identifiers("BEACON", ids.beacon, ids.beacon),
        Identifiers("ASSIGN", ids.assign, ids.assign + _JOINING, extended=True),
        Identifiers("JOIN", ids.join, ids.join + _JOINING, extended=True),
    )


_ROBOT_SCHEMES: Final = {
    "can": _native(),
    "sim": _native(),
    "canfd": (Identifiers("clients", 0, _ALL_29_BITS, extended=True),),
    "can-legacy": (Identifiers("the component", *_LEGACY),),
}
"""Links of MsBOT on a CAN bus, and their identifiers."""
