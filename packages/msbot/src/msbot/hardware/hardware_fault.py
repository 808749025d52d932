"""What can be wrong with hardware, as one sentence that says what to check."""

from __future__ import annotations

from msbot_xrce.errors import MsbotError


class HardwareFault(MsbotError):
    """A chip, pin or device does not answer or cannot be used; the text says what to check."""


def missing_library(what: str, library: str) -> HardwareFault:
    """The sentence about a library that is not installed."""
    return HardwareFault(f"{what} need the library {library}: `pip install 'msbot[hardware]'` brings it")
