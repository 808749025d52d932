from __future__ import annotations

import asyncio
import errno
import os
import socket

import pytest

from msbot_agent.link.net.host_address import addresses_of, cannot_listen, cannot_reach, joined, serve_both_kinds
from msbot_xrce.errors import LinkDown


def test_an_address_is_written_so_that_it_can_be_read_again() -> None:
    assert joined("127.0.0.1", 8888) == "127.0.0.1:8888"
    assert joined("fe80::1%eth0", 8888) == "[fe80::1%eth0]:8888"


async def test_a_host_is_looked_up_for_its_kind_of_socket() -> None:
    loop = asyncio.get_running_loop()
    for kind in (socket.SOCK_DGRAM, socket.SOCK_STREAM):
        (found,) = await addresses_of(loop, "udp:x", "127.0.0.1", 8888, kind=kind)
        assert (found[0], found[1], found[3]) == (socket.AF_INET, kind, ("127.0.0.1", 8888))
    with pytest.raises(LinkDown, match=r"udp:x: no such host as 'no-such-host\.invalid'"):
        await addresses_of(loop, "udp:x", "no-such-host.invalid", 8888, kind=socket.SOCK_DGRAM)


@pytest.mark.parametrize(
    ("number", "words"),
    [
        (errno.EADDRINUSE, "cannot listen at tcp:h:80: another program listens there: end it (`ss -tlnp sport = :80`"),
        (errno.EACCES, "cannot listen at tcp:h:80: ports below 1024 belong to the system"),
        (errno.EADDRNOTAVAIL, "no interface of this machine has the address h"),
        (errno.EAFNOSUPPORT, "this machine has no IPv6"),
        (errno.EIO, f"cannot listen at tcp:h:80: {os.strerror(errno.EIO)}"),
    ],
)
def test_why_a_server_cannot_listen(number: int, words: str) -> None:
    assert words in str(cannot_listen("tcp:h:80", "h", 80, OSError(number, ""), lister="ss -tlnp"))


def test_an_address_that_each_network_has_needs_the_network() -> None:
    refused = OSError(errno.EINVAL, "")
    words = str(cannot_listen("udp:[fe80::1]:80", "fe80::1", 80, refused, lister="ss -ulnp"))
    assert words.endswith(": each network has such addresses: say which one it is, for example fe80::1%eth0")
    named = str(cannot_listen("udp:[fe80::1%lo]:80", "fe80::1%lo", 80, refused, lister="ss -ulnp"))
    assert named.endswith(os.strerror(errno.EINVAL))


@pytest.mark.parametrize(
    ("number", "words"),
    [
        (errno.ENETUNREACH, "cannot reach udp:h:80: no way to that network"),
        (errno.EAFNOSUPPORT, "this machine has no IPv6"),
        (errno.EACCES, "that is a broadcast address"),
        (errno.EIO, f"cannot reach udp:h:80: {os.strerror(errno.EIO)}"),
    ],
)
def test_why_a_client_cannot_start(number: int, words: str) -> None:
    assert words in str(cannot_reach("udp:h:80", "h", OSError(number, "")))


class Recorder:
    """A socket that remembers its options."""

    def __init__(self, family: int) -> None:
        self.family = family
        self.options: list[tuple[int, ...]] = []

    def setsockopt(self, *option: int) -> None:
        self.options.append(option)


@pytest.mark.parametrize(
    ("family", "host", "count"),
    [(socket.AF_INET6, "::", 1), (socket.AF_INET6, "::1", 0), (socket.AF_INET, "0.0.0.0", 0)],
)
def test_only_a_server_of_every_interface_serves_both_kinds(family: int, host: str, count: int) -> None:
    server = Recorder(family)
    serve_both_kinds(server, host)  # type: ignore[arg-type]  # has all that is needed
    assert server.options == [(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 0)] * count
