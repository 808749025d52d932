"""The data types of Cyphal for the library `pycyphal`: compiled once for this user, and kept.

The definitions are in the folder `dsdl`: those that the bridge uses, with the names, fields and port ids of the
standard. The library compiles them into the packages `uavcan` and `reg`, a job of seconds, so a process of its own does
it, and the result is kept in the user's cache, by what it was made from.
"""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import importlib
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Final

from msbot_agent.process.user_folders import cache_folder, make_own_folder
from msbot_xrce.errors import ConfigError

DEFINITIONS: Final = Path(__file__).parent / "dsdl"
NAMESPACES: Final = ("uavcan", "reg")
LATEST: Final = 2
"""So many results are kept: another version of MsBOT may use the one before."""
ABANDONED_S: Final = 3600.0
"""A folder that was begun so long ago will not be finished."""
_MAKING: Final = ".making-"


def folder_of_types(cache: Path | None = None) -> Path:
    """Where the compiled types are, or will be.

    Args:
        cache: the folder of caches; that of this user unless given.
    """
    digest = hashlib.sha256()
    for package in ("pycyphal", "nunavut", "pydsdl"):
        digest.update(f"{package} {version(package)}\n".encode())
    for path in sorted(DEFINITIONS.rglob("*.dsdl")):
        digest.update(f"{path.relative_to(DEFINITIONS).as_posix()}\n".encode() + path.read_bytes())
    return (cache or cache_folder()) / "cyphal" / digest.hexdigest()[:16]


async def load_types() -> None:
    """Make `uavcan` and `reg` importable; compiles them if this user has not done so yet.

    Raises:
        ConfigError: they cannot be compiled, or kept, or another package is in the way.
    """
    folder = await asyncio.to_thread(folder_of_types)
    if not folder.exists():
        compiling = await asyncio.create_subprocess_exec(
            *(sys.executable, "-m", "msbot_bridges.cyphal.compile_types", str(folder)),
            stdin=asyncio.subprocess.DEVNULL,
            stderr=asyncio.subprocess.PIPE,
        )
        try:
            _, told = await compiling.communicate()
        finally:
            if compiling.returncode is None:
                with contextlib.suppress(ProcessLookupError):
                    compiling.kill()
                await compiling.wait()
        if compiling.returncode:
            reason = told.decode(errors="replace").strip().rpartition("\n")[2] or f"status {compiling.returncode}"
            raise ConfigError(
                f"the data types of Cyphal cannot be compiled into {folder}, where a folder is needed that can be "
                f"written ({reason})"
            )
    await asyncio.to_thread(_import, folder)


def compile_types(folder: Path, definitions: Path = DEFINITIONS) -> None:
    """Compile into a folder, which appears whole or not at all, whoever else does the same.

    Args:
        folder: where the types are to be.
        definitions: the folder of their definitions.

    Raises:
        OSError: it cannot be written.
    """
    with _staging(folder) as staging:
        import pycyphal.dsdl

        pycyphal.dsdl.compile_all([definitions / name for name in NAMESPACES], output_directory=staging)
        try:
            staging.rename(folder)
        except OSError:
            if not folder.is_dir():  # else somebody else was first
                raise
    _forget(folder.parent)


@contextmanager
def _staging(folder: Path) -> Iterator[Path]:
    make_own_folder(folder.parent)
    staging = Path(tempfile.mkdtemp(dir=folder.parent, prefix=_MAKING))
    try:
        yield staging
    finally:
        shutil.rmtree(staging, ignore_errors=True)


def _forget(folder: Path) -> None:
    """All but the latest, and what others have begun and not finished."""
    there = {path: path.stat().st_mtime for path in folder.iterdir() if path.is_dir()}
    finished = sorted((path for path in there if not path.name.startswith(_MAKING)), key=lambda path: -there[path])
    for path, begun in there.items():
        if path in finished[LATEST:] or (path not in finished and time.time() - begun > ABANDONED_S):
            shutil.rmtree(path, ignore_errors=True)


def _import(folder: Path) -> None:
    """Load them all, so that they stay when another version of MsBOT makes room in the cache."""
    for name in (*NAMESPACES, "nunavut_support"):
        there = getattr(sys.modules.get(name), "__file__", None)
        if there is not None and folder not in Path(there).parents:
            raise ConfigError(f"{there} has the name of Cyphal's data types; run the bridge without that package")
    if str(folder) not in sys.path:
        sys.path.insert(0, str(folder))
        importlib.invalidate_caches()
    os.environ.setdefault("PYCYPHAL_NO_IMPORT_HOOK", "1")  # it would compile whatever is imported and missing
    for path in sorted(folder.rglob("__init__.py")):
        importlib.import_module(".".join(path.parent.relative_to(folder).parts))
