"""Masters found in the network (multicast DNS, RFC 6762 and 6763): one that is told to says that it is there.

Consent comes first: without `--announce` nothing is sent. What is heard may be said by anybody, so it decides nothing:
an announcement leads to an address that a person may enter an access for, and never to a token or a command.

zeroconf does the work in a thread of its own: a flood of packets keeps no robot waiting.
"""

from __future__ import annotations

import asyncio
import logging
import socket
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from hashlib import sha256
from ipaddress import ip_address
from typing import TYPE_CHECKING, Final

from msbot.process.daemon_threads import DaemonThreads
from msbot_agent.text.sentence import printable, said
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

if TYPE_CHECKING:
    from zeroconf import ServiceInfo, Zeroconf

SERVICE: Final = "_msbot._tcp.local."
LOOK_AGAIN_S: Final = 20.0
"""How often a master looks whether its computer's addresses are others: a network that came late, another lease."""
MOST: Final = 500
"""Announcements that are listened to."""
LONGEST: Final = 64
"""Characters of a text in an announcement."""
NEEDED: Final = said("to announce and to find robots takes another package: pip install 'msbot-school[announce]'")
NO_NETWORK: Final = said("this computer is in no network: nothing can be announced, and nobody found")

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class MasterAnnouncement:
    """What a master says of itself; as heard it may be anything, but for its forms."""

    robot: str
    serial_number: str
    version: str
    class_name: str
    """For whom it is announced."""
    port: int
    """Of its page."""
    is_tls: bool
    host: str = ""
    """The address that it is heard from; as said: the one that the page is served at, empty for all of the computer."""

    @property
    def address(self) -> str:
        """The address of its page."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{'https' if self.is_tls else 'http'}://{host}:{self.port}"

    @property
    def texts(self) -> dict[str, str]:
        """What is said beside address and port."""
        return {
            "robot": self.robot[:LONGEST],
            "serial": self.serial_number[:LONGEST],
            "version": self.version[:LONGEST],
            "class": self.class_name[:LONGEST],
            "tls": "1" if self.is_tls else "0",
        }


def check_class_name(name: str) -> str:
    """The name of a class, if it is one.

    Raises:
        ConfigError: it is none.
    """
    if not name.strip() or len(name) > LONGEST or not name.isprintable():
        raise ConfigError(said("the name of a class has 1 to {most} printable characters", most=LONGEST))
    return name.strip()


def own_addresses() -> list[str]:
    """The IPv4 addresses at which other computers reach this one.

    Raises:
        ConfigError: zeroconf is not installed.
    """
    with _needed():
        import ifaddr
    found = [str(ip.ip) for adapter in ifaddr.get_adapters() for ip in adapter.ips if ip.is_IPv4]
    return sorted(one for one in found if not ip_address(one).is_loopback)


class MasterAnnouncer:
    """Says that a master is there until it is cancelled; follows the addresses of its computer.

    Args:
        announced: what is said.
        say: takes a sentence for the person at the terminal.
    """

    def __init__(self, announced: MasterAnnouncement, say: Callable[[str], None]) -> None:
        self._announced = announced
        self._say = say
        self._thread = DaemonThreads(1, "msbot announce")
        self._zeroconf: Zeroconf | None = None
        self._at: list[str] | None = None
        self._told = ""

    async def run(self) -> None:
        """Announce until cancelled, and then take it back."""
        loop = asyncio.get_running_loop()
        try:
            while True:
                words = await loop.run_in_executor(self._thread, self._follow)
                if words and words != self._told:
                    self._told = words
                    self._say(words)
                await asyncio.sleep(LOOK_AGAIN_S)
        finally:
            ending = loop.run_in_executor(self._thread, self._end)
            await asyncio.shield(ending)

    def _follow(self) -> str:
        """Announce at the present addresses; returns what there is to say about it."""
        host = self._announced.host
        addresses = [host] if host else own_addresses()
        if addresses == self._at:
            return ""
        self._end()
        if not own_addresses():
            return f"not announced yet: {NO_NETWORK}"
        from zeroconf import Error

        try:
            self._zeroconf = _open(addresses)
            self._zeroconf.register_service(_info(self._announced, addresses), allow_name_change=True)
        except (OSError, Error) as error:
            self._end()
            return f"not announced yet, the network takes no multicast: {_why(error)}"
        self._at = addresses
        return f"announced in {', '.join(addresses)} for class {self._announced.class_name}"

    def _end(self) -> None:
        zeroconf, self._zeroconf, self._at = self._zeroconf, None, None
        if zeroconf is not None:
            zeroconf.unregister_all_services()
            zeroconf.close()


def find_masters(seconds: float, class_name: str = "") -> list[MasterAnnouncement]:
    """The masters that announce themselves in the networks of this computer.

    Args:
        seconds: how long is listened.
        class_name: only those for this class; empty: all.

    Raises:
        ConfigError: zeroconf is not installed, there is no network, or it takes no multicast.
    """
    addresses = own_addresses()
    if not addresses:
        raise ConfigError(NO_NETWORK)
    with _needed():
        from zeroconf import ServiceBrowser, ServiceInfo, ServiceListener
    until = time.monotonic() + seconds
    names: set[str] = set()

    class Hearing(ServiceListener):
        def add_service(self, zc: Zeroconf, type_: str, name: str) -> None:  # noqa: ARG002
            if len(names) < MOST:
                names.add(name)

        def update_service(self, zc: Zeroconf, type_: str, name: str) -> None:
            self.add_service(zc, type_, name)

        def remove_service(self, zc: Zeroconf, type_: str, name: str) -> None:  # noqa: ARG002
            names.discard(name)

    try:
        zeroconf = _open(addresses)
    except OSError as error:
        raise ConfigError(
            said("nobody can be found, the network takes no multicast: {error}", error=_why(error))
        ) from None
    found: set[MasterAnnouncement] = set()
    try:
        browser = ServiceBrowser(zeroconf, SERVICE, Hearing())
        known: set[str] = set()
        while (left := until - time.monotonic()) > 0:
            for name in tuple(names - known):
                info = ServiceInfo(SERVICE, name)
                if info.load_from_cache(zeroconf) or info.request(zeroconf, min(left, 1.0) * 1000):
                    known.add(name)
                    found.update(parse_announcement(info.properties, info.port, info.parsed_addresses()))
            time.sleep(min(left, 0.05))
        browser.cancel()
    finally:
        zeroconf.close()
    fitting = [one for one in found if class_name in ("", one.class_name)]
    return sorted(fitting, key=lambda one: (one.class_name, one.robot, one.serial_number, one.address))


def parse_announcement(
    texts: Mapping[bytes, bytes | None], port: int | None, addresses: list[str]
) -> Iterator[MasterAnnouncement]:
    """What an announcement says, if it makes sense: one for the first address that other computers can reach."""

    def text(name: str) -> str:
        raw = (texts.get(name.encode()) or b"").decode("utf-8", "replace")
        return printable(raw)[:LONGEST]

    hosts = [one for one in addresses if _can_be_reached(one)]
    if port and text("robot") and hosts:
        yield MasterAnnouncement(
            text("robot"), text("serial"), text("version"), text("class"), port, text("tls") == "1", hosts[0]
        )


def _why(error: Exception) -> str:
    return (error.strerror if isinstance(error, OSError) else "") or str(error) or type(error).__name__


def _can_be_reached(host: str) -> bool:
    try:
        found = ip_address(host)
    except ValueError:
        return False
    return found.version == 4 and not (found.is_loopback or found.is_multicast or found.is_unspecified)


def _info(announced: MasterAnnouncement, addresses: list[str]) -> ServiceInfo:
    from zeroconf import ServiceInfo

    own = f"{announced.robot}\n{announced.serial_number}\n{announced.port}\n{socket.gethostname()}"
    mark = sha256(own.encode()).hexdigest()[:8]
    shown = "".join(letter if letter.isalnum() else "-" for letter in f"{announced.robot}-{announced.serial_number}")
    return ServiceInfo(
        SERVICE,
        f"{shown.encode('ascii', 'replace').decode().replace('?', '-')[:40]}-{mark}.{SERVICE}",
        addresses=[socket.inet_aton(one) for one in addresses],
        port=announced.port,
        properties=announced.texts,
        server=f"msbot-{mark}.local.",
    )


def _open(addresses: list[str]) -> Zeroconf:
    with _needed():
        from zeroconf import IPVersion, Zeroconf
    logging.getLogger("zeroconf").setLevel(logging.CRITICAL)  # what others send is their affair
    return Zeroconf(interfaces=addresses, ip_version=IPVersion.V4Only)


@contextmanager
def _needed() -> Iterator[None]:
    try:
        yield
    except ImportError:
        raise ConfigError(NEEDED) from None
