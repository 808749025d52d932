"""Tests of the whole, and what all tests share; those of one distribution are in its folder.

They are one package, `tests`, wherever they are: `packages/msbot-agent/tests/link` is `tests.link`.
"""

from pathlib import Path

ROOT = Path(__file__).parent.parent
FOLDERS = (Path(__file__).parent, *sorted(ROOT.glob("packages/*/tests")))
"""Where tests are."""
__path__.extend(map(str, FOLDERS[1:]))


def place_of(file: Path) -> Path | None:
    """A file's or folder's place in the package: `link/net/test_udp.py`; None for what is no test."""
    return next((file.relative_to(folder) for folder in FOLDERS if file.is_relative_to(folder)), None)
