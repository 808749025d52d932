"""Where the package has the files that are not Python of its own: the installed package brings what a checkout has
elsewhere."""

from __future__ import annotations

from pathlib import Path

_PACKAGE = Path(__file__).parents[1]


def carried_folder(name: str, in_checkout: str) -> Path:
    """A folder that the package brings.

    Args:
        name: its name in the installed package, below `msbot/web`.
        in_checkout: its path from the root of a checkout.
    """
    installed = _PACKAGE / "web" / name
    return installed if installed.is_dir() else _PACKAGE.parents[1] / in_checkout
