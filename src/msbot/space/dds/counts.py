"""What did not get through between this process and DDS."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(slots=True)
class Counts:
    """Samples of one endpoint."""

    lost: int = 0
    """Pushed out before there was room for them."""
    refused: int = 0
    """Whose octets made no sense on the way."""
