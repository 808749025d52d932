"""Loads what extensions bring for bridges, as it is loaded when it is used: for `msbot extensions`."""

from __future__ import annotations


def load_for_bridges() -> None:
    """Worlds."""
    from msbot_bridges.bridge import worlds

    worlds()
