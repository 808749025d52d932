"""The protocol of websockets, loaded when the first of them comes or the first page has gone, not before that page."""

from __future__ import annotations

import asyncio
from typing import Any


class LateWebSocket(asyncio.Protocol):
    """Becomes uvicorn's own protocol when a connection asks for one."""

    def __new__(cls, **given: Any) -> Any:  # noqa: ANN401 - whatever uvicorn gives and wants
        """The protocol for one connection."""
        return websocket_protocol()(**given)


def websocket_protocol() -> type[asyncio.Protocol]:
    """What uvicorn would have chosen at its start; here it is always installed."""
    from uvicorn.protocols.websockets.auto import AutoWebSocketsProtocol

    assert isinstance(AutoWebSocketsProtocol, type)
    return AutoWebSocketsProtocol
