"""The seals of one robot's parts, by session, with `authentication = "key+data"`. Pure."""

from __future__ import annotations

from collections.abc import Callable

from msbot.part.join.seal import Seal


class SessionSeals:
    """Which seal belongs to which session (see `msbot.part.join.seal`).

    Args:
        changed: called with the key of every session whose seal has changed.
    """

    def __init__(self, changed: Callable[[int], None]) -> None:
        self._changed = changed
        self._seals: dict[int, Seal] = {}

    def of(self, client_key: int) -> Seal | None:
        """The seal of that session; None: its samples are not sealed."""
        return self._seals.get(client_key)

    def put(self, client_key: int, secret: bytes) -> None:
        """A session has proved its key, which produced that secret."""
        self._seals[client_key] = Seal(secret, is_part=False)
        self._changed(client_key)

    def drop(self, client_key: int) -> None:
        """A session has ended, or started over."""
        self._seals.pop(client_key, None)
