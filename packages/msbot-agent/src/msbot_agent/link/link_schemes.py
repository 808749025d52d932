"""Addresses of links as people write them: `udp:127.0.0.1:8888`, `serial:/dev/ttyUSB0?baudrate=115200`.

What precedes the first colon chooses the kind of link; every kind reads the rest in its own way. Options follow a
question mark.
"""

from __future__ import annotations

import ipaddress
import re
from collections.abc import Callable
from functools import partial

from msbot_agent.link.can.can_address import (
    CAN_EXAMPLE,
    CANFD_EXAMPLE,
    LEGACY_EXAMPLE,
    CanSettings,
    open_can,
    open_can_legacy,
    open_canfd,
)
from msbot_agent.link.can.sim.sim_address import SIM_EXAMPLE, open_sim
from msbot_agent.link.contract import Link
from msbot_agent.link.failover_link import FailoverLink
from msbot_agent.link.net.tcp import TcpClientLink, TcpServerLink
from msbot_agent.link.net.udp import UdpClientLink, UdpServerLink
from msbot_agent.link.net.websocket_client import open_websocket
from msbot_agent.link.serial.pty import PtyServerLink
from msbot_agent.link.serial.serial_line import CLIENT_ADDRESS
from msbot_agent.link.serial.serial_port import AUTO, DEFAULT_BAUDRATE, SerialClientLink, SerialServerLink
from msbot_agent.startup.extensions import extensions
from msbot_xrce.errors import ConfigError, MsbotError
from msbot_xrce.lazy import dataclass


@dataclass(frozen=True, slots=True)
class Scheme:
    """One kind of link."""

    example: str
    """An address that a person can copy."""
    open: Callable[[str, bool, CanSettings], Link]
    """`(rest of the address, serve, what CAN needs)`: makes the link but does not open it; raises ConfigError."""


def open_link(address: str, *, serve: bool = False, can: CanSettings | None = None) -> Link:
    """Make the link for an address; it opens when it runs.

    Args:
        address: for example `udp:192.168.1.20:8888` or `udp:[::1]:8888`; a part may have several, with commas between
            them: masters of which one serves (`FailoverLink`).
        serve: True for the side that serves many peers (the master), False for a part.
        can: what a link on a CAN bus needs in addition to its address.

    Raises:
        ConfigError: the address makes no sense; the text shows a right one.
    """
    several = _SEVERAL.split(address.strip())
    if len(several) > 1:
        if serve:
            raise ConfigError(f"link {address!r}: a master serves each of them: give --link several times")
        return FailoverLink([open_link(one, can=can) for one in several])
    name, colon, rest = address.strip().partition(":")
    scheme = SCHEMES.get(name.lower()) or _brought(name.lower())
    if scheme is None or not colon:
        kinds = ", ".join(f"`{known.example}`" for known in link_kinds().values())
        raise ConfigError(f"link {address!r}: unknown kind of link {name!r}; there are {kinds}")
    try:
        return scheme.open(rest, serve, can or CanSettings())
    except ConfigError as error:
        raise ConfigError(f"link {address!r}: {error}; write it like `{scheme.example}`") from error


def link_kinds() -> dict[str, Scheme]:
    """Every kind of link that an address can name, those of extensions included, by name."""
    return {**SCHEMES, **extensions().all("links", Scheme, SCHEMES)}


def _brought(name: str) -> Scheme | None:
    """A kind of link that an extension brings; whatever it raises when it is opened is a mistake in the address."""
    scheme = extensions().get("links", name, Scheme)
    return None if scheme is None else Scheme(scheme.example, partial(_open_brought, name, scheme))


def _open_brought(name: str, scheme: Scheme, rest: str, serve: bool, can: CanSettings) -> Link:
    try:
        return scheme.open(rest, serve, can)
    except MsbotError:
        raise
    except Exception as error:
        raise ConfigError(f"the extension that brings {name} links failed: {type(error).__name__}: {error}") from error


def bound_name(link: Link) -> str:
    """The link's name as a peer would write it: with the port that it has got if any free one was asked for.

    Before the link is open, and for every link without ports, it is `link.info.name`.
    """
    if isinstance(link, UdpServerLink | TcpServerLink) and link.port:
        return f"{link.info.name.rpartition(':')[0]}:{link.port}"
    return link.info.name


_SEVERAL = re.compile(r",(?=[a-z][a-z-]*:)")
"""Between two addresses; ports of one address are separated by commas, too."""

_HOST_AND_PORT = re.compile(r"(?:\[(?P<ipv6>[^\[\]]+)\]|(?P<host>[^:\[\]]+)):(?P<port>[0-9]{1,5})")


