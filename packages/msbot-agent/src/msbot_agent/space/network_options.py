"""What the spaces of DDS and Zenoh are given for their networks."""

from __future__ import annotations

from pathlib import Path

from msbot_xrce.lazy import dataclass

MAX_DOMAIN = 232
"""DDS domains above this have no UDP ports (DDSI-RTPS 2.3 §9.6.1.1)."""


@dataclass(frozen=True, slots=True)
class TlsFiles:
    """The certificates of one end of a connection (PEM)."""

    ca: Path
    """Whose certificates are accepted."""
    certificate: Path | None = None
    """Our own; None: we show none."""
    key: Path | None = None
    """Its private key."""
