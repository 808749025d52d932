"""Where a Modbus line is: `tcp:HOST[:PORT]`, `rtu:DEVICE[?baud=N&parity=E&stop=1]`, `rtu+tcp:HOST:PORT`."""

from __future__ import annotations

from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

_BAUDS = (1200, 2400, 4800, 9600, 19_200, 38_400, 57_600, 115_200, 230_400, 460_800, 921_600)


@dataclass(frozen=True, slots=True)
class LineAddress:
    """A serial line, or a computer that has one."""

    words: str
    host: str
    """For a serial line, its device."""
    port: int = 502
    is_rtu: bool = False
    is_serial: bool = False
    baud: int = 19_200
    parity: str = "E"
    """What the specification has as default."""
    stop_bits: int = 1


def read_address(text: str) -> LineAddress:
    """Read an address.

    Raises:
        ConfigError: it is none; the text says what would be right.
    """
    scheme, _, rest = text.partition(":")
    if scheme == "rtu" and rest:
        device, _, query = rest.partition("?")
        given = dict(pair.partition("=")[::2] for pair in query.split("&") if pair)
        if set(given) <= {"baud", "parity", "stop"} and device:
            return _serial(text, device, given)
    if scheme in ("tcp", "rtu+tcp") and rest:
        host, port = rest, "502"
        if rest.startswith("[") and "]" in rest:
            host, _, after = rest[1:].partition("]")
            port = after.removeprefix(":") or "502"
        elif ":" in rest:
            host, _, port = rest.rpartition(":")
        if host and port.isdecimal() and 0 < int(port) < 65_536:
            return LineAddress(text, host, int(port), scheme == "rtu+tcp")
    raise ConfigError(
        f"--link {text}: write tcp:HOST, tcp:HOST:PORT, rtu+tcp:HOST:PORT, "
        "or rtu:/dev/ttyUSB0?baud=19200&parity=E&stop=1"
    )


def _serial(text: str, device: str, given: dict[str, str]) -> LineAddress:
    baud, parity, stop = given.get("baud", "19200"), given.get("parity", "E"), given.get("stop", "1")
    if not baud.isdecimal() or int(baud) not in _BAUDS:
        raise ConfigError(f"--link {text}: baud is one of {', '.join(map(str, _BAUDS))}")
    if parity not in ("E", "O", "N") or stop not in ("1", "2"):
        raise ConfigError(f"--link {text}: parity is E, O or N, and stop is 1 or 2")
    return LineAddress(text, device, 0, True, True, int(baud), parity, int(stop))
