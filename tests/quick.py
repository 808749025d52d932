"""`pytest -p tests.quick`: only the tests without processes, browsers, servers and virtual machines (`make quick`).

A file of tests is left out if it imports what starts one of these, itself or by another module of the tests.
"""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

from tests import FOLDERS, place_of

STARTS = re.compile(r"^\s*(?:import|from) (?:subprocess|multiprocessing|playwright|schemathesis)\b", re.MULTILINE)
_OURS = re.compile(r"^\s*(?:from (tests[\w.]*) import ([\w, ()\n]+)|import (tests[\w.]+))", re.MULTILINE)
ANYWAY = ("registry/postgres.py",)
"""Their users run without it, too."""


def pytest_ignore_collect(collection_path: Path) -> bool | None:
    """Leave out folders whose fixtures start something, and files that do."""
    fixtures = collection_path / "conftest.py" if collection_path.is_dir() else collection_path
    if (
        collection_path not in FOLDERS
        and fixtures.is_file()
        and fixtures.suffix == ".py"
        and starts_something(fixtures)
    ):
        return True
    return None


@cache
def starts_something(file: Path) -> bool:
    """Whether a module of the tests starts processes, by itself or by what it imports."""
    if (place := place_of(file)) is not None and place.as_posix() in ANYWAY:
        return False
    text = file.read_text()
    if STARTS.search(text):
        return True
    return any(starts_something(other) for other in _imported(text) if other != file)


def _imported(text: str) -> set[Path]:
    found = set[Path]()
    for package, names, module in _OURS.findall(text):
        name = package or module
        for tests in FOLDERS:
            folder = tests / name.partition(".")[2].replace(".", "/")
            wanted = [folder.with_suffix(".py"), *(folder / f"{one.strip(' (),')}.py" for one in names.split(","))]
            found.update(path for path in wanted if path.is_file())
    return found
