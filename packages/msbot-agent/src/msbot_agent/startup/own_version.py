"""The version of MsBOT that this is."""

from __future__ import annotations

from functools import cache


@cache
def own_version() -> str:
    """As `msbot --version` says it; `unknown` when MsBOT runs without having been installed."""
    from importlib.metadata import PackageNotFoundError, version  # slow to load, and seldom needed

    try:
        return version("msbot-agent")
    except PackageNotFoundError:
        return "unknown"
