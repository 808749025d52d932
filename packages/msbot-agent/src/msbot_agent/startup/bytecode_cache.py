"""What is made from a file that MsBOT brings, kept as byte-code beside it, as Python keeps that of its own modules.

The part library, the catalogues of languages and the templates of the page are read at every start, and to parse them
took longer than to load the code that does it. Python's own loader looks after what is kept: it is made anew when the
file has another time or size, goes where `PYTHONPYCACHEPREFIX` says, and is not written where nobody may write or
`PYTHONDONTWRITEBYTECODE` forbids it. Only for files of the package: what is kept is executed.
"""

from __future__ import annotations

import gc
import tomllib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from importlib.machinery import SourceFileLoader
from importlib.resources.abc import Traversable
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any
from zlib import crc32


def cached_definitions(path: Path, to_python: Callable[[bytes], str], mark: str) -> dict[str, Any]:
    """The names that a Python text defines.

    Args:
        path: the file.
        to_python: makes the text from what the file has in it; called only if nothing fitting was kept.
        mark: names `to_python` and what it depends on; what was kept under another mark does not fit.

    Raises:
        OSError: the file cannot be read.
    """
    module = ModuleType(path.stem)
    module.__file__ = str(path)
    _Loader(path, to_python, mark).exec_module(module)
    return vars(module)


def packaged_toml(entry: Traversable) -> Mapping[str, Any]:
    """The values of a TOML file of the package: text, numbers, truth, lists and tables, no dates.

    Raises:
        OSError: the file cannot be read.
        tomllib.TOMLDecodeError: it is not TOML.
    """
    if not isinstance(entry, Path):  # in an archive
        return tomllib.loads(entry.read_text("utf-8"))
    values: Mapping[str, Any] = cached_definitions(entry, _toml_to_python, "TOML 1")["values"]
    return values


def _toml_to_python(octets: bytes) -> str:
    return f"values = {tomllib.loads(octets.decode())!r}"


class _Loader(SourceFileLoader):
    """Python's loader of modules, for a file that is none until it is put into Python."""

    def __init__(self, path: Path, to_python: Callable[[bytes], str], mark: str) -> None:
        super().__init__(path.stem, str(path))
        self._to_python = to_python
        self._mark = crc32(mark.encode())

    def path_stats(self, path: Any) -> Mapping[str, Any]:  # noqa: ANN401 - as the class it extends
        """As the loader asks for it: it compares 32 bits of the time, and the mark changes those."""
        stats = super().path_stats(path)
        return {**stats, "mtime": (int(stats["mtime"]) + self._mark) & 0xFFFFFFFF}

    def source_to_code(self, data: Any, path: Any, **options: Any) -> CodeType:  # type: ignore[override]  # noqa: ANN401
        """As the loader asks for it."""
        return super().source_to_code(self._to_python(bytes(data)).encode(), path, **options)


# What is made at the start and stays until the end: no garbage is looked for in it, neither then nor later.


@contextmanager
def without_garbage_collection() -> Iterator[None]:
    """Suspend garbage collection while something large is loaded, and exempt all that is there from it for good.

    This saves a sixth of the time to start, and long pauses later while the robot runs.
    """
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()
