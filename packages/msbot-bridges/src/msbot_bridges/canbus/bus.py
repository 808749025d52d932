"""A bus of python-can for the library of a world."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from msbot_xrce.errors import ConfigError, LinkDown

if TYPE_CHECKING:
    import can

SEND_S: Final = 0.5
"""Longest wait for room in the controller."""
ALONE_S: Final = 0.02
"""The same after a frame has found none."""


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


class FrameSender:
    """Hands frames to a controller.

    A frame waits for room while other nodes are on the bus. A node alone there gets no acknowledgement, and so no room:
    its frames are counted and lost, after a short wait for each.

    Args:
        bus: an open bus.
    """

    def __init__(self, bus: can.BusABC) -> None:
        self.unsent = 0
        """Frames for which there was no room."""
        self._bus = bus
        self._is_alone = False

    def send(self, message: can.Message) -> bool:
        """Send a frame; False: it is lost.

        Raises:
            can.CanError: the bus cannot send.
        """
        import can

        try:
            self._bus.send(message, ALONE_S if self._is_alone else SEND_S)
        except can.CanTimeoutError:
            self._is_alone = True
            self.unsent += 1
            return False
        self._is_alone = False
        return True
