"""A board with MicroPython at a serial port. The library mpremote speaks with it; what goes wrong becomes one sentence.

We use mpremote's class rather than its command line, which tells neither how far it is nor, in words that a program
can rely on, what went wrong.
"""

from __future__ import annotations

import ast
import contextlib
import errno
import io
import struct
import sys
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, Final

from msbot_xrce.errors import ConfigError, LinkDown, MsbotError
from msbot_xrce.lazy import dataclass

if TYPE_CHECKING:
    from mpremote.transport_serial import SerialTransport
    from serial.tools.list_ports_common import ListPortInfo


# What a board answers to the questions of `connection.py`: whether it is an answer at all.
#
# A board prints Python values; one that runs something else, or is out of its mind, prints values of other kinds.


SHORTEST: Final = 2
"""Numbers of a version."""


def are_board_facts(found: object) -> bool:
    """Name, version, machine, version of compiled files, folders for packages, home."""
    match found:
        case (str(), [*version], str(), int(), [*lib], str()) if len(version) >= SHORTEST:
            return all(isinstance(one, int) for one in version) and all(isinstance(one, str) for one in lib)
    return False


def is_room(found: object) -> bool:
    """Octets of a block and of a fragment, blocks in all, free ones; or None."""
    match found:
        case None | (int(), int(), int(), int()):
            return found is None or (found[0] > 0 and min(found) >= 0)
    return False


def are_files(found: list[object]) -> bool:
    """Name, octets and SHA-256 of each file."""
    for one in found:
        match one:
            case (str(), int(), bytes() | None):
                pass
            case _:
                return False
    return True


# The serial ports of this computer, and which of them a board is meant to be at.


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


BAUDRATE = 115_200
OLDEST = (1, 22)
"""The first MicroPython that MsBOT's package runs on."""
CHUNK = 1024
"""Octets of a file that are written by one line of Python: what a board with little memory can hold."""
ANSWER_S = 4.0
"""How long a board may take to stop its program, to start again, or to carry out a line."""
TRIES = 2
"""A board that restarts when its port is opened misses the first."""
_SHOWN = 60

_FACTS = """
import sys, os
_i = sys.implementation
print(repr((_i[0], tuple(_i[1])[:3], getattr(_i, "_machine", sys.platform), getattr(_i, "_mpy", 0) & 255,
 [p for p in sys.path if p.endswith("/lib")], os.getcwd())))
"""
NOTHING: Final = object()
"""A board has printed no value."""
FREE_BLOCKS: Final = 3
"""Place of what is free in the answer to `_ROOM`; before it the sizes of a block and of a fragment, and all blocks."""
_ROOM = """
import os
try:
 print(repr(tuple(os.statvfs({folder!r}))[:4]))
except (AttributeError, OSError):
 print(None)
"""
_LOOK = """
import os
try:
 from hashlib import sha256
except ImportError:
 sha256 = None
try:
 _n = list(os.ilistdir({folder!r}))
except OSError:
 _n = ()
for _f in _n:
 if not _f[1] & 0x4000:
  _p = {folder!r} + "/" + _f[0]
  _h = sha256 and sha256()
  with open(_p, "rb") as _s:
   while _h:
    _b = _s.read(256)
    if not _b:
     break
    _h.update(_b)
  print(repr((_f[0], os.stat(_p)[6], _h and _h.digest())), end=",")
"""


@dataclass(frozen=True, slots=True)
class BoardFacts:
    """What a board says it is."""

    machine: str
    version: tuple[int, ...]
    mpy_version: int
    """The version of compiled files that it takes; 0 = none."""
    lib: str
    """The folder that packages go to."""
    home: str
    """The folder in which programs start, without a slash at its end."""

    @property
    def version_words(self) -> str:
        """`1.22.0`."""
        return ".".join(map(str, self.version))


@dataclass(frozen=True, slots=True)
class BoardFile:
    """A file on the board."""

    size: int
    sha256: bytes | None
    """None if the board cannot tell."""


class CodeFailed(MsbotError):
    """Python code on the board ended with an exception; the text is its traceback."""


