"""A copy of a piece of a recorder's ring that stays when the ring goes on, and never has more than so many octets.

Frames of buses are left out: they are most of a ring, and whoever looks at a person's work asks what the parts said. If
the rest is still too large, the copy begins later: what happened last is worth more.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from msbot.recording.recordings.excerpts import write_cut
from msbot.recording.recordings.mcap_reader import FRAMES, NS
from msbot_xrce.lazy import dataclass

SHORTEST_S: Final = 5.0
"""Of a robot that says so much that not even this fits, nothing is copied."""


@dataclass(frozen=True, slots=True)
class BoundedCopy:
    """A recording that is small enough to be kept."""

    octets: bytes
    """An MCAP file."""
    from_ns: int
    """When its first message came, nanoseconds since 1970."""
    to_ns: int
    """When its last one came."""


def bounded_copy(files: Sequence[Path], from_s: float, to_s: float, most_octets: int) -> BoundedCopy | None:
    """What a ring's files have of a time, without frames, or as much of its end as fits.

    Args:
        files: those that have something of that time, oldest first.
        from_s: since when, seconds since 1970.
        to_s: until when.
        most_octets: how large the copy may be.

    Returns:
        None: they have nothing of that time, or even its last seconds are too large.

    Raises:
        ConfigError: a file cannot be read.
    """
    while True:
        with tempfile.TemporaryDirectory(prefix="msbot-copy-") as place:
            target = Path(place, "copy.mcap")
            cut = write_cut(
                files,
                target,
                from_ns=round(from_s * NS),
                to_ns=round(to_s * NS),
                wanted=lambda message: not message.topic.startswith(FRAMES),
            )
            if cut.first_ns is None or cut.last_ns is None:
                return None
            if target.stat().st_size <= most_octets:
                return BoundedCopy(target.read_bytes(), cut.first_ns, cut.last_ns)
        from_s = max(from_s, cut.first_ns / NS)
        from_s += (to_s - from_s) / 2
        if to_s - from_s < SHORTEST_S:
            return None
