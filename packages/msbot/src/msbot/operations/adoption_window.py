"""The adoption window: for a while, a person lets in parts that the library would turn away. Pure."""

from __future__ import annotations

from msbot_agent.text.sentence import said
from msbot_xrce.errors import ConfigError

LONGEST_WINDOW_S = 3600.0


class AdoptionWindow:
    """One adoption window, closed at first."""

    def __init__(self) -> None:
        self.slot: str | None = None
        """The slot that the next newcomer gets automatically; None: none, a person names part and slot."""
        self.who = ""
        """Who opened it."""
        self._until: float | None = None

    def open(self, seconds: float, slot: str | None, who: str, now: float) -> None:
        """Open it, or open it again.

        Raises:
            ConfigError: the time is out of range.
        """
        if not 1.0 <= seconds <= LONGEST_WINDOW_S:
            raise ConfigError(
                said(
                    "an adoption window of {seconds:g} s: it must be 1 to {longest_window_s:g} s",
                    seconds=seconds,
                    longest_window_s=LONGEST_WINDOW_S,
                )
            )
        self._until, self.slot, self.who = now + seconds, slot, who

    def close(self) -> None:
        """Close it; does nothing when it is closed."""
        self._until, self.slot = None, None

    def remaining_s(self, now: float) -> float:
        """How long it stays open; 0 = closed."""
        return 0.0 if self._until is None else max(0.0, self._until - now)
