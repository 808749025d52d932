"""A root shell in the virtual computer, for trials: systemd starts one at a second serial line when the kernel's
command line asks for it (`systemd.debug_shell`). The card's files stay as they are flashed."""

from __future__ import annotations

import socket
import time
from pathlib import Path

from tools.card_image.base import ImageError

TTY = "ttyS0"
"""The line in the machine: a serial port at PCI."""
READY_S = 900.0
_MARK = "msbot-trial"


def line(place: Path) -> tuple[list[str], str]:
    """What qemu and the kernel have to be told.

    Args:
        place: the socket.
    """
    words = ["-chardev", f"socket,id=shell,path={place},server=on,wait=off", "-device", "pci-serial,chardev=shell"]
    return words, f"systemd.debug_shell={TTY}"


class Shell:
    """The shell, from outside; one command after the other.

    Args:
        place: the socket.
    """

    def __init__(self, place: Path) -> None:
        self._place = place
        self._socket: socket.socket | None = None
        self._number = 0

    def open(self, within_s: float = READY_S) -> None:
        """Wait until it answers.

        Raises:
            ImageError: it does not.
        """
        until = time.monotonic() + within_s
        self.close()
        while time.monotonic() < until:
            try:
                self._socket = _connected(self._place)
                break
            except OSError:
                time.sleep(0.5)
        while time.monotonic() < until:
            try:
                self.run("stty -echo; PS1=; true", within_s=10)
                return
            except TimeoutError:
                continue
        raise ImageError(f"the machine's shell does not answer within {within_s:.0f} s")

    def close(self) -> None:
        """Let it go."""
        if self._socket is not None:
            self._socket.close()
        self._socket = None

    def run(self, command: str, within_s: float = 300.0) -> str:
        """Run a command; returns what it says.

        Raises:
            ImageError: it fails.
            TimeoutError: it is not done in time.
        """
        status, said = self.ask(command, within_s)
        if status:
            raise ImageError(f"in the machine, `{command}` fails with {status}: {said}")
        return said

    def ask(self, command: str, within_s: float = 300.0) -> tuple[int, str]:
        """Run a command; returns its status and what it says.

        Raises:
            TimeoutError: it is not done in time.
        """
        assert self._socket is not None
        self._number += 1
        begin, end = f"<{_MARK} {self._number}>", f"<{_MARK} {self._number} is done:"
        # The marks are put together by the shell, so that an echo of this line has none.
        said = f"printf '<%s>\\n' '{_MARK} {self._number}'; {{ {command}\n}} 2>&1; printf '<%s %d>\\n' "
        self._socket.sendall(f"{said}'{_MARK} {self._number} is done:' $?\n".encode())
        self._socket.settimeout(1.0)
        got, until = b"", time.monotonic() + within_s
        while True:
            text = got.decode("utf-8", "replace").replace("\r", "")
            _, found, behind = text.partition(begin + "\n")
            said, ended, rest = behind.partition(end)
            if found and ended and ">" in rest:
                return int(rest.partition(">")[0]), said.strip("\n")
            if time.monotonic() > until:
                raise TimeoutError(f"`{command}` is not done within {within_s:.0f} s: {text[-500:]}")
            try:
                piece = self._socket.recv(1 << 16)
            except TimeoutError:
                continue
            if not piece:
                raise ImageError("the machine has closed its shell")
            got += piece

    def wait_for(self, command: str, within_s: float = 600.0) -> str:
        """Run a command again and again until it succeeds; returns what it says then.

        Raises:
            ImageError: it does not in time.
        """
        until = time.monotonic() + within_s
        while True:
            status, said = self.ask(command)
            if not status:
                return said
            if time.monotonic() > until:
                raise ImageError(f"in the machine, `{command}` fails for {within_s:.0f} s, with {status}: {said}")
            time.sleep(1.0)


def _connected(place: Path) -> socket.socket:
    made = socket.socket(socket.AF_UNIX)
    try:
        made.connect(str(place))
    except OSError:
        made.close()
        raise
    return made