class Board:
    """A board whose program was ended and which waits for lines of Python (raw REPL).

    Its methods raise `LinkDown` if the board is unplugged or stops answering, with a sentence that names its port.
    """

    def __init__(self, transport: SerialTransport, port: str) -> None:
        self._transport = transport
        self.port = port

    def facts(self) -> BoardFacts:
        """What it is.

        Raises:
            ConfigError: MsBOT cannot run on it.
        """
        name, version, machine, mpy_version, lib, home = self._value(_FACTS, are_board_facts)
        words = ".".join(map(str, version))
        if name != "micropython":
            raise ConfigError(
                f"the board at {self.port} runs {_short(name)} {words}: MsBOT needs MicroPython 1.22 or newer"
            )
        if tuple(version) < OLDEST:
            raise ConfigError(
                f"the board at {self.port} has MicroPython {words}, MsBOT needs 1.22 or newer: put a new one on it "
                "(https://micropython.org/download/)"
            )
        home = home.rstrip("/")
        return BoardFacts(_short(machine), tuple(version), mpy_version, lib[0] if lib else f"{home}/lib", home)

    def free_space(self, folder: str) -> tuple[int, int] | None:
        """Octets that are free in the file system of a folder, and the size of its blocks; None if it cannot tell."""
        found = self._value(_ROOM.format(folder=folder or "/"), is_room)
        return None if found is None else (found[FREE_BLOCKS] * (found[1] or found[0]), found[1] or found[0])

    def files(self, folder: str) -> dict[str, BoardFile]:
        """The files in a folder; none if there is no such folder."""
        found: list[tuple[str, int, bytes | None]] = self._value(_LOOK.format(folder=folder), are_files, "[{}]")
        return {name: BoardFile(size, digest) for name, size, digest in found}

    def read(self, path: str) -> bytes:
        """A file's content, which has to be small."""
        code = f"with open({path!r}, 'rb') as _s:\n print(repr(_s.read()))"
        content: bytes = self._value(code, lambda found: isinstance(found, bytes))
        return content

    def make_folder(self, path: str) -> None:
        """Make a folder and those it is in, if they are not there."""
        parts = path.strip("/").split("/")
        for count in range(1, len(parts) + 1):
            name = "/" + "/".join(parts[:count])
            self.execute(f"import os\ntry:\n os.stat({name!r})\nexcept OSError:\n os.mkdir({name!r})")

    def remove(self, path: str) -> None:
        """Remove a file."""
        self.execute(f"import os\nos.remove({path!r})")

    def write(self, path: str, octets: bytes, progress: Callable[[int], object]) -> None:
        """Write a file.

        Args:
            path: its whole name on the board.
            octets: its content.
            progress: is called with the number of octets whenever some were written.

        Raises:
            ConfigError: it has no space for it.
        """
        try:
            self.execute(f"_f = open({path!r}, 'wb')\n_w = _f.write")
            for start in range(0, len(octets), CHUNK):
                chunk = octets[start : start + CHUNK]
                self.execute(f"_w({chunk!r})")
                progress(len(chunk))
            self.execute("_f.close()")
        except CodeFailed as error:
            if not _is_about_space(str(error)):
                raise LinkDown(f"the board at {self.port} cannot write {path}: {_last_line(str(error))}") from None
            with contextlib.suppress(CodeFailed):
                self.execute(f"_f.close()\nimport os\nos.remove({path!r})")
            raise ConfigError(
                f"the board at {self.port} has no space left for {path} ({len(octets)} bytes): remove files from it "
                f"(msbot board shell; import os; os.listdir())"
            ) from None

    def execute(self, code: str) -> bytes:
        """Have code executed; returns what it prints.

        Raises:
            CodeFailed: it raised an exception.
        """
        with self._in_words():
            printed, error = self._transport.exec_raw(code, timeout=ANSWER_S)
        if error:
            raise CodeFailed(error.decode("utf-8", "replace"))
        return bytes(printed)

    def run(self, code: str, out: Callable[[bytes], object]) -> str:
        """Have a program executed until it ends; Ctrl-C here is Ctrl-C there.

        Args:
            code: the program.
            out: gets every octet that it prints.

        Returns:
            The traceback with which it ended, or "".
        """
        is_interrupted = False
        with self._in_words():
            self._transport.exec_raw_no_follow(code)
            while True:
                try:
                    _, error = self._transport.follow(ANSWER_S if is_interrupted else None, data_consumer=out)
                    return bytes(error).decode("utf-8", "replace")
                except KeyboardInterrupt:
                    if is_interrupted:
                        raise
                    is_interrupted = True
                    self._transport.serial.write(b"\x03")

    def restart(self) -> None:
        """Restart Python on it, which runs main.py; it waits for no lines afterwards."""
        with self._in_words():
            self._transport.exit_raw_repl()
            self._transport.read_until(1, b">>> ", timeout=ANSWER_S)
            self._transport.serial.write(b"\x04")
            heard = self._transport.read_until(1, b"soft reboot", timeout=ANSWER_S)
        if not heard.endswith(b"soft reboot"):
            raise LinkDown(f"the board at {self.port} does not restart: press its RESET button")

    def reset(self) -> None:
        """Reset the whole board; it may vanish from its port for a moment."""
        with self._in_words():
            self._transport.exec_raw_no_follow("import machine\nmachine.reset()")

    def _value(self, code: str, fits: Callable[[Any], bool], form: str = "{}") -> Any:  # noqa: ANN401 - as `fits` says
        printed = self.execute(code).decode("utf-8", "replace").strip()
        try:
            value = ast.literal_eval(form.format(printed))
        except (ValueError, SyntaxError, TypeError, RecursionError, MemoryError):  # as its documentation says
            value = NOTHING
        if value is not NOTHING and fits(value):
            return value
        raise LinkDown(
            f"the board at {self.port} answers something else than was asked ({_short(printed)!r}): does another "
            "program use it, or is its cable bad?"
        )

    @contextlib.contextmanager
    def _in_words(self) -> Iterator[None]:
        from mpremote.transport import TransportError

        try:
            with _mpremote_is_quiet():
                yield
        except (TransportError, struct.error) as error:
            raise LinkDown(
                f"the board at {self.port} does not answer any more ({_short(str(error))}): press its RESET button, "
                "then try again"
            ) from None
        except OSError:
            raise LinkDown(
                f"the board at {self.port} was unplugged: plug it in and give the same command again; it goes on from "
                "there"
            ) from None


