"""Which network DDS uses, as a configuration for Cyclone.

If CYCLONEDDS_URI is set, it alone decides. Otherwise Cyclone chooses the interface itself, unless the computer has no
network. In that case programs on it find each other over the loopback interface: by multicast where the other side
supports it, else by trying the usual ports (this found every peer that was tested, whatever its own settings).
"""

from __future__ import annotations

import os
import re
import socket
import struct
import sys
from collections.abc import Iterable
from pathlib import Path

from msbot_agent.space.network_options import MAX_DOMAIN
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

MAX_PARTICIPANTS = 60
"""How many participants on one computer can find each other without multicast."""

LOOPBACK = "lo"

_PEERS = (
    "<Discovery><ParticipantIndex>auto</ParticipantIndex>"
    f"<MaxAutoParticipantIndex>{MAX_PARTICIPANTS}</MaxAutoParticipantIndex>"
    '<Peers><Peer Address="localhost"/></Peers></Discovery>'
)

_INTERFACE = re.compile(r"""<NetworkInterface(?:Address>\s*|[^>]*?\b(?:name|address)\s*=\s*["'])([^"'<\s]+)""")
_PEER = re.compile(r"""<Peer\b[^>]*?\bAddress\s*=\s*["']([^"':]+)""", re.IGNORECASE)

_UP, _IS_LOOPBACK, _MULTICAST = 0x1, 0x8, 0x1000
_SIOCGIFFLAGS, _SIOCGIFADDR = 0x8913, 0x8915


@dataclass(frozen=True, slots=True)
class NetworkInterface:
    """A network interface of this computer."""

    name: str
    is_up: bool
    is_loopback: bool
    multicast: bool
    address: str = ""
    """Its IPv4 address; empty: it has none."""

    @property
    def has_address(self) -> bool:
        """Whether it has one."""
        return bool(self.address)


@dataclass(frozen=True, slots=True)
class Network:
    """The network configuration for DDS, and its description for people."""

    config: str | None
    """In Cyclone's XML; None leaves it to Cyclone and its environment variable."""
    words: str
    addresses: tuple[str, ...] = ("127.0.0.1",)
    """Addresses of this computer on it."""
    is_local: bool = False
    """Whether only this computer is on it."""
    peers: tuple[str, ...] = ()
    """Computers that are told by address."""


def choose(interface: str | None = None, interfaces: Iterable[NetworkInterface] | None = None) -> Network:
    """The network for DDS.

    Args:
        interface: the one to use; if absent, whichever there is.
        interfaces: the computer's interfaces; looked up if absent.

    Raises:
        ConfigError: there is no interface of that name, or it is down.
    """
    uri = os.environ.get("CYCLONEDDS_URI")
    if uri:
        return _as_cyclone_is_told(uri)
    known = {one.name: one for one in (find_interfaces() if interfaces is None else interfaces)}
    if interface is not None:
        return _named(interface, known)
    usable = [one for one in known.values() if one.is_up and one.has_address and not one.is_loopback]
    if not usable and known:
        words = "this computer only: it has no network"
        return Network(_config(LOOPBACK, peers=True), words, is_local=True)
    addresses = tuple(one.address for one in usable) or (_usual_address(),)
    if known and not any(one.multicast for one in usable):
        names = ", ".join(one.name for one in usable)
        return Network(
            None,
            f"{names}, without multicast: peers elsewhere are found only if CYCLONEDDS_URI names them",
            addresses,
        )
    return Network(None, "the network", addresses)


def _as_cyclone_is_told(uri: str) -> Network:
    """What CYCLONEDDS_URI says of interfaces and peers, as far as the participant of the services follows it."""
    text = uri
    if "<" not in uri:
        path = Path(uri.split(",", maxsplit=1)[0].removeprefix("file://"))
        text = path.read_text(errors="replace") if path.is_file() else ""
    interfaces = find_interfaces()
    wanted = set(_INTERFACE.findall(text))
    usable = [one for one in interfaces if one.is_up and one.has_address]
    chosen = [one for one in usable if {one.name, one.address} & wanted] or [
        one for one in usable if not one.is_loopback
    ]
    addresses = tuple(one.address for one in chosen) or (_usual_address() if not interfaces else "127.0.0.1",)
    is_local = all(address.startswith("127.") for address in addresses)
    peers = tuple(peer for peer in _PEER.findall(text) if _is_address(peer))
    return Network(None, "as CYCLONEDDS_URI says", addresses, is_local, peers)


def _usual_address() -> str:
    """The address from which this computer reaches others, where the system lists no interfaces."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("239.255.0.1", 7400))
        except OSError:
            return "127.0.0.1"
        return str(probe.getsockname()[0])


def _is_address(text: str) -> bool:
    try:
        socket.inet_aton(text)
    except OSError:
        return False
    return text.count(".") == 3


def _named(name: str, known: dict[str, NetworkInterface]) -> Network:
    found = known.get(name)
    if found is None:
        raise ConfigError(f"DDS: there is no network interface {name!r}; there are {', '.join(sorted(known))}")
    if not found.is_up or not found.has_address:
        raise ConfigError(f"DDS: the network interface {name} is down or has no IPv4 address: `ip addr show {name}`")
    where = "this computer only" if found.is_loopback else name
    return Network(_config(name, peers=found.is_loopback), where, (found.address,), found.is_loopback)


def _config(name: str, *, peers: bool) -> str:
    multicast = ' multicast="true"' if peers else ""
    interfaces = f'<General><Interfaces><NetworkInterface name="{name}"{multicast}/></Interfaces></General>'
    return interfaces + (_PEERS if peers else "")


def check_domain(domain: int) -> None:
    """Make sure that a domain exists.

    Raises:
        ConfigError: there are no ports for it.
    """
    if not 0 <= domain <= MAX_DOMAIN:
        raise ConfigError(f"DDS domain {domain}: domains go from 0 to {MAX_DOMAIN}, more have no UDP ports")


def find_interfaces() -> list[NetworkInterface]:
    """The interfaces of this computer; none where the system does not tell (not Linux)."""
    if not sys.platform.startswith("linux"):
        return []
    found = []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        for _, name in socket.if_nameindex():
            answer = _ask(probe, _SIOCGIFFLAGS, name)
            if answer is None:
                continue  # it has just disappeared
            flags: int = struct.unpack_from("H", answer, 16)[0]
            found.append(
                NetworkInterface(
                    name,
                    is_up=bool(flags & _UP),
                    is_loopback=bool(flags & _IS_LOOPBACK),
                    multicast=bool(flags & _MULTICAST),
                    address=_address(_ask(probe, _SIOCGIFADDR, name)),
                )
            )
    return found


def _address(answer: bytes | None) -> str:
    return "" if answer is None else socket.inet_ntoa(answer[20:24])


def _ask(probe: socket.socket, what: int, name: str) -> bytes | None:
    import fcntl

    try:
        return fcntl.ioctl(probe.fileno(), what, struct.pack("40s", name.encode()[:15]))
    except OSError:
        return None
