"""Words and addresses that UDP and TCP share."""

from __future__ import annotations

import asyncio
import errno
import os
import socket

from msbot_xrce.errors import LinkDown

_NO_IPV6 = "this machine has no IPv6: use an IPv4 address"


Address = tuple[str, int] | tuple[str, int, int, int] | tuple[int, bytes]
"""What `getaddrinfo` gives and `bind` takes."""

SocketAddress = tuple[int, int, int, Address]
"""Family, kind and protocol of a socket, and what it binds or connects to."""


def joined(host: str, port: int) -> str:
    """`127.0.0.1:8888` or `[::1]:8888`."""
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


def serve_both_kinds(server: socket.socket, host: str) -> None:
    """Make a server at `::` serve IPv4, too, whatever the system's setting."""
    if server.family == socket.AF_INET6 and host == "::":
        server.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 0)


async def addresses_of(
    loop: asyncio.AbstractEventLoop, name: str, host: str, port: int, *, kind: int
) -> list[SocketAddress]:
    """Look up a host; `name` is the link's, `kind` SOCK_DGRAM or SOCK_STREAM.

    Raises:
        LinkDown: there is no such host.
    """
    try:
        found = await loop.getaddrinfo(host, port, type=kind)
    except socket.gaierror as error:
        words = f"{name}: no such host as {host!r} ({error.strerror}): check the name or give a number"
        raise LinkDown(words) from error
    return [(family, kind, protocol, address) for family, kind, protocol, _, address in found]


def cannot_listen(name: str, host: str, port: int, error: OSError, *, lister: str) -> LinkDown:
    """The error for an address that cannot be served; `lister` is the command that shows who has the port."""
    remedies = {
        errno.EADDRINUSE: f"another program listens there: end it (`{lister} sport = :{port}` names it) "
        f"or choose another port, such as {port + 1 if port < 65535 else port - 1}",
        errno.EACCES: "ports below 1024 belong to the system: choose a higher one",
        errno.EADDRNOTAVAIL: f"no interface of this machine has the address {host}: "
        "use 127.0.0.1, or 0.0.0.0 for all (`ip address` shows them)",
        errno.EAFNOSUPPORT: _NO_IPV6,
    }
    if host.lower().startswith("fe80:") and "%" not in host:
        remedies[errno.EINVAL] = f"each network has such addresses: say which one it is, for example {host}%eth0"
    return LinkDown(f"cannot listen at {name}: {remedies.get(error.errno or 0) or os.strerror(error.errno or 0)}")


def cannot_reach(name: str, host: str, error: OSError) -> LinkDown:
    """The error for a client that cannot even try."""
    broadcast = "that is a broadcast address: give the address of one machine"
    remedies = {
        errno.ENETUNREACH: "no way to that network: check the cable, the wireless network and `ip route`",
        errno.EAFNOSUPPORT: _NO_IPV6,
        errno.EACCES: broadcast,
    }
    if host == "255.255.255.255":  # without a network, too
        remedies[errno.ENETUNREACH] = broadcast
    return LinkDown(f"cannot reach {name}: {remedies.get(error.errno or 0) or os.strerror(error.errno or 0)}")
