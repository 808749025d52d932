"""The serial ports of this computer, and which of them a board is meant to be at."""

from __future__ import annotations

from typing import TYPE_CHECKING

from msbot_xrce.common.lazy_dataclass import dataclass
from msbot_xrce.errors import ConfigError

if TYPE_CHECKING:
    from serial.tools.list_ports_common import ListPortInfo

NEEDED = "boards need the library mpremote: pip install 'msbot[board]'"


@dataclass(frozen=True, slots=True)
class SerialPort:
    """One serial port."""

    port: str
    name: str
    """What it calls itself, "" if it does not."""
    usb: str
    """Vendor and product, as in `2e8a:0005`; "" for a port that is not USB."""
    serial_number: str


def ports() -> list[SerialPort]:
    """Every serial port, those of USB first.

    Raises:
        ConfigError: the library for boards is not installed.
    """
    try:
        from serial.tools.list_ports import comports
    except ImportError:
        raise ConfigError(NEEDED) from None
    return sorted((_port(info) for info in comports()), key=lambda port: (not port.usb, port.port))


def _port(info: ListPortInfo) -> SerialPort:
    words = [word for word in (info.manufacturer, info.product) if word]
    usb = "" if info.vid is None else f"{info.vid:04x}:{info.pid or 0:04x}"
    return SerialPort(info.device, " ".join(words), usb, info.serial_number or "")


def choose(port: str | None, there: list[SerialPort]) -> str:
    """The port that is meant: the one that was named, else the only USB serial port.

    Raises:
        ConfigError: none is there, or several are.
    """
    if port is not None:
        return port
    found = [one.port for one in there if one.usb]
    if len(found) == 1:
        return found[0]
    if found:
        raise ConfigError(f"several boards may be meant ({', '.join(found)}): name one with --port")
    raise ConfigError(
        "there is no board at a USB port: plug it in with a cable that carries data, or name another port with --port"
    )