def parse_host_and_port(text: str, *, any_port: bool = False) -> tuple[str, int]:
    """`127.0.0.1:8888`, `name:8888` or `[::1]:8888` as host and port.

    Args:
        text: this part of the address.
        any_port: whether port 0, "any free one", is allowed here.

    Raises:
        ConfigError: it is not a host and a port.
    """
    match = _HOST_AND_PORT.fullmatch(text)
    if match is None:
        if text.count(":") > 1 and "[" not in text:
            raise ConfigError("an IPv6 address needs brackets")
        raise ConfigError("it needs a host and a port")
    host, port = match["ipv6"] or match["host"], int(match["port"])
    if match["ipv6"] is not None:
        try:
            ipaddress.IPv6Address(host)
        except ValueError as error:
            raise ConfigError(f"{host!r} is no IPv6 address") from error
    lowest = 0 if any_port else 1
    if not lowest <= port <= 65535:
        raise ConfigError(f"port {port} is not from {lowest} to 65535")
    return host, port


def _open_udp(rest: str, serve: bool, _: CanSettings) -> Link:
    host, port = parse_host_and_port(rest, any_port=serve)
    return UdpServerLink(host, port) if serve else UdpClientLink(host, port)


def _open_tcp(rest: str, serve: bool, _: CanSettings) -> Link:
    host, port = parse_host_and_port(rest, any_port=serve)
    return TcpServerLink(host, port) if serve else TcpClientLink(host, port)


def _open_ws(rest: str, serve: bool, _: CanSettings) -> Link:
    return _open_page_link(f"ws:{rest}", serve)


def _open_wss(rest: str, serve: bool, _: CanSettings) -> Link:
    return _open_page_link(f"wss:{rest}", serve)


def _open_page_link(address: str, serve: bool) -> Link:
    if serve:
        raise ConfigError("the page serves parts by itself wherever it is served: leave this link out; a part opens it")
    return open_websocket(address)


def parse_options(text: str, **defaults: int) -> tuple[str, dict[str, int]]:
    """`/dev/ttyUSB0?baudrate=9600&address=2` as the part before the question mark, and its numeric options.

    Args:
        text: this part of the address.
        defaults: all options, with their default values.

    Raises:
        ConfigError: there is no such option, or its value is not a number.
    """
    path, _, query = text.partition("?")
    options = dict(defaults)
    for item in filter(None, query.split("&")):
        name, _, value = item.partition("=")
        if name not in options:
            raise ConfigError(f"there is no option {name!r}; there are {', '.join(defaults)}")
        if not (value.isascii() and value.isdigit()):
            raise ConfigError(f"option {name} is {value!r}, not a number")
        options[name] = int(value)
    return path, options


def _open_serial(rest: str, serve: bool, _: CanSettings) -> Link:
    if serve:
        path, options = parse_options(rest, baudrate=DEFAULT_BAUDRATE)
        ports = [port.strip() for port in path.split(",")]
        if not all(ports):
            raise ConfigError(f"it needs a port, or `{AUTO}` for every USB serial port")
        return SerialServerLink([] if ports == [AUTO] else ports, baudrate=options["baudrate"])
    path, options = parse_options(rest, baudrate=DEFAULT_BAUDRATE, address=CLIENT_ADDRESS)
    if not path or path == AUTO or "," in path:
        raise ConfigError("it needs the one port that leads to the master")
    return SerialClientLink(path, baudrate=options["baudrate"], address=options["address"])


def _open_pty(rest: str, serve: bool, _: CanSettings) -> Link:
    if not serve:
        raise ConfigError(f"a part opens the other end, as a serial port: `serial:{rest}`")
    if not rest:
        raise ConfigError("it needs a name for the terminal")
    return PtyServerLink(rest)


SCHEMES: dict[str, Scheme] = {
    "udp": Scheme("udp:127.0.0.1:8888", _open_udp),
    "tcp": Scheme("tcp:127.0.0.1:8888", _open_tcp),
    "ws": Scheme("ws://127.0.0.1:8080", _open_ws),
    "wss": Scheme("wss://robot.school:8080", _open_wss),
    "serial": Scheme("serial:/dev/ttyUSB0?baudrate=115200", _open_serial),
    "pty": Scheme("pty:/tmp/robot.tty", _open_pty),
    "can": Scheme(CAN_EXAMPLE, open_can),
    "canfd": Scheme(CANFD_EXAMPLE, open_canfd),
    "can-legacy": Scheme(LEGACY_EXAMPLE, open_can_legacy),
    "sim": Scheme(SIM_EXAMPLE, open_sim),
}
"""Every kind of link that an address can name without an extension."""
