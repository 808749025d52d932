"""What compilers and checkers have made of our sources, kept from one run to the next: in `build/kept`.

A compiled program, or a checker's verdict, depends on nothing but the sources, the tools and what they are told. As
long as none of these has changed, it is not asked for again. What fails is not kept. `make clean` forgets everything.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]  # there two workers make the same, and one of them is first

FOLDER = Path(__file__).parents[1] / "build" / "kept"
LATEST = 2
"""So many of each name are kept: another run may still use the one before."""


def kept(name: str, make: Callable[[Path], None], *, tools: Sequence[str], told: Sequence[object], of: Path) -> Path:
    """The folder that `make` has filled, now or in an earlier run.

    Args:
        name: Of what is made; a file name.
        tools: The programs that make it; one that is newer makes it anew.
        told: Everything else that it depends on: options, texts, files of libraries.
        of: The folder of sources; all of them count, those that others include, too.
    """
    key = hashlib.sha256(repr((_state_of(of), *map(_identity, tools), *map(str, told))).encode()).hexdigest()[:16]
    place = FOLDER / name / key
    if not place.exists():
        place.parent.mkdir(parents=True, exist_ok=True)
        with _alone(place.parent):
            if not place.exists():
                _fill(place, make)
    return place


def _fill(place: Path, make: Callable[[Path], None]) -> None:
    staging = Path(tempfile.mkdtemp(dir=place.parent, prefix="."))
    try:
        make(staging)
        os.rename(staging, place)  # whole or not at all
    except OSError:
        if not place.exists():  # else another worker was first
            raise
    finally:
        shutil.rmtree(staging, ignore_errors=True)
    _forget(place.parent)


@contextlib.contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """One worker makes it, and the others wait: two that install the same at once take longer than one."""
    with open(folder / ".lock", "w") as lock:
        if fcntl is not None:
            fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def said_once(name: str, ask: Callable[[], str], *, tools: Sequence[str], told: Sequence[object], of: Path) -> str:
    """What a checker says when it is content; what `ask` raises is not kept."""

    def make(folder: Path) -> None:
        (folder / "said").write_text(ask())

    return (kept(name, make, tools=tools, told=told, of=of) / "said").read_text()


def _forget(folder: Path) -> None:
    """All but the latest: the sources have changed since."""
    there = sorted(folder.glob("[!.]*"), key=lambda path: -path.stat().st_mtime)
    for path in there[LATEST:]:
        shutil.rmtree(path, ignore_errors=True)


@cache
def _state_of(folder: Path) -> str:
    """All that is in a folder, in 64 characters."""
    digest = hashlib.sha256()
    for path in sorted(path for path in folder.rglob("*") if path.is_file() and "__pycache__" not in path.parts):
        digest.update(f"{path.relative_to(folder)} {path.stat().st_size}\n".encode() + path.read_bytes())
    return digest.hexdigest()


@cache
def _identity(tool: str) -> str:
    """Which program it is, as its package installed it."""
    path = Path(shutil.which(tool) or tool).resolve()
    return f"{path} {path.stat().st_size} {path.stat().st_mtime_ns}"
