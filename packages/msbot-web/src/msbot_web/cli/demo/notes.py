"""Lines for the person at the terminal while a demo runs."""

from __future__ import annotations

from collections.abc import Callable


class Notes:
    """Lines for the person at the terminal while the robot runs, such as the page's address."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.say: Callable[[str], None] | None = None
        """Prints a line at once; None: the screen shows `lines`."""

    def add(self, line: str) -> None:
        """Say a line, now or on the screen."""
        self.lines.append(line)
        if self.say is not None:
            self.say(line)
