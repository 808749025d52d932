"""What did not get through between this process and DDS."""

from __future__ import annotations

from msbot_xrce.common.lazy_dataclass import dataclass


@dataclass(slots=True)
class Counts:
    """Samples of one endpoint."""

    lost: int = 0
    """Samples pushed out before there was room for them."""
    refused: int = 0
    """Samples whose octets made no sense."""
