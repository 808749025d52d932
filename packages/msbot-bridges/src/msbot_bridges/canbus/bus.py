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


def check_address(address: str, *, may_be_fd: bool = False) -> None:
    """Refuse what is no `INTERFACE:CHANNEL[?bitrate=N]`.

    Args:
        address: as a person wrote it.
        may_be_fd: its devices may be on CAN FD: `fd=1`, and with it `dbitrate=N`.

    Raises:
        ConfigError: the text says what would be right.
    """
    path, _, query = address.partition("?")
    if not all(path.partition(":")[::2]):
        raise ConfigError(f"--link {address}: write INTERFACE:CHANNEL, for example socketcan:can0")
    for pair in filter(None, query.split("&")):
        name, _, value = pair.partition("=")
        if name in ("fd", "dbitrate") and not may_be_fd:
            raise ConfigError(f"--link {address}: the bridge for these devices is for classic CAN; leave {name} out")
        is_rate = name == "bitrate" or (name == "dbitrate" and is_fd(address))
        if not (is_rate and value.isdecimal() and int(value)) and not (name == "fd" and value in ("0", "1")):
            with_fd = "; with fd=1, also dbitrate=N" if may_be_fd else ""
            raise ConfigError(
                f"--link {address}: after ? there may be bitrate=N in bit/s, for example bitrate=500000{with_fd}"
            )


def is_fd(address: str) -> bool:
    """Whether it is a bus of CAN FD: it has `fd=1`."""
    return "fd=1" in address.partition("?")[2].split("&")


def open_bus(address: str) -> can.BusABC:
    """Open `INTERFACE:CHANNEL[?bitrate=N]` of python-can, on CAN FD `INTERFACE:CHANNEL?fd=1[&bitrate=N][&dbitrate=N]`.

    Raises:
        LinkDown: it cannot be opened.
    """
    import can

    path, _, query = address.partition("?")
    interface, _, channel = path.partition(":")
    options = dict(pair.partition("=")[::2] for pair in query.split("&") if pair)
    settings: dict[str, Any] = {"bitrate": int(options["bitrate"])} if "bitrate" in options else {}
    if is_fd(address):
        if interface == "virtual":  # it has a word of its own for it
            settings["protocol"] = can.CanProtocol.CAN_FD
        else:
            settings["fd"] = True
        if "dbitrate" in options:
            settings["data_bitrate"] = int(options["dbitrate"])
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
