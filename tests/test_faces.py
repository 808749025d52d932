"""The rooms that others build on show a small face: what stands in `__all__` of a package; the rest is their own."""

from __future__ import annotations

import ast
import importlib
from functools import cache
from pathlib import Path

import pytest

from tools.sources import dotted, source_files

ROOT = Path(__file__).parent.parent
ROOMS = ("msbot_agent.agent", "msbot_agent.link", "msbot_agent.space", "msbot_xrce")
FOR_ALL = ("msbot_xrce.counting", "msbot_xrce.errors", "msbot_xrce.lazy", "msbot_xrce.identity_cache")
"""Modules that are faces themselves."""
LARGEST = 48
"""Names in one face: the submessages of DDS-XRCE with their numbers are that many."""


def faces(room: str) -> dict[str, list[str]]:
    """The packages of a room, and what each of them shows."""
    packages = [
        name
        for path in source_files()
        if path.name == "__init__.py" and f"{(name := dotted(path))}.".startswith(f"{room}.")
    ]
    return {name: list(getattr(importlib.import_module(name), "__all__", [])) for name in packages}


@cache
def imports_of(path: Path) -> list[ast.Import | ast.ImportFrom]:
    """What a file imports."""
    return [node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Import | ast.ImportFrom)]


def foreign_imports(room: str) -> list[tuple[str, str, str]]:
    """`(file, module, name)` for each import from the room by a file outside of it."""
    found = []
    for path in source_files():
        file = path.relative_to(ROOT)
        if f"{dotted(path)}.".startswith(f"{room}."):
            continue
        for node in imports_of(path):
            if isinstance(node, ast.ImportFrom) and node.module and f"{node.module}.".startswith(f"{room}."):
                found += [(str(file), node.module, name.name) for name in node.names]
            elif isinstance(node, ast.Import):
                found += [(str(file), name.name, "") for name in node.names if f"{name.name}.".startswith(f"{room}.")]
    return found


@pytest.mark.parametrize("room", ROOMS)
def test_other_rooms_use_the_face_of_a_room_and_nothing_behind_it(room: str) -> None:
    known = faces(room)
    imports = foreign_imports(room)
    assert imports
    around = [
        (file, module, name)
        for file, module, name in imports
        if name not in known.get(module, ()) and not module.startswith(FOR_ALL)
    ]
    assert around == [], "show the name in the package's __all__, or do without it"


@pytest.mark.parametrize("room", ROOMS)
def test_a_face_is_small_and_shows_what_is_used(room: str) -> None:
    for package, names in faces(room).items():
        assert len(names) <= LARGEST, package
        module = importlib.import_module(package)
        assert [name for name in names if not hasattr(module, name)] == []
