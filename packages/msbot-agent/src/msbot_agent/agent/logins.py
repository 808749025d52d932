"""Whose a packet is that comes from an address nobody knows: a login, or a packet with the key in its header."""

from __future__ import annotations

from msbot_xrce.errors import RemoteProtocolError
from msbot_xrce.messages import CreateClient, decode_header, first_submessage


def client_key_in(packet: bytes) -> int | None:
    """The client key that a packet shows; None: it shows none, as packets inside most sessions, or is broken."""
    try:
        header = decode_header(packet)
        if header.client_key:
            return header.client_key
        first = first_submessage(packet, header.size)
    except RemoteProtocolError:
        return None
    return first.client_key if isinstance(first, CreateClient) else None
