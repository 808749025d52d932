"""Says by the rules of which country Linux uses its radios (nl80211). It runs in the virtual computer, with its
Python; its text is handed there between single quotes, so it has none."""

import socket
import struct
import sys
from collections.abc import Iterator

CONTROL, GET_FAMILY, FAMILY_ID, FAMILY_NAME = 16, 3, 1, 2
GET_REGULATORY, ALPHA2 = 31, 33
REQUEST = 1


def attributes(octets: bytes) -> Iterator[tuple[int, bytes]]:
    """Number and content of each (struct nlattr)."""
    place = 0
    while place + 4 <= len(octets):
        size, kind = struct.unpack_from("=HH", octets, place)
        yield kind & 0x3FFF, octets[place + 4 : place + size]
        place += max(4, (size + 3) & ~3)


def ask(link: socket.socket, family: int, command: int, body: bytes = b"") -> dict[int, bytes]:
    """What a family of generic netlink answers."""
    message = struct.pack("=BBH", command, 1, 0) + body
    link.send(struct.pack("=IHHII", 16 + len(message), family, REQUEST, 1, 0) + message)
    return dict(attributes(link.recv(1 << 16)[20:]))


def country() -> str:
    """Two letters; 00: the rules that hold everywhere."""
    with socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, 16) as link:
        name = struct.pack("=HH", 12, FAMILY_NAME) + b"nl80211\0"
        (family,) = struct.unpack("=H", ask(link, CONTROL, GET_FAMILY, name)[FAMILY_ID])
        return ask(link, family, GET_REGULATORY)[ALPHA2].rstrip(b"\0").decode()


if __name__ == "__main__":
    sys.stdout.write(country() + "\n")
