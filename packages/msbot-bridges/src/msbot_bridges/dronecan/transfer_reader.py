"""Has a node of the library take in what comes, and go on after what cannot be read.

The library raises whatever it stumbles over in what others have sent: toggle bits that do not alternate, a wrong
checksum, an unknown type, a frame without data. The frame is gone then, so the next call goes on behind it.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any

from dronecan.driver.common import DriverError

import can
from msbot_bridges.dronecan.bounded_transfers import BoundedTransfers

_log = logging.getLogger("msbot.part")


class TransferReader:
    """That of one node; used in its thread.

    Args:
        node: the library's; it keeps transfers that never end only for a while from now on.
        where: its bus, for people.
        say: takes one sentence, at the first transfer that cannot be read.
    """

    def __init__(self, node: Any, where: str, say: Callable[[str], None]) -> None:  # noqa: ANN401 - it has no types
        self.unreadable = 0
        """Transfers that were left out."""
        self._node, self._where, self._say = node, where, say
        node._transfer_manager = BoundedTransfers()  # noqa: SLF001 - it has no other way

    def spin(self, timeout_s: float, most_unreadable: int = 1) -> None:
        """Take in what comes, and do what is due.

        Args:
            timeout_s: how long; 0: only what is there.
            most_unreadable: transfers that may be left out in this call; then the next one goes on.

        Raises:
            DriverError, CanError: the bus has ended.
        """
        for _ in range(most_unreadable):
            try:
                self._node.spin(timeout_s)
            except (DriverError, can.CanError):
                raise
            except Exception as error:  # see the module's docstring
                self.unreadable += 1
                _log.debug("%s: a transfer cannot be read", self._where, exc_info=True)
                if self.unreadable == 1:
                    self._say(f"something on this bus cannot be read, and is left out: {error}")
            else:
                return
