"""Single key presses from the terminal, without waiting for Enter."""

from __future__ import annotations

import asyncio
import os
import sys
from collections.abc import Callable
from types import TracebackType

if sys.platform != "win32":
    import termios
    import tty


class KeyPresses:
    """While open, calls `pressed` in the event loop with every key; does nothing if stdin is not a terminal."""

    def __init__(self, pressed: Callable[[str], None]) -> None:
        self._pressed = pressed
        self._saved: list[int | list[bytes | int]] | None = None

    def __enter__(self) -> KeyPresses:
        if sys.platform == "win32" or not sys.stdin.isatty():
            return self
        descriptor = sys.stdin.fileno()
        self._saved = termios.tcgetattr(descriptor)
        tty.setcbreak(descriptor)
        asyncio.get_running_loop().add_reader(descriptor, self._read)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._saved is not None and sys.platform != "win32":
            descriptor = sys.stdin.fileno()
            asyncio.get_running_loop().remove_reader(descriptor)
            termios.tcsetattr(descriptor, termios.TCSADRAIN, self._saved)

    def _read(self) -> None:
        for key in os.read(sys.stdin.fileno(), 64).decode(errors="replace"):
            self._pressed(key)
