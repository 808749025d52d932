"""Where a distribution has the files that are not Python of its own: the installed package brings what a checkout has
elsewhere."""

from __future__ import annotations

from pathlib import Path

ROOT_OF_CHECKOUT = 3
"""Where the root is among the parents of a package: src, msbot-web, packages, the root."""


def carried_folder(package: Path, installed: str, in_checkout: str) -> Path:
    """A folder that a distribution brings.

    Args:
        package: the folder of its import package.
        installed: the folder's name below that one in the installed distribution.
        in_checkout: its path from the root of a checkout.
    """
    folder = package / installed
    return folder if folder.is_dir() else package.parents[ROOT_OF_CHECKOUT] / in_checkout
