"""Puts the frames of a DroneCAN bus together: the library's, which keeps what is never finished only for a while.

The library's own keeps each transfer until its last frame has come. On a bus where frames are lost, or where a node
sends beginnings without ends, it would grow for as long as the bridge runs.
"""

from __future__ import annotations

import time
from typing import Any, Final

from dronecan.transport import TransferManager

MOST_TRANSFERS: Final = 500
"""That have begun and not ended; then the oldest is given up."""
MOST_FRAMES: Final = 256
"""Of one transfer: more than the longest of the standard has."""
MOST_S: Final = 2.0
"""The standard gives up a transfer after so long without a frame."""


class BoundedTransfers(TransferManager):  # type: ignore[misc]  # the library has no types
    """See the module's docstring."""

    def __init__(self) -> None:
        super().__init__()
        self.given_up = 0
        """Transfers that never ended."""

    def receive_frame(self, frame: Any) -> Any:  # noqa: ANN401
        """See the library: the frames of a transfer that is complete, or None."""
        key = frame.transfer_key
        before = self.active_transfers.get(key)
        if before is not None and not frame.start_of_transfer and len(before) >= MOST_FRAMES:
            self._give_up(key)
            return None
        complete = super().receive_frame(frame)
        if key in self.active_transfers:  # the newest is the last, so that the first is the oldest
            self.active_transfers[key] = self.active_transfers.pop(key)
            self.remove_inactive_transfers(MOST_S)
        return complete

    def remove_inactive_transfers(self, timeout: float = MOST_S) -> None:
        """See the library; also those that are too many."""
        now = time.monotonic()
        while self.active_transfers:
            oldest = next(iter(self.active_transfers))
            is_old = now - self.active_transfer_timestamps[oldest] > timeout
            if not is_old and len(self.active_transfers) <= MOST_TRANSFERS:
                return
            self._give_up(oldest)

    def _give_up(self, key: Any) -> None:  # noqa: ANN401
        del self.active_transfers[key], self.active_transfer_timestamps[key]
        self.given_up += 1
