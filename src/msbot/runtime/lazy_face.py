"""Packages whose names are imported when they are used first: who needs one of them does not wait for all."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Mapping


def lazy_face(package: str, names: Mapping[str, tuple[str, ...]]) -> Callable[[str], object]:
    """What a package has as `__getattr__` (PEP 562).

    Args:
        package: its name.
        names: module of the package -> the names that come from there.
    """
    where = {name: module for module, found in names.items() for name in found}

    def find(name: str) -> object:
        if name not in where:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        value = getattr(importlib.import_module(where[name]), name)
        setattr(sys.modules[package], name, value)  # asked once
        return value

    return find
