"""Names of simulated buses that this user's other programs can join: one small file for each, in the user's folder.

The file gives the port of this computer at which the bus is served, the key to present there, and the bit rates. The
process that serves a bus writes it, so a name stands for one bus. A file left behind by a killed process is recognised
and removed by the next process that looks; a bus that another process has begun to serve under that name meanwhile
keeps its file.
"""

from __future__ import annotations

import json
import os
import re
import secrets
from dataclasses import asdict
from pathlib import Path
from typing import Final

from msbot_agent.process.user_folders import alone_in, check_owner, is_running, running_folder
from msbot_agent.text.untrusted_input import read_json
from msbot_xrce.errors import ConfigError, LinkDown
from msbot_xrce.lazy import dataclass

DEFAULT_NAME: Final = "classroom"
"""The bus to use when none is named."""
PREFIX: Final = "bus-"
KEY_OCTETS: Final = 16

_NAME = re.compile(r"[A-Za-z0-9_-]{1,32}")


@dataclass(frozen=True, slots=True)
class NamedBus:
    """A simulated bus that is being served."""

    name: str
    port: int
    """TCP port on 127.0.0.1."""
    key: str
    """Hexadecimal; a program must present it to join."""
    pid: int
    bitrate: int
    data_bitrate: int | None
    fd: bool

    def rates(self) -> str:
        """Kind and bit rates in words."""
        return rates_words(self.bitrate, self.data_bitrate if self.fd else None, fd=self.fd)


def rates_words(bitrate: int, data_bitrate: int | None, *, fd: bool) -> str:
    """`CAN FD, 500 and 2000 kbit/s`."""
    data = "" if data_bitrate is None else f" and {data_bitrate / 1000:g}"
    return f"CAN{' FD' if fd else ''}, {bitrate / 1000:g}{data} kbit/s"


def check_name(name: str) -> str:
    """Check a name and return it.

    Raises:
        ConfigError: it is not a valid name.
    """
    if not _NAME.fullmatch(name):
        raise ConfigError(f"{name!r} is not a name for a simulated bus: 1 to 32 letters, digits, - and _")
    return name


def publish(bus: NamedBus, folder: Path | None = None) -> Path:
    """Write the file of a bus that is served by this process; the process that serves it removes it with `withdraw`.

    Raises:
        LinkDown: a running process serves a bus of that name already.
        ConfigError: the folder cannot be used, or is not the user's own.
    """
    folder = folder or running_folder()
    path = _path(bus.name, folder)
    draft = folder / f".{PREFIX}{bus.pid}-{secrets.token_hex(4)}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        check_free(bus.name, folder)
        descriptor = os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        try:
            with os.fdopen(descriptor, "w") as stream:
                json.dump(asdict(bus), stream)
            _link(draft, path, bus.name)
        finally:
            draft.unlink(missing_ok=True)
    except LinkDown:
        raise  # another process serves the name
    except OSError as error:
        raise ConfigError(f"cannot write {path} ({error.strerror})") from error
    return path


def withdraw(bus: NamedBus, folder: Path | None = None) -> None:
    """Remove the file of a bus, if it still belongs to this bus."""
    folder = folder or running_folder()
    path = _path(bus.name, folder)
    if _read(path) != bus:
        return
    # Without a lock (Windows), `is_running` cannot tell either, so that only a refused connection and the process that
    # has served the bus remove its file.
    with alone_in(folder):
        # Two processes may see the same dead bus: the slower one must not remove what was written after the faster one.
        if _read(path) == bus:
            path.unlink(missing_ok=True)


def find_bus(name: str, folder: Path | None = None) -> NamedBus | None:
    """The bus of that name, if a running process serves it.

    Raises:
        ConfigError: it is not a valid name, or the folder is not the user's own.
    """
    folder = folder or running_folder()
    path = _path(check_name(name), folder)
    if not folder.is_dir():
        return None
    check_owner(folder)
    bus = _read(path)
    if bus is not None and not is_running(bus.pid):
        withdraw(bus, folder)
        return None
    return bus


def check_free(name: str, folder: Path | None = None) -> None:
    """Make sure that a bus of that name can be served, before anything else is started.

    Raises:
        LinkDown: a running process already serves it.
        ConfigError: it is not a valid name, or the folder is not the user's own.
    """
    other = find_bus(name, folder)
    if other is not None:
        raise LinkDown(
            f"process {other.pid} serves a simulated bus {other.name!r} already ({other.rates()}): "
            "join it, stop that process, or take another name"
        )


def existing_bus(name: str, folder: Path | None = None) -> NamedBus:
    """The bus of that name.

    Raises:
        LinkDown: there is none; the text says how to start it, and which buses there are.
        ConfigError: it is not a valid name, or the folder is not the user's own.
    """
    bus = find_bus(name, folder)
    if bus is None:
        others = [other.name for other in list_buses(folder)]
        there = f" (there is {', '.join(others)})" if others else ""
        raise LinkDown(
            f"there is no simulated bus {name!r}{there}: start one with `msbot bus serve {name}`, "
            f"`msbot demo --bus {name}` or `msbot master --link sim:{name}`"
        )
    return bus


def list_buses(folder: Path | None = None) -> list[NamedBus]:
    """All buses of this user that are being served, by name.

    Raises:
        ConfigError: the folder is not the user's own.
    """
    folder = folder or running_folder()
    names = sorted(path.name.removeprefix(PREFIX).removesuffix(".json") for path in folder.glob(f"{PREFIX}*.json"))
    found = (find_bus(name, folder) for name in names if _NAME.fullmatch(name))
    return [bus for bus in found if bus is not None]


def _link(draft: Path, path: Path, name: str) -> None:
    """Give the file its name, atomically, and never overwrite another's."""
    try:
        os.link(draft, path)
    except FileExistsError:
        raise LinkDown(f"another program has just begun to serve a simulated bus {name!r}") from None


def _path(name: str, folder: Path) -> Path:
    return folder / f"{PREFIX}{name}.json"


def _read(path: Path) -> NamedBus | None:
    try:
        content = read_json(path.read_text())
        data_bitrate = content["data_bitrate"]
        return NamedBus(
            str(content["name"]),
            int(content["port"]),
            bytes.fromhex(content["key"]).hex(),
            int(content["pid"]),
            int(content["bitrate"]),
            None if data_bitrate is None else int(data_bitrate),
            bool(content["fd"]),
        )
    except (OSError, ValueError, KeyError, TypeError, OverflowError):
        return None  # not there, being removed, or not ours
