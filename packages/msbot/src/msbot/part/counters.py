"""What is counted of a part while it runs."""

from __future__ import annotations

from msbot_xrce.common.lazy_dataclass import dataclass


@dataclass(slots=True)
class PartCounters:
    """Counts of what happened to a part since it began to run."""

    messages_in: int = 0
    """Samples handed to a handler."""
    messages_out: int = 0
    """Samples published."""
    not_sent: int = 0
    """Samples not sent because the stream or the link had no room."""
    dropped: int = 0
    """Samples that arrived and could not be used."""
    refused: int = 0
    """Samples without a good seal, in a robot with `authentication = "key+data"`."""
    held: int = 0
    """Samples that arrived after STOP and were not used."""
    beats: int = 0
    """Beats that the inventory answered."""
    missed_beats: int = 0
    handler_errors: int = 0
