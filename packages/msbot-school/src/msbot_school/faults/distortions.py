"""What a broken sensor says. Pure."""

from __future__ import annotations

from collections.abc import Mapping

from msbot.config import FieldKind, PartType, Scalar
from msbot.sim import fit


class Stuck:
    """The first values are said for ever.

    Args:
        port: only this port; empty: all.
    """

    def __init__(self, port: str) -> None:
        self._port = port
        self._first: dict[str, Mapping[str, Scalar]] = {}

    def __call__(self, port: str, fields: Mapping[str, Scalar], now: float) -> Mapping[str, Scalar]:  # noqa: ARG002
        """See `Distortion`."""
        if self._port and port != self._port:
            return fields
        return self._first.setdefault(port, fields)


class Drifting:
    """Numbers move away from what is true.

    Args:
        port: only this port; empty: all.
        per_minute: how much they move.
        part_type: says what its messages can hold.
    """

    def __init__(self, port: str, per_minute: float, part_type: PartType) -> None:
        self._port = port
        self._per_s = per_minute / 60
        self._kinds: dict[str, Mapping[str, FieldKind]] = {
            one.name: one.message.fields for one in part_type.ports if one.message is not None
        }
        self._began_at: float | None = None

    def __call__(self, port: str, fields: Mapping[str, Scalar], now: float) -> Mapping[str, Scalar]:
        """See `Distortion`."""
        if self._port and port != self._port:
            return fields
        if self._began_at is None:
            self._began_at = now
        moved = self._per_s * (now - self._began_at)
        return {name: self._moved(port, name, value, moved) for name, value in fields.items()}

    def _moved(self, port: str, name: str, value: Scalar, moved: float) -> Scalar:
        if isinstance(value, bool | str):
            return value
        return fit(self._kinds[port][name], value + moved)
