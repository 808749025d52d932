"""NiceGUI's outboxes sleep until they are told that something is to be sent to their browser.

They are told in any case, also when they are to end; besides, each would look once a second by itself.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable
from typing import Any

from nicegui import outbox


class _UntilTold:
    """What outboxes use of asyncio; their waiting has no limit."""

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - whatever is there
        return getattr(asyncio, name)

    @staticmethod
    async def wait_for(told: Awaitable[object], timeout: float) -> None:  # noqa: ARG004, ASYNC109 - asyncio's signature
        """Wait until it is told."""
        await told


def let_outboxes_sleep() -> None:
    """From now on, in this process."""
    vars(outbox)["asyncio"] = _UntilTold()
