"""The MicroPython home under CPython: its package by another name, with the three modules that only MicroPython has."""

from __future__ import annotations

import asyncio
import importlib
import importlib.util
import sys
import types
import zlib
from collections.abc import Callable
from importlib.machinery import FileFinder, SourceFileLoader
from io import BytesIO
from typing import Any, ClassVar
from unittest import mock

from tests import ROOT

FOLDER = ROOT / "micropython/msbot"
NAME = "micro_msbot"


class _DeflateIO:
    """As much of `deflate.DeflateIO` as the home uses, on zlib."""

    def __init__(self, stream: BytesIO, form: int, bits: int) -> None:
        assert form == 1
        self._octets, self._bits = stream.read(), bits

    def read(self, size: int) -> bytes:
        inflater = zlib.decompressobj(-max(9, self._bits))
        try:
            out = inflater.decompress(self._octets, size)
        except zlib.error as error:
            raise OSError(str(error)) from None
        if not inflater.eof and len(out) < size:
            raise EOFError
        return out


class _Loader(SourceFileLoader):
    """Compiles each file once: modules are imported for a moment again and again."""

    _compiled: ClassVar[dict[str, types.CodeType | None]] = {}

    def get_code(self, fullname: str) -> types.CodeType | None:
        if self.path not in self._compiled:
            self._compiled[self.path] = super().get_code(fullname)
        return self._compiled[self.path]


sys.path_importer_cache[str(FOLDER)] = FileFinder(str(FOLDER), (_Loader, [".py"]))


def schedule(function: Callable[[object], object], argument: object) -> None:
    """MicroPython calls it between two steps of the interpreter."""
    asyncio.get_running_loop().call_soon(function, argument)


_MICROPYTHON = types.SimpleNamespace(const=lambda value: value, schedule=schedule)


def load(name: str = "") -> Any:
    """A module of the home, or the package itself."""
    if NAME not in sys.modules:
        sys.modules.setdefault("micropython", _MICROPYTHON)  # type: ignore[arg-type]
        sys.modules.setdefault("deflate", types.SimpleNamespace(RAW=1, DeflateIO=_DeflateIO))  # type: ignore[arg-type]
        spec = importlib.util.spec_from_file_location(
            NAME, FOLDER / "__init__.py", submodule_search_locations=[str(FOLDER)]
        )
        assert spec is not None
        assert spec.loader is not None
        sys.modules[NAME] = importlib.util.module_from_spec(spec)
        with mock.patch("builtins.print"):  # it puts its own in its place
            spec.loader.exec_module(sys.modules[NAME])
    return importlib.import_module(f"{NAME}.{name}") if name else sys.modules[NAME]


def forget() -> None:
    """Have the next `load` begin anew."""
    for name in [name for name in sys.modules if name == NAME or name.startswith(f"{NAME}.")]:
        del sys.modules[name]
