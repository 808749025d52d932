"""Addresses of links as people write them: `udp:127.0.0.1:8888`.

What stands before the first colon chooses the kind of link; every kind reads the rest in its own way.
"""

from __future__ import annotations

import ipaddress
import re
from collections.abc import Callable
from dataclasses import dataclass

from msbot.errors import ConfigError
from msbot.link import Link
from msbot.link.udp import UdpClientLink, UdpServerLink


@dataclass(frozen=True, slots=True)
class Scheme:
    """One kind of link."""

    example: str
    """An address that a person can copy."""
    open: Callable[[str, bool], Link]
    """`(rest of the address, serve)`: makes the link without opening it; raises ConfigError."""


def open_link(address: str, *, serve: bool = False) -> Link:
    """Make the link of an address; it opens when it runs.

    Args:
        address: for example `udp:192.168.1.20:8888` or `udp:[::1]:8888`.
        serve: True for the side that many peers come to (the master), False for a part.

    Raises:
        ConfigError: the address makes no sense; the text shows a right one.
    """
    name, colon, rest = address.strip().partition(":")
    scheme = SCHEMES.get(name.lower())
    if scheme is None or not colon:
        kinds = ", ".join(f"`{known.example}`" for known in SCHEMES.values())
        raise ConfigError(f"link {address!r}: unknown kind of link {name!r}; there are {kinds}")
    try:
        return scheme.open(rest, serve)
    except ConfigError as error:
        raise ConfigError(f"link {address!r}: {error}; write it like `{scheme.example}`") from error


_HOST_AND_PORT = re.compile(r"(?:\[(?P<ipv6>[^\[\]]+)\]|(?P<host>[^:\[\]]+)):(?P<port>[0-9]{1,5})")


def parse_host_and_port(text: str, *, any_port: bool = False) -> tuple[str, int]:
    """`127.0.0.1:8888`, `name:8888` or `[::1]:8888` as host and port.

    Args:
        text: what stands in the address.
        any_port: whether port 0, "any free one", makes sense here.

    Raises:
        ConfigError: it is nothing of the kind.
    """
    match = _HOST_AND_PORT.fullmatch(text)
    if match is None:
        if text.count(":") > 1 and "[" not in text:
            raise ConfigError("an IPv6 address stands in brackets")
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


def _open_udp(rest: str, serve: bool) -> Link:
    host, port = parse_host_and_port(rest, any_port=serve)
    return UdpServerLink(host, port) if serve else UdpClientLink(host, port)


SCHEMES: dict[str, Scheme] = {"udp": Scheme("udp:127.0.0.1:8888", _open_udp)}
"""Every kind of link that an address can name."""