@contextlib.contextmanager
def open_board(port: str) -> Iterator[Board]:
    """Open a port, end what runs on its board, and restart its Python, so that all its memory is free.

    Raises:
        ConfigError: there is no such port, it cannot be used, or the library is not installed.
        LinkDown: no MicroPython answers there.
    """
    transport = _open(port)
    try:
        _enter(transport, port)
        yield Board(transport, port)
    finally:
        with contextlib.suppress(OSError):  # it was unplugged
            if transport.in_raw_repl:
                transport.exit_raw_repl()
        with contextlib.suppress(OSError):
            transport.close()


def check_port(port: str) -> None:
    """Raise ConfigError if a port cannot be opened."""
    try:
        import serial
    except ImportError:
        raise ConfigError(NEEDED) from None
    try:
        serial.Serial(port, BAUDRATE, exclusive=True).close()
    except (OSError, ValueError) as error:
        raise ConfigError(_why_closed(port, error)) from None


def _open(port: str) -> SerialTransport:
    try:
        from mpremote.transport import TransportError
        from mpremote.transport_serial import SerialTransport
    except ImportError:
        raise ConfigError(NEEDED) from None
    try:
        return SerialTransport(port, BAUDRATE, timeout=ANSWER_S)
    except TransportError:  # it does not say why
        check_port(port)
        raise ConfigError(f"the port {port} cannot be opened: try again") from None


def _why_closed(port: str, error: Exception) -> str:
    number = getattr(error, "errno", None)
    words = str(error)
    if number == errno.ENOENT or "FileNotFoundError" in words:
        return f"there is no port {port}: `msbot board list` shows those that are there"
    if number in (errno.EAGAIN, errno.EBUSY) or (sys.platform == "win32" and "PermissionError" in words):
        return f"another program uses {port}: end it (a terminal program, an editor with a console, msbot master)"
    if number == errno.ENOTTY or "Inappropriate ioctl" in words:
        return f"{port} is no serial port: `msbot board list` shows those that are there"
    if number in (errno.EACCES, errno.EPERM):
        return f"you may not use {port}: `sudo usermod -aG dialout $USER`, then log in again"
    return f"{port} cannot be used as a serial port: {_short(words)}"


def _enter(transport: SerialTransport, port: str) -> None:
    from mpremote.transport import TransportError

    heard = b""
    for _ in range(TRIES):
        try:
            with _mpremote_is_quiet() as told:
                transport.enter_raw_repl(soft_reset=True, timeout_overall=ANSWER_S)
        except TransportError:
            heard = _said(told.getvalue()) or heard
        except OSError:
            raise LinkDown(f"the board at {port} was unplugged") from None
        else:
            return
    if heard.strip():
        says = _short(heard.decode("utf-8", "replace"))
        raise LinkDown(
            f"what is at {port} does not answer as MicroPython does; it says {says!r}: "
            "is it a board with MicroPython, at 115200 baud?"
        )
    raise LinkDown(
        f"the board at {port} does not answer, not even to Ctrl-C: press its RESET button and try again; if that does "
        "not help, put MicroPython on it (https://micropython.org/download/)"
    )


def _said(printed: str) -> bytes:
    """What mpremote heard; it prints that as a bytes literal."""
    try:
        heard = ast.literal_eval(printed.strip() or "b''")
    except (ValueError, SyntaxError):
        return b""
    return heard if isinstance(heard, bytes) else b""


@contextlib.contextmanager
def _mpremote_is_quiet() -> Iterator[io.StringIO]:
    """Keep what mpremote prints by itself."""
    with contextlib.redirect_stdout(io.StringIO()) as told:
        yield told


def _is_about_space(traceback: str) -> bool:
    last = _last_line(traceback)
    return last.startswith("OSError") and ("28" in last or "ENOSPC" in last)


def _last_line(traceback: str) -> str:
    return traceback.strip().rpartition("\n")[2].strip()


def _short(words: str) -> str:
    plain = " ".join("".join(char if char.isprintable() else " " for char in words).split())
    return plain if len(plain) <= _SHOWN else plain[: _SHOWN - 1] + "…"
