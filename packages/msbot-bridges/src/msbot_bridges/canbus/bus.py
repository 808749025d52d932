"""A bus of python-can for the library of a world."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from msbot_xrce.errors import ConfigError, LinkDown

if TYPE_CHECKING:
    import can

SEND_S: Final = 0.02
"""Longest wait for room in the controller."""


def check_address(address: str) -> None:
    """Refuse what is no `INTERFACE:CHANNEL[?bitrate=N]`.

    Raises:
        ConfigError: the text says what would be right.
    """
    path, _, query = address.partition("?")
    if not all(path.partition(":")[::2]):
        raise ConfigError(f"--link {address}: write INTERFACE:CHANNEL, for example socketcan:can0")
    for pair in filter(None, query.split("&")):
        name, _, value = pair.partition("=")
        if name != "bitrate" or not value.isdecimal() or not int(value):
            raise ConfigError(f"--link {address}: after ? there may be bitrate=N in bit/s, for example bitrate=500000")


def open_bus(address: str) -> can.BusABC:
    """Open `INTERFACE:CHANNEL[?bitrate=N]` of python-can.

    Raises:
        LinkDown: it cannot be opened.
    """
    import can

    path, _, query = address.partition("?")
    interface, _, channel = path.partition(":")
    bitrate = dict(pair.partition("=")[::2] for pair in query.split("&") if pair).get("bitrate")
    settings: dict[str, Any] = {"bitrate": int(bitrate)} if bitrate else {}
    try:
        return can.Bus(channel or None, interface, ignore_config=True, **settings)
    except Exception as error:  # an adapter's library may raise anything
        raise LinkDown(f"{address} cannot be opened: {error}") from error


def send_frame(bus: can.BusABC, message: can.Message) -> bool:
    """Hand a frame to the controller; False: it had no room, and the frame is lost: a node may be alone on its bus.

    Raises:
        can.CanError: the bus cannot send.
    """
    import can

    try:
        bus.send(message, SEND_S)
    except can.CanTimeoutError:
        return False
    return True
