"""Modules of others that are loaded when something of them is used, not when they are imported.

For libraries that import what only some of their users need: the websocket server of the page brings the client's
half along, with two HTTP clients. The import system's own `LazyLoader` does it, so the module is whole, only later.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec, PathFinder
from importlib.util import LazyLoader
from types import ModuleType


def load_late(*names: str) -> None:
    """Have the first import of each of these modules load nothing: the first use of it does, or a second import.

    To be called before whoever imports them. A module that is loaded already, or not installed, stays so.
    """
    sys.meta_path.insert(0, _LateFinder(names))


def leave_out(*names: str) -> None:
    """Have the import of each of these modules fail, for libraries that try it and do without.

    A module that is loaded already stays.
    """
    for name in names:
        sys.modules.setdefault(name, None)  # type: ignore[arg-type]


class _LateFinder:
    """Finds what others find, and has it loaded later."""

    def __init__(self, names: Sequence[str]) -> None:
        self._names = set(names)

    def find_spec(
        self, fullname: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """As the import system asks for it."""
        if fullname not in self._names:
            return None
        self._names.discard(fullname)
        spec = PathFinder.find_spec(fullname, path, target)
        if spec is not None and spec.loader is not None:
            spec.loader = LazyLoader(spec.loader)
        return spec
